//! Tokens of all windows: each mode's vector plus each window's.

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor};

use super::{cpu, rows, values};

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
            for mode in modes.chunks_exact(width) {
                out.extend(mode.iter().zip(window).map(|(m, w)| m + w));
            }
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
        let (storage, layout) = d_out.storage_and_layout();
        let d_out = values(cpu(&storage)?, layout)?;
        let (mut d_modes, mut d_windows) = (vec![0f32; modes.elem_count()], vec![0f32; windows.elem_count()]);
        for (window, d_window) in d_out.chunks_exact(count * width).zip(d_windows.chunks_exact_mut(width)) {
            rows::add(&mut d_modes, window);
            window.chunks_exact(width).for_each(|token| rows::add(d_window, token));
        }
        let tensor = |d, like: &Tensor| Tensor::from_vec(d, like.shape(), like.device()).map(Some);
        Ok((tensor(d_modes, modes)?, tensor(d_windows, windows)?))
    }
}
