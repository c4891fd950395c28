//! The values of candle's tensors as slices, where kernels read them.

use std::ops::{Deref, Range};

use candle_core::{CpuStorage, Layout, Result, Storage, Tensor};

/// The values of a contiguous tensor, as an operation of one's own is handed them.
///
/// # Errors
/// When the tensor is not contiguous or does not hold `f32`.
pub fn values<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    Ok(&storage.as_slice::<f32>()?[range(layout)?])
}

fn range(layout: &Layout) -> Result<Range<usize>> {
    match layout.contiguous_offsets() {
        Some((from, to)) => Ok(from..to),
        None => candle_core::bail!("a kernel takes contiguous tensors"),
    }
}

/// The values of a contiguous tensor on the CPU in row-major order, without a copy. While they are held,
/// the tensor cannot be written to.
///
/// # Errors
/// When the tensor is not contiguous, not on the CPU or does not hold `f32`.
pub fn read(tensor: &Tensor) -> Result<impl Deref<Target = [f32]>> {
    let (storage, layout) = tensor.storage_and_layout();
    match &*storage {
        Storage::Cpu(CpuStorage::F32(_)) => Ok(Held { range: range(layout)?, storage }),
        _ => candle_core::bail!("a kernel takes f32 on the CPU, not {:?} on {:?}", tensor.dtype(), tensor.device()),
    }
}

struct Held<S> {
    storage: S,
    range: Range<usize>,
}

impl<S: Deref<Target = Storage>> Deref for Held<S> {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        match &*self.storage {
            Storage::Cpu(CpuStorage::F32(values)) => &values[self.range.clone()],
            _ => &[],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{DType, Device};

    #[test]
    fn a_part_of_a_tensor_is_read_in_place_and_what_cannot_be_is_refused() -> Result<()> {
        let x = Tensor::arange(0f32, 6., &Device::Cpu)?.reshape((3, 2))?;
        let part = x.narrow(0, 1, 2)?;
        assert_eq!(&*read(&part)?, [2., 3., 4., 5.]);
        assert!(read(&x.t()?).is_err());
        assert!(read(&x.to_dtype(DType::F64)?).is_err());
        Ok(())
    }
}
