//! The split, and the intention modes of its training part.

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::Result;
use gnp_data::{Recording, Split, SplitKind, Subset, WindowSet, overlaps};
use gnp_model::{AugmentedView, ReferencePath};
use gnp_modes::{Modes, fit};

use crate::config::RunConfig;
use crate::evaluation::rules;
use crate::machine::Machine;
use crate::run::folder::Stage;
use crate::run::{Run, origin};

/// File of the split in a run folder.
pub(super) const SPLIT: &str = "split.json";

/// Parts the windows of all recordings, writes `split.json` to `folder`; returns the split's hash.
///
/// # Errors
/// When a part would be left without windows, or the same vehicle would stand in two.
pub(super) fn split(recordings: &[Recording], config: &RunConfig, folder: &Path, machine: &Machine) -> Result<String> {
    let (set, _) = WindowSet::cut(recordings, &config.windows)?;
    let overlaps = overlaps(recordings);
    let split = Split::new(&set, &config.split, &overlaps)?;
    split.save(&set, &folder.join(SPLIT))?;
    machine.progress.note(&summary(&set, &split));
    for overlap in &overlaps {
        machine.progress.note(&format!("split: {overlap}"));
    }
    if split.leaks() {
        machine.progress.note("split: it leaks, the same vehicle stands in several parts; scores are too good");
    }
    Ok(split.hash().to_owned())
}

/// Finds the modes of the training part, or takes those of the run that this one starts from, and writes
/// `modes.safetensors`; parts the windows first unless they are.
///
/// # Errors
/// Those of [`split`]; when there are fewer different futures than modes.
pub(super) fn find(run: &mut Run) -> Result<()> {
    if run.folder.state.split_hash.is_empty() {
        let hash = split(run.recordings()?, &run.config, run.folder.root(), &run.machine)?;
        run.folder.state.split_hash = hash;
        run.folder.record(Stage::Ingest, [SPLIT.to_owned()])?;
        run.folder.write()?;
    }
    if run.config.features.reference == ReferencePath::Platoon {
        rules::keep(run)?;
    }
    run.machine.stop.check()?;
    let place = run.folder.path("modes.safetensors");
    if let Some(taken) = origin::file(&run.folder, Stage::Modes) {
        let modes = Modes::load(&taken)?;
        modes.save(&place)?;
        run.note(&format!("modes: {} of the run that this one starts from", modes.len()));
        return Ok(());
    }
    let set = run.windows()?;
    let (split, features) = run.features(&set)?;
    let mut futures = Vec::with_capacity(split.train().len() * 2 * set.shape().t_pred);
    for window in split.train().iter().filter_map(|id| set.get(*id)) {
        let mut add = |seen| -> Result<()> {
            futures.extend(features.future(&features.situation(seen)?, &window));
            Ok(())
        };
        add(AugmentedView::recorded(window.observation()))?;
        // A network that learns from mirrored windows needs modes for them, too.
        if run.config.goal.loss.mirror > 0. {
            add(AugmentedView::mirrored(window.observation()))?;
        }
    }
    let modes = fit(&futures, set.shape().t_pred, features.mode_frame(), &run.config.modes)?;
    modes.save(&place)?;
    let (most, least) = (modes.sizes.first().copied().unwrap_or(0), modes.sizes.last().copied().unwrap_or(0));
    let windows = futures.len() / (2 * set.shape().t_pred).max(1);
    let rms = (modes.inertia / (windows * set.shape().t_pred).max(1) as f64).sqrt();
    run.note(&format!(
        "modes: {} of {windows} futures, {least} to {most} in each, {rms:.2} m root mean square to the nearest{}",
        modes.len(),
        if modes.converged { "" } else { "; not converged, more modes.max_iterations would improve them" }
    ));
    Ok(())
}

fn summary(set: &WindowSet<'_>, split: &Split) -> String {
    let counts: Vec<String> =
        Subset::ALL.iter().map(|part| format!("{} {}", split.subset(*part).len(), part.name())).collect();
    let count = |dropped: &BTreeMap<String, usize>| dropped.values().sum::<usize>();
    let left_out = [
        (count(split.dropped_at_boundary()), "in none"),
        (count(split.dropped_drivers()), "in none since their drivers are kept with other recordings"),
    ];
    let left_out: String = left_out.iter().filter(|(n, _)| *n > 0).map(|(n, why)| format!(", {n} {why}")).collect();
    format!("split: {} windows by {}: {}{left_out}", set.len(), kinds(split.kinds()), counts.join(", "))
}

/// How windows were parted: `recording`, or `i-80 vehicle, us-101 recording`.
pub(crate) fn kinds(kinds: &BTreeMap<String, SplitKind>) -> String {
    let mut different: Vec<&str> = kinds.values().map(|kind| kind.name()).collect();
    different.sort_unstable();
    different.dedup();
    match different[..] {
        [one] => one.to_owned(),
        _ => kinds.iter().map(|(site, kind)| format!("{site} {}", kind.name())).collect::<Vec<_>>().join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_named_once_or_by_site() {
        let by = |i80| BTreeMap::from([("i-80".to_owned(), i80), ("us-101".to_owned(), SplitKind::Recording)]);
        assert_eq!(kinds(&by(SplitKind::Recording)), "recording");
        assert_eq!(kinds(&by(SplitKind::Vehicle)), "i-80 vehicle, us-101 recording");
    }
}
