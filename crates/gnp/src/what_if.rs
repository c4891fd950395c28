//! What if: a moment of traffic that can be changed, and what is then predicted.

mod change;
mod moment;
mod predictor;

pub use self::change::{Change, ChangeError, ChangeField, ChangeProblem};
pub use self::moment::{ChangedMoment, Moment};
pub use self::predictor::{ExplainedForecast, Future, LeftOut, SceneForecasts, ScenePredictor, VehicleForecast};
