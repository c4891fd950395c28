//! Convolutions over grids as matrix products between rows: of a whole grid, of a grid in which few
//! cells are occupied, and transposed.
//!
//! candle's convolution has no fast gradient on the CPU. Tensors are channels-last here:
//! `[batch, rows, columns, channels]`; weights keep PyTorch's layout.

use candle_core::{DType, Result, Tensor};
use candle_nn::{Init, VarBuilder};

use crate::rows::rectified;

/// Rows and columns.
pub(crate) type Size = [usize; 2];

/// A convolution of stride 1, weight `[out, in, rows, columns]`.
#[derive(Clone, Debug)]
pub(crate) struct Conv {
    weight: Tensor,
    bias: Tensor,
    padding: Size,
}

fn weights(shape: [usize; 4], fan_in: usize, output: usize, vb: &VarBuilder) -> Result<(Tensor, Tensor)> {
    let bound = 1. / (fan_in.max(1) as f64).sqrt();
    let init = Init::Uniform { lo: -bound, up: bound };
    Ok((vb.get_with_hints(&shape, "weight", init)?, vb.get_with_hints(output, "bias", init)?))
}

impl Conv {
    /// A convolution of `kernel` cells with zeros around the grid.
    pub(crate) fn new(input: usize, output: usize, kernel: Size, padding: Size, vb: &VarBuilder) -> Result<Self> {
        let [rows, columns] = kernel;
        let (weight, bias) = weights([output, input, rows, columns], input * rows * columns, output, vb)?;
        Ok(Self { weight, bias, padding })
    }

    fn kernel(&self) -> Result<Size> {
        let (_, _, rows, columns) = self.weight.dims4()?;
        Ok([rows, columns])
    }

    /// Size of the result over a grid of `size`.
    pub(crate) fn size(&self, size: Size) -> Result<Size> {
        let kernel = self.kernel()?;
        Ok([0, 1].map(|axis| (size[axis] + 2 * self.padding[axis] + 1).saturating_sub(kernel[axis])))
    }

    /// Over a whole grid `[batch, rows, columns, in]`; what is below 0 times `slope`.
    pub(crate) fn forward(&self, x: &Tensor, slope: f32) -> Result<Tensor> {
        let (batch, rows, columns, input) = x.dims4()?;
        let (kernel, [out_rows, out_columns]) = (self.kernel()?, self.size([rows, columns])?);
        let outside = (batch * rows * columns) as u32;
        let mut cells = Vec::with_capacity(batch * out_rows * out_columns * kernel[0] * kernel[1]);
        for b in 0..batch {
            for r in 0..out_rows {
                for c in 0..out_columns {
                    for i in 0..kernel[0] {
                        for j in 0..kernel[1] {
                            let row = (r + i).checked_sub(self.padding[0]).filter(|row| *row < rows);
                            let column = (c + j).checked_sub(self.padding[1]).filter(|column| *column < columns);
                            let cell = row.zip(column).map(|(row, column)| (b * rows + row) * columns + column);
                            cells.push(cell.map_or(outside, |cell| cell as u32));
                        }
                    }
                }
            }
        }
        let mut flat = x.contiguous()?.reshape((batch * rows * columns, input))?;
        if self.padding != [0, 0] {
            flat = Tensor::cat(&[&flat, &Tensor::zeros((1, input), DType::F32, x.device())?], 0)?;
        }
        let seen = flat.index_select(&Tensor::new(cells, x.device())?, 0)?;
        let seen = seen.reshape((batch * out_rows * out_columns, kernel[0] * kernel[1] * input))?;
        let output = self.bias.dim(0)?;
        // [out, in, i, j] to [(i, j, in), out], the order in which cells were laid side by side.
        let weight = self.weight.permute((2, 3, 1, 0))?.contiguous()?.reshape(((), output))?;
        rectified(&seen.matmul(&weight)?, &self.bias, slope)?.reshape((batch, out_rows, out_columns, output))
    }

    /// Over `batch` grids of `size` that are zero but for `codes` `[occupied, in]` at `cells`, each
    /// `(grid * rows + row) * columns + column`: the same result from the occupied cells alone.
    pub(crate) fn forward_sparse(
        &self,
        codes: &Tensor,
        cells: &[u32],
        batch: usize,
        size: Size,
        slope: f32,
    ) -> Result<Tensor> {
        let (kernel, [out_rows, out_columns]) = (self.kernel()?, self.size(size)?);
        let output = self.bias.dim(0)?;
        let weight = self.weight.permute((1, 2, 3, 0))?.contiguous()?.reshape((codes.dim(1)?, ()))?;
        let mut places = Vec::with_capacity(cells.len() * kernel[0] * kernel[1]);
        let place = |at: usize, k: usize, axis: usize, outputs: usize| {
            (at + self.padding[axis]).checked_sub(k).filter(|place| *place < outputs)
        };
        for cell in cells {
            let cell = *cell as usize;
            let (grid, row, column) = (cell / (size[0] * size[1]), cell / size[1] % size[0], cell % size[1]);
            for i in 0..kernel[0] {
                for j in 0..kernel[1] {
                    let to = place(row, i, 0, out_rows).zip(place(column, j, 1, out_columns));
                    places.push(to.map(|(r, c)| (grid * out_rows + r) * out_columns + c));
                }
            }
        }
        let sums = gather(codes, &weight, places, batch * out_rows * out_columns, output)?;
        rectified(&sums, &self.bias, slope)?.reshape((batch, out_rows, out_columns, output))
    }
}

/// Sums `[cells, out]` of the parts that each row of `codes` sends, by `weight` `[in, parts * out]`, to
/// the cells `places` (`None`: beyond the edge).
fn gather(codes: &Tensor, weight: &Tensor, places: Vec<Option<usize>>, cells: usize, output: usize) -> Result<Tensor> {
    let zeros = Tensor::zeros((cells, output), DType::F32, codes.device())?;
    let (parts, to): (Vec<u32>, Vec<u32>) =
        places.into_iter().enumerate().filter_map(|(part, cell)| Some((part as u32, cell? as u32))).unzip();
    if parts.is_empty() {
        return Ok(zeros);
    }
    let sent = codes.matmul(weight)?.reshape(((), output))?;
    let sent = sent.index_select(&Tensor::new(parts, codes.device())?, 0)?;
    zeros.index_add(&Tensor::new(to, codes.device())?, &sent, 0)
}

/// A transposed convolution of kernel 3 x 3, stride 2 and padding 1, weight `[in, out, 3, 3]`.
#[derive(Clone, Debug)]
pub(crate) struct ConvTranspose {
    weight: Tensor,
    bias: Tensor,
}

impl ConvTranspose {
    const KERNEL: usize = 3;

    /// From `input` to `output` channels.
    pub(crate) fn new(input: usize, output: usize, vb: &VarBuilder) -> Result<Self> {
        let k = Self::KERNEL;
        let (weight, bias) = weights([input, output, k, k], output * k * k, output, vb)?;
        Ok(Self { weight, bias })
    }

    /// Twice the size less one along each axis: `[batch, 2 rows - 1, 2 columns - 1, out]`; what is below 0
    /// times `slope`.
    pub(crate) fn forward(&self, x: &Tensor, slope: f32) -> Result<Tensor> {
        let (batch, rows, columns, input) = x.dims4()?;
        let (k, output) = (Self::KERNEL, self.bias.dim(0)?);
        let (out_rows, out_columns) = (2 * rows - 1, 2 * columns - 1);
        let weight = self.weight.permute((0, 2, 3, 1))?.contiguous()?.reshape((input, k * k * output))?;
        let place = |at: usize, k: usize, outputs: usize| (2 * at + k).checked_sub(1).filter(|place| *place < outputs);
        let mut places = Vec::with_capacity(batch * rows * columns * k * k);
        for cell in 0..batch * rows * columns {
            let (b, row, column) = (cell / (rows * columns), cell / columns % rows, cell % columns);
            for i in 0..k {
                for j in 0..k {
                    let to = place(row, i, out_rows).zip(place(column, j, out_columns));
                    places.push(to.map(|(r, c)| (b * out_rows + r) * out_columns + c));
                }
            }
        }
        let flat = x.contiguous()?.reshape((batch * rows * columns, input))?;
        let sums = gather(&flat, &weight, places, batch * out_rows * out_columns, output)?;
        rectified(&sums, &self.bias, slope)?.reshape((batch, out_rows, out_columns, output))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;
    use gnp_nn::Weights;

    fn numbers(dims: &[usize]) -> Tensor {
        let n = dims.iter().product::<usize>();
        let values: Vec<f32> = (0..n).map(|i| (1.3 * i as f32).sin()).collect();
        Tensor::from_vec(values, dims, &Device::Cpu).unwrap()
    }

    fn assert_close(a: &Tensor, b: &Tensor) {
        assert_eq!(a.dims(), b.dims());
        let off = (a - b).unwrap().abs().unwrap().flatten_all().unwrap().max(0).unwrap().to_scalar::<f32>().unwrap();
        assert!(off < 1e-5, "{off}");
    }

    /// candle's channels-first form to ours.
    fn last(x: &Tensor) -> Tensor {
        x.permute((0, 2, 3, 1)).unwrap().contiguous().unwrap()
    }

    fn first(x: &Tensor) -> Tensor {
        x.permute((0, 3, 1, 2)).unwrap().contiguous().unwrap()
    }

    #[test]
    fn whole_grids_are_convolved_as_candle_does() {
        for (kernel, padding) in [([3, 3], [0, 0]), ([3, 3], [1, 1]), ([3, 1], [0, 0])] {
            let weights = Weights::seeded(1, &Device::Cpu);
            let conv = Conv::new(2, 4, kernel, padding, &weights.builder()).unwrap();
            let x = numbers(&[2, 7, 5, 2]);
            let named = weights.named();
            let weight = named["weight"].as_tensor();
            // candle has one padding for both axes, as have these.
            let y = first(&x).conv2d(weight, padding[0], 1, 1, 1).unwrap();
            let y = y.broadcast_add(&named["bias"].reshape((1, 4, 1, 1)).unwrap()).unwrap();
            assert_close(&conv.forward(&x, 1.).unwrap(), &last(&y));
        }
    }

    #[test]
    fn occupied_cells_alone_give_the_whole_result() {
        for padding in [[0, 0], [1, 1]] {
            let weights = Weights::seeded(2, &Device::Cpu);
            let conv = Conv::new(2, 4, [3, 3], padding, &weights.builder()).unwrap();
            let cells = [0u32, 11, 34, 35, 50, 69];
            let codes = numbers(&[6, 2]);
            let grid = Tensor::zeros((2 * 35, 2), DType::F32, &Device::Cpu).unwrap();
            let grid = grid.index_add(&Tensor::new(&cells, &Device::Cpu).unwrap(), &codes, 0).unwrap();
            let whole = conv.forward(&grid.reshape((2, 7, 5, 2)).unwrap(), 1.).unwrap();
            assert_close(&conv.forward_sparse(&codes, &cells, 2, [7, 5], 1.).unwrap(), &whole);
        }
        let weights = Weights::seeded(2, &Device::Cpu);
        let conv = Conv::new(2, 4, [3, 3], [0, 0], &weights.builder()).unwrap();
        let nobody = Tensor::zeros((0, 2), DType::F32, &Device::Cpu).unwrap();
        let empty = Tensor::zeros((1, 7, 5, 2), DType::F32, &Device::Cpu).unwrap();
        assert_close(&conv.forward_sparse(&nobody, &[], 1, [7, 5], 1.).unwrap(), &conv.forward(&empty, 1.).unwrap());
    }

    #[test]
    fn transposed_ones_are_candles() {
        let weights = Weights::seeded(3, &Device::Cpu);
        let conv = ConvTranspose::new(3, 2, &weights.builder()).unwrap();
        let x = numbers(&[2, 7, 2, 3]);
        let named = weights.named();
        let y = first(&x).conv_transpose2d(named["weight"].as_tensor(), 1, 0, 2, 1).unwrap();
        let y = y.broadcast_add(&named["bias"].reshape((1, 2, 1, 1)).unwrap()).unwrap();
        let ours = conv.forward(&x, 1.).unwrap();
        assert_eq!(ours.dims(), [2, 13, 3, 2]);
        assert_close(&ours, &last(&y));
    }
}
