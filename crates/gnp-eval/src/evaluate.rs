//! The driver: asks models for forecasts batch by batch and gathers what each window adds.

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{Forecast, Observation, OraclePredictor, Predictor, Subset, Window, WindowId, WindowSet};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bootstrap::Bootstrap;
use crate::case::{Reference, ScoredWindow};
use crate::clusters::Clusters;
use crate::error::EvalError;
use crate::evaluation::{Evaluation, Gathered, Setting, Sheet};
use crate::manoeuvre::Manoeuvre;
use crate::metric::Metric;
use crate::protocol::Protocol;
use crate::spreads::Spreads;
use crate::sums::{Gatherer, VehicleId};

/// How to evaluate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvalConfig {
    /// Subset of the split whose windows are scored: the test part, or the validation part as long as
    /// settings are being compared. [`evaluate`] takes the windows it is given.
    pub subset: Subset,
    /// Protocols to score under.
    pub protocols: Vec<Protocol>,
    /// Windows handed to a model at a time, at least; a batch ends with the vehicles of an instant
    /// complete, so that models that predict a scene together see it whole.
    pub batch: usize,
    /// Resampling for the intervals.
    pub bootstrap: Bootstrap,
}

impl EvalConfig {
    /// Every number but those of the bootstrap: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 1] = [("batch", 1., 65_536., "windows")];

    /// Refuses values that cannot be used.
    ///
    /// # Errors
    /// Names the key and what to write.
    pub fn check(&self) -> Result<(), EvalError> {
        let bad = |key, problem: &str| Err(EvalError::Config { key, problem: problem.to_owned() });
        let [(key, least, most, unit)] = Self::RANGES;
        if !(least..=most).contains(&(self.batch as f64)) {
            let problem = format!("is {}; give a number from {least} to {most} {unit}, such as 256", self.batch);
            return bad(key, &problem);
        }
        if self.protocols.is_empty() {
            return bad("protocols", "is empty; write some of paper, literature, clean, av2, nuscenes, waymo");
        }
        if self.protocols.iter().collect::<BTreeSet<_>>().len() < self.protocols.len() {
            return bad("protocols", "names a protocol twice; write each once");
        }
        self.bootstrap.check()
    }
}

/// A model to score.
#[derive(Clone, Copy)]
pub enum EvaluatedModel<'a> {
    /// Sees the past alone.
    Predictor(&'a dyn Predictor),
    /// Sees the past alone, and has densities: their spreads were fitted to other windows.
    WithSpreads(&'a dyn Predictor, &'a Spreads),
    /// Is handed recorded futures: refused under `clean`, marked everywhere else.
    Oracle(&'a dyn OraclePredictor),
}

impl EvaluatedModel<'_> {
    /// Name in tables.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Predictor(model) | Self::WithSpreads(model, _) => model.name(),
            Self::Oracle(model) => model.name(),
        }
    }

    /// Whether it is handed recorded futures.
    #[must_use]
    pub fn uses_future(&self) -> bool {
        matches!(self, Self::Oracle(_))
    }

    fn spreads(&self) -> Option<&Spreads> {
        match self {
            Self::WithSpreads(_, spreads) => Some(spreads),
            Self::Predictor(_) | Self::Oracle(_) => None,
        }
    }

    pub(crate) fn predict(&self, windows: &[Window<'_>], k: usize) -> Result<Vec<Forecast>, EvalError> {
        let Some(first) = windows.first() else { return Ok(Vec::new()) };
        let forecasts = match self {
            Self::Predictor(model) | Self::WithSpreads(model, _) => {
                let seen: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
                model.predict(&seen, k)
            }
            Self::Oracle(model) => model.predict_with_future(windows, k),
        };
        let forecasts = forecasts.map_err(|source| EvalError::Predict { first: first.key(), source })?;
        if forecasts.len() != windows.len() {
            let model = self.name().to_owned();
            return Err(EvalError::Count { model, windows: windows.len(), found: forecasts.len() });
        }
        Ok(forecasts)
    }
}

/// One answer of one model, as the watcher sees it: for a progress bar, or to write predictions.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Name of the model.
    pub model: &'a str,
    /// Futures it was asked for.
    pub asked: usize,
    /// The windows, by recording, instant and vehicle.
    pub windows: &'a [Window<'a>],
    /// One forecast a window.
    pub forecasts: &'a [Forecast],
    /// Forecasts made so far, this batch included, over all models and numbers of futures.
    pub done: usize,
    /// Forecasts to make.
    pub total: usize,
}

/// Scores every model on the windows `ids` of `set` under every protocol of `config`.
///
/// Models are asked one after the other, windows ordered by recording, instant and vehicle. What a
/// window adds is kept as sums by vehicle: memory does not grow with the number of windows. Which
/// vehicles are one driver, and which recordings one event, is a matter of all recordings of `set`:
/// evaluations on parts of it agree, and may be [pooled](Evaluation::pooled). Densities are scored
/// of models that come with [`Spreads`]. `watch` sees every answer; an error from it, such as [`EvalError::Stopped`],
/// ends the evaluation.
///
/// # Errors
/// When the configuration cannot be used, there is no window, two models share a name, an informed
/// model meets a protocol that allows no future input, a model fails or gives a forecast that
/// cannot be scored (the window is named), or `watch` says so.
pub fn evaluate(
    set: &WindowSet<'_>,
    ids: &[WindowId],
    models: &[EvaluatedModel<'_>],
    config: &EvalConfig,
    watch: &mut dyn FnMut(&Batch<'_>) -> Result<(), EvalError>,
) -> Result<Evaluation, EvalError> {
    config.check()?;
    admit(models, &config.protocols)?;
    let ids = in_order(set, ids)?;
    let setting = setting(set, &ids)?;
    let metrics: BTreeMap<Protocol, Vec<Metric>> =
        config.protocols.iter().map(|p| Ok((*p, p.metrics(&set.shape())?))).collect::<Result<_, EvalError>>()?;
    let asks: BTreeSet<usize> = metrics.keys().flat_map(|protocol| protocol.asks().iter().copied()).collect();
    let total = ids.len() * asks.len() * models.len();
    let clusters = Clusters::of(set);
    let mut done = 0;
    let mut sheets = Vec::new();
    for model in models {
        let mut gathered: Vec<Gathered<'_>> = vec![Gathered::default(); metrics.len()];
        for batch in batches(set, &ids, config.batch) {
            let windows: Vec<Window<'_>> = batch.iter().filter_map(|id| set.get(*id)).collect();
            let mut answers = BTreeMap::new();
            for asked in &asks {
                let forecasts = model.predict(&windows, *asked)?;
                done += windows.len();
                let (model, windows) = (model.name(), &windows[..]);
                watch(&Batch { model, asked: *asked, windows, forecasts: &forecasts, done, total })?;
                answers.insert(*asked, forecasts);
            }
            let contributions: Vec<Vec<Vec<Option<f64>>>> = (0..windows.len())
                .into_par_iter()
                .map(|i| contributions(model, &windows[i], i, &answers, &metrics))
                .collect::<Result<_, _>>()?;
            for ((id, window), by_protocol) in batch.iter().zip(&windows).zip(&contributions) {
                let Some(recording) = set.recording(*id) else { continue };
                let (seen, manoeuvres) = (window.observation(), Manoeuvre::of(window));
                let vehicle = recording.tracks()[id.track as usize].vehicle;
                let vehicle = VehicleId { recording: recording.meta().name.clone(), vehicle };
                let cluster = clusters.get(&vehicle);
                for ((protocol, gathered), row) in metrics.keys().zip(&mut gathered).zip(by_protocol) {
                    let new = || Gatherer::new(row.len());
                    gathered.sites.entry(seen.site()).or_insert_with(new).add(&vehicle, &cluster, row);
                    for manoeuvre in manoeuvres.iter().filter(|_| protocol.by_manoeuvre()) {
                        gathered.manoeuvres.entry(*manoeuvre).or_insert_with(new).add(&vehicle, &cluster, row);
                    }
                }
            }
        }
        for (protocol, gathered) in metrics.keys().zip(gathered) {
            sheets.push(Sheet::new((model.name(), model.uses_future()), *protocol, gathered));
        }
    }
    Ok(Evaluation { setting, metrics, sheets })
}

fn admit(models: &[EvaluatedModel<'_>], protocols: &[Protocol]) -> Result<(), EvalError> {
    let mut names = BTreeSet::new();
    for model in models {
        let name = model.name().to_owned();
        let refusing = protocols.iter().find(|protocol| model.uses_future() && !protocol.allows_future());
        if let Some(protocol) = refusing {
            return Err(EvalError::FutureInput { model: name, protocol: protocol.name() });
        }
        if !names.insert(name.clone()) {
            return Err(EvalError::SameName { model: name });
        }
    }
    Ok(())
}

/// The windows by recording, instant and vehicle.
pub(crate) fn in_order(set: &WindowSet<'_>, ids: &[WindowId]) -> Result<Vec<WindowId>, EvalError> {
    let mut keyed = Vec::with_capacity(ids.len());
    for id in ids {
        let window = set.get(*id).ok_or(EvalError::UnknownWindow { id: *id })?;
        keyed.push(((id.recording, window.observation().frame(), id.track), *id));
    }
    keyed.sort_unstable();
    Ok(keyed.into_iter().map(|(_, id)| id).collect())
}

fn setting(set: &WindowSet<'_>, ids: &[WindowId]) -> Result<Setting, EvalError> {
    let recordings: BTreeSet<u32> = ids.iter().map(|id| id.recording).collect();
    let mut metas = recordings.iter().filter_map(|index| set.recordings().get(*index as usize)).map(|r| r.meta());
    let first = metas.next().ok_or(EvalError::NoWindows)?;
    Ok(Setting {
        dataset: first.dataset,
        simulated: first.simulated || metas.any(|meta| meta.simulated),
        rate_hz: set.shape().rate_hz,
        windows: ids.len(),
    })
}

/// Runs of at least `size` windows that end where an instant ends.
pub(crate) fn batches<'a>(
    set: &'a WindowSet<'_>,
    ids: &'a [WindowId],
    size: usize,
) -> impl Iterator<Item = &'a [WindowId]> {
    let instant = |id: &WindowId| (id.recording, set.get(*id).map(|window| window.observation().frame()));
    let mut rest = ids;
    std::iter::from_fn(move || {
        let mut end = size.min(rest.len());
        while 0 < end && end < rest.len() && instant(&rest[end - 1]) == instant(&rest[end]) {
            end += 1;
        }
        let (batch, after) = rest.split_at(end);
        rest = after;
        (!batch.is_empty()).then_some(batch)
    })
}

/// What window number `i` of a batch adds to every metric of every protocol.
fn contributions(
    model: &EvaluatedModel<'_>,
    window: &Window<'_>,
    i: usize,
    answers: &BTreeMap<usize, Vec<Forecast>>,
    metrics: &BTreeMap<Protocol, Vec<Metric>>,
) -> Result<Vec<Vec<Option<f64>>>, EvalError> {
    let reference = Reference::of(window);
    let spreads = model.spreads().map_or(&[][..], |spreads| spreads.of(window.observation().site()));
    let mut cases = BTreeMap::new();
    for (asked, forecasts) in answers {
        let case = ScoredWindow::new(&reference, &forecasts[i], *asked).map_err(|problem| EvalError::Forecast {
            model: model.name().to_owned(),
            window: window.key(),
            problem,
        })?;
        cases.insert(*asked, case.with_spreads(spreads));
    }
    let of_protocol = |(protocol, metrics): (&Protocol, &Vec<Metric>)| {
        let of_metric = |metric: &Metric| metric.contribution(&cases[&protocol.asks()[protocol.answer_for(metric)]]);
        metrics.iter().map(of_metric).collect()
    };
    metrics.iter().map(of_protocol).collect()
}
