//! A run on disk: what is where, what is finished, and what each file should hold.
//!
//! Every file is written under a temporary name and then renamed; a folder is filled beside its
//! place and then renamed. A stage is finished when `run.json` says so, with the size and checksum of every file that it
//! left; opening a run compares them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use gnp_model::Origin;
use serde::{Deserialize, Serialize};

use crate::error::{Context as _, Error, Result, bail};
use crate::inside::inside;
use crate::run::foreign::foreign;
use crate::run::manifest::{Consequence, Damage, EVENTS, Need, RunFile};

pub use crate::run::stage::Stage;

/// Version of the layout of a run folder.
const FORMAT: u32 = 2;
pub(super) const STATE: &str = "run.json";
/// What to do about a `run.json` that cannot be used.
pub(super) const REMEDY: &str = "copy it back, or start a new run";

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
    /// The files of the run by their names from its folder; a file that is not here is not of the run.
    pub files: BTreeMap<String, RunFile>,
}

impl RunState {
    /// The state of a new run.
    pub(crate) fn new(seed: u64, data: DataState) -> Self {
        let version = env!("CARGO_PKG_VERSION").to_owned();
        let (split_hash, finished, files) = Default::default();
        Self { format: FORMAT, version, seed, data, split_hash, origin: None, finished, files }
    }

    /// Notes what files of a stage in the folder `root` hold.
    ///
    /// # Errors
    /// When one cannot be read.
    pub(crate) fn record(&mut self, root: &Path, stage: Stage, names: impl IntoIterator<Item = String>) -> Result<()> {
        for name in names {
            let file = RunFile::of(root, &name, stage)?;
            self.files.insert(name, file);
        }
        Ok(())
    }

    /// [`RunState::record`] of all files of a finished stage: those that it always leaves, and `more`.
    ///
    /// # Errors
    /// When one cannot be read.
    pub(crate) fn record_stage(&mut self, root: &Path, stage: Stage, more: Vec<String>) -> Result<()> {
        self.record(root, stage, stage.files().into_iter().chain(more))
    }

    /// Notes that a stage is finished, and how many seconds it took.
    pub(crate) fn note(&mut self, stage: Stage, seconds: f64) {
        self.finished.insert(stage, (seconds * 100.).round() / 100.);
    }
}

/// A run folder that exists: ingest is finished.
#[derive(Debug)]
pub(crate) struct RunFolder {
    root: PathBuf,
    /// What is finished.
    pub(crate) state: RunState,
    /// What it was opened for.
    need: Need,
    /// Files that are not what was written and are not needed; who comes to use one is refused then.
    passed_over: Vec<Damage>,
}

impl RunFolder {
    /// Whether there is a run folder at `root`, whole or not.
    pub(crate) fn is_at(root: &Path) -> bool {
        root.join(STATE).is_file()
    }

    /// Opens a folder, whatever became of its files.
    ///
    /// # Errors
    /// When it is not a run folder, or one of another version, or its `run.json` is damaged.
    pub(crate) fn open(root: &Path) -> Result<Self> {
        #[derive(Deserialize)]
        struct Layout {
            format: u32,
        }
        let path = root.join(STATE);
        let bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Err(Error::Folder(foreign(root))),
            Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
        };
        // First, since earlier layouts had no checksum.
        if let Ok(Layout { format }) = serde_json::from_slice(&bytes)
            && format != FORMAT
        {
            bail!(Folder, "{} has layout {format}, this program has {FORMAT}; start a new run", path.display());
        }
        let state: RunState = match gnp_file::parse_json(&bytes) {
            Ok(state) => state,
            Err(problem) => bail!(Folder, "{} {problem}; {REMEDY}", path.display()),
        };
        // Files by these names are removed, too.
        state.files.keys().try_for_each(|name| inside(root, name).map(drop))?;
        Ok(Self { root: root.to_owned(), state, need: Need::All, passed_over: Vec::new() })
    }

    /// Opens a folder and looks what is damaged of the files that `need` looks at.
    ///
    /// # Errors
    /// As [`RunFolder::open`].
    pub(crate) fn look(root: &Path, need: Need) -> Result<(Self, Vec<Damage>)> {
        let mut folder = Self::open(root)?;
        loop {
            folder.need = need;
            let damage = folder.damage();
            let now = if damage.is_empty() { None } else { Some(Self::open(root)?) };
            match now {
                // Somebody worked in it meanwhile: what differs may be new.
                Some(now) if now.state != folder.state => folder = now,
                _ => return Ok((folder, damage)),
            }
        }
    }

    /// Opens a folder in which every file that is needed is as it was written; others are passed over.
    ///
    /// # Errors
    /// As [`RunFolder::open`]; when a file is missing or differs, with how it is made again.
    pub(crate) fn whole(root: &Path, need: Need) -> Result<Self> {
        let (mut folder, damage) = Self::look(root, need)?;
        let (blocking, passed_over): (Vec<Damage>, Vec<Damage>) =
            damage.into_iter().partition(|one| need.is_blocked_by(one));
        if !blocking.is_empty() {
            return Err(Error::Folder(Damage::refusal(&blocking, root)));
        }
        for one in passed_over.iter().filter(|one| matches!(one.consequence(), Consequence::Unneeded(_))) {
            folder.state.files.remove(&one.name);
        }
        folder.passed_over = passed_over;
        Ok(folder)
    }

    /// Files that are not what was written, of those that are looked at.
    pub(crate) fn damage(&self) -> Vec<Damage> {
        let looked_at = self.state.files.iter().filter(|(_, file)| self.need.looks_at(file.stage));
        looked_at.filter_map(|(name, file)| file.damage(&self.root, name)).collect()
    }

    /// What it was opened for.
    pub(super) fn need(&self) -> Need {
        self.need
    }

    /// Files that are not what was written and that it was opened without.
    pub(super) fn passed_over(&self) -> &[Damage] {
        &self.passed_over
    }

    /// A file in it that is about to be read.
    ///
    /// # Errors
    /// When it is not what was written and was passed over when the folder was opened.
    pub(crate) fn usable(&self, name: &str) -> Result<PathBuf> {
        match self.passed_over.iter().find(|one| one.name == name) {
            Some(one) => Err(Error::Folder(Damage::refusal(std::slice::from_ref(one), &self.root))),
            None => Ok(self.path(name)),
        }
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
        let path = self.usable(name)?;
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

    /// As [`RunState::record`].
    pub(crate) fn record(&mut self, stage: Stage, names: impl IntoIterator<Item = String>) -> Result<()> {
        self.state.record(&self.root, stage, names)
    }

    /// Notes that a stage is finished, with the files that it left: those of known names, and `more`.
    ///
    /// # Errors
    /// When a file cannot be read or the state not be written.
    pub(crate) fn finish(&mut self, stage: Stage, seconds: f64, mut more: Vec<String>) -> Result<()> {
        self.state.files.retain(|_, file| file.stage != stage || stage == Stage::Ingest);
        more.extend(self.events()?);
        self.state.record_stage(&self.root, stage, more)?;
        self.state.note(stage, seconds);
        self.write()
    }

    /// Curves for TensorBoard that no finished stage left.
    fn events(&self) -> Result<Vec<String>> {
        let folder = self.path(EVENTS);
        if !folder.exists() {
            return Ok(Vec::new());
        }
        let cannot = || format!("cannot list {}", folder.display());
        let mut names = Vec::new();
        for entry in fs::read_dir(&folder).with_context(cannot)? {
            let name = format!("{EVENTS}/{}", entry.with_context(cannot)?.file_name().to_string_lossy());
            if name.contains(".tfevents.") && !self.state.files.contains_key(&name) {
                names.push(name);
            }
        }
        Ok(names)
    }

    /// Forgets stages, and all that were made from them, with their files, so that they are done anew.
    ///
    /// # Errors
    /// When the state cannot be written or a file not be removed.
    pub(crate) fn forget(&mut self, stages: &[Stage]) -> Result<()> {
        let mut gone = stages.to_vec();
        for later in Stage::ALL {
            if later.needs().iter().any(|needed| gone.contains(needed)) {
                gone.push(later);
            }
        }
        self.state.finished.retain(|stage, _| !gone.contains(stage));
        let (stay, go) =
            std::mem::take(&mut self.state.files).into_iter().partition(|(_, it)| !gone.contains(&it.stage));
        self.state.files = stay;
        self.write()?;
        // Curves stay for comparison; what was last begun starts anew.
        let go: BTreeMap<String, RunFile> = go;
        let mut names: BTreeSet<String> = go.into_keys().filter(|name| !name.starts_with(EVENTS)).collect();
        names.extend(gone.iter().map(|stage| format!("{}.last.safetensors", stage.name())));
        for name in names {
            let path = self.path(name);
            match fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(error).with_context(|| format!("cannot remove {}", path.display()));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Writes what is finished.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub(crate) fn write(&self) -> Result<()> {
        write_state(&self.root, &self.state)
    }
}

/// Writes `run.json`.
pub(crate) fn write_state(root: &Path, state: &RunState) -> Result<()> {
    Ok(gnp_file::save_json(&root.join(STATE), state)?)
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

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;

    fn state() -> RunState {
        let data = DataState { dir: "data".into(), embedded: false, simulated: true, description: "simulated".into() };
        RunState::new(3, data)
    }

    /// A run folder with what a stage leaves as text.
    fn folder(root: &Path) -> RunFolder {
        write_state(root, &state()).unwrap();
        RunFolder::open(root).unwrap()
    }

    fn finish(run: &mut RunFolder, stage: Stage) {
        stage.files().iter().for_each(|name| fs::write(run.path(name), name).unwrap());
        run.finish(stage, 1., Vec::new()).unwrap();
    }

    #[test]
    fn stages_are_required_finished_and_forgotten() {
        let parent = TempDir::new().unwrap();
        let mut run = folder(parent.path());
        assert!(run.require(Stage::Modes).unwrap_err().to_string().contains("gnp ingest"));
        for stage in Stage::ALL {
            run.require(stage).unwrap();
            finish(&mut run, stage);
        }
        fs::write(run.path("mine.txt"), "mine").unwrap();
        run.forget(&[Stage::Attraction]).unwrap();
        let run = RunFolder::whole(run.root(), Need::All).unwrap();
        let left: Vec<Stage> = run.state.finished.keys().copied().collect();
        assert_eq!(left, [Stage::Ingest, Stage::Modes, Stage::Goal]);
        let there = ["mine.txt", "goal.safetensors"].map(|name| run.path(name).exists());
        let gone =
            ["attraction.safetensors", "repulsion.last.safetensors", "report.html"].map(|name| run.path(name).exists());
        assert_eq!((there, gone), ([true; 2], [false; 3]));
    }

    #[test]
    fn what_is_missing_or_differs_is_found_by_name() {
        let parent = TempDir::new().unwrap();
        let mut run = folder(parent.path());
        fs::create_dir(run.path(EVENTS)).unwrap();
        for name in ["events.out.tfevents.1.gnp.0", "notes"] {
            fs::write(run.path(EVENTS).join(name), name).unwrap();
        }
        finish(&mut run, Stage::Ingest);
        finish(&mut run, Stage::Goal);
        let names: Vec<&str> = run.state.files.keys().map(String::as_str).collect();
        assert!(names.contains(&"events/events.out.tfevents.1.gnp.0") && !names.contains(&"events/notes"), "{names:?}");
        RunFolder::whole(run.root(), Need::All).unwrap();
        for (name, text) in [("goal.safetensors", Some("goal.safetensorz")), ("goal.safetensors", None)] {
            let path = run.path(name);
            match text {
                Some(text) => fs::write(&path, text).unwrap(),
                None => fs::remove_file(&path).unwrap(),
            }
            let message = RunFolder::whole(run.root(), Need::All).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("--resume"), "{message}");
            fs::write(&path, name).unwrap();
        }
        // What other files say, too, is done without until it is used.
        fs::remove_file(run.path("history-goal.json")).unwrap();
        let opened = RunFolder::whole(run.root(), Need::All).unwrap();
        let message = opened.usable("history-goal.json").unwrap_err().to_string();
        assert!(message.contains("history-goal.json is missing") && message.contains("--resume"), "{message}");
        opened.usable("goal.safetensors").unwrap();
        // Whoever made the folder names nothing outside of it.
        let mut elsewhere = run.state.clone();
        elsewhere.files.insert("../mine.txt".to_owned(), run.state.files["goal.safetensors"].clone());
        write_state(run.root(), &elsewhere).unwrap();
        let message = RunFolder::open(run.root()).unwrap_err().to_string();
        assert!(message.contains("../mine.txt"), "{message}");
        run.write().unwrap();
        // Under its checksum stands all the rest.
        let path = run.path(STATE);
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, text.replace("\"seed\": 3", "\"seed\": 4")).unwrap();
        let message = RunFolder::open(run.root()).unwrap_err().to_string();
        assert!(message.contains("run.json differs from what was written; copy it back"), "{message}");
    }

    #[test]
    fn a_foreign_folder_is_refused_as_what_it_is() {
        let parent = TempDir::new().unwrap();
        let message = || RunFolder::open(parent.path()).unwrap_err().to_string();
        assert!(message().contains("is not a run folder"), "{}", message());
        for (file, says) in [("eval.json", "scores"), ("table.toml", "gnp compare --resume")] {
            fs::write(parent.path().join(file), "").unwrap();
            assert!(message().contains(says), "{}", message());
        }
        let gone = RunFolder::open(&parent.path().join("gone")).unwrap_err().to_string();
        assert!(gone.contains("is not there: there is no run"), "{gone}");
        fs::write(parent.path().join(STATE), "{\"format\": 1, \"version\": \"0.1.0\"}").unwrap();
        assert!(message().contains("has layout 1, this program has 2; start a new run"), "{}", message());
    }
}
