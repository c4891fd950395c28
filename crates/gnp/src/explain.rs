//! `explain`: one forecast come apart into its causes, and what it would be in a changed scene.

mod find;
mod text;
mod tracks;

pub use self::tracks::{TracksQuestion, explain_tracks};

use std::path::{Path, PathBuf};

use gnp_data::{
    Account, DataError, EditedScene, Forecast, Observation, Predictor as _, Recording, SceneEditError, Window,
    WindowId, WindowKey, WindowShape,
};
use gnp_model::Gnp;
use gnp_plot::{Figure, Mark, Scene, Source, VehicleBox, WhatIf, contributions, what_if};

use crate::error::{Error, Result, bail};
use crate::figures;
use crate::inside::inside;
use crate::run::Run;

/// Which forecast is asked for, and what is changed in its scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Question {
    /// Name of the recording; without it, of all of them.
    pub recording: Option<String>,
    /// Number of the vehicle; without it, any.
    pub vehicle: Option<u32>,
    /// Last observed frame; without it, that of a window of the run. Of several forecasts that fit, the one is explained in
    /// which a leader moves the vehicle most.
    pub frame: Option<u32>,
    /// What is changed; without anything, the forecast stands alone.
    pub changes: Vec<Change>,
}

/// A change of a scene.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Change {
    /// A vehicle is not there.
    Without {
        /// Its number.
        vehicle: u32,
    },
    /// A vehicle arrives at its place with another speed.
    Speed {
        /// Its number.
        vehicle: u32,
        /// The speed, m/s.
        speed_mps: f32,
    },
    /// The vehicle is drawn to this place: forward and left of where it is, m.
    Goal([f32; 2]),
}

impl Change {
    /// In words, such as `without vehicle 34`.
    #[must_use]
    pub fn words(&self) -> String {
        match self {
            Self::Without { vehicle } => format!("without vehicle {vehicle}"),
            Self::Speed { vehicle, speed_mps } => format!("with vehicle {vehicle} at {speed_mps} m/s"),
            Self::Goal([x, y]) => format!("drawn to {x} m ahead and {y} m to the left"),
        }
    }
}

/// A forecast explained: numbers, sentences, pictures.
#[derive(Clone, Debug)]
pub struct Explained {
    /// The window: recording, vehicle, last observed frame.
    pub key: WindowKey,
    /// Whether the recording is simulated.
    pub simulated: bool,
    /// The prediction as it is.
    pub as_it_is: Account,
    /// The prediction in the changed scene.
    pub changed: Option<Account>,
    /// What was changed, in words; empty without changes.
    pub changes: String,
    /// `contributions`, and with changes `what-if`.
    pub figures: Vec<Figure>,
}

impl Explained {
    /// What the changes do to the prediction, cause by cause.
    #[must_use]
    pub fn change(&self) -> Option<Account> {
        self.changed.as_ref().map(|changed| self.as_it_is.change_to(changed))
    }

    /// Writes the figures to a folder, as SVG and PNG.
    ///
    /// # Errors
    /// When one cannot be painted or written.
    pub fn save_figures(&self, out: &Path) -> Result<()> {
        figures::save(&self.figures, out)
    }

    /// The folder for its figures in that of the run: one for each recording, vehicle and frame.
    ///
    /// # Errors
    /// When the recording has a name that leads out of the run folder.
    pub fn folder(&self, run: &Run) -> Result<PathBuf> {
        let WindowKey { recording, vehicle, t0, .. } = &self.key;
        inside(&run.path().join("explain"), &format!("{recording}-{vehicle}-{t0}"))
    }
}

/// Explains a forecast of a trained run.
///
/// # Errors
/// When nothing fits the question, naming what there is; when the scene cannot be changed so; when a file of the run
/// cannot be used.
pub fn explain(run: &Run, question: &Question) -> Result<Explained> {
    let gnp = run.model()?.explaining(true);
    let moment = find::moment(run, &gnp, question)?;
    let data = &run.folder.state.data;
    let source = Source { words: data.description.clone(), simulated: data.simulated };
    let Some(told) = tell(&gnp, &moment, &question.changes, run.config.predict.k, &source)? else {
        bail!(Folder, "{} has no physics to explain its forecasts by; train its repulsion", run.path().display());
    };
    let simulated = data.simulated;
    let Told { as_it_is, changed, changes, figures } = told;
    Ok(Explained { key: moment.key.clone(), simulated, as_it_is, changed, changes, figures })
}

/// A vehicle at a moment, with what happened then where that is recorded.
pub(crate) struct Moment<'a> {
    /// The recording whose names of vehicles are used; numbers without.
    pub(crate) names: Option<&'a Recording>,
    /// Its name, with the frame as the recording counts, which a snapshot may not.
    pub(crate) key: WindowKey,
    pub(crate) observation: Observation<'a>,
    pub(crate) window: Option<Window<'a>>,
}

impl<'a> Moment<'a> {
    fn of(recording: &'a Recording, shape: WindowShape, id: WindowId) -> Option<Self> {
        let (track, row) = (id.track as usize, id.row as usize);
        let observation = Observation::new(recording, shape, track, row).ok()?;
        let window = Window::new(recording, shape, track, row).ok();
        Some(Self { names: Some(recording), key: observation.key(), observation, window })
    }

    /// The account of its prediction, in which vehicles have the names of the recording.
    fn account(&self, seen: &Observation<'_>, forecast: &Forecast) -> Option<Account> {
        let account = Account::of(seen.vehicle(), forecast.modes.first()?, seen.shape().dt())?;
        Some(match self.names {
            Some(recording) => account.named_as_in(recording),
            None => account,
        })
    }

    fn scene(&self, forecast: Forecast, title: String) -> Scene {
        match &self.window {
            Some(window) => Scene::of(window, forecast, title),
            None => Scene::seen(&self.observation, forecast, title),
        }
    }
}

/// What is told of a moment.
pub(crate) struct Told {
    as_it_is: Account,
    changed: Option<Account>,
    changes: String,
    pub(crate) figures: Vec<Figure>,
}

/// The account of a moment's prediction, as it is and with changes, and the figures of both; `None` for a model without
/// physics.
pub(crate) fn tell(
    gnp: &Gnp,
    moment: &Moment<'_>,
    changes: &[Change],
    k: usize,
    source: &Source,
) -> Result<Option<Told>> {
    let seen = &moment.observation;
    let key = &moment.key;
    let forecast = gnp.predict(&[*seen], k)?.pop().unwrap_or_default();
    let Some(as_it_is) = moment.account(seen, &forecast) else { return Ok(None) };
    let what = format!("{}, vehicle {}, frame {}", key.recording, as_it_is.name(key.vehicle), key.t0);
    let title = "What moves a vehicle from constant velocity to its predicted path";
    let mut figures = vec![contributions("contributions", title, &what, &as_it_is, source)];
    if changes.is_empty() {
        return Ok(Some(Told { as_it_is, changed: None, changes: String::new(), figures }));
    }
    let words: Vec<String> = changes.iter().map(Change::words).collect();
    let words = words.join(" and ");
    let scene = edited(seen, changes)?;
    let changed_seen = scene.observation()?;
    let goal = changes.iter().rev().find_map(|change| match change {
        Change::Goal(goal) => Some(*goal),
        _ => None,
    });
    let found = match goal {
        Some(goal) => gnp.predict_towards(&[changed_seen], &[vec![goal]])?,
        None => gnp.predict(&[changed_seen], k)?,
    };
    let changed_forecast = found.into_iter().next().unwrap_or_default();
    let Some(changed) = moment.account(&changed_seen, &changed_forecast) else { return Ok(None) };
    let change = as_it_is.change_to(&changed);
    let before = moment.scene(forecast, what.clone());
    // What happened did not happen in the changed scene.
    let after = Scene::seen(&changed_seen, changed_forecast, what);
    let marks = marks(seen, changes);
    let both = WhatIf { what: &words, before: &before, after: &after, marks: &marks, change: &change };
    figures.push(what_if("what-if", "What if: the forecast of a changed scene", &both, source));
    Ok(Some(Told { as_it_is, changed: Some(changed), changes: words, figures }))
}

/// The scene with its changes but for the goal.
fn edited(seen: &Observation<'_>, changes: &[Change]) -> Result<EditedScene> {
    let mut scene = EditedScene::of(seen)?;
    for change in changes {
        let edited = match change {
            Change::Without { vehicle } => scene.without(*vehicle),
            Change::Speed { vehicle, speed_mps } => scene.with_speed(*vehicle, *speed_mps),
            Change::Goal(goal) if goal.iter().all(|value| value.is_finite()) => Ok(scene),
            Change::Goal([x, y]) => bail!(Recordings, "a goal at {x}, {y} m is not finite"),
        };
        scene = edited.map_err(|error| match error {
            DataError::SceneEdit(absent @ SceneEditError::Absent { .. }) => {
                let others = seen.others().map(|other| other.vehicle()).chain(seen.column().map(|it| it.vehicle()));
                Error::Recordings(format!("{absent}; there are {}", find::listed(others)))
            }
            other => other.into(),
        })?;
    }
    Ok(scene)
}

/// The vehicle, whom it follows, and those that are changed.
fn marks(seen: &Observation<'_>, changes: &[Change]) -> Vec<Mark> {
    let gone = |number: u32| changes.contains(&Change::Without { vehicle: number });
    let spoken_of = |number: u32| {
        changes.iter().any(|change| match change {
            Change::Without { vehicle } | Change::Speed { vehicle, .. } => *vehicle == number,
            Change::Goal(_) => false,
        })
    };
    let leader = seen.leader().map(|leader| leader.vehicle());
    let others = seen.others().map(|other| (other.vehicle(), other.now(), other.size()));
    // A leader without rows of its own is none of the others.
    let named = seen.column().filter(|it| it.recorded().is_none()).map(|it| (it.vehicle(), it.now(), it.size()));
    let marked = others.chain(named).filter(|(number, ..)| spoken_of(*number) || Some(*number) == leader);
    marked
        .map(|(number, now, size)| Mark {
            at: VehicleBox { centre: [now.x, now.y], size },
            label: number.to_string(),
            gone: gone(number),
        })
        .collect()
}
