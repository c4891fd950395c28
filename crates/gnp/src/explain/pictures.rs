//! The figures of an explained forecast.

use std::collections::BTreeSet;

use gnp_data::{Observation, TrackState, Window};
use gnp_plot::{Figure, Mark, Scene, Source, VehicleBox, WhatIf, contributions, what_if};

use super::Explained;
use crate::error::Result;
use crate::what_if::{Change, ChangedMoment, ExplainedForecast, Moment};

/// `contributions`, of a vehicle that is added in the changed scene, and with changes of others' scenes `what-if`; with what
/// happened where there is a window.
pub(crate) fn pictures(
    explained: &Explained,
    window: Option<&Window<'_>>,
    (moment, changed): (&Moment, &ChangedMoment),
    changes: &[Change],
    source: &Source,
) -> Result<Vec<Figure>> {
    let key = &explained.key;
    let what = format!("{}, vehicle {}, frame {}", key.recording, explained.name(), key.t0);
    let title = "What moves a vehicle from constant velocity to its predicted path";
    let causes = |what: &str, of: &ExplainedForecast| contributions("contributions", title, what, &of.account, source);
    let Some(as_it_is) = &explained.as_it_is else {
        let what = format!("{what}, {}", explained.changes);
        return Ok(explained.changed.iter().map(|changed| causes(&what, changed)).collect());
    };
    let mut figures = vec![causes(&what, as_it_is)];
    let (Some(after), Some(change)) = (&explained.changed, explained.change()) else { return Ok(figures) };
    let before = moment.scene().observation(key.vehicle)?;
    let forecast = as_it_is.forecast.clone();
    let before_it = match window {
        Some(window) => Scene::of(window, forecast, what.clone()),
        None => Scene::seen(&before, forecast, what.clone()),
    };
    // What happened did not happen in the changed scene.
    let seen = changed.now().scene().observation(key.vehicle)?;
    let after_it = Scene::seen(&seen, after.forecast.clone(), what);
    let marks = marks(&before, &seen, changed, changes);
    let (from, to) = (before.origin(), seen.origin());
    let both = WhatIf {
        what: &explained.changes,
        before: &before_it,
        after: &after_it,
        shift: [from[0] - to[0], from[1] - to[1]],
        marks: &marks,
        change: &change,
    };
    figures.push(what_if("what-if", "What if: the forecast of a changed scene", &both, source));
    Ok(figures)
}

/// Whom the vehicle follows, and those that are changed: where they are in both scenes, by the vehicle in each.
fn marks(before: &Observation<'_>, after: &Observation<'_>, changed: &ChangedMoment, changes: &[Change]) -> Vec<Mark> {
    let boxes = |seen: &Observation<'_>| {
        let others = seen.others().map(|other| (other.vehicle(), other.now(), other.size()));
        // A leader without rows of its own is none of the others.
        let named = seen.column().filter(|it| it.recorded().is_none()).map(|it| (it.vehicle(), it.now(), it.size()));
        let own = (seen.vehicle(), TrackState::default(), seen.size());
        let boxed = others
            .chain(named)
            .chain([own])
            .map(|(number, now, size)| (number, VehicleBox { centre: [now.x, now.y], size }));
        boxed.collect::<Vec<_>>()
    };
    let (was, is) = (boxes(before), boxes(after));
    let at = |all: &[(u32, VehicleBox)], number: u32| all.iter().find(|(it, _)| *it == number).map(|(_, at)| *at);
    let edits =
        changes.iter().filter_map(|change| if let Change::Scene(edit) = change { Some(edit.vehicle()) } else { None });
    let leader = before.leader().map(|leader| leader.vehicle());
    let spoken_of: BTreeSet<u32> = edits.chain(leader).collect();
    let mark = |number: u32| {
        let (before, after) = (at(&was, number), at(&is, number));
        (before.is_some() || after.is_some()).then(|| Mark { label: changed.name(number), before, after })
    };
    spoken_of.into_iter().filter_map(mark).collect()
}
