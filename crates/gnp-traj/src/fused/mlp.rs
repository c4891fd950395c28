//! Linear layers with ReLU between them, on blocks of rows that stay in the cache.

use gnp_nn::kernels::{Aligned, Rows, RowsMut, Scratch, Start, product, relu_adjoint};

use super::cuts::Cuts;
use super::layout::{Gradient, Packed};

/// Rows that go through all layers before the next ones do.
pub(crate) const BLOCK: usize = 96;

/// What the layers hold for up to `capacity` rows: values after each hidden layer and gradients of what
/// each layer gives.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    capacity: usize,
    values: Vec<Aligned>,
    deltas: Vec<Aligned>,
}

impl Workspace {
    /// For values alone.
    pub(crate) fn forward(layers: &[Packed], capacity: usize) -> Self {
        let mut work = Self::default();
        work.reset(layers, capacity);
        work
    }

    /// [`Workspace::forward`] in the memory of this one, where that suffices.
    pub(crate) fn reset(&mut self, layers: &[Packed], capacity: usize) {
        self.capacity = capacity;
        self.values.resize_with(layers.len(), Aligned::default);
        for (values, layer) in self.values.iter_mut().zip(layers) {
            values.resize(capacity * layer.outputs());
        }
    }

    /// For values and gradients.
    pub(crate) fn adjoint(layers: &[Packed], capacity: usize) -> Self {
        let deltas = layers.iter().map(|layer| Aligned::zeros(capacity * layer.outputs())).collect();
        Self { deltas, ..Self::forward(layers, capacity) }
    }

    /// Where the gradient of the result goes before [`adjoint`]: `count` rows from row `at` on.
    pub(crate) fn result_delta(&mut self, layers: &[Packed], at: usize, count: usize) -> &mut [f32] {
        let (last, width) = (layers.len() - 1, layers[layers.len() - 1].outputs());
        &mut self.deltas[last][at * width..(at + count) * width]
    }
}

/// The result of the layers on `count` rows, in blocks.
pub(crate) fn forward(layers: &[Packed], work: &mut Workspace, count: usize, x: Rows<'_>, y: RowsMut<'_>) {
    let last = layers.len() - 1;
    for first in (0..count).step_by(work.capacity) {
        let rows = work.capacity.min(count - first);
        let x = Rows { data: &x.data[first * x.stride..], stride: x.stride };
        hidden(layers, &mut work.values, 0, last, rows, x);
        let y = RowsMut { data: &mut y.data[first * y.stride..], stride: y.stride };
        let x = if last == 0 { x } else { rows_of(&work.values[last - 1], layers, last - 1, 0) };
        product(rows, x, &layers[last].forward, Start::Bias(&layers[last].bias), false, y);
    }
}

/// The values after the layers before `end`, at row `at` of `values`.
fn hidden(layers: &[Packed], values: &mut [Aligned], at: usize, end: usize, rows: usize, x: Rows<'_>) {
    for i in 0..end {
        let (before, rest) = values.split_at_mut(i);
        let x = if i == 0 { x } else { rows_of(&before[i - 1], layers, i - 1, at) };
        let width = layers[i].outputs();
        let y = RowsMut { data: &mut rest[0][at * width..], stride: width };
        product(rows, x, &layers[i].forward, Start::Bias(&layers[i].bias), true, y);
    }
}

/// The rows from `at` on of what layer `i` gives.
fn rows_of<'a>(values: &'a [f32], layers: &[Packed], i: usize, at: usize) -> Rows<'a> {
    let stride = layers[i].outputs();
    Rows { data: &values[at * stride..], stride }
}

/// Passes the gradient of the result, in [`Workspace::result_delta`], back to the inputs `x` `[count, ..]`,
/// leaving every layer's in `work` at row `at` on.
///
/// `kept` are the values after the second and later hidden layers; without them, and for the first
/// layer, which is cheap, they are computed again.
pub(crate) fn adjoint(
    layers: &[Packed],
    work: &mut Workspace,
    at: usize,
    count: usize,
    x: Rows<'_>,
    kept: &[Rows<'_>],
    dx: Option<RowsMut<'_>>,
) {
    let last = layers.len() - 1;
    let end = if kept.is_empty() { last } else { last.min(1) };
    hidden(layers, &mut work.values, at, end, count, x);
    for i in (1..=last).rev() {
        let (before, after) = work.deltas.split_at_mut(i);
        let width = layers[i - 1].outputs();
        let gradient = &mut before[i - 1][at * width..(at + count) * width];
        let delta = rows_of(&after[0], layers, i, at);
        product(count, delta, &layers[i].backward, Start::Zero, false, RowsMut { data: gradient, stride: width });
        let value =
            if i == 1 || kept.is_empty() { rows_of(&work.values[i - 1], layers, i - 1, at) } else { kept[i - 2] };
        relu_adjoint(width, gradient, value);
    }
    if let Some(dx) = dx {
        product(count, rows_of(&work.deltas[0], layers, 0, at), &layers[0].backward, Start::Zero, false, dx);
    }
}

/// Adds the weight gradients of the first rows of `work`, `[steps, cuts.len()]`, whose inputs were `x` and whose
/// kept values were `kept`.
#[expect(clippy::too_many_arguments, reason = "one pass touches everything once")]
pub(crate) fn add_gradients(
    layers: &[Packed],
    work: &Workspace,
    steps: usize,
    cuts: &Cuts,
    x: Rows<'_>,
    kept: &[Rows<'_>],
    gradients: &mut [Gradient],
    scratch: &mut Scratch,
) {
    for (i, gradient) in gradients.iter_mut().enumerate() {
        let input = match i {
            0 => x,
            i if i == 1 || kept.is_empty() => rows_of(&work.values[i - 1], layers, i - 1, 0),
            i => kept[i - 2],
        };
        gradient.add(steps, cuts, rows_of(&work.deltas[i], layers, i, 0), input, scratch);
    }
}

/// Gradients of the weights for result gradients `dy` of rows that are cut into groups by `cuts`, with all values
/// computed again, in blocks.
#[expect(clippy::too_many_arguments, reason = "one pass touches everything once")]
pub(crate) fn adjoint_alone(
    layers: &[Packed],
    work: &mut Workspace,
    cuts: &Cuts,
    x: Rows<'_>,
    dy: Rows<'_>,
    mut dx: Option<RowsMut<'_>>,
    gradients: &mut [Gradient],
    scratch: &mut Scratch,
) {
    for first in (0..cuts.len()).step_by(work.capacity) {
        let rows = work.capacity.min(cuts.len() - first);
        let x = Rows { data: &x.data[first * x.stride..], stride: x.stride };
        let width = dy.stride;
        work.result_delta(layers, 0, rows).copy_from_slice(&dy.data[first * width..(first + rows) * width]);
        let dx = dx.as_mut().map(|dx| RowsMut { data: &mut dx.data[first * dx.stride..], stride: dx.stride });
        adjoint(layers, work, 0, rows, x, &[], dx);
        add_gradients(layers, work, 1, &cuts.within(first..first + rows), x, &[], gradients, scratch);
    }
}
