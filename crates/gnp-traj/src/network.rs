//! The attraction network (phi_1) and the repulsion network (phi_2).

use candle_core::{Module, Tensor};
use candle_nn::{Init, VarBuilder, ops::sigmoid};
use gnp_nn::{Linear, Lstm, LstmState, Mlp, linear};

use crate::fused::Fused;
use crate::scene::Sizes;
use crate::{Engine, NeighbourStates, Phase, RollOut, Scene, TrajConfig, TrajError, graph};

/// The neural social force; the weights have the names of the reference implementation in PyTorch,
/// with `enc_line` and `k_line` beside them when lines push.
#[derive(Clone, Debug)]
pub struct SocialForce {
    pub(crate) cfg: TrajConfig,
    pub(crate) attraction: Attraction,
    pub(crate) repulsion: Repulsion,
    fused: Fused,
    /// In the order in which the fused roll-out lays them out.
    weights: Vec<Tensor>,
}

/// phi_1: history and goal give `tau`.
#[derive(Clone, Debug)]
pub(crate) struct Attraction {
    pub(crate) history_encoder: HistoryEncoder,
    pub(crate) enc_goal: Mlp,
    pub(crate) tau: Mlp,
}

/// phi_2: history and neighbour give `k`, history and line give `k_line`.
#[derive(Clone, Debug)]
pub(crate) struct Repulsion {
    pub(crate) history_encoder: HistoryEncoder,
    pub(crate) enc_nei: Mlp,
    pub(crate) k: Mlp,
    /// Encoder and head.
    pub(crate) line: Option<(Mlp, Mlp)>,
}

/// Embedding, LSTM and latent of the history, seen or predicted.
#[derive(Clone, Debug)]
pub(crate) struct HistoryEncoder {
    emb: Linear,
    cell: Lstm,
    out: Linear,
}

impl HistoryEncoder {
    fn new(cfg: &TrajConfig, number: usize, vb: &VarBuilder) -> candle_core::Result<Self> {
        Ok(Self {
            emb: linear(4, cfg.embedding, vb.pp(format!("emb{number}")))?,
            cell: Lstm::new(cfg.embedding, cfg.hidden, vb.pp(format!("cell{number}")))?,
            out: linear(cfg.hidden, cfg.latent_dim, vb.pp(format!("out{number}")))?,
        })
    }

    /// Takes in one frame of scaled states `[rows, 4]`.
    pub(crate) fn step(&self, states: &Tensor, memory: Option<&LstmState>) -> candle_core::Result<LstmState> {
        self.cell.step(&self.emb.forward(states)?.relu()?, memory)
    }

    /// The latent of the history `[rows, latent]`.
    pub(crate) fn latent(&self, memory: &LstmState) -> candle_core::Result<Tensor> {
        self.out.forward(&memory.h)
    }
}

impl SocialForce {
    /// The networks on `vb`, drawn anew or as stored there.
    ///
    /// # Errors
    /// When the configuration is refused, or `vb` holds a weight of another shape.
    pub fn new(cfg: &TrajConfig, vb: VarBuilder) -> Result<Self, TrajError> {
        cfg.check()?;
        let encoder = |input: usize| [&[input], &cfg.encoder[..], &[cfg.latent_dim]].concat();
        let head = [&[2 * cfg.latent_dim], &cfg.decoder[..], &[1]].concat();
        let strength = |name: &str| {
            let vb = vb.pp(name);
            // Asked for first, so that it starts from this value and not from the layer's own.
            vb.pp(2 * cfg.decoder.len()).get_with_hints(1, "bias", Init::Const(cfg.k_bias))?;
            Mlp::new(&head, vb)
        };
        let line =
            if cfg.lines { Some((Mlp::new(&encoder(2), vb.pp("enc_line"))?, strength("k_line")?)) } else { None };
        let attraction = Attraction {
            history_encoder: HistoryEncoder::new(cfg, 1, &vb)?,
            enc_goal: Mlp::new(&encoder(2), vb.pp("enc_goal"))?,
            tau: Mlp::new(&head, vb.pp("tau"))?,
        };
        let repulsion = Repulsion {
            history_encoder: HistoryEncoder::new(cfg, 2, &vb)?,
            enc_nei: Mlp::new(&encoder(4), vb.pp("enc_nei"))?,
            k: strength("k")?,
            line,
        };
        let fused = Fused::new(cfg);
        let weight = |(name, shape): &(String, Vec<usize>)| vb.get(shape.as_slice(), name);
        let weights = fused.names().iter().map(weight).collect::<candle_core::Result<_>>()?;
        Ok(Self { cfg: cfg.clone(), attraction, repulsion, fused, weights })
    }

    /// The configuration the networks were built with.
    #[must_use]
    pub fn config(&self) -> &TrajConfig {
        &self.cfg
    }

    /// Positions after each step `[batch, goals, steps, 2]` in m, with a gradient to the weights
    /// that `phase` trains; one backward pass a roll-out.
    ///
    /// # Errors
    /// When the scene is incomplete or its shapes do not fit each other.
    pub fn roll_out(&self, scene: &Scene, phase: Phase) -> Result<Tensor, TrajError> {
        self.roll_out_on(self.engine(scene, phase), scene, phase)
    }

    /// [`SocialForce::roll_out`] on an engine of the caller's choice.
    ///
    /// # Errors
    /// As [`SocialForce::roll_out`], and when the engine does not offer what the scene asks for.
    pub fn roll_out_on(&self, engine: Engine, scene: &Scene, phase: Phase) -> Result<Tensor, TrajError> {
        let sizes = self.check(engine, scene, phase)?;
        Ok(match engine {
            Engine::Fused => self.fused.path(&self.cfg, &self.weights, scene, sizes, phase)?,
            Engine::Graph => graph::roll_out(self, scene, sizes, phase)?.path,
        })
    }

    /// [`SocialForce::roll_out`] without a gradient, for which nothing is kept.
    ///
    /// # Errors
    /// As [`SocialForce::roll_out`].
    pub fn predict(&self, scene: &Scene, phase: Phase) -> Result<Tensor, TrajError> {
        self.detached()?.roll_out(scene, phase)
    }

    /// The roll-out with its forces and their parameters, without a gradient.
    ///
    /// # Errors
    /// As [`SocialForce::roll_out`].
    pub fn roll_out_explained(&self, scene: &Scene, phase: Phase) -> Result<RollOut, TrajError> {
        self.roll_out_explained_on(self.engine(scene, phase), scene, phase)
    }

    /// [`SocialForce::roll_out_explained`] on an engine of the caller's choice.
    ///
    /// # Errors
    /// As [`SocialForce::roll_out_on`].
    pub fn roll_out_explained_on(&self, engine: Engine, scene: &Scene, phase: Phase) -> Result<RollOut, TrajError> {
        let sizes = self.check(engine, scene, phase)?;
        Ok(match engine {
            Engine::Fused => self.fused.explain(&self.cfg, &self.weights, scene, sizes, phase)?,
            Engine::Graph => graph::roll_out(&self.detached()?, scene, sizes, phase)?,
        })
    }

    /// The faster engine of those that can roll `scene` out.
    #[must_use]
    pub fn engine(&self, scene: &Scene, phase: Phase) -> Engine {
        if self.fusible(scene, phase) { Engine::Fused } else { Engine::Graph }
    }

    /// The same networks on weights that ask for no gradient.
    fn detached(&self) -> Result<Self, TrajError> {
        let named = self.fused.names().iter().zip(&self.weights);
        let weights = named.map(|((name, _), weight)| (name.clone(), weight.detach())).collect();
        let vb = VarBuilder::from_tensors(weights, self.weights[0].dtype(), self.weights[0].device());
        Ok(Self { fused: self.fused.clone(), ..Self::new(&self.cfg, vb)? })
    }

    fn fusible(&self, scene: &Scene, phase: Phase) -> bool {
        let joint = scene.neighbours.as_ref().is_some_and(|n| matches!(n.states, NeighbourStates::Joint { .. }));
        self.weights.iter().all(|weight| weight.device().is_cpu()) && (phase == Phase::Attraction || !joint)
    }

    fn check(&self, engine: Engine, scene: &Scene, phase: Phase) -> Result<Sizes, TrajError> {
        if engine == Engine::Fused && !self.fusible(scene, phase) {
            let problem = "the fused roll-out wants a CPU and given neighbours; take the graph".to_owned();
            return Err(TrajError::Scene { name: "neighbours.states", problem });
        }
        scene.check(&self.cfg, phase)
    }
}

/// `largest * sigmoid(head(inputs))`, one strength a row: `inputs` `[rows, slots, 2 * latent]` gives
/// `[rows, slots]`.
pub(crate) fn strength(head: &Mlp, inputs: &Tensor, largest: f64) -> candle_core::Result<Tensor> {
    let (rows, slots, width) = inputs.dims3()?;
    let logits = head.forward(&inputs.reshape((rows * slots, width))?)?.reshape((rows, slots))?;
    sigmoid(&logits)? * largest
}
