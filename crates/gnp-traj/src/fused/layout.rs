//! All weights as one flat vector with named views, and their packed form.

use std::convert::Infallible;
use std::ops::Range;

use gnp_nn::Precision;
use gnp_nn::kernels::{LINE, Panels, Picked, Rows, Scratch, outer_sum, padded};
use rayon::prelude::*;

use super::cuts::Cuts;
use crate::weights::Builder;
use crate::{Phase, TrajConfig};

pub(crate) use crate::weights::{HistoryEncoder, Net};

/// Where the weights of one affine map stand in the flat vector, and how they are padded: inputs and
/// outputs come in parts that each fill whole cache lines.
#[derive(Clone, Debug)]
pub(crate) struct Dense {
    inputs: Vec<Part>,
    /// Flat offsets of biases that are added up.
    biases: Vec<usize>,
    /// Number of parts of the outputs and width of each.
    outputs: (usize, usize),
}

/// Some inputs of a map: columns `column..column + width` of the matrix `[.., stride]` at `offset`.
#[derive(Clone, Debug)]
struct Part {
    offset: usize,
    stride: usize,
    column: usize,
    width: usize,
}

impl Dense {
    /// Padded number of inputs.
    pub(crate) fn inputs(&self) -> usize {
        self.inputs.iter().map(|part| padded(part.width)).sum()
    }

    /// Padded number of outputs.
    pub(crate) fn outputs(&self) -> usize {
        self.outputs.0 * padded(self.outputs.1)
    }

    /// Inputs up to the last that is not padding.
    fn depth(&self) -> usize {
        let last = self.inputs.last().map_or(0, |part| padded(part.width) - part.width);
        self.inputs() - last
    }

    /// Outputs up to the last that is not padding.
    fn used_outputs(&self) -> usize {
        let (parts, each) = self.outputs;
        parts.saturating_sub(1) * padded(each) + each
    }

    /// Whether its products are faster in bf16: rows of a line or two cost as much to round as that saves.
    fn gains_by_bf16(&self) -> bool {
        self.depth() > 2 * LINE && self.outputs() > LINE
    }

    /// Where its weights begin in the flat vector; they end where those of the next map begin.
    fn start(&self) -> usize {
        self.inputs.first().map_or(0, |part| part.offset)
    }

    /// Calls `f` with each stretch of weights: flat range, padded output, first padded input.
    fn stretches(&self, mut f: impl FnMut(Range<usize>, usize, usize)) {
        let (parts, each) = self.outputs;
        for o in 0..parts * each {
            let output = o / each * padded(each) + o % each;
            let mut input = 0;
            for part in &self.inputs {
                let from = part.offset + o * part.stride + part.column;
                f(from..from + part.width, output, input);
                input += padded(part.width);
            }
        }
    }

    /// Calls `f` with each stretch of biases: flat range, first padded output.
    fn bias_stretches(&self, mut f: impl FnMut(Range<usize>, usize)) {
        let (parts, each) = self.outputs;
        for &offset in &self.biases {
            for part in 0..parts {
                let from = offset + part * each;
                f(from..from + each, part * padded(each));
            }
        }
    }
}

/// The weights of one map as products read them.
#[derive(Debug)]
pub(crate) struct Packed {
    /// From inputs to outputs.
    pub(crate) forward: Panels,
    pub(crate) bias: Vec<f32>,
    /// From the gradients of outputs to those of inputs; empty without an adjoint.
    pub(crate) backward: Panels,
    pub(crate) inputs: usize,
}

impl Packed {
    /// Packs the weights of one map; those of the adjoint only if there will be one. Maps that do not gain stay in f32.
    pub(crate) fn new(dense: &Dense, flat: &[f32], adjoint: bool, precision: Precision) -> Self {
        let (inputs, outputs) = (dense.inputs(), dense.outputs());
        let mut matrix = vec![0.; outputs * inputs];
        dense.stretches(|range, output, input| {
            matrix[output * inputs + input..][..range.len()].copy_from_slice(&flat[range]);
        });
        let mut bias = vec![0.; outputs];
        dense.bias_stretches(|range, output| {
            for (bias, &value) in bias[output..].iter_mut().zip(&flat[range]) {
                *bias += value;
            }
        });
        let forward = Panels::pack_transposed(&matrix, inputs, dense.depth(), outputs);
        let forward = match precision {
            Precision::Bf16 if dense.gains_by_bf16() => forward.into_bf16(),
            _ => forward,
        };
        let backward = Panels::pack(&matrix, if adjoint { dense.used_outputs() } else { 0 }, inputs);
        Self { forward, bias, backward, inputs }
    }

    pub(crate) fn outputs(&self) -> usize {
        self.forward.width()
    }
}

/// The gradient of one map, padded, of each group of a chunk by itself.
#[derive(Debug)]
pub(crate) struct Gradient {
    /// `[groups, outputs, inputs]`
    weight: Vec<f32>,
    /// `[groups, outputs]`
    bias: Vec<f32>,
    inputs: usize,
    outputs: usize,
}

impl Gradient {
    pub(crate) fn zeros(dense: &Dense, groups: usize) -> Self {
        let (inputs, outputs) = (dense.inputs(), dense.outputs());
        let (weight, bias) = (vec![0.; groups * inputs * outputs], vec![0.; groups * outputs]);
        Self { weight, bias, inputs, outputs }
    }

    /// Adds what output gradients `dy` and inputs `x` of `steps` steps contribute, whose rows are cut into groups by
    /// `cuts`, `[steps, cuts.len()]`.
    pub(crate) fn add(&mut self, steps: usize, cuts: &Cuts, dy: Rows<'_>, x: Rows<'_>, scratch: &mut Scratch) {
        let Self { inputs, outputs, .. } = *self;
        let sums = self.weight.chunks_exact_mut(outputs * inputs).zip(self.bias.chunks_exact_mut(outputs));
        for (rows, (weight, bias)) in cuts.groups().zip(sums).filter(|(rows, _)| !rows.is_empty()) {
            let picked = Picked { rows, of: cuts.len(), blocks: steps };
            outer_sum(&picked, dy, x, weight, bias, inputs, scratch);
        }
    }

    /// Adds the gradients of the groups, in their order, to the part of the flat one that begins at `start`.
    fn add_to(&self, dense: &Dense, start: usize, flat: &mut [f32]) {
        let sum = |flat: &mut [f32], values: &[f32]| {
            for (flat, value) in flat.iter_mut().zip(values) {
                *flat += value;
            }
        };
        let groups = self.weight.chunks_exact(self.outputs * self.inputs).zip(self.bias.chunks_exact(self.outputs));
        for (weight, bias) in groups {
            dense.stretches(|range, output, input| {
                sum(&mut flat[range.start - start..range.end - start], &weight[output * self.inputs + input..])
            });
            dense.bias_stretches(|range, output| {
                sum(&mut flat[range.start - start..range.end - start], &bias[output..])
            });
        }
    }
}

/// A named weight and its shape.
pub(crate) type Named = (String, Vec<usize>);

/// The flat vector of all weights: names, shapes and order, and the maps they form.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    /// phi_1 first, phi_2 after it.
    pub(crate) names: Vec<Named>,
    phi_1: usize,
    pub(crate) maps: Net<Dense>,
}

impl Layout {
    pub(crate) fn new(cfg: &TrajConfig) -> Self {
        let mut flat = Flat::default();
        let Ok(maps) = Net::build(cfg, &mut flat);
        Self { names: flat.names, phi_1: flat.phi_1, maps }
    }

    /// The flat weights packed, maps side by side; those of the adjoint only if there will be one.
    pub(crate) fn packed(&self, flat: &[f32], adjoint: bool, precision: Precision) -> Net<Packed> {
        self.maps.par_map(|dense| Packed::new(dense, flat, adjoint, precision))
    }

    /// Adds the gradients of chunks, in their order, to the flat one; maps side by side.
    pub(crate) fn add(&self, gradients: &[Net<Gradient>], flat: &mut [f32]) {
        let mut maps: Vec<(&Dense, Vec<&Gradient>)> = self.maps.iter().map(|dense| (dense, Vec::new())).collect();
        for net in gradients {
            maps.iter_mut().zip(net.iter()).for_each(|((_, of_map), gradient)| of_map.push(gradient));
        }
        // Each map has a stretch of the flat vector to itself.
        maps.sort_by_key(|(dense, _)| std::cmp::Reverse(dense.start()));
        let mut rest = flat;
        let mut work = Vec::with_capacity(maps.len());
        for (dense, of_map) in maps {
            let (before, own) = rest.split_at_mut(dense.start());
            work.push((dense, of_map, own));
            rest = before;
        }
        work.into_par_iter().for_each(|(dense, of_map, own)| {
            of_map.into_iter().for_each(|gradient| gradient.add_to(dense, dense.start(), own));
        });
    }

    /// Whether `phase` trains the weight at `index` of the names.
    pub(crate) fn trained(&self, index: usize, phase: Phase) -> bool {
        match phase {
            Phase::Attraction => index < self.phi_1,
            Phase::Repulsion => index >= self.phi_1,
            Phase::Full => true,
        }
    }
}

/// A flat vector under construction.
#[derive(Default)]
struct Flat {
    names: Vec<Named>,
    len: usize,
    /// Weights before phi_2.
    phi_1: usize,
}

impl Flat {
    /// Appends a weight and returns its offset.
    fn push(&mut self, name: String, shape: &[usize]) -> usize {
        let offset = self.len;
        self.len += shape.iter().product::<usize>();
        self.names.push((name, shape.to_vec()));
        offset
    }

    /// A linear layer whose inputs come in parts.
    fn dense(&mut self, name: &str, inputs: &[usize], output: usize) -> Dense {
        let stride = inputs.iter().sum();
        let offset = self.push(format!("{name}.weight"), &[output, stride]);
        let bias = self.push(format!("{name}.bias"), &[output]);
        let mut column = 0;
        let mut parts = Vec::new();
        for &width in inputs {
            parts.push(Part { offset, stride, column, width });
            column += width;
        }
        Dense { inputs: parts, biases: vec![bias], outputs: (1, output) }
    }
}

impl Builder for Flat {
    type Linear = Dense;
    type Cell = Dense;
    type Mlp = Vec<Dense>;
    type Error = Infallible;

    fn linear(&mut self, name: &str, inputs: usize, outputs: usize) -> Result<Dense, Infallible> {
        Ok(self.dense(name, &[inputs], outputs))
    }

    fn cell(&mut self, name: &str, inputs: usize, hidden: usize) -> Result<Dense, Infallible> {
        let gates = 4 * hidden;
        let input = self.push(format!("{name}.weight_ih"), &[gates, inputs]);
        let memory = self.push(format!("{name}.weight_hh"), &[gates, hidden]);
        let biases = ["bias_ih", "bias_hh"].map(|bias| self.push(format!("{name}.{bias}"), &[gates])).to_vec();
        let whole = |offset, width| Part { offset, stride: width, column: 0, width };
        Ok(Dense { inputs: vec![whole(input, inputs), whole(memory, hidden)], biases, outputs: (4, hidden) })
    }

    fn mlp(
        &mut self,
        name: &str,
        widths: &[usize],
        parts: &[usize],
        _bias: Option<f64>,
    ) -> Result<Vec<Dense>, Infallible> {
        let layer = |(i, pair): (usize, &[usize])| {
            let inputs = if i == 0 { parts } else { &pair[..1] };
            self.dense(&format!("{name}.{}", 2 * i), inputs, pair[1])
        };
        Ok(widths.windows(2).enumerate().map(layer).collect())
    }

    fn phi_2(&mut self) {
        self.phi_1 = self.names.len();
    }
}
