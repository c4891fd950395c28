//! The fusion of all targets around an ego: down, up, and each target read from its own cell.

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

use crate::conv::{Conv, ConvTranspose};
use crate::grid::{PLACE_COLUMNS, PLACE_ROWS};
use crate::norm::BatchNorm;
use crate::pooling::{Window, max_pool};

/// Slope of a rectifier below 0.
const RELU: f32 = 0.;

/// Two convolutions down, two transposed ones up, with one shortcut.
#[derive(Clone, Debug)]
pub(crate) struct Fusion {
    down: [(Conv, BatchNorm); 2],
    up: [(ConvTranspose, BatchNorm); 2],
}

impl Fusion {
    /// For codes of `width` values.
    pub(crate) fn new(width: usize, vb: &VarBuilder) -> Result<Self> {
        let down = |from: usize, to: usize, name: &str| -> Result<_> {
            let conv = Conv::new(from, to, [3, 3], [1, 1], &vb.pp(name))?;
            Ok((conv, BatchNorm::new(to, &vb.pp(format!("{name}_norm")))?))
        };
        let up = |from: usize, to: usize, name: &str| -> Result<_> {
            let conv = ConvTranspose::new(from, to, &vb.pp(name))?;
            Ok((conv, BatchNorm::new(to, &vb.pp(format!("{name}_norm")))?))
        };
        Ok(Self {
            down: [down(width, 2 * width, "down_1")?, down(2 * width, 4 * width, "down_2")?],
            up: [up(4 * width, 2 * width, "up_1")?, up(2 * width, width, "up_2")?],
        })
    }

    /// Fused codes `[read, width]` of the cells `read` of `scenes` grids, in which `codes`
    /// `[targets, width]` stand at `cells`.
    pub(crate) fn forward(
        &self,
        codes: &Tensor,
        cells: &[u32],
        read: &[u32],
        scenes: usize,
        training: bool,
    ) -> Result<Tensor> {
        let half = Window { ceil: true, ..Window::of(2) };
        let [(first, first_norm), (second, second_norm)] = &self.down;
        let x = first.forward_sparse(codes, cells, scenes, [PLACE_ROWS, PLACE_COLUMNS], RELU)?;
        let halved = max_pool(&first_norm.forward(&x, training)?, half, half)?;
        let x = second_norm.forward(&second.forward(&halved, RELU)?, training)?;
        let quartered = max_pool(&x, half, half)?;
        let [(first, first_norm), (second, second_norm)] = &self.up;
        let x = first_norm.forward(&(first.forward(&quartered, RELU)? + &halved)?, training)?;
        let x = second_norm.forward(&second.forward(&x, RELU)?, training)?;
        x.flatten(0, 2)?.index_select(&Tensor::new(read, codes.device())?, 0)
    }
}
