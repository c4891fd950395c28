//! Where drivers could have changed lanes, and whether they did.
use super::{
    fit::{DriverKey, FittedTraffic},
    stretches::frame_of,
};
use gnp_data::{Recording, Slot, Track};
use gnp_force::{Driver, Mobil, following_acceleration};
use std::collections::BTreeMap;

/// Time between a change's end and the next situation, and the time after a situation that must be recorded, s.
pub(super) const PAUSE_S: f64 = 3.;
/// Speed across the road from which somebody is on his way, m/s, over [`ACROSS_S`].
const UNDER_WAY: f64 = 0.15;
/// Time over which a speed across the road is measured, s.
const ACROSS_S: f64 = 1.;
/// Longest time from the begin of a change to the line, s.
const LONGEST_S: f64 = 5.;
/// Time for which a new lane is kept, s: shorter ones are errors of the lane numbers.
const KEPT_S: f64 = 1.;
/// Least gap to those one would move between, m.
const LEAST_ROOM_M: f64 = 1.;

/// What one side would bring, m/s².
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gain {
    /// To the driver.
    pub(super) own: f64,
    /// To his new and his old follower together.
    pub(super) others: f64,
}

/// A driver at one moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Situation {
    /// Who.
    pub(super) key: DriverKey,
    /// Left and right; none where no lane is, no room, or it would not be safe.
    pub(super) sides: [Option<Gain>; 2],
    /// The side to which he begins to move within the next second.
    pub(super) taken: Option<usize>,
}

/// What was found in a recording.
#[derive(Debug, Default)]
pub(super) struct Situations {
    pub(super) all: Vec<Situation>,
    /// Changes to the left and to the right, wherever in a track.
    pub(super) changes: [usize; 2],
    /// Way driven, km.
    pub(super) vehicle_km: f64,
}

/// A change: the rows in which it begins and in which the centre is in the new lane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Change {
    begin: usize,
    crossed: usize,
    side: usize,
}

/// The situations of the vehicles of a recording, one a second, of those tracks that `counts` lets through.
pub(super) fn situations(
    recording: &Recording,
    number: usize,
    traffic: &FittedTraffic,
    counts: impl Fn(&Track) -> bool,
) -> Situations {
    let rate = recording.meta().rate_hz;
    let (second, pause) = (rate.round().max(1.) as usize, (PAUSE_S * rate).round() as usize);
    let scene = Scene { recording, number, traffic };
    let mut found = Situations::default();
    for track in recording.tracks().iter().filter(|track| counts(track)) {
        let (Some(first), Some(last)) = (track.rows.clone().next(), track.rows.clone().last()) else { continue };
        let x = &recording.columns().x;
        found.vehicle_km += f64::from(x[last] - x[first]).abs() / 1000.;
        let changes = changes(recording, track);
        for change in &changes {
            found.changes[change.side] += 1;
        }
        for row in track.rows.clone().step_by(second).take_while(|row| row + pause <= last) {
            let busy = |change: &Change| row > change.begin && row <= change.crossed + pause;
            if changes.iter().any(busy) {
                continue;
            }
            let begins = |change: &&Change| (row..row + second).contains(&change.begin);
            let taken = changes.iter().find(begins).map(|change| change.side);
            let sides = scene.sides(track, row);
            let key = DriverKey { recording: number, vehicle: track.vehicle };
            found.all.push(Situation { key, sides, taken });
        }
    }
    found
}

/// The changes of a track, by the numbers of its lanes.
fn changes(recording: &Recording, track: &Track) -> Vec<Change> {
    let (columns, rate) = (recording.columns(), recording.meta().rate_hz);
    let half = ((ACROSS_S / 2. * rate).round() as usize).max(1);
    let (first, end) = (track.rows.start, track.rows.end);
    let kept = (KEPT_S * rate).round() as usize;
    let across = |row: usize| {
        let (from, to) = (row.saturating_sub(half).max(first), (row + half).min(end - 1));
        f64::from(columns.y[to] - columns.y[from]) * rate / (to - from).max(1) as f64
    };
    let mut found: Vec<Change> = Vec::new();
    for row in first + 1..end {
        let (before, now) = (columns.lane[row - 1], columns.lane[row]);
        let steady = |rows: std::ops::Range<usize>, lane| columns.lane[rows].iter().all(|it| *it == lane);
        if before == now || before == 0 || now == 0 || !steady(row..(row + kept).min(end), now) {
            continue;
        }
        let (speed, longest) = (across(row), (LONGEST_S * rate) as usize);
        let (side, sign) = if speed > 0. { (0, 1.) } else { (1, -1.) };
        let earliest = row.saturating_sub(longest).max(found.last().map_or(first, |last| last.crossed));
        let resting = (earliest..row).rev().find(|at| sign * across(*at) < UNDER_WAY);
        found.push(Change { begin: resting.unwrap_or(earliest), crossed: row, side });
    }
    found
}

struct Scene<'a> {
    recording: &'a Recording,
    number: usize,
    traffic: &'a FittedTraffic,
}

/// Somebody in a frame.
#[derive(Clone, Copy)]
struct Present {
    x: f64,
    v: f64,
    length: f64,
    driver: Driver<f64>,
}

impl Present {
    /// Acceleration behind somebody, or on an empty road, m/s².
    fn behind(&self, leader: Option<&Self>) -> f64 {
        match leader {
            Some(leader) => {
                let body = (self.length + leader.length) / 2.;
                following_acceleration(leader.x - self.x, body, self.v, leader.v, &self.driver)
            }
            None => gnp_force::free_acceleration(self.v, &self.driver),
        }
    }

    fn has_room(&self, other: &Self) -> bool {
        (self.x - other.x).abs() - (self.length + other.length) / 2. >= LEAST_ROOM_M
    }
}

impl Scene<'_> {
    fn present(&self, track: &Track, row: usize) -> Present {
        let state = self.recording.state(row);
        let key = DriverKey { recording: self.number, vehicle: track.vehicle };
        let driver = self.traffic.driver(key, track.class);
        Present { x: f64::from(state.x), v: f64::from(state.vx), length: f64::from(track.length), driver }
    }

    /// The vehicle in a slot.
    fn slot(&self, track: &Track, row: usize, slot: Slot) -> Option<Present> {
        let other = &self.recording.tracks()[self.recording.neighbour(row, slot)?];
        Some(self.present(other, other.row_at(frame_of(track, row))?))
    }

    fn sides(&self, track: &Track, row: usize) -> [Option<Gain>; 2] {
        let me = self.present(track, row);
        let (leader, follower) = (self.slot(track, row, Slot::Preceding), self.slot(track, row, Slot::Following));
        let own = me.behind(leader.as_ref());
        let released = follower.map_or(0., |follower| follower.behind(leader.as_ref()) - follower.behind(Some(&me)));
        let lines = self.recording.roads().get(usize::from(track.road)).map_or(&[][..], |road| &road.lines[..]);
        let y = self.recording.columns().y[row];
        let right_of = lines.iter().filter(|line| line.y <= y).count();
        let slots = [
            [Slot::LeftPreceding, Slot::LeftAlongside, Slot::LeftFollowing],
            [Slot::RightPreceding, Slot::RightAlongside, Slot::RightFollowing],
        ];
        // A lane beside has a line at its far edge.
        let exists = [right_of >= 1 && right_of + 1 < lines.len(), right_of >= 2];
        let mut sides = [None; 2];
        for ((side, exists), [ahead, beside, behind]) in sides.iter_mut().zip(exists).zip(slots) {
            if !exists || self.slot(track, row, beside).is_some() {
                continue;
            }
            let (ahead, behind) = (self.slot(track, row, ahead), self.slot(track, row, behind));
            let mine = me.behind(ahead.as_ref());
            let his = behind.map(|behind| (behind.behind(Some(&me)), behind.behind(ahead.as_ref())));
            let roomy = ahead.iter().chain(&behind).all(|other| me.has_room(other));
            let least = -Mobil::<f64>::standard().safe_braking;
            if roomy && mine >= least && his.is_none_or(|(after, _)| after >= least) {
                let others = released + his.map_or(0., |(after, before)| after - before);
                *side = Some(Gain { own: mine - own, others });
            }
        }
        sides
    }
}

/// For scenes that share vehicles: the recording in which each has most rows.
pub(super) fn longest(recordings: &[Recording]) -> BTreeMap<u32, usize> {
    let mut rows: BTreeMap<u32, (usize, usize)> = BTreeMap::new();
    for (number, recording) in recordings.iter().enumerate() {
        for track in recording.tracks() {
            let best = rows.entry(track.vehicle).or_insert((track.rows.len(), number));
            if track.rows.len() > best.0 {
                *best = (track.rows.len(), number);
            }
        }
    }
    rows.into_iter().map(|(vehicle, (_, number))| (vehicle, number)).collect()
}
