//! One chunk carried through all steps.

use gnp_force::nalgebra::{Point2, Vector2};
use gnp_force::{goal_force, line_force, vehicle_force};
use gnp_nn::kernels::{Aligned, LINE, Pool, Rows, RowsMut};

use super::batch::Chunk;
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

/// Parts of the roll-out as in [`crate::RollOut`], for the rows of a chunk.
#[derive(Debug, Default)]
pub(crate) struct Record {
    pub(crate) velocity: Vec<f32>,
    pub(crate) goal_force: Vec<f32>,
    pub(crate) tau: Vec<f32>,
    pub(crate) neighbour_forces: Vec<f32>,
    pub(crate) k: Vec<f32>,
    pub(crate) line_forces: Vec<f32>,
    pub(crate) k_line: Vec<f32>,
}

impl Record {
    fn new(chunk: &Chunk<'_>) -> Self {
        let sizes = chunk.batch.sizes;
        let zeros = |width: usize| vec![0.; chunk.rows() * chunk.batch.steps * width];
        Self {
            velocity: zeros(2),
            goal_force: zeros(2),
            tau: zeros(1),
            neighbour_forces: zeros(2 * sizes.slots),
            k: zeros(sizes.slots),
            line_forces: zeros(sizes.lines),
            k_line: zeros(sizes.lines),
        }
    }
}

impl Tape {
    fn new(chunk: &Chunk<'_>, net: &Net<Packed>, pool: &Pool, keep: bool) -> Self {
        let batch = chunk.batch;
        let (rows, runs, seen) = (chunk.rows(), batch.runs(), batch.seen());
        let (neighbours, lines) = (chunk.neighbours.pairs.len(), chunk.lines.pairs.len());
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

/// Distance and kind of each line that each row feels, `[pairs, LINE]`.
pub(crate) fn line_features(chunk: &Chunk<'_>, motion: &[f32], features: &mut [f32]) {
    for (&(row, occupied), features) in chunk.lines.pairs.iter().zip(features.chunks_exact_mut(LINE)) {
        let line = chunk.line(occupied);
        features[0] = motion[4 * row + 1] - line.y;
        features[1] = line.feature;
    }
}

/// Position and velocity of a row.
pub(crate) fn state_of(motion: &[f32], row: usize) -> (Point2<f32>, Vector2<f32>) {
    let at = 4 * row;
    (Point2::new(motion[at], motion[at + 1]), Vector2::new(motion[at + 2], motion[at + 3]))
}

/// The predicted steps of one chunk.
struct Drive<'a, 'b> {
    chunk: &'a Chunk<'b>,
    net: &'a Net<Packed>,
    tape: &'a mut Tape,
    outcome: Outcome,
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
        self.tape.tau.forward(&net.tau, run, &mut self.heads[0]);

        if let Some(future) = &self.tape.future[1] {
            future.latent(&net.history_encoders[1], run, RowsMut { data: &mut self.latent, stride: width });
        }
        if let Some(k) = &mut self.tape.k {
            let occupied = chunk.neighbours.occupied.len();
            neighbour_features(chunk, step, &mut self.features[..occupied * LINE]);
            let features = Rows { data: &self.features, stride: LINE };
            let latents = RowsMut { data: &mut self.latents, stride: width };
            mlp::forward(&net.enc_nei, &mut self.encoders[0], occupied, features, latents);
            let entries = chunk.neighbours.pairs.iter().zip(k.input.at_mut(run).chunks_exact_mut(2 * width));
            for (&(row, occupied), input) in entries {
                input[..width].copy_from_slice(&self.latent[row * width..][..width]);
                input[width..].copy_from_slice(&self.latents[occupied * width..][..width]);
            }
            k.forward(&net.k, run, &mut self.heads[1]);
        }
        if let Some(k) = &mut self.tape.k_line {
            let pairs = chunk.lines.pairs.len();
            line_features(chunk, self.tape.motion.at(step), &mut self.features[..pairs * LINE]);
            let features = Rows { data: &self.features, stride: LINE };
            let latents = RowsMut { data: &mut self.latents, stride: width };
            mlp::forward(&net.enc_line, &mut self.encoders[1], pairs, features, latents);
            let entries = chunk.lines.pairs.iter().zip(k.input.at_mut(run).chunks_exact_mut(2 * width));
            for ((&(row, _), input), line) in entries.zip(self.latents.chunks_exact(width)) {
                input[..width].copy_from_slice(&self.latent[row * width..][..width]);
                input[width..].copy_from_slice(line);
            }
            k.forward(&net.k_line, run, &mut self.heads[2]);
        }
    }

    /// Moves every row from `step` to the next.
    fn physics(&mut self, step: usize, run: usize) {
        let (chunk, batch) = (self.chunk, self.chunk.batch);
        let (dt, steps) = (batch.dt, batch.steps);
        let left = (steps - step) as f32 * dt;
        let motion = self.tape.motion.at(step);
        let mut forces = vec![Vector2::zeros(); chunk.rows()];
        for (row, force) in forces.iter_mut().enumerate() {
            let (p, v) = state_of(motion, row);
            let tau = batch.tau_max * self.tape.tau.value(run)[row] + dt;
            *force = goal_force(p, v, Point2::from(chunk.goal(row)), left, tau);
            if let Some(record) = &mut self.outcome.record {
                let at = row * steps + step;
                record.tau[at] = tau;
                record.goal_force[2 * at..2 * at + 2].copy_from_slice(force.as_slice());
            }
        }
        if let Some(k) = &self.tape.k {
            for (&(row, occupied), &share) in chunk.neighbours.pairs.iter().zip(k.value(run)) {
                let [x, y, ..] = chunk.neighbour(step, occupied);
                let k = batch.k_max * share;
                let force = vehicle_force(state_of(motion, row).0 - Point2::new(x, y), k, batch.r_col);
                forces[row] += force;
                if let Some(record) = &mut self.outcome.record {
                    let at = (row * steps + step) * batch.sizes.slots + chunk.neighbours.occupied[occupied].1;
                    record.k[at] = k;
                    record.neighbour_forces[2 * at..2 * at + 2].copy_from_slice(force.as_slice());
                }
            }
        }
        if let Some(k) = &self.tape.k_line {
            for (&(row, occupied), &share) in chunk.lines.pairs.iter().zip(k.value(run)) {
                let line = chunk.line(occupied);
                let k = batch.k_max_line * share;
                let force = line_force(line.kind, motion[4 * row + 1] - line.y, k, line.side);
                forces[row].y += force;
                if let Some(record) = &mut self.outcome.record {
                    let at = (row * steps + step) * batch.sizes.lines + chunk.lines.occupied[occupied].1;
                    record.k_line[at] = k;
                    record.line_forces[at] = force;
                }
            }
        }
        self.tape.motion.carry(step);
        for ((row, force), state) in forces.iter().enumerate().zip(self.tape.motion.at_mut(step + 1).as_chunks_mut().0)
        {
            let [x, y, vx, vy] = state;
            let faster = [*vx + force.x * dt, *vy + force.y * dt];
            let moving = match batch.integrator {
                Integrator::Explicit => [*vx, *vy],
                Integrator::SemiImplicit => faster,
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
