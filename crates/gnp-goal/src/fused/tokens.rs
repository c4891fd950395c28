//! Tokens of all windows: each mode's vector plus each window's.

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor};
use gnp_nn::kernels::{add_rows, add_to_rows, read, values};

use super::gradient;

/// `modes` `[modes, width]` plus `windows` `[batch, width]`, every one with every other,
/// `[batch, modes, width]`, on the CPU.
///
/// candle's broadcast addition computes an index for each value, and its gradient sums twice over.
pub(crate) fn outer_sum(modes: &Tensor, windows: &Tensor) -> Result<Tensor> {
    modes.contiguous()?.apply_op2(&windows.contiguous()?, OuterSum)
}

struct OuterSum;

impl CustomOp2 for OuterSum {
    fn name(&self) -> &'static str {
        "outer sum"
    }

    fn cpu_fwd(
        &self,
        modes: &CpuStorage,
        lm: &Layout,
        windows: &CpuStorage,
        lw: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let ((count, width), (batch, same)) = (lm.shape().dims2()?, lw.shape().dims2()?);
        if width != same {
            candle_core::bail!("outer sum: widths {width} and {same}");
        }
        let (modes, windows) = (values(modes, lm)?, values(windows, lw)?);
        let mut out = Vec::with_capacity(batch * modes.len());
        for window in windows.chunks_exact(width) {
            let from = out.len();
            out.extend_from_slice(modes);
            add_to_rows(&mut out[from..], window);
        }
        Ok((CpuStorage::F32(out), Shape::from((batch, count, width))))
    }

    fn bwd(
        &self,
        modes: &Tensor,
        windows: &Tensor,
        _: &Tensor,
        d_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (count, width) = modes.dims2()?;
        let d_out = d_out.contiguous()?;
        let d_out = read(&d_out)?;
        let (mut d_modes, mut d_windows) = (vec![0f32; modes.elem_count()], vec![0f32; windows.elem_count()]);
        for (window, d_window) in d_out.chunks_exact(count * width).zip(d_windows.chunks_exact_mut(width)) {
            add_rows(&mut d_modes, window);
            add_rows(d_window, window);
        }
        Ok((gradient(d_modes, modes)?, gradient(d_windows, windows)?))
    }
}
