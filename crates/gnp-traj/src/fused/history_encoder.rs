//! Embedding, LSTM and latent of a history, and their adjoint.

use gnp_nn::kernels::{Aligned, Pool, Rows, RowsMut, Scratch, Start, lstm, lstm_adjoint, product, relu_adjoint};

use super::cuts::Cuts;
use super::layout::{Gradient, HistoryEncoder, Packed};
use super::trace::Trace;

/// What an LSTM leaves behind on its way through some steps; without rows it does not act.
#[derive(Debug, Default)]
pub(crate) struct HistoryTape {
    rows: usize,
    /// Width of the embedding, and of the memory.
    widths: (usize, usize),
    /// Embedding and output of the step before `[rows, embedding + hidden]`, one more than steps.
    input: Trace,
    /// `[rows, 4 * hidden]`
    gates: Trace,
    /// `[rows, hidden]`, one more than steps.
    cell: Trace,
}

impl HistoryTape {
    /// Room for `steps` steps, all of them to be kept or not; it starts without any memory of what it saw.
    pub(crate) fn reset(
        &mut self,
        pool: &Pool,
        history_encoder: &HistoryEncoder<Packed>,
        rows: usize,
        steps: usize,
        keep: bool,
    ) {
        let (embedding, hidden) =
            (history_encoder.emb.outputs(), history_encoder.cell.inputs - history_encoder.emb.outputs());
        let kept = |steps: usize| if keep { steps } else { steps.min(2) };
        (self.rows, self.widths) = (rows, (embedding, hidden));
        if rows == 0 {
            return;
        }
        self.input.reset(pool, kept(steps + 1), rows * (embedding + hidden));
        self.gates.reset(pool, if keep { steps.max(1) } else { 1 }, rows * 4 * hidden);
        self.cell.reset(pool, kept(steps + 1), rows * hidden);
        self.input.at_mut(0).fill(0.);
        self.cell.at_mut(0).fill(0.);
    }

    pub(crate) fn acts(&self) -> bool {
        self.rows > 0
    }

    /// Takes in the scaled states `[rows, 4]` of step `step`.
    pub(crate) fn advance(&mut self, history_encoder: &HistoryEncoder<Packed>, step: usize, states: Rows<'_>) {
        let (embedding, hidden) = self.widths;
        let stride = embedding + hidden;
        let input = RowsMut { data: self.input.at_mut(step), stride };
        product(self.rows, states, &history_encoder.emb.forward, Start::Bias(&history_encoder.emb.bias), true, input);
        let input = Rows { data: self.input.at(step), stride };
        let gates = RowsMut { data: self.gates.at_mut(step), stride: 4 * hidden };
        product(self.rows, input, &history_encoder.cell.forward, Start::Bias(&history_encoder.cell.bias), false, gates);
        self.cell.carry(step);
        let h = RowsMut { data: &mut self.input.at_mut(step + 1)[embedding..], stride };
        lstm(hidden, self.gates.at_mut(step), self.cell.at_mut(step + 1), h);
    }

    /// The output after `steps` steps, `[rows, hidden]`.
    fn output(&self, steps: usize) -> Rows<'_> {
        let (embedding, hidden) = self.widths;
        Rows { data: &self.input.at(steps)[embedding..], stride: embedding + hidden }
    }

    /// Starts from what `history` remembers after `steps` steps, each of its rows `goals` times.
    pub(crate) fn start_from(&mut self, history: &Self, steps: usize, goals: usize) {
        let (embedding, hidden) = self.widths;
        let (output, cell) = (history.output(steps), history.cell.at(steps));
        for row in 0..self.rows {
            let from = row / goals;
            let h = &output.data[from * output.stride..][..hidden];
            self.input.at_mut(0)[row * (embedding + hidden) + embedding..][..hidden].copy_from_slice(h);
            self.cell.at_mut(0)[row * hidden..][..hidden].copy_from_slice(&cell[from * hidden..][..hidden]);
        }
    }

    /// The latent `[rows, latent]` after `steps` steps.
    pub(crate) fn latent(&self, history_encoder: &HistoryEncoder<Packed>, steps: usize, latent: RowsMut<'_>) {
        product(
            self.rows,
            self.output(steps),
            &history_encoder.out.forward,
            Start::Bias(&history_encoder.out.bias),
            false,
            latent,
        );
    }

    pub(crate) fn into_buffers(self) -> [Aligned; 3] {
        [self.input.into_buffer(), self.gates.into_buffer(), self.cell.into_buffer()]
    }
}

/// The gradient on its way back through the steps of a [`HistoryTape`].
#[derive(Debug)]
pub(crate) struct HistoryAdjoint {
    /// Steps whose weight gradients are summed at once.
    gather: usize,
    /// Of the rows of a step.
    cuts: Cuts,
    /// Of the output and the cell after the step to undo next, `[rows, hidden]`.
    dh: Aligned,
    dcell: Aligned,
    /// Of the cell's input, `[rows, embedding + hidden]`.
    dinput: Aligned,
    /// Of the embedding before its ReLU, `[gather * rows, embedding]`.
    demb: Aligned,
}

impl HistoryAdjoint {
    /// For rows that are cut into groups by `cuts`; the weight gradients of `gather` steps are summed at once.
    pub(crate) fn new(tape: &HistoryTape, cuts: Cuts, gather: usize) -> Self {
        let (embedding, hidden) = tape.widths;
        Self {
            gather,
            cuts,
            dh: Aligned::zeros(tape.rows * hidden),
            dcell: Aligned::zeros(tape.rows * hidden),
            dinput: Aligned::zeros(tape.rows * (embedding + hidden)),
            demb: Aligned::zeros(gather * tape.rows * embedding),
        }
    }

    /// Takes in the gradient `dlatent` `[rows, latent]` of the latent after `steps` steps.
    pub(crate) fn latent(
        &mut self,
        history_encoder: &HistoryEncoder<Packed>,
        tape: &HistoryTape,
        steps: usize,
        dlatent: Rows<'_>,
        gradient: &mut HistoryEncoder<Gradient>,
        scratch: &mut Scratch,
    ) {
        let dh = RowsMut { data: &mut self.dh, stride: tape.widths.1 };
        product(tape.rows, dlatent, &history_encoder.out.backward, Start::Sum, false, dh);
        gradient.out.add(1, &self.cuts, dlatent, tape.output(steps), scratch);
    }

    /// Undoes step `step` of `steps`; `states` is the trace of scaled states that were taken in, and
    /// `dstates` `[rows, ..]` receives their gradient.
    #[expect(clippy::too_many_arguments, reason = "one step touches everything once")]
    pub(crate) fn step(
        &mut self,
        history_encoder: &HistoryEncoder<Packed>,
        tape: &mut HistoryTape,
        (step, steps): (usize, usize),
        states: &Trace,
        dstates: Option<RowsMut<'_>>,
        gradient: &mut HistoryEncoder<Gradient>,
        scratch: &mut Scratch,
    ) {
        let (embedding, hidden) = tape.widths;
        let (rows, stride) = (tape.rows, embedding + hidden);
        let dh = Rows { data: &self.dh, stride: hidden };
        let gates = tape.gates.at_mut(step);
        lstm_adjoint(hidden, gates, tape.cell.at(step), tape.cell.at(step + 1), dh, &mut self.dcell);
        let dgates = Rows { data: tape.gates.at(step), stride: 4 * hidden };
        let dinput = RowsMut { data: &mut self.dinput, stride };
        product(rows, dgates, &history_encoder.cell.backward, Start::Zero, false, dinput);
        let demb = &mut self.demb[step % self.gather * rows * embedding..][..rows * embedding];
        for row in 0..rows {
            let dinput = &self.dinput[row * stride..][..stride];
            demb[row * embedding..][..embedding].copy_from_slice(&dinput[..embedding]);
            self.dh[row * hidden..][..hidden].copy_from_slice(&dinput[embedding..]);
        }
        relu_adjoint(embedding, demb, Rows { data: tape.input.at(step), stride });
        if let Some(dstates) = dstates {
            let demb = Rows { data: demb, stride: embedding };
            product(rows, demb, &history_encoder.emb.backward, Start::Zero, false, dstates);
        }
        if step % self.gather == 0 {
            let count = self.gather.min(steps - step);
            let dgates = Rows { data: tape.gates.span(step, count), stride: 4 * hidden };
            let input = Rows { data: tape.input.span(step, count), stride };
            gradient.cell.add(count, &self.cuts, dgates, input, scratch);
            let demb = Rows { data: &self.demb, stride: embedding };
            let states = Rows { data: states.span(step, count), stride: history_encoder.emb.inputs };
            gradient.emb.add(count, &self.cuts, demb, states, scratch);
        }
    }

    /// Goes over from the roll-out to the history it started from: rows of one window add up.
    pub(crate) fn into_history(self, history: &HistoryTape, goals: usize, cuts: Cuts, gather: usize) -> Self {
        let hidden = history.widths.1;
        let mut adjoint = Self::new(history, cuts, gather);
        for (sum, from) in [(&mut adjoint.dh, &self.dh), (&mut adjoint.dcell, &self.dcell)] {
            for (row, from) in from.chunks_exact(hidden).enumerate() {
                for (sum, from) in sum[row / goals * hidden..][..hidden].iter_mut().zip(from) {
                    *sum += from;
                }
            }
        }
        adjoint
    }
}
