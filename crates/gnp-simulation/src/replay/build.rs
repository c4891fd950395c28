//! Scenes from recordings.
use super::{Actor, Path, Replay, ReplaySettings, Scene, Trace};
use crate::error::SimulationError;
use gnp_data::{LaneMarking, NAMED_LEADER_SIZE, Recording, Track, VehicleClass, VelocitySource, fit_lanes};
use gnp_force::State;
use std::collections::{BTreeMap, BTreeSet};

/// Velocities that the data does not have are differences of positions this far apart, in s.
const VELOCITY_SPAN_S: f64 = 0.5;
/// A named leader that is known for a shorter time is left out, in s.
const SHORTEST_LEADER_S: f64 = 0.5;
/// Who ends nearer than this to the end of the section has left by it, in m.
const NEAR_THE_END_M: f64 = 40.0;

/// See [`Replay::all`].
pub(super) fn all(recording: &Recording, settings: &ReplaySettings) -> Result<Vec<Replay>, SimulationError> {
    let rate = recording.meta().rate_hz;
    let frames = |seconds: f64| (seconds * rate).round().max(1.0) as u32;
    let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
    let last = recording.tracks().iter().map(Track::last_frame).max().unwrap_or(0);
    let mut replays = Vec::new();
    for road in 0..recording.roads().len() {
        let mut start = first + frames(settings.past_s);
        while start < last {
            match replay(recording, road, start, settings) {
                Ok(replay) => replays.push(replay),
                Err(SimulationError::NobodyToDrive { .. }) => {}
                Err(error) => return Err(error),
            }
            start += frames(settings.every_s);
        }
    }
    Ok(replays)
}

/// See [`Replay::of`].
pub(super) fn replay(
    recording: &Recording,
    road: usize,
    start: u32,
    settings: &ReplaySettings,
) -> Result<Replay, SimulationError> {
    let meta = recording.meta();
    let fail = |reason: String| SimulationError::Replay { recording: meta.name.clone(), reason };
    let Some(carriageway) = recording.roads().get(road) else {
        return Err(fail(format!("it has no carriageway {road}, but {}", recording.roads().len())));
    };
    let tracks: Vec<&Track> = recording.tracks().iter().filter(|track| usize::from(track.road) == road).collect();
    let first = tracks.iter().map(|track| track.first_frame).min().unwrap_or(0);
    let last = tracks.iter().map(|track| track.last_frame()).max().unwrap_or(0);
    let longest = (settings.duration_s * meta.rate_hz).round().max(0.0) as u32;
    let nobody = SimulationError::NobodyToDrive { recording: meta.name.clone(), start };
    let frames = last.saturating_sub(start).min(longest);
    if frames == 0 {
        return Err(nobody);
    }
    let lines = lines(recording, &carriageway.lines, &tracks);
    if lines.len() < 2 {
        return Err(fail("its lanes are not known; give lane lines or lane numbers".to_owned()));
    }
    let rows = tracks.iter().flat_map(|track| track.rows.clone());
    let x = rows.map(|row| f64::from(recording.columns().x[row]));
    let section = x.fold([f64::INFINITY, f64::NEG_INFINITY], |[from, to], x| [from.min(x), to.max(x)]);
    let mut scene = Scene {
        name: format!("{}:{road}:{:.1}", meta.name, f64::from(start.saturating_sub(first)) / meta.rate_hz),
        dataset: meta.dataset,
        site: meta.site.clone(),
        simulated: meta.simulated,
        velocities: meta.velocities,
        rate_hz: meta.rate_hz,
        frames: frames as usize,
        lines,
        section,
        actors: Vec::new(),
        is_a_sample: false,
    };
    let source = Source { recording, start, past: (settings.past_s * meta.rate_hz).round() as u32 };
    let (mut actors, mut paths) = source.vehicles(&scene, &tracks);
    for (actor, path) in source.leaders(&scene, &tracks, &actors) {
        actors.push(actor);
        paths.push(path);
    }
    scene.is_a_sample = recording.columns().named_leader.is_some();
    let mut order: Vec<usize> = (0..actors.len()).collect();
    order.sort_by_key(|&index| (actors[index].enters, actors[index].vehicle, actors[index].is_driven()));
    scene.actors = order.iter().map(|&index| actors[index].clone()).collect();
    let mut truth: Vec<Path> = order.iter().map(|&index| paths[index].clone()).collect();
    lead_the_columns(&mut scene, &mut truth);
    if !scene.actors.iter().any(Actor::is_scored) {
        return Err(nobody);
    }
    Ok(Replay { scene, truth: Trace { paths: truth, ..Trace::default() } })
}

/// The lines that the carriageway has, or those fitted to its rows.
fn lines(recording: &Recording, given: &[LaneMarking], tracks: &[&Track]) -> Vec<LaneMarking> {
    if given.len() >= 2 {
        return given.to_vec();
    }
    let columns = recording.columns();
    let rows = || tracks.iter().flat_map(|track| track.rows.clone());
    let lane: Vec<i16> = rows().map(|row| columns.lane[row]).collect();
    let y: Vec<f32> = rows().map(|row| columns.y[row]).collect();
    fit_lanes(&lane, &y).lines
}

/// The foremost of each lane at the start follow somebody who is not known: they move as recorded.
fn lead_the_columns(scene: &mut Scene, truth: &mut [Path]) {
    let lane = |actor: &Actor| scene.lane_at(actor.start.position.y);
    let mut heads: BTreeMap<usize, usize> = BTreeMap::new();
    for (index, actor) in scene.actors.iter().enumerate().filter(|(_, actor)| actor.enters == 0) {
        let head = heads.entry(lane(actor)).or_insert(index);
        if actor.start.position.x > scene.actors[*head].start.position.x {
            *head = index;
        }
    }
    for index in heads.into_values() {
        if !scene.actors[index].is_driven() {
            continue;
        }
        let motion = carried_on(scene, truth[index].states.clone(), 0);
        truth[index].states = motion.clone();
        scene.actors[index].motion = Some(motion);
    }
}

/// A recorded motion that ends near the end of the section goes on at its last speed.
fn carried_on(scene: &Scene, mut states: Vec<State<f64>>, enters: usize) -> Vec<State<f64>> {
    if let Some(&last) = states.last().filter(|last| last.position.x > scene.section[1] - NEAR_THE_END_M) {
        let missing = (scene.frames + 1).saturating_sub(enters + states.len());
        states.extend((1..=missing).map(|frame| {
            let way = last.velocity.x * scene.dt() * frame as f64;
            State::new(last.position.x + way, last.position.y, last.velocity.x, 0.0)
        }));
    }
    states
}

/// A recording around a start.
struct Source<'a> {
    recording: &'a Recording,
    start: u32,
    past: u32,
}

impl Source<'_> {
    /// Everybody who has rows, with what they did from when they came.
    fn vehicles(&self, scene: &Scene, tracks: &[&Track]) -> (Vec<Actor>, Vec<Path>) {
        let (mut actors, mut paths) = (Vec::new(), Vec::new());
        let mut known: BTreeSet<u32> = BTreeSet::new();
        let mut by_time: Vec<&&Track> = tracks.iter().collect();
        by_time.sort_by_key(|track| (track.first_frame, track.vehicle));
        for track in by_time {
            let present = track.first_frame <= self.start && track.last_frame() > self.start;
            let comes = track.first_frame > self.start && track.first_frame < self.start + scene.frames as u32;
            // After a gap it is there already.
            if !(present || comes) || !known.insert(track.vehicle) {
                continue;
            }
            let from = track.first_frame.max(self.start);
            let last = track.last_frame().min(self.start + scene.frames as u32);
            let states = (from..=last).map(|frame| self.recorded(track, frame)).collect();
            let since = track.first_frame.max(self.start.saturating_sub(self.past)).min(from);
            let start = self.state_up_to(track, from);
            let mut past: Vec<State<f64>> = (since..from).map(|frame| self.state_up_to(track, frame)).collect();
            past.push(start);
            let enters = (from - self.start) as usize;
            let size = [track.length, track.width];
            let (vehicle, class) = (track.vehicle, track.class);
            actors.push(Actor { vehicle, size, class, enters, start, past, has_rows: true, motion: None });
            paths.push(Path { first: enters, states });
        }
        (actors, paths)
    }

    /// Leaders that rows name and that have none themselves, moved as those rows tell.
    fn leaders(&self, scene: &Scene, tracks: &[&Track], driven: &[Actor]) -> Vec<(Actor, Path)> {
        let Some(named) = &self.recording.columns().named_leader else { return Vec::new() };
        let driven: BTreeSet<u32> = driven.iter().map(|actor| actor.vehicle).collect();
        let from = self.start.saturating_sub(self.past);
        let to = self.start + scene.frames as u32;
        // By leader and frame: the place, and whether its follower's rows end there.
        let mut seen: BTreeMap<u32, BTreeMap<u32, ([f64; 2], bool)>> = BTreeMap::new();
        for track in tracks {
            for frame in track.first_frame.max(from)..=track.last_frame().min(to) {
                let Some(row) = track.row_at(frame) else { continue };
                let leader = named[row];
                if leader.vehicle == 0 || driven.contains(&leader.vehicle) {
                    continue;
                }
                let behind = self.recording.state(row);
                let x = behind.x + track.length / 2.0 + leader.headway - NAMED_LEADER_SIZE[0] / 2.0;
                let y = scene.lane(scene.lane_at(f64::from(behind.y)))[0];
                let place = ([f64::from(x), y], frame == track.last_frame());
                seen.entry(leader.vehicle).or_default().entry(frame).or_insert(place);
            }
        }
        let shortest = (SHORTEST_LEADER_S * scene.rate_hz).ceil() as usize;
        let mut found = Vec::new();
        for (vehicle, frames) in seen {
            let rows: Vec<(u32, [f64; 2], bool)> =
                frames.iter().map(|(frame, seen)| (*frame, seen.0, seen.1)).collect();
            for run in rows.chunk_by(|a, b| a.0 + 1 == b.0).filter(|run| run.len() > shortest) {
                found.extend(self.leader(scene, vehicle, run));
            }
        }
        found
    }

    /// A named leader over frames without a gap; none if that is before the start.
    fn leader(&self, scene: &Scene, vehicle: u32, run: &[(u32, [f64; 2], bool)]) -> Option<(Actor, Path)> {
        let half = (scene.rate_hz / 2.0).round().max(1.0) as usize;
        let state = |index: usize| {
            let (from, to) = (index.saturating_sub(half), (index + half).min(run.len() - 1));
            let way = run[to].1[0] - run[from].1[0];
            let speed = way / (scene.dt() * (to - from).max(1) as f64);
            State::new(run[index].1[0], run[index].1[1], speed.max(0.0), 0.0)
        };
        let begins = run.iter().position(|(frame, ..)| *frame >= self.start)?;
        let enters = (run[begins].0 - self.start) as usize;
        let mut motion: Vec<State<f64>> = (begins..run.len()).map(state).collect();
        let (_, _, left_with_follower) = *run.last()?;
        if left_with_follower {
            motion = carried_on(scene, motion, enters);
        }
        let past = (0..=begins).map(state).collect();
        let start = *motion.first()?;
        let path = Path { first: enters, states: motion.clone() };
        let (size, class) = (NAMED_LEADER_SIZE, VehicleClass::Car);
        Some((Actor { vehicle, size, class, enters, start, past, has_rows: false, motion: Some(motion) }, path))
    }

    /// The state in a frame, with nothing in it from a later one but in a track's first, whose velocity no earlier one tells.
    fn state_up_to(&self, track: &Track, frame: u32) -> State<f64> {
        let span = (VELOCITY_SPAN_S * self.recording.meta().rate_hz).round().max(1.0) as u32;
        let from = frame.saturating_sub(span).max(track.first_frame);
        let to = if from == frame { (frame + span).min(track.last_frame()) } else { frame };
        self.state(track, frame, [from, to])
    }

    /// The state in a frame as recorded, its velocity a difference around it.
    fn recorded(&self, track: &Track, frame: u32) -> State<f64> {
        let half = (VELOCITY_SPAN_S * self.recording.meta().rate_hz).round().max(1.0) as u32;
        self.state(
            track,
            frame,
            [frame.saturating_sub(half).max(track.first_frame), (frame + half).min(track.last_frame())],
        )
    }

    fn state(&self, track: &Track, frame: u32, [from, to]: [u32; 2]) -> State<f64> {
        let at = |frame: u32| track.row_at(frame).map(|row| self.recording.state(row)).unwrap_or_default();
        let here = at(frame);
        let mut velocity = [here.vx, here.vy].map(f64::from);
        if self.recording.meta().velocities == VelocitySource::Derived && to > from {
            let (a, b) = (at(from), at(to));
            let seconds = f64::from(to - from) / self.recording.meta().rate_hz;
            velocity = [f64::from(b.x - a.x) / seconds, f64::from(b.y - a.y) / seconds];
        }
        State::new(f64::from(here.x), f64::from(here.y), velocity[0], velocity[1])
    }
}
