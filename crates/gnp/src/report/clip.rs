//! The clip of a run: the busiest minute of the longest recording, with a forecast of every vehicle each second.

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{Split, WindowSet};
use gnp_plot::{Clip, ClipSpan, Evaluated};

use crate::error::Result;
use crate::figures::forecasts;
use crate::figures::traffic::{SHOWN_S, busiest_of};
use crate::run::Run;

/// The clip of a run; `None` without evaluated windows or without lanes.
///
/// # Errors
/// When the recordings or the model cannot be used, or the work is stopped.
pub(crate) fn clip(run: &Run, set: &WindowSet<'_>, split: &Split) -> Result<Option<Clip>> {
    let recordings = run.recordings()?;
    let subset = run.config.evaluate.subset;
    let mut tracks: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    for id in split.subset(subset) {
        tracks.entry(id.recording as usize).or_default().insert(id.track as usize);
    }
    let Some((index, lane)) = busiest_of(recordings, |i| tracks.contains_key(&i)) else { return Ok(None) };
    let span = ClipSpan { road: lane.road, first_frame: lane.first_frame, seconds: SHOWN_S };
    let evaluated = Evaluated { subset: subset.name(), tracks: &tracks[&index] };
    let gnp = run.model()?.explaining(true);
    let clip = Clip::cut(&recordings[index], set.shape(), span, evaluated, |seen| {
        forecasts(run, &gnp, seen, "player", |forecast| {
            // The other futures' forces are shown nowhere, and are most of what would be kept.
            forecast.modes.iter_mut().skip(1).for_each(|mode| mode.explanation = None);
        })
    });
    clip.map(Some)
}
