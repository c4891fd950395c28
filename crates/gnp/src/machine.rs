//! What a run is worked on with.

use std::sync::Arc;

use candle_core::Device;

use crate::progress::{Progress, Silent, Stop, Work};

/// Device, progress and stop token. The number of threads is that of rayon's global pool.
///
/// A program of one's own is faster when it is started with `CANDLE_NUM_THREADS=1` and `RAYON_NUM_THREADS` set to the number
/// of threads: candle reads them from the environment, and its own threads wait actively beside rayon's. `gnp` sees to it
/// itself.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Machine {
    /// Where tensors live.
    pub device: Device,
    /// What the user sees.
    pub progress: Arc<dyn Progress>,
    /// How the user ends the work.
    pub stop: Stop,
}

impl Default for Machine {
    /// The processor, in silence, until the work is done.
    fn default() -> Self {
        Self::new(Device::Cpu, Arc::new(Silent), Stop::new())
    }
}

impl Machine {
    /// A machine.
    #[must_use]
    pub fn new(device: Device, progress: Arc<dyn Progress>, stop: Stop) -> Self {
        Self { device, progress, stop }
    }

    /// Starts to show a piece of work of `total` units.
    pub(crate) fn work(&self, what: &str, total: usize, unit: &'static str) -> Box<dyn Work> {
        self.progress.start(what, 0, total as u64, unit)
    }
}
