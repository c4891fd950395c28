//! Which recordings show one event, and when in it a frame is.

use super::{Overlap, SharedBy, by_index};
use crate::recording::Recording;

/// Length of the stretches that a long recording is cut into, s.
const STRETCH_S: f64 = 60.;

/// Number of the event of each track, by recording: see [`Drivers::event`](super::Drivers::event).
pub(super) fn events(recordings: &[Recording], overlaps: &[Overlap]) -> Vec<Vec<usize>> {
    let mut events: Vec<Vec<usize>> = vec![Vec::new(); recordings.len()];
    let mut count = 0;
    for Members { members, short } in connected(recordings, overlaps) {
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
            let whole = short || (to - from) as f64 / rate_hz <= STRETCH_S;
            let number = |frame: u32| if whole { 0 } else { stretch(i64::from(frame) + shift) };
            let of_track: Vec<usize> = recordings[recording].tracks().iter().map(|it| number(it.first_frame)).collect();
            last = of_track.iter().copied().fold(last, usize::max);
            events[recording] = of_track.into_iter().map(|stretch| count + stretch).collect();
        }
        count += last + 1;
    }
    events
}

/// Recordings that belong together, each with the frames to add to get those of the first of them.
struct Members {
    members: Vec<(usize, i64)>,
    /// Whether they are short recordings of about one minute, of which some shift is not known.
    short: bool,
}

/// Recordings connected by motion; short ones by drivers, too: who passes a section once does so in about a minute.
fn connected(recordings: &[Recording], overlaps: &[Overlap]) -> Vec<Members> {
    let is_short = |recording: usize| {
        let tracks = recordings[recording].tracks();
        let from = tracks.iter().map(|track| track.first_frame).min().unwrap_or(0);
        let to = tracks.iter().map(|track| track.last_frame()).max().unwrap_or(0);
        f64::from(to - from) / recordings[recording].meta().rate_hz <= STRETCH_S
    };
    let mut shifts: Vec<(usize, usize, Option<i64>)> = Vec::new();
    for (a, b, overlap) in by_index(recordings, overlaps) {
        match overlap.found {
            SharedBy::Motion { shift } => shifts.extend([(a, b, Some(shift)), (b, a, Some(-shift))]),
            SharedBy::Drivers if is_short(a) && is_short(b) => shifts.extend([(a, b, None), (b, a, None)]),
            SharedBy::Drivers => {}
        }
    }
    // What is known comes first.
    shifts.sort_by_key(|(_, _, shift)| shift.is_none());
    let mut seen = vec![false; recordings.len()];
    let mut all = Vec::new();
    for first in 0..recordings.len() {
        if std::mem::replace(&mut seen[first], true) {
            continue;
        }
        let mut members = vec![(first, 0)];
        let (mut next, mut unknown) = (0, false);
        while let Some((recording, so_far)) = members.get(next).copied() {
            for (_, other, shift) in shifts.iter().filter(|(from, _, _)| *from == recording) {
                if !std::mem::replace(&mut seen[*other], true) {
                    unknown |= shift.is_none();
                    members.push((*other, so_far + shift.unwrap_or(0)));
                }
            }
            next += 1;
        }
        let short = unknown && members.iter().all(|(recording, _)| is_short(*recording));
        all.push(Members { members, short });
    }
    all
}
