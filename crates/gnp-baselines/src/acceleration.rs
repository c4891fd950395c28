//! Constant acceleration, until the vehicle is stationary.

use gnp_data::{Forecast, Observation, PredictError, Predictor, Window};
use serde::{Deserialize, Serialize};

use crate::by_site::BySite;
use crate::motion::{BaselineError, certain, check_span, periods, velocity_and_acceleration};
use crate::rule::{Rule, parameters, parsed};
use crate::span::best_span;

const NAME: &str = "constant acceleration";

/// The span is fitted by site.
pub(crate) const RULE: Rule = Rule::new(
    NAME,
    "Every vehicle keeps the acceleration of the last moments, until it is stationary.",
    |training| parameters(NAME, &BySite::fit(training, ConstantAcceleration::fit)?),
    |of| {
        Ok(Box::new(parsed::<BySite<ConstantAcceleration>>(NAME, of)?.made(|of| ConstantAcceleration::new(of.span_s))?))
    },
);

/// Every vehicle goes on to speed up, slow down and swerve as over the last moments.
///
/// Vehicles do not drive backwards: while the forward speed would be below 0 it is 0, and there is
/// no motion sideways either. A vehicle that brakes stops and stays there; a stationary one that
/// speeds up sets off when the speed comes above 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstantAcceleration {
    span_s: f64,
}

impl ConstantAcceleration {
    /// Time the motion is estimated from, s, where nothing else is asked for and nothing is fitted: noisy positions ask
    /// for more, smooth ones for less.
    pub const SPAN_S: f64 = 1.;

    /// Estimates velocity and acceleration by a least-squares parabola over the last `span_s`
    /// seconds of positions, rounded to whole frames, two at the least.
    ///
    /// # Errors
    /// When `span_s` is not a positive number.
    pub fn new(span_s: f64) -> Result<Self, BaselineError> {
        check_span(span_s, Self::SPAN_S)?;
        Ok(Self { span_s })
    }

    /// The span, from two frames to the whole past, with the least squared error over whole seconds of `windows`
    /// (training ones).
    ///
    /// # Errors
    /// When there is no window, or they differ in shape or have fewer than three observed frames.
    pub fn fit(windows: &[Window<'_>]) -> Result<Self, BaselineError> {
        Self::new(best_span(NAME, windows, 2, Self::new)?)
    }

    /// Time the motion is estimated from, s.
    #[must_use]
    pub fn span_s(&self) -> f64 {
        self.span_s
    }
}

impl Default for ConstantAcceleration {
    /// With [`ConstantAcceleration::SPAN_S`].
    fn default() -> Self {
        Self { span_s: Self::SPAN_S }
    }
}

impl Predictor for ConstantAcceleration {
    fn name(&self) -> &str {
        NAME
    }

    fn predict(&self, observations: &[Observation<'_>], _k: usize) -> Result<Vec<Forecast>, PredictError> {
        let one = |observation: &Observation<'_>| {
            let shape = observation.shape();
            let periods = periods(NAME, shape, self.span_s, 2)?;
            let (velocity, acceleration) = velocity_and_acceleration(observation, periods);
            let [from, to] = driving(velocity[0], acceleration[0]);
            let along = |axis: usize, time: f64| velocity[axis] * time + acceleration[axis] * time * time / 2.;
            // From the start to `time`, as far as the vehicle drives.
            let moved = |axis: usize, time: f64| along(axis, time.clamp(from, to)) - along(axis, from);
            Ok(certain(shape, |time| if from < to { [moved(0, time), moved(1, time)] } else { [0.; 2] }))
        };
        observations.iter().map(one).collect()
    }
}

/// The times, s, from and to which a forward speed of `speed + acceleration * t` is above 0; empty
/// where it never is.
fn driving(speed: f64, acceleration: f64) -> [f64; 2] {
    let turn = -speed / acceleration;
    match (speed > 0., acceleration) {
        (true, a) if a < 0. => [0., turn],
        (true, _) => [0., f64::INFINITY],
        (false, a) if a > 0. => [turn, f64::INFINITY],
        (false, _) => [0., 0.],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drives_only_while_the_speed_is_above_zero() {
        let forever = f64::INFINITY;
        assert_eq!(driving(10., -2.), [0., 5.]);
        assert_eq!(driving(10., 0.), [0., forever]);
        assert_eq!(driving(10., 2.), [0., forever]);
        assert_eq!(driving(-1., 2.), [0.5, forever]);
        assert_eq!(driving(0., 2.), [0., forever]);
        assert_eq!(driving(-1., 0.), [0., 0.]);
        assert_eq!(driving(0., -1.), [0., 0.]);
    }
}
