//! What if: a moment of traffic that can be changed, and what is then predicted.

mod change;
mod moment;
mod names;
mod predictor;

pub use self::change::{Change, ChangeError, ChangeField, ChangeProblem, NamedChange};
pub use self::moment::{ChangedMoment, Moment};
pub use self::names::{Names, UnknownVehicle};
pub(crate) use self::names::{alike_or_all, cut, of_recording};
pub use self::predictor::{ExplainedForecast, Future, LeftOut, SceneForecasts, ScenePredictor, VehicleForecast};
