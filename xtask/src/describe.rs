//! `ingest --describe`: which files and columns are read, in which units, and what is there.

use anyhow::{Result, bail};
use gnp_data::{FORMATS, discover, format_of, schema};

use crate::cli::RunArgs;
use crate::config::RunConfig;
use crate::terminal::Terminal;

/// Prints the schema of the data set asked for, and the recordings found in `--data-dir`.
///
/// # Errors
/// When the folder holds no recordings of that kind.
pub(crate) fn run(run: &RunArgs, terminal: &Terminal) -> Result<()> {
    let datasets = match (run.dataset, &run.config) {
        (None, None) => FORMATS.iter().map(|format| format.dataset()).collect(),
        _ => vec![RunConfig::resolve(run)?.0.dataset],
    };
    for dataset in &datasets {
        terminal.result(&schema::describe(format_of(*dataset)?));
    }
    let Some(dir) = &run.data_dir else { return Ok(()) };
    let [dataset] = datasets[..] else { bail!("give --dataset to see what is in {}", dir.display()) };
    let sources = discover(dir, dataset)?;
    terminal.result(&format!("{} in {}:", counted(sources.len()), dir.display()));
    for source in sources {
        let site = source.site.as_deref().unwrap_or("site as the file says");
        let simulated = if source.simulated { ", *simulated*" } else { "" };
        terminal.result(&format!("  {} ({site}{simulated})", source.name));
        for file in &source.files {
            terminal.result(&format!("    {}", file.display()));
        }
        for note in &source.notes {
            terminal.result(&format!("    {note}"));
        }
    }
    Ok(())
}

fn counted(sources: usize) -> String {
    if sources == 1 {
        "1 recording or file of recordings".to_owned()
    } else {
        format!("{sources} recordings or files of recordings")
    }
}
