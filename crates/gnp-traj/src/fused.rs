//! The roll-out as one operation with a hand-derived adjoint, for CPUs.
//!
//! A graph of some thousand small operations spends its time on allocating, dispatching and
//! synchronising them. Here the windows are cut into chunks, and each thread carries a chunk through
//! all steps by itself:
//!
//! - All weights are one flat vector (`layout`), packed once a call for the products of [`gnp_nn::kernels`].
//! - `forward` runs the networks (`history_encoder`, `head`, `mlp`) and the physics of `gnp_force` step by step;
//!   what `backward` needs stays in the buffers of a tape, and without a gradient nothing stays.
//! - Empty slots and lines are left out rather than masked, and the history is occupied in once a window.
//! - Chunks do not depend on the number of threads and gradients add up in their order, so that the
//!   same bits come out on any number of them.
//!
//! Widths are padded to whole cache lines with zeros in the weights, so that padding stays zero or is
//! multiplied by zero throughout.

mod backward;
mod batch;
mod forward;
mod head;
mod history_encoder;
mod layout;
mod mlp;
mod trace;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use candle_core::{CpuStorage, CustomOp1, Device, Layout as Strides, Result, Shape, Tensor};
use gnp_nn::kernels::Pool;
use rayon::prelude::*;

use self::batch::{Batch, Chunk};
use self::forward::{Outcome, Record, Tape};
use self::layout::{Gradient, Net, Packed};
use crate::scene::Sizes;
use crate::{Phase, RollOut, Scene, TrajConfig};

pub(crate) use self::layout::Layout;

/// Values (4 bytes each) that the tapes of one batch may hold; chunks beyond go forward once more
/// before they go backward. Also what waits for the next batch at most.
const TAPE_VALUES: usize = 1 << 28;

/// Chunks whose weight gradients exist at a time.
const GROUP: usize = 16;

/// What a network keeps from one roll-out to the next: the layout of its weights and idle memory.
#[derive(Clone, Debug)]
pub(crate) struct Fused {
    layout: Arc<Layout>,
    pool: Arc<Pool>,
    tape_values: usize,
}

impl Fused {
    pub(crate) fn new(cfg: &TrajConfig) -> Self {
        Self { layout: Arc::new(Layout::new(cfg)), pool: Arc::default(), tape_values: TAPE_VALUES }
    }

    /// Names and shapes of the weights in the order of the flat vector.
    pub(crate) fn names(&self) -> &[(String, Vec<usize>)] {
        &self.layout.names
    }

    /// The path `[batch, goals, steps, 2]` with a gradient to the `weights` (in the order of
    /// [`Fused::names`]) that `phase` trains.
    pub(crate) fn path(
        &self,
        cfg: &TrajConfig,
        weights: &[Tensor],
        scene: &Scene,
        sizes: Sizes,
        phase: Phase,
    ) -> Result<Tensor> {
        let part = |(i, weight): (usize, &Tensor)| {
            let flat = weight.flatten_all()?;
            Ok(if self.layout.trained(i, phase) { flat } else { flat.detach() })
        };
        let flat = Tensor::cat(&weights.iter().enumerate().map(part).collect::<Result<Vec<_>>>()?, 0)?;
        let batch = Batch::new(cfg, scene, sizes, phase)?;
        let keep = flat.track_op();
        flat.apply_op1(Operation { fused: self.clone(), batch, keep, memory: Mutex::default() })
    }

    /// The roll-out with its parts.
    pub(crate) fn explain(
        &self,
        cfg: &TrajConfig,
        weights: &[Tensor],
        scene: &Scene,
        sizes: Sizes,
        phase: Phase,
    ) -> Result<RollOut> {
        let flat = weights.iter().map(Tensor::flatten_all).collect::<Result<Vec<_>>>()?;
        let flat = Tensor::cat(&flat, 0)?.to_vec1::<f32>()?;
        let batch = Batch::new(cfg, scene, sizes, phase)?;
        let net = self.layout.maps.map(|dense| Packed::new(dense, &flat, false));
        let chunks = batch.chunks();
        let outcomes: Vec<Outcome> = chunks
            .par_iter()
            .map(|chunk| {
                let (outcome, tape) = forward::roll_out(chunk, &net, &self.pool, false, true);
                tape.recycle(&self.pool, self.tape_values);
                outcome
            })
            .collect();
        explained(outcomes, sizes, scene.steps)
    }
}

/// The parts of all chunks as tensors.
fn explained(outcomes: Vec<Outcome>, sizes: Sizes, steps: usize) -> Result<RollOut> {
    let (paths, records): (Vec<_>, Vec<_>) =
        outcomes.into_iter().map(|o| (o.path, o.record.unwrap_or_default())).unzip();
    let tensor = |values: Vec<f32>, inner: &[usize]| {
        let shape = [&[sizes.batch, sizes.goals, steps], inner].concat();
        Tensor::from_vec(values, shape, &Device::Cpu)
    };
    let part = |of: fn(&Record) -> &Vec<f32>, inner: &[usize]| {
        let values: Vec<f32> = records.iter().flat_map(|record| of(record).iter().copied()).collect();
        tensor(values, inner)
    };
    let (slots, lines) = (sizes.slots, sizes.lines);
    let there = |size: usize, part: Result<Tensor>| if size > 0 { part.map(Some) } else { Ok(None) };
    Ok(RollOut {
        path: tensor(paths.concat(), &[2])?,
        velocity: part(|r| &r.velocity, &[2])?,
        goal_force: part(|r| &r.goal_force, &[2])?,
        tau: part(|r| &r.tau, &[])?,
        neighbour_forces: there(slots, part(|r| &r.neighbour_forces, &[slots, 2]))?,
        k: there(slots, part(|r| &r.k, &[slots]))?,
        line_forces: there(lines, part(|r| &r.line_forces, &[lines]))?,
        k_line: there(lines, part(|r| &r.k_line, &[lines]))?,
    })
}

/// From the flat weights to the path.
struct Operation {
    fused: Fused,
    batch: Batch,
    /// Whether there will be a gradient.
    keep: bool,
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

    /// The weight gradients of one chunk for the gradient `dpath` of the whole path.
    fn undo(&self, chunk: &Chunk<'_>, net: &Net<Packed>, tape: Option<Tape>, dpath: &[f32]) -> Net<Gradient> {
        let (pool, width) = (&self.fused.pool, self.batch.sizes.goals * self.batch.steps * 2);
        let mut tape = tape.unwrap_or_else(|| forward::roll_out(chunk, net, pool, true, false).1);
        let mut gradient = self.fused.layout.maps.map(Gradient::zeros);
        let dpath = &dpath[chunk.windows.start * width..chunk.windows.end * width];
        backward::adjoint(chunk, net, &mut tape, dpath, &mut gradient);
        tape.recycle(pool, self.fused.tape_values);
        gradient
    }
}

impl CustomOp1 for Operation {
    fn name(&self) -> &'static str {
        "social-force-roll-out"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, strides: &Strides) -> Result<(CpuStorage, Shape)> {
        let Some((start, end)) = strides.contiguous_offsets() else { candle_core::bail!("flat weights are strided") };
        let flat = &storage.as_slice::<f32>()?[start..end];
        let net = Arc::new(self.fused.layout.maps.map(|dense| Packed::new(dense, flat, self.keep)));
        let chunks = self.batch.chunks();
        let room = self.fused.tape_values / self.batch.tape_values(&net).max(1);
        let done: Vec<(Vec<f32>, Option<Tape>)> = chunks
            .par_iter()
            .enumerate()
            .map(|(i, chunk)| {
                let keep = self.keep && i < room;
                let (outcome, tape) = forward::roll_out(chunk, &net, &self.fused.pool, keep, false);
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

    fn bwd(&self, flat: &Tensor, _path: &Tensor, dpath: &Tensor) -> Result<Option<Tensor>> {
        let Memory { net, tapes } = std::mem::take(&mut *self.memory());
        let Some(net) = net else {
            candle_core::bail!("a roll-out passes its gradient back once; roll out again before the next backward pass")
        };
        let dpath = dpath.flatten_all()?.to_vec1::<f32>()?;
        let mut work: Vec<_> = self.batch.chunks().into_iter().zip(tapes).collect();
        let mut sum = vec![0.; flat.elem_count()];
        while !work.is_empty() {
            let group: Vec<_> = work.drain(..GROUP.min(work.len())).collect();
            let gradients: Vec<Net<Gradient>> =
                group.into_par_iter().map(|(chunk, tape)| self.undo(&chunk, &net, tape, &dpath)).collect();
            for gradient in &gradients {
                for (gradient, dense) in gradient.iter().zip(self.fused.layout.maps.iter()) {
                    gradient.add_to(dense, &mut sum);
                }
            }
        }
        Tensor::from_vec(sum, flat.shape(), flat.device()).map(Some)
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
        let scene = Scene {
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
        let sizes = scene.check(&cfg, Phase::Full)?;
        let mut fused = Fused::new(&cfg);
        let weights: Vec<Var> =
            fused.names().iter().map(|(_, shape)| Var::from_tensor(&wave(shape)?)).collect::<Result<_>>()?;
        let tensors: Vec<Tensor> = weights.iter().map(|weight| weight.as_tensor().clone()).collect();
        let mut gradients = |tape_values: usize| -> Result<Vec<Vec<f32>>> {
            fused.tape_values = tape_values;
            let grads = fused.path(&cfg, &tensors, &scene, sizes, Phase::Full)?.sqr()?.sum_all()?.backward()?;
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
