//! A moment of a recording, and the same with changes.

use std::collections::BTreeMap;

use gnp_data::{
    DataError, EditedScene, NewVehicle, Observation, Present, Recording, SceneEdit, SceneEditError, Snapshot,
    WindowShape, limits,
};

use super::change::{Change, ChangeError, ChangeProblem};
use crate::error::{Result, bail};
use crate::explain::listed;
use crate::predict::{span_s, wrong_rate};

/// All vehicles of a recording at a moment, with what was observed of them up to it: owned, and free to be shared among
/// threads. Pasts that are short are filled, as [`Snapshot`] says.
#[derive(Clone, Debug)]
pub struct Moment {
    scene: EditedScene,
    frame: u32,
    time_s: f64,
}

impl Moment {
    /// The frame nearest to `time_s` on the clock of the recording, for a model of windows like `shape`.
    ///
    /// # Errors
    /// For a time outside of the recording, or one that has neither the rate of the model nor a whole multiple of it.
    pub fn at_time(recording: &Recording, time_s: f64, shape: WindowShape) -> Result<Self> {
        let [from, to] = span_s(recording);
        let frame = ((time_s - recording.meta().start_s) * recording.meta().rate_hz).round();
        let half = 0.5 / recording.meta().rate_hz;
        if !(from - half..=to + half).contains(&time_s) || !(0. ..=f64::from(u32::MAX)).contains(&frame) {
            bail!(Recordings, "{time_s} s is outside of {}, which goes from {from} to {to} s", recording.meta().name);
        }
        Self::at_frame(recording, frame as u32, shape)
    }

    /// A frame of the recording, for a model of windows like `shape`.
    ///
    /// # Errors
    /// When the recording has neither the rate of the model nor a whole multiple of it.
    pub fn at_frame(recording: &Recording, frame: u32, shape: WindowShape) -> Result<Self> {
        let Some(shape) = shape.at_rate(recording.meta().rate_hz) else { return Err(wrong_rate(recording, shape)) };
        let snapshot = Snapshot::of(recording, frame, shape).map_err(DataError::from)?;
        let time_s = recording.meta().time_s(frame);
        Ok(Self { scene: EditedScene::from_snapshot(snapshot), frame, time_s })
    }

    /// What was observed of the carriageway of a window, with pasts as they are: whose is short is not predicted.
    pub(crate) fn of_observation(seen: &Observation<'_>) -> Self {
        let scene = EditedScene::of(seen);
        let time_s = scene.snapshot().recording().meta().time_s(seen.frame());
        Self { frame: seen.frame(), time_s, scene }
    }

    /// Frame of the recording.
    #[must_use]
    pub fn frame(&self) -> u32 {
        self.frame
    }

    /// Time on the clock of the recording, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The vehicles, their pasts, the roads, names. Its frames may count otherwise than those of the recording.
    #[must_use]
    pub fn snapshot(&self) -> &Snapshot {
        self.scene.snapshot()
    }

    /// The vehicles that are there, by growing number.
    pub fn vehicles(&self) -> impl ExactSizeIterator<Item = Present<'_>> {
        self.snapshot().vehicles()
    }

    /// The same as a scene that can be changed further.
    #[must_use]
    pub fn scene(&self) -> &EditedScene {
        &self.scene
    }

    /// What a vehicle is called in the data.
    #[must_use]
    pub fn name(&self, vehicle: u32) -> String {
        self.snapshot().recording().vehicle_name(vehicle).into_owned()
    }

    /// The vehicle of this name in the data.
    #[must_use]
    pub fn vehicle_named(&self, name: &str) -> Option<u32> {
        self.snapshot().recording().vehicle_named(name)
    }

    /// A number that no vehicle has, for one that is added; `taken` are others that are added.
    #[must_use]
    pub fn free_number(&self, taken: &[u32]) -> Option<u32> {
        self.scene.free_number(taken)
    }

    /// The moment with changes, one after the other.
    ///
    /// # Errors
    /// For the first one that cannot be made. Terms of the force are not looked at: that does
    /// [`ScenePredictor`](super::ScenePredictor), who has a model.
    pub fn changed(&self, changes: &[Change]) -> Result<ChangedMoment, ChangeError> {
        let (before, now) = (self.clone(), self.clone());
        let mut changed = ChangedMoment { before, now, goals: BTreeMap::new(), without_terms: Vec::new() };
        for (index, change) in changes.iter().enumerate() {
            changed.apply(index, change).map_err(|problem| {
                let named = change.vehicle().map(|vehicle| (vehicle, self.called(change, vehicle)));
                ChangeError { index, problem: problem.by_name(named) }
            })?;
        }
        Ok(changed)
    }

    /// What the vehicle of a change is called, also where it is gone or could not be added.
    fn called(&self, change: &Change, vehicle: u32) -> String {
        match change {
            Change::Scene(SceneEdit::Add(NewVehicle { name: Some(name), .. })) => name.clone(),
            _ => self.name(vehicle),
        }
    }
}

/// A [`Moment`] with changes.
#[derive(Clone, Debug)]
pub struct ChangedMoment {
    before: Moment,
    now: Moment,
    /// By vehicle, forward and left of where it is, m.
    goals: BTreeMap<u32, [f32; 2]>,
    /// Which change it was, and the name of the term.
    without_terms: Vec<(usize, String)>,
}

impl ChangedMoment {
    fn apply(&mut self, index: usize, change: &Change) -> Result<(), ChangeProblem> {
        match change {
            Change::Scene(edit) => {
                self.now.scene.apply(edit).map_err(|error| self.problem(error))?;
                if let SceneEdit::Remove { vehicle } = edit {
                    self.goals.remove(vehicle);
                }
            }
            Change::Goal { at: [x, y], .. } if !limits::is_position([*x, *y]) => {
                return Err(ChangeProblem::Goal { x: *x, y: *y });
            }
            Change::Goal { vehicle, at } => {
                self.now.scene.present(*vehicle).map_err(|error| self.problem(error))?;
                self.goals.insert(*vehicle, *at);
            }
            Change::WithoutTerm(term) => self.without_terms.push((index, term.clone())),
        }
        Ok(())
    }

    fn problem(&self, source: SceneEditError) -> ChangeProblem {
        let said = source.to_string();
        match source {
            SceneEditError::Absent { .. } | SceneEditError::Removed { .. } => {
                let there = listed(self.now.scene.numbers(), |number| self.now.name(number));
                ChangeProblem::Absent { source, said, there }
            }
            source => ChangeProblem::Scene { source, said },
        }
    }

    /// The moment as it is now.
    #[must_use]
    pub fn now(&self) -> &Moment {
        &self.now
    }

    /// What a vehicle is called, also one that is removed.
    #[must_use]
    pub fn name(&self, vehicle: u32) -> String {
        let was_there = self.before.snapshot().vehicle(vehicle).is_some();
        if was_there { &self.before } else { &self.now }.name(vehicle)
    }

    /// Where a vehicle is drawn to, forward and left of where it is, m, if that was changed.
    #[must_use]
    pub fn goal(&self, vehicle: u32) -> Option<[f32; 2]> {
        self.goals.get(&vehicle).copied()
    }

    /// Terms of the force that do not act, each with the index of the change that said so.
    #[must_use]
    pub fn without_terms(&self) -> &[(usize, String)] {
        &self.without_terms
    }
}
