//! One chunk carried through all steps.

use std::sync::Arc;

use gnp_force::na::Vector2;
use gnp_force::{Arity, ForceTerm, GoalAttraction, LineRepulsion, Source, State, TermDescriptor, VehicleRepulsion};
use gnp_nn::kernels::{Aligned, LINE, Pool, Rows, RowsMut};

use super::batch::{Batch, Chunk};
use super::head::{HeadTape, HeadWork};
use super::history_encoder::HistoryTape;
use super::layout::{Net, Packed};
use super::mlp::{self, BLOCK, Workspace};
use super::trace::Trace;
use crate::{Integrator, Phase};

/// What a chunk leaves behind for its adjoint.
#[derive(Debug)]
pub(crate) struct Tape {
    /// Scaled observed states `[windows, LINE]` and rolled-out ones `[rows, LINE]` that the networks saw.
    pub(crate) seen: Trace,
    pub(crate) scaled: Trace,
    /// phi_1 and phi_2, over the observed frames and over the predicted ones; phi_2 if anything pushes.
    pub(crate) history: [Option<HistoryTape>; 2],
    pub(crate) future: [Option<HistoryTape>; 2],
    /// States `[rows, 4]` before each step.
    pub(crate) motion: Trace,
    /// Scaled goals `[rows, LINE]`.
    pub(crate) goals: Aligned,
    pub(crate) tau: HeadTape,
    pub(crate) k: Option<HeadTape>,
    pub(crate) k_line: Option<HeadTape>,
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

/// A term: forces `[rows, steps, sources, 2]` and each parameter that varies `[rows, steps, sources]`.
#[derive(Debug, Default)]
pub(crate) struct TermRecord {
    sources: usize,
    pub(crate) forces: Vec<f32>,
    pub(crate) parameters: Vec<Vec<f32>>,
}

impl Record {
    fn new(chunk: &Chunk<'_>) -> Self {
        let entries = chunk.rows() * chunk.batch.steps;
        let term = |(term, sources): (&Arc<TermDescriptor>, usize)| TermRecord {
            sources,
            forces: vec![0.; entries * sources * 2],
            parameters: vec![vec![0.; entries * sources]; term.varying().count()],
        };
        Self { velocity: vec![0.; entries * 2], terms: chunk.batch.acting().into_iter().map(term).collect() }
    }
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
    fn new(chunk: &Chunk<'_>, net: &Net<Packed>, pool: &Pool, keep: bool) -> Self {
        let batch = chunk.batch;
        let (rows, runs, seen) = (chunk.rows(), batch.runs(), batch.seen());
        let (neighbours, lines) = chunk.learned_pairs();
        let kept = |steps: usize| if keep { steps } else { steps.min(2) };
        let history_encoder = |i: usize, rows: usize, steps: usize| {
            let acts = i == 0 || neighbours + lines > 0;
            let keep = keep && trained(batch.phase, i);
            acts.then(|| HistoryTape::new(pool, &net.history_encoders[i], rows, steps, keep))
        };
        let head = |layers: &[Packed], rows: usize| (rows > 0).then(|| HeadTape::new(pool, layers, rows, runs, keep));
        Self {
            seen: Trace::new(pool, kept(seen), chunk.count() * LINE),
            scaled: Trace::new(pool, kept(runs), rows * LINE),
            history: [0, 1].map(|i| history_encoder(i, chunk.count(), seen)),
            future: [0, 1].map(|i| history_encoder(i, rows, runs - 1)),
            motion: Trace::new(pool, kept(batch.steps + 1), rows * 4),
            goals: Aligned::zeros(rows * LINE),
            tau: HeadTape::new(pool, &net.tau, rows, runs, keep && trained(batch.phase, 0)),
            k: head(&net.k, neighbours),
            k_line: head(&net.k_line, lines),
        }
    }

    /// Gives all memory back, keeping at most `limit` values idle.
    pub(crate) fn recycle(self, pool: &Pool, limit: usize) {
        let history_encoders =
            self.history.into_iter().chain(self.future).flatten().flat_map(HistoryTape::into_buffers);
        let traces = [self.seen, self.scaled, self.motion].map(Trace::into_buffer);
        let heads = [Some(self.tau), self.k, self.k_line].into_iter().flatten().flat_map(HeadTape::into_buffers);
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
    explain: bool,
) -> (Outcome, Tape) {
    let mut tape = Tape::new(chunk, net, pool, keep);
    observe(chunk, net, &mut tape);
    let outcome = Drive::new(chunk, net, &mut tape, explain).run();
    (outcome, tape)
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
            if let Some(history) = history {
                history.advance(history_encoder, step, states);
            }
        }
    }
    for (history, future) in tape.history.iter().zip(&mut tape.future) {
        if let (Some(history), Some(future)) = (history, future) {
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
        let values = |head: &'a Option<HeadTape>| head.as_ref().map_or(&[][..], |head| head.value(run));
        Self { batch, tau: tape.tau.value(run), k: values(&tape.k), k_line: values(&tape.k_line) }
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
    outcome: Outcome,
    /// On every row in a step.
    forces: Vec<Vector2<f32>>,
    sources: Vec<Source<f32>>,
    heads: [HeadWork; 3],
    encoders: [Workspace; 2],
    /// Features and latents of what is encoded at a step.
    features: Aligned,
    latents: Aligned,
    /// Code of the history `[rows, latent]`.
    latent: Aligned,
    goal_latent: Aligned,
    /// Width of a latent.
    width: usize,
}

impl<'a, 'b> Drive<'a, 'b> {
    fn new(chunk: &'a Chunk<'b>, net: &'a Net<Packed>, tape: &'a mut Tape, explain: bool) -> Self {
        let (rows, width) = (chunk.rows(), net.history_encoders[0].out.outputs());
        let most = chunk.neighbours.occupied.len().max(chunk.lines.pairs.len());
        let mut goal_latent = Aligned::zeros(rows * width);
        let mut work = Workspace::forward(&net.enc_goal, BLOCK);
        let goals = Rows { data: &tape.goals, stride: LINE };
        mlp::forward(&net.enc_goal, &mut work, rows, goals, RowsMut { data: &mut goal_latent, stride: width });
        let path = vec![0.; rows * chunk.batch.steps * 2];
        Self {
            chunk,
            net,
            tape,
            outcome: Outcome { path, record: explain.then(|| Record::new(chunk)) },
            forces: vec![Vector2::zeros(); rows],
            sources: Vec::with_capacity(rows.max(chunk.neighbours.occupied.len())),
            heads: [&net.tau, &net.k, &net.k_line].map(|layers| HeadWork::new(layers)),
            encoders: [&net.enc_nei, &net.enc_line].map(|layers| Workspace::forward(layers, BLOCK)),
            features: Aligned::zeros(most * LINE),
            latents: Aligned::zeros(most * width),
            latent: Aligned::zeros(rows * width),
            goal_latent,
            width,
        }
    }

    fn run(mut self) -> Outcome {
        for step in 0..self.chunk.batch.steps {
            if step % self.chunk.batch.period == 0 {
                self.networks(step, step / self.chunk.batch.period);
            }
            self.physics(step, step / self.chunk.batch.period);
        }
        self.outcome
    }

    /// Sets `tau` and the strengths from the state at `step`.
    fn networks(&mut self, step: usize, run: usize) {
        let (net, chunk, width) = (self.net, self.chunk, self.width);
        if run > 0 {
            let (motion, scaled) = (self.tape.motion.at(step), self.tape.scaled.at_mut(run - 1));
            for (state, scaled) in motion.as_chunks::<4>().0.iter().zip(scaled.chunks_exact_mut(LINE)) {
                scale_into(scaled, *state, chunk.batch.scale);
            }
            let states = Rows { data: self.tape.scaled.at(run - 1), stride: LINE };
            for (history_encoder, future) in net.history_encoders.iter().zip(&mut self.tape.future) {
                if let Some(future) = future {
                    future.advance(history_encoder, run - 1, states);
                }
            }
        }
        if let Some(future) = &self.tape.future[0] {
            future.latent(&net.history_encoders[0], run, RowsMut { data: &mut self.latent, stride: width });
        }
        for (row, input) in self.tape.tau.input.at_mut(run).chunks_exact_mut(2 * width).enumerate() {
            input[..width].copy_from_slice(&self.latent[row * width..][..width]);
            input[width..].copy_from_slice(&self.goal_latent[row * width..][..width]);
        }
        self.tape.tau.forward(&net.tau, run, chunk.rows(), &mut self.heads[0]);

        if let Some(future) = &self.tape.future[1] {
            future.latent(&net.history_encoders[1], run, RowsMut { data: &mut self.latent, stride: width });
        }
        // All goals of a window set out from one state: the first run looks at one of them.
        let alike = |k: &HeadTape| run == 0 && !k.keep;
        if let Some(k) = &mut self.tape.k {
            let occupied = chunk.neighbours.occupied.len();
            neighbour_features(chunk, step, &mut self.features[..occupied * LINE]);
            let features = Rows { data: &self.features, stride: LINE };
            let latents = RowsMut { data: &mut self.latents, stride: width };
            mlp::forward(&net.enc_nei, &mut self.encoders[0], occupied, features, latents);
            let pairs = chunk.neighbours.distinct(alike(k));
            let entries = pairs.iter().zip(k.input.at_mut(run).chunks_exact_mut(2 * width));
            for (&(row, occupied), input) in entries {
                input[..width].copy_from_slice(&self.latent[row * width..][..width]);
                input[width..].copy_from_slice(&self.latents[occupied * width..][..width]);
            }
            k.forward(&net.k, run, pairs.len(), &mut self.heads[1]);
            if alike(k) {
                k.spread(run, chunk.neighbours.pairs.iter().map(|(_, occupied)| *occupied));
            }
        }
        if let Some(k) = &mut self.tape.k_line {
            let pairs = chunk.lines.distinct(alike(k));
            line_features(chunk, pairs, self.tape.motion.at(step), &mut self.features[..pairs.len() * LINE]);
            let features = Rows { data: &self.features, stride: LINE };
            let latents = RowsMut { data: &mut self.latents, stride: width };
            mlp::forward(&net.enc_line, &mut self.encoders[1], pairs.len(), features, latents);
            let entries = pairs.iter().zip(k.input.at_mut(run).chunks_exact_mut(2 * width));
            for ((&(row, _), input), line) in entries.zip(self.latents.chunks_exact(width)) {
                input[..width].copy_from_slice(&self.latent[row * width..][..width]);
                input[width..].copy_from_slice(line);
            }
            k.forward(&net.k_line, run, pairs.len(), &mut self.heads[2]);
            if alike(k) {
                k.spread(run, chunk.lines.pairs.iter().map(|(_, occupied)| *occupied));
            }
        }
    }

    /// Sets the forces on every row in `step`, recorded where that is asked for.
    fn act(&mut self, step: usize, run: usize) {
        let (chunk, batch) = (self.chunk, self.chunk.batch);
        self.forces.fill(Vector2::zeros());
        let mut adding = Adding {
            chunk,
            motion: self.tape.motion.at(step),
            forces: &mut self.forces,
            sources: &mut self.sources,
            record: self.outcome.record.as_mut(),
            step,
            done: 0,
        };
        let learned = Learned::of(batch, self.tape, run);
        adding.add(&GoalAttraction, Arity::One, |row| learned.tau(row));
        if batch.sizes.k {
            adding.add(&VehicleRepulsion, Arity::PerNeighbour, |pair| learned.k(pair));
        }
        if batch.sizes.k_line {
            adding.add(&LineRepulsion, Arity::PerLine, |pair| learned.k_line(pair));
        }
        for term in batch.terms.fixed.iter().filter(|term| batch.sizes.sources(term.descriptor.arity) > 0) {
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
            self.forces.iter().enumerate().zip(self.tape.motion.at_mut(step + 1).as_chunks_mut().0)
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
