//! From rows of a table to a recording: order, repeated rows, gap-free tracks, velocities,
//! neighbours.

use rayon::prelude::*;

use crate::error::DataError;
use crate::ingest_report::IngestReport;
use crate::leader;
use crate::lookup::FrameIndex;
use crate::named::{Named, Names, Placed};
use crate::neighbours;
use crate::parts::check_span;
use crate::recording::{Columns, NamedLeader, Recording, RecordingMeta, Road, Track, VehicleClass, VelocitySource};
use crate::slot::SLOTS;

/// Rows of one recording in SI units and the road frame, in any order: what the reader of a format
/// makes, and [`Recording::from_rows`] takes. All columns are of one length.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Rows {
    /// Vehicle of each row.
    pub vehicle: Vec<u32>,
    /// Frame of each row.
    pub frame: Vec<u32>,
    /// Centre of the box, forward, m.
    pub x: Vec<f32>,
    /// Centre of the box, to the left, m.
    pub y: Vec<f32>,
    /// Recorded velocity forward and to the left, m/s; differentiated from positions where there is none.
    pub velocity: Option<[Vec<f32>; 2]>,
    /// Lane number of the file; 0 where unknown.
    pub lane: Vec<i16>,
    /// Who is in the eight slots.
    pub neighbours: NeighbourSource,
    /// The vehicle that each row names as the one directly ahead, where the data does; taken where the rows do not
    /// contradict it and tell less.
    pub leader: Option<Vec<NamedLeader>>,
}

impl Rows {
    /// Positions alone: no lanes, velocities to be derived, neighbours to be found where lanes are
    /// set. The other columns may be set afterwards.
    #[must_use]
    pub fn new(vehicle: Vec<u32>, frame: Vec<u32>, x: Vec<f32>, y: Vec<f32>) -> Self {
        let lane = vec![0; x.len()];
        let neighbours = NeighbourSource::Lanes(|lane| lane);
        Self { vehicle, frame, x, y, velocity: None, lane, neighbours, leader: None }
    }

    fn check(&self) -> Result<(), String> {
        let mut lengths = vec![self.vehicle.len(), self.frame.len(), self.y.len(), self.lane.len()];
        lengths.extend(self.velocity.iter().flatten().map(Vec::len));
        if let NeighbourSource::Named(slots) = &self.neighbours {
            lengths.extend(slots.iter().map(Vec::len));
        }
        lengths.extend(self.leader.iter().map(Vec::len));
        let rows = self.x.len();
        if !lengths.iter().all(|n| *n == rows) || u32::try_from(rows).is_err() {
            return Err(format!(
                "columns have {lengths:?} rows where x has {rows}; all must have the same, below 4 billion"
            ));
        }
        // Before the frames are gone through one by one.
        let (first, last) = (self.frame.iter().min().copied(), self.frame.iter().max().copied());
        check_span(first.unwrap_or(0), last.unwrap_or(0))
    }
}

/// Where the neighbours of a recording's rows come from.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum NeighbourSource {
    /// The data names the vehicle in each slot, in the order of [`Slot::ALL`](crate::Slot::ALL); 0
    /// or -1 for none. One that is not where its slot says is not taken, and counted.
    Named(Box<[Vec<i32>; SLOTS]>),
    /// They are found by [`find_neighbours`](crate::find_neighbours). The function gives a lane
    /// number of the data its place in the order from left to right, 1 leftmost; for most data that
    /// is the number itself.
    Lanes(fn(i16) -> i16),
}

/// What a vehicle is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleBody {
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Extent along the road, m.
    pub length: f32,
    /// Extent across the road, m.
    pub width: f32,
    /// Index of its carriageway.
    pub road: u16,
}

/// Rows that were left out.
struct Dropped {
    duplicates: u64,
    conflicts: u64,
    /// Names of neighbours that were not taken; without slots.
    named: Named,
    leaders: leader::Doubts,
}

impl Recording {
    /// A recording of `rows`, and a report with everything but what only the reader of the file
    /// knows. `body` is asked for a row of `rows`; that of a track's first row counts.
    ///
    /// Rows are sorted by vehicle and frame. Of several rows of a vehicle and frame the first is
    /// kept; a gap parts a vehicle's track in two. `meta.velocities` is set by whether the rows have
    /// velocities.
    ///
    /// # Errors
    /// As [`Recording::from_parts`]; when columns differ in length.
    pub fn from_rows(
        meta: RecordingMeta,
        roads: Vec<Road>,
        rows: Rows,
        body: impl Fn(usize) -> VehicleBody,
    ) -> Result<(Self, IngestReport), DataError> {
        Self::with_names(meta, roads, rows, body).map(|(recording, report, _)| (recording, report))
    }

    /// As [`Recording::from_rows`], and what became of the neighbours that the data names, by slot.
    pub(crate) fn with_names(
        meta: RecordingMeta,
        roads: Vec<Road>,
        rows: Rows,
        body: impl Fn(usize) -> VehicleBody,
    ) -> Result<(Self, IngestReport, [Names; SLOTS]), DataError> {
        let rows_read = rows.x.len() as u64;
        let (recording, Dropped { duplicates, conflicts, named, leaders }) = assemble(meta, roads, rows, body)?;
        let mut report = IngestReport::of(&recording);
        report.rows_read = rows_read;
        (report.duplicates, report.conflicts) = (duplicates, conflicts);
        report.unknown_neighbours = named.absent;
        let not_taken = named.not_taken.into_iter();
        report.contradictions =
            not_taken.map(|(who, n)| (format!("neighbours named are {who}: not taken"), n)).collect();
        report.contradictions.extend(leaders.counted);
        report.leaders_not_taken = leaders.not_taken;
        Ok((recording, report, named.by_slot))
    }

    /// As [`Recording::from_rows`], without a report.
    pub(crate) fn without_report(
        meta: RecordingMeta,
        roads: Vec<Road>,
        rows: Rows,
        body: impl Fn(usize) -> VehicleBody,
    ) -> Result<Self, DataError> {
        assemble(meta, roads, rows, body).map(|(recording, _)| recording)
    }
}

fn assemble(
    meta: RecordingMeta,
    roads: Vec<Road>,
    rows: Rows,
    body: impl Fn(usize) -> VehicleBody,
) -> Result<(Recording, Dropped), DataError> {
    rows.check().map_err(|reason| DataError::Parts { recording: meta.name.clone(), reason })?;
    let Kept { order, duplicates, conflicts } = keep(&rows, &body);
    let pick = |row: usize| order.as_ref().map_or(row, |order| order[row] as usize);
    let count = order.as_ref().map_or(rows.x.len(), Vec::len);
    let tracks = tracks(&rows, count, pick, body);

    let Rows { x, y, velocity, lane, leader, neighbours: source, .. } = rows;
    let x = reorder(x, order.as_deref());
    let y = reorder(y, order.as_deref());
    let lane = reorder(lane, order.as_deref());
    let velocities = if velocity.is_some() { VelocitySource::Recorded } else { VelocitySource::Derived };
    let [vx, vy] = match velocity {
        Some(recorded) => recorded.map(|v| reorder(v, order.as_deref())),
        None => [&x, &y].map(|position| derivative(position, &tracks, meta.rate_hz)),
    };
    let (mut named, lane_order) = match source {
        NeighbourSource::Named(ids) => (Placed { tracks: &tracks, x: &x, y: &y, lane: &lane }.named(&ids, pick), None),
        NeighbourSource::Lanes(from_left) => {
            let spans: Vec<(u32, u32)> = tracks.iter().map(|track| (track.first_frame, track.last_frame())).collect();
            let slots = neighbours::from_lanes(&tracks, &FrameIndex::new(&spans), &x, &lane, from_left);
            let order = lane.iter().map(|lane| (*lane, from_left(*lane))).collect();
            (Named { slots, ..Named::default() }, Some(order))
        }
    };
    let neighbours = std::mem::take(&mut named.slots);
    let mut columns = Columns { x, y, vx, vy, lane, neighbours, named_leader: None };
    let mut leaders = leader::Doubts::default();
    if let Some(named) = leader {
        (columns.named_leader, leaders) = leader::checked(reorder(named, order.as_deref()), &tracks, &columns);
    }
    let recording = Recording::from_parts(meta.with_velocities(velocities), roads, tracks, columns)?;
    Ok((Recording { lane_order, ..recording }, Dropped { duplicates, conflicts, named, leaders }))
}

/// Rows that are kept, by vehicle and frame.
struct Kept {
    /// Places of the rows; `None` when the file has them all, in order.
    order: Option<Vec<u32>>,
    duplicates: u64,
    conflicts: u64,
}

fn keep(rows: &Rows, body: &impl Fn(usize) -> VehicleBody) -> Kept {
    let key = |row: usize| (rows.vehicle[row], rows.frame[row]);
    if (1..rows.x.len()).all(|row| key(row - 1) < key(row)) {
        return Kept { order: None, duplicates: 0, conflicts: 0 };
    }
    let mut order: Vec<u32> = (0..rows.x.len() as u32).collect();
    // The place in the file decides between equals: the first row of a frame is kept.
    order.par_sort_unstable_by_key(|row| (key(*row as usize), *row));
    let ids = match &rows.neighbours {
        NeighbourSource::Named(ids) => &ids[..],
        NeighbourSource::Lanes(_) => &[],
    };
    let same = |a: usize, b: usize| {
        (rows.x[a], rows.y[a], rows.lane[a]) == (rows.x[b], rows.y[b], rows.lane[b])
            && rows.velocity.iter().flatten().all(|v| v[a] == v[b])
            && rows.leader.iter().all(|v| v[a] == v[b])
            && ids.iter().all(|v| v[a] == v[b])
            && body(a) == body(b)
    };
    let (mut duplicates, mut conflicts) = (0, 0);
    order.dedup_by(|next, kept| {
        let (next, kept) = (*next as usize, *kept as usize);
        let repeated = key(next) == key(kept);
        if repeated && same(next, kept) {
            duplicates += 1;
        } else if repeated {
            conflicts += 1;
        }
        repeated
    });
    Kept { order: Some(order), duplicates, conflicts }
}

/// Gap-free tracks of the kept rows.
fn tracks(rows: &Rows, count: usize, pick: impl Fn(usize) -> usize, body: impl Fn(usize) -> VehicleBody) -> Vec<Track> {
    let mut tracks: Vec<Track> = Vec::new();
    let mut before: Option<(u32, u32)> = None;
    for i in 0..count {
        let row = pick(i);
        let (vehicle, frame) = (rows.vehicle[row], rows.frame[row]);
        match (before, tracks.last_mut()) {
            (Some((same, last)), Some(track)) if same == vehicle && frame - last == 1 => track.rows.end = i + 1,
            (_, last) => {
                let segment =
                    last.filter(|last| last.vehicle == vehicle).map_or(0, |last| last.segment.saturating_add(1));
                let VehicleBody { class, length, width, road } = body(row);
                let rows = i..i + 1;
                tracks.push(Track { vehicle, segment, road, class, length, width, first_frame: frame, rows });
            }
        }
        before = Some((vehicle, frame));
    }
    tracks
}

fn reorder<T: Copy + Send + Sync>(column: Vec<T>, order: Option<&[u32]>) -> Vec<T> {
    let Some(order) = order else { return column };
    order.par_iter().map(|row| column[*row as usize]).collect()
}

/// Derivative in time of a position within each track: central inside, one-sided at the ends, 0 for
/// a track of one row.
fn derivative(position: &[f32], tracks: &[Track], rate_hz: f64) -> Vec<f32> {
    let mut slope = Vec::with_capacity(position.len());
    for track in tracks {
        let p = &position[track.rows.clone()];
        slope.extend((0..p.len()).map(|i| slope_at(|i| p[i], i, p.len(), rate_hz)));
    }
    slope
}

/// Derivative in time at the `i`-th of `n` positions.
pub(crate) fn slope_at(position: impl Fn(usize) -> f32, i: usize, n: usize, rate_hz: f64) -> f32 {
    let (from, to) = (i.saturating_sub(1), (n - 1).min(i + 1));
    let steps = (to - from).max(1) as f64;
    (f64::from(position(to) - position(from)) * rate_hz / steps) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use crate::slot::Slot;

    fn meta() -> RecordingMeta {
        RecordingMeta::new(Dataset::NGSIM, "s", "n", 10.)
    }

    fn road() -> Road {
        Road { driving_direction: 2, lines: Vec::new(), fitted: true, axis: None }
    }

    /// Rows given as (vehicle, frame, x).
    fn rows(given: &[(u32, u32, f32)]) -> Rows {
        let (vehicle, rest): (Vec<u32>, Vec<(u32, f32)>) = given.iter().map(|row| (row.0, (row.1, row.2))).unzip();
        let (frame, x): (Vec<u32>, Vec<f32>) = rest.into_iter().unzip();
        let y = vec![0.; given.len()];
        let lane = vec![1; given.len()];
        Rows { lane, ..Rows::new(vehicle, frame, x, y) }
    }

    fn car(_: usize) -> VehicleBody {
        VehicleBody { class: VehicleClass::Car, length: 4., width: 2., road: 0 }
    }

    #[test]
    fn repeated_rows_go_and_gaps_part_tracks() {
        let given = [
            (7, 3, 30.),
            (7, 1, 10.),
            (7, 1, 10.), // the same again
            (7, 2, 21.),
            (7, 2, 99.), // contradicts the row before
            (5, 9, 0.),
            (7, 6, 60.), // after a gap
            (7, 7, 75.),
        ];
        let (recording, quality) = Recording::from_rows(meta(), vec![road()], rows(&given), car).unwrap();
        let tracks: Vec<_> =
            recording.tracks().iter().map(|t| (t.vehicle, t.segment, t.first_frame, t.rows.clone())).collect();
        assert_eq!(tracks, [(5, 0, 9, 0..1), (7, 0, 1, 1..4), (7, 1, 6, 4..6)]);
        assert_eq!(recording.columns().x, [0., 10., 21., 30., 60., 75.]);
        // One-sided, central, one-sided; no difference across the gap.
        assert_eq!(recording.columns().vx, [0., 110., 100., 90., 150., 150.]);
        assert_eq!((quality.duplicates, quality.conflicts, quality.gaps), (1, 1, 1));
        assert_eq!((quality.rows_read, quality.rows, quality.vehicles, quality.tracks), (8, 6, 2, 3));
    }

    #[test]
    fn a_named_neighbour_is_the_track_present_in_the_frame() {
        let given = [(3, 1, 0.), (3, 2, 1.), (3, 5, 4.), (8, 1, 50.), (8, 2, 51.), (8, 5, 54.), (8, 6, 55.)];
        let mut rows = rows(&given);
        let mut ids: [Vec<i32>; SLOTS] = std::array::from_fn(|_| vec![0; given.len()]);
        ids[1] = vec![0, 0, 0, 3, 3, 3, 3]; // in frame 6 vehicle 3 is gone
        ids[0] = vec![-1, 8, 8, 0, 0, 0, 0];
        rows.neighbours = NeighbourSource::Named(Box::new(ids));
        let (recording, quality) = Recording::from_rows(meta(), vec![road()], rows, car).unwrap();
        let at = |slot: Slot| (0..7).map(|row| recording.neighbour(row, slot)).collect::<Vec<_>>();
        assert_eq!(at(Slot::Following), [None, None, None, Some(0), Some(0), Some(1), None]);
        assert_eq!(at(Slot::Preceding), [None, Some(2), Some(3), None, None, None, None]);
        assert_eq!(quality.unknown_neighbours, 1);
    }

    #[test]
    fn columns_of_different_lengths_are_refused() {
        let mut short = rows(&[(1, 0, 0.), (1, 1, 1.)]);
        short.lane.pop();
        let error = Recording::from_rows(meta(), vec![road()], short, car).unwrap_err().to_string();
        assert!(error.contains("rows"), "{error}");
    }

    #[test]
    fn velocities_are_recorded_where_rows_have_them() {
        let given = rows(&[(1, 0, 0.), (1, 1, 1.)]);
        let source = |rows| {
            let (recording, _) = Recording::from_rows(meta(), vec![road()], rows, car).unwrap();
            (recording.meta().velocities, recording.velocity_one_sided(0, 0))
        };
        assert_eq!(source(given.clone()), (VelocitySource::Derived, None));
        let measured = Rows { velocity: Some([vec![3.; 2], vec![4.; 2]]), ..given };
        assert_eq!(source(measured), (VelocitySource::Recorded, Some([3., 4.])));
    }
}
