//! Small recordings made from parts.

#![allow(dead_code)] // each test file takes what it needs
#![allow(clippy::unwrap_used)] // only tests call these

use gnp_data::{
    Columns, Dataset, LaneMarking, NamedLeader, Neighbour, Observation, Recording, RecordingMeta, Road, SLOTS, Track,
    TrackState, WindowConfig,
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
    Recording::from_parts(meta, vec![Road { driving_direction: 2, lines, fitted: true, axis: None }], tracks, columns)
        .unwrap()
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

/// Every number that can be reached, to the bit. `depth` follows neighbours to their own neighbours.
pub(crate) fn reachable(observation: Observation<'_>, depth: usize) -> Vec<u32> {
    let mut bits = Vec::new();
    let t_obs = observation.shape().t_obs;
    let mut floats = |values: &[f32]| bits.extend(values.iter().map(|value| value.to_bits()));
    let state = |state: TrackState| [state.x, state.y, state.vx, state.vy];
    for i in 0..=t_obs {
        floats(&state(observation.target(i)));
    }
    floats(&observation.origin());
    floats(&observation.size());
    for line in observation.lines() {
        floats(&[line.y]);
    }
    let key = observation.key();
    bits.extend([key.vehicle, u32::from(key.segment), key.t0, observation.frame(), observation.lane() as u32]);
    let seen = |neighbour: Neighbour<'_>| {
        let mut bits = vec![neighbour.vehicle()];
        let values = neighbour.size().into_iter().chain(state(neighbour.now()));
        bits.extend(values.map(f32::to_bits));
        for i in 0..=t_obs {
            let state = neighbour.state(i).map(|s| state(s).map(f32::to_bits));
            bits.extend(state.unwrap_or([u32::MAX; 4]));
        }
        match neighbour.observation() {
            Some(own) if depth > 0 => bits.extend(reachable(own, depth - 1)),
            own => bits.push(u32::from(own.is_some())),
        }
        bits
    };
    for neighbour in observation.neighbours().0 {
        bits.extend(neighbour.map_or_else(|| vec![u32::MAX], &seen));
    }
    bits.extend(observation.others().flat_map(seen));
    for leader in observation.column().chain(observation.others().filter_map(|other| other.leader())) {
        bits.extend([leader.vehicle(), leader.leader().map_or(0, |next| next.vehicle())]);
        bits.extend(leader.size().map(f32::to_bits));
        for i in 0..=t_obs {
            bits.extend(leader.state(i).map_or([u32::MAX; 4], |s| state(s).map(f32::to_bits)));
        }
    }
    bits
}
