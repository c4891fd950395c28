//! The vehicle directly ahead, also one that has no row of its own.
//!
//! A file may name the vehicle ahead of a row without having rows of it: at I-80 most leaders are
//! known so. Such a leader has a place, from the row of its follower, and neither size nor leader.

use std::collections::BTreeMap;
use std::fmt;

use crate::parts::track_at;
use crate::recording::{Columns, NamedLeader, Track, TrackState};
use crate::slot::Slot;
use crate::window::{Neighbour, Observation};

/// Length and width of a leader that has no row of its own, m: those of a car.
pub const NAMED_LEADER_SIZE: [f32; 2] = [4.8, 1.8];

/// The vehicle directly ahead in the lane at the target's last observed frame, seen up to that frame.
#[derive(Clone, Copy)]
pub struct Leader<'a> {
    observation: Observation<'a>,
    who: Who,
}

#[derive(Clone, Copy)]
enum Who {
    /// It has a track.
    Recorded(usize),
    /// The rows of track `follower` name it.
    Named { vehicle: u32, follower: usize },
}

impl<'a> Leader<'a> {
    /// The vehicle ahead of `track`, which is present in the last observed frame.
    fn of(observation: Observation<'a>, track: usize) -> Option<Self> {
        let recording = observation.recording;
        let row = recording.tracks()[track].row_at(observation.frame())?;
        let named = recording.named_leader(row).map(|named| Who::Named { vehicle: named.vehicle, follower: track });
        let who = named.or_else(|| recording.neighbour(row, Slot::Preceding).map(Who::Recorded))?;
        Some(Self { observation, who })
    }

    /// State in observed frame `i` of `0..t_obs`, in the **target's** window frame; `None` where it
    /// is absent. One without rows of its own is absent where its follower's row names another
    /// vehicle or none.
    ///
    /// The velocity in the last observed frame is that of [`Leader::velocity`], or the target's
    /// where that is not known. Without rows of its own it is where its follower's row says, at the
    /// follower's lateral position, and its velocity is the difference of its positions over one
    /// frame: backward, or forward in the first frame it is named in.
    #[must_use]
    pub fn state(&self, i: usize) -> Option<TrackState> {
        let o = &self.observation;
        match self.who {
            Who::Recorded(track) => o.state_of(track, i),
            Who::Named { vehicle, follower } => {
                let frame = o.observed_frame(i)?;
                let [x, y] = self.place(vehicle, follower, frame)?;
                let target = || o.recording.velocity_one_sided(o.track, o.row);
                let [vx, vy] = self.speed(vehicle, follower, frame).or_else(target).unwrap_or_default();
                let [x0, y0] = o.origin();
                Some(TrackState { x: x - x0, y: y - y0, vx, vy })
            }
        }
    }

    /// State at the target's last observed frame, in the target's window frame.
    #[must_use]
    pub fn now(&self) -> TrackState {
        self.state(self.observation.shape.t_obs - 1).unwrap_or_default()
    }

    /// Its own velocity at the target's last observed frame, m/s, from rows up to that frame;
    /// `None` where none tells it.
    #[must_use]
    pub fn velocity(&self) -> Option<[f32; 2]> {
        match self.who {
            Who::Recorded(track) => Neighbour { observation: self.observation, track }.velocity(),
            Who::Named { vehicle, follower } => self.speed(vehicle, follower, self.observation.frame()),
        }
    }

    /// Length and width, m; [`NAMED_LEADER_SIZE`] where it has no row of its own.
    #[must_use]
    pub fn size(&self) -> [f32; 2] {
        self.recorded().map_or(NAMED_LEADER_SIZE, |it| it.size())
    }

    /// Vehicle of the file.
    #[must_use]
    pub fn vehicle(&self) -> u32 {
        match self.who {
            Who::Recorded(track) => self.observation.recording.tracks()[track].vehicle,
            Who::Named { vehicle, .. } => vehicle,
        }
    }

    /// The same vehicle as a neighbour, if it has rows of its own.
    #[must_use]
    pub fn recorded(&self) -> Option<Neighbour<'a>> {
        match self.who {
            Who::Recorded(track) => Some(Neighbour { observation: self.observation, track }),
            Who::Named { .. } => None,
        }
    }

    /// Whom it follows; of one without rows of its own nobody is known.
    #[must_use]
    pub fn leader(&self) -> Option<Self> {
        self.recorded().and_then(|it| it.leader())
    }

    /// Centre in `frame`, m, road frame, where the row of the follower names it.
    fn place(&self, vehicle: u32, follower: usize, frame: u32) -> Option<[f32; 2]> {
        let recording = self.observation.recording;
        let track = &recording.tracks()[follower];
        let row = track.row_at(frame)?;
        let named = recording.named_leader(row).filter(|named| named.vehicle == vehicle)?;
        let behind = recording.state(row);
        Some([behind.x + track.length / 2. + named.headway - NAMED_LEADER_SIZE[0] / 2., behind.y])
    }

    /// Velocity in `frame`, m/s: nothing after the last observed frame enters.
    fn speed(&self, vehicle: u32, follower: usize, frame: u32) -> Option<[f32; 2]> {
        let at = |frame: u32| self.place(vehicle, follower, frame);
        let here = at(frame)?;
        let rate = self.observation.recording.meta().rate_hz as f32;
        let slope = |from: [f32; 2], to: [f32; 2]| [(to[0] - from[0]) * rate, (to[1] - from[1]) * rate];
        let before = frame.checked_sub(1).and_then(at).map(|before| slope(before, here));
        let after = || (frame < self.observation.frame()).then(|| at(frame + 1)).flatten();
        before.or_else(|| after().map(|after| slope(here, after)))
    }
}

impl fmt::Debug for Leader<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = matches!(self.who, Who::Named { .. });
        f.debug_struct("Leader").field("vehicle", &self.vehicle()).field("named", &named).finish_non_exhaustive()
    }
}

impl<'a> Observation<'a> {
    /// The vehicle directly ahead of the target in its lane, also one that only the target's row tells.
    #[must_use]
    pub fn leader(&self) -> Option<Leader<'a>> {
        Leader::of(*self, self.track)
    }

    /// The leader, whom it follows, and so on: nearest first, each vehicle once.
    pub fn column(&self) -> impl Iterator<Item = Leader<'a>> + use<'a> {
        let mut seen = vec![self.track().vehicle];
        // Neighbours named by a file may follow one another in a circle.
        std::iter::successors(self.leader(), Leader::leader).take_while(move |leader| {
            let new = !seen.contains(&leader.vehicle());
            seen.push(leader.vehicle());
            new
        })
    }
}

impl<'a> Neighbour<'a> {
    /// The vehicle directly ahead of it in its lane, in the **target's** window frame.
    #[must_use]
    pub fn leader(&self) -> Option<Leader<'a>> {
        Leader::of(self.observation, self.track)
    }
}

/// A headway may differ by this much from positions, m: on I-80 one in a thousand does, as it was not taken from the
/// positions that were published.
const HEADWAY_TOLERANCE: f32 = 5.;

/// What is doubtful in the leaders that rows name.
#[derive(Debug, Default)]
pub(crate) struct Doubts {
    /// Rows whose leader is not taken from there, by reason.
    pub(crate) not_taken: BTreeMap<String, u64>,
    /// Rows that contradict positions, by how.
    pub(crate) counted: BTreeMap<String, u64>,
}

/// Of the leaders that rows name those that tell what no other row does, and the others by reason.
///
/// Where a leader has a row of its own, its place can be compared with what its follower's row says. If most such rows
/// are wrong, none of the others is believed.
pub(crate) fn checked(
    mut named: Vec<NamedLeader>,
    tracks: &[Track],
    columns: &Columns,
) -> (Option<Vec<NamedLeader>>, Doubts) {
    let compared = compare(&named, tracks, columns);
    let believed = 2 * (compared.elsewhere + compared.headway) <= compared.rows;
    let mut not_taken = BTreeMap::new();
    let mut taken = false;
    for track in tracks {
        for (row, frame) in track.rows.clone().zip(track.first_frame..) {
            let leader = &mut named[row];
            if leader.vehicle == 0 {
                *leader = NamedLeader::default();
                continue;
            }
            let unbelieved = (!believed).then_some("most rows that can be compared contradict positions");
            match doubt(leader, track, frame, row, tracks, columns).or(unbelieved) {
                None => taken = true,
                Some(reason) => {
                    *not_taken.entry(reason.to_owned()).or_insert(0) += 1;
                    *leader = NamedLeader::default();
                }
            }
        }
    }
    let counted = [
        ("rows name a vehicle ahead that is not ahead in their lane", compared.elsewhere),
        ("rows have a headway that is more than 5 m off the positions", compared.headway),
    ];
    let counted = counted.into_iter().filter(|(_, rows)| *rows > 0).map(|(what, rows)| (what.to_owned(), rows));
    (taken.then_some(named), Doubts { not_taken, counted: counted.collect() })
}

/// Rows whose leader has a row of its own, and those of them that contradict it.
#[derive(Default)]
struct Compared {
    rows: u64,
    /// It is behind or in another lane.
    elsewhere: u64,
    /// It is ahead at another distance.
    headway: u64,
}

fn compare(named: &[NamedLeader], tracks: &[Track], columns: &Columns) -> Compared {
    let mut compared = Compared::default();
    for track in tracks {
        // A leader stays the same over many rows: its track is looked up once.
        let mut last = None::<usize>;
        for (row, frame) in track.rows.clone().zip(track.first_frame..) {
            let NamedLeader { vehicle, headway } = named[row];
            if vehicle == 0 || vehicle == track.vehicle {
                continue;
            }
            let known = last.filter(|t| tracks[*t].vehicle == vehicle && tracks[*t].row_at(frame).is_some());
            last = known.or_else(|| track_at(tracks, vehicle, frame));
            let Some((ahead, other)) = last.and_then(|t| Some((&tracks[t], tracks[t].row_at(frame)?))) else {
                continue;
            };
            compared.rows += 1;
            let fronts = columns.x[other] - columns.x[row] + (ahead.length - track.length) / 2.;
            if fronts <= 0. || columns.lane[other] != columns.lane[row] {
                compared.elsewhere += 1;
            } else if headway > 0. && (headway - fronts).abs() > HEADWAY_TOLERANCE {
                compared.headway += 1;
            }
        }
    }
    compared
}

/// Why the vehicle that a row names as its leader is not taken from there.
fn doubt(
    leader: &NamedLeader,
    track: &Track,
    frame: u32,
    row: usize,
    tracks: &[Track],
    columns: &Columns,
) -> Option<&'static str> {
    let ahead = || {
        let other = tracks.get(columns.neighbours[row][Slot::Preceding.index()] as usize)?;
        let centres = columns.x[other.row_at(frame)?] - columns.x[row];
        Some(centres + other.length / 2. - track.length / 2.)
    };
    if leader.vehicle == track.vehicle {
        Some("it is the vehicle itself")
    } else if track_at(tracks, leader.vehicle, frame).is_some() {
        Some("it has a row of its own in the frame")
    } else if !(leader.headway.is_finite() && leader.headway > 0.) {
        Some("its headway is none")
    } else if ahead().is_some_and(|recorded| leader.headway >= recorded) {
        Some("another vehicle is recorded before it in the lane")
    } else {
        None
    }
}
