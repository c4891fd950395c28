//! A network and its modes for prediction alone, window by window in memory that is there.

use candle_core::{D, DType, Module, Result as CandleResult, Tensor};
use candle_nn::Linear;
use gnp_nn::kernels::{Aligned, Rows, RowsMut, Start, add_to_rows, matmul, transpose};

use crate::config::{GoalShape, Regression};
use crate::error::GoalError;
use crate::fused::{Shape, Transformer, Transposed, Window, transposed};
use crate::net::GoalNet;
use crate::pick::likeliest_first;

/// A [`GoalNet`] on the CPU with its modes, whose weights never change: [`GoalNet::packed`].
#[derive(Debug)]
pub struct PackedGoalNet {
    shape: GoalShape,
    transformer: Shape,
    /// Embedded modes `[modes, width]`.
    modes: Vec<f32>,
    /// Last points of the modes where futures are differences from them.
    ends: Option<Vec<[f32; 2]>>,
    observed: Affine,
    neighbour: Affine,
    /// To the last point of a future.
    end: Affine,
    /// Of the transformer, and its maps turned.
    weights: Vec<f32>,
    turned: Vec<Transposed>,
    /// `[slots, width]`
    slot: Option<Vec<f32>>,
    null_token: Option<Vec<f32>>,
}

/// An affine map.
#[derive(Debug)]
struct Affine {
    /// `[inputs, outputs]`
    weight: Vec<f32>,
    bias: Vec<f32>,
}

/// What [`PackedGoalNet::predict`] keeps from one window to the next: memory, no state.
#[derive(Debug, Default)]
pub struct GoalWorkspace {
    observed: Vec<f32>,
    /// Of the keys that exist, `[keys, width]`.
    keys: Vec<f32>,
    logits: Vec<f32>,
    /// `[modes, width]`
    decoded: Vec<f32>,
    order: Vec<u32>,
    points: Vec<[f32; 2]>,
    probabilities: Vec<f32>,
    kept: Aligned,
    room: Aligned,
}

/// Where a window may end, likeliest first.
#[derive(Clone, Copy, Debug)]
pub struct EndPoints<'a> {
    /// Last point of the future of each mode, in the frame and the unit of the modes.
    pub points: &'a [[f32; 2]],
    /// Probability of each; they sum to 1.
    pub probabilities: &'a [f32],
}

impl Affine {
    /// The `outputs` last outputs of a linear layer.
    fn of(linear: &Linear, outputs: usize) -> CandleResult<Self> {
        let Some(bias) = linear.bias() else { candle_core::bail!("a map has a bias") };
        let (all, inputs) = linear.weight().dims2()?;
        let matrix = flat(&linear.weight().narrow(0, all - outputs, outputs)?)?;
        let mut weight = vec![0.; matrix.len()];
        transpose(&mut weight, outputs, &matrix, inputs, [outputs, inputs], 1.);
        Ok(Self { weight, bias: flat(&bias.narrow(0, all - outputs, outputs)?)? })
    }

    /// Of each row of `from` `[rows, inputs]` into `to` `[rows, outputs]`; the bias is added last, as candle does.
    fn apply(&self, from: &[f32], to: &mut [f32]) {
        let outputs = self.bias.len();
        let inputs = self.weight.len() / outputs;
        let (x, weight) = (Rows::new(from, inputs), Rows::new(&self.weight, outputs));
        matmul([to.len() / outputs, inputs, outputs], x, weight, Start::Zero, RowsMut::new(to, outputs));
        add_to_rows(to, &self.bias);
    }
}

fn flat(tensor: &Tensor) -> CandleResult<Vec<f32>> {
    tensor.to_dtype(DType::F32)?.flatten_all()?.to_vec1()
}

impl GoalNet {
    /// The network with `modes` `[modes, t_pred, 2]`, in the unit of [`GoalNet::predict`], for prediction window by window
    /// without allocations.
    ///
    /// # Errors
    /// [`GoalError::Shape`] for modes of another shape; candle's, also for a network that is not on the CPU.
    pub fn packed(&self, modes: &Tensor) -> Result<PackedGoalNet, GoalError> {
        let GoalShape { slots, t_pred, .. } = self.shape;
        if modes.rank() != 3 || modes.dims()[0] == 0 || modes.dims()[1..] != [t_pred, 2] {
            let needed = format!("[modes, {t_pred}, 2] with at least one mode");
            return Err(GoalError::Shape { name: "modes", found: modes.dims().to_vec(), needed });
        }
        let transformer = Shape {
            layers: self.config.layers,
            modes: modes.dims()[0],
            picked: modes.dims()[0],
            keys: slots + usize::from(self.null_token.is_some()),
            width: self.config.width,
            heads: self.config.heads,
            hidden: self.config.feed_forward * self.config.width,
            probability: self.config.probability,
        };
        let mut weights = Vec::new();
        for weight in self.transformer_weights()? {
            weights.extend(flat(weight)?);
        }
        let ends = match self.config.regression {
            Regression::Residual => {
                let last = flat(&modes.narrow(D::Minus2, t_pred - 1, 1)?)?;
                Some(last.chunks_exact(2).map(|end| [end[0], end[1]]).collect())
            }
            Regression::Absolute => None,
        };
        Ok(PackedGoalNet {
            shape: self.shape,
            transformer,
            modes: flat(&self.mode.forward(&modes.flatten_from(1)?)?)?,
            ends,
            observed: Affine::of(&self.observed, self.config.width)?,
            neighbour: Affine::of(&self.neighbour, self.config.width)?,
            end: Affine::of(&self.goal, 2)?,
            turned: transposed(&weights, &transformer),
            weights,
            slot: self.slot.as_ref().map(flat).transpose()?,
            null_token: self.null_token.as_ref().map(flat).transpose()?,
        })
    }
}

impl PackedGoalNet {
    /// The sizes it was made for.
    #[must_use]
    pub fn shape(&self) -> GoalShape {
        self.shape
    }

    /// Number of modes.
    #[must_use]
    pub fn modes(&self) -> usize {
        self.transformer.modes
    }

    /// The last points of the futures of all modes and their probabilities for one window: those of [`GoalNet::predict`],
    /// but for rounding. `observed` `[observed]` and `neighbours` `[slots, neighbour]` are features, `present` `[slots]`
    /// says which slots are taken; what stands in the others does not matter.
    ///
    /// # Errors
    /// [`GoalError::Shape`] where these are not as many as the network was made for.
    pub fn predict<'a>(
        &self,
        observed: &[f32],
        neighbours: &[f32],
        present: &[bool],
        work: &'a mut GoalWorkspace,
    ) -> Result<EndPoints<'a>, GoalError> {
        let GoalShape { observed: features, neighbour, slots, .. } = self.shape;
        for (name, found, needed) in [
            ("observed", observed.len(), features),
            ("neighbours", neighbours.len(), slots * neighbour),
            ("present", present.len(), slots),
        ] {
            if found != needed {
                return Err(GoalError::Shape { name, found: vec![found], needed: format!("[{needed}]") });
            }
        }
        let Shape { modes, width, .. } = self.transformer;
        work.reset(&self.transformer);
        self.observed.apply(observed, &mut work.observed);
        self.keys(neighbours, present, &mut work.keys);
        let window = Window { index: 0, modes: &self.modes, observed: &work.observed, keys: &work.keys };
        let order = &mut work.order;
        Transformer::new(self.transformer, &self.weights, &[]).forward(
            &self.turned,
            &window,
            move |logits| {
                likeliest_first(logits, order);
                order
            },
            (&mut work.logits, &mut work.decoded),
            &mut work.kept,
            &mut work.room,
        );

        let points = work.points.as_flattened_mut();
        self.end.apply(&work.decoded[..modes * width], points);
        if let Some(ends) = &self.ends {
            for (point, mode) in work.points.iter_mut().zip(&work.order) {
                let end = ends[*mode as usize];
                *point = [point[0] + end[0], point[1] + end[1]];
            }
        }
        softmax(&work.order, &work.logits, &mut work.probabilities);
        Ok(EndPoints { points: &work.points, probabilities: &work.probabilities })
    }

    /// What the decoder attends to: the neighbours that are there, coded by slot, and nobody.
    fn keys(&self, neighbours: &[f32], present: &[bool], keys: &mut Vec<f32>) {
        let (features, width) = (self.shape.neighbour, self.transformer.width);
        keys.clear();
        for (slot, row) in neighbours.chunks_exact(features).enumerate().filter(|(slot, _)| present[*slot]) {
            let first = keys.len();
            keys.resize(first + width, 0.);
            self.neighbour.apply(row, &mut keys[first..]);
            if let Some(codes) = &self.slot {
                add_to_rows(&mut keys[first..], &codes[slot * width..][..width]);
            }
        }
        if let Some(null_token) = &self.null_token {
            keys.extend_from_slice(null_token);
        }
    }
}

impl GoalWorkspace {
    /// Makes room for a window of this shape.
    fn reset(&mut self, shape: &Shape) {
        self.observed.resize(shape.width, 0.);
        self.keys.clear();
        self.keys.reserve(shape.keys * shape.width);
        self.logits.resize(shape.modes, 0.);
        self.decoded.resize(shape.modes * shape.width, 0.);
        self.order.clear();
        self.order.reserve(shape.modes);
        self.points.resize(shape.modes, [0.; 2]);
        self.kept.resize(shape.kept_values());
        self.room.resize(shape.room_values());
        self.probabilities.clear();
        self.probabilities.reserve(shape.modes);
    }
}

/// Probabilities from `logits`, in that order.
fn softmax(order: &[u32], logits: &[f32], probabilities: &mut Vec<f32>) {
    let logits = order.iter().map(|mode| logits[*mode as usize]);
    let largest = logits.clone().fold(f32::NEG_INFINITY, f32::max);
    probabilities.clear();
    probabilities.extend(logits.map(|logit| (logit - largest).exp()));
    let sum: f32 = probabilities.iter().sum();
    probabilities.iter_mut().for_each(|probability| *probability /= sum);
}
