//! A recording prepared for measuring: lanes, positions without jumps, who is ahead of whom.

use std::collections::BTreeMap;

use gnp_data::{NAMED_LEADER_SIZE, Recording, Road, Track};
use serde::{Deserialize, Serialize};

use crate::error::MeasureError;
use crate::robust::{median, quantile};

/// No track, no lane.
const NONE: u32 = u32::MAX;

/// Tracks that must begin, or end, inside the recorded time before the stretch that is seen in full is told from them.
const FEW: usize = 10;

/// How the road runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Course {
    /// From somewhere to somewhere else.
    #[default]
    Open,
    /// Around: `x` and `x + circumference` are one place, whether a recording's x starts anew at the seam or counts on.
    Ring {
        /// Length of one round, m.
        circumference: f64,
    },
}

/// A lane of a carriageway. Numbers are those of the file, whatever order it counts in.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Lane {
    /// Index of its carriageway in [`Recording::roads`].
    pub road: u16,
    /// Number in the file.
    pub number: i16,
    /// Lateral place of its centre, m, to the left: midway between the lane lines around the median of its rows, or that
    /// median where no lines are around it.
    pub centre: f64,
    /// Its place on the carriageway, 0 leftmost.
    pub from_left: usize,
    /// Rows in it.
    pub rows: u64,
}

/// The vehicle directly ahead in the lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ahead {
    /// Vehicle of the file.
    pub vehicle: u32,
    /// Its track; `None` where only the follower's row names it.
    pub track: Option<usize>,
    /// From front to rear, m; negative where the two overlap lengthwise.
    pub gap: f64,
    /// Its speed, m/s; `None` where no row tells it.
    pub speed: Option<f64>,
}

/// A recording, its course, and what every measure needs of them.
#[derive(Debug)]
pub struct Traffic<'a> {
    recording: &'a Recording,
    course: Course,
    /// Centre along the road by row, m, without jumps at a seam.
    x: Vec<f64>,
    lanes: Vec<Lane>,
    /// Index of the lane by row.
    lane: Vec<u32>,
    /// Tracks directly ahead and behind in the lane, by row.
    ahead: Vec<u32>,
    behind: Vec<u32>,
    extents: Vec<Option<[f64; 2]>>,
    frames: [u32; 2],
}

/// A track between two frames.
pub(crate) struct Step {
    /// Row at its start; the next row is its end.
    pub(crate) row: usize,
    /// Times, s.
    pub(crate) t: [f64; 2],
    /// Centres, m, without jumps.
    pub(crate) x: [f64; 2],
}

impl<'a> Traffic<'a> {
    /// Looks at a recording once.
    ///
    /// # Errors
    /// [`MeasureError::NoTime`] with fewer than two frames; [`MeasureError::Setting`] for a circumference that is not
    /// positive.
    pub fn new(recording: &'a Recording, course: Course) -> Result<Self, MeasureError> {
        let tracks = recording.tracks();
        let first = tracks.iter().map(|track| track.first_frame).min().unwrap_or(0);
        let last = tracks.iter().map(Track::last_frame).max().unwrap_or(0);
        Self::over(recording, course, [first, last])
    }

    /// As [`Traffic::new`], over the time from one frame to another, in which nobody may be there at first and at last. Frames
    /// with vehicles before and after them count all the same.
    ///
    /// # Errors
    /// As [`Traffic::new`].
    pub fn over(recording: &'a Recording, course: Course, span: [u32; 2]) -> Result<Self, MeasureError> {
        if let Course::Ring { circumference } = course {
            MeasureError::positive("circumference", circumference)?;
        }
        let tracks = recording.tracks();
        let first = tracks.iter().map(|track| track.first_frame).min().unwrap_or(span[0]).min(span[0]);
        let last = tracks.iter().map(Track::last_frame).max().unwrap_or(span[1]).max(span[1]);
        if last <= first {
            return Err(MeasureError::NoTime { recording: recording.meta().name.clone() });
        }
        let (lanes, lane) = lanes(recording);
        let rows = recording.len();
        let mut traffic = Self {
            recording,
            course,
            x: unwrapped(recording, course),
            lanes,
            lane,
            ahead: vec![NONE; rows],
            behind: vec![NONE; rows],
            extents: Vec::new(),
            frames: [first, last],
        };
        traffic.extents = (0..recording.roads().len()).map(|road| traffic.seen_in_full(road as u16)).collect();
        traffic.find_leaders();
        Ok(traffic)
    }

    /// The recording.
    #[must_use]
    pub fn recording(&self) -> &'a Recording {
        self.recording
    }

    /// How its road runs.
    #[must_use]
    pub fn course(&self) -> Course {
        self.course
    }

    /// Lanes with at least one row, by carriageway and from left to right.
    #[must_use]
    pub fn lanes(&self) -> &[Lane] {
        &self.lanes
    }

    /// Duration of the recording, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.time_s(self.frames[1])
    }

    /// Time of a frame after the recording's first, s.
    #[must_use]
    pub fn time_s(&self, frame: u32) -> f64 {
        (f64::from(frame) - f64::from(self.frames[0])) / self.recording.meta().rate_hz
    }

    /// Stretch of a carriageway that is measured, m; `None` where no vehicle is on it.
    ///
    /// A ring is measured from 0 to its circumference. An open road is measured where it is seen in full: between the places
    /// that nine in ten of the vehicles that come later appear before, and nine in ten of those that leave earlier
    /// disappear behind. Where these are few, or the stretch would be less than half of what any vehicle covers, all of it.
    #[must_use]
    pub fn extent(&self, road: u16) -> Option<[f64; 2]> {
        self.extents.get(usize::from(road)).copied().flatten()
    }

    /// Centre along the road in a row, m: on a ring without jumps at the seam.
    #[must_use]
    pub fn x(&self, row: usize) -> f64 {
        self.x[row]
    }

    /// A place along the road as it is measured: on a ring between 0 and the circumference, m.
    #[must_use]
    pub fn place(&self, x: f64) -> f64 {
        self.circumference().map_or(x, |around| x.rem_euclid(around))
    }

    /// The lane of a row; `None` where the file knows none.
    #[must_use]
    pub fn lane(&self, row: usize) -> Option<&Lane> {
        self.lanes.get(self.lane[row] as usize)
    }

    /// The vehicle directly ahead in the lane. Where a row names one that has no row of its own ([`gnp_data::NamedLeader`]),
    /// it is that one, as long as a car ([`NAMED_LEADER_SIZE`]), its speed from its places in the rows around.
    ///
    /// `row` is one of track `track`.
    #[must_use]
    pub fn ahead(&self, track: usize, row: usize) -> Option<Ahead> {
        let own = &self.recording.tracks()[track];
        if let Some(named) = self.named(row) {
            let gap = f64::from(named.1) - f64::from(NAMED_LEADER_SIZE[0]);
            let inside =
                |row: usize| own.rows.contains(&row) && self.named(row).is_some_and(|other| other.0 == named.0);
            let from = row.checked_sub(1).filter(|before| inside(*before)).unwrap_or(row);
            let to = Some(row + 1).filter(|after| inside(*after)).unwrap_or(row);
            let front = |row: usize| Some(self.x[row] + f64::from(self.named(row)?.1));
            let seconds = (to - from) as f64 / self.recording.meta().rate_hz;
            let speed = (to > from).then(|| Some((front(to)? - front(from)?) / seconds)).flatten();
            return Some(Ahead { vehicle: named.0, track: None, gap, speed });
        }
        let leader = self.track_ahead(row)?;
        let gap = self.gap(own, row, leader, true)?;
        let theirs = &self.recording.tracks()[leader];
        let speed = theirs.row_at(self.frame(own, row)).map(|row| f64::from(self.recording.columns().vx[row]));
        Some(Ahead { vehicle: theirs.vehicle, track: Some(leader), gap, speed })
    }

    /// Track directly ahead in the lane, of those that have a row in the frame.
    #[must_use]
    pub fn track_ahead(&self, row: usize) -> Option<usize> {
        Some(self.ahead[row]).filter(|track| *track != NONE).map(|track| track as usize)
    }

    /// Track directly behind in the lane.
    #[must_use]
    pub fn track_behind(&self, row: usize) -> Option<usize> {
        Some(self.behind[row]).filter(|track| *track != NONE).map(|track| track as usize)
    }

    /// Gap between the vehicle of `row`, one of `own`'s, and a track ahead of it (or behind), bumper to bumper, m.
    pub(crate) fn gap(&self, own: &Track, row: usize, other: usize, is_ahead: bool) -> Option<f64> {
        let theirs = &self.recording.tracks()[other];
        let there = theirs.row_at(self.frame(own, row))?;
        let apart = if is_ahead { self.x[there] - self.x[row] } else { self.x[row] - self.x[there] };
        let apart = self.circumference().map_or(apart, |around| apart.rem_euclid(around));
        Some(apart - f64::from(own.length + theirs.length) / 2.)
    }

    pub(crate) fn frame(&self, track: &Track, row: usize) -> u32 {
        track.first_frame + (row - track.rows.start) as u32
    }

    pub(crate) fn frames(&self) -> std::ops::RangeInclusive<u32> {
        self.frames[0]..=self.frames[1]
    }

    pub(crate) fn circumference(&self) -> Option<f64> {
        match self.course {
            Course::Open => None,
            Course::Ring { circumference } => Some(circumference),
        }
    }

    pub(crate) fn lanes_of(&self, road: u16) -> impl Iterator<Item = &Lane> {
        self.lanes.iter().filter(move |lane| lane.road == road)
    }

    /// Index of the row's lane in [`Traffic::lanes`].
    pub(crate) fn lane_index(&self, row: usize) -> Option<usize> {
        Some(self.lane[row]).filter(|lane| *lane != NONE).map(|lane| lane as usize)
    }

    /// Seconds that a row stands for.
    pub(crate) fn frame_s(&self) -> f64 {
        1. / self.recording.meta().rate_hz
    }

    /// The track from frame to frame.
    pub(crate) fn steps(&self, track: &Track) -> impl Iterator<Item = Step> {
        let (start, from) = (track.rows.start, track.first_frame);
        (start..track.rows.end.saturating_sub(1)).map(move |row| {
            let frame = from + (row - start) as u32;
            Step { row, t: [self.time_s(frame), self.time_s(frame + 1)], x: [self.x[row], self.x[row + 1]] }
        })
    }

    /// Vehicle and headway from front to front, m, of the leader that a row names.
    fn named(&self, row: usize) -> Option<(u32, f32)> {
        let named = self.recording.columns().named_leader.as_ref()?.get(row)?;
        (named.vehicle != 0).then_some((named.vehicle, named.headway))
    }

    fn seen_in_full(&self, road: u16) -> Option<[f64; 2]> {
        if let Some(around) = self.circumference() {
            return Some([0., around]);
        }
        let on_road = || self.recording.tracks().iter().filter(|track| track.road == road);
        let all = on_road().flat_map(|track| &self.x[track.rows.clone()]);
        let [low, high] = all.fold([f64::INFINITY, f64::NEG_INFINITY], |r, x| [r[0].min(*x), r[1].max(*x)]);
        if low > high {
            return None;
        }
        let sorted = |mut places: Vec<f64>| {
            places.sort_unstable_by(f64::total_cmp);
            places
        };
        let came = on_road().filter(|track| track.first_frame > self.frames[0]).map(|track| self.x[track.rows.start]);
        let left =
            on_road().filter(|track| track.last_frame() < self.frames[1]).map(|track| self.x[track.rows.end - 1]);
        let (came, left) = (sorted(came.collect()), sorted(left.collect()));
        let seen = [quantile(&came, 0.9), quantile(&left, 0.1)];
        match seen {
            [Some(from), Some(to)] if came.len().min(left.len()) >= FEW && to - from > (high - low) / 2. => {
                Some([from, to])
            }
            _ => Some([low, high]),
        }
    }

    fn find_leaders(&mut self) {
        let tracks = self.recording.tracks();
        let mut placed: Vec<(u32, f64, u32, usize)> = Vec::new();
        for frame in self.frames() {
            placed.clear();
            for track in self.recording.present(frame) {
                let Some(row) = tracks[*track as usize].row_at(frame) else { continue };
                if self.lane[row] != NONE {
                    placed.push((self.lane[row], self.place(self.x[row]), *track, row));
                }
            }
            placed.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
            for lane in placed.chunk_by(|a, b| a.0 == b.0) {
                let closed = self.circumference().is_some() && lane.len() > 1;
                let seam = lane.last().zip(lane.first()).filter(|_| closed);
                for (behind, ahead) in lane.iter().zip(&lane[1..]).chain(seam) {
                    self.ahead[behind.3] = ahead.2;
                    self.behind[ahead.3] = behind.2;
                }
            }
        }
    }
}

/// Positions along the road without jumps at the seam of a ring: each track starts in its first round and counts on.
fn unwrapped(recording: &Recording, course: Course) -> Vec<f64> {
    let given = &recording.columns().x;
    let Course::Ring { circumference: around } = course else { return given.iter().map(|x| f64::from(*x)).collect() };
    let mut x = Vec::with_capacity(given.len());
    for track in recording.tracks() {
        let mut at = f64::from(given[track.rows.start]).rem_euclid(around);
        x.push(at);
        for row in track.rows.clone().skip(1) {
            let by = f64::from(given[row]) - f64::from(given[row - 1]);
            at += by - around * (by / around).round();
            x.push(at);
        }
    }
    x
}

/// Lanes by carriageway from left to right, and the index of the lane of each row.
fn lanes(recording: &Recording) -> (Vec<Lane>, Vec<u32>) {
    let columns = recording.columns();
    let mut places: BTreeMap<(u16, i16), Vec<f64>> = BTreeMap::new();
    for track in recording.tracks() {
        for row in track.rows.clone().filter(|row| columns.lane[*row] > 0) {
            places.entry((track.road, columns.lane[row])).or_default().push(f64::from(columns.y[row]));
        }
    }
    let lane = |((road, number), y): ((u16, i16), Vec<f64>)| {
        let rows = y.len() as u64;
        let middle = median(y).unwrap_or(0.);
        let centre = recording.roads().get(usize::from(road)).and_then(|road| between_lines(road, middle));
        Lane { road, number, centre: centre.unwrap_or(middle), from_left: 0, rows }
    };
    let mut lanes: Vec<Lane> = places.into_iter().map(lane).collect();
    lanes.sort_by(|a, b| a.road.cmp(&b.road).then(b.centre.total_cmp(&a.centre)).then(a.number.cmp(&b.number)));
    for road in lanes.chunk_by_mut(|a, b| a.road == b.road) {
        road.iter_mut().enumerate().for_each(|(place, lane)| lane.from_left = place);
    }
    let index: BTreeMap<(u16, i16), u32> = lanes.iter().zip(0..).map(|(it, i)| ((it.road, it.number), i)).collect();
    let mut of_row = vec![NONE; recording.len()];
    for track in recording.tracks() {
        for row in track.rows.clone() {
            of_row[row] = index.get(&(track.road, columns.lane[row])).copied().unwrap_or(NONE);
        }
    }
    (lanes, of_row)
}

/// Middle between the lane lines around `y`, m.
fn between_lines(road: &Road, y: f64) -> Option<f64> {
    let around = |pair: &&[gnp_data::LaneMarking]| f64::from(pair[0].y) <= y && y < f64::from(pair[1].y);
    road.lines.windows(2).find(around).map(|pair| f64::from(pair[0].y + pair[1].y) / 2.)
}
