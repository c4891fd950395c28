//! A computation on a GPU that is recorded once and then launched whole.

use std::fmt;
use std::sync::Arc;

use candle_core::cuda_backend::WrapErr;
use candle_core::cuda_backend::cudarc::driver::sys::{CUgraphInstantiate_flags, CUstreamCaptureMode};
use candle_core::cuda_backend::cudarc::driver::{CudaGraph, CudaStream};
use candle_core::{Device, Result, Tensor, Var};

use crate::launch::LaunchCache;

/// What a function of tensors does on a GPU, as a CUDA graph: thousands of small operations cost one launch.
///
/// It works on the weights where they are, so that it sees what an optimiser makes of them. One thread at a time may use
/// it, the one that recorded it.
pub struct Replay {
    graph: CudaGraph,
    inputs: Vec<Var>,
    outputs: Vec<Var>,
}

impl Replay {
    /// Records `f` on `inputs`, which must be of one CUDA device, as must what it makes. It is called twice: once to load
    /// what it needs, once to be recorded. It may not wait for the device, nor send data there but small constants.
    ///
    /// # Errors
    /// Those of `f`, and when it cannot be recorded.
    pub fn record(device: &Device, inputs: &[Tensor], f: impl Fn(&[Tensor]) -> Result<Vec<Tensor>>) -> Result<Self> {
        let stream = device.as_cuda_device()?.cuda_stream();
        let _sent = LaunchCache::on(device);
        let inputs = inputs.iter().map(Var::from_tensor).collect::<Result<Vec<_>>>()?;
        let given: Vec<Tensor> = inputs.iter().map(|input| input.as_tensor().detach()).collect();
        let outputs = f(&given)?.iter().map(Var::from_tensor).collect::<Result<Vec<_>>>()?;
        device.synchronize()?;
        let graph = capture(&stream, || {
            outputs.iter().zip(f(&given)?).try_for_each(|(output, made)| output.set(&made.detach()))
        })?;
        Ok(Self { graph, inputs, outputs })
    }

    /// What `f` makes of other inputs of the same shapes.
    ///
    /// # Errors
    /// When a shape is another, or the device fails.
    pub fn run(&self, inputs: &[Tensor]) -> Result<Vec<Tensor>> {
        if inputs.len() != self.inputs.len() {
            candle_core::bail!("{} inputs for a computation of {}", inputs.len(), self.inputs.len());
        }
        self.inputs.iter().zip(inputs).try_for_each(|(input, value)| input.set(value))?;
        self.graph.launch().w()?;
        self.outputs.iter().map(|output| output.as_tensor().copy()).collect()
    }
}

/// Records what `work` asks of `stream`.
fn capture(stream: &Arc<CudaStream>, work: impl FnOnce() -> Result<()>) -> Result<CudaGraph> {
    stream.begin_capture(CUstreamCaptureMode::CU_STREAM_CAPTURE_MODE_THREAD_LOCAL).w()?;
    let done = work();
    // Ended in any case, so that the stream can be used again.
    let graph = stream.end_capture(CUgraphInstantiate_flags(0));
    done?;
    match graph.w()? {
        Some(graph) => Ok(graph),
        None => candle_core::bail!("nothing was recorded"),
    }
}

impl fmt::Debug for Replay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Replay").field("inputs", &self.inputs).field("outputs", &self.outputs).finish_non_exhaustive()
    }
}
