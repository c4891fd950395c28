//! Small recordings made from parts.

#![allow(dead_code)] // each test file takes what it needs
#![allow(clippy::unwrap_used)] // only tests call these

use gnp_data::{
    Columns, Dataset, LaneMarking, NamedLeader, Recording, RecordingMeta, Road, SLOTS, Track, WindowConfig,
};

/// No vehicle in a neighbour slot.
pub(crate) const NO_TRACK: u32 = u32::MAX;

/// 0.3 s observed (4 frames at 10 Hz), 0.5 s predicted (5 frames), a window every 0.2 s (2 frames).
pub(crate) fn short_windows() -> WindowConfig {
    WindowConfig { observed_s: 0.3, predicted_s: 0.5, rate_hz: 10., stride_s: 0.2, site_stride_s: Default::default() }
}

/// A track: vehicle, segment, first frame, rows.
pub(crate) type Snippet = (u32, u16, u32, usize);

/// Vehicles that keep their speed of `vehicle` m/s in a lane of their own, with no vehicle beside them.
pub(crate) fn recording(name: &str, site: &str, rate_hz: f64, snippets: &[Snippet]) -> Recording {
    let position = |(vehicle, _, first, _): Snippet, i: usize| {
        let time = f64::from(first + i as u32) / rate_hz;
        [(f64::from(vehicle) * time) as f32, vehicle as f32 * 4.]
    };
    from_positions(Dataset::NGSIM, name, site, rate_hz, snippets, &position, &|_, _| [NO_TRACK; SLOTS])
}

/// A recording from positions (of the `i`-th row of a track) and neighbours (of a track at a frame),
/// with velocities differentiated as a reader does: centrally, one-sided at the ends of a track.
pub(crate) fn from_positions(
    dataset: Dataset,
    name: &str,
    site: &str,
    rate_hz: f64,
    snippets: &[Snippet],
    position: &dyn Fn(Snippet, usize) -> [f32; 2],
    neighbours: &dyn Fn(usize, u32) -> [u32; SLOTS],
) -> Recording {
    let mut columns = Columns::default();
    let mut tracks = Vec::new();
    for (index, snippet) in snippets.iter().enumerate() {
        let (vehicle, segment, first_frame, rows) = *snippet;
        let start = columns.x.len();
        let path: Vec<[f32; 2]> = (0..rows).map(|i| position(*snippet, i)).collect();
        for i in 0..rows {
            let (from, to) = (i.saturating_sub(1), (i + 1).min(rows - 1));
            let period = ((to - from).max(1) as f64 / rate_hz) as f32;
            columns.x.push(path[i][0]);
            columns.y.push(path[i][1]);
            columns.vx.push((path[to][0] - path[from][0]) / period);
            columns.vy.push((path[to][1] - path[from][1]) / period);
            columns.lane.push(1 + (vehicle % 3) as i16);
            columns.neighbours.push(neighbours(index, first_frame + i as u32));
        }
        let mut track = Track::new(vehicle, [4. + vehicle as f32 / 16., 1.75], first_frame, start..start + rows);
        track.segment = segment;
        tracks.push(track);
    }
    let lines = [(-2., true), (1.75, false), (5.5, true)].map(|(y, boundary)| LaneMarking::new(y, boundary)).to_vec();
    let meta = RecordingMeta::new(dataset, site, name, rate_hz);
    Recording::from_parts(meta, vec![Road { driving_direction: 2, lines, fitted: true }], tracks, columns).unwrap()
}

/// The same recording, in which a vehicle in a frame also names a leader without rows: (vehicle, headway in m).
pub(crate) fn named(recording: Recording, leader: impl Fn(u32, u32) -> Option<(u32, f32)>) -> Recording {
    let (roads, tracks) = (recording.roads().to_vec(), recording.tracks().to_vec());
    let rows =
        tracks.iter().flat_map(|track| track.rows.clone().zip(track.first_frame..).map(|(_, f)| (track.vehicle, f)));
    let leaders = rows.map(|(vehicle, frame)| {
        leader(vehicle, frame).map_or_else(NamedLeader::default, |(vehicle, headway)| NamedLeader { vehicle, headway })
    });
    let columns = Columns { named_leader: Some(leaders.collect()), ..recording.columns().clone() };
    Recording::from_parts(recording.meta().clone(), roads, tracks, columns).unwrap()
}
