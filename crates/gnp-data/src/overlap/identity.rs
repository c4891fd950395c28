//! Who is one driver across recordings.

use std::collections::BTreeMap;

use super::drivers::{Sizes, alike, sizes};
use super::event::events;
use super::meeting::Meeting;
use super::numbering::numberings;
use super::{Overlap, SharedBy, by_index};
use crate::recording::Recording;

/// Which tracks of different recordings are one driver, and which recordings show one event.
///
/// The tracks of one vehicle of a recording are one driver; so are vehicles of the same number, length and width, in recordings
/// of one site whose numbers mean the same vehicles; and vehicles at one place at one time, where recordings show the same
/// minutes. Numbers mean the same where nearly all that two recordings share stand for one size, more often than by
/// chance, and that spreads: from A and B, and B and C, to A and C. Two recordings that share one or two vehicles count as
/// well when so many equal sizes have a probability of 5 % or less among all vehicles of both, so that a driver may be taken
/// for another, seldom the other way round.
///
/// Vehicles of one number and size that are at different places at one time are two drivers, unless a third recording
/// joins them. That can be said only of
/// recordings found to show the same minutes by motion: the times of recordings as they are given may start anywhere.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Drivers {
    /// Driver of each track, by recording.
    drivers: Vec<Vec<usize>>,
    /// Event of each track, by recording.
    events: Vec<Vec<usize>>,
}

impl Drivers {
    /// From recordings and what [`overlaps`](crate::overlaps) found in them.
    #[must_use]
    pub fn of(recordings: &[Recording], overlaps: &[Overlap]) -> Self {
        let sizes: Vec<Sizes> = recordings.iter().map(sizes).collect();
        let meetings = meetings(recordings, overlaps);
        let mut same = Same::new(&sizes);
        let numbering = numberings(recordings, &sizes, overlaps);
        let mut by_number: BTreeMap<(usize, u32), Vec<usize>> = BTreeMap::new();
        for (recording, sizes) in sizes.iter().enumerate() {
            for vehicle in sizes.keys() {
                by_number.entry((numbering[recording], *vehicle)).or_default().push(recording);
            }
        }
        for ((_, vehicle), within) in by_number {
            for (i, a) in within.iter().enumerate() {
                for b in &within[i + 1..] {
                    let apart =
                        meetings.get(&(*a, *b)).is_some_and(|meeting| are_apart(meeting, recordings, *a, *b, vehicle));
                    if alike(&sizes[*a][&vehicle], &sizes[*b][&vehicle]) && !apart {
                        same.join((*a, vehicle), (*b, vehicle));
                    }
                }
            }
        }
        for ((a, b), meeting) in &meetings {
            for one in recordings[*a].tracks() {
                for other in
                    recordings[*b].tracks().iter().filter(|other| meeting.one_vehicle(one, other) == Some(true))
                {
                    same.join((*a, one.vehicle), (*b, other.vehicle));
                }
            }
        }
        Self { drivers: same.numbers(recordings), events: events(recordings, overlaps) }
    }

    /// Number of the driver of a track (indices into the recordings and their tracks); equal numbers are one driver.
    /// `None` where there is no such track.
    #[must_use]
    pub fn driver(&self, recording: usize, track: usize) -> Option<usize> {
        self.drivers.get(recording)?.get(track).copied()
    }

    /// Number of the event that a track belongs to; equal numbers are one event. Recordings that show the same minutes
    /// (connected by overlaps found by motion, or, where none is longer than 60 s, by drivers) are one event; what is longer than 60 s is cut into stretches of 60 s, and
    /// a track belongs to that of its first frame. `None` where there is no such track.
    #[must_use]
    pub fn event(&self, recording: usize, track: usize) -> Option<usize> {
        self.events.get(recording)?.get(track).copied()
    }
}

/// Recordings that show the same minutes, the smaller index first.
fn meetings<'r>(recordings: &'r [Recording], overlaps: &[Overlap]) -> BTreeMap<(usize, usize), Meeting<'r>> {
    let mut meetings = BTreeMap::new();
    for (a, b, overlap) in by_index(recordings, overlaps) {
        if let SharedBy::Motion { shift } = overlap.found {
            let ((a, b), shift) = if a < b { ((a, b), shift) } else { ((b, a), -shift) };
            meetings.insert((a, b), Meeting::new(&recordings[a], &recordings[b], shift));
        }
    }
    meetings
}

/// Whether tracks of a number are in both recordings at one time, at different places.
fn are_apart(meeting: &Meeting<'_>, recordings: &[Recording], a: usize, b: usize, vehicle: u32) -> bool {
    let of = |recording: usize| recordings[recording].tracks().iter().filter(move |track| track.vehicle == vehicle);
    of(a).any(|one| of(b).any(|other| meeting.one_vehicle(one, other) == Some(false)))
}

/// Vehicles of recordings, joined to drivers.
struct Same {
    /// Place of a vehicle in `first`, by recording.
    places: Vec<BTreeMap<u32, usize>>,
    /// A vehicle joined earlier, or the vehicle itself.
    first: Vec<usize>,
}

impl Same {
    fn new(sizes: &[Sizes]) -> Self {
        let mut count = 0..;
        let places = sizes.iter().map(|of| of.keys().copied().zip(&mut count).collect()).collect();
        let total = sizes.iter().map(BTreeMap::len).sum();
        Self { places, first: (0..total).collect() }
    }

    fn root(&self, mut place: usize) -> usize {
        while self.first[place] != place {
            place = self.first[place];
        }
        place
    }

    fn join(&mut self, a: (usize, u32), b: (usize, u32)) {
        let (a, b) = (self.root(self.places[a.0][&a.1]), self.root(self.places[b.0][&b.1]));
        self.first[a.max(b)] = a.min(b);
    }

    /// Number of the driver of each track, by recording.
    fn numbers(&self, recordings: &[Recording]) -> Vec<Vec<usize>> {
        let of = |(recording, places): (&Recording, &BTreeMap<u32, usize>)| {
            recording.tracks().iter().map(|track| self.root(places[&track.vehicle])).collect()
        };
        recordings.iter().zip(&self.places).map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overlap::overlaps;
    use crate::overlap::tests::cut;

    /// The same recording with other vehicle numbers.
    fn renumbered(mut recording: Recording, number: impl Fn(u32) -> u32) -> Recording {
        for track in &mut recording.tracks {
            track.vehicle = number(track.vehicle);
        }
        recording
    }

    fn drivers(recordings: &[Recording]) -> Drivers {
        Drivers::of(recordings, &overlaps(recordings))
    }

    #[test]
    fn vehicles_at_one_place_at_one_time_are_one_driver_whatever_their_numbers() {
        // Vehicle 2 is third in a and first in c; 8 is not in a.
        let recordings = [cut("a", 0..6, 100, 0.), cut("c", 2..8, 115, 0.02)];
        let drivers = drivers(&recordings);
        for track in 2..6 {
            assert_eq!(drivers.driver(0, track), drivers.driver(1, track - 2));
        }
        let all =
            [0, 1].map(|recording| (0..6).filter_map(|track| drivers.driver(recording, track)).collect::<Vec<_>>());
        assert!(all[1][4..].iter().all(|driver| !all[0].contains(driver)), "{all:?}");
        assert_eq!(drivers.event(0, 0), drivers.event(1, 5));
    }

    #[test]
    fn numbers_spread_over_connected_recordings_and_one_driver_is_enough() {
        // Other times, numbers that mean the same: a and b share four, b and c one, a and c none.
        let recordings = [("a", 0..8, 0), ("b", 4..13, 1000), ("c", 12..20, 2000)].map(|(name, vehicles, from)| {
            let start = vehicles.start;
            renumbered(cut(name, vehicles, from, 0.), |number| number + start)
        });
        let drivers = drivers(&recordings);
        for (a, b) in [((0, 4), (1, 0)), ((0, 7), (1, 3)), ((1, 8), (2, 0))] {
            assert_eq!(drivers.driver(a.0, a.1), drivers.driver(b.0, b.1), "{a:?}, {b:?}");
        }
        let distinct = (0..3).flat_map(|r| (0..9).map(move |t| (r, t))).filter_map(|(r, t)| drivers.driver(r, t));
        assert_eq!(std::collections::BTreeSet::from_iter(distinct).len(), 20);
        let events = [0, 1, 2].map(|recording| drivers.event(recording, 0));
        // Short recordings with drivers in common are of about one minute; one driver alone shows no such thing.
        assert!(events[0] == events[1] && events[1] != events[2]);
    }

    #[test]
    fn numbers_given_anew_are_other_drivers() {
        // Numbered from 1 each; sizes differ.
        let drivers = drivers(&[cut("a", 0..8, 0, 0.), cut("b", 4..13, 1000, 0.)]);
        assert!((0..8).all(|a| (0..9).all(|b| drivers.driver(0, a) != drivers.driver(1, b))));
        // One size for all: equal numbers show nothing.
        let mut alike = [cut("a", 0..8, 0, 0.), cut("b", 0..8, 1000, 0.)];
        alike.iter_mut().flat_map(|recording| &mut recording.tracks).for_each(|track| track.length = 4.5);
        assert_ne!(Drivers::of(&alike, &[]).driver(0, 0), Drivers::of(&alike, &[]).driver(1, 0));
    }

    #[test]
    fn a_number_at_two_places_at_one_time_is_two_drivers() {
        let mut recordings = [cut("a", 0..6, 100, 0.), cut("b", 0..6, 115, 0.)];
        let track = recordings[1].tracks[5].rows.clone();
        recordings[1].columns.x[track].iter_mut().for_each(|x| *x += 30.);
        let drivers = drivers(&recordings);
        assert!((0..5).all(|track| drivers.driver(0, track) == drivers.driver(1, track)));
        assert_ne!(drivers.driver(0, 5), drivers.driver(1, 5));
    }
}
