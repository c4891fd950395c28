//! A trained model as a folder of its own, or as bytes in a program.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use candle_core::Device;
use gnp_file::Seal;
use gnp_modes::Modes;
use serde::Deserialize;

use crate::card::{ModelCard, PredictSettings};
use crate::checkpoint::Checkpoint;
use crate::error::ModelError;
use crate::gnp::Gnp;
use crate::trust::Trust;

const CARD: &str = "card.json";
const README: &str = "README.md";
const MODES: &str = "modes.safetensors";
const GOAL: &str = "goal.safetensors";
const FORCE: &str = "repulsion.safetensors";

/// A model folder that was read: its card, and the bytes of its weights, which are what the card says.
///
/// ```no_run
/// # fn main() -> Result<(), gnp_model::ModelError> {
/// let folder = gnp_model::ModelFolder::open("models/ngsim".as_ref())?;
/// println!("{}", folder.card().text());
/// let gnp = folder.model(&gnp_model::Device::Cpu)?;
/// # Ok(()) }
/// ```
#[derive(Clone, Debug)]
pub struct ModelFolder {
    place: PathBuf,
    card: ModelCard,
    files: BTreeMap<&'static str, Cow<'static, [u8]>>,
}

impl ModelFolder {
    /// Files of weights in a model folder, as in a run folder.
    pub const FILES: [&'static str; 3] = [MODES, GOAL, FORCE];

    /// Whether there is a model folder at `path`, whole or not.
    #[must_use]
    pub fn is_at(path: &Path) -> bool {
        path.join(CARD).is_file()
    }

    /// Reads a folder and compares every file with its card.
    ///
    /// # Errors
    /// [`ModelError::NoModel`] where there is none; [`ModelError::CardFormat`] for one of a later program;
    /// [`ModelError::Changed`] for a file that is missing or differs from what the card says.
    pub fn open(root: &Path) -> Result<Self, ModelError> {
        if !Self::is_at(root) {
            let seen = match root.metadata() {
                Err(_) => "there is nothing of that name".to_owned(),
                Ok(found) if found.is_file() => "it is a file".to_owned(),
                Ok(_) => format!("it has no {CARD}"),
            };
            return Err(ModelError::NoModel { path: root.to_owned(), seen });
        }
        let read = |name: &str| {
            let path = root.join(name);
            std::fs::read(&path).map_err(|error| ModelError::changed(&path, format!("cannot be read: {error}")))
        };
        let card = read(CARD)?;
        let mut files = BTreeMap::new();
        for name in Self::FILES {
            files.insert(name, Cow::Owned(read(name)?));
        }
        Self::of(root.to_owned(), &card, files)
    }

    /// The same of bytes that a program has; `name` stands for the folder in messages. `files` are those of
    /// [`ModelFolder::FILES`], in their order.
    ///
    /// # Errors
    /// As [`ModelFolder::open`].
    pub fn embedded(name: &str, card: &[u8], files: [&'static [u8]; 3]) -> Result<Self, ModelError> {
        let files = Self::FILES.into_iter().zip(files.map(Cow::Borrowed));
        Self::of(name.into(), card, files.collect())
    }

    fn of(place: PathBuf, card: &[u8], files: BTreeMap<&'static str, Cow<'static, [u8]>>) -> Result<Self, ModelError> {
        #[derive(Deserialize)]
        struct Layout {
            format: u32,
        }
        let path = place.join(CARD);
        let unusable = |problem: String| ModelError::changed(&path, problem);
        // First, since the rest of a later card may be otherwise.
        let Layout { format } = gnp_file::parse_json(card).map_err(unusable)?;
        if format != ModelCard::FORMAT {
            return Err(ModelError::CardFormat { path, found: format, reads: ModelCard::FORMAT });
        }
        let card: ModelCard = gnp_file::parse_json(card).map_err(unusable)?;
        for (name, bytes) in &files {
            let path = place.join(name);
            match card.files.get(*name) {
                Some(seal) if *seal == Seal::of_bytes(bytes) => {}
                Some(_) => return Err(ModelError::changed(&path, format!("differs from what {CARD} says (SHA-256)"))),
                None => return Err(ModelError::changed(&path, format!("is not named in {CARD}"))),
            }
        }
        Ok(Self { place, card, files })
    }

    /// Where it is: its folder, or what was given in its place.
    #[must_use]
    pub fn place(&self) -> &Path {
        &self.place
    }

    /// What it is.
    #[must_use]
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    /// The predictor, with the settings of the card.
    ///
    /// # Errors
    /// As [`Gnp::load`].
    pub fn model(&self, device: &Device) -> Result<Gnp, ModelError> {
        let PredictSettings { neighbours, selection, trust, .. } = self.card.predict;
        let file = |name: &'static str| (self.place.join(name), self.files.get(name).map_or(&[][..], |bytes| bytes));
        let ((modes, modes_bytes), (goal, goal_bytes), (force, force_bytes)) = (file(MODES), file(GOAL), file(FORCE));
        let parts = (
            Modes::parse(&modes, modes_bytes)?,
            Checkpoint::parse(&goal, goal_bytes)?,
            Checkpoint::parse(&force, force_bytes)?,
        );
        let gnp = Gnp::of_files(parts, [&goal, &force], neighbours.without_future(), device)?;
        gnp.selecting(selection).trusting(Trust::Share(trust.into()))
    }

    /// Writes `card.json` and `README.md` to `root`, which has the files of weights; the card then names what they hold.
    ///
    /// # Errors
    /// [`ModelError::Changed`] when a file of weights cannot be read; [`ModelError::Checkpoint`] when one cannot be written.
    pub fn write_card(root: &Path, card: ModelCard) -> Result<ModelCard, ModelError> {
        let mut card = card;
        card.files.clear();
        for name in Self::FILES {
            let path = root.join(name);
            let seal =
                Seal::of(&path).map_err(|error| ModelError::changed(&path, format!("cannot be read: {error}")))?;
            card.files.insert(name.to_owned(), seal);
        }
        gnp_file::save_json(&root.join(CARD), &card)?;
        let path = root.join(README);
        gnp_file::save(&path, card.text().as_bytes())
            .map_err(|error| ModelError::checkpoint(&path, format!("cannot be written: {error}")))?;
        Ok(card)
    }
}

impl Gnp {
    /// Opens a model folder, with the settings of its card. Files of weights alone, as in a run folder, are read by
    /// [`Gnp::load`].
    ///
    /// # Errors
    /// As [`ModelFolder::open`] and [`ModelFolder::model`].
    pub fn open(folder: &Path, device: &Device) -> Result<Self, ModelError> {
        ModelFolder::open(folder)?.model(device)
    }
}
