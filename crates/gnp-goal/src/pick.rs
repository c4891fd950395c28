//! Which modes are decoded.

use std::borrow::Cow;

use candle_core::{D, Device, Result, Tensor};

use crate::error::GoalError;

/// Which modes are decoded.
#[derive(Clone, Debug)]
pub enum Pick {
    /// These, `[batch, k]` of `u32`: in training, the one nearest to the truth.
    Indices(Tensor),
    /// The `k` most probable of each window, likeliest first, the lower index among equals; all of
    /// them where there are fewer.
    MostProbable(usize),
    /// All, in the order of the modes: in training, where their mean is learned.
    All,
}

impl Pick {
    /// For every of `batch` windows with `modes` modes.
    pub(crate) fn of_windows(&self, batch: usize, modes: usize) -> std::result::Result<Picked, GoalError> {
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
}

impl Picked {
    /// Modes picked of a window.
    pub(crate) fn count(&self) -> usize {
        match self {
            Self::Given { count, .. } => *count,
            Self::MostProbable(count) | Self::All(count) => *count,
        }
    }

    /// Those of window `window`, of which all modes have these `logits`.
    pub(crate) fn of_window(&self, window: usize, logits: &[f32]) -> Cow<'_, [u32]> {
        match self {
            Self::Given { count, indices } => Cow::Borrowed(&indices[window * count..][..*count]),
            Self::MostProbable(count) => {
                let mut order: Vec<u32> = (0..logits.len() as u32).collect();
                order.sort_by(|a, b| logits[*b as usize].total_cmp(&logits[*a as usize]).then(a.cmp(b)));
                order.truncate(*count);
                Cow::Owned(order)
            }
            Self::All(count) => Cow::Owned((0..*count as u32).collect()),
        }
    }

    /// Indices `[batch, k]` for `logits` `[batch, modes]`.
    pub(crate) fn indices(&self, logits: &Tensor) -> Result<Tensor> {
        let (batch, k) = (logits.dims()[0], self.count());
        let mut picked = Vec::with_capacity(batch * k);
        for (window, row) in logits.to_device(&Device::Cpu)?.to_vec2::<f32>()?.iter().enumerate() {
            picked.extend_from_slice(&self.of_window(window, row));
        }
        Tensor::from_vec(picked, (batch, k), logits.device())
    }
}

/// The rows `indices` `[batch, k]` of `x` `[batch, modes, width]`, `[batch, k, width]`.
pub(crate) fn rows(x: &Tensor, indices: &Tensor) -> Result<Tensor> {
    let (batch, modes, width) = x.dims3()?;
    let (_, k) = indices.dims2()?;
    // One selection over all windows: its gradient adds rows, where a gather would need an index
    // for each value.
    let first = Tensor::arange_step(0u32, (batch * modes) as u32, modes as u32, x.device())?;
    let flat = indices.broadcast_add(&first.unsqueeze(D::Minus1)?)?.flatten_all()?;
    x.reshape((batch * modes, width))?.index_select(&flat, 0)?.reshape((batch, k, width))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_probable_come_first() -> std::result::Result<(), Box<dyn std::error::Error>> {
        let logits = Tensor::new(&[[0.1f32, 3., -1., 3.], [5., 4., 6., 1.]], &Device::Cpu)?;
        let indices =
            |pick: Pick| -> std::result::Result<Tensor, GoalError> { Ok(pick.of_windows(2, 4)?.indices(&logits)?) };
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
