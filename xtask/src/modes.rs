//! The split, and the intention modes of its training part.

use std::collections::BTreeMap;

use anyhow::Result;
use gnp_data::{Part, Split, SplitKind, WindowSet, overlaps};
use gnp_model::Seen;
use gnp_modes::fit;

use crate::session::{Session, features};
use crate::stop;

/// Parts the windows, finds the modes, writes `split.json` and `modes.safetensors`; returns the
/// split's hash.
///
/// # Errors
/// When a part would be left without windows, or there are fewer different futures than modes.
pub(crate) fn run(session: &Session) -> Result<String> {
    let set = session.windows()?;
    let overlaps = overlaps(set.recordings());
    let split = Split::new(&set, &session.config.split, &overlaps)?;
    split.save(&set, &session.folder.path("split.json"))?;
    let terminal = session.terminal();
    terminal.note(&summary(&set, &split));
    for overlap in &overlaps {
        terminal.note(&format!(
            "split: {} and {} show {} of the same vehicles",
            overlap.first, overlap.second, overlap.vehicles
        ));
    }
    if split.leaks() {
        terminal
            .note("split: it leaks, the same vehicle at the same time stands in several parts; scores are too good");
    }
    stop::check()?;
    let features = features(&session.config, &set, &split)?;
    let mut futures = Vec::with_capacity(split.train().len() * 2 * set.shape().predicted);
    for window in split.train().iter().filter_map(|id| set.get(*id)) {
        futures.extend(features.future(&Seen::recorded(window.observation()), &window));
    }
    let modes = fit(&futures, set.shape().predicted, features.mode_frame(), &session.config.modes)?;
    modes.save(&session.folder.path("modes.safetensors"))?;
    let (most, least) = (modes.sizes.first().copied().unwrap_or(0), modes.sizes.last().copied().unwrap_or(0));
    let windows = split.train().len();
    let rms = (modes.inertia / (windows * set.shape().predicted).max(1) as f64).sqrt();
    terminal.note(&format!(
        "modes: {} of {windows} futures, {least} to {most} in each, {rms:.2} m root mean square to the nearest{}",
        modes.len(),
        if modes.converged { "" } else { "; not converged, more modes.max_iterations would improve them" }
    ));
    Ok(split.hash().to_owned())
}

fn summary(set: &WindowSet<'_>, split: &Split) -> String {
    let counts: Vec<String> =
        Part::ALL.iter().map(|part| format!("{} {}", split.part(*part).len(), part.name())).collect();
    let straddling: usize = split.straddling().values().sum();
    let left_out = if straddling > 0 { format!(", {straddling} in none") } else { String::new() };
    format!("split: {} windows by {}: {}{left_out}", set.len(), kinds(split.kinds()), counts.join(", "))
}

/// How windows were parted, in words: `recording`, or `i-80 vehicle, us-101 recording`.
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
