//! Which recordings are read, and how that is said.

use std::path::{Path, PathBuf};

use gnp_data::{Dataset, Source, discover};

use crate::config::RunConfig;
use crate::error::{Result, bail};
use crate::run::folder::DataState;

/// Recordings that were found.
#[derive(Debug)]
pub(crate) struct Found {
    /// Where they are and what they are called in headings.
    pub(crate) data: DataState,
    /// The files, sorted by name.
    pub(crate) sources: Vec<Source>,
}

/// Finds the recordings of a run: those of `data_dir`, or those that come with the project.
///
/// # Errors
/// When there are none, or they are not what they seem.
pub(crate) fn find(config: &RunConfig, data_dir: Option<&Path>) -> Result<Found> {
    let embedded = data_dir.is_none();
    let dir = match data_dir {
        Some(dir) => dir.to_owned(),
        None => embedded_folder(config.dataset)?,
    };
    let mut sources = discover(&dir, config.dataset)?;
    if config.data.max_recordings > 0 {
        sources.truncate(config.data.max_recordings);
    }
    let simulated = sources.iter().any(|source| source.simulated);
    let description = description(config.dataset, embedded, simulated, &dir);
    Ok(Found { data: DataState { dir, embedded, simulated, description }, sources })
}

/// The folder of the recordings that come with the project's sources.
///
/// # Errors
/// [`Error::Recordings`](crate::Error::Recordings) where this crate was built outside of the project.
pub fn embedded_folder(dataset: Dataset) -> Result<PathBuf> {
    let fixtures = Path::new("fixtures").join(dataset_name(dataset));
    // Cargo says where the program that it runs comes from; compiled files outlive the checkout they were made in.
    let started = std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from);
    let places = started.into_iter().chain([PathBuf::from(env!("CARGO_MANIFEST_DIR"))]);
    let found = places.flat_map(|place| place.ancestors().map(|above| above.join(&fixtures)).collect::<Vec<_>>());
    match found.into_iter().find(|folder| folder.is_dir()) {
        Some(folder) => Ok(folder),
        None => bail!(
            Recordings,
            "no recordings of {} come with this program; give a folder of them",
            dataset_name(dataset)
        ),
    }
}

/// A kind of data as in file names and on the command line.
#[must_use]
pub fn dataset_name(dataset: Dataset) -> &'static str {
    match dataset {
        Dataset::Ngsim => "ngsim",
        Dataset::HighD => "highd",
    }
}

fn description(dataset: Dataset, embedded: bool, simulated: bool, dir: &Path) -> String {
    match (dataset, embedded, simulated) {
        (Dataset::Ngsim, true, false) => "real NGSIM scenes of US-101 and I-80 that come with the project".to_owned(),
        (Dataset::HighD, true, true) => {
            "*simulated* recordings in highD's file layout that come with the project; nothing measured on them is a \
             result about highD"
                .to_owned()
        }
        (_, _, true) => format!("*simulated* recordings in {}", dir.display()),
        (Dataset::Ngsim, _, false) => format!("NGSIM recordings in {}", dir.display()),
        (Dataset::HighD, _, false) => format!("highD recordings in {}", dir.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_is_always_said() {
        for dataset in [Dataset::Ngsim, Dataset::HighD] {
            for embedded in [true, false] {
                assert!(description(dataset, embedded, true, Path::new("d")).contains("*simulated*"));
                assert!(!description(dataset, embedded, false, Path::new("d")).contains("simulated"));
            }
        }
    }
}
