//! `replay`: the clip of the scene player, for the Rerun viewer.

use std::io::Write as _;
use std::path::Path;

use crate::error::{Context as _, Result, bail};

use crate::report::clip::clip;
use crate::run::Run;

/// What was written for the viewer.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Replayed {
    /// Recording, site and driving direction.
    pub heading: String,
    /// Vehicles in it.
    pub vehicles: usize,
    /// Forecasts in it.
    pub forecasts: usize,
    /// Version of the viewer that opens it.
    pub viewer: &'static str,
}

/// Whether this build can write files for the Rerun viewer.
///
/// # Errors
/// [`Error::Unavailable`](crate::Error::Unavailable) in a build without the feature `rerun`.
pub fn can_replay() -> Result<()> {
    if !gnp_replay::CAN_ENCODE {
        bail!(Unavailable, "this build cannot write Rerun files, which needs the feature `rerun`");
    }
    Ok(())
}

/// Writes the clip of the scene player of a finished run for the Rerun viewer. `vehicle` is shown first; without one,
/// of the evaluated ones the one that moves sideways most.
///
/// # Errors
/// As [`can_replay`]; when a file of the run cannot be used; when it has nothing to show, or not the vehicle asked
/// for; when the file cannot be written.
pub fn write_replay(run: &Run, path: &Path, vehicle: Option<u32>) -> Result<Replayed> {
    can_replay()?;
    // Before minutes of work are done for it.
    let mut file = place(path)?;
    let set = run.windows()?;
    let split = run.split(&set)?;
    let Some(clip) = clip(run, &set, &split)? else {
        bail!(
            Folder,
            "{} has no {} windows, so that there is nothing to replay; split it in another way",
            run.path().display(),
            run.config.evaluate.subset.name()
        );
    };
    let picked = match vehicle {
        Some(id) if clip.vehicles.iter().all(|vehicle| vehicle.id != id) => {
            let ids: Vec<String> = clip.forecast_ids().iter().map(u32::to_string).collect();
            bail!(
                Recordings,
                "vehicle {id} is not in the minute that is replayed; leave --vehicle out, or take one of {}",
                ids.join(", ")
            )
        }
        Some(id) => Some(id),
        None => clip.liveliest(),
    };
    let cannot = || format!("cannot write {}", path.display());
    file.write_all(&gnp_replay::encode(&clip, picked)?).with_context(cannot)?;
    file.persist(path).with_context(cannot)?;
    Ok(Replayed {
        heading: clip.heading(),
        vehicles: clip.vehicles.len(),
        forecasts: clip.vehicles.iter().map(|vehicle| vehicle.forecasts.len()).sum(),
        viewer: gnp_replay::VIEWER,
    })
}

/// A temporary file beside the one to be written.
fn place(path: &Path) -> Result<gnp_file::Temporary> {
    if path.is_dir() {
        bail!(Folder, "--rrd {} is a folder; give the name of a file", path.display());
    }
    gnp_file::beside(path).with_context(|| {
        format!("cannot write {}; give --rrd a file in a folder that can be written to", path.display())
    })
}
