//! What a run folder should hold: every file that a stage left, with its size and checksum.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use gnp_data::Recording;
use gnp_file::Seal;
use serde::{Deserialize, Serialize};

use crate::data::ingest::RECORDINGS;
use crate::error::{Context as _, Error, Result};
use crate::evaluation::rules;
use crate::run::folder::Stage;

/// Folder of the curves for TensorBoard.
pub(crate) const EVENTS: &str = "events";

/// What is wrong with a file that is not there.
const MISSING: &str = "is missing";

/// The files that make a model.
const MODEL: [&str; 5] =
    ["config.toml", "modes.safetensors", "goal.safetensors", "attraction.safetensors", "repulsion.safetensors"];

/// The scores once more, for people and spreadsheets.
pub(super) const TABLES: [&str; 2] = ["metrics.csv", "metrics.md"];

/// A file of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RunFile {
    /// The stage that left it.
    pub stage: Stage,
    /// What it held then. The checksum of a recording is that which its head gives of the rest; the rest is compared
    /// with it whenever the recording is read.
    #[serde(flatten)]
    pub seal: Seal,
}

impl RunFile {
    /// The file `name` in the folder `root` as it is now.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(crate) fn of(root: &Path, name: &str, stage: Stage) -> Result<Self> {
        let path = root.join(name);
        let seal = if is_recording(name) {
            Recording::seal(&path)?
        } else {
            Seal::of(&path).with_context(|| format!("cannot read {}", path.display()))?
        };
        Ok(Self { stage, seal })
    }

    /// What is wrong with the file `name` in the folder `root`, if anything is.
    pub(crate) fn damage(&self, root: &Path, name: &str) -> Option<Damage> {
        let path = root.join(name);
        let found = if is_recording(name) {
            // A head that cannot be read is another one.
            fs::metadata(&path).map(|_| Recording::seal(&path).is_ok_and(|seal| seal == self.seal))
        } else {
            self.seal.fits(&path)
        };
        let problem = match found {
            Ok(true) => return None,
            Ok(false) => "differs from what was written".to_owned(),
            Err(error) if error.kind() == ErrorKind::NotFound => MISSING.to_owned(),
            Err(error) => format!("cannot be read ({error})"),
        };
        Some(Damage { name: name.to_owned(), stage: self.stage, problem })
    }
}

fn is_recording(name: &str) -> bool {
    name.strip_prefix(RECORDINGS).is_some_and(|rest| rest.starts_with('/'))
}

/// A file of a run that is not what was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Damage {
    /// From the run folder.
    pub(crate) name: String,
    pub(crate) stage: Stage,
    problem: String,
}

/// What a damaged file means for its run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Consequence {
    /// It cannot be made again: the run is lost.
    Lost,
    /// Its stage makes it again, and what was made from it.
    Again,
    /// It says again what another file says.
    Rewritten,
    /// It is no longer needed, or made again when it is; with the reason.
    Unneeded(&'static str),
}

/// For what a run folder is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Need {
    /// Whatever is in it.
    All,
    /// Its model alone, which may be used where its recordings must not be taken.
    Model,
    /// What ingest left: recordings and split.
    Ingest,
}

impl Need {
    /// Whether files of a stage matter at all.
    pub(crate) fn looks_at(self, stage: Stage) -> bool {
        self != Self::Ingest || stage == Stage::Ingest
    }

    /// Whether the run cannot be used so with this damage.
    pub(crate) fn is_blocked_by(self, damage: &Damage) -> bool {
        match self {
            // Recordings that are not there were left out; ones that differ are damaged, which is not to be passed over.
            Self::Model => {
                let gone = damage.problem == MISSING;
                MODEL.contains(&damage.name.as_str()) || !gone && damage.consequence() == Consequence::Lost
            }
            Self::All | Self::Ingest => matches!(damage.consequence(), Consequence::Lost | Consequence::Again),
        }
    }
}

impl Damage {
    pub(crate) fn consequence(&self) -> Consequence {
        let name = self.name.as_str();
        match self.stage {
            Stage::Ingest if name == rules::FILE => Consequence::Unneeded("the rules are fitted again"),
            Stage::Ingest if name == "ingest.txt" => Consequence::Rewritten,
            Stage::Evaluate if TABLES.contains(&name) => Consequence::Rewritten,
            Stage::Ingest => Consequence::Lost,
            _ if name.starts_with("history-") => Consequence::Rewritten,
            _ if name.starts_with(EVENTS) => Consequence::Unneeded("its curves are in the history, too"),
            _ if name.ends_with(".last.safetensors") => {
                Consequence::Unneeded("its training is finished and does not go on")
            }
            _ => Consequence::Again,
        }
    }

    /// What is wrong: `goal.safetensors is missing`.
    pub(crate) fn words(&self) -> String {
        format!("{} {}", self.name, self.problem)
    }

    /// What is wrong with files and what becomes of each, a line for all that are alike:
    /// `figures/a.png and 19 more are missing: they are made again`.
    pub(crate) fn grouped<'a>(all: impl IntoIterator<Item = (&'a Self, String)>) -> Vec<String> {
        let mut groups: Vec<(&Self, String, usize)> = Vec::new();
        for (one, told) in all {
            let alike = |it: &Self, of: &String| it.stage == one.stage && it.problem == one.problem && *of == told;
            match groups.iter_mut().find(|(first, of, _)| alike(first, of)) {
                Some((.., count)) => *count += 1,
                None => groups.push((one, told, 1)),
            }
        }
        let line = |(first, told, count): (&Self, String, usize)| match count {
            1 => format!("{}: {told}", first.words()),
            _ => {
                let problem = first.problem.replacen("is ", "are ", 1).replacen("differs", "differ", 1);
                format!("{} and {} more {problem}: {told}", first.name, count - 1)
            }
        };
        groups.into_iter().map(line).collect()
    }

    /// What it means for who reads a run and does without the file.
    pub(crate) fn done_without(&self) -> String {
        match self.consequence() {
            Consequence::Unneeded(why) => why.to_owned(),
            Consequence::Rewritten => "says only what other files say".to_owned(),
            Consequence::Lost | Consequence::Again => "done without".to_owned(),
        }
    }

    /// Refuses the run in `root` where it is damaged beyond repair.
    ///
    /// # Errors
    /// Names what cannot be made again.
    pub(crate) fn check(all: &[Self], root: &Path) -> Result<()> {
        match all.iter().any(|one| one.consequence() == Consequence::Lost) {
            true => Err(Error::Folder(Self::refusal(all, root))),
            false => Ok(()),
        }
    }

    /// Why the run in `root` is refused, and what to do.
    pub(crate) fn refusal(all: &[Self], root: &Path) -> String {
        let worst = all.iter().find(|one| one.consequence() == Consequence::Lost).or(all.first());
        let Some(worst) = worst else { return String::new() };
        let more = match all.len() - 1 {
            0 => String::new(),
            more => format!(" ({more} more damaged)"),
        };
        let (root, words) = (root.display(), worst.words());
        if worst.consequence() == Consequence::Lost {
            format!("{root}: {words} and cannot be made again{more}; copy it back, or start a new run")
        } else {
            format!("{root}: {words}{more}; `gnp pipeline --resume --out {root}` makes what is damaged again")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_made_again_is_told_from_what_can() {
        let of =
            |name: &str, stage| Damage { name: name.to_owned(), stage, problem: "is missing".to_owned() }.consequence();
        for name in ["config.toml", "ingest.json", "split.json", "recordings/0000-a.rec", "origin/goal.safetensors"] {
            assert_eq!(of(name, Stage::Ingest), Consequence::Lost, "{name}");
        }
        for (name, stage) in
            [("goal.safetensors", Stage::Goal), ("metrics.json", Stage::Evaluate), ("figures/a.svg", Stage::Report)]
        {
            assert_eq!(of(name, stage), Consequence::Again, "{name}");
        }
        assert_eq!(of("ingest.txt", Stage::Ingest), Consequence::Rewritten);
        assert_eq!(of("history-goal.json", Stage::Goal), Consequence::Rewritten);
        for name in ["events/events.out.tfevents.1", "goal.last.safetensors"] {
            assert!(matches!(of(name, Stage::Goal), Consequence::Unneeded(_)), "{name}");
        }
    }

    #[test]
    fn the_worst_is_said_first() {
        let of = |name: &str, stage| Damage { name: name.to_owned(), stage, problem: "is missing".to_owned() };
        let all = [of("goal.safetensors", Stage::Goal), of("split.json", Stage::Ingest)];
        let text = Damage::refusal(&all, Path::new("runs/a"));
        assert!(text.starts_with("runs/a: split.json is missing and cannot be made again (1 more damaged);"), "{text}");
        let text = Damage::refusal(&all[..1], Path::new("runs/a"));
        assert!(
            text.ends_with("is missing; `gnp pipeline --resume --out runs/a` makes what is damaged again"),
            "{text}"
        );
    }
}
