//! Makes good what is damaged in a run folder, as far as it can be; called by who holds the folder's lock.

use gnp_model::Checkpoint;
use gnp_train::{History, Progress};

use crate::config::RunConfig;
use crate::data::ingest::IngestSummary;
use crate::error::Result;
use crate::machine::Machine;
use crate::run::Run;
use crate::run::folder::{RunFolder, Stage, write};
use crate::run::manifest::{Consequence, Damage, Need, TABLES};

/// Says what is damaged in a run and what becomes of it: files are written anew from others, stages are forgotten, so that
/// they are done again.
///
/// # Errors
/// When a file is damaged that cannot be made again, or the folder cannot be written.
pub(super) fn mend(folder: &mut RunFolder, machine: &Machine) -> Result<()> {
    let damage = folder.damage();
    if damage.is_empty() {
        return Ok(());
    }
    Damage::check(&damage, folder.root())?;
    let (mut again, mut becomes) = (Vec::new(), Vec::new());
    for one in &damage {
        becomes.push(match one.consequence() {
            Consequence::Unneeded(why) => {
                folder.state.files.remove(&one.name);
                why.to_owned()
            }
            Consequence::Rewritten if rewritten(folder, one, &damage, machine)? => "written again".to_owned(),
            _ => {
                again.push(one.stage);
                format!("{} and what was made from it are made again", one.stage.name())
            }
        });
    }
    Damage::grouped(damage.iter().zip(becomes)).iter().for_each(|told| machine.progress.note(told));
    folder.forget(&again)
}

/// Writes a file anew that says what another one says; `false` where that one is damaged, too.
fn rewritten(folder: &mut RunFolder, one: &Damage, all: &[Damage], machine: &Machine) -> Result<bool> {
    if one.stage == Stage::Ingest {
        let report: IngestSummary = folder.read_json("ingest.json")?;
        write(&folder.path(&one.name), report.text().as_bytes())?;
    } else if one.stage == Stage::Evaluate {
        if all.iter().any(|other| other.stage != Stage::Report && Need::All.is_blocked_by(other)) {
            return Ok(false);
        }
        let config = RunConfig::read(&folder.path("config.toml"), &[])?;
        Run::new(RunFolder::open(folder.root())?, &config, machine).rewrite_tables()?;
        folder.record(Stage::Evaluate, TABLES.map(str::to_owned))?;
        return Ok(true);
    } else {
        let last = format!("{}.last.safetensors", one.stage.name());
        if all.iter().any(|other| other.name == last) {
            return Ok(false);
        }
        let Ok(Checkpoint { header, .. }) = Checkpoint::load(&folder.path(&last)) else { return Ok(false) };
        let progress = header.trainer.and_then(|text| serde_json::from_str::<Progress>(&text).ok());
        let Some(Progress { stage, history, .. }) = progress else { return Ok(false) };
        History { stage, epochs: history }.save(&folder.path(&one.name))?;
    }
    folder.record(one.stage, [one.name.clone()])?;
    Ok(true)
}
