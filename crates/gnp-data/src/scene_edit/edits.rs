//! The changes of a scene, taken together.

use std::collections::{BTreeMap, BTreeSet};

use super::base::Base;
use super::{NewVehicle, SPEED_CHANGE_S, SPEED_KEPT_S, SceneEdit, SceneEditError, check_new, check_speed};
use crate::limits::is_position;

/// All changes, one entry a vehicle.
#[derive(Clone, Debug, Default)]
pub(super) struct Edits {
    pub(super) removed: BTreeSet<u32>,
    /// Vehicles of the data, those without a row included.
    pub(super) changed: BTreeMap<u32, Changed>,
    pub(super) added: BTreeMap<u32, NewVehicle>,
}

/// How a vehicle of the data is changed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Changed {
    /// Forward and to the left, m.
    pub(super) by: [f32; 2],
    pub(super) speed_mps: Option<f32>,
}

/// Where a vehicle comes from.
enum Origin {
    /// It has this track.
    Recorded(usize),
    /// Others' rows name it.
    Named,
    Added,
}

impl Edits {
    pub(super) fn is_empty(&self) -> bool {
        self.removed.is_empty() && self.changed.is_empty() && self.added.is_empty()
    }

    /// Whether a vehicle is where no data has it.
    pub(super) fn is_placed(&self, vehicle: u32) -> bool {
        self.added.contains_key(&vehicle) || self.changed.get(&vehicle).is_some_and(|it| it.by != [0.; 2])
    }

    /// Whether a vehicle of the data is there, and where the data has it.
    pub(super) fn stays(&self, vehicle: u32) -> bool {
        !self.removed.contains(&vehicle) && !self.is_placed(vehicle)
    }

    /// Why a vehicle is not there.
    pub(super) fn absent(&self, vehicle: u32) -> SceneEditError {
        if self.removed.contains(&vehicle) {
            SceneEditError::Removed { vehicle }
        } else {
            SceneEditError::Absent { vehicle }
        }
    }

    pub(super) fn add(&mut self, edit: &SceneEdit, base: &Base) -> Result<(), SceneEditError> {
        match edit {
            SceneEdit::Remove { vehicle } => match self.origin(*vehicle, base)? {
                Origin::Added => drop(self.added.remove(vehicle)),
                Origin::Recorded(_) | Origin::Named => {
                    self.changed.remove(vehicle);
                    self.removed.insert(*vehicle);
                }
            },
            SceneEdit::Move { vehicle, by } => self.shift(*vehicle, *by, base)?,
            SceneEdit::Speed { vehicle, speed_mps } => self.speed(*vehicle, *speed_mps, base)?,
            SceneEdit::Add(new) => {
                let vehicle = new.vehicle;
                if base.numbers().any(|it| it == vehicle) || self.added.contains_key(&vehicle) {
                    return Err(SceneEditError::Taken { vehicle });
                }
                check_new(new, base.lanes.len())?;
                self.added.insert(vehicle, new.clone());
            }
        }
        Ok(())
    }

    fn origin(&self, vehicle: u32, base: &Base) -> Result<Origin, SceneEditError> {
        if self.added.contains_key(&vehicle) {
            return Ok(Origin::Added);
        }
        let recorded = || base.track(vehicle).map(Origin::Recorded);
        let named = || base.named.iter().any(|it| it.placed.vehicle == vehicle).then_some(Origin::Named);
        let there = if self.removed.contains(&vehicle) { None } else { recorded().or_else(named) };
        there.ok_or_else(|| self.absent(vehicle))
    }

    fn shift(&mut self, vehicle: u32, by: [f32; 2], base: &Base) -> Result<(), SceneEditError> {
        let origin = self.origin(vehicle, base)?;
        let so_far = self.changed.get(&vehicle).map_or([0.; 2], |it| it.by);
        let plus = |a: [f32; 2], b: [f32; 2]| [a[0] + b[0], a[1] + b[1]];
        let total = plus(so_far, by);
        let place = match (&origin, self.added.get(&vehicle)) {
            (_, Some(new)) => plus(new.at, by),
            (Origin::Recorded(track), _) => {
                let recording = base.scene.recording();
                let now = recording.state(recording.tracks()[*track].rows.end - 1);
                plus([now.x, now.y], total)
            }
            // Its place across the road is its follower's.
            (_, None) => {
                let of = base.named.iter().find(|it| it.placed.vehicle == vehicle);
                plus([of.map_or(0., |it| it.placed.position.x), 0.], total)
            }
        };
        if !is_position(place) {
            let [forward, left] = by;
            return Err(SceneEditError::Move { vehicle, forward, left });
        }
        match self.added.get_mut(&vehicle) {
            Some(new) => new.at = place,
            None => {
                let changed = self.changed.entry(vehicle).or_default();
                changed.by = total;
                if *changed == Changed::default() {
                    self.changed.remove(&vehicle);
                }
            }
        }
        Ok(())
    }

    fn speed(&mut self, vehicle: u32, speed_mps: f32, base: &Base) -> Result<(), SceneEditError> {
        check_speed(vehicle, speed_mps)?;
        let known = match self.origin(vehicle, base)? {
            Origin::Recorded(track) => base.velocity(track).is_some(),
            Origin::Named => base.named.iter().filter(|it| it.placed.vehicle == vehicle).all(|it| it.speed.is_some()),
            Origin::Added => true,
        };
        if !known {
            return Err(SceneEditError::NoPast { vehicle });
        }
        match self.added.get_mut(&vehicle) {
            Some(new) => new.speed_mps = speed_mps,
            None => self.changed.entry(vehicle).or_default().speed_mps = Some(speed_mps),
        }
        Ok(())
    }
}

/// How a frame differs from the recorded one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Difference {
    /// Forward, m.
    pub(super) place: f32,
    /// Speed from the frame before to this one, m/s.
    pub(super) speed: f32,
}

/// What a speed that is `faster` m/s at the end does to the last `rows` frames, the last first.
pub(super) fn speed_change(faster: f32, rows: usize, rate_hz: f64) -> Vec<Difference> {
    let dt = 1. / rate_hz;
    let mut place = 0f64;
    let change = |back: usize| {
        let share = 1. - (back as f64 * dt - SPEED_KEPT_S) / SPEED_CHANGE_S;
        let speed = f64::from(faster) * share.clamp(0., 1.);
        let change = Difference { place: place as f32, speed: speed as f32 };
        // Where it comes from, one frame before.
        place -= speed * dt;
        change
    };
    (0..rows).map(change).collect()
}
