//! The adjoint of one chunk's roll-out: from the gradient of its path to those of all weights.

use gnp_force::na::Vector2;
use gnp_force::{Arity, ForceTerm, GoalAttraction, LineRepulsion, TermVjp, VehicleRepulsion};
use gnp_nn::kernels::{Aligned, LINE, Rows, RowsMut, Scratch};

use super::batch::{Chunk, Pair};
use super::cuts::Cuts;
use super::forward::{Learned, Tape, line_features, neighbour_features, state_of, trained};
use super::head::HeadAdjoint;
use super::history_encoder::HistoryAdjoint;
use super::layout::{Gradient, Net, Packed};
use super::mlp::{self, BLOCK, Workspace};
use crate::Integrator;

/// The gradient in what a chunk is given.
#[derive(Debug)]
pub(crate) struct InputGradient {
    /// `[rows, 2]`
    pub(crate) goals: Vec<f32>,
    /// `[windows, t_obs, 4]`
    pub(crate) observed: Vec<f32>,
}

/// Adds the weight gradients for the gradient `dpath` `[rows, steps, 2]` of the path of a chunk, which
/// `tape` remembers; the tape is used up. Returns the gradient in goals and observations where it is wanted.
pub(crate) fn adjoint(
    chunk: &Chunk<'_>,
    net: &Net<Packed>,
    tape: &mut Tape,
    dpath: &[f32],
    gradient: &mut Net<Gradient>,
    inputs: bool,
) -> Option<InputGradient> {
    let mut back = Back::new(chunk, net, tape);
    for step in (0..chunk.batch.steps).rev() {
        let run = step / chunk.batch.period;
        back.physics(tape, step, run, dpath);
        if step % chunk.batch.period == 0 {
            back.networks(tape, step, run, gradient);
        }
    }
    back.history(tape, gradient, inputs)
}

/// Gradients on their way back through the steps of one chunk.
struct Back<'a, 'b> {
    chunk: &'a Chunk<'b>,
    net: &'a Net<Packed>,
    /// Of the states `[rows, (position, velocity)]` before the step to undo next.
    dmotion: Vec<(Vector2<f32>, Vector2<f32>)>,
    /// Of the goals by row, through the attraction.
    dgoals: Vec<Vector2<f32>>,
    /// Of `tau` and of the shares of the largest strengths, since the networks last ran.
    dtau: Vec<f32>,
    dk: Vec<f32>,
    dk_line: Vec<f32>,
    history_encoders: [Option<HistoryAdjoint>; 2],
    tau: Option<HeadAdjoint>,
    k: Option<HeadAdjoint>,
    k_line: Option<HeadAdjoint>,
    encoders: [Workspace; 2],
    /// Of the latents of goals `[rows, latent]`, over all steps.
    dgoal: Aligned,
    /// Of the latent of the history `[rows, latent]` at one step.
    dlatent: Aligned,
    /// Features at one step and the gradients of their latents.
    features: Aligned,
    dlatents: Aligned,
    /// Of features, and of scaled states `[.., LINE]`.
    dfeatures: Aligned,
    dscaled: Aligned,
    scratch: Scratch,
    /// Groups of windows, rows, occupied neighbour slots and pairs with lines.
    windows: Cuts,
    rows: Cuts,
    occupied: Cuts,
    line_pairs: Cuts,
    /// Width of a latent.
    width: usize,
}

impl<'a, 'b> Back<'a, 'b> {
    fn new(chunk: &'a Chunk<'b>, net: &'a Net<Packed>, tape: &Tape) -> Self {
        let (rows, width, phase) = (chunk.rows(), net.history_encoders[0].out.outputs(), chunk.batch.phase);
        let (neighbours, lines) = chunk.learned_pairs();
        let most = chunk.neighbours.occupied.len().max(lines);
        let gather = chunk.batch.gather;
        let [windows, all] = chunk.cuts();
        let [occupied, pairs] = chunk.cuts_of(&chunk.neighbours);
        let [_, line_pairs] = chunk.cuts_of(&chunk.lines);
        let history_encoder = |i: usize| {
            let tape = Some(&tape.future[i]).filter(|tape| tape.acts() && trained(phase, i));
            tape.map(|tape| HistoryAdjoint::new(tape, all.clone(), gather.rows))
        };
        Self {
            chunk,
            net,
            dmotion: vec![(Vector2::zeros(), Vector2::zeros()); rows],
            dgoals: vec![Vector2::zeros(); rows],
            dtau: vec![0.; rows],
            dk: vec![0.; neighbours],
            dk_line: vec![0.; lines],
            history_encoders: [0, 1].map(history_encoder),
            tau: (tape.tau.acts() && trained(phase, 0))
                .then(|| HeadAdjoint::new(&net.tau, &tape.tau, all.clone(), gather.rows)),
            k: tape.k.acts().then(|| HeadAdjoint::new(&net.k, &tape.k, pairs, gather.neighbours)),
            k_line: tape
                .k_line
                .acts()
                .then(|| HeadAdjoint::new(&net.k_line, &tape.k_line, line_pairs.clone(), gather.lines)),
            encoders: [&net.enc_nei, &net.enc_line].map(|layers| Workspace::adjoint(layers, 2 * BLOCK)),
            dgoal: Aligned::zeros(rows * width),
            dlatent: Aligned::zeros(rows * width),
            features: Aligned::zeros(most * LINE),
            dlatents: Aligned::zeros(most * width),
            dfeatures: Aligned::zeros(lines * LINE),
            dscaled: Aligned::zeros(rows * LINE),
            scratch: Scratch::default(),
            windows,
            rows: all,
            occupied,
            line_pairs,
            width,
        }
    }

    /// Undoes the motion from `step` to the next.
    fn physics(&mut self, tape: &Tape, step: usize, run: usize, dpath: &[f32]) {
        let (chunk, batch) = (self.chunk, self.chunk.batch);
        let dt = batch.dt;
        let motion = tape.motion.at(step);
        let mut dforces = Vec::with_capacity(chunk.rows());
        for (row, (dp, dv)) in self.dmotion.iter_mut().enumerate() {
            let at = 2 * (row * batch.steps + step);
            *dp += Vector2::new(dpath[at], dpath[at + 1]);
            dforces.push(match batch.integrator {
                Integrator::ExplicitEuler => *dv * dt,
                _ => (*dv + *dp * dt) * dt,
            });
            *dv += *dp * dt;
        }
        let mut undoing = Undoing { chunk, step, motion, dforces: &dforces, dmotion: &mut self.dmotion };
        let learned = Learned::of(batch, tape, run);
        if tape.tau.acts() {
            let (dgoals, dtau) = (&mut self.dgoals, &mut self.dtau);
            undoing.undo(
                &GoalAttraction,
                Arity::One,
                |row| learned.tau(row),
                |row, vjp, parameters| {
                    dgoals[row] += vjp.source_position;
                    dtau[row] += parameters[0] * batch.tau_max;
                },
            );
        }
        if tape.k.acts() {
            let dk = &mut self.dk;
            undoing.undo(
                &VehicleRepulsion,
                Arity::PerNeighbour,
                |pair| learned.k(pair),
                |i, _, parameters| {
                    dk[i] += parameters[0] * batch.k_max;
                },
            );
        }
        if tape.k_line.acts() {
            let dk = &mut self.dk_line;
            undoing.undo(
                &LineRepulsion,
                Arity::PerLine,
                |pair| learned.k_line(pair),
                |i, _, parameters| {
                    dk[i] += parameters[0] * batch.k_max_line;
                },
            );
        }
        for term in batch.terms.fixed() {
            let arity = term.descriptor.arity;
            undoing.undo(
                &*term.law,
                arity,
                |_| &term.parameters,
                |row, vjp, _| {
                    // Goals come row by row; neighbours and lines ask for no gradient here.
                    if arity == Arity::One {
                        self.dgoals[row] += vjp.source_position;
                    }
                },
            );
        }
    }

    /// Undoes the run of the networks before `step`.
    fn networks(&mut self, tape: &mut Tape, step: usize, run: usize, gradient: &mut Net<Gradient>) {
        let (net, width, runs) = (self.net, self.width, self.chunk.batch.runs());
        if let (Some(head), Some(history_encoder)) = (&mut self.tau, &mut self.history_encoders[0]) {
            head.run(&net.tau, &tape.tau, (run, runs), &self.dtau, &mut gradient.tau, &mut self.scratch);
            for (row, dinput) in head.dinput.chunks_exact(2 * width).enumerate() {
                self.dlatent[row * width..][..width].copy_from_slice(&dinput[..width]);
                add(&mut self.dgoal[row * width..][..width], &dinput[width..]);
            }
            let dlatent = Rows { data: &self.dlatent, stride: width };
            history_encoder.latent(
                &net.history_encoders[0],
                &tape.future[0],
                run,
                dlatent,
                &mut gradient.history_encoders[0],
                &mut self.scratch,
            );
        }
        self.dlatent.fill(0.);
        self.neighbours(tape, step, run, gradient);
        self.lines(tape, step, run, gradient);
        if let Some(history_encoder) = &mut self.history_encoders[1] {
            let dlatent = Rows { data: &self.dlatent, stride: width };
            history_encoder.latent(
                &net.history_encoders[1],
                &tape.future[1],
                run,
                dlatent,
                &mut gradient.history_encoders[1],
                &mut self.scratch,
            );
        }
        for dvalue in [&mut self.dtau, &mut self.dk, &mut self.dk_line] {
            dvalue.fill(0.);
        }
        if run == 0 {
            return;
        }
        for i in 0..2 {
            if let Some(history_encoder) = &mut self.history_encoders[i] {
                let dscaled = RowsMut { data: &mut self.dscaled, stride: LINE };
                let (steps, gradient) = ((run - 1, runs - 1), &mut gradient.history_encoders[i]);
                history_encoder.step(
                    &net.history_encoders[i],
                    &mut tape.future[i],
                    steps,
                    &tape.scaled,
                    Some(dscaled),
                    gradient,
                    &mut self.scratch,
                );
                let scale = self.chunk.batch.scale;
                for ((dp, dv), d) in self.dmotion.iter_mut().zip(self.dscaled.chunks_exact(LINE)) {
                    *dp += Vector2::new(d[0] * scale[0], d[1] * scale[1]);
                    *dv += Vector2::new(d[2] * scale[2], d[3] * scale[3]);
                }
            }
        }
    }

    /// Undoes the head and the encoder of neighbours.
    fn neighbours(&mut self, tape: &Tape, step: usize, run: usize, gradient: &mut Net<Gradient>) {
        let Some(head) = &mut self.k else { return };
        let (net, chunk, width) = (self.net, self.chunk, self.width);
        head.run(&net.k, &tape.k, (run, chunk.batch.runs()), &self.dk, &mut gradient.k, &mut self.scratch);
        let occupied = chunk.neighbours.occupied.len();
        self.dlatents[..occupied * width].fill(0.);
        for (&(row, occupied), dinput) in chunk.neighbours.pairs.iter().zip(head.dinput.chunks_exact(2 * width)) {
            add(&mut self.dlatent[row * width..][..width], &dinput[..width]);
            add(&mut self.dlatents[occupied * width..][..width], &dinput[width..]);
        }
        neighbour_features(chunk, step, &mut self.features[..occupied * LINE]);
        let (features, dlatents) =
            (Rows { data: &self.features, stride: LINE }, Rows { data: &self.dlatents, stride: width });
        let (work, sums) = (&mut self.encoders[0], &mut gradient.enc_nei);
        mlp::adjoint_alone(&net.enc_nei, work, &self.occupied, features, dlatents, None, sums, &mut self.scratch);
    }

    /// Undoes the head and the encoder of lines.
    fn lines(&mut self, tape: &Tape, step: usize, run: usize, gradient: &mut Net<Gradient>) {
        let Some(head) = &mut self.k_line else { return };
        let (net, chunk, width) = (self.net, self.chunk, self.width);
        head.run(
            &net.k_line,
            &tape.k_line,
            (run, chunk.batch.runs()),
            &self.dk_line,
            &mut gradient.k_line,
            &mut self.scratch,
        );
        let pairs = &chunk.lines.pairs;
        let entries = pairs.iter().zip(head.dinput.chunks_exact(2 * width)).zip(self.dlatents.chunks_exact_mut(width));
        for ((&(row, _), dinput), dlatent) in entries {
            add(&mut self.dlatent[row * width..][..width], &dinput[..width]);
            dlatent.copy_from_slice(&dinput[width..]);
        }
        line_features(chunk, pairs, tape.motion.at(step), &mut self.features[..pairs.len() * LINE]);
        let (features, dlatents) =
            (Rows { data: &self.features, stride: LINE }, Rows { data: &self.dlatents, stride: width });
        let dfeatures = RowsMut { data: &mut self.dfeatures, stride: LINE };
        let (work, sums) = (&mut self.encoders[1], &mut gradient.enc_line);
        mlp::adjoint_alone(
            &net.enc_line,
            work,
            &self.line_pairs,
            features,
            dlatents,
            Some(dfeatures),
            sums,
            &mut self.scratch,
        );
        for (&(row, _), dfeatures) in pairs.iter().zip(self.dfeatures.chunks_exact(LINE)) {
            self.dmotion[row].0.y += dfeatures[0];
        }
    }

    /// Undoes the observed frames and the encoder of goals.
    fn history(mut self, tape: &mut Tape, gradient: &mut Net<Gradient>, inputs: bool) -> Option<InputGradient> {
        let (net, chunk, batch) = (self.net, self.chunk, self.chunk.batch);
        let (frames, goals) = (batch.sizes.observed, batch.sizes.goals);
        let mut dinputs = inputs.then(|| self.start());
        let mut dstates = Aligned::zeros(if inputs { chunk.count() * LINE } else { 0 });
        for (i, history_encoder) in self.history_encoders.into_iter().enumerate() {
            let Some(history_encoder) = history_encoder else { continue };
            let history = &mut tape.history[i];
            let cuts = self.windows.clone();
            let mut history_encoder = history_encoder.into_history(history, goals, cuts, batch.gather.windows);
            for step in (0..batch.seen()).rev() {
                let (steps, gradient) = ((step, batch.seen()), &mut gradient.history_encoders[i]);
                let wanted = inputs.then_some(RowsMut { data: &mut dstates, stride: LINE });
                history_encoder.step(
                    &net.history_encoders[i],
                    history,
                    steps,
                    &tape.seen,
                    wanted,
                    gradient,
                    &mut self.scratch,
                );
                if let Some(dinputs) = &mut dinputs {
                    for (window, d) in dstates.chunks_exact(LINE).enumerate() {
                        let at = 4 * (window * frames + batch.frame(step));
                        add_scaled(&mut dinputs.observed[at..at + 4], d, batch.scale);
                    }
                }
            }
        }
        if self.tau.is_some() {
            let rows = chunk.rows();
            let mut work = Workspace::adjoint(&net.enc_goal, 2 * BLOCK);
            let (goals, dgoal) =
                (Rows { data: &tape.goals, stride: LINE }, Rows { data: &self.dgoal, stride: self.width });
            let mut dfeatures = Aligned::zeros(if inputs { rows * LINE } else { 0 });
            let wanted = inputs.then_some(RowsMut { data: &mut dfeatures, stride: LINE });
            let sums = &mut gradient.enc_goal;
            mlp::adjoint_alone(&net.enc_goal, &mut work, &self.rows, goals, dgoal, wanted, sums, &mut self.scratch);
            if let Some(dinputs) = &mut dinputs {
                for (dgoal, d) in dinputs.goals.chunks_exact_mut(2).zip(dfeatures.chunks_exact(LINE)) {
                    add_scaled(dgoal, d, batch.scale);
                }
            }
        }
        dinputs
    }

    /// The gradient in goals and observations without the networks': of the attraction, and of where the rows start.
    fn start(&self) -> InputGradient {
        let (frames, goals) = (self.chunk.batch.sizes.observed, self.chunk.batch.sizes.goals);
        let mut observed = vec![0.; self.chunk.count() * frames * 4];
        for (row, (dp, dv)) in self.dmotion.iter().enumerate() {
            let at = 4 * ((row / goals + 1) * frames - 1);
            add(&mut observed[at..at + 4], &[dp.x, dp.y, dv.x, dv.y]);
        }
        InputGradient { goals: self.dgoals.iter().flat_map(|d| [d.x, d.y]).collect(), observed }
    }
}

/// A step while the gradients of its forces are undone, term by term.
struct Undoing<'a, 'b> {
    chunk: &'a Chunk<'b>,
    step: usize,
    motion: &'a [f32],
    dforces: &'a [Vector2<f32>],
    dmotion: &'a mut [(Vector2<f32>, Vector2<f32>)],
}

impl Undoing<'_, '_> {
    /// A term with the parameters of each pair; `take` is given the rest of the gradient, with that of the parameters.
    fn undo<L, P>(
        &mut self,
        law: &L,
        arity: Arity,
        parameters: impl Fn(usize) -> P,
        mut take: impl FnMut(usize, &TermVjp<f32>, &[f32]),
    ) where
        L: ForceTerm<f32> + ?Sized,
        P: AsRef<[f32]>,
    {
        let mut dparameters = vec![0.; law.descriptor().parameters.len()];
        let sources: Vec<_> = self.chunk.sources(arity, self.step).collect();
        for (i, Pair { row, from, .. }) in self.chunk.pairs(arity, &sources).enumerate() {
            let state = state_of(self.motion, row);
            let vjp = law.vjp(&state, from, parameters(i).as_ref(), self.dforces[row], &mut dparameters);
            let (dp, dv) = &mut self.dmotion[row];
            *dp += vjp.position;
            *dv += vjp.velocity;
            take(i, &vjp, &dparameters);
        }
    }
}

/// `sum += scale * x`, value by value, as long as `sum` is.
fn add_scaled(sum: &mut [f32], x: &[f32], scale: [f32; 4]) {
    for ((sum, x), scale) in sum.iter_mut().zip(x).zip(scale) {
        *sum += x * scale;
    }
}

/// `sum += x`, value by value.
fn add(sum: &mut [f32], x: &[f32]) {
    for (sum, x) in sum.iter_mut().zip(x) {
        *sum += x;
    }
}
