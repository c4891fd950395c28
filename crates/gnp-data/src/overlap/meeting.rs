//! Two recordings that show the same minutes: which of their tracks are at one place at one time.

use super::{LATERAL_TOLERANCE, LONGITUDINAL_TOLERANCE, PLACE};
use crate::recording::{Recording, Track};

/// Lengths that count as one differ by no more, m.
const LENGTH_TOLERANCE: f32 = 0.05;
/// Two bodies whose centres are this near, m, are one: no second vehicle has room.
const ONE_BODY: f32 = 1.;
/// Frames that two tracks must have in common to tell where their recordings lie to each other.
const LEAST_FRAMES: u32 = 5;

/// The shift in time and space between two recordings of one road.
pub(super) struct Meeting<'r> {
    recordings: [&'r Recording; 2],
    /// Frames to add to one of the second to get that of the first.
    shift: i64,
    /// What to add to a position of the second to get that of the first, m, by road.
    places: Vec<Option<[f32; 2]>>,
}

impl<'r> Meeting<'r> {
    pub(super) fn new(first: &'r Recording, second: &'r Recording, shift: i64) -> Self {
        let roads = first.roads().len().min(second.roads().len());
        let mut meeting = Self { recordings: [first, second], shift, places: Vec::new() };
        meeting.places = (0..roads).map(|road| meeting.place(road)).collect();
        meeting
    }

    /// The shift in space that most pairs of tracks of one length keep from their first common frame to their last.
    fn place(&self, road: usize) -> Option<[f32; 2]> {
        let [first, second] = self.recordings;
        let on_road =
            |recording: &'r Recording| recording.tracks().iter().filter(move |track| usize::from(track.road) == road);
        let mut votes: Vec<[f32; 2]> = Vec::new();
        for a in on_road(first) {
            for b in on_road(second).filter(|b| (a.length - b.length).abs() < LENGTH_TOLERANCE) {
                let Some((from, to)) = self.common(a, b).filter(|(from, to)| to - from >= LEAST_FRAMES) else {
                    continue;
                };
                let ([x0, y0], [x1, y1]) = (self.apart(a, b, from), self.apart(a, b, to));
                if (x0 - x1).abs() < LONGITUDINAL_TOLERANCE && (y0 - y1).abs() < LATERAL_TOLERANCE {
                    votes.push([x0, y0]);
                }
            }
        }
        let near =
            |[x, y]: [f32; 2]| votes.iter().filter(|v| (v[0] - x).abs() < PLACE && (v[1] - y).abs() < PLACE).count();
        votes.iter().copied().rev().max_by_key(|vote| near(*vote))
    }

    /// Frames of the first recording in which both tracks are there, less the ends of both, which may be a cut's.
    fn common(&self, a: &Track, b: &Track) -> Option<(u32, u32)> {
        let from = i64::from(a.first_frame).max(i64::from(b.first_frame) + self.shift) + 1;
        let to = i64::from(a.last_frame()).min(i64::from(b.last_frame()) + self.shift) - 1;
        (from <= to).then_some((from as u32, to as u32))
    }

    /// Position of a track of the first less that of one of the second, at a frame of the first that both have, m.
    fn apart(&self, a: &Track, b: &Track, frame: u32) -> [f32; 2] {
        let other = (i64::from(frame) - self.shift) as u32;
        let [ca, cb] = self.recordings.map(Recording::columns);
        let (a, b) = (a.rows.start + (frame - a.first_frame) as usize, b.rows.start + (other - b.first_frame) as usize);
        [ca.x[a] - cb.x[b], ca.y[a] - cb.y[b]]
    }

    /// Whether two tracks are one vehicle: of one length, and at one place in all frames that both have. `None` when they
    /// have too few to tell.
    pub(super) fn one_vehicle(&self, a: &Track, b: &Track) -> Option<bool> {
        let (from, to) = self.common(a, b).filter(|(from, to)| to - from >= LEAST_FRAMES)?;
        if a.road != b.road {
            return Some(false);
        }
        let [x, y] = (*self.places.get(usize::from(a.road))?)?;
        let alike = (a.length - b.length).abs() < LENGTH_TOLERANCE;
        Some(
            alike
                && (from..=to).all(|frame| {
                    let apart = self.apart(a, b, frame);
                    (apart[0] - x).abs() < ONE_BODY && (apart[1] - y).abs() < ONE_BODY
                }),
        )
    }
}
