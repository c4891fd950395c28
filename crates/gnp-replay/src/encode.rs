//! From a clip to the bytes of a file, where Rerun was built in.

use gnp_plot::Clip;

use crate::error::ReplayError;

/// Version of the viewer that files open in.
pub const VIEWER: &str = "0.36.3";

/// Whether [`encode`] can: the feature `rerun`.
pub const CAN_ENCODE: bool = cfg!(feature = "rerun");

/// An `.rrd` file: the records of the clip, and how the viewer lays them out around the vehicle `picked`. The same
/// clip gives the same bytes.
///
/// # Errors
/// Without the feature `rerun`, and when Rerun refuses a record.
pub fn encode(clip: &Clip, picked: Option<u32>) -> Result<Vec<u8>, ReplayError> {
    #[cfg(feature = "rerun")]
    return crate::rrd::encode(clip, picked);
    #[cfg(not(feature = "rerun"))]
    {
        let _ = (clip, picked);
        Err(ReplayError::WithoutRerun)
    }
}
