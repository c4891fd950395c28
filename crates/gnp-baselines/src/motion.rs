//! Velocity and acceleration at the last observed frame, from observed positions.

use gnp_data::{Forecast, Mode, Observation, PredictError, WindowShape};

/// Why a baseline cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BaselineError {
    /// A time to estimate from that is no time.
    #[error("a motion cannot be estimated over {seconds} s; take a positive number of seconds, such as {default}")]
    Span {
        /// The time asked for, s.
        seconds: f64,
        /// The default, s.
        default: f64,
    },
    /// A parameter out of its range.
    #[error("`{key}` cannot be {value}; take a positive number, for a share one up to 1, such as {default}")]
    Parameter {
        /// Its name.
        key: &'static str,
        /// What it was.
        value: f64,
        /// The default.
        default: f64,
    },
    /// Nothing to fit to.
    #[error("there is no window to fit to; give training windows")]
    NoWindows,
    /// Windows that cannot be fitted to together.
    #[error(
        "windows of several shapes, or with a single observed frame, cannot be fitted to; cut them alike, with 2 observed frames or more"
    )]
    Shapes,
    /// Parameters of a rule that cannot be found or read.
    #[error("{rule}: the parameters cannot be fitted or read; fit it anew to training windows")]
    Rule {
        /// Name of the rule.
        rule: String,
        /// What failed.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

/// Checks a time to estimate from.
pub(crate) fn check_span(seconds: f64, default: f64) -> Result<(), BaselineError> {
    if seconds.is_finite() && seconds > 0. { Ok(()) } else { Err(BaselineError::Span { seconds, default }) }
}

/// Frame periods in `seconds`, at least `least`; an error where the window observes fewer.
pub(crate) fn periods(model: &str, shape: WindowShape, seconds: f64, least: usize) -> Result<usize, PredictError> {
    let periods = ((seconds * shape.rate_hz).round() as usize).max(least);
    if periods < shape.t_obs {
        return Ok(periods);
    }
    Err(PredictError::Shape {
        model: model.to_owned(),
        needs: format!("{} observed frames ({seconds} s at {} Hz)", periods.saturating_add(1), shape.rate_hz),
        found: format!("{}", shape.t_obs),
    })
}

/// Positions of the target in the last `periods + 1` observed frames, m, oldest first.
fn recent(observation: &Observation<'_>, periods: usize) -> impl Iterator<Item = [f64; 2]> {
    let t_obs = observation.shape().t_obs;
    (t_obs - 1 - periods..t_obs).map(|i| {
        let state = observation.target(i);
        [f64::from(state.x), f64::from(state.y)]
    })
}

/// Slope of the straight line through the last `periods + 1` positions, m/s. One period gives the
/// backward difference.
pub(crate) fn velocity(observation: &Observation<'_>, periods: usize) -> [f64; 2] {
    let positions: Vec<[f64; 2]> = recent(observation, periods).collect();
    [0, 1].map(|axis| slope(positions.iter().map(|position| position[axis])) / observation.shape().dt())
}

/// Slope of the straight line through two values or more, one a period, per period.
pub(crate) fn slope(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    // Time is counted around the middle of the stretch, where the slope does not depend on the mean
    // value.
    let middle = (values.len() as f64 - 1.) / 2.;
    let (mut products, mut squares) = (0., 0.);
    for (i, value) in values.enumerate() {
        let time = i as f64 - middle;
        squares += time * time;
        products += time * value;
    }
    products / squares
}

/// Velocity (m/s) at the last observed frame and acceleration (m/s²) of the parabola through the
/// last `periods + 1` positions, at least three.
pub(crate) fn velocity_and_acceleration(observation: &Observation<'_>, periods: usize) -> ([f64; 2], [f64; 2]) {
    // Around the middle of the stretch, t and t^2 - mean(t^2) are orthogonal: two sums, no system.
    let dt = observation.shape().dt();
    let middle = periods as f64 / 2.;
    let times = || (0..=periods).map(|i| i as f64 - middle);
    let squares: f64 = times().map(|t| t * t).sum();
    let mean = squares / (periods + 1) as f64;
    let spread: f64 = times().map(|t| (t * t - mean).powi(2)).sum();
    let (mut linear, mut quadratic) = ([0.; 2], [0.; 2]);
    for (t, position) in times().zip(recent(observation, periods)) {
        for axis in 0..2 {
            linear[axis] += t * position[axis];
            quadratic[axis] += (t * t - mean) * position[axis];
        }
    }
    let acceleration = quadratic.map(|q| 2. * q / spread / (dt * dt));
    let at_end = |axis: usize| linear[axis] / squares / dt + acceleration[axis] * middle * dt;
    ([at_end(0), at_end(1)], acceleration)
}

/// One future with probability 1: the position at each predicted frame's time (s) after the last
/// observed one.
pub(crate) fn certain(shape: WindowShape, position: impl Fn(f64) -> [f64; 2]) -> Forecast {
    let path = (1..=shape.t_pred).map(|j| position(j as f64 * shape.dt()).map(|value| value as f32)).collect();
    Forecast { modes: vec![Mode { probability: 1., path, explanation: None }] }
}
