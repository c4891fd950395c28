//! Scenes for SUMO, and its courses, in a folder.
use crate::error::{Context as _, Result};
use crate::machine::Machine;
use crate::run::folder::write;
use gnp_simulation::replay::{Imported, Replay, RuleDrivers, export_sumo, import_sumo};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// What SUMO takes for the speed limit, m/s: 65 miles an hour.
const SPEED_LIMIT: f64 = 29.06;
/// Roll-outs of its drivers, who draw how far they keep to the limit.
const SEEDS: u64 = 8;

/// Writes every scene, once for SUMO's own drivers and once with those of other vehicles, and reads the courses that are there;
/// without those of all scenes, a note says how to make them.
///
/// # Errors
/// When a file cannot be written, or courses cannot be read.
pub(super) fn exchange(
    folder: &Path,
    replays: &[Replay],
    drivers: &RuleDrivers,
    machine: &Machine,
) -> Result<Vec<Imported>> {
    let seeds: Vec<u64> = (1..=SEEDS).collect();
    let kinds = [("SUMO, its IDM", "own", None), ("SUMO, IDM, medians of other drivers", "medians", Some(drivers))];
    let mut found = Vec::new();
    for (name, part, drivers) in kinds {
        let folder = folder.join(part);
        fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let mut courses = BTreeMap::new();
        let mut missing = 0;
        for replay in replays {
            let scene = replay.scene();
            let file = |ending: &str| folder.join(format!("{}.{ending}", scene.name.replace([':', '/'], "_")));
            let seeds = if drivers.is_none() { &seeds[..] } else { &seeds[..1] };
            let text = serde_json::to_string(&export_sumo(scene, drivers, seeds, SPEED_LIMIT)?)?;
            let written = file("json");
            write(&written, text.as_bytes())?;
            let positions = file("csv");
            if !positions.is_file() {
                missing += 1;
                continue;
            }
            let text =
                fs::read_to_string(&positions).with_context(|| format!("cannot read {}", positions.display()))?;
            let read = import_sumo(scene, &text).with_context(|| format!("cannot use {}", positions.display()))?;
            courses.insert(scene.name.clone(), read);
        }
        if missing == 0 {
            found.push(Imported { name: name.to_owned(), uses_future: false, courses });
        } else {
            machine.progress.note(&format!(
                "no courses of SUMO for {missing} of {} scenes: for each FILE.json in {} run\n\
                 python xtask/peer/sumo_replay.py FILE.json --out FILE.csv --keep-offset",
                replays.len(),
                folder.display()
            ));
        }
    }
    Ok(found)
}
