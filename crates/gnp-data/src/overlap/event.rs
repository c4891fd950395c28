//! Which recordings show one event, and when in it a frame is.

use super::{Overlap, SharedBy, by_index};
use crate::recording::Recording;

/// Length of the stretches that a long recording is cut into, s.
const STRETCH_S: f64 = 60.;

/// Number of the event of each track, by recording: see [`Drivers::event`](super::Drivers::event).
pub(super) fn events(recordings: &[Recording], overlaps: &[Overlap]) -> Vec<Vec<usize>> {
    let mut events: Vec<Vec<usize>> = vec![Vec::new(); recordings.len()];
    let mut count = 0;
    for members in connected(recordings, overlaps) {
        let starts = members.iter().flat_map(|(recording, shift)| {
            recordings[*recording].tracks().iter().map(move |track| i64::from(track.first_frame) + shift)
        });
        let ends = members.iter().flat_map(|(recording, shift)| {
            recordings[*recording].tracks().iter().map(move |track| i64::from(track.last_frame()) + shift)
        });
        let (from, to) = (starts.min().unwrap_or(0), ends.max().unwrap_or(0));
        let mut last = 0;
        for (recording, shift) in members {
            let rate_hz = recordings[recording].meta().rate_hz;
            let stretch = |frame: i64| ((frame - from) as f64 / rate_hz / STRETCH_S) as usize;
            let whole = (to - from) as f64 / rate_hz <= STRETCH_S;
            let number = |frame: u32| if whole { 0 } else { stretch(i64::from(frame) + shift) };
            let of_track: Vec<usize> = recordings[recording].tracks().iter().map(|it| number(it.first_frame)).collect();
            last = of_track.iter().copied().fold(last, usize::max);
            events[recording] = of_track.into_iter().map(|stretch| count + stretch).collect();
        }
        count += last + 1;
    }
    events
}

/// Recordings connected by motion, each with the frames to add to get those of the first of them.
fn connected(recordings: &[Recording], overlaps: &[Overlap]) -> Vec<Vec<(usize, i64)>> {
    let mut shifts: Vec<(usize, usize, i64)> = Vec::new();
    for (a, b, overlap) in by_index(recordings, overlaps) {
        if let SharedBy::Motion { shift } = overlap.found {
            shifts.extend([(a, b, shift), (b, a, -shift)]);
        }
    }
    let mut seen = vec![false; recordings.len()];
    let mut all = Vec::new();
    for first in 0..recordings.len() {
        if std::mem::replace(&mut seen[first], true) {
            continue;
        }
        let mut members = vec![(first, 0)];
        let mut next = 0;
        while let Some((recording, so_far)) = members.get(next).copied() {
            for (_, other, shift) in shifts.iter().filter(|(from, _, _)| *from == recording) {
                if !std::mem::replace(&mut seen[*other], true) {
                    members.push((*other, so_far + shift));
                }
            }
            next += 1;
        }
        all.push(members);
    }
    all
}
