//! The heads that end in one sigmoid a row, and their adjoint.

use gnp_nn::kernels::{Aligned, LINE, Pool, Rows, RowsMut, Scratch, Start, product, sigmoid};

use super::cuts::Cuts;
use super::layout::{Gradient, Packed};
use super::mlp::{self, BLOCK, Workspace};
use super::trace::Trace;

/// What a head leaves behind each time it runs; without rows it does not act.
#[derive(Debug, Default)]
pub(crate) struct HeadTape {
    rows: usize,
    pub(crate) keep: bool,
    /// `[rows, inputs]`, to be filled before each run.
    pub(crate) input: Trace,
    /// After the second and later hidden layers; the first is cheap and computed again. Without
    /// keeping, for one block of rows.
    hidden: Vec<Trace>,
    /// The sigmoid `[rows]`, kept always: the physics needs it where the head is not trained, too.
    value: Trace,
}

impl HeadTape {
    /// Room for `runs` runs on `rows` rows, all of them to be kept or not. What is not kept has room for `most` rows, so
    /// that batches of other neighbours find it large enough.
    pub(crate) fn reset(&mut self, pool: &Pool, layers: &[Packed], [rows, most]: [usize; 2], runs: usize, keep: bool) {
        (self.rows, self.keep) = (rows, keep);
        let (kept, rows) = if keep { (runs, rows) } else { (1, most) };
        if rows == 0 {
            return;
        }
        let room = if keep { rows } else { rows.min(BLOCK) };
        let inner = layers.get(1..layers.len().saturating_sub(1)).unwrap_or_default();
        self.input.reset(pool, kept, rows * layers.first().map_or(0, |layer| layer.inputs));
        self.hidden.resize_with(inner.len(), Trace::default);
        for (hidden, layer) in self.hidden.iter_mut().zip(inner) {
            hidden.reset(pool, kept, room * layer.outputs());
        }
        self.value.reset(pool, runs, rows);
    }

    pub(crate) fn acts(&self) -> bool {
        self.rows > 0
    }

    /// Runs the head on the first `count` rows of the input of `run`.
    pub(crate) fn forward(&mut self, layers: &[Packed], run: usize, count: usize, work: &mut HeadWork) {
        let Some(((outer, inner), last)) =
            layers.split_last().and_then(|(last, rest)| Some((rest.split_first()?, last)))
        else {
            return;
        };
        for first in (0..count).step_by(BLOCK) {
            let rows = BLOCK.min(count - first);
            let at = if self.keep { first } else { 0 };
            let x = Rows { data: &self.input.at(run)[first * outer.inputs..], stride: outer.inputs };
            layer(rows, x, outer, true, &mut work.first);
            for (i, inner) in inner.iter().enumerate() {
                let (before, after) = self.hidden.split_at_mut(i);
                let x = match before.last() {
                    Some(before) => &before.at(run)[at * inner.inputs..],
                    None => &work.first,
                };
                let y = &mut after[0].at_mut(run)[at * inner.outputs()..];
                layer(rows, Rows { data: x, stride: inner.inputs }, inner, true, y);
            }
            let x = match self.hidden.last() {
                Some(before) => &before.at(run)[at * last.inputs..],
                None => &work.first,
            };
            layer(rows, Rows { data: x, stride: last.inputs }, last, false, &mut work.result);
            let values = &mut self.value.at_mut(run)[first..first + rows];
            for (value, result) in values.iter_mut().zip(work.result.chunks_exact(LINE)) {
                *value = sigmoid(result[0]);
            }
        }
    }

    /// Gives every row the value of the one that `from` names, which does not come after it.
    pub(crate) fn spread(&mut self, run: usize, from: impl DoubleEndedIterator<Item = usize> + ExactSizeIterator) {
        let values = self.value.at_mut(run);
        // The last ones first: what is still to be read is not overwritten.
        for (row, from) in from.enumerate().rev() {
            values[row] = values[from];
        }
    }

    /// After a run on the rows of `some` alone, which are some of `all` in their order: moves the value of each to its place
    /// among all, and gives the others 0.
    pub(crate) fn scatter<T: PartialEq>(&mut self, run: usize, some: &[T], all: &[T]) {
        let values = self.value.at_mut(run);
        let mut left = some.len();
        // The last ones first, as in `spread`.
        for (row, pair) in all.iter().enumerate().rev() {
            let there = left > 0 && some[left - 1] == *pair;
            left -= usize::from(there);
            values[row] = if there { values[left] } else { 0. };
        }
    }

    /// The sigmoids of a run, those of its rows first; none where it does not act.
    pub(crate) fn value(&self, run: usize) -> &[f32] {
        if self.acts() { self.value.at(run) } else { &[] }
    }

    fn kept(&self, layers: &[Packed], run: usize, count: usize) -> Vec<Rows<'_>> {
        self.hidden
            .iter()
            .zip(&layers[1..])
            .map(|(trace, layer)| Rows { data: trace.span(run, count), stride: layer.outputs() })
            .collect()
    }

    pub(crate) fn into_buffers(self) -> impl Iterator<Item = Aligned> {
        [self.input, self.value].into_iter().chain(self.hidden).map(Trace::into_buffer)
    }
}

fn layer(rows: usize, x: Rows<'_>, layer: &Packed, relu: bool, y: &mut [f32]) {
    let y = RowsMut { data: y, stride: layer.outputs() };
    product(rows, x, &layer.forward, Start::Bias(&layer.bias), relu, y);
}

/// One block of rows after the first and after the last layer.
#[derive(Debug, Default)]
pub(crate) struct HeadWork {
    first: Aligned,
    result: Aligned,
}

impl HeadWork {
    pub(crate) fn reset(&mut self, layers: &[Packed]) {
        self.first.resize(BLOCK * layers.first().map_or(0, Packed::outputs));
        self.result.resize(BLOCK * LINE);
    }
}

/// The gradient on its way back through the runs of a head.
#[derive(Debug)]
pub(crate) struct HeadAdjoint {
    /// Runs whose weight gradients are summed at once.
    gather: usize,
    cuts: Cuts,
    work: Workspace,
    /// Of the input of the latest run, `[rows, inputs]`.
    pub(crate) dinput: Aligned,
}

impl HeadAdjoint {
    /// For rows that are cut into groups by `cuts`; the weight gradients of `gather` runs are summed at once.
    pub(crate) fn new(layers: &[Packed], tape: &HeadTape, cuts: Cuts, gather: usize) -> Self {
        Self {
            gather,
            cuts,
            work: Workspace::adjoint(layers, gather * tape.rows),
            dinput: Aligned::zeros(tape.rows * layers.first().map_or(0, |layer| layer.inputs)),
        }
    }

    /// Undoes run `run` of `runs` for the gradients `dvalue` `[rows]` of its sigmoids.
    pub(crate) fn run(
        &mut self,
        layers: &[Packed],
        tape: &HeadTape,
        (run, runs): (usize, usize),
        dvalue: &[f32],
        gradients: &mut [Gradient],
        scratch: &mut Scratch,
    ) {
        let Some(stride) = layers.first().map(|layer| layer.inputs) else { return };
        let at = run % self.gather * tape.rows;
        let delta = self.work.result_delta(layers, at, tape.rows);
        for ((delta, &dvalue), &value) in delta.chunks_exact_mut(LINE).zip(dvalue).zip(tape.value(run)) {
            delta[0] = dvalue * value * (1. - value);
        }
        let x = Rows { data: tape.input.at(run), stride };
        let dx = RowsMut { data: &mut self.dinput, stride };
        mlp::adjoint(layers, &mut self.work, at, tape.rows, x, &tape.kept(layers, run, 1), Some(dx));
        if run % self.gather == 0 {
            let count = self.gather.min(runs - run);
            let x = Rows { data: tape.input.span(run, count), stride };
            let kept = tape.kept(layers, run, count);
            mlp::add_gradients(layers, &self.work, count, &self.cuts, x, &kept, gradients, scratch);
        }
    }
}
