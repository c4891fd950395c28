//! Max-pooling whose gradient is right: from `index_select` and `maximum`.
//!
//! candle's own `max_pool2d` passes only a share of the gradient to a maximum, and fails for strides
//! unlike the kernel. Tensors are channels-last here: `[batch, rows, columns, channels]`.

use candle_core::{Result, Tensor};

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
}
