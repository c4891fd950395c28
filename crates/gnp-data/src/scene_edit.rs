//! A moment with changes: what a predictor is asked with "what if".

mod base;
mod build;
mod edits;
mod road_lanes;
mod slots;

use std::sync::{Arc, OnceLock};

use self::base::Base;
use self::edits::Edits;
use crate::error::DataError;
use crate::limits::{MAX_POSITION, MAX_SPEED, is_position, is_size, sizes};
use crate::recording::{Track, VehicleClass};
use crate::snapshot::{Present, Snapshot};
use crate::window::Observation;

/// Time for which a changed speed has been driven at the moment, s: a predictor that takes speeds from the last second, or
/// accelerations, finds that speed and no braking.
pub const SPEED_KEPT_S: f64 = 1.5;

/// Time before that over which a changed speed is reached, s.
pub const SPEED_CHANGE_S: f64 = 1.;

/// The vehicles of a moment with their observed pasts, and with changes; no row after it.
///
/// Changes can be made in any order and taken back: a vehicle that is moved by 10 m and by −10 m is where it was, bit by bit,
/// and so are all others.
///
/// - *Neighbours* are looked for by place ([`find_neighbours`](crate::find_neighbours)) without and with the changes. Where
///   both find the same one, whom the data names stays; otherwise the new one is taken. Whom the data names and no place
///   tells stays while neither of the two is moved.
/// - *Leaders without rows of their own*, which only the rows of their follower name, have a place by these. Each is followed
///   by whoever is directly behind it: where its follower is gone, by the next one; where a vehicle comes between, by that
///   one. Where nobody is, it is gone.
/// - *Lanes* of a vehicle that is moved across the road or added are those between the lane lines of its carriageway: off the
///   road it has none, and is nobody's neighbour. A carriageway without lines leaves vehicles in the lanes they had.
///
/// Vehicles may come to lie in one another: [`EditedScene::overlaps`] says which.
///
/// ```no_run
/// # fn example(observation: gnp_data::Observation<'_>) -> Result<(), gnp_data::DataError> {
/// use gnp_data::{EditedScene, SceneEdit};
///
/// // What would the target do without its leader, and what if the leader were at 5 m/s?
/// if let Some(leader) = observation.leader() {
///     let vehicle = leader.vehicle();
///     let free = EditedScene::of(&observation).with(&SceneEdit::Remove { vehicle })?;
///     let slow = EditedScene::of(&observation).with(&SceneEdit::Speed { vehicle, speed_mps: 5. })?;
///     let asked = [free.observation(observation.vehicle())?, slow.observation(observation.vehicle())?];
///     // predictor.predict(&asked, 6)
/// #   let _ = asked;
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct EditedScene {
    base: Arc<Base>,
    edits: Edits,
    /// The scene with all edits, once it was asked for.
    now: OnceLock<Arc<Snapshot>>,
}

/// A change of the vehicles of a moment.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneEdit {
    /// A vehicle is not there. It may be a leader without a row of its own.
    Remove {
        /// Its number.
        vehicle: u32,
    },
    /// A vehicle is elsewhere, its whole past with it. Velocities stay. A leader without a row of its own that comes
    /// behind its follower's front is absent.
    Move {
        /// Its number.
        vehicle: u32,
        /// Forward and to the left, m.
        by: [f32; 2],
    },
    /// A vehicle arrives at its present place with another speed: for the last [`SPEED_KEPT_S`] it is faster or slower than
    /// recorded by as much as it is at the moment, after that difference has grown over [`SPEED_CHANGE_S`], linearly in time. Its lateral motion stays, and so do the
    /// places of all others. A leader without a row is absent where it would be behind its follower's front.
    Speed {
        /// Its number.
        vehicle: u32,
        /// The speed along the road, m/s.
        speed_mps: f32,
    },
    /// Another vehicle is there.
    Add(NewVehicle),
}

impl SceneEdit {
    /// Number of the vehicle.
    #[must_use]
    pub fn vehicle(&self) -> u32 {
        match self {
            Self::Remove { vehicle } | Self::Move { vehicle, .. } | Self::Speed { vehicle, .. } => *vehicle,
            Self::Add(new) => new.vehicle,
        }
    }
}

/// A vehicle that was not there. It has driven straight along the road, at one speed.
#[derive(Clone, Debug, PartialEq)]
pub struct NewVehicle {
    /// Its number, which no other vehicle of the moment has: [`EditedScene::free_number`].
    pub vehicle: u32,
    /// What it is called; by its number without.
    pub name: Option<String>,
    /// Index of its carriageway.
    pub road: u16,
    /// Centre of its box, m, road frame.
    pub at: [f32; 2],
    /// Speed along the road, m/s.
    pub speed_mps: f32,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Length and width, m.
    pub size: [f32; 2],
}

/// Why a scene cannot be changed so.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneEditError {
    /// A vehicle that is not there.
    #[error("vehicle {vehicle} is not there at the moment")]
    Absent {
        /// The vehicle.
        vehicle: u32,
    },
    /// A vehicle that an earlier change removed.
    #[error("vehicle {vehicle} was removed by an earlier change")]
    Removed {
        /// The vehicle.
        vehicle: u32,
    },
    /// A speed that is none.
    #[error("vehicle {vehicle}: a speed of {speed_mps} m/s is not between 0 and {MAX_SPEED} m/s")]
    Speed {
        /// The vehicle.
        vehicle: u32,
        /// The speed, m/s.
        speed_mps: f32,
    },
    /// A vehicle that has just appeared: there is no past to be changed.
    #[error("vehicle {vehicle} has no past that tells its speed")]
    NoPast {
        /// The vehicle.
        vehicle: u32,
    },
    /// A way that leads out of what a road can be.
    #[error("vehicle {vehicle}: moved by ({forward}, {left}) m it is not within {MAX_POSITION} m of the origin")]
    Move {
        /// The vehicle.
        vehicle: u32,
        /// Forward, m.
        forward: f32,
        /// To the left, m.
        left: f32,
    },
    /// A place that is none.
    #[error("vehicle {vehicle}: ({x}, {y}) m is not within {MAX_POSITION} m of the origin")]
    Place {
        /// The vehicle.
        vehicle: u32,
        /// Forward, m.
        x: f32,
        /// To the left, m.
        y: f32,
    },
    /// A size that no vehicle has.
    #[error("vehicle {vehicle}: {length} m by {width} m is no size: vehicles are {}", sizes())]
    Size {
        /// The vehicle.
        vehicle: u32,
        /// Length, m.
        length: f32,
        /// Width, m.
        width: f32,
    },
    /// A vehicle to be added under a number that another one has.
    #[error("there is a vehicle {vehicle}; give the new one another number")]
    Taken {
        /// The number.
        vehicle: u32,
    },
    /// A vehicle to be added to a carriageway that is not there.
    #[error("vehicle {vehicle} is to be on carriageway {road}, there are {roads}")]
    Road {
        /// The vehicle.
        vehicle: u32,
        /// The carriageway.
        road: u16,
        /// How many there are.
        roads: usize,
    },
}

impl EditedScene {
    /// The vehicles on the carriageway of `observation` with nothing changed: its own observation gives the same bits.
    /// Pasts are as they are; a vehicle whose past is short has no observation.
    #[must_use]
    pub fn of(observation: &Observation<'_>) -> Self {
        Self::from_snapshot(Snapshot::as_seen(observation))
    }

    /// The vehicles of a snapshot on all its carriageways with nothing changed.
    #[must_use]
    pub fn from_snapshot(snapshot: Snapshot) -> Self {
        Self { base: Arc::new(Base::of(snapshot)), edits: Edits::default(), now: OnceLock::new() }
    }

    /// Changes it.
    ///
    /// # Errors
    /// [`SceneEditError`]; then nothing is changed.
    pub fn apply(&mut self, edit: &SceneEdit) -> Result<(), SceneEditError> {
        self.edits.add(edit, &self.base)?;
        self.now = OnceLock::new();
        Ok(())
    }

    /// The scene with a change.
    ///
    /// # Errors
    /// [`SceneEditError`].
    pub fn with(mut self, edit: &SceneEdit) -> Result<Self, SceneEditError> {
        self.apply(edit)?;
        Ok(self)
    }

    /// The scene as it is now: its vehicles, with what a predictor may see of each. Neighbours and presence stand in the last
    /// frame alone.
    #[must_use]
    pub fn snapshot(&self) -> &Snapshot {
        self.now.get_or_init(|| {
            if self.edits.is_empty() {
                Arc::clone(&self.base.scene)
            } else {
                Arc::new(build::scene(&self.base, &self.edits))
            }
        })
    }

    /// A vehicle of the scene.
    ///
    /// # Errors
    /// [`SceneEditError::Absent`], [`SceneEditError::Removed`].
    pub fn present(&self, vehicle: u32) -> Result<Present<'_>, SceneEditError> {
        self.snapshot().vehicle(vehicle).ok_or_else(|| self.edits.absent(vehicle))
    }

    /// What a predictor may see of a vehicle, under the name of the recording the scene was made of.
    ///
    /// # Errors
    /// As [`EditedScene::present`]; [`DataError::Window`] for one whose past is short or tells no velocity.
    pub fn observation(&self, vehicle: u32) -> Result<Observation<'_>, DataError> {
        let present = self.present(vehicle)?;
        Ok(present.window()?)
    }

    /// Numbers of the vehicles that are there, and of the leaders that only rows of theirs name.
    pub fn numbers(&self) -> impl Iterator<Item = u32> {
        let recording = self.snapshot().recording();
        let named = |track: &Track| recording.named_leader(track.rows.end - 1).map(|leader| leader.vehicle);
        recording.tracks().iter().flat_map(move |track| [Some(track.vehicle), named(track)]).flatten()
    }

    /// A number that no vehicle of the moment has, and none of `taken`; `None` where the last one is.
    #[must_use]
    pub fn free_number(&self, taken: &[u32]) -> Option<u32> {
        let there = self.base.numbers().chain(self.edits.added.keys().copied()).chain(taken.iter().copied());
        there.max().unwrap_or(0).checked_add(1)
    }

    /// Pairs of vehicles whose boxes lie in one another at the moment, one of them moved or added at least; each pair by
    /// growing number.
    #[must_use]
    pub fn overlaps(&self) -> Vec<[u32; 2]> {
        let recording = self.snapshot().recording();
        let (tracks, columns) = (recording.tracks(), recording.columns());
        let mut pairs = Vec::new();
        for (i, a) in tracks.iter().enumerate() {
            for b in tracks[i + 1..].iter().filter(|b| b.road == a.road) {
                if !(self.edits.is_placed(a.vehicle) || self.edits.is_placed(b.vehicle)) {
                    continue;
                }
                let apart = |column: &[f32]| (column[a.rows.end - 1] - column[b.rows.end - 1]).abs();
                if apart(&columns.x) < (a.length + b.length) / 2. && apart(&columns.y) < (a.width + b.width) / 2. {
                    pairs.push([a.vehicle, b.vehicle]);
                }
            }
        }
        pairs
    }
}

/// Whether a new vehicle can be one.
fn check_new(new: &NewVehicle, roads: usize) -> Result<(), SceneEditError> {
    let NewVehicle { vehicle, road, at: [x, y], speed_mps, size: [length, width], .. } = *new;
    if usize::from(road) >= roads {
        return Err(SceneEditError::Road { vehicle, road, roads });
    }
    if !is_position(new.at) {
        return Err(SceneEditError::Place { vehicle, x, y });
    }
    check_speed(vehicle, speed_mps)?;
    if is_size(new.size) { Ok(()) } else { Err(SceneEditError::Size { vehicle, length, width }) }
}

fn check_speed(vehicle: u32, speed_mps: f32) -> Result<(), SceneEditError> {
    if (0. ..=MAX_SPEED).contains(&speed_mps) { Ok(()) } else { Err(SceneEditError::Speed { vehicle, speed_mps }) }
}
