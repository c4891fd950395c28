//! Lane changes: when, to which side, into what gap, how long.

use gnp_data::Track;
use serde::{Deserialize, Serialize};

use crate::error::MeasureError;
use crate::traffic::{Lane, Traffic};

/// What is a lane change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaneChangeSettings {
    /// A lane number that is undone within this time is a flip and no change, s.
    pub flip_s: f64,
    /// Lateral speed is a difference of positions over this time, s.
    pub span_s: f64,
    /// A change lasts while the lateral speed towards the new lane is at least this, m/s.
    pub lateral_speed: f64,
}

impl Default for LaneChangeSettings {
    fn default() -> Self {
        Self { flip_s: 1., span_s: 0.5, lateral_speed: 0.15 }
    }
}

/// A side of the road as seen by the driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// To the left of travel.
    Left,
    /// To the right of travel.
    Right,
}

/// A vehicle ahead of the one that changes lane, or behind it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Beside {
    /// Vehicle of the file.
    pub vehicle: u32,
    /// Bumper to bumper, m; negative where the two overlap lengthwise.
    pub gap: f64,
    /// Its speed, m/s.
    pub speed: f64,
    /// Post-encroachment time, s: from now until the front of the one behind reaches the place where the rear of the one
    /// ahead is now, as it then drove. `None` where the recording ends before.
    pub post_encroachment_s: Option<f64>,
}

/// Who is ahead and behind in one lane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Situation {
    /// Directly ahead, of vehicles with rows.
    pub leader: Option<Beside>,
    /// Directly behind.
    pub follower: Option<Beside>,
}

/// One lane change.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LaneChange {
    /// Vehicle of the file.
    pub vehicle: u32,
    /// Index of the carriageway.
    pub road: u16,
    /// First frame in the new lane, s: the centre of the box crosses the line.
    pub time_s: f64,
    /// Place there, m.
    pub x: f64,
    /// Speed there, m/s.
    pub speed: f64,
    /// Lane numbers of the file, before and after.
    pub from: i16,
    /// See `from`.
    pub to: i16,
    /// To which side.
    pub direction: Direction,
    /// Lanes crossed; 1 for the lane beside.
    pub lanes: usize,
    /// Duration of the lateral motion, s, to within `span_s` of the settings; `None` where the track begins or ends in it.
    pub duration_s: Option<f64>,
    /// In the last frame in the old lane.
    pub before: Situation,
    /// In the first frame in the new lane.
    pub after: Situation,
}

/// Lane changes of a recording.
///
/// Post-encroachment time is that of FHWA's Surrogate Safety Assessment Model (Gettman et al. 2008), with the line
/// across the lane at the rear of the vehicle ahead as the place of conflict: in the new lane, the changer's rear and the new
/// follower's front, and the new leader's rear and the changer's front; in the old lane the same, as it stood in the last
/// frame. After a change it is what happened, so that a follower who brakes has a longer one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LaneChanges {
    /// By vehicle and time.
    pub changes: Vec<LaneChange>,
    /// Distance driven by all vehicles, km.
    pub vehicle_km: f64,
    /// Changes for every vehicle-kilometre; `None` where nobody drove.
    pub per_vehicle_km: Option<f64>,
    /// To the left, to the right.
    pub by_direction: [usize; 2],
    /// Changes of the lane number that were undone: no changes.
    pub flips: usize,
    /// Changes over frames without a lane number; the time is that of the first number after them.
    pub through_unknown: usize,
    /// Changes whose duration is not known, because the track begins or ends in them.
    pub cut_off: usize,
}

/// Rows in one lane, one after the other.
#[derive(Clone, Copy)]
struct Run {
    lane: usize,
    first: usize,
    last: usize,
}

impl Traffic<'_> {
    /// Lane changes.
    ///
    /// # Errors
    /// [`MeasureError::Setting`] for settings that are not positive.
    pub fn lane_changes(&self, settings: &LaneChangeSettings) -> Result<LaneChanges, MeasureError> {
        MeasureError::positive("lane_changes.flip_s", settings.flip_s)?;
        MeasureError::positive("lane_changes.span_s", settings.span_s)?;
        MeasureError::positive("lane_changes.lateral_speed", settings.lateral_speed)?;
        let vehicle_km = self.distance_m() / 1000.;
        let mut found = LaneChanges {
            changes: Vec::new(),
            vehicle_km,
            per_vehicle_km: None,
            by_direction: [0; 2],
            flips: 0,
            through_unknown: 0,
            cut_off: 0,
        };
        for track in self.recording().tracks() {
            let runs = self.runs(track, settings, &mut found.flips);
            for pair in runs.windows(2) {
                found.through_unknown += usize::from(pair[1].first > pair[0].last + 1);
                found.changes.push(self.change(track, pair[0], pair[1], settings));
            }
        }
        for change in &found.changes {
            found.by_direction[usize::from(change.direction == Direction::Right)] += 1;
            found.cut_off += usize::from(change.duration_s.is_none());
        }
        found.per_vehicle_km = (vehicle_km > 0.).then(|| found.changes.len() as f64 / vehicle_km);
        Ok(found)
    }

    /// Stays in lanes, without those that a flip makes.
    fn runs(&self, track: &Track, settings: &LaneChangeSettings, flips: &mut usize) -> Vec<Run> {
        let short = (settings.flip_s / self.frame_s()).round() as usize;
        let mut runs: Vec<Run> = Vec::new();
        for row in track.rows.clone() {
            let Some(lane) = self.lane_index(row) else { continue };
            match runs.last_mut() {
                Some(run) if run.lane == lane => run.last = row,
                _ => runs.push(Run { lane, first: row, last: row }),
            }
            // Back where it was, after a short stay elsewhere.
            if let [.., before, away, back] = &mut runs[..]
                && before.lane == back.lane
                && away.last - away.first < short
            {
                before.last = back.last;
                runs.truncate(runs.len() - 2);
                *flips += 1;
            }
        }
        runs
    }

    fn change(&self, track: &Track, old: Run, new: Run, settings: &LaneChangeSettings) -> LaneChange {
        let (from, to): (&Lane, &Lane) = (&self.lanes()[old.lane], &self.lanes()[new.lane]);
        let direction = if to.from_left < from.from_left { Direction::Left } else { Direction::Right };
        LaneChange {
            vehicle: track.vehicle,
            road: track.road,
            time_s: self.time_s(self.frame(track, new.first)),
            x: self.place(self.x(new.first)),
            speed: f64::from(self.recording().columns().vx[new.first]),
            from: from.number,
            to: to.number,
            direction,
            lanes: to.from_left.abs_diff(from.from_left),
            duration_s: self.lateral_duration(track, [old.last, new.first], direction, settings),
            before: self.situation(track, old.last),
            after: self.situation(track, new.first),
        }
    }

    /// Time around the crossing for which the vehicle moves towards the new lane.
    fn lateral_duration(
        &self,
        track: &Track,
        [old, new]: [usize; 2],
        direction: Direction,
        settings: &LaneChangeSettings,
    ) -> Option<f64> {
        let y = &self.recording().columns().y;
        let half = ((settings.span_s / self.frame_s() / 2.).round() as usize).max(1);
        let sign = if direction == Direction::Left { 1. } else { -1. };
        let moves = |row: usize| {
            let from = row.checked_sub(half).filter(|from| track.rows.contains(from))?;
            let to = Some(row + half).filter(|to| track.rows.contains(to))?;
            let speed = f64::from(y[to] - y[from]) / (2. * half as f64 * self.frame_s());
            Some(sign * speed >= settings.lateral_speed)
        };
        // `Some(false)` is its first row at rest sideways; a row whose speed is not known ends the search in vain.
        let rest = |rows: &mut dyn Iterator<Item = usize>| {
            rows.map_while(|row| Some((row, moves(row)?))).find(|(_, moves)| !moves).map(|(row, _)| row)
        };
        let begins = rest(&mut (track.rows.start..=old).rev())?;
        let ends = rest(&mut (new..track.rows.end))?;
        Some((ends - begins) as f64 * self.frame_s())
    }

    fn situation(&self, track: &Track, row: usize) -> Situation {
        let tracks = self.recording().tracks();
        let vx = &self.recording().columns().vx;
        let frame = self.frame(track, row);
        let beside = |other: usize, is_ahead: bool| {
            let gap = self.gap(track, row, other, is_ahead)?;
            let (theirs, there) = (&tracks[other], tracks[other].row_at(frame)?);
            let (behind, from) = if is_ahead { (track, row) } else { (theirs, there) };
            let post_encroachment_s = self.time_to_drive(behind, from, gap);
            Some(Beside { vehicle: theirs.vehicle, gap, speed: f64::from(vx[there]), post_encroachment_s })
        };
        Situation {
            leader: self.track_ahead(row).and_then(|other| beside(other, true)),
            follower: self.track_behind(row).and_then(|other| beside(other, false)),
        }
    }

    /// Time in which the vehicle drives `metres` on from `row`, s: 0 where it is there already, `None` where the track ends before.
    fn time_to_drive(&self, track: &Track, row: usize, metres: f64) -> Option<f64> {
        let goal = self.x(row) + metres;
        if metres <= 0. {
            return Some(0.);
        }
        let reached = (row + 1..track.rows.end).find(|row| self.x(*row) >= goal)?;
        let (before, after) = (self.x(reached - 1), self.x(reached));
        Some(((reached - 1 - row) as f64 + (goal - before) / (after - before)) * self.frame_s())
    }
}
