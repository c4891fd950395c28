//! The roll-out as one operation with a hand-derived adjoint, for CPUs.
//!
//! A graph of some thousand small operations spends its time on allocating, dispatching and
//! synchronising them. Here the windows are cut into chunks, and each thread carries a chunk through
//! all steps by itself:
//!
//! - All weights are one flat vector (`layout`), packed for the products of [`gnp_nn::kernels`]: once a call, or once
//!   for all of a frozen network.
//! - `forward` runs the networks (`history_encoder`, `head`, `mlp`) and the physics of `gnp_force` step by step;
//!   what `backward` needs stays in the buffers of a tape, and without a gradient nothing stays.
//! - Empty slots and lines are left out rather than masked, and the history is taken in once a window.
//! - A window's values do not depend on the others of its chunk, and gradients add up by groups of windows, in their
//!   order (`cuts`): the same bits come out on any number of threads, whatever chunks they take.
//!
//! Widths are padded to whole cache lines with zeros in the weights, so that padding stays zero or is
//! multiplied by zero throughout.

mod backward;
mod batch;
mod cuts;
mod forward;
mod head;
mod history_encoder;
mod layout;
mod mlp;
mod trace;
mod values;
mod workspace;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use candle_core::{CpuStorage, CustomOp3, DType, Device, Layout as Strides, Result, Shape, Tensor};
use gnp_force::TermDescriptor;
use gnp_nn::Precision;
use gnp_nn::kernels::Pool;
use rayon::prelude::*;

use self::backward::InputGradient;
use self::batch::{Batch, Chunk};
use self::forward::{Detail, Outcome, Record, Tape};
use self::layout::{Gradient, Net, Packed};
use crate::network::SocialForce;
use crate::roll_out::Sizes;
use crate::{Phase, RollOut, RollOutBatch, TermRollOut, TrajConfig};

pub(crate) use self::layout::Layout;
pub use self::values::RollOutValues;
pub use self::workspace::{RollOutWorkspace, RolledOut, RolledOutTerm};

/// Values (4 bytes each) that the tapes of one batch may hold; chunks beyond go forward once more
/// before they go backward. Also what waits for the next batch at most.
const TAPE_VALUES: usize = 1 << 28;

/// What a network keeps from one roll-out to the next: the layout of its weights, idle memory, and the packed weights
/// if they never change.
#[derive(Clone, Debug)]
pub(crate) struct Fused {
    layout: Arc<Layout>,
    pool: Arc<Pool>,
    tape_values: usize,
    packed: Option<Arc<Net<Packed>>>,
    /// Of the packed weights.
    precision: Precision,
}

impl Fused {
    pub(crate) fn new(cfg: &TrajConfig) -> Self {
        Self {
            layout: Arc::new(Layout::new(cfg)),
            pool: Arc::default(),
            tape_values: TAPE_VALUES,
            packed: None,
            precision: Precision::F32,
        }
    }

    /// The same for a network whose `weights` (in the order of [`Fused::names`]) never change.
    pub(crate) fn frozen(&self, weights: &[Tensor], precision: Precision) -> Result<Self> {
        Ok(Self { packed: Some(Arc::new(self.pack(weights, precision)?)), precision, ..self.clone() })
    }

    /// What the packed weights are multiplied in.
    pub(crate) fn precision(&self) -> Precision {
        self.precision
    }

    /// The packed weights of a frozen network.
    pub(crate) fn packed(&self) -> Option<&Net<Packed>> {
        self.packed.as_deref()
    }

    /// Whether the weights are packed already.
    pub(crate) fn is_frozen(&self) -> bool {
        self.packed.is_some()
    }

    /// Packs `weights` for roll-outs without a gradient.
    fn pack(&self, weights: &[Tensor], precision: Precision) -> Result<Net<Packed>> {
        let flat = weights.iter().map(Tensor::flatten_all).collect::<Result<Vec<_>>>()?;
        let flat = Tensor::cat(&flat, 0)?.to_vec1::<f32>()?;
        Ok(self.layout.packed(&flat, false, precision))
    }

    /// All chunks without a gradient.
    fn roll_out(&self, batch: &Batch, net: &Net<Packed>, detail: Detail) -> Vec<Outcome> {
        let roll_out = |chunk: &Chunk<'_>| {
            let (outcome, tape) = forward::roll_out(chunk, net, &self.pool, false, detail);
            tape.recycle(&self.pool, self.tape_values);
            outcome
        };
        batch.chunks(rayon::current_num_threads(), false).par_iter().map(roll_out).collect()
    }

    /// Whether `phase` trains the weight of that name.
    pub(crate) fn trains(&self, phase: Phase, name: &str) -> bool {
        let place = self.layout.names.iter().position(|(known, _)| known == name);
        place.is_some_and(|index| self.layout.trained(index, phase))
    }

    /// Names and shapes of the weights in the order of the flat vector.
    pub(crate) fn names(&self) -> &[(String, Vec<usize>)] {
        &self.layout.names
    }

    /// The path `[batch, goals, steps, 2]` with a gradient to goals, observations and the `weights` (in the order of
    /// [`Fused::names`]) that `phase` trains.
    pub(crate) fn path(
        &self,
        network: &SocialForce,
        weights: &[Tensor],
        batch: &RollOutBatch,
        sizes: Sizes,
        phase: Phase,
    ) -> Result<Tensor> {
        let (goals, observed) = (batch.goals.to_dtype(DType::F32)?, batch.observed.to_dtype(DType::F32)?);
        let inputs = goals.track_op() || observed.track_op();
        if let Some(net) = self.packed.as_ref().filter(|_| !inputs) {
            let batch = Batch::new(network, batch, sizes, phase)?;
            let paths: Vec<_> =
                self.roll_out(&batch, net, Detail::Path).into_iter().map(|outcome| outcome.path).collect();
            return Tensor::from_vec(paths.concat(), (sizes.batch, sizes.goals, batch.steps, 2), &Device::Cpu);
        }
        let part = |(i, weight): (usize, &Tensor)| {
            let flat = weight.flatten_all()?;
            Ok(if self.layout.trained(i, phase) { flat } else { flat.detach() })
        };
        let flat = Tensor::cat(&weights.iter().enumerate().map(part).collect::<Result<Vec<_>>>()?, 0)?;
        let keep = flat.track_op() || inputs;
        let batch = Batch::new(network, batch, sizes, phase)?;
        let threads = rayon::current_num_threads();
        let operation = Operation { fused: self.clone(), batch, threads, keep, inputs, memory: Mutex::default() };
        flat.apply_op3(&goals, &observed, operation)
    }

    /// The roll-out with its parts.
    pub(crate) fn explain(
        &self,
        network: &SocialForce,
        weights: &[Tensor],
        batch: &RollOutBatch,
        sizes: Sizes,
        phase: Phase,
    ) -> Result<RollOut> {
        let batch = Batch::new(network, batch, sizes, phase)?;
        let net = match &self.packed {
            Some(net) => Arc::clone(net),
            None => Arc::new(self.pack(weights, Precision::F32)?),
        };
        explained(self.roll_out(&batch, &net, Detail::Parameters), &batch)
    }
}

/// The parts of all chunks as tensors.
fn explained(outcomes: Vec<Outcome>, batch: &Batch) -> Result<RollOut> {
    let (paths, records): (Vec<_>, Vec<_>) =
        outcomes.into_iter().map(|o| (o.path, o.record.unwrap_or_default())).unzip();
    let tensor = |values: Vec<f32>, inner: &[usize]| {
        let shape = [&[batch.sizes.batch, batch.sizes.goals, batch.steps], inner].concat();
        Tensor::from_vec(values, shape, &Device::Cpu)
    };
    let part = |of: &dyn Fn(&Record) -> &Vec<f32>, inner: &[usize]| {
        let values: Vec<f32> = records.iter().flat_map(|record| of(record).iter().copied()).collect();
        tensor(values, inner)
    };
    let term = |(i, (term, sources)): (usize, (&Arc<TermDescriptor>, usize))| {
        let parameter = |j: usize| part(&|record| &record.terms[i].parameters[j], &[sources]);
        Ok(TermRollOut {
            term: term.clone(),
            forces: part(&|record| &record.terms[i].forces, &[sources, 2])?,
            parameters: (0..term.varying().count()).map(parameter).collect::<Result<_>>()?,
        })
    };
    Ok(RollOut {
        path: tensor(paths.concat(), &[2])?,
        velocity: part(&|record| &record.velocity, &[2])?,
        terms: batch.acting().enumerate().map(term).collect::<Result<_>>()?,
    })
}

/// From the flat weights, goals and observations to the path.
struct Operation {
    fused: Fused,
    batch: Batch,
    /// Threads that the batch is cut into chunks for, forward and backward.
    threads: usize,
    /// Whether there will be a gradient.
    keep: bool,
    /// Whether there will be one to goals or observations.
    inputs: bool,
    memory: Mutex<Memory>,
}

/// What goes from the forward pass to the backward one.
#[derive(Default)]
struct Memory {
    net: Option<Arc<Net<Packed>>>,
    /// One for each chunk, as far as they fit.
    tapes: Vec<Option<Tape>>,
}

impl Operation {
    fn memory(&self) -> MutexGuard<'_, Memory> {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The gradients of one chunk for the gradient `dpath` of the whole path.
    fn undo(
        &self,
        chunk: &Chunk<'_>,
        net: &Net<Packed>,
        tape: Option<Tape>,
        dpath: &[f32],
    ) -> (Net<Gradient>, Option<InputGradient>) {
        let (pool, width) = (&self.fused.pool, self.batch.sizes.goals * self.batch.steps * 2);
        let mut tape = tape.unwrap_or_else(|| forward::roll_out(chunk, net, pool, true, Detail::Path).1);
        let mut gradient = self.fused.layout.maps.map(|dense| Gradient::zeros(dense, chunk.groups()));
        let dpath = &dpath[chunk.windows.start * width..chunk.windows.end * width];
        let inputs = backward::adjoint(chunk, net, &mut tape, dpath, &mut gradient, self.inputs);
        tape.recycle(pool, self.fused.tape_values);
        (gradient, inputs)
    }
}

impl CustomOp3 for Operation {
    fn name(&self) -> &'static str {
        "social-force-roll-out"
    }

    /// The batch has read goals and observations already.
    fn cpu_fwd(
        &self,
        storage: &CpuStorage,
        strides: &Strides,
        _goals: &CpuStorage,
        _: &Strides,
        _observed: &CpuStorage,
        _: &Strides,
    ) -> Result<(CpuStorage, Shape)> {
        let Some((start, end)) = strides.contiguous_offsets() else { candle_core::bail!("flat weights are strided") };
        let flat = &storage.as_slice::<f32>()?[start..end];
        let net = Arc::new(self.fused.layout.packed(flat, self.keep, Precision::F32));
        let chunks = self.batch.chunks(self.threads, self.keep);
        let room = self.fused.tape_values / self.batch.tape_values_a_window(&net).max(1);
        let done: Vec<(Vec<f32>, Option<Tape>)> = chunks
            .par_iter()
            .map(|chunk| {
                let keep = self.keep && chunk.windows.end <= room;
                let (outcome, tape) = forward::roll_out(chunk, &net, &self.fused.pool, keep, Detail::Path);
                if keep {
                    return (outcome.path, Some(tape));
                }
                tape.recycle(&self.fused.pool, self.fused.tape_values);
                (outcome.path, None)
            })
            .collect();
        let (paths, tapes): (Vec<_>, Vec<_>) = done.into_iter().unzip();
        if self.keep {
            *self.memory() = Memory { net: Some(net), tapes };
        }
        let sizes = self.batch.sizes;
        let shape = (sizes.batch, sizes.goals, self.batch.steps, 2);
        Ok((CpuStorage::F32(paths.concat()), shape.into()))
    }

    fn bwd(
        &self,
        flat: &Tensor,
        goals: &Tensor,
        observed: &Tensor,
        _path: &Tensor,
        dpath: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let Memory { net, tapes } = std::mem::take(&mut *self.memory());
        let Some(net) = net else {
            candle_core::bail!("a roll-out passes its gradient back once; roll out again before the next backward pass")
        };
        let dpath = dpath.flatten_all()?.to_vec1::<f32>()?;
        let mut work: Vec<_> = self.batch.chunks(self.threads, true).into_iter().zip(tapes).collect();
        let mut sum = vec![0.; flat.elem_count()];
        let (mut dgoals, mut dobserved) = (Vec::new(), Vec::new());
        while !work.is_empty() {
            // As many at a time as there are threads: the weight gradients of all would be large.
            let some: Vec<_> = work.drain(..self.threads.clamp(1, work.len())).collect();
            let (gradients, inputs): (Vec<Net<Gradient>>, Vec<Option<InputGradient>>) =
                some.into_par_iter().map(|(chunk, tape)| self.undo(&chunk, &net, tape, &dpath)).unzip();
            self.fused.layout.add(&gradients, &mut sum);
            for inputs in inputs.into_iter().flatten() {
                dgoals.extend(inputs.goals);
                dobserved.extend(inputs.observed);
            }
        }
        let tensor = |values, like: &Tensor| Tensor::from_vec(values, like.shape(), like.device());
        let (dgoals, dobserved) =
            if self.inputs { (Some(tensor(dgoals, goals)?), Some(tensor(dobserved, observed)?)) } else { (None, None) };
        Ok((Some(tensor(sum, flat)?), dgoals, dobserved))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NeighbourStates, Neighbours};
    use candle_core::{DType, Var};

    #[test]
    fn chunks_without_a_tape_give_the_same_gradient() -> std::result::Result<(), Box<dyn std::error::Error>> {
        let cfg =
            TrajConfig { hidden: 6, embedding: 5, encoder: vec![7], decoder: vec![9, 8], ..TrajConfig::published() };
        let wave = |shape: &[usize]| -> Result<Tensor> {
            let values: Vec<f32> = (0..shape.iter().product()).map(|i: usize| (i as f32 * 0.7).sin()).collect();
            Tensor::from_vec(values, shape, &Device::Cpu)
        };
        let batch = RollOutBatch {
            observed: wave(&[40, 3, 4])?,
            goals: wave(&[40, 1, 2])?,
            neighbours: Some(Neighbours {
                states: NeighbourStates::Given(wave(&[40, 6, 2, 4])?),
                present: Tensor::ones((40, 2), DType::F32, &Device::Cpu)?,
            }),
            lines: None,
            dt: 0.1,
            steps: 6,
        };
        let network = SocialForce::new(&cfg, gnp_nn::Weights::seeded(1, &Device::Cpu).builder())?;
        let sizes = batch.check(&cfg, &network.terms, Phase::Full)?;
        let mut fused = Fused::new(&cfg);
        let weights: Vec<Var> =
            fused.names().iter().map(|(_, shape)| Var::from_tensor(&wave(shape)?)).collect::<Result<_>>()?;
        let tensors: Vec<Tensor> = weights.iter().map(|weight| weight.as_tensor().clone()).collect();
        let mut gradients = |tape_values: usize| -> Result<Vec<Vec<f32>>> {
            fused.tape_values = tape_values;
            let grads = fused.path(&network, &tensors, &batch, sizes, Phase::Full)?.sqr()?.sum_all()?.backward()?;
            let of = |weight: &Var| match grads.get(weight) {
                Some(gradient) => gradient.flatten_all()?.to_vec1(),
                None => Ok(Vec::new()),
            };
            weights.iter().map(of).collect()
        };
        let kept = gradients(TAPE_VALUES)?;
        assert!(kept.iter().all(|gradient| gradient.iter().any(|&v| v != 0.)));
        assert_eq!(gradients(0)?, kept);
        Ok(())
    }
}
