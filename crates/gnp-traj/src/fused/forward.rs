//! One chunk carried through all steps.

use gnp_force::na::Vector2;
use gnp_force::{Arity, CENTRE_CUTOFF, ForceTerm, GoalAttraction, LineRepulsion, Source, State, VehicleRepulsion};
use gnp_nn::kernels::{Aligned, LINE, Pool, Rows, RowsMut};

use super::batch::{Batch, Chunk};
use super::head::{HeadTape, HeadWork};
use super::history_encoder::HistoryTape;
use super::layout::{Net, Packed};
use super::mlp::{self, BLOCK, Workspace};
use super::trace::Trace;
use crate::{Integrator, Phase};

/// What a chunk leaves behind for its adjoint.
#[derive(Debug, Default)]
pub(crate) struct Tape {
    /// Scaled observed states `[windows, LINE]` and rolled-out ones `[rows, LINE]` that the networks saw.
    pub(crate) seen: Trace,
    pub(crate) scaled: Trace,
    /// phi_1 and phi_2, over the observed frames and over the predicted ones; phi_2 if anything pushes.
    pub(crate) history: [HistoryTape; 2],
    pub(crate) future: [HistoryTape; 2],
    /// States `[rows, 4]` before each step.
    pub(crate) motion: Trace,
    /// Scaled goals `[rows, LINE]`.
    pub(crate) goals: Aligned,
    pub(crate) tau: HeadTape,
    pub(crate) k: HeadTape,
    pub(crate) k_line: HeadTape,
}

/// What a roll-out tells beside its path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Detail {
    Path,
    /// The forces of every step.
    Forces,
    /// Also their parameters, at every distance.
    Parameters,
}

/// What comes out of a chunk, rows first.
#[derive(Debug, Default)]
pub(crate) struct Outcome {
    /// Positions `[rows, steps, 2]`.
    pub(crate) path: Vec<f32>,
    pub(crate) record: Option<Record>,
}

/// What [`crate::RollOut`] holds beside the path, for the rows of a chunk.
#[derive(Debug, Default)]
pub(crate) struct Record {
    /// `[rows, steps, 2]`
    pub(crate) velocity: Vec<f32>,
    /// One for each of [`Batch::acting`](super::batch::Batch::acting).
    pub(crate) terms: Vec<TermRecord>,
}

/// A term: forces `[rows, steps, sources, 2]` and, where they are told, each parameter that varies
/// `[rows, steps, sources]`.
#[derive(Debug, Default)]
pub(crate) struct TermRecord {
    pub(crate) sources: usize,
    pub(crate) forces: Vec<f32>,
    pub(crate) parameters: Vec<Vec<f32>>,
}

impl Outcome {
    /// Room for a chunk, in its memory where that suffices.
    fn reset(&mut self, chunk: &Chunk<'_>, detail: Detail) {
        zero(&mut self.path, chunk.rows() * chunk.batch.steps * 2);
        match detail {
            Detail::Path => self.record = None,
            _ => self.record.get_or_insert_default().reset(chunk, detail),
        }
    }
}

impl Record {
    fn reset(&mut self, chunk: &Chunk<'_>, detail: Detail) {
        let entries = chunk.rows() * chunk.batch.steps;
        zero(&mut self.velocity, entries * 2);
        self.terms.resize_with(chunk.batch.acting().count(), TermRecord::default);
        for (record, (term, sources)) in self.terms.iter_mut().zip(chunk.batch.acting()) {
            record.sources = sources;
            zero(&mut record.forces, entries * sources * 2);
            let parameters = if detail == Detail::Parameters { term.varying().count() } else { 0 };
            record.parameters.resize_with(parameters, Vec::new);
            record.parameters.iter_mut().for_each(|values| zero(values, entries * sources));
        }
    }
}

/// Makes `values` so many zeros.
fn zero(values: &mut Vec<f32>, len: usize) {
    values.clear();
    values.resize(len, 0.);
}

/// The forces of a step while terms add to them, and what is recorded of them.
struct Adding<'a, 'b> {
    chunk: &'a Chunk<'b>,
    motion: &'a [f32],
    forces: &'a mut [Vector2<f32>],
    /// Room for what a term acts from.
    sources: &'a mut Vec<Source<f32>>,
    record: Option<&'a mut Record>,
    step: usize,
    /// Terms so far.
    done: usize,
}

impl Adding<'_, '_> {
    /// The next term with the parameters of each pair.
    fn add<L, P>(&mut self, law: &L, arity: Arity, parameters: impl Fn(usize) -> P)
    where
        L: ForceTerm<f32> + ?Sized,
        P: AsRef<[f32]>,
    {
        let (step, steps) = (self.step, self.chunk.batch.steps);
        let mut record = self.record.as_mut().and_then(|record| record.terms.get_mut(self.done));
        self.done += 1;
        self.sources.clear();
        self.sources.extend(self.chunk.sources(arity, step));
        self.chunk.pairs(arity, self.sources).enumerate().for_each(|(i, pair)| {
            let parameters = parameters(i);
            let force = law.force(&state_of(self.motion, pair.row), pair.from, parameters.as_ref());
            self.forces[pair.row] += force;
            if let Some(record) = &mut record {
                let at = (pair.row * steps + step) * record.sources + pair.slot;
                record.forces[2 * at..2 * at + 2].copy_from_slice(force.as_slice());
                let all = law.descriptor().parameters.iter().zip(parameters.as_ref());
                let varying = all.filter(|(known, _)| known.varies);
                for (values, (_, value)) in record.parameters.iter_mut().zip(varying) {
                    values[at] = *value;
                }
            }
        });
    }
}

impl Tape {
    /// Room for a chunk, in its memory where that suffices, else in that of `pool`.
    fn reset(&mut self, chunk: &Chunk<'_>, net: &Net<Packed>, pool: &Pool, keep: bool) {
        let batch = chunk.batch;
        let (rows, runs, seen) = (chunk.rows(), batch.runs(), batch.seen());
        let (neighbours, lines) = chunk.learned_pairs();
        let kept = |steps: usize| if keep { steps } else { steps.min(2) };
        self.seen.reset(pool, kept(seen), chunk.count() * LINE);
        self.scaled.reset(pool, kept(runs), rows * LINE);
        for (i, history_encoder) in net.history_encoders.iter().enumerate() {
            // Room for pairs is made also where there happen to be none, so that the next chunk finds it.
            let acts = match i {
                0 => batch.sizes.pull,
                _ if keep => neighbours + lines > 0,
                _ => batch.sizes.k || batch.sizes.k_line,
            };
            let [windows, rows] = [chunk.count(), rows].map(|rows| if acts { rows } else { 0 });
            let keep = keep && trained(batch.phase, i);
            self.history[i].reset(pool, history_encoder, windows, seen, keep);
            self.future[i].reset(pool, history_encoder, rows, runs - 1, keep);
        }
        self.motion.reset(pool, kept(batch.steps + 1), rows * 4);
        self.goals.resize(rows * LINE);
        let pulled = if batch.sizes.pull { rows } else { 0 };
        self.tau.reset(pool, &net.tau, [pulled, pulled], runs, keep && trained(batch.phase, 0));
        self.k.reset(pool, &net.k, [neighbours, rows * batch.sizes.slots], runs, keep);
        self.k_line.reset(pool, &net.k_line, [lines, rows * batch.sizes.lines], runs, keep);
    }

    /// Gives all memory back, keeping at most `limit` values idle.
    pub(crate) fn recycle(self, pool: &Pool, limit: usize) {
        let history_encoders = self.history.into_iter().chain(self.future).flat_map(HistoryTape::into_buffers);
        let traces = [self.seen, self.scaled, self.motion].map(Trace::into_buffer);
        let heads = [self.tau, self.k, self.k_line].into_iter().flat_map(HeadTape::into_buffers);
        pool.give(history_encoders.chain(traces).chain(heads), limit);
    }
}

/// Whether `phase` trains phi_1 (0) or phi_2 (1).
pub(crate) fn trained(phase: Phase, history_encoder: usize) -> bool {
    match phase {
        Phase::Attraction => history_encoder == 0,
        Phase::Repulsion => history_encoder == 1,
        Phase::Full => true,
    }
}

/// Rolls the chunk out; the tape is whole only if it is to be kept.
pub(crate) fn roll_out(
    chunk: &Chunk<'_>,
    net: &Net<Packed>,
    pool: &Pool,
    keep: bool,
    detail: Detail,
) -> (Outcome, Tape) {
    let (mut outcome, mut tape) = (Outcome::default(), Tape::default());
    roll_out_into(chunk, net, pool, (keep, detail), &mut tape, &mut Work::default(), &mut outcome);
    (outcome, tape)
}

/// [`roll_out`] in memory that is there.
pub(crate) fn roll_out_into(
    chunk: &Chunk<'_>,
    net: &Net<Packed>,
    pool: &Pool,
    (keep, detail): (bool, Detail),
    tape: &mut Tape,
    work: &mut Work,
    outcome: &mut Outcome,
) {
    tape.reset(chunk, net, pool, keep);
    outcome.reset(chunk, detail);
    observe(chunk, net, tape);
    work.reset(chunk, net, &tape.goals);
    Drive { chunk, net, tape, work, outcome, detail }.run();
}

/// Takes in the observed frames and sets the start of the roll-out.
fn observe(chunk: &Chunk<'_>, net: &Net<Packed>, tape: &mut Tape) {
    let (batch, goals) = (chunk.batch, chunk.batch.sizes.goals);
    for step in 0..batch.seen() {
        for (window, seen) in tape.seen.at_mut(step).chunks_exact_mut(LINE).enumerate() {
            scale_into(seen, chunk.observed(window, step), batch.scale);
        }
        let states = Rows { data: tape.seen.at(step), stride: LINE };
        for (history_encoder, history) in net.history_encoders.iter().zip(&mut tape.history) {
            if history.acts() {
                history.advance(history_encoder, step, states);
            }
        }
    }
    for (history, future) in tape.history.iter().zip(&mut tape.future) {
        if history.acts() {
            future.start_from(history, batch.seen(), goals);
        }
    }
    for (row, state) in tape.motion.at_mut(0).chunks_exact_mut(4).enumerate() {
        state.copy_from_slice(&chunk.observed(row / goals, batch.seen() - 1));
    }
    for (row, goal) in tape.goals.chunks_exact_mut(LINE).enumerate() {
        let [x, y] = chunk.goal(row);
        scale_into(goal, [x, y, 0., 0.], batch.scale);
    }
}

fn scale_into(row: &mut [f32], state: [f32; 4], scale: [f32; 4]) {
    for ((value, state), scale) in row.iter_mut().zip(state).zip(scale) {
        *value = state * scale;
    }
}

/// Scaled states of the occupied slots in a step, `[occupied, LINE]`.
pub(crate) fn neighbour_features(chunk: &Chunk<'_>, step: usize, features: &mut [f32]) {
    for (occupied, row) in features.chunks_exact_mut(LINE).enumerate() {
        scale_into(row, chunk.neighbour(step, occupied), chunk.batch.scale);
    }
}

/// Distance and kind of the line of each pair with a row, `[pairs, LINE]`.
pub(crate) fn line_features(chunk: &Chunk<'_>, pairs: &[(usize, usize)], motion: &[f32], features: &mut [f32]) {
    for (&(row, occupied), features) in pairs.iter().zip(features.chunks_exact_mut(LINE)) {
        let [y, kind, _] = chunk.line(occupied);
        features[0] = motion[4 * row + 1] - y;
        features[1] = kind;
    }
}

/// How far a vehicle may come sideways between two frames of which the networks see the first, m.
const SIDEWAYS: f32 = 1.;

/// The pairs of a row and a line that may push until the networks run again: all but those with a line between lanes
/// beyond its cut-off.
fn near_lines(chunk: &Chunk<'_>, motion: &[f32], near: &mut Vec<(usize, usize)>) {
    let reach = CENTRE_CUTOFF as f32 + 1e-3 + SIDEWAYS * (chunk.batch.period - 1) as f32;
    near.clear();
    near.extend(chunk.lines.pairs.iter().copied().filter(|&(row, occupied)| {
        let [y, kind, _] = chunk.line(occupied);
        kind > 0.5 || (motion[4 * row + 1] - y).abs() < reach
    }));
}

/// The state of a row.
pub(crate) fn state_of(motion: &[f32], row: usize) -> State<f32> {
    let at = 4 * row;
    State::new(motion[at], motion[at + 1], motion[at + 2], motion[at + 3])
}

/// The parameters that the networks set in a run, by pair.
#[derive(Clone, Copy)]
pub(crate) struct Learned<'a> {
    batch: &'a Batch,
    tau: &'a [f32],
    k: &'a [f32],
    k_line: &'a [f32],
}

impl<'a> Learned<'a> {
    pub(crate) fn of(batch: &'a Batch, tape: &'a Tape, run: usize) -> Self {
        Self { batch, tau: tape.tau.value(run), k: tape.k.value(run), k_line: tape.k_line.value(run) }
    }

    /// Of the goal of a row.
    pub(crate) fn tau(self, row: usize) -> [f32; 1] {
        [self.batch.tau_max * self.tau[row] + self.batch.dt]
    }

    /// Of a neighbour.
    pub(crate) fn k(self, pair: usize) -> [f32; 2] {
        [self.batch.k_max * self.k[pair], self.batch.r_col]
    }

    /// Of a line.
    pub(crate) fn k_line(self, pair: usize) -> [f32; 1] {
        [self.batch.k_max_line * self.k_line[pair]]
    }
}

/// The predicted steps of one chunk.
struct Drive<'a, 'b> {
    chunk: &'a Chunk<'b>,
    net: &'a Net<Packed>,
    tape: &'a mut Tape,
    work: &'a mut Work,
    outcome: &'a mut Outcome,
    detail: Detail,
}

/// Room to work in while a chunk is driven.
#[derive(Debug, Default)]
pub(crate) struct Work {
    /// On every row in a step.
    forces: Vec<Vector2<f32>>,
    sources: Vec<Source<f32>>,
    /// Pairs of a row and a line near enough to push.
    near: Vec<(usize, usize)>,
    heads: [HeadWork; 3],
    /// Of neighbours, lines and goals.
    encoders: [Workspace; 3],
    /// Features and latents of what is encoded at a step.
    features: Aligned,
    latents: Aligned,
    /// Code of the history `[rows, latent]`.
    latent: Aligned,
    goal_latent: Aligned,
    /// Width of a latent.
    width: usize,
}

impl Work {
    /// Room for a chunk with these scaled goals, whatever is present, in its memory where that suffices.
    fn reset(&mut self, chunk: &Chunk<'_>, net: &Net<Packed>, goals: &[f32]) {
        let (rows, windows, sizes) = (chunk.rows(), chunk.count(), chunk.batch.sizes);
        self.width = net.history_encoders[0].out.outputs();
        let most = (windows * sizes.slots).max(rows * sizes.lines);
        self.forces.resize(rows, Vector2::zeros());
        self.sources.clear();
        self.sources.reserve(rows.max(windows * sizes.slots.max(sizes.lines)));
        self.near.clear();
        self.near.reserve(rows * sizes.lines);
        for (work, layers) in self.heads.iter_mut().zip([&net.tau, &net.k, &net.k_line]) {
            work.reset(layers);
        }
        for (work, layers) in self.encoders.iter_mut().zip([&net.enc_nei, &net.enc_line, &net.enc_goal]) {
            work.reset(layers, BLOCK);
        }
        self.features.resize(most * LINE);
        self.latents.resize(most * self.width);
        self.latent.resize(rows * self.width);
        self.goal_latent.resize(rows * self.width);
        if sizes.pull {
            let latents = RowsMut { data: &mut self.goal_latent, stride: self.width };
            mlp::forward(&net.enc_goal, &mut self.encoders[2], rows, Rows { data: goals, stride: LINE }, latents);
        }
    }
}

impl Drive<'_, '_> {
    fn run(mut self) {
        for step in 0..self.chunk.batch.steps {
            if step % self.chunk.batch.period == 0 {
                self.networks(step, step / self.chunk.batch.period);
            }
            self.physics(step, step / self.chunk.batch.period);
        }
    }

    /// Sets `tau` and the strengths from the state at `step`.
    fn networks(&mut self, step: usize, run: usize) {
        let (net, chunk) = (self.net, self.chunk);
        let Work { heads, encoders, features, latents, latent, goal_latent, width, near, .. } = &mut *self.work;
        let width = *width;
        if run > 0 {
            let (motion, scaled) = (self.tape.motion.at(step), self.tape.scaled.at_mut(run - 1));
            for (state, scaled) in motion.as_chunks::<4>().0.iter().zip(scaled.chunks_exact_mut(LINE)) {
                scale_into(scaled, *state, chunk.batch.scale);
            }
            let states = Rows { data: self.tape.scaled.at(run - 1), stride: LINE };
            for (history_encoder, future) in net.history_encoders.iter().zip(&mut self.tape.future) {
                if future.acts() {
                    future.advance(history_encoder, run - 1, states);
                }
            }
        }
        if self.tape.tau.acts() {
            let history_code = RowsMut { data: latent, stride: width };
            self.tape.future[0].latent(&net.history_encoders[0], run, history_code);
            for (row, input) in self.tape.tau.input.at_mut(run).chunks_exact_mut(2 * width).enumerate() {
                input[..width].copy_from_slice(&latent[row * width..][..width]);
                input[width..].copy_from_slice(&goal_latent[row * width..][..width]);
            }
            self.tape.tau.forward(&net.tau, run, chunk.rows(), &mut heads[0]);
        }
        if self.tape.future[1].acts() {
            let history_code = RowsMut { data: latent, stride: width };
            self.tape.future[1].latent(&net.history_encoders[1], run, history_code);
        }
        // All goals of a window set out from one state: the first run looks at one of them.
        let alike = |k: &HeadTape| run == 0 && !k.keep;
        let k = &mut self.tape.k;
        if k.acts() {
            let occupied = chunk.neighbours.occupied.len();
            neighbour_features(chunk, step, &mut features[..occupied * LINE]);
            let seen = Rows { data: features, stride: LINE };
            mlp::forward(&net.enc_nei, &mut encoders[0], occupied, seen, RowsMut { data: latents, stride: width });
            let pairs = chunk.neighbours.distinct(alike(k));
            let entries = pairs.iter().zip(k.input.at_mut(run).chunks_exact_mut(2 * width));
            for (&(row, occupied), input) in entries {
                input[..width].copy_from_slice(&latent[row * width..][..width]);
                input[width..].copy_from_slice(&latents[occupied * width..][..width]);
            }
            k.forward(&net.k, run, pairs.len(), &mut heads[1]);
            if alike(k) {
                k.spread(run, chunk.neighbours.pairs.iter().map(|(_, occupied)| *occupied));
            }
        }
        let k = &mut self.tape.k_line;
        if k.acts() {
            let all = chunk.lines.distinct(alike(k));
            // Nobody needs the strength of a line that does not push.
            let some = !k.keep && !alike(k) && self.detail != Detail::Parameters;
            if some {
                near_lines(chunk, self.tape.motion.at(step), near);
            }
            let pairs = if some { near } else { all };
            line_features(chunk, pairs, self.tape.motion.at(step), &mut features[..pairs.len() * LINE]);
            let seen = Rows { data: features, stride: LINE };
            mlp::forward(&net.enc_line, &mut encoders[1], pairs.len(), seen, RowsMut { data: latents, stride: width });
            let entries = pairs.iter().zip(k.input.at_mut(run).chunks_exact_mut(2 * width));
            for ((&(row, _), input), line) in entries.zip(latents.chunks_exact(width)) {
                input[..width].copy_from_slice(&latent[row * width..][..width]);
                input[width..].copy_from_slice(line);
            }
            k.forward(&net.k_line, run, pairs.len(), &mut heads[2]);
            if alike(k) {
                k.spread(run, chunk.lines.pairs.iter().map(|(_, occupied)| *occupied));
            } else if some {
                k.scatter(run, pairs, all);
            }
        }
    }

    /// Sets the forces on every row in `step`, recorded where that is asked for.
    fn act(&mut self, step: usize, run: usize) {
        let (chunk, batch) = (self.chunk, self.chunk.batch);
        let Work { forces, sources, .. } = &mut *self.work;
        forces.fill(Vector2::zeros());
        let mut adding = Adding {
            chunk,
            motion: self.tape.motion.at(step),
            forces,
            sources,
            record: self.outcome.record.as_mut(),
            step,
            done: 0,
        };
        let learned = Learned::of(batch, self.tape, run);
        if batch.sizes.pull {
            adding.add(&GoalAttraction, Arity::One, |row| learned.tau(row));
        }
        if batch.sizes.k {
            adding.add(&VehicleRepulsion, Arity::PerNeighbour, |pair| learned.k(pair));
        }
        if batch.sizes.k_line {
            adding.add(&LineRepulsion, Arity::PerLine, |pair| learned.k_line(pair));
        }
        for term in batch.terms.fixed().filter(|term| batch.sizes.sources(term.descriptor.arity) > 0) {
            adding.add(&*term.law, term.descriptor.arity, |_| &term.parameters);
        }
    }

    /// Moves every row from `step` to the next.
    fn physics(&mut self, step: usize, run: usize) {
        let batch = self.chunk.batch;
        let (dt, steps) = (batch.dt, batch.steps);
        self.act(step, run);
        self.tape.motion.carry(step);
        for ((row, force), state) in
            self.work.forces.iter().enumerate().zip(self.tape.motion.at_mut(step + 1).as_chunks_mut().0)
        {
            let [x, y, vx, vy] = state;
            let faster = [*vx + force.x * dt, *vy + force.y * dt];
            let moving = match batch.integrator {
                Integrator::ExplicitEuler => [*vx, *vy],
                _ => faster,
            };
            *x += moving[0] * dt;
            *y += moving[1] * dt;
            [*vx, *vy] = faster;
            let at = 2 * (row * steps + step);
            self.outcome.path[at..at + 2].copy_from_slice(&[*x, *y]);
            if let Some(record) = &mut self.outcome.record {
                record.velocity[at..at + 2].copy_from_slice(&faster);
            }
        }
    }
}
