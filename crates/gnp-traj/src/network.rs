//! The attraction network (phi_1) and the repulsion network (phi_2).

use std::sync::Arc;

use candle_core::{Module, Tensor};
use candle_nn::{Init, VarBuilder, ops::sigmoid};
use gnp_force::{Arity, ForceTerm, TermDescriptor};
use gnp_nn::{Linear, Lstm, LstmState, Mlp, Precision, linear};

use crate::fused::{Fused, RollOutWorkspace, RolledOut};
#[cfg(feature = "cuda")]
use crate::recorded;
use crate::roll_out::Sizes;
use crate::terms::{FixedTerm, Terms};
use crate::weights::{Builder, HistoryEncoder, Net};
use crate::{Engine, NeighbourStates, Phase, RollOut, RollOutBatch, TrajConfig, TrajError, graph};

/// The neural social force; the weights have the names of the reference implementation in PyTorch,
/// with `enc_line` and `k_line` beside them when lines push.
#[derive(Clone, Debug)]
pub struct SocialForce {
    pub(crate) cfg: TrajConfig,
    pub(crate) net: Net<Linear, Lstm, Mlp>,
    pub(crate) terms: Arc<Terms>,
    fused: Fused,
    /// In the order in which the fused roll-out lays them out.
    pub(crate) weights: Vec<Tensor>,
    /// The same in all copies of a network, which share its weights.
    #[cfg(feature = "cuda")]
    pub(crate) identity: Arc<()>,
}

/// Makes the modules of the graph.
struct Modules<'a>(VarBuilder<'a>);

impl Builder for Modules<'_> {
    type Linear = Linear;
    type Cell = Lstm;
    type Mlp = Mlp;
    type Error = candle_core::Error;

    fn linear(&mut self, name: &str, inputs: usize, outputs: usize) -> candle_core::Result<Linear> {
        linear(inputs, outputs, self.0.pp(name))
    }

    fn cell(&mut self, name: &str, inputs: usize, hidden: usize) -> candle_core::Result<Lstm> {
        Lstm::new(inputs, hidden, self.0.pp(name))
    }

    fn mlp(&mut self, name: &str, widths: &[usize], _: &[usize], bias: Option<f64>) -> candle_core::Result<Mlp> {
        let vb = self.0.pp(name);
        if let (Some(bias), Some(last)) = (bias, widths.len().checked_sub(2)) {
            // Asked for first, so that it starts from this value and not from the layer's own.
            vb.pp(2 * last).get_with_hints(1, "bias", Init::Const(bias))?;
        }
        Mlp::new(widths, vb)
    }
}

impl HistoryEncoder<Linear, Lstm> {
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
        let mut terms = Terms::new();
        for term in &cfg.terms {
            terms.add(FixedTerm::configured(term)?, cfg)?;
        }
        let net = Net::build(cfg, &mut Modules(vb.clone()))?;
        let fused = Fused::new(cfg);
        let weight = |(name, shape): &(String, Vec<usize>)| vb.get(shape.as_slice(), name);
        let weights = fused.names().iter().map(weight).collect::<candle_core::Result<_>>()?;
        Ok(Self {
            cfg: cfg.clone(),
            net,
            terms: Arc::new(terms),
            fused,
            weights,
            #[cfg(feature = "cuda")]
            identity: Arc::default(),
        })
    }

    /// The same networks with one more term of the force, which acts in every step of every phase with these values of
    /// its parameters.
    ///
    /// # Errors
    /// When a term of its name acts already, or the values are not as many as its parameters.
    pub fn with_term(mut self, law: Arc<dyn ForceTerm<f32>>, parameters: &[f64]) -> Result<Self, TrajError> {
        Arc::make_mut(&mut self.terms).add(FixedTerm::new(law, parameters)?, &self.cfg)?;
        Ok(self)
    }

    /// The same networks without the terms of these names: they exert no force in any phase, and roll-outs do not list them.
    /// The weights are shared. What the networks see stays as it is, so that the other terms change only as the path does.
    ///
    /// # Errors
    /// [`TrajError::Term`] for a name of no term, with those that there are.
    pub fn without_terms(mut self, names: &[&str]) -> Result<Self, TrajError> {
        Arc::make_mut(&mut self.terms).switch_off(names, &self.cfg)?;
        // Roll-outs of these terms are recorded apart.
        #[cfg(feature = "cuda")]
        {
            self.identity = Arc::default();
        }
        Ok(self)
    }

    /// All terms in the order in which they are added up, whether they act or are switched off.
    pub fn term_descriptors(&self) -> impl Iterator<Item = &Arc<TermDescriptor>> {
        self.terms.all(&self.cfg)
    }

    /// Whether `phase` trains the weight of that name; a name of no weight is trained by none.
    #[must_use]
    pub fn trains(&self, phase: Phase, name: &str) -> bool {
        self.fused.trains(phase, name)
    }

    /// The configuration the networks were built with.
    #[must_use]
    pub fn config(&self) -> &TrajConfig {
        &self.cfg
    }

    /// Positions after each step `[batch, goals, steps, 2]` in m, with a gradient to the weights
    /// that `phase` trains and to the goals and observations that ask for one; one backward pass a roll-out.
    ///
    /// # Errors
    /// When the batch is incomplete or its shapes do not fit each other.
    pub fn roll_out(&self, batch: &RollOutBatch, phase: Phase) -> Result<Tensor, TrajError> {
        let engine = self.engine(batch, phase);
        #[cfg(feature = "cuda")]
        if engine == Engine::Graph {
            let sizes = self.check(engine, batch, phase)?;
            if let Some(path) = recorded::path(self, batch, sizes, phase)? {
                return Ok(path);
            }
        }
        self.roll_out_on(engine, batch, phase)
    }

    /// [`SocialForce::roll_out`] on an engine of the caller's choice.
    ///
    /// # Errors
    /// As [`SocialForce::roll_out`], and when the engine does not offer what the batch asks for.
    pub fn roll_out_on(&self, engine: Engine, batch: &RollOutBatch, phase: Phase) -> Result<Tensor, TrajError> {
        let sizes = self.check(engine, batch, phase)?;
        Ok(match engine {
            Engine::Fused => self.fused.path(self, &self.weights, batch, sizes, phase)?,
            Engine::Graph => graph::roll_out(self, batch, sizes, phase)?.path,
        })
    }

    /// [`SocialForce::roll_out`] without a gradient, for which nothing is kept.
    ///
    /// # Errors
    /// As [`SocialForce::roll_out`].
    pub fn predict(&self, batch: &RollOutBatch, phase: Phase) -> Result<Tensor, TrajError> {
        self.detached()?.roll_out(&batch.detached(), phase)
    }

    /// The roll-out with its forces and their parameters, without a gradient.
    ///
    /// # Errors
    /// As [`SocialForce::roll_out`].
    pub fn roll_out_explained(&self, batch: &RollOutBatch, phase: Phase) -> Result<RollOut, TrajError> {
        self.roll_out_explained_on(self.engine(batch, phase), batch, phase)
    }

    /// [`SocialForce::roll_out_explained`] on an engine of the caller's choice.
    ///
    /// # Errors
    /// As [`SocialForce::roll_out_on`].
    pub fn roll_out_explained_on(
        &self,
        engine: Engine,
        batch: &RollOutBatch,
        phase: Phase,
    ) -> Result<RollOut, TrajError> {
        let batch = &batch.detached();
        let sizes = self.check(engine, batch, phase)?;
        Ok(match engine {
            Engine::Fused => self.fused.explain(self, &self.weights, batch, sizes, phase)?,
            Engine::Graph => graph::roll_out(&self.detached()?, batch, sizes, phase)?,
        })
    }

    /// Rolls out what `workspace.values` hold, on the caller's thread and in the memory of `workspace`, with the forces of
    /// every step where they are to be explained; the same bits as [`SocialForce::roll_out`] for neighbours that are given.
    /// Nothing is allocated where an earlier roll-out had no fewer windows, goals, steps, slots and lines.
    ///
    /// All windows are carried through a step together: 96 rows (windows times goals) at a time are fastest.
    ///
    /// # Errors
    /// [`TrajError::Batch`] for a network that is not [`SocialForce::frozen`] on a CPU; when the values are not as many as
    /// their sizes say.
    pub fn roll_out_into<'a>(
        &'a self,
        phase: Phase,
        explain: bool,
        workspace: &'a mut RollOutWorkspace,
    ) -> Result<RolledOut<'a>, TrajError> {
        let sizes = workspace.values.check(&self.cfg, &self.terms, phase)?;
        let Some(net) = self.fused.packed() else {
            let problem = "the network is not packed; take `frozen` of one on a CPU".to_owned();
            return Err(TrajError::Batch { name: "network", problem });
        };
        Ok(workspace.roll_out(self, net, sizes, phase, explain))
    }

    /// Whether [`SocialForce::roll_out_into`] works.
    #[must_use]
    pub fn is_packed(&self) -> bool {
        self.fused.is_frozen()
    }

    /// The faster engine of those that can roll `batch` out.
    #[must_use]
    pub fn engine(&self, batch: &RollOutBatch, phase: Phase) -> Engine {
        if self.unfusible(batch, phase).is_none() { Engine::Fused } else { Engine::Graph }
    }

    /// The same networks for prediction alone, on copies of the weights that pass no gradient: roll-outs on CPUs, which
    /// otherwise pack the weights at every call, then do so once for all. The results are the same bits.
    ///
    /// # Errors
    /// Candle's.
    pub fn frozen(&self) -> Result<Self, TrajError> {
        self.frozen_in(Precision::F32)
    }

    /// [`SocialForce::frozen`] with the products of the networks in another precision. In bf16 roll-outs are fused ones without a
    /// gradient, and the results differ from those in f32 by rounding to 8 bits.
    ///
    /// # Errors
    /// [`TrajError::Precision`] where the processor does not multiply in it; [`TrajError::Batch`] for bf16 on another
    /// device than a CPU; candle's.
    pub fn frozen_in(&self, precision: Precision) -> Result<Self, TrajError> {
        precision.check()?;
        let network = self.with_weights(|weight| weight.detach().copy())?;
        let on_cpu = network.weights.iter().all(|weight| weight.device().is_cpu());
        match precision {
            _ if on_cpu => Ok(Self { fused: network.fused.frozen(&network.weights, precision)?, ..network }),
            Precision::Bf16 => Err(in_bf16("is on a GPU; products in bf16 are made on CPUs")),
            Precision::F32 => Ok(network),
        }
    }

    /// What its networks multiply in.
    #[must_use]
    pub fn precision(&self) -> Precision {
        self.fused.precision()
    }

    /// The same networks on weights that ask for no gradient.
    pub(crate) fn detached(&self) -> Result<Self, TrajError> {
        if self.fused.is_frozen() { Ok(self.clone()) } else { self.with_weights(|weight| Ok(weight.detach())) }
    }

    /// The same networks on what `f` makes of each weight.
    fn with_weights(&self, f: impl Fn(&Tensor) -> candle_core::Result<Tensor>) -> Result<Self, TrajError> {
        let named = self.fused.names().iter().zip(&self.weights);
        let weights = named.map(|((name, _), weight)| Ok((name.clone(), f(weight)?)));
        let weights = weights.collect::<candle_core::Result<_>>()?;
        let vb = VarBuilder::from_tensors(weights, self.weights[0].dtype(), self.weights[0].device());
        Ok(Self {
            fused: self.fused.clone(),
            terms: self.terms.clone(),
            #[cfg(feature = "cuda")]
            identity: self.identity.clone(),
            ..Self::new(&self.cfg, vb)?
        })
    }

    /// The field of the batch that the fused roll-out cannot serve, and why.
    fn unfusible(&self, batch: &RollOutBatch, phase: Phase) -> Option<(&'static str, &'static str)> {
        if !self.weights.iter().all(|weight| weight.device().is_cpu()) {
            return Some(("observed", "the fused roll-out runs on CPUs; take the graph"));
        }
        let sees = |arity| self.terms.act_from(arity, &self.cfg, phase);
        if let Some(neighbours) = batch.neighbours.as_ref().filter(|_| sees(Arity::PerNeighbour)) {
            match &neighbours.states {
                NeighbourStates::Joint { .. } => {
                    return Some(("neighbours.states", "the fused roll-out wants given neighbours; take the graph"));
                }
                NeighbourStates::Given(states) if states.track_op() => {
                    return Some((
                        "neighbours.states",
                        "only the graph has a gradient for it; take that, or detach it",
                    ));
                }
                NeighbourStates::Given(_) => {}
            }
        }
        let lines = batch.lines.as_ref().filter(|_| sees(Arity::PerLine));
        lines
            .filter(|lines| lines.lines.track_op())
            .map(|_| ("lines.lines", "only the graph has a gradient for it; take that, or detach it"))
    }

    fn check(&self, engine: Engine, batch: &RollOutBatch, phase: Phase) -> Result<Sizes, TrajError> {
        let sizes = batch.check(&self.cfg, &self.terms, phase)?;
        if self.precision() == Precision::Bf16 {
            if engine == Engine::Graph {
                return Err(in_bf16("is in bf16, and only the graph can roll this out, which is f32: take f32"));
            }
            if batch.goals.track_op() || batch.observed.track_op() {
                return Err(in_bf16("is in bf16, which passes no gradient: take f32"));
            }
        }
        match self.unfusible(batch, phase) {
            Some((name, problem)) if engine == Engine::Fused => {
                Err(TrajError::Batch { name, problem: problem.to_owned() })
            }
            _ => Ok(sizes),
        }
    }
}

/// What a network in bf16 cannot do.
fn in_bf16(problem: &str) -> TrajError {
    TrajError::Batch { name: "network", problem: problem.to_owned() }
}

/// `largest * sigmoid(head(inputs))`, one strength a row: `inputs` `[rows, slots, 2 * latent]` gives
/// `[rows, slots]`.
pub(crate) fn strength(head: &Mlp, inputs: &Tensor, largest: f64) -> candle_core::Result<Tensor> {
    let (rows, slots, width) = inputs.dims3()?;
    let logits = head.forward(&inputs.reshape((rows * slots, width))?)?.reshape((rows, slots))?;
    sigmoid(&logits)? * largest
}
