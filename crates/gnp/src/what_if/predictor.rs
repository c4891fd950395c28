//! Forecasts of a changed moment.

use gnp_data::{Account, Forecast, Observation, Past, PredictError, Predictor as _, Present, SLOTS, Slot, VehicleClass, WindowKey};
use gnp_model::{Forecasts, Gnp, Workspace};

use super::change::{Change, ChangeError, ChangeProblem};
use super::moment::{ChangedMoment, Moment};
use crate::error::{Error, Result, bail};
use crate::explain::Explained;
use crate::model::Model;
use crate::predict::Unpredicted;

/// Predicts vehicles of moments as they are and as they are changed. Cheap to clone: networks are shared.
#[derive(Clone, Debug)]
pub struct ScenePredictor {
    gnp: Gnp,
    simulated: bool,
}

/// The forecasts of a moment.
#[derive(Clone, Debug, Default)]
pub struct SceneForecasts {
    /// By growing number of the vehicle.
    pub forecasts: Vec<VehicleForecast>,
    /// Vehicles without one.
    pub left_out: Vec<LeftOut>,
}

/// What is predicted of a vehicle, and from what.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct VehicleForecast {
    /// Number of the vehicle.
    pub vehicle: u32,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Length and width, m.
    pub size: [f32; 2],
    /// Index of its carriageway.
    pub road: u16,
    /// Centre at the moment, m, road frame: the origin of goals and paths.
    pub at: [f32; 2],
    /// Velocity at the moment, m/s, road frame.
    pub velocity: [f32; 2],
    /// How much of its past was seen.
    pub past: Past,
    /// For how long it was seen, s, up to what the model needs.
    pub observed_s: f64,
    /// Number of the vehicle directly ahead.
    pub leader: Option<u32>,
    /// Numbers of its neighbours, in the order of [`Slot::ALL`].
    pub neighbours: [Option<u32>; SLOTS],
    /// The futures, the prediction first; one alone where a goal is forced.
    pub modes: Vec<Future>,
}

/// One way on.
#[derive(Clone, Debug, PartialEq)]
pub struct Future {
    /// From 0 to 1.
    pub probability: f32,
    /// Where the vehicle is drawn to, m from where it is.
    pub goal: [f32; 2],
    /// Centre in each predicted frame, m from where it is.
    pub path: Vec<[f32; 2]>,
}

/// A vehicle that has no forecast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct LeftOut {
    /// Its number.
    pub vehicle: u32,
    /// Why.
    pub reason: Unpredicted,
}

/// A forecast with its explanation.
#[derive(Clone, Debug, PartialEq)]
pub struct ExplainedForecast {
    /// Centre of the vehicle at the moment, m, road frame: the origin of goals and paths.
    pub at: [f32; 2],
    /// The prediction cause by cause, by the names of the data.
    pub account: Account,
    /// The futures, the prediction first, each with its goal and the force and parameters of every term.
    pub forecast: Forecast,
}

impl ScenePredictor {
    /// By a model.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        Self::of(model.gnp().clone(), model.card().data.simulated)
    }

    /// `simulated` says whether the model is trained on simulated recordings.
    pub(crate) fn of(gnp: Gnp, simulated: bool) -> Self {
        Self { gnp, simulated }
    }

    /// The model.
    #[must_use]
    pub fn gnp(&self) -> &Gnp {
        &self.gnp
    }

    /// Forecasts with at most `k` futures of the vehicles `only`, or of all, on the caller's thread. For a vehicle whose
    /// goal is forced the future is the way there.
    ///
    /// # Errors
    /// [`Error::Change`] for a term that the model does not have; when a prediction fails for all vehicles.
    pub fn forecasts(
        &self,
        moment: &ChangedMoment,
        only: Option<&[u32]>,
        k: usize,
        workspace: &mut Workspace,
    ) -> Result<SceneForecasts> {
        todo!()
    }

    /// Explains the forecast of a vehicle, with at most `k` futures, as it is and, where something is changed, in the
    /// changed moment.
    ///
    /// # Errors
    /// [`Error::Change`] for a change that cannot be made, such as one that removes the vehicle; when there is no such
    /// vehicle or it cannot be predicted; when the model has no physics.
    pub fn explain(&self, moment: &Moment, vehicle: u32, changes: &[Change], k: usize) -> Result<Explained> {
        todo!()
    }
}
