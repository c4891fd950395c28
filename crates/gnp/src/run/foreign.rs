//! What a folder is that is no run.

use std::path::Path;

use crate::run::folder::{REMEDY, STATE};

/// What a folder is that is no run, and what to do.
pub(super) fn foreign(root: &Path) -> String {
    let dir = root.display();
    if !root.is_dir() {
        let is = if root.exists() { "is no folder" } else { "is not there" };
        return format!(
            "{dir} {is}: there is no run to go on with; start one with `gnp pipeline --dataset NAME --out {dir}`"
        );
    }
    let has = |name: &str| root.join(name).exists();
    let start = "start one with `gnp ingest --dataset NAME --out DIR`, a new folder";
    if has("table.toml") {
        format!("{dir} is not a run folder but that of a table; go on with it by `gnp compare --resume --out {dir}`")
    } else if has("variants") || has("gnp") {
        format!("{dir} is not a run folder but that of a table; its runs are below it, such as {dir}/gnp")
    } else if has("eval.json") {
        format!("{dir} is not a run folder: it has the scores of one on other recordings; {start}")
    } else if has("scene.toml") || has("tracks.parquet") {
        format!("{dir} is not a run folder: it has simulated traffic; {start}")
    } else if has("config.toml") && has("ingest.json") {
        format!("{dir} has the files of a run, but its {STATE} is missing; {REMEDY}")
    } else {
        format!("{dir} is not a run folder, it has no {STATE}; {start}")
    }
}
