//! Which modes are decoded.

use std::borrow::Cow;

use candle_core::{D, Device, Result, Tensor};

use crate::error::GoalError;

/// Which modes are decoded.
#[derive(Clone, Debug)]
pub enum Pick {
    /// These, `[batch, k]` of `u32`: in training, the one nearest to the truth. On a GPU they are not looked at
    /// before they are used.
    Indices(Tensor),
    /// The `k` most probable of each window, likeliest first, the lower index among equals (on a GPU in any order); all
    /// of them where there are fewer.
    MostProbable(usize),
    /// All, in the order of the modes: in training, where their mean is learned.
    All,
}

impl Pick {
    /// For every of `batch` windows with `modes` modes, on `device`.
    pub(crate) fn of_windows(
        &self,
        batch: usize,
        modes: usize,
        device: &Device,
    ) -> std::result::Result<Picked, GoalError> {
        if !device.is_cpu() {
            return Ok(Picked::OnDevice(self.clone()));
        }
        Ok(match self {
            Self::Indices(indices) => {
                // Checked here, because one beyond the last mode is the next window's first.
                let picked = indices.flatten_all()?.to_vec1::<u32>()?;
                if let Some(index) = picked.iter().find(|index| **index as usize >= modes) {
                    return Err(GoalError::Mode { index: *index, modes });
                }
                Picked::Given { count: picked.len() / batch.max(1), indices: picked }
            }
            Self::All => Picked::All(modes),
            Self::MostProbable(k) => Picked::MostProbable((*k).min(modes)),
        })
    }
}

/// Which modes are decoded, after the sizes were compared.
#[derive(Clone, Debug)]
pub(crate) enum Picked {
    /// `count` of every window, one window after the other.
    Given { count: usize, indices: Vec<u32> },
    /// So many of the most probable.
    MostProbable(usize),
    /// All of so many.
    All(usize),
    /// What a GPU picks for itself, without the host looking at anything: it would wait for the GPU, whose kernel stops
    /// the program at an index that is too large.
    OnDevice(Pick),
}

impl Picked {
    /// Modes picked of a window, on the host.
    pub(crate) fn count(&self) -> usize {
        match self {
            Self::Given { count, .. } | Self::MostProbable(count) | Self::All(count) => *count,
            Self::OnDevice(_) => 0,
        }
    }

    /// Those of window `window`, of which all modes have these `logits`, on the host.
    pub(crate) fn of_window(&self, window: usize, logits: &[f32]) -> Cow<'_, [u32]> {
        match self {
            Self::Given { count, indices } => Cow::Borrowed(&indices[window * count..][..*count]),
            Self::MostProbable(count) => {
                let mut order = Vec::new();
                likeliest_first(logits, &mut order);
                order.truncate(*count);
                Cow::Owned(order)
            }
            Self::All(count) => Cow::Owned((0..*count as u32).collect()),
            Self::OnDevice(_) => Cow::Borrowed(&[]),
        }
    }

    /// Indices `[batch, k]` for `logits` `[batch, modes]`.
    pub(crate) fn indices(&self, logits: &Tensor) -> Result<Tensor> {
        let (batch, modes) = logits.dims2()?;
        let k = match self {
            Self::OnDevice(Pick::Indices(indices)) => return Ok(indices.clone()),
            Self::OnDevice(Pick::MostProbable(k)) => return sorted(logits, (*k).min(modes)),
            Self::OnDevice(Pick::All) => {
                let all = Tensor::arange(0u32, modes as u32, logits.device())?;
                return all.unsqueeze(0)?.broadcast_as((batch, modes))?.contiguous();
            }
            on_host => on_host.count(),
        };
        let mut picked = Vec::with_capacity(batch * k);
        for (window, row) in logits.to_vec2::<f32>()?.iter().enumerate() {
            picked.extend_from_slice(&self.of_window(window, row));
        }
        Tensor::from_vec(picked, (batch, k), logits.device())
    }
}

/// The indices of `logits`, the largest first, the lower index among equals.
pub(crate) fn likeliest_first(logits: &[f32], order: &mut Vec<u32>) {
    order.clear();
    order.extend(0..logits.len() as u32);
    order.sort_unstable_by(|a, b| logits[*b as usize].total_cmp(&logits[*a as usize]).then(a.cmp(b)));
}

/// The indices `[batch, k]` of the largest of `logits` `[batch, modes]`, found on their device.
fn sorted(logits: &Tensor, k: usize) -> Result<Tensor> {
    logits.contiguous()?.arg_sort_last_dim(false)?.narrow(1, 0, k)?.contiguous()
}

/// The rows `indices` `[batch, k]` of `x` `[batch, modes, width]`, `[batch, k, width]`.
pub(crate) fn rows(x: &Tensor, indices: &Tensor) -> Result<Tensor> {
    let (batch, modes, width) = x.dims3()?;
    if !x.device().is_cpu() {
        return gathered(x, indices);
    }
    let (_, k) = indices.dims2()?;
    // One selection over all windows: its gradient adds rows, where a gather would need an index
    // for each value.
    let first = Tensor::arange_step(0u32, (batch * modes) as u32, modes as u32, x.device())?;
    let flat = indices.broadcast_add(&first.unsqueeze(D::Minus1)?)?.flatten_all()?;
    x.reshape((batch * modes, width))?.index_select(&flat, 0)?.reshape((batch, k, width))
}

/// As [`rows`] by an index for each value: on a GPU the gradient of a selection over all windows would be added up row by
/// row, one after the other.
fn gathered(x: &Tensor, indices: &Tensor) -> Result<Tensor> {
    let ((batch, k), width) = (indices.dims2()?, x.dim(D::Minus1)?);
    let index = indices.unsqueeze(D::Minus1)?.broadcast_as((batch, k, width))?.contiguous()?;
    x.contiguous()?.gather(&index, 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Var;

    #[test]
    fn what_gpus_run_picks_the_same() -> std::result::Result<(), Box<dyn std::error::Error>> {
        let logits = Tensor::new(&[[0.1f32, 3., -1., 2.], [5., 4., 6., 1.]], &Device::Cpu)?;
        let picked = Pick::MostProbable(3).of_windows(2, 4, &Device::Cpu)?.indices(&logits)?;
        for pick in [Pick::MostProbable(3), Pick::MostProbable(9), Pick::All, Pick::Indices(picked.clone())] {
            let on_host = pick.of_windows(2, 4, &Device::Cpu)?.indices(&logits)?.to_vec2::<u32>()?;
            assert_eq!(Picked::OnDevice(pick).indices(&logits)?.to_vec2::<u32>()?, on_host);
        }
        let x = Var::from_tensor(&Tensor::arange(0f32, 24., &Device::Cpu)?.reshape((2, 4, 3))?)?;
        let weigh = Tensor::arange(1f32, 19., &Device::Cpu)?.reshape((2, 3, 3))?;
        let run = |of: fn(&Tensor, &Tensor) -> Result<Tensor>| -> Result<[Vec<f32>; 2]> {
            let out = of(&x, &picked)?;
            let gradients = (&out * &weigh)?.sum_all()?.backward()?;
            let gradient = gradients.get(&x).ok_or_else(|| candle_core::Error::msg("no gradient"))?;
            Ok([out.flatten_all()?.to_vec1()?, gradient.flatten_all()?.to_vec1()?])
        };
        assert_eq!(run(gathered)?, run(rows)?);
        Ok(())
    }

    #[test]
    fn the_most_probable_come_first() -> std::result::Result<(), Box<dyn std::error::Error>> {
        let logits = Tensor::new(&[[0.1f32, 3., -1., 3.], [5., 4., 6., 1.]], &Device::Cpu)?;
        let indices = |pick: Pick| -> std::result::Result<Tensor, GoalError> {
            Ok(pick.of_windows(2, 4, &Device::Cpu)?.indices(&logits)?)
        };
        assert_eq!(indices(Pick::MostProbable(3))?.to_vec2::<u32>()?, [[1, 3, 0], [2, 0, 1]]);
        assert_eq!(indices(Pick::MostProbable(9))?.dims(), [2, 4]);
        assert_eq!(indices(Pick::All)?.to_vec2::<u32>()?, [[0, 1, 2, 3], [0, 1, 2, 3]]);
        let given = [[3u32], [1]];
        assert_eq!(indices(Pick::Indices(Tensor::new(&given, &Device::Cpu)?))?.to_vec2::<u32>()?, given);
        Ok(())
    }

    #[test]
    fn rows_come_from_their_own_window() -> Result<()> {
        let x = Tensor::arange(0f32, 2. * 3. * 2., &Device::Cpu)?.reshape((2, 3, 2))?;
        let picked = rows(&x, &Tensor::new(&[[2u32], [0]], &Device::Cpu)?)?;
        assert_eq!(picked.to_vec3::<f32>()?, [[[4., 5.]], [[6., 7.]]]);
        Ok(())
    }
}
