//! The tracks that are asked for: which files, in which format.

use std::path::{Path, PathBuf};

use gnp_data::{DataError, Dataset, Discovery, FORMATS, Format, Source, survey};

use crate::error::{Context as _, Result, bail};

/// Tracks that were found.
pub(crate) struct Input {
    /// The file or folder.
    pub(crate) root: PathBuf,
    pub(crate) dataset: Dataset,
    /// Sorted by name.
    pub(crate) sources: Vec<Source>,
    /// What is there and not read.
    pub(crate) notes: Vec<String>,
}

impl Input {
    /// The tracks at `root`, in a format or in the one that fits.
    ///
    /// # Errors
    /// When there are none, or several formats fit.
    pub(crate) fn find(root: &Path, format: Option<Dataset>) -> Result<Self> {
        if !root.exists() {
            bail!(Recordings, "there is nothing at {}; give a file of tracks or a folder of them", root.display());
        }
        let (dataset, found) = match format {
            Some(dataset) => (dataset, survey(root, dataset)?),
            None => recognised(root)?,
        };
        let notes = found.notes();
        Ok(Self { root: root.to_owned(), dataset, sources: found.sources, notes })
    }
}

/// The one format that finds recordings at `root`.
fn recognised(root: &Path) -> Result<(Dataset, Discovery)> {
    let mut fitting = Vec::new();
    let mut problems: Vec<(Dataset, DataError)> = Vec::new();
    for dataset in FORMATS.iter().map(|format: &&dyn Format| format.dataset()) {
        match survey(root, dataset) {
            Ok(found) => fitting.push((dataset, found)),
            Err(error) => problems.push((dataset, error)),
        }
    }
    if fitting.len() > 1 {
        let names: Vec<&str> = fitting.iter().map(|(dataset, _)| dataset.as_str()).collect();
        bail!(
            Recordings,
            "{}: there are tracks of several formats, {}; say which is meant",
            root.display(),
            names.join(", ")
        );
    }
    if let Some(found) = fitting.pop() {
        return Ok(found);
    }
    // A format that knows its files and finds something wrong with them says what.
    let closest = problems.iter().position(|(_, error)| !matches!(error, DataError::NoRecordings { .. }));
    if let Some(closest) = closest {
        let (dataset, error) = problems.swap_remove(closest);
        return Err(error).with_context(|| format!("tracks in the format {dataset}"));
    }
    let said: Vec<String> = problems.iter().map(|(dataset, error)| format!("\n  {dataset}: {error}")).collect();
    bail!(Recordings, "{} holds no tracks in a format that is known:{}", root.display(), said.concat())
}
