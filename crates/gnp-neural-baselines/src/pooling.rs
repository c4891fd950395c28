//! Max-pooling whose gradient is right: from `index_select` and `maximum`.
//!
//! candle's own `max_pool2d` passes only a share of the gradient to a maximum, and fails for strides
//! unlike the kernel. Tensors are channels-last here: `[batch, rows, columns, channels]`.

use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};
use gnp_nn::kernels::{read, values};

/// How a pool moves along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) kernel: usize,
    pub(crate) stride: usize,
    /// Cells before the first one that count as minus infinity.
    pub(crate) padding: usize,
    /// Whether a last window that is not full counts.
    pub(crate) ceil: bool,
}

impl Window {
    /// A kernel that steps by itself, without padding.
    pub(crate) fn of(kernel: usize) -> Self {
        Self { kernel, stride: kernel, padding: 0, ceil: false }
    }

    /// Cells of the result over `length` cells.
    pub(crate) fn outputs(self, length: usize) -> usize {
        let room = (length + 2 * self.padding).saturating_sub(self.kernel);
        // A window must begin on a cell or in the padding before the first one (PyTorch).
        let ceiled = room.div_ceil(self.stride) + 1;
        match self.ceil {
            true if (ceiled - 1) * self.stride >= length + self.padding => ceiled - 1,
            true => ceiled,
            false => room / self.stride + 1,
        }
    }

    /// For offset `k` of the kernel, the cell that each output looks at. A cell outside is replaced by
    /// the nearest one inside, which the window has anyway.
    fn cells(self, length: usize, k: usize) -> Vec<u32> {
        let last = length.saturating_sub(1);
        (0..self.outputs(length)).map(|i| (i * self.stride + k).saturating_sub(self.padding).min(last) as u32).collect()
    }
}

/// The largest value of each window, by channel.
pub(crate) fn max_pool(x: &Tensor, along: Window, across: Window) -> Result<Tensor> {
    if x.device().is_cpu() {
        return x.contiguous()?.apply_op1(Largest { along, across });
    }
    in_graph(x, along, across)
}

/// The same from candle's operations: for other devices, and to test against.
fn in_graph(x: &Tensor, along: Window, across: Window) -> Result<Tensor> {
    let rows = max_along(x, 1, along)?;
    max_along(&rows, 2, across)
}

fn max_along(x: &Tensor, axis: usize, window: Window) -> Result<Tensor> {
    if window == Window::of(1) {
        return Ok(x.clone());
    }
    let length = x.dim(axis)?;
    let x = x.contiguous()?;
    let pick = |k: usize| {
        let cells = window.cells(length, k);
        x.index_select(&Tensor::new(cells, x.device())?, axis)
    };
    (1..window.kernel).try_fold(pick(0)?, |largest, k| largest.maximum(&pick(k)?))
}

/// [`max_pool`] as one operation. Of equal values the first in the window takes the gradient.
#[derive(Clone, Copy, Debug)]
struct Largest {
    along: Window,
    across: Window,
}

impl Largest {
    /// Cells of the result for `[batch, rows, columns, channels]`.
    fn outputs(self, shape: &Shape) -> Result<Shape> {
        let (batch, rows, columns, channels) = shape.dims4()?;
        Ok((batch, self.along.outputs(rows), self.across.outputs(columns), channels).into())
    }

    /// For every cell of the result, where the channels of the cells in its window begin.
    fn windows(self, shape: &Shape) -> Result<Vec<Vec<usize>>> {
        let (batch, rows, columns, channels) = shape.dims4()?;
        let cells = |window: Window, length| (0..window.kernel).map(move |k| window.cells(length, k));
        let along: Vec<Vec<u32>> = cells(self.along, rows).collect();
        let across: Vec<Vec<u32>> = cells(self.across, columns).collect();
        let mut windows = Vec::new();
        for grid in 0..batch {
            for r in 0..self.along.outputs(rows) {
                for c in 0..self.across.outputs(columns) {
                    let cell = |i: &Vec<u32>, j: &Vec<u32>| (grid * rows + i[r] as usize) * columns + j[c] as usize;
                    windows.push(along.iter().flat_map(|i| across.iter().map(|j| cell(i, j) * channels)).collect());
                }
            }
        }
        Ok(windows)
    }
}

impl CustomOp1 for Largest {
    fn name(&self) -> &'static str {
        "max-pool"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (x, shape) = (values(storage, layout)?, self.outputs(layout.shape())?);
        let channels = shape.dims4()?.3;
        let mut y = vec![f32::NEG_INFINITY; shape.elem_count()];
        for (y, window) in y.chunks_exact_mut(channels.max(1)).zip(self.windows(layout.shape())?) {
            for at in window {
                y.iter_mut().zip(&x[at..at + channels]).for_each(|(y, x)| *y = y.max(*x));
            }
        }
        Ok((CpuStorage::F32(y), shape))
    }

    fn bwd(&self, input: &Tensor, res: &Tensor, grad: &Tensor) -> Result<Option<Tensor>> {
        let (shape, grad) = (input.shape(), grad.contiguous()?);
        let (x, y, grad) = (read(input)?, read(res)?, read(&grad)?);
        let channels = shape.dims4()?.3;
        let mut dx = vec![0f32; x.len()];
        let mut left = vec![0f32; channels];
        let rows = y.chunks_exact(channels.max(1)).zip(grad.chunks_exact(channels.max(1)));
        for ((y, grad), window) in rows.zip(self.windows(shape)?) {
            left.copy_from_slice(grad);
            for at in window {
                let (x, dx) = (&x[at..at + channels], &mut dx[at..at + channels]);
                for c in 0..channels {
                    // The first that is largest takes what is left, which is then nothing.
                    let taken = if x[c] == y[c] { left[c] } else { 0. };
                    dx[c] += taken;
                    left[c] -= taken;
                }
            }
        }
        Tensor::from_vec(dx, shape, input.device()).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    fn column(values: &[f32]) -> Var {
        Var::from_tensor(&Tensor::from_slice(values, (1, values.len(), 1, 1), &Device::Cpu).unwrap()).unwrap()
    }

    #[test]
    fn nine_cells_with_padding_become_five() {
        // All below 0: padding with zeros would show.
        let x = column(&[-5., -1., -2., -4., -3., -9., -8., -6., -7.]);
        let window = Window { padding: 1, ..Window::of(2) };
        let y = max_pool(x.as_tensor(), window, Window::of(1)).unwrap();
        assert_eq!(y.flatten_all().unwrap().to_vec1::<f32>().unwrap(), [-5., -1., -3., -8., -6.]);
        let grads = y.sum_all().unwrap().backward().unwrap();
        let grad = grads.get(&x).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(grad, [1., 1., 0., 0., 1., 0., 1., 1., 0.], "all of it to each maximum");
    }

    #[test]
    fn overlapping_windows_and_unfull_last_ones() {
        let x = column(&[1., 7., 2., 3., 6., 5.]);
        let overlapping = Window { kernel: 3, stride: 2, padding: 0, ceil: false };
        let y = max_pool(x.as_tensor(), overlapping, Window::of(1)).unwrap();
        assert_eq!(y.flatten_all().unwrap().to_vec1::<f32>().unwrap(), [7., 6.]);
        let grads = y.sum_all().unwrap().backward().unwrap();
        assert_eq!(grads.get(&x).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap(), [0., 1., 0., 0., 1., 0.]);
        let ceil = Window { ceil: true, ..Window::of(2) };
        let y = max_pool(column(&[1., 2., 4., 3., -6.]).as_tensor(), ceil, Window::of(1)).unwrap();
        assert_eq!(y.flatten_all().unwrap().to_vec1::<f32>().unwrap(), [2., 4., -6.]);
        assert_eq!([25, 13, 5, 3].map(|n| ceil.outputs(n)), [13, 7, 3, 2]);
    }

    #[test]
    fn both_axes() {
        let x = Tensor::arange(0f32, 24., &Device::Cpu).unwrap().reshape((1, 3, 4, 2)).unwrap();
        let overlapping = Window { kernel: 3, stride: 2, padding: 0, ceil: false };
        let y = max_pool(&x, overlapping, Window::of(2)).unwrap();
        assert_eq!(y.dims(), [1, 1, 2, 2]);
        assert_eq!(y.flatten_all().unwrap().to_vec1::<f32>().unwrap(), [18., 19., 22., 23.]);
    }

    #[test]
    fn one_operation_gives_the_values_and_gradients_of_the_graph() {
        let numbers = |shape: &[usize], from: f32| {
            let count = shape.iter().product::<usize>();
            let values: Vec<f32> = (0..count).map(|i| (from + 1.7 * i as f32).sin()).collect();
            Var::from_tensor(&Tensor::from_vec(values, shape, &Device::Cpu).unwrap()).unwrap()
        };
        let x = numbers(&[2, 7, 5, 3], 0.4);
        let overlapping = Window { kernel: 3, stride: 2, padding: 0, ceil: false };
        let padded = Window { padding: 1, ..Window::of(2) };
        let half = Window { ceil: true, ..Window::of(2) };
        for (along, across) in [(overlapping, overlapping), (padded, half), (half, Window::of(1))] {
            let of = |y: Tensor| {
                let upstream = numbers(y.dims(), 2.1);
                let grads = (&y * upstream.as_tensor()).unwrap().sum_all().unwrap().backward().unwrap();
                [y, grads.get(&x).unwrap().clone()].map(|t| t.flatten_all().unwrap().to_vec1::<f32>().unwrap())
            };
            let (ours, theirs) = (of(max_pool(&x, along, across).unwrap()), of(in_graph(&x, along, across).unwrap()));
            assert_eq!(ours[0], theirs[0]);
            assert!(ours[1].iter().zip(&theirs[1]).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }
}
