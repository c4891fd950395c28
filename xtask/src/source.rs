//! Which recordings are read, and how that is said.

use std::path::{Path, PathBuf};

use anyhow::Result;
use gnp_data::{Dataset, Format, Source, discover, format_of};

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
    let words = words(format_of(config.dataset)?, embedded, simulated, &dir);
    Ok(Found { data: DataState { dir, embedded, simulated, words }, sources })
}

fn fixtures(dataset: Dataset) -> PathBuf {
    project::root().join("fixtures").join(dataset.as_str())
}

fn words(format: &dyn Format, embedded: bool, simulated: bool, dir: &Path) -> String {
    let (title, of_sites) = (format.title(), format.sites().map_or_else(String::new, |sites| format!(" of {sites}")));
    match (embedded, simulated) {
        (true, false) => format!("real {title} scenes{of_sites} that come with the project"),
        (true, true) => format!(
            "*simulated* recordings in {title}'s file layout that come with the project; nothing measured on them is a \
             result about {title}"
        ),
        (false, true) => format!("*simulated* recordings in {}", dir.display()),
        (false, false) => format!("{title} recordings in {}", dir.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_is_always_said() {
        for format in gnp_data::FORMATS {
            for embedded in [true, false] {
                assert!(words(*format, embedded, true, Path::new("d")).contains("*simulated*"));
                assert!(!words(*format, embedded, false, Path::new("d")).contains("simulated"));
            }
        }
    }
}
