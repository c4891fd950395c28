//! A predictor that drives: it predicts, everybody follows one of his predicted paths for a while, and it predicts again.
use super::{
    ClosedLoop, DrivenBy, Scene, Trace,
    world::{Decides, World, drive},
};
use crate::{chance::uniform, error::SimulationError};
use gnp_data::{
    Forecast, Mode, NamedLeader, NeighbourSource, Observation, Predictor, Recording, RecordingMeta, Road, Rows,
    VehicleBody, VelocitySource, WindowShape,
};
use gnp_force::{State, Vehicle};

/// Paths that end farther to one side than this are changes of lane, in m.
const LANE_CHANGE_M: f32 = 2.0;

/// A predictor re-planned in closed loop.
///
/// Every `replan_s` it sees the last seconds of everybody, before the start as recorded and since then as driven, and
/// predicts for every driven vehicle that has been there long enough; until then, and beyond its predicted time, `until`
/// drives. A vehicle follows one of its `k` predicted paths exactly: the first, or with `draws` one drawn by probability.
/// Which one depends on a number between 0 and 1 that a vehicle keeps for `hold_s`: paths are ordered by side, right to
/// left, and within a side by how far they lead, so that it stays the bold or the careful driver from one prediction to the
/// next.
pub struct Learned<'a> {
    name: String,
    predictor: &'a dyn Predictor,
    shape: WindowShape,
    draws: bool,
    until: DrivenBy,
    /// Paths asked for.
    pub k: usize,
    /// Time from one prediction to the next, in s.
    pub replan_s: f64,
    /// Time for which a vehicle keeps its draw, in s.
    pub hold_s: f64,
}

impl<'a> Learned<'a> {
    /// A predictor of windows of `shape`, re-planned every 0.5 s, with draws of 6 paths kept for 5 s.
    #[must_use]
    pub fn new(
        name: impl Into<String>,
        predictor: &'a dyn Predictor,
        shape: WindowShape,
        draws: bool,
        until: DrivenBy,
    ) -> Self {
        Self { name: name.into(), predictor, shape, draws, until, k: 6, replan_s: 0.5, hold_s: 5.0 }
    }
}

impl ClosedLoop for Learned<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn draws(&self) -> bool {
        self.draws
    }

    fn drive(&self, scene: &Scene, seed: u64) -> Result<Trace, SimulationError> {
        let every = (self.replan_s * scene.rate_hz).round().max(1.0) as usize;
        let plans = vec![Vec::new(); scene.actors.len()];
        drive(scene, seed, &mut Planner { of: self, seed, every, plans, planned: 0, stood_in: 0 })
    }
}

struct Planner<'a, 'b> {
    of: &'a Learned<'b>,
    seed: u64,
    every: usize,
    /// States in the coming frames, by actor; empty for those who drive by themselves.
    plans: Vec<Vec<State<f64>>>,
    /// Frame of the last prediction.
    planned: usize,
    stood_in: usize,
}

impl Decides for Planner<'_, '_> {
    fn vehicle(&mut self, scene: &Scene, index: usize, base: Vehicle<f64>) -> Vehicle<f64> {
        self.of.until.drives(scene, &scene.actors[index], base)
    }

    fn plan(&mut self, world: &World<'_>, moves: &mut Vec<(usize, State<f64>)>) -> Result<(), SimulationError> {
        if world.frame.is_multiple_of(self.every) {
            self.predict(world)?;
        }
        for (index, actor) in world.scene.actors.iter().enumerate() {
            let Some(now) = world.now(index).filter(|_| actor.is_driven()) else { continue };
            if now.position.x > world.scene.section[1] {
                continue;
            }
            match self.plans[index].get(world.frame - self.planned) {
                Some(state) => moves.push((index, *state)),
                None => self.stood_in += 1,
            }
        }
        Ok(())
    }

    fn stood_in(&self) -> usize {
        self.stood_in
    }
}

impl Planner<'_, '_> {
    fn predict(&mut self, world: &World<'_>) -> Result<(), SimulationError> {
        self.planned = world.frame;
        self.plans.iter_mut().for_each(Vec::clear);
        let Some((recording, tracks)) = seen(world, &self.of.shape)? else { return Ok(()) };
        let mut who = Vec::new();
        let mut observations = Vec::new();
        for (index, track) in tracks {
            let rows = recording.tracks()[track].rows.clone();
            if let Ok(observation) = Observation::new(&recording, self.of.shape, track, rows.end - 1) {
                who.push(index);
                observations.push(observation);
            }
        }
        if observations.is_empty() {
            return Ok(());
        }
        let forecasts = self.of.predictor.predict(&observations, self.of.k)?;
        for ((index, forecast), observation) in who.into_iter().zip(&forecasts).zip(&observations) {
            let chosen = if self.of.draws { self.drawn(world, index, forecast) } else { forecast.modes.first() };
            if let (Some(mode), Some(now)) = (chosen, world.now(index)) {
                let origin = observation.origin().map(f64::from);
                self.plans[index] = followed(mode, origin, now, &self.of.shape, self.every, world.scene.rate_hz);
            }
        }
        Ok(())
    }

    /// The path that a vehicle's number between 0 and 1 stands for.
    fn drawn<'f>(&self, world: &World<'_>, index: usize, forecast: &'f Forecast) -> Option<&'f Mode> {
        let hold = (self.of.hold_s * world.scene.rate_hz).round().max(1.0) as u64;
        let vehicle = u64::from(world.scene.actors[index].vehicle);
        // Not everybody draws anew at the same moment.
        let period = (world.frame as u64 + vehicle * 7 % hold) / hold;
        let number = uniform(&[self.seed, vehicle, period]) as f32;
        let mut modes: Vec<&Mode> = forecast.modes.iter().filter(|mode| !mode.path.is_empty()).collect();
        let end = |mode: &Mode| mode.path.last().copied().unwrap_or_default();
        let side = |mode: &Mode| i8::from(end(mode)[1] > LANE_CHANGE_M) - i8::from(end(mode)[1] < -LANE_CHANGE_M);
        modes.sort_by(|a, b| side(a).cmp(&side(b)).then(end(a)[0].total_cmp(&end(b)[0])));
        let total: f32 = modes.iter().map(|mode| mode.probability).sum();
        let mut sum = 0.0;
        let found = modes.iter().find(|mode| {
            sum += mode.probability / total;
            sum >= number
        });
        found.or(modes.last()).copied()
    }
}

/// The first `frames` states of a path from a vehicle's place on, at the rate of the scene.
fn followed(
    mode: &Mode,
    origin: [f64; 2],
    now: &State<f64>,
    shape: &WindowShape,
    frames: usize,
    rate_hz: f64,
) -> Vec<State<f64>> {
    let point = |step: usize| match step.checked_sub(1) {
        None => Some([now.position.x, now.position.y]),
        Some(step) => mode.path.get(step).map(|p| [origin[0] + f64::from(p[0]), origin[1] + f64::from(p[1])]),
    };
    let mut states = Vec::with_capacity(frames);
    let mut before = [now.position.x, now.position.y];
    for frame in 1..=frames {
        let (step, part) = (frame / shape.step, (frame % shape.step) as f64 / shape.step as f64);
        let (Some(from), to) = (point(step), point(step + 1)) else { break };
        let Some(to) = to.or((part == 0.0).then_some(from)) else { break };
        let at = [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * part);
        // Nobody drives backwards.
        let at = [at[0].max(before[0]), at[1]];
        states.push(State::new(at[0], at[1], (at[0] - before[0]) * rate_hz, (at[1] - before[1]) * rate_hz));
        before = at;
    }
    states
}

/// The last seconds of everybody, and the driven actors in the section with their tracks.
type Seen = (Recording, Vec<(usize, usize)>);

/// Numbers of vehicles that are moved as recorded begin here: two of them may have one number in the file.
const MOVED: u32 = 1 << 31;

/// The number under which a predictor sees an actor: his own, if he is driven.
fn number(scene: &Scene, index: usize) -> u32 {
    let actor = &scene.actors[index];
    if actor.is_driven() { actor.vehicle } else { MOVED + index as u32 }
}

/// What a predictor sees now; nothing where nobody is to be driven.
fn seen(world: &World<'_>, shape: &WindowShape) -> Result<Option<Seen>, SimulationError> {
    let scene = world.scene;
    let needed = (shape.t_obs - 1) * shape.step + 1;
    let mut rows = Rows::new(Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut velocity = [Vec::new(), Vec::new()];
    let mut bodies = Vec::new();
    let mut driven = Vec::new();
    let mut named = Vec::new();
    let lanes = scene.lines.len().saturating_sub(1);
    let spans: Vec<Vec<State<f64>>> = (0..scene.actors.len()).map(|index| span(world, index, needed)).collect();
    for (index, actor) in scene.actors.iter().enumerate().filter(|(index, _)| world.is_there(*index)) {
        // A leader that only rows of others name is seen by them alone, as in the file.
        if !actor.has_rows {
            continue;
        }
        let states = &spans[index];
        let count = states.len();
        for (offset, state) in states.iter().enumerate() {
            rows.vehicle.push(number(scene, index));
            rows.frame.push((needed - count + offset) as u32);
            rows.x.push(state.position.x as f32);
            rows.y.push(state.position.y as f32);
            named.push(named_leader(scene, &spans, index, count - offset));
            rows.lane.push((lanes - scene.lane_at(state.position.y)) as i16);
            velocity[0].push(state.velocity.x as f32);
            velocity[1].push(state.velocity.y as f32);
            let [length, width] = actor.size;
            bodies.push(VehicleBody { class: actor.class, length, width, road: 0 });
        }
        if actor.is_driven() && states.last().is_some_and(|now| now.position.x <= scene.section[1]) {
            driven.push(index);
        }
    }
    if driven.is_empty() {
        return Ok(None);
    }
    rows.leader = scene.is_a_sample.then_some(named);
    rows.neighbours = NeighbourSource::Lanes(|lane| lane);
    rows.velocity = (scene.velocities == VelocitySource::Recorded).then_some(velocity);
    let meta = RecordingMeta::new(scene.dataset, &scene.site, &scene.name, scene.rate_hz);
    let road = Road { driving_direction: 2, lines: scene.lines.clone(), fitted: true, axis: None };
    let (recording, _) = Recording::from_rows(meta, vec![road], rows, |row| bodies[row])?;
    let tracks = driven.into_iter().filter_map(|index| {
        let own = |track: &gnp_data::Track| track.vehicle == number(scene, index);
        recording.tracks().iter().position(own).map(|track| (index, track))
    });
    let tracks = tracks.collect();
    Ok(Some((recording, tracks)))
}

/// The last states of an actor without a gap, before the start as recorded, at most `needed`; none of one who is not there.
fn span(world: &World<'_>, index: usize, needed: usize) -> Vec<State<f64>> {
    if !world.is_there(index) {
        return Vec::new();
    }
    let (actor, path) = (&world.scene.actors[index], world.path(index));
    let before = actor.past.split_last().map_or(&[][..], |(_, before)| before);
    let before = if path.first == actor.enters { before } else { &[] };
    let from_path = path.states.len().min(needed);
    let from_past = (needed - from_path).min(before.len());
    let past = &before[before.len() - from_past..];
    [past, &path.states[path.states.len() - from_path..]].concat()
}

/// What the row of an actor says of a leader without rows, `back` states before the last, counted from 1; nothing where the
/// next in the lane has rows.
fn named_leader(scene: &Scene, spans: &[Vec<State<f64>>], index: usize, back: usize) -> NamedLeader {
    let then = |index: usize| spans[index].len().checked_sub(back).map(|place| spans[index][place].position);
    let Some(me) = then(index) else { return NamedLeader::default() };
    let lane = scene.lane_at(me.y);
    let others = (0..spans.len()).filter(|other| *other != index).filter_map(|other| Some((other, then(other)?)));
    let ahead = others.filter(|(_, place)| place.x > me.x && scene.lane_at(place.y) == lane);
    let next = ahead.min_by(|a, b| a.1.x.total_cmp(&b.1.x)).filter(|(other, _)| !scene.actors[*other].has_rows);
    next.map_or_else(NamedLeader::default, |(other, place)| {
        let lengths = f64::from(scene.actors[other].size[0] - scene.actors[index].size[0]);
        NamedLeader { vehicle: number(scene, other), headway: (place.x - me.x + lengths / 2.0) as f32 }
    })
}
