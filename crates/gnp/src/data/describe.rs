//! Which files and columns are read, in which units, and what is there.

use std::fmt::Write as _;
use std::path::Path;

use gnp_data::{Dataset, format_of, schema, survey};

use crate::error::Result;

/// The schema of a kind of data, the recordings found in `data` and what is not read there: text that ends without a line break.
///
/// # Errors
/// When the folder holds no recordings of that kind.
pub fn describe(dataset: Dataset, data: Option<&Path>) -> Result<String> {
    let mut text = schema::describe(format_of(dataset)?).trim_end().to_owned();
    let Some(dir) = data else { return Ok(text) };
    let found = survey(dir, dataset)?;
    let _ = write!(text, "\n{} in {}:", counted(found.sources.len()), dir.display());
    for source in &found.sources {
        let site = source.site.as_deref().unwrap_or("site as the file says");
        let simulated = if source.simulated { ", *simulated*" } else { "" };
        let _ = write!(text, "\n  {} ({site}{simulated})", source.name);
        let files = source.files.iter().map(|file| file.display().to_string());
        for line in files.chain(source.notes.iter().cloned()) {
            let _ = write!(text, "\n    {line}");
        }
    }
    for note in found.notes() {
        let _ = write!(text, "\n  {note}");
    }
    Ok(text)
}

fn counted(sources: usize) -> String {
    if sources == 1 {
        "1 recording or file of recordings".to_owned()
    } else {
        format!("{sources} recordings or files of recordings")
    }
}
