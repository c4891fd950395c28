//! Tokens of all windows: each mode's vector plus each window's.

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor};

use pulp::Arch;

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
        let (arch, mut out) = (Arch::new(), Vec::with_capacity(batch * modes.len()));
        for window in windows.chunks_exact(width) {
            let from = out.len();
            out.extend_from_slice(modes);
            rows::add_to_rows(arch, &mut out[from..], window);
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
        let arch = Arch::new();
        for (window, d_window) in d_out.chunks_exact(count * width).zip(d_windows.chunks_exact_mut(width)) {
            rows::add_rows(arch, &mut d_modes, window);
            rows::add_rows(arch, d_window, window);
        }
        let tensor = |d, like: &Tensor| Tensor::from_vec(d, like.shape(), like.device()).map(Some);
        Ok((tensor(d_modes, modes)?, tensor(d_windows, windows)?))
    }
}
