//! A run on disk: what is where, what is finished, and how files get there.
//!
//! Every file is written under a temporary name and then renamed; a folder is filled beside its
//! place and then renamed. What has its final name is whole.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{Context as _, Result, bail};
use gnp_model::Origin;
use serde::{Deserialize, Serialize};
use tempfile::TempDir;

/// Version of the layout of a run folder.
const FORMAT: u32 = 1;
const STATE: &str = "run.json";

/// A stage of the pipeline, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Stage {
    /// Recordings to windows and their split.
    Ingest,
    /// Training windows to intention modes.
    Modes,
    /// The goal network.
    Goal,
    /// The goal attraction.
    Attraction,
    /// The repulsion of vehicles and lines.
    Repulsion,
    /// Scores on the test part.
    Evaluate,
    /// Figures and the report.
    Report,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Self; 7] =
        [Self::Ingest, Self::Modes, Self::Goal, Self::Attraction, Self::Repulsion, Self::Evaluate, Self::Report];

    /// As in file names.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ingest => "ingest",
            Self::Modes => "modes",
            Self::Goal => "goal",
            Self::Attraction => "attraction",
            Self::Repulsion => "repulsion",
            Self::Evaluate => "evaluate",
            Self::Report => "report",
        }
    }

    /// The command that does it.
    fn command(self) -> String {
        match self {
            Self::Ingest | Self::Evaluate | Self::Report => self.name().to_owned(),
            _ => format!("train --stage {}", self.name()),
        }
    }

    /// What must be finished before it.
    #[must_use]
    pub fn needs(self) -> &'static [Self] {
        match self {
            Self::Ingest => &[],
            Self::Modes => &[Self::Ingest],
            // The split is made with the modes.
            Self::Goal | Self::Attraction => &[Self::Ingest, Self::Modes],
            Self::Repulsion => &[Self::Ingest, Self::Modes, Self::Attraction],
            Self::Evaluate => &[Self::Ingest, Self::Modes, Self::Goal, Self::Attraction, Self::Repulsion],
            Self::Report => &[Self::Ingest, Self::Modes, Self::Goal, Self::Attraction, Self::Repulsion, Self::Evaluate],
        }
    }
}

/// Where the recordings of a run come from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct DataState {
    /// Folder or file that was read.
    pub dir: PathBuf,
    /// Whether it is the data that comes with the project.
    pub embedded: bool,
    /// Whether any recording was made by a simulator.
    pub simulated: bool,
    /// What the data is, for headings.
    #[serde(alias = "words")]
    pub description: String,
}

/// `run.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RunState {
    /// Version of the layout.
    pub format: u32,
    /// Version of the program that started the run.
    pub version: String,
    /// Seed of the configuration.
    pub seed: u64,
    /// The recordings.
    pub data: DataState,
    /// Hash of the split, which names the windows of every part; empty before there is one.
    pub split_hash: String,
    /// The run that this one started from, where it is fine-tuned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
    /// Finished stages, with how long each took in seconds.
    pub finished: BTreeMap<Stage, f64>,
}

impl RunState {
    /// The state of a new run.
    pub(crate) fn new(seed: u64, data: DataState) -> Self {
        let version = env!("CARGO_PKG_VERSION").to_owned();
        Self { format: FORMAT, version, seed, data, split_hash: String::new(), origin: None, finished: BTreeMap::new() }
    }

    /// Notes that a stage is finished, and how many seconds it took.
    pub(crate) fn note(&mut self, stage: Stage, seconds: f64) {
        self.finished.insert(stage, (seconds * 100.).round() / 100.);
    }
}

/// A folder being filled beside its place; dropped without [`Draft::publish`] it vanishes.
#[derive(Debug)]
pub(crate) struct Draft {
    folder: TempDir,
    place: PathBuf,
}

impl Draft {
    /// Starts a folder that will stand at `place`.
    ///
    /// # Errors
    /// When `place` exists and is not an empty folder; the message ends with `remedy`.
    pub(crate) fn start(place: &Path, remedy: &str) -> Result<Self> {
        if occupied(place)? {
            bail!(Folder, "{} exists and is not empty; {remedy}", place.display());
        }
        let parent = parent_of(place);
        fs::create_dir_all(parent).with_context(|| format!("cannot make the folder {}", parent.display()))?;
        let name = place.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let folder = as_open_as_others()
            .prefix(&format!(".{name}.unfinished-"))
            .tempdir_in(parent)
            .with_context(|| format!("cannot make a folder in {}", parent.display()))?;
        Ok(Self { folder, place: place.to_owned() })
    }

    /// The folder as it is now.
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Moves the folder to its place.
    ///
    /// # Errors
    /// When it cannot be moved there.
    pub(crate) fn publish(self) -> Result<PathBuf> {
        let place = self.place;
        let cannot = || format!("cannot move the finished folder to {}", place.display());
        if place.is_dir() {
            fs::remove_dir(&place).with_context(cannot)?; // empty, or this fails
        }
        fs::rename(self.folder.path(), &place).with_context(cannot)?;
        // Nothing is left at the temporary name; forget it instead of cleaning it up.
        let _ = self.folder.keep();
        Ok(place)
    }
}

/// Makes temporary folders that are not for their owner alone: they become final ones.
fn as_open_as_others() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777)); // less the umask
    builder
}

/// Whether something that must not be overwritten is at `place`.
pub(crate) fn occupied(place: &Path) -> Result<bool> {
    if !place.exists() {
        return Ok(false);
    }
    if !place.is_dir() {
        return Ok(true);
    }
    let mut entries = fs::read_dir(place).with_context(|| format!("cannot list {}", place.display()))?;
    Ok(entries.next().is_some())
}

/// A run folder that exists: ingest is finished.
#[derive(Debug)]
pub(crate) struct RunFolder {
    root: PathBuf,
    /// What is finished.
    pub(crate) state: RunState,
}

impl RunFolder {
    /// Opens a folder.
    ///
    /// # Errors
    /// When it is not a run folder, or one of another version.
    pub(crate) fn open(root: &Path) -> Result<Self> {
        let path = root.join(STATE);
        let text = fs::read_to_string(&path).with_context(|| {
            format!("{} is not a run folder; start one with `gnp ingest --dataset NAME --out {0}`", root.display())
        })?;
        let state: RunState = serde_json::from_str(&text)
            .with_context(|| format!("{} cannot be read; start a new run", path.display()))?;
        if state.format != FORMAT {
            bail!(Folder, "{} has layout {}, this program has {FORMAT}; start a new run", path.display(), state.format);
        }
        Ok(Self { root: root.to_owned(), state })
    }

    /// The folder.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// A file or folder in it.
    pub(crate) fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.root.join(name)
    }

    /// A JSON file in it.
    ///
    /// # Errors
    /// When it is missing or damaged.
    pub(crate) fn read_json<T: serde::de::DeserializeOwned>(&self, name: &str) -> Result<T> {
        let path = self.path(name);
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{} is damaged; start a new run", path.display()))
    }

    /// Whether a stage is finished.
    pub(crate) fn has(&self, stage: Stage) -> bool {
        self.state.finished.contains_key(&stage)
    }

    /// Whether everything that `stage` needs is finished.
    ///
    /// # Errors
    /// Names the missing stage and its command.
    pub(crate) fn require(&self, stage: Stage) -> Result<()> {
        match stage.needs().iter().find(|needed| !self.has(**needed)) {
            Some(needed) => bail!(
                Folder,
                "{} needs {}, which is not finished in {root}; run `gnp {2} --run {root}` first",
                stage.name(),
                needed.name(),
                needed.command(),
                root = self.root.display()
            ),
            None => Ok(()),
        }
    }

    /// Notes that a stage is finished.
    ///
    /// # Errors
    /// When the state cannot be written.
    pub(crate) fn finish(&mut self, stage: Stage, seconds: f64) -> Result<()> {
        self.state.note(stage, seconds);
        write_state(&self.root, &self.state)
    }

    /// Forgets a stage, and all that were made from it; their trainings start anew.
    ///
    /// # Errors
    /// When the state cannot be written or a checkpoint not be removed.
    pub(crate) fn forget(&mut self, stage: Stage) -> Result<()> {
        let mut gone = vec![stage];
        for later in Stage::ALL {
            if later.needs().iter().any(|needed| gone.contains(needed)) {
                gone.push(later);
            }
        }
        for stage in &gone {
            let path = self.path(format!("{}.last.safetensors", stage.name()));
            if path.exists() {
                fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
            }
        }
        self.state.finished.retain(|stage, _| !gone.contains(stage));
        write_state(&self.root, &self.state)
    }
}

/// Writes `run.json`.
pub(crate) fn write_state(root: &Path, state: &RunState) -> Result<()> {
    write_json(&root.join(STATE), state)
}

/// Writes a whole file: temporary name, then rename.
///
/// # Errors
/// When the folder cannot be written.
pub(crate) fn write(path: &Path, content: &[u8]) -> Result<()> {
    gnp_file::save(path, content).with_context(|| format!("cannot write {}", path.display()))
}

/// [`write()`] of a value as readable JSON.
///
/// # Errors
/// As [`write()`].
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value).with_context(|| format!("cannot write {}", path.display()))?;
    text.push('\n');
    write(path, text.as_bytes())
}

fn parent_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> RunState {
        let data = DataState { dir: "data".into(), embedded: false, simulated: true, description: "simulated".into() };
        RunState::new(3, data)
    }

    fn folder(parent: &TempDir) -> RunFolder {
        let place = parent.path().join("run");
        let draft = Draft::start(&place, "take another name").unwrap();
        write_state(draft.path(), &state()).unwrap();
        draft.publish().unwrap();
        RunFolder::open(&place).unwrap()
    }

    #[test]
    fn an_abandoned_draft_leaves_nothing() {
        let parent = TempDir::new().unwrap();
        let draft = Draft::start(&parent.path().join("run"), "").unwrap();
        fs::write(draft.path().join("half"), "x").unwrap();
        drop(draft);
        assert!(!occupied(parent.path()).unwrap());
    }

    #[test]
    fn a_folder_in_use_is_refused_and_an_empty_one_is_taken() {
        let parent = TempDir::new().unwrap();
        fs::create_dir(parent.path().join("run")).unwrap();
        let run = folder(&parent);
        assert_eq!(run.state, state());
        let message = Draft::start(run.root(), "give --resume").unwrap_err().to_string();
        assert!(message.contains("not empty; give --resume"), "{message}");
    }

    #[test]
    fn stages_are_required_finished_and_forgotten() {
        let parent = TempDir::new().unwrap();
        let mut run = folder(&parent);
        assert!(run.require(Stage::Modes).unwrap_err().to_string().contains("gnp ingest"));
        for stage in Stage::ALL {
            run.require(stage).unwrap();
            run.finish(stage, 1.).unwrap();
        }
        run.forget(Stage::Attraction).unwrap();
        let run = RunFolder::open(run.root()).unwrap();
        let left: Vec<Stage> = run.state.finished.keys().copied().collect();
        assert_eq!(left, [Stage::Ingest, Stage::Modes, Stage::Goal]);
    }

    #[test]
    fn a_foreign_folder_is_refused() {
        let parent = TempDir::new().unwrap();
        let message = RunFolder::open(parent.path()).unwrap_err().to_string();
        assert!(message.contains("is not a run folder"), "{message}");
        fs::write(parent.path().join(STATE), serde_json::to_string(&RunState { format: 99, ..state() }).unwrap())
            .unwrap();
        assert!(RunFolder::open(parent.path()).unwrap_err().to_string().contains("layout 99"));
    }
}
