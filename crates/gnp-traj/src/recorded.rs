//! The roll-out on a GPU as one launch instead of thousands: recorded when a batch of the same sizes comes again.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

use candle_core::backend::BackendStorage as _;
use candle_core::{CpuStorage, CudaStorage, CustomOp1, Error, Layout, Result, Shape, Storage, Tensor};
use gnp_nn::Replay;

use crate::graph;
use crate::network::SocialForce;
use crate::roll_out::Sizes;
use crate::{Lines, NeighbourStates, Neighbours, Phase, RollOutBatch};

/// Recordings that a thread makes of one network in one phase; each holds the memory that its work needs. The first ones
/// stay, so that sizes that change all the time are not recorded for ever.
const KEPT: usize = 8;

thread_local! {
    /// Only the thread that recorded something may launch it.
    static RECORDINGS: RefCell<Recordings> =
        const { RefCell::new(Recordings { of: None, made: Vec::new(), seen: VecDeque::new() }) };
}

#[derive(Default)]
struct Recordings {
    of: Option<(Arc<()>, Phase)>,
    /// None where it could not be made, for want of memory for one.
    made: Vec<(Key, Option<Rc<Replay>>)>,
    /// What was asked for once, the last first; that may have been the only time.
    seen: VecDeque<Key>,
}

/// What a recording is of, beside network and phase.
#[derive(Clone, PartialEq)]
struct Key {
    gradient: bool,
    shapes: Vec<Vec<usize>>,
    joint: bool,
    lines: bool,
    dt: u64,
    steps: usize,
}

enum Found {
    Recorded(Rc<Replay>),
    ToBeRecorded,
    ByOperation,
}

/// A roll-out that can be recorded.
#[derive(Clone)]
struct RollOut {
    network: SocialForce,
    batch: RollOutBatch,
    sizes: Sizes,
    phase: Phase,
}

/// The path, as [`graph::roll_out`] has it; nothing where only that can say it: on other devices, with a gradient to
/// anything but weights, and with terms that act on the host.
pub(crate) fn path(network: &SocialForce, batch: &RollOutBatch, sizes: Sizes, phase: Phase) -> Result<Option<Tensor>> {
    let tracked: Vec<&Tensor> = network.weights.iter().filter(|weight| weight.track_op()).collect();
    let records = batch.observed.device().is_cuda()
        && network.terms.fixed().next().is_none()
        && inputs(batch).iter().all(|input| !input.track_op())
        && tracked.iter().all(|weight| weight.is_variable());
    if !records {
        return Ok(None);
    }
    let roll_out = RollOut { network: network.clone(), batch: batch.clone(), sizes, phase };
    if tracked.is_empty() {
        return roll_out.path().map(Some);
    }
    let flat: Vec<Tensor> = network.weights.iter().map(Tensor::flatten_all).collect::<Result<_>>()?;
    Tensor::cat(&flat, 0)?.apply_op1(roll_out).map(Some)
}

impl RollOut {
    fn path(&self) -> Result<Tensor> {
        let network = self.network.detached().map_err(Error::wrap)?;
        let work = |given: &[Tensor]| -> Result<Vec<Tensor>> {
            Ok(vec![graph::roll_out(&network, &of_inputs(&self.batch, given), self.sizes, self.phase)?.path])
        };
        self.launch(false, &inputs(&self.batch), work)?.into_iter().next().ok_or_else(nothing)
    }

    /// The gradient of all weights, end to end, for the path's gradient `d_path`. The path is rolled out once more.
    fn gradient(&self, d_path: &Tensor) -> Result<Tensor> {
        let work = |given: &[Tensor]| -> Result<Vec<Tensor>> {
            let [given @ .., d_path] = given else { return Err(nothing()) };
            let batch = of_inputs(&self.batch, given);
            let path = graph::roll_out(&self.network, &batch, self.sizes, self.phase)?.path;
            let all = (path * d_path)?.sum_all()?.backward()?;
            let of = |weight: &Tensor| match all.get(weight) {
                Some(gradient) => gradient.detach().flatten_all(),
                None => weight.detach().zeros_like()?.flatten_all(),
            };
            let gradients: Vec<Tensor> = self.network.weights.iter().map(of).collect::<Result<_>>()?;
            Ok(vec![Tensor::cat(&gradients, 0)?])
        };
        let mut given = inputs(&self.batch);
        given.push(d_path.detach());
        self.launch(true, &given, work)?.into_iter().next().ok_or_else(nothing)
    }

    /// What `work` makes of `given`: recorded where that was asked for before.
    fn launch(
        &self,
        gradient: bool,
        given: &[Tensor],
        work: impl Fn(&[Tensor]) -> Result<Vec<Tensor>>,
    ) -> Result<Vec<Tensor>> {
        let RollOutBatch { neighbours, lines, dt, steps, .. } = &self.batch;
        let joint = neighbours.as_ref().is_some_and(|of| matches!(of.states, NeighbourStates::Joint { .. }));
        let shapes = given.iter().map(|input| input.dims().to_vec()).collect();
        let key = Key { gradient, shapes, joint, lines: lines.is_some(), dt: dt.to_bits(), steps: *steps };
        let found = RECORDINGS.with_borrow_mut(|kept| kept.find(&self.network.identity, self.phase, &key));
        let replay = match found {
            Found::ByOperation => None,
            Found::Recorded(replay) => Some(replay),
            Found::ToBeRecorded => {
                let replay = Replay::record(given[0].device(), given, &work).ok().map(Rc::new);
                RECORDINGS.with_borrow_mut(|kept| kept.made.push((key, replay.clone())));
                replay
            }
        };
        replay.map_or_else(|| work(given), |replay| replay.run(given))
    }
}

impl Recordings {
    /// What there is for `key`, which is noted.
    fn find(&mut self, network: &Arc<()>, phase: Phase, key: &Key) -> Found {
        if self.of.as_ref().is_none_or(|(of, its)| !Arc::ptr_eq(of, network) || *its != phase) {
            *self = Self { of: Some((network.clone(), phase)), ..Self::default() };
        }
        if let Some((_, made)) = self.made.iter().find(|(of, _)| of == key) {
            return made.clone().map_or(Found::ByOperation, Found::Recorded);
        }
        if self.seen.contains(key) && self.made.len() < KEPT {
            return Found::ToBeRecorded;
        }
        self.seen.truncate(KEPT - 1);
        self.seen.push_front(key.clone());
        Found::ByOperation
    }
}

impl CustomOp1 for RollOut {
    fn name(&self) -> &'static str {
        "recorded-roll-out"
    }

    fn cpu_fwd(&self, _: &CpuStorage, _: &Layout) -> Result<(CpuStorage, Shape)> {
        candle_core::bail!("recorded roll-outs are for GPUs")
    }

    fn cuda_fwd(&self, _: &CudaStorage, _: &Layout) -> Result<(CudaStorage, Shape)> {
        let path = self.path()?.contiguous()?;
        let (storage, layout) = path.storage_and_layout();
        match &*storage {
            Storage::Cuda(storage) => Ok((storage.try_clone(layout)?, path.shape().clone())),
            _ => Err(nothing()),
        }
    }

    fn bwd(&self, _: &Tensor, _: &Tensor, d_path: &Tensor) -> Result<Option<Tensor>> {
        self.gradient(d_path).map(Some)
    }
}

fn nothing() -> Error {
    Error::Msg("a roll-out left nothing on its GPU".to_owned())
}

/// The tensors of a batch.
fn inputs(batch: &RollOutBatch) -> Vec<Tensor> {
    let mut all = vec![batch.observed.clone(), batch.goals.clone()];
    if let Some(Neighbours { states, present }) = &batch.neighbours {
        match states {
            NeighbourStates::Given(states) => all.push(states.clone()),
            NeighbourStates::Joint { index, offset } => all.extend([index.clone(), offset.clone()]),
        }
        all.push(present.clone());
    }
    if let Some(Lines { lines, present }) = &batch.lines {
        all.extend([lines.clone(), present.clone()]);
    }
    all
}

/// A batch like `batch` of other tensors, in the order of [`inputs`].
fn of_inputs(batch: &RollOutBatch, tensors: &[Tensor]) -> RollOutBatch {
    let mut tensors = tensors.iter().cloned();
    let mut next = |old: &Tensor| tensors.next().unwrap_or_else(|| old.clone());
    let (observed, goals) = (next(&batch.observed), next(&batch.goals));
    let neighbours = batch.neighbours.as_ref().map(|old| Neighbours {
        states: match &old.states {
            NeighbourStates::Given(states) => NeighbourStates::Given(next(states)),
            NeighbourStates::Joint { index, offset } => {
                NeighbourStates::Joint { index: next(index), offset: next(offset) }
            }
        },
        present: next(&old.present),
    });
    let lines = batch.lines.as_ref().map(|old| Lines { lines: next(&old.lines), present: next(&old.present) });
    RollOutBatch { observed, goals, neighbours, lines, ..*batch }
}
