//! What a GPU needs of the host: each operation's shapes, and that one thread at a time asks for work.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

use candle_core::{Device, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// While one is held, shapes, strides and constants that candle sends to a GPU with an operation are sent once and kept
/// there, for as long as the program runs. Nothing on other devices.
///
/// Data of up to [`LaunchCache::KEPT`] bytes that are sent meanwhile are kept, too: hold one while a network runs, not
/// while batches are put together.
#[must_use]
pub struct LaunchCache {
    /// candle's guard, whose type has no public name.
    _kept: Option<Box<dyn Any>>,
}

impl LaunchCache {
    /// What is longer, in bytes, is not kept.
    pub const KEPT: usize = 4096;

    /// Begins to keep what this thread sends to `device`.
    pub fn on(device: &Device) -> Self {
        #[cfg(feature = "cuda")]
        if let Ok(device) = device.as_cuda_device() {
            return Self { _kept: Some(Box::new(device.enable_cuda_graph_htod_cache())) };
        }
        let _ = device;
        Self { _kept: None }
    }
}

impl fmt::Debug for LaunchCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "LaunchCache({})", if self._kept.is_some() { "held" } else { "none" })
    }
}

/// Where work on a device is done: on a GPU by one thread alone, as each thread has a queue of its own there and nothing
/// orders those of two; on the CPU where it was asked for. Clones share the thread.
#[derive(Clone, Debug)]
pub struct DeviceThread(Option<Arc<ThreadPool>>);

impl DeviceThread {
    /// A thread for `device`, if it needs one. What this thread sent there before, such as weights, is there then.
    ///
    /// # Errors
    /// When the system refuses a thread, or the device reports what failed on it earlier.
    pub fn of(device: &Device) -> Result<Self> {
        if device.is_cpu() {
            return Ok(Self(None));
        }
        device.synchronize()?;
        let thread = ThreadPoolBuilder::new().num_threads(1).thread_name(|_| "gnp-device".to_owned()).build();
        Ok(Self(Some(Arc::new(thread.map_err(candle_core::Error::wrap)?))))
    }

    /// Does `work` there, and waits for it. What it returns should be on the host.
    pub fn run<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(thread) => thread.install(work),
            None => work(),
        }
    }
}
