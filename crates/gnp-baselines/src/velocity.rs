//! Constant velocity.

use gnp_data::{Forecast, Observation, PredictError, Predictor};
use serde::{Deserialize, Serialize};

use crate::motion::{BaselineError, certain, check_span, periods, velocity};
use crate::rule::{Rule, parameters, parsed};

const NAME: &str = "constant velocity";

/// Nothing is fitted: the span is [`ConstantVelocity::SPAN_S`].
pub(crate) const RULE: Rule = Rule::new(
    NAME,
    "Every vehicle keeps the velocity of the last moments.",
    |_| parameters(NAME, &ConstantVelocity::default()),
    |of| Ok(Box::new(ConstantVelocity::new(parsed::<ConstantVelocity>(NAME, of)?.span_s)?)),
);

/// Every vehicle keeps the velocity of the last moments: the first thing to be better than.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstantVelocity {
    span_s: f64,
}

impl ConstantVelocity {
    /// Time the velocity is estimated from, s, where nothing else is asked for.
    ///
    /// Of all spans it has the smallest error at every horizon on the US-101 scenes in `fixtures/`,
    /// whose positions are noisy: RMSE at 5 s of 6.77 m, against 8.27 m with one frame (0.1 s), 6.83 m
    /// with 1 s and 8.26 m with 3 s. Smooth positions ask for less: on the I-80 lanes it is 5.40 m
    /// against 4.93 m with one frame.
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
