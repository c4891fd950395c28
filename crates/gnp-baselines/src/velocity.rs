//! Constant velocity.

use gnp_data::{Forecast, Observation, PredictError, Predictor, Window};
use serde::{Deserialize, Serialize};

use crate::by_site::BySite;
use crate::motion::{BaselineError, certain, check_span, periods, velocity};
use crate::rule::{Rule, parameters, parsed};
use crate::span::best_span;

const NAME: &str = "constant velocity";

/// The span is fitted by site.
pub(crate) const RULE: Rule = Rule::new(
    NAME,
    "Every vehicle keeps the velocity of the last moments.",
    |training| parameters(NAME, &BySite::fit(training, ConstantVelocity::fit)?),
    |of| Ok(Box::new(parsed::<BySite<ConstantVelocity>>(NAME, of)?.made(|of| ConstantVelocity::new(of.span_s))?)),
);

/// Every vehicle keeps the velocity of the last moments: the first thing to be better than.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstantVelocity {
    span_s: f64,
}

impl ConstantVelocity {
    /// Time the velocity is estimated from, s, where nothing else is asked for and nothing is fitted: noisy positions ask
    /// for more, smooth ones for less.
    pub const SPAN_S: f64 = 0.8;

    /// Estimates the velocity by least squares over the last `span_s` seconds of positions, rounded
    /// to whole frames, one at the least: then it is the backward difference.
    ///
    /// # Errors
    /// When `span_s` is not a positive number.
    pub fn new(span_s: f64) -> Result<Self, BaselineError> {
        check_span(span_s, Self::SPAN_S)?;
        Ok(Self { span_s })
    }

    /// The span, from one frame to the whole past, with the least squared error over whole seconds of `windows`
    /// (training ones).
    ///
    /// # Errors
    /// When there is no window, or they differ in shape or have a single observed frame.
    pub fn fit(windows: &[Window<'_>]) -> Result<Self, BaselineError> {
        Self::new(best_span(NAME, windows, 1, Self::new)?)
    }

    /// Time the motion is estimated from, s.
    #[must_use]
    pub fn span_s(&self) -> f64 {
        self.span_s
    }
}

impl Default for ConstantVelocity {
    /// With [`ConstantVelocity::SPAN_S`].
    fn default() -> Self {
        Self { span_s: Self::SPAN_S }
    }
}

impl Predictor for ConstantVelocity {
    fn name(&self) -> &str {
        NAME
    }

    fn predict(&self, observations: &[Observation<'_>], _k: usize) -> Result<Vec<Forecast>, PredictError> {
        let one = |observation: &Observation<'_>| {
            let shape = observation.shape();
            let [vx, vy] = velocity(observation, periods(NAME, shape, self.span_s, 1)?);
            Ok(certain(shape, |time| [vx * time, vy * time]))
        };
        observations.iter().map(one).collect()
    }
}
