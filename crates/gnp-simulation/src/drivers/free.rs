//! Speeds of those whom nobody holds up.
use super::{median, stretches::ahead};
use gnp_data::{Recording, Track, VehicleClass};

/// Slower than this nobody drives freely: the whole road is held up, m/s.
const SLOWEST: f64 = 18.;
/// Time gap from which a driver counts as free, s.
const FREE_S: f64 = 3.;
/// Acceleration above which he is still on his way to the speed that he wants, m/s², over [`STEADY_S`].
const STEADY: f64 = 0.2;
/// Time over which a speed is steady, s.
const STEADY_S: f64 = 2.;
/// Least time that a driver is seen so, s.
const LEAST_S: f64 = 3.;

/// Speed of one who drives freely.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FreeSpeed {
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Median of his speed while free, m/s.
    pub speed: f64,
}

/// The speeds of the vehicles of a recording that drive steadily, at 18 m/s or more, for 3 s or more with
/// nobody within 3 s ahead.
///
/// Without a leader somebody is free as far as the recorded section reaches 3 s ahead. Where rows name leaders that have
/// none of their own the recording does not hold everybody, and a row without a leader says nothing.
pub(super) fn free_speeds(recording: &Recording) -> Vec<FreeSpeed> {
    let columns = recording.columns();
    let mut ends = vec![f64::NEG_INFINITY; recording.roads().len()];
    for track in recording.tracks() {
        let end = &mut ends[usize::from(track.road)];
        *end = track.rows.clone().map(|row| f64::from(columns.x[row])).fold(*end, f64::max);
    }
    let rate = recording.meta().rate_hz;
    let reach = (STEADY_S / 2. * rate).round() as usize;
    let is_free = |track: &Track, row: usize| {
        let (x, v) = (f64::from(columns.x[row]), f64::from(columns.vx[row]));
        let room = match ahead(recording, track, row) {
            Some((_, place)) => place - x,
            None if columns.named_leader.is_some() => 0.,
            None => ends[usize::from(track.road)] - x,
        };
        if v < SLOWEST || room < FREE_S * v || row < track.rows.start + reach || row + reach >= track.rows.end {
            return false;
        }
        f64::from(columns.vx[row + reach] - columns.vx[row - reach]).abs() <= STEADY * STEADY_S
    };
    let of_track = |track: &Track| {
        let rows = track.rows.clone().filter(|row| is_free(track, *row));
        let speeds: Vec<f64> = rows.map(|row| f64::from(columns.vx[row])).collect();
        (speeds.len() as f64 >= LEAST_S * rate).then(|| FreeSpeed { class: track.class, speed: median(speeds) })
    };
    recording.tracks().iter().filter_map(of_track).collect()
}
