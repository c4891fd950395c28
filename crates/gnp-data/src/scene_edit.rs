//! A window's past with changes: what a predictor is asked with "what if".

use crate::error::DataError;
use crate::limits::MAX_SPEED;
use crate::neighbours::{LanePosition, find_neighbours};
use crate::parts::track_at;
use crate::recording::{Columns, NO_TRACK, NamedLeader, Recording, Track, VelocitySource};
use crate::slot::{SLOTS, Slot};
use crate::window::{Neighbour, Observation};
use crate::window_shape::WindowShape;

/// Time before the last observed frame over which a changed speed is reached, s.
pub const SPEED_CHANGE_S: f64 = 1.;

/// The observed past of a window's carriageway as a recording of its own, with changes: every
/// vehicle present in the last observed frame, and no row after it.
///
/// ```no_run
/// # fn example(observation: gnp_data::Observation<'_>) -> Result<(), gnp_data::DataError> {
/// use gnp_data::EditedScene;
///
/// // What would the target do without its leader, and what if the leader were at 5 m/s?
/// if let Some(leader) = observation.leader() {
///     let free = EditedScene::of(&observation)?.without(leader.vehicle())?;
///     let slow = EditedScene::of(&observation)?.with_speed(leader.vehicle(), 5.)?;
///     let asked = [free.observation()?, slow.observation()?];
///     // predictor.predict(&asked, 6)
/// #   let _ = asked;
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct EditedScene {
    recording: Recording,
    shape: WindowShape,
    target: u32,
    /// The last observed frame.
    frame: u32,
}

/// Why a scene cannot be changed so.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneEditError {
    /// The target was to be removed.
    #[error("vehicle {vehicle} is the target of the window and cannot be removed")]
    Target {
        /// The vehicle.
        vehicle: u32,
    },
    /// A vehicle that is not there.
    #[error("vehicle {vehicle} is not on the target's carriageway in the last observed frame")]
    Absent {
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
}

impl EditedScene {
    /// The scene of `observation` with nothing changed: its own observation gives the same bits.
    ///
    /// # Errors
    /// [`DataError::Parts`] never for an observation of a checked recording.
    pub fn of(observation: &Observation<'_>) -> Result<Self, DataError> {
        let (from, frame) = (observation.recording, observation.frame());
        // The velocity in a frame needs the one before.
        let shape = observation.shape;
        let past = (shape.t_obs - 1).saturating_mul(shape.step).saturating_add(1);
        let start = frame.saturating_sub(past as u32);
        let road = observation.track().road;
        let there = from.present(frame).iter().copied();
        let kept: Vec<u32> = there.filter(|track| from.tracks()[*track as usize].road == road).collect();
        let place = |track: u32| kept.binary_search(&track).map_or(NO_TRACK, |place| place as u32);

        let mut tracks = Vec::with_capacity(kept.len());
        let mut columns = Columns::default();
        let all = from.columns();
        let mut leaders = all.named_leader.as_ref().map(|_| Vec::new());
        for index in &kept {
            let track = &from.tracks()[*index as usize];
            let first_frame = track.first_frame.max(start);
            let (Some(first), Some(last)) = (track.row_at(first_frame), track.row_at(frame)) else { continue };
            let begin = columns.x.len();
            columns.x.extend_from_slice(&all.x[first..=last]);
            columns.y.extend_from_slice(&all.y[first..=last]);
            columns.lane.extend_from_slice(&all.lane[first..=last]);
            // The last stored velocity may know the next row.
            let now = from.velocity_one_sided(*index as usize, last).unwrap_or_default();
            columns.vx.extend(all.vx[first..last].iter().chain([&now[0]]));
            columns.vy.extend(all.vy[first..last].iter().chain([&now[1]]));
            columns.neighbours.resize(columns.x.len() - 1, [NO_TRACK; SLOTS]);
            columns.neighbours.push(all.neighbours[last].map(place));
            if let (Some(leaders), Some(all)) = (&mut leaders, &all.named_leader) {
                leaders.extend_from_slice(&all[first..=last]);
            }
            tracks.push(Track { first_frame, rows: begin..columns.x.len(), ..track.clone() });
        }
        columns.named_leader = leaders;
        let recording = Recording::from_parts(from.meta().clone(), from.roads().to_vec(), tracks, columns)?;
        let recording =
            Recording { lane_order: from.lane_order.clone(), ..recording }.with_vehicle_names(from.names.clone());
        Ok(Self { recording, shape, target: observation.track().vehicle, frame })
    }

    /// The scene without `vehicle`, which may be a leader that has no row of its own. Whoever had it as neighbour
    /// has the next one instead; who followed it follows whom it followed.
    ///
    /// # Errors
    /// [`SceneEditError::Target`], [`SceneEditError::Absent`].
    pub fn without(self, vehicle: u32) -> Result<Self, DataError> {
        if vehicle == self.target {
            return Err(SceneEditError::Target { vehicle }.into());
        }
        let gone = track_at(self.recording.tracks(), vehicle, self.frame);
        if gone.is_none() && self.followers(vehicle).is_empty() {
            return Err(SceneEditError::Absent { vehicle }.into());
        }
        let mut columns = self.recording.columns().clone();
        if let Some(gone) = gone {
            self.pass_on_leader(gone, &mut columns);
        }
        for leader in columns.named_leader.iter_mut().flatten().filter(|leader| leader.vehicle == vehicle) {
            *leader = NamedLeader::default();
        }
        let Some(gone) = gone else { return self.rebuilt(self.recording.tracks().to_vec(), columns) };

        let mut tracks = self.recording.tracks().to_vec();
        let removed = tracks.remove(gone).rows;
        columns.x.drain(removed.clone());
        columns.y.drain(removed.clone());
        columns.vx.drain(removed.clone());
        columns.vy.drain(removed.clone());
        columns.lane.drain(removed.clone());
        columns.neighbours.drain(removed.clone());
        columns.named_leader.iter_mut().for_each(|leaders| drop(leaders.drain(removed.clone())));
        for track in &mut tracks[gone..] {
            track.rows = track.rows.start - removed.len()..track.rows.end - removed.len();
        }
        let found = find_neighbours(&self.positions(&tracks, &columns));
        for (track, found) in tracks.iter().zip(found) {
            // The others are who they were: the nearest stay the nearest.
            for (slot, found) in columns.neighbours[track.rows.end - 1].iter_mut().zip(found.0) {
                *slot = match *slot {
                    NO_TRACK => NO_TRACK,
                    other if other as usize == gone => found.map_or(NO_TRACK, |other| other as u32),
                    other => other - u32::from(other as usize > gone),
                };
            }
        }
        self.rebuilt(tracks, columns)
    }

    /// The scene in which `vehicle`, which may be the target or a leader without a row of its own, arrives at its
    /// present place with `speed_mps` along the road, m/s: over the last [`SPEED_CHANGE_S`] before the last observed
    /// frame its speed departs from the recorded one, linearly in time. Its lateral motion stays, and so do the
    /// places of all others. A leader without a row is absent where it would be behind its follower's front.
    ///
    /// # Errors
    /// [`SceneEditError::Speed`], [`SceneEditError::Absent`], [`SceneEditError::NoPast`].
    pub fn with_speed(self, vehicle: u32, speed_mps: f32) -> Result<Self, DataError> {
        if !(0. ..=MAX_SPEED).contains(&speed_mps) {
            return Err(SceneEditError::Speed { vehicle, speed_mps }.into());
        }
        let mut columns = self.recording.columns().clone();
        match track_at(self.recording.tracks(), vehicle, self.frame) {
            Some(track) => self.change_recorded(track, speed_mps, &mut columns)?,
            None => self.change_named(vehicle, speed_mps, &mut columns)?,
        }
        self.rebuilt(self.recording.tracks().to_vec(), columns)
    }

    /// What a predictor may see of the target in the changed scene, under the name of the window it was made of.
    ///
    /// # Errors
    /// [`DataError::Window`] never for a scene of an observation.
    pub fn observation(&self) -> Result<Observation<'_>, DataError> {
        let absent = SceneEditError::Absent { vehicle: self.target };
        let track = track_at(self.recording.tracks(), self.target, self.frame).ok_or(absent)?;
        let row = self.recording.tracks()[track].rows.end - 1;
        Ok(Observation::new(&self.recording, self.shape, track, row)?)
    }

    /// The scene: every vehicle of the carriageway up to the last observed frame. Neighbours stand in that frame alone.
    #[must_use]
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    fn rebuilt(&self, tracks: Vec<Track>, columns: Columns) -> Result<Self, DataError> {
        let old = &self.recording;
        let recording = Recording::from_parts(old.meta().clone(), old.roads().to_vec(), tracks, columns)?;
        let recording = Recording { lane_order: old.lane_order.clone(), ..recording };
        Ok(Self { recording: recording.with_vehicle_names(old.names.clone()), ..*self })
    }

    /// Tracks whose last row names `vehicle`, which has no track, as leader.
    fn followers(&self, vehicle: u32) -> Vec<usize> {
        let named = |track: &Track| self.recording.named_leader(track.rows.end - 1);
        let names = |track: &Track| named(track).is_some_and(|leader| leader.vehicle == vehicle);
        (0..self.recording.tracks().len()).filter(|track| names(&self.recording.tracks()[*track])).collect()
    }

    /// Who follows track `gone` follows the leader that only its rows tell.
    fn pass_on_leader(&self, gone: usize, columns: &mut Columns) {
        let tracks = self.recording.tracks();
        let (leading, Some(leaders)) = (&tracks[gone], &mut columns.named_leader) else { return };
        let last = leading.rows.end - 1;
        let passed_on = leaders[last].vehicle;
        if passed_on == 0 {
            return;
        }
        let preceding = |track: &&Track| self.recording.neighbour(track.rows.end - 1, Slot::Preceding) == Some(gone);
        for track in tracks.iter().filter(preceding) {
            if leaders[track.rows.end - 1].vehicle != 0 {
                continue;
            }
            for (row, from) in track.rows.clone().rev().zip(leading.rows.clone().rev()) {
                let NamedLeader { vehicle, headway } = leaders[from];
                let centres = columns.x[from] - columns.x[row];
                let headway = headway + centres + (leading.length - track.length) / 2.;
                if vehicle == passed_on && leaders[row].vehicle == 0 && headway > 0. {
                    leaders[row] = NamedLeader { vehicle, headway };
                }
            }
        }
    }

    /// Vehicles of the last observed frame by lane, 1 leftmost.
    fn positions(&self, tracks: &[Track], columns: &Columns) -> Vec<LanePosition> {
        let lane = |track: &Track| columns.lane[track.rows.end - 1];
        let known: Vec<(f32, f32)> = tracks
            .iter()
            .filter(|track| lane(track) > 0)
            .map(|track| (f32::from(lane(track)), columns.y[track.rows.end - 1]))
            .collect();
        let count = known.len().max(1) as f32;
        let mean = |of: fn(&(f32, f32)) -> f32| known.iter().map(of).sum::<f32>() / count;
        let (lanes, y) = (mean(|it| it.0), mean(|it| it.1));
        // Where the data names neighbours, lane numbers may grow to the left.
        let to_the_left = known.iter().map(|it| (it.0 - lanes) * (it.1 - y)).sum::<f32>() > 0.;
        let highest = tracks.iter().map(lane).max().unwrap_or(0);
        let place = |lane: i16| match &self.recording.lane_order {
            Some(order) => order.get(&lane).copied().unwrap_or(0),
            None if to_the_left && lane > 0 => highest - lane + 1,
            None => lane,
        };
        let position = |track: &Track| LanePosition {
            lane: place(lane(track)),
            x: columns.x[track.rows.end - 1],
            length: track.length,
        };
        tracks.iter().map(position).collect()
    }

    fn change_recorded(&self, track: usize, speed_mps: f32, columns: &mut Columns) -> Result<(), SceneEditError> {
        let Track { vehicle, ref rows, .. } = self.recording.tracks()[track];
        let now = self.recording.velocity_one_sided(track, rows.end - 1).ok_or(SceneEditError::NoPast { vehicle })?;
        let change = self.change(speed_mps - now[0], rows.len());
        let recorded = self.recording.meta().velocities == VelocitySource::Recorded;
        for (back, row) in rows.clone().rev().enumerate() {
            columns.x[row] += change[back].place;
            if let Some(leaders) = &mut columns.named_leader {
                leaders[row] = moved(leaders[row], -change[back].place);
            }
            // A derived velocity is a difference to the row after, too.
            columns.vx[row] += match back.checked_sub(1) {
                Some(after) if !recorded && row == rows.start => change[after].speed,
                Some(after) if !recorded => (change[back].speed + change[after].speed) / 2.,
                _ => change[back].speed,
            };
        }
        Ok(())
    }

    fn change_named(&self, vehicle: u32, speed_mps: f32, columns: &mut Columns) -> Result<(), DataError> {
        let followers = self.followers(vehicle);
        let Some(leaders) = columns.named_leader.as_mut().filter(|_| !followers.is_empty()) else {
            return Err(SceneEditError::Absent { vehicle }.into());
        };
        for track in followers {
            let follower = Neighbour { observation: self.observation()?, track };
            let now =
                follower.leader().and_then(|leader| leader.velocity()).ok_or(SceneEditError::NoPast { vehicle })?;
            let rows = self.recording.tracks()[track].rows.clone();
            let change = self.change(speed_mps - now[0], rows.len());
            for (leader, change) in leaders[rows].iter_mut().rev().zip(change) {
                if leader.vehicle == vehicle {
                    *leader = moved(*leader, change.place);
                }
            }
        }
        Ok(())
    }

    /// What a difference of speeds of `faster` m/s at the end does to the last `rows` frames, the last first.
    fn change(&self, faster: f32, rows: usize) -> Vec<Change> {
        let dt = 1. / self.recording.meta().rate_hz;
        let mut place = 0f64;
        let change = |back: usize| {
            let speed = f64::from(faster) * (1. - back as f64 * dt / SPEED_CHANGE_S).max(0.);
            let change = Change { place: place as f32, speed: speed as f32 };
            // Where it comes from, one frame before.
            place -= speed * dt;
            change
        };
        (0..rows).map(change).collect()
    }
}

/// How a frame differs from the recorded one.
#[derive(Clone, Copy)]
struct Change {
    /// Forward, m.
    place: f32,
    /// Speed from the frame before to this one, m/s.
    speed: f32,
}

/// A leader that is `forward` m further ahead of its follower, if it still is ahead.
fn moved(leader: NamedLeader, forward: f32) -> NamedLeader {
    let headway = leader.headway + forward;
    if leader.vehicle != 0 && headway > 0. { NamedLeader { headway, ..leader } } else { NamedLeader::default() }
}
