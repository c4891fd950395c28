//! `explain`: one forecast come apart into its causes, and what it would be in a changed scene.

mod find;
mod pictures;
mod text;
mod tracks;

pub(crate) use self::find::listed;
pub(crate) use self::pictures::pictures;
pub use self::tracks::{TracksQuestion, explain_tracks};

use std::path::{Path, PathBuf};

use gnp_data::{Account, NewVehicle, SceneEdit, VehicleClass, WindowKey};
use gnp_plot::{Figure, Source};

use crate::error::{Error, Result, bail};
use crate::figures;
use crate::inside::inside;
use crate::run::Run;
use crate::what_if::{Change, ChangeError, ExplainedForecast, Moment, NamedChange, Names, ScenePredictor};

/// Which forecast is asked for, and what is changed in its scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Question {
    /// Name of the recording; without it, of all of them.
    pub recording: Option<String>,
    /// What the recording calls the vehicle; without it, any.
    pub vehicle: Option<String>,
    /// Last observed frame; without it, that of a window of the run. Of several forecasts that fit, the one is explained in
    /// which a leader moves the vehicle most.
    pub frame: Option<u32>,
    /// What is changed; without anything, the forecast stands alone.
    pub what_if: WhatIf,
}

/// What is changed in the scene of a vehicle that may not be known yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WhatIf {
    /// Changes of vehicles of the data and of terms, one after the other.
    pub changes: Vec<NamedChange>,
    /// Cars that are added then.
    pub added: Vec<AddedCar>,
    /// Where the vehicle is drawn to: forward and left of where it is, m.
    pub goal: Option<[f32; 2]>,
    /// Whose forecast is explained instead of that of the vehicle, such as `new 1`.
    pub watch: Option<String>,
}

/// A car on the carriageway of the vehicle that is explained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AddedCar {
    /// Forward and left of where that vehicle is, m.
    pub at: [f32; 2],
    /// Its speed, m/s.
    pub speed_mps: f32,
}

impl WhatIf {
    /// The changes around a vehicle of a moment, and the number of whose forecast is explained. Added cars are called
    /// `new 1`, `new 2`, ..., as far as nobody is called so.
    fn around(&self, vehicle: u32, moment: &Moment) -> Result<(Vec<Change>, u32)> {
        let mut names = Names::of(moment);
        let mut changes = Vec::new();
        for (index, change) in self.changes.iter().enumerate() {
            let change = names.change(change).map_err(|unknown| ChangeError { index, problem: unknown.into() })?;
            changes.push(change);
        }
        let Some(present) = moment.snapshot().vehicle(vehicle) else { return Ok((changes, vehicle)) };
        let mut free = (1u32..).map(|i| format!("new {i}"));
        for AddedCar { at: [forward, left], speed_mps } in &self.added {
            let name = free.find(|name| !names.is_taken(name)).unwrap_or_default();
            let Some(number) = names.add(name.clone()) else {
                bail!(Recordings, "no number is left for another vehicle");
            };
            let [x, y] = present.at();
            changes.push(Change::Scene(SceneEdit::Add(NewVehicle {
                vehicle: number,
                name: Some(name),
                road: present.track().road,
                at: [x + forward, y + left],
                speed_mps: *speed_mps,
                class: VehicleClass::Car,
                size: VehicleClass::Car.default_size(),
            })));
        }
        changes.extend(self.goal.map(|at| Change::Goal { vehicle, at }));
        let watched = match &self.watch {
            Some(name) => names.number(name).map_err(|unknown| Error::Recordings(unknown.to_string()))?,
            None => vehicle,
        };
        Ok((changes, watched))
    }
}

/// A forecast explained: numbers, sentences, pictures.
#[derive(Clone, Debug)]
pub struct Explained {
    /// The window: recording, vehicle, last observed frame.
    pub key: WindowKey,
    /// Whether the recording, or what the model was trained on, is simulated.
    pub simulated: bool,
    /// As it is; none of a vehicle that is added, which has no forecast from before.
    pub as_it_is: Option<ExplainedForecast>,
    /// In the changed scene; none without changes.
    pub changed: Option<ExplainedForecast>,
    /// What was changed, in words; empty without changes.
    pub changes: String,
    /// Where it was asked for `contributions`, and with changes `what-if`.
    pub figures: Vec<Figure>,
}

impl Explained {
    /// What the changes do to the prediction, cause by cause; none without changes, and none of a vehicle that is added.
    #[must_use]
    pub fn change(&self) -> Option<Account> {
        let (before, after) = self.as_it_is.as_ref().zip(self.changed.as_ref())?;
        Some(before.account.change_to(&after.account))
    }

    /// What the vehicle is called.
    #[must_use]
    pub fn name(&self) -> String {
        let account = self.as_it_is.as_ref().or(self.changed.as_ref()).map(|it| &it.account);
        account.map_or_else(|| self.key.vehicle.to_string(), |account| account.name(self.key.vehicle))
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
    let found = find::found(run, &gnp, question)?;
    let data = &run.folder.state.data;
    let source = Source { words: data.description.clone(), simulated: data.simulated };
    let (predictor, moment) = (ScenePredictor::of(gnp, data.simulated), Moment::of_observation(&found.observation));
    let vehicle = found.observation.vehicle();
    let (changes, watched) = question.what_if.around(vehicle, &moment)?;
    let (mut explained, changed) = predictor.told(&moment, watched, &changes, run.config.predict.k)?;
    let window = found.window.as_ref().filter(|_| watched == vehicle);
    explained.figures = pictures(&explained, window, (&moment, &changed), &changes, &source)?;
    Ok(explained)
}
