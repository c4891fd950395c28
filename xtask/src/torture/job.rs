//! What is disturbed: a pipeline, a table, a simulation; each done once undisturbed, as the reference.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use gnp::Stage;
use serde_json::Value;

use crate::contents::Contents;
use crate::process::{Running, Starter};
use crate::project;

/// Settings that make the trainings of the smoke configuration long enough to be hit, and the whole run a second.
const SETTINGS: [&str; 4] = ["goal.epochs=8", "attraction.epochs=6", "repulsion.epochs=6", "data.max_recordings=1"];

/// Two small trainings beside that of GNP.
const RECIPES: &str = r#"[shared]
forms = ["published"]
steps = 40
warm_up = 0.6
batch = 32
learning_rate = 2e-3
schedule = { kind = "constant" }
weight_decay = 0.0
clip_norm = 10.0
class_loss = "none"
class_loss_in_warm_up = false
unit_m = 5.0
fused_targets = 0

[column_network]
networks = 1
hidden = 8
dropout = 0.2
epochs = 4
batch = 64
learning_rate = 1e-3
weight_decay = 0.3
seed = 18

[s_lstm]
seed = 11
"#;

/// A command that writes a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// `pipeline`.
    Pipeline,
    /// `compare`.
    Compare,
    /// `simulate`.
    Simulate,
}

/// A command with what it writes when nothing happens.
#[derive(Debug)]
pub(crate) struct Job {
    kind: Kind,
    starter: Starter,
    /// Folder with what all jobs read.
    inputs: PathBuf,
    /// The undisturbed folder.
    pub(crate) folder: PathBuf,
    /// What is in it.
    pub(crate) contents: Contents,
    /// How long it took.
    pub(crate) total: Duration,
}

/// Writes what all jobs read.
///
/// # Errors
/// When a file cannot be copied.
pub(crate) fn prepare(inputs: &Path) -> Result<()> {
    project::one_recording(inputs)?;
    fs::write(inputs.join("recipes.toml"), RECIPES).context("cannot write recipes.toml")
}

impl Job {
    /// Does it undisturbed, into `folder`.
    ///
    /// # Errors
    /// When it fails.
    pub(crate) fn undisturbed(kind: Kind, starter: &Starter, inputs: &Path, folder: &Path) -> Result<Self> {
        let begun = Instant::now();
        starter.run(&arguments(kind, inputs, folder))?.well()?;
        Ok(Self {
            kind,
            starter: starter.clone(),
            inputs: inputs.to_owned(),
            folder: folder.to_owned(),
            contents: Contents::read(folder)?,
            total: begun.elapsed(),
        })
    }

    /// The arguments that write or go on with `folder`.
    pub(crate) fn arguments(&self, folder: &Path) -> Vec<String> {
        arguments(self.kind, &self.inputs, folder)
    }

    /// Starts it, or goes on.
    ///
    /// # Errors
    /// When it cannot be started.
    pub(crate) fn start(&self, folder: &Path) -> Result<Running> {
        self.starter.start(&self.arguments(folder))
    }

    /// The program.
    pub(crate) fn starter(&self) -> &Starter {
        &self.starter
    }

    /// Folder of the recordings that it reads.
    pub(crate) fn data(&self) -> PathBuf {
        self.inputs.join("data")
    }

    /// Stages of a pipeline with how long each took; `None` for other commands.
    ///
    /// # Errors
    /// When `run.json` does not tell.
    pub(crate) fn stages(&self) -> Result<Option<Vec<(Stage, Duration)>>> {
        if self.kind != Kind::Pipeline {
            return Ok(None);
        }
        let seconds = finished(&self.folder)?;
        if seconds.len() != Stage::ALL.len() {
            bail!("{} does not name every stage as finished", self.folder.join("run.json").display());
        }
        Ok(Some(seconds.into_iter().map(|(stage, seconds)| (stage, Duration::from_secs_f64(seconds))).collect()))
    }

    /// What is finished of a pipeline in `folder`; of other commands nothing is told.
    ///
    /// # Errors
    /// When `run.json` is damaged.
    pub(crate) fn done(&self, folder: &Path) -> Result<Vec<(Stage, f64)>> {
        if self.kind == Kind::Pipeline { finished(folder) } else { Ok(Vec::new()) }
    }

    /// Requires that stages that were finished `before` were not done again: the seconds that they took are still the same.
    ///
    /// # Errors
    /// Names those that were.
    pub(crate) fn expect_kept(&self, before: &[(Stage, f64)], folder: &Path) -> Result<()> {
        let again = done_again(before, &self.done(folder)?);
        if again.is_empty() {
            return Ok(());
        }
        bail!("finished stages were done again: {}", again.join(", "))
    }

    /// Requires that `folder` is as the undisturbed one, and that nothing else lies beside it.
    ///
    /// # Errors
    /// Names what is not.
    pub(crate) fn expect_same(&self, folder: &Path) -> Result<()> {
        self.expect_same_but(folder, &[])
    }

    /// The same with files set aside.
    ///
    /// # Errors
    /// As [`Job::expect_same`].
    pub(crate) fn expect_same_but(&self, folder: &Path, aside: &[&str]) -> Result<()> {
        let mut differences = self.contents.without(aside).differences(&Contents::read(folder)?.without(aside));
        let beside = folder.parent().map(fs::read_dir).transpose()?.into_iter().flatten();
        for entry in beside {
            let name = entry?.file_name();
            if Some(name.as_os_str()) != folder.file_name() && name != "lost+found" {
                differences.push(format!("{} is left over beside it", name.display()));
            }
        }
        if differences.is_empty() {
            return Ok(());
        }
        bail!("after the end not as undisturbed: {}", differences.join(", "))
    }
}

/// Finished stages of a run, in order, with the seconds that each took; none before there is a run.
///
/// # Errors
/// When `run.json` is damaged.
pub(crate) fn finished(run: &Path) -> Result<Vec<(Stage, f64)>> {
    let path = run.join("run.json");
    let Ok(bytes) = fs::read(&path) else { return Ok(Vec::new()) };
    let value: Value = serde_json::from_slice(&bytes).with_context(|| format!("{} is damaged", path.display()))?;
    let seconds = |stage: Stage| value.get("finished")?.get(stage.name())?.as_f64();
    Ok(Stage::ALL.into_iter().filter_map(|stage| Some((stage, seconds(stage)?))).collect())
}

/// Stages of `before` that are not in `after` with the same seconds, up to what decimal digits lose.
fn done_again(before: &[(Stage, f64)], after: &[(Stage, f64)]) -> Vec<&'static str> {
    let same = |a: &(Stage, f64), b: &(Stage, f64)| a.0 == b.0 && (a.1 - b.1).abs() <= 1e-9 * a.1.abs();
    before.iter().filter(|a| !after.iter().any(|b| same(a, b))).map(|(stage, _)| stage.name()).collect()
}

fn arguments(kind: Kind, inputs: &Path, folder: &Path) -> Vec<String> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let out = ["--out".to_owned(), text(folder)];
    let command = match kind {
        Kind::Simulate => {
            return ["simulate", "ring", "--seed", "1"].map(str::to_owned).into_iter().chain(out).collect();
        }
        Kind::Pipeline => "pipeline",
        Kind::Compare => "compare",
    };
    let mut words = vec![command.to_owned(), "--resume".to_owned()];
    words.extend(["--config".to_owned(), text(&project::root().join("configs/smoke.toml"))]);
    words.extend(["--data-dir".to_owned(), text(&inputs.join("data"))]);
    words.extend(SETTINGS.iter().flat_map(|setting| ["--set".to_owned(), (*setting).to_owned()]));
    if kind == Kind::Compare {
        words.extend(["--recipes".to_owned(), text(&inputs.join("recipes.toml"))]);
        words.extend(["--workers".to_owned(), "2".to_owned()]);
    }
    words.extend(out);
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_that_is_gone_or_took_another_time_was_done_again() {
        let before = [(Stage::Ingest, 0.1), (Stage::Modes, 0.2)];
        let after = [(Stage::Ingest, 0.1 + 1e-16), (Stage::Modes, 0.2), (Stage::Goal, 0.3)];
        assert!(done_again(&before, &after).is_empty() && done_again(&[], &after).is_empty());
        assert_eq!(done_again(&before, &[(Stage::Ingest, 0.1), (Stage::Modes, 0.21)]), ["modes"]);
        assert_eq!(done_again(&before, &[]), ["ingest", "modes"]);
    }
}
