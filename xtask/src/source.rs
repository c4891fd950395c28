//! Which recordings are read, and how that is said.

use std::path::{Path, PathBuf};

use anyhow::Result;
use gnp_data::{Dataset, Source, discover};

use crate::cli::DatasetName;
use crate::config::RunConfig;
use crate::project;
use crate::run_folder::DataState;

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
    let dir = data_dir.map_or_else(|| fixtures(config.dataset), Path::to_path_buf);
    let mut sources = discover(&dir, config.dataset)?;
    if config.data.max_recordings > 0 {
        sources.truncate(config.data.max_recordings);
    }
    let simulated = sources.iter().any(|source| source.simulated);
    let words = words(config.dataset, embedded, simulated, &dir);
    Ok(Found { data: DataState { dir, embedded, simulated, words }, sources })
}

fn fixtures(dataset: Dataset) -> PathBuf {
    project::root().join("fixtures").join(DatasetName::from(dataset).as_str())
}

fn words(dataset: Dataset, embedded: bool, simulated: bool, dir: &Path) -> String {
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
                assert!(words(dataset, embedded, true, Path::new("d")).contains("*simulated*"));
                assert!(!words(dataset, embedded, false, Path::new("d")).contains("simulated"));
            }
        }
    }
}
