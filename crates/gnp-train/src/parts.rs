//! A mini-batch in parts that threads share out.
//!
//! Which windows are in a part depends on the batch alone, what is drawn for a window on its place in the batch, and
//! gradients add up in the order of the parts: the same bits come out on any number of threads.

use std::sync::atomic::{AtomicBool, Ordering};

use candle_core::backprop::GradStore;
use gnp_nn::LaunchCache;
use rayon::prelude::*;

use crate::error::TrainError;
use crate::stage::{BatchTotals, Part, Stage};

/// Parts of a batch at most, since each keeps a gradient of every weight until all are there.
const MOST_PARTS: usize = 16;

/// What a mini-batch came to.
pub(crate) struct Made {
    /// Mean over its windows.
    pub(crate) loss: f32,
    /// Of each part; their sum is the gradient of the loss. None where the loss is not finite.
    pub(crate) gradients: Vec<GradStore>,
}

/// Loss and gradients of a mini-batch of at least one window.
pub(crate) fn made(stage: &dyn Stage, batch: Part<'_>) -> Result<Made, TrainError> {
    let Some(size) = stage.part_windows() else { return made_of(stage, batch, 1.) };
    let all = batch.windows.len();
    let size = size.max(all.div_ceil(MOST_PARTS)).max(1);
    let part = |(i, windows): (usize, &[usize])| {
        made_of(stage, Part { windows, first: i * size, ..batch }, windows.len() as f64 / all as f64)
    };
    let parts: Vec<Result<Made, TrainError>> = batch.windows.par_chunks(size).enumerate().map(part).collect();
    let mut sum = Made { loss: 0., gradients: Vec::new() };
    // The first error in the order of the parts, whichever came first.
    for part in parts {
        let part = part?;
        sum.loss += part.loss;
        sum.gradients.extend(part.gradients);
    }
    Ok(sum)
}

/// What one part, which is this share of the batch, adds to its loss and gradient.
fn made_of(stage: &dyn Stage, part: Part<'_>, share: f64) -> Result<Made, TrainError> {
    let mut tensor = stage.loss(part)?;
    if share < 1. {
        tensor = (tensor * share)?;
    }
    let loss = tensor.to_scalar::<f32>()?;
    if !loss.is_finite() {
        return Ok(Made { loss, gradients: Vec::new() });
    }
    let _sent = LaunchCache::on(tensor.device());
    Ok(Made { loss, gradients: vec![tensor.backward()?] })
}

/// Scores of the validation windows `windows`, in batches of `batch` or in parts; nothing when the stop flag ended them.
pub(crate) fn scored(
    stage: &dyn Stage,
    windows: &[usize],
    batch: usize,
    stop: &AtomicBool,
) -> Option<Vec<Result<BatchTotals, TrainError>>> {
    let score = |windows: &[usize]| (!stop.load(Ordering::Relaxed)).then(|| stage.validate(windows));
    match stage.part_windows() {
        Some(size) => windows.par_chunks(size.clamp(1, batch)).map(score).collect(),
        None => windows.chunks(batch).map(score).collect(),
    }
}
