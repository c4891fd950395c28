//! `export`: the model of a run as a folder of its own.

use std::path::PathBuf;

use gnp_model::{CardWords, ModelCard, ModelFolder};

use crate::error::{Context as _, Result, bail};
use crate::machine::Machine;
use crate::run::Run;
use crate::run::draft::Draft;

/// Longest name of a model, in characters.
const LONGEST: usize = 80;

/// Which run, where to, and what is said of it.
#[derive(Clone, Debug)]
pub struct ExportRequest {
    /// The run; its trainings are finished.
    pub run: PathBuf,
    /// The model folder to make; nothing or an empty folder may be there.
    pub out: PathBuf,
    /// Name of the model; that of the run's folder where it is not given.
    pub name: Option<String>,
    /// TOML with title, licence, limits and scores: [`CardWords`].
    pub card: Option<PathBuf>,
}

/// Writes the model of a run as a folder that needs no recordings: weights, card, and the card as text. The folder
/// appears whole or not at all. The same run and words give the same bytes.
///
/// # Errors
/// When a training of the run is not finished or a file of it is damaged; when the words or the name cannot be used; when
/// the place is taken.
pub fn export(request: &ExportRequest, machine: &Machine) -> Result<ModelCard> {
    let ExportRequest { run, out, name, card } = request;
    let run = Run::open_model(run, machine)?;
    if let Some(name) = name
        && (name.trim().is_empty() || name.chars().count() > LONGEST || name.chars().any(char::is_control))
    {
        bail!(Config, "{name:?} is no name of a model: give 1 to {LONGEST} characters in one line");
    }
    let mut made = run.card(name.as_deref())?;
    if let Some(path) = card {
        let cannot = || format!("{} cannot be used as the words of a card", path.display());
        let text = std::fs::read_to_string(path).with_context(cannot)?;
        let words: CardWords = match toml::from_str(&text) {
            Ok(words) => words,
            Err(error) => bail!(Config, "{}: {}", cannot(), error.to_string().trim_end()),
        };
        made = made.with_words(words);
    }
    let draft = Draft::start(out, "take another --out", machine)?;
    for name in ModelFolder::FILES {
        let from = run.folder.path(name);
        gnp_file::copy(&from, &draft.path().join(name)).with_context(|| format!("cannot copy {}", from.display()))?;
    }
    let made = ModelFolder::write_card(draft.path(), made)?;
    draft.publish()?;
    Ok(made)
}
