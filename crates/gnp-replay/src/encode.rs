//! From a scene to the bytes of a file, where Rerun was built in.

use crate::error::ReplayError;
use crate::scene::Scene;

/// Version of the viewer that files open in.
pub const VIEWER: &str = "0.36.3";

/// Whether [`encode`] can: the feature `rerun`.
pub const CAN_ENCODE: bool = cfg!(feature = "rerun");

/// An `.rrd` file: the records of the scene, and how the viewer lays them out. The same scene gives the same bytes.
///
/// # Errors
/// Without the feature `rerun`, and when Rerun refuses a record.
pub fn encode(scene: &Scene) -> Result<Vec<u8>, ReplayError> {
    #[cfg(feature = "rerun")]
    return crate::rrd::encode(scene);
    #[cfg(not(feature = "rerun"))]
    {
        let _ = scene;
        Err(ReplayError::WithoutRerun)
    }
}
