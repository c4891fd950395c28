//! Which modes are decoded.

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
    /// Indices `[batch, k]` for `logits` `[batch, modes]`.
    pub(crate) fn indices(&self, logits: &Tensor) -> std::result::Result<Tensor, GoalError> {
        let (batch, modes) = logits.dims2()?;
        match self {
            Self::Indices(indices) => {
                // Checked here, because one beyond the last mode is the next window's first.
                let picked = indices.flatten_all()?.to_vec1::<u32>()?;
                match picked.into_iter().find(|index| *index as usize >= modes) {
                    Some(index) => Err(GoalError::Mode { index, modes }),
                    None => Ok(indices.clone()),
                }
            }
            Self::All => {
                let all = Tensor::arange(0u32, modes as u32, logits.device())?;
                Ok(all.unsqueeze(0)?.broadcast_as((batch, modes))?.contiguous()?)
            }
            Self::MostProbable(k) => {
                let k = (*k).min(modes);
                let mut picked = Vec::with_capacity(batch * k);
                for row in logits.to_device(&Device::Cpu)?.to_vec2::<f32>()? {
                    let mut order: Vec<u32> = (0..modes as u32).collect();
                    order.sort_by(|a, b| row[*b as usize].total_cmp(&row[*a as usize]).then(a.cmp(b)));
                    picked.extend_from_slice(&order[..k]);
                }
                Ok(Tensor::from_vec(picked, (batch, k), logits.device())?)
            }
        }
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
        let picked = Pick::MostProbable(3).indices(&logits)?.to_vec2::<u32>()?;
        assert_eq!(picked, [[1, 3, 0], [2, 0, 1]]);
        assert_eq!(Pick::MostProbable(9).indices(&logits)?.dims(), [2, 4]);
        assert_eq!(Pick::All.indices(&logits)?.to_vec2::<u32>()?, [[0, 1, 2, 3], [0, 1, 2, 3]]);
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
