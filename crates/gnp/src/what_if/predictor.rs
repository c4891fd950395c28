//! Forecasts of a changed moment.

use gnp_data::{
    Account, Forecast, Mode, Observation, Past, PredictError, Predictor as _, Present, SLOTS, SceneEdit, VehicleClass,
    WindowKey,
};
use gnp_model::{Forecasts, Gnp, ModelError, Workspace};

use super::change::{Change, ChangeError, ChangeProblem};
use super::moment::{ChangedMoment, Moment};
use crate::error::{Result, bail};
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
    /// Velocity at the moment as the model takes it, m/s, road frame: of it the causes are counted.
    pub velocity: [f32; 2],
    /// How much of its past was seen.
    pub past: Past,
    /// For how long it was seen, s, up to what the model needs.
    pub observed_s: f64,
    /// Number of the vehicle directly ahead.
    pub leader: Option<u32>,
    /// Numbers of its neighbours, in the order of [`Slot::ALL`](gnp_data::Slot::ALL).
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
    /// [`Error::Change`](crate::Error::Change) for a term that the model does not have; when a prediction fails for all vehicles.
    pub fn forecasts(
        &self,
        moment: &ChangedMoment,
        only: Option<&[u32]>,
        k: usize,
        workspace: &mut Workspace,
    ) -> Result<SceneForecasts> {
        let gnp = self.with_terms_of(moment)?;
        let asked = |present: &Present<'_>| only.is_none_or(|only| only.contains(&present.vehicle()));
        let mut out = SceneForecasts::default();
        let (mut free, mut seen, mut forced) = (Vec::new(), Vec::new(), Vec::new());
        for present in moment.now().vehicles().filter(asked) {
            let vehicle = present.vehicle();
            match (present.observation(), moment.goal(vehicle)) {
                (None, _) => out.left_out.push(LeftOut { vehicle, reason: Unpredicted::NoVelocity }),
                (Some(observation), None) => {
                    free.push(present);
                    seen.push(observation);
                }
                (Some(observation), Some(goal)) => forced.push((present, observation, goal)),
            }
        }
        let modes = futures(&gnp, &seen, k, workspace)?;
        for ((present, observation), modes) in free.into_iter().zip(&seen).zip(modes) {
            out.take(&present, observation, modes);
        }
        let gnp = gnp.explaining(true);
        for (present, observation, goal) in forced {
            let modes = match gnp.predict_towards(&[observation], &[vec![goal]]) {
                Ok(forecasts) => forecasts.into_iter().next().map(|forecast| to_goal(forecast, goal)),
                Err(PredictError::Model { .. }) => None,
                Err(error) => return Err(error.into()),
            };
            out.take(&present, &observation, modes);
        }
        out.forecasts.sort_by_key(|forecast| forecast.vehicle);
        Ok(out)
    }

    /// Explains the forecast of a vehicle, with at most `k` futures, as it is and, where something is changed, in the
    /// changed moment; without figures. A vehicle that a change adds has no forecast as it is, and so no difference.
    ///
    /// # Errors
    /// [`Error::Change`](crate::Error::Change) for a change that cannot be made, such as one that removes the vehicle; when there is no such
    /// vehicle or it cannot be predicted; when the model has no physics.
    pub fn explain(&self, moment: &Moment, vehicle: u32, changes: &[Change], k: usize) -> Result<Explained> {
        self.told(moment, vehicle, changes, k).map(|(explained, _)| explained)
    }

    /// The same, and the changed moment.
    pub(crate) fn told(
        &self,
        moment: &Moment,
        vehicle: u32,
        changes: &[Change],
        k: usize,
    ) -> Result<(Explained, ChangedMoment)> {
        let added = changes.iter().find_map(|change| match change {
            Change::Scene(SceneEdit::Add(new)) if new.vehicle == vehicle => Some(new),
            _ => None,
        });
        let removes = |change: &Change| *change == Change::Scene(SceneEdit::Remove { vehicle });
        if let Some(index) = changes.iter().position(removes) {
            let name = added.and_then(|new| new.name.clone()).unwrap_or_else(|| moment.name(vehicle));
            return Err(ChangeError { index, problem: ChangeProblem::Explained { name } }.into());
        }
        let as_it_is = if added.is_some() { None } else { Some(self.explained(&moment.changed(&[])?, vehicle, k)?) };
        let moment_now = moment.changed(changes)?;
        let changed = if changes.is_empty() { None } else { Some(self.explained(&moment_now, vehicle, k)?) };
        let words: Vec<String> = changes.iter().map(|change| change.words(|number| moment_now.name(number))).collect();
        let seen = if added.is_some() { moment_now.now() } else { moment }.scene().observation(vehicle)?;
        let explained = Explained {
            // A snapshot may count frames otherwise.
            key: WindowKey { t0: moment.frame(), ..seen.key() },
            simulated: self.simulated || moment.snapshot().recording().meta().simulated,
            as_it_is,
            changed,
            changes: words.join(" and "),
            figures: Vec::new(),
        };
        Ok((explained, moment_now))
    }

    fn explained(&self, moment: &ChangedMoment, vehicle: u32, k: usize) -> Result<ExplainedForecast> {
        let gnp = self.with_terms_of(moment)?.explaining(true);
        let seen = moment.now().scene().observation(vehicle)?;
        let found = match moment.goal(vehicle) {
            Some(goal) => gnp.predict_towards(&[seen], &[vec![goal]])?,
            None => gnp.predict(&[seen], k)?,
        };
        let forecast = found.into_iter().next().unwrap_or_default();
        let account = forecast.modes.first().and_then(|mode| Account::of(vehicle, mode, seen.shape().dt()));
        let Some(account) = account else {
            bail!(Unavailable, "the model has no physics to explain its forecasts by; train its repulsion");
        };
        let account = account.named_as_in(moment.now().snapshot().recording());
        Ok(ExplainedForecast { at: seen.origin(), account, forecast })
    }

    /// The model with the terms of the force that act in a moment.
    fn with_terms_of(&self, moment: &ChangedMoment) -> Result<Gnp, ChangeError> {
        let terms: Vec<&str> = moment.without_terms().iter().map(|(_, term)| term.as_str()).collect();
        if terms.is_empty() {
            return Ok(self.gnp.clone());
        }
        self.gnp.without_terms(&terms).map_err(|error| {
            let unknown = if let ModelError::UnknownTerm { name, .. } = &error { Some(name) } else { None };
            let of = moment.without_terms().iter().find(|(_, term)| unknown.is_none_or(|name| name == term));
            let index = of.map_or(0, |(index, _)| *index);
            ChangeError { index, problem: ChangeProblem::Term(Box::new(error)) }
        })
    }
}

impl SceneForecasts {
    fn take(&mut self, present: &Present<'_>, seen: &Observation<'_>, futures: Option<Futures>) {
        let (track, vehicle) = (present.track(), present.vehicle());
        let Some(Futures { velocity, modes }) = futures else {
            self.left_out.push(LeftOut { vehicle, reason: Unpredicted::NotFinite });
            return;
        };
        self.forecasts.push(VehicleForecast {
            vehicle,
            class: track.class,
            size: seen.size(),
            road: track.road,
            at: seen.origin(),
            velocity,
            past: present.past(),
            observed_s: match present.past() {
                Past::Filled { observed_s } => observed_s,
                _ => seen.shape().observed_s(),
            },
            leader: seen.leader().map(|leader| leader.vehicle()),
            neighbours: seen.neighbours().map(|other| other.map(|other| other.vehicle())).0,
            modes,
        });
    }
}

/// The futures of a vehicle, and the velocity that they set out from, m/s.
struct Futures {
    velocity: [f32; 2],
    modes: Vec<Future>,
}

/// The futures of each window; of a call that fails as a whole those of each window that it does not fail for.
fn futures(
    gnp: &Gnp,
    seen: &[Observation<'_>],
    k: usize,
    workspace: &mut Workspace,
) -> Result<Vec<Option<Futures>>, PredictError> {
    let gnp = gnp.clone().explaining(true);
    let mut forecasts = Forecasts::default();
    match gnp.predict_into(seen, k, workspace, &mut forecasts) {
        Ok(()) => Ok((0..seen.len()).map(|window| Some(modes_of(&forecasts, window))).collect()),
        Err(error @ PredictError::Shape { .. }) => Err(error),
        Err(error) => {
            let mut alone = |seen: &Observation<'_>| {
                gnp.predict_into(&[*seen], k, workspace, &mut forecasts).ok().map(|()| modes_of(&forecasts, 0))
            };
            let each: Vec<_> = seen.iter().map(&mut alone).collect();
            // Then it is not one of the vehicles.
            if each.iter().all(Option::is_none) { Err(error) } else { Ok(each) }
        }
    }
}

fn modes_of(forecasts: &Forecasts, window: usize) -> Futures {
    let mode = |mode: usize| Future {
        probability: forecasts.probabilities()[window * forecasts.modes() + mode],
        goal: forecasts.goals()[window * forecasts.modes() + mode],
        path: forecasts.path(window, mode).to_vec(),
    };
    Futures { velocity: forecasts.velocities()[window], modes: (0..forecasts.modes()).map(mode).collect() }
}

fn to_goal(forecast: Forecast, goal: [f32; 2]) -> Futures {
    let explanation = forecast.modes.first().and_then(|mode| mode.explanation.as_ref());
    let velocity = explanation.map_or([0.; 2], |explanation| explanation.velocity);
    let future = |mode: Mode| Future { probability: mode.probability, goal, path: mode.path };
    Futures { velocity, modes: forecast.modes.into_iter().map(future).collect() }
}
