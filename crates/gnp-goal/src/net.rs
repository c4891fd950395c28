//! The network as a whole.

use candle_core::{D, Tensor};
use candle_nn::{Init, Linear, Module, VarBuilder};
use gnp_nn::{Dropout, LaunchCache, linear};

use crate::block::{Block, BlockMasks};
use crate::config::{GoalConfig, GoalShape, ProbabilityHead, Regression};
use crate::error::GoalError;
use crate::fused::{self, FusedTransformer, Memory};
use crate::pick::{Pick, Picked, rows};

/// Goal prediction: modes as tokens, weighed against the observation and the neighbours.
#[derive(Clone, Debug)]
pub struct GoalNet {
    pub(crate) config: GoalConfig,
    pub(crate) shape: GoalShape,
    pub(crate) mode: Linear,
    pub(crate) observed: Linear,
    pub(crate) neighbour: Linear,
    encoder: Vec<Block>,
    decoder: Block,
    probability: Linear,
    pub(crate) goal: Linear,
    pub(crate) null_token: Option<Tensor>,
    pub(crate) slot: Option<Tensor>,
    graph: bool,
    pub(crate) memory: Memory,
}

/// What [`GoalNet::forward`] gives.
#[derive(Clone, Debug)]
pub struct GoalOutput {
    /// Unnormalised log-probability of every mode, `[batch, modes]`.
    pub logits: Tensor,
    /// Future of every mode picked, `[batch, k, t_pred, 2]`, m, in the frame of the modes.
    pub futures: Tensor,
    /// The modes picked, `[batch, k]` of `u32`.
    pub indices: Tensor,
}

/// What [`GoalNet::predict`] gives, likeliest first.
#[derive(Clone, Debug)]
pub struct Goals {
    /// `[batch, k, t_pred, 2]`, m, in the frame of the modes; the last point of each is the goal.
    pub futures: Tensor,
    /// `[batch, k]`, summing to 1 over the `k`.
    pub probabilities: Tensor,
    /// Modes, `[batch, k]` of `u32`.
    pub indices: Tensor,
}

impl GoalNet {
    /// A network under `vb` for data of `shape`. Its weights are named `mode`, `obs`, `nei`,
    /// `enc.0`.., `dec`, `prob` and `goal`, and `nobody` and `slot` where the configuration has them.
    ///
    /// # Errors
    /// When a setting is out of range, a size is 0, or `vb` holds weights of another shape under these names.
    pub fn new(config: &GoalConfig, shape: GoalShape, vb: VarBuilder) -> Result<Self, GoalError> {
        config.check()?;
        shape.check()?;
        let width = config.width;
        let block = |vb| Block::new(width, config.heads, config.feed_forward, vb);
        let head = |outputs: usize, name: &str| -> candle_core::Result<Linear> {
            let vb = vb.pp(name);
            if config.zero_start {
                // Asked for first, so that they start from this and not from the layer's own.
                vb.get_with_hints((outputs, width), "weight", Init::Const(0.))?;
                vb.get_with_hints(outputs, "bias", Init::Const(0.))?;
            }
            linear(width, outputs, vb)
        };
        let learned = |shape: &[usize], name| {
            let bound = 1. / (width as f64).sqrt();
            vb.get_with_hints(shape, name, Init::Uniform { lo: -bound, up: bound })
        };
        Ok(Self {
            mode: linear(2 * shape.t_pred, width, vb.pp("mode"))?,
            observed: linear(shape.observed, width, vb.pp("obs"))?,
            neighbour: linear(shape.neighbour, width, vb.pp("nei"))?,
            encoder: (0..config.layers).map(|i| block(vb.pp("enc").pp(i))).collect::<Result<_, _>>()?,
            decoder: block(vb.pp("dec"))?,
            probability: head(1, "prob")?,
            goal: head(2 * shape.t_pred, "goal")?,
            null_token: config.null_token.then(|| learned(&[width], "nobody")).transpose()?,
            slot: config.slot_embedding.then(|| learned(&[shape.slots, width], "slot")).transpose()?,
            config: config.clone(),
            shape,
            graph: false,
            memory: Memory::default(),
        })
    }

    /// The same network as a graph of candle's own operations, on the CPU too. Other devices always
    /// run it so; on the CPU it is several times slower, and the reference for the fused form.
    #[must_use]
    pub fn as_graph(mut self) -> Self {
        self.graph = true;
        self
    }

    /// Logits of all modes, and futures of those that `pick` names.
    ///
    /// A window without any neighbour, in a network without `nobody`, gathers nothing from the
    /// decoder's attention but the bias of its output map. What stands in the track of an absent
    /// neighbour never matters, as long as it is finite.
    ///
    /// # Shapes
    /// - `observed` `[batch, observed]`: the target's features
    /// - `neighbours` `[batch, slots, neighbour]`, `mask` `[batch, slots]`: 1 where there is one, else 0
    /// - `modes` `[modes, t_pred, 2]`, m: the centres
    /// - `dropout`: one in training, none for inference
    ///
    /// # Errors
    /// When a shape differs from the network's (the message has both), or a mode is picked that does
    /// not exist.
    pub fn forward(
        &self,
        observed: &Tensor,
        neighbours: &Tensor,
        mask: &Tensor,
        modes: &Tensor,
        pick: &Pick,
        mut dropout: Option<&mut Dropout>,
    ) -> Result<GoalOutput, GoalError> {
        let batch = self.check(observed, neighbours, mask, modes, pick)?;
        let picked = pick.of_windows(batch, modes.dims()[0], observed.device())?;
        let _sent = LaunchCache::on(observed.device());
        let modes = modes.flatten_from(1)?;
        // Modes are embedded once a batch, not once a window.
        let (embedded, observed) = (self.mode.forward(&modes)?, self.observed.forward(observed)?);
        let (keys, mask) = self.keys(neighbours, mask)?;
        let masks = (0..=self.encoder.len()).map(|_| BlockMasks::draw(dropout.as_deref_mut())).collect();
        let tokens = [&embedded, &observed, &keys, &mask];
        let (logits, decoded, indices) = if !self.graph && fused::runs_on(&embedded) {
            self.fused(tokens, picked, masks)?
        } else {
            self.graph(tokens, &picked, &masks)?
        };
        let mut futures = self.goal.forward(&decoded)?;
        if self.config.regression == Regression::Residual {
            let centres = modes.index_select(&indices.flatten_all()?, 0)?;
            futures = (futures + centres.reshape((batch, (), 2 * self.shape.t_pred))?)?;
        }
        let futures = futures.reshape((batch, (), self.shape.t_pred, 2))?;
        Ok(GoalOutput { logits, futures, indices })
    }

    /// Logits of all modes, decoded tokens of those picked, and their indices, by one operation on the CPU; the first of
    /// modes `[modes, width]`, observations `[batch, width]`, keys `[batch, keys, width]` and their mask.
    fn fused(
        &self,
        tokens: [&Tensor; 4],
        picked: Picked,
        masks: Vec<BlockMasks>,
    ) -> candle_core::Result<(Tensor, Tensor, Tensor)> {
        let weights = self.transformer_weights()?;
        let transformer = FusedTransformer {
            memory: self.memory.clone(),
            layers: self.encoder.len(),
            heads: self.config.heads,
            hidden: self.config.feed_forward * self.config.width,
            probability: self.config.probability,
            picked: picked.clone(),
            masks,
        };
        let (logits, decoded) = transformer.apply(tokens, &weights)?;
        let indices = picked.indices(&logits)?;
        Ok((logits, decoded, indices))
    }

    /// Weights of the encoder's blocks, of the decoder and of the map to a logit, in the order of the fused operation.
    pub(crate) fn transformer_weights(&self) -> candle_core::Result<Vec<&Tensor>> {
        let Some(bias) = self.probability.bias() else { candle_core::bail!("the map to a logit has a bias") };
        let blocks = self.encoder.iter().chain([&self.decoder]).map(Block::weights);
        let mut weights = blocks.collect::<candle_core::Result<Vec<_>>>()?.concat();
        weights.extend([self.probability.weight(), bias]);
        Ok(weights)
    }

    /// As [`GoalNet::fused`], operation by operation.
    fn graph(
        &self,
        [modes, observed, keys, mask]: [&Tensor; 4],
        picked: &Picked,
        masks: &[BlockMasks],
    ) -> candle_core::Result<(Tensor, Tensor, Tensor)> {
        let mut x = modes.unsqueeze(0)?.broadcast_add(&observed.unsqueeze(1)?)?;
        let mut masks = masks.iter().copied();
        let mut next = || masks.next().unwrap_or(BlockMasks::NONE);
        for block in &self.encoder {
            x = block.graph(&x, None, next())?;
        }
        let masks = next();
        let decode = |x: &Tensor| self.decoder.graph(x, Some((keys, mask)), masks);
        let logits = |x: &Tensor| self.probability.forward(x)?.squeeze(D::Minus1);
        Ok(match self.config.probability {
            ProbabilityHead::Encoder => {
                let logits: Tensor = logits(&x)?;
                let indices = picked.indices(&logits)?;
                (logits, decode(&rows(&x, &indices)?)?, indices)
            }
            ProbabilityHead::Decoder => {
                let all = decode(&x)?;
                let logits = logits(&all)?;
                let indices = picked.indices(&logits)?;
                (logits, rows(&all, &indices)?, indices)
            }
        })
    }

    /// The `k` most probable goals, or all where there are fewer modes; arguments as for
    /// [`GoalNet::forward`].
    ///
    /// # Errors
    /// As [`GoalNet::forward`].
    pub fn predict(
        &self,
        observed: &Tensor,
        neighbours: &Tensor,
        mask: &Tensor,
        modes: &Tensor,
        k: usize,
    ) -> Result<Goals, GoalError> {
        let output = self.forward(observed, neighbours, mask, modes, &Pick::MostProbable(k), None)?;
        let probabilities = candle_nn::ops::softmax(&output.logits.gather(&output.indices, 1)?, 1)?;
        Ok(Goals { futures: output.futures, probabilities, indices: output.indices })
    }

    /// Its form.
    #[must_use]
    pub fn config(&self) -> &GoalConfig {
        &self.config
    }

    /// The sizes it was made for.
    #[must_use]
    pub fn shape(&self) -> GoalShape {
        self.shape
    }

    /// What the decoder attends to: neighbours, coded by slot, and nobody; with their mask.
    fn keys(&self, neighbours: &Tensor, mask: &Tensor) -> candle_core::Result<(Tensor, Tensor)> {
        let mut keys = self.neighbour.forward(neighbours)?;
        if let Some(slot) = &self.slot {
            keys = keys.broadcast_add(slot)?;
        }
        let Some(null_token) = &self.null_token else { return Ok((keys, mask.clone())) };
        let (batch, _, width) = keys.dims3()?;
        // Contiguous, or the whole would be put together transposed, which products on a GPU do not take.
        let null_token = null_token.broadcast_as((batch, 1, width))?.contiguous()?;
        let always = Tensor::ones((batch, 1), mask.dtype(), mask.device())?;
        Ok((Tensor::cat(&[&keys, &null_token], 1)?, Tensor::cat(&[mask, &always], 1)?))
    }

    /// The batch size, after every shape was compared.
    fn check(
        &self,
        observed: &Tensor,
        neighbours: &Tensor,
        mask: &Tensor,
        modes: &Tensor,
        pick: &Pick,
    ) -> Result<usize, GoalError> {
        let wrong = |name, tensor: &Tensor, needed: String| {
            Err(GoalError::Shape { name, found: tensor.dims().to_vec(), needed })
        };
        let GoalShape { observed: features, neighbour, slots, t_pred } = self.shape;
        let batch = match *observed.dims() {
            [batch, found] if found == features && batch > 0 => batch,
            _ => return wrong("observed", observed, format!("[batch, {features}] with at least one window")),
        };
        if neighbours.dims() != [batch, slots, neighbour] {
            return wrong("neighbours", neighbours, format!("[{batch}, {slots}, {neighbour}]"));
        }
        if mask.dims() != [batch, slots] {
            return wrong("mask", mask, format!("[{batch}, {slots}]"));
        }
        if modes.rank() != 3 || modes.dims()[0] == 0 || modes.dims()[1..] != [t_pred, 2] {
            return wrong("modes", modes, format!("[modes, {t_pred}, 2] with at least one mode"));
        }
        match pick {
            Pick::Indices(indices) if !matches!(*indices.dims(), [b, k] if b == batch && k > 0) => {
                wrong("pick", indices, format!("[{batch}, k] with k at least 1"))
            }
            Pick::MostProbable(0) => wrong("pick", &mask.narrow(1, 0, 0)?, format!("[{batch}, k] with k at least 1")),
            _ => Ok(batch),
        }
    }
}
