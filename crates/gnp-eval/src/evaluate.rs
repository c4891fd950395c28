//! The driver: asks models for forecasts batch by batch and gathers what each window adds.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{Dataset, Forecast, Observation, OraclePredictor, Predictor, Subset, Window, WindowId, WindowSet};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bootstrap::{Bootstrap, Difference};
use crate::case::{Reference, ScoredWindow};
use crate::error::EvalError;
use crate::manoeuvre::Manoeuvre;
use crate::metric::Metric;
use crate::protocol::Protocol;
use crate::score::{ALL_SITES, Score};
use crate::sums::{Gatherer, Members, MetricSums};

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
    /// Refuses values that cannot be used.
    ///
    /// # Errors
    /// Names the key and what to write.
    pub fn check(&self) -> Result<(), EvalError> {
        let bad = |key, problem: &str| Err(EvalError::Config { key, problem: problem.to_owned() });
        if self.batch == 0 {
            return bad("batch", "is 0; write a number of windows, such as 256");
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
    /// Is handed recorded futures: refused under `clean`, marked everywhere else.
    Oracle(&'a dyn OraclePredictor),
}

impl EvaluatedModel<'_> {
    /// Name in tables.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Predictor(model) => model.name(),
            Self::Oracle(model) => model.name(),
        }
    }

    /// Whether it is handed recorded futures.
    #[must_use]
    pub fn uses_future(&self) -> bool {
        matches!(self, Self::Oracle(_))
    }

    fn predict(&self, windows: &[Window<'_>], k: usize) -> Result<Vec<Forecast>, EvalError> {
        let Some(first) = windows.first() else { return Ok(Vec::new()) };
        let forecasts = match self {
            Self::Predictor(model) => {
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

/// What the scored windows have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The data family.
    pub dataset: Dataset,
    /// Whether any recording that was scored is simulated.
    pub simulated: bool,
    /// Rate of the windows' frames, Hz.
    pub rate_hz: f64,
    /// Windows scored.
    pub windows: usize,
}

/// Sums of every metric by model, protocol, site and vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    setting: Setting,
    pub(crate) metrics: BTreeMap<Protocol, Vec<Metric>>,
    pub(crate) sheets: Vec<Sheet>,
}

/// One model under one protocol.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sheet {
    pub(crate) model: String,
    pub(crate) protocol: Protocol,
    pub(crate) uses_future: bool,
    /// By site, [`ALL_SITES`] among them.
    pub(crate) sums: BTreeMap<String, Members>,
    /// Of all sites by manoeuvre; empty where the protocol has none.
    manoeuvres: BTreeMap<Manoeuvre, Members>,
}

/// Scores every model on the windows `ids` of `set` under every protocol of `config`.
///
/// Models are asked one after the other, windows ordered by recording, instant and vehicle. What a
/// window adds is kept as sums by vehicle: memory does not grow with the number of windows. `watch`
/// sees every answer; an error from it, such as [`EvalError::Stopped`], ends the evaluation.
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
                .map(|i| contributions(model.name(), &windows[i], i, &answers, &metrics))
                .collect::<Result<_, _>>()?;
            for ((id, window), by_protocol) in batch.iter().zip(&windows).zip(&contributions) {
                let Some(recording) = set.recording(*id) else { continue };
                let vehicle = recording.tracks()[id.track as usize].vehicle;
                let (seen, manoeuvres) = (window.observation(), Manoeuvre::of(window));
                for ((protocol, gathered), row) in metrics.keys().zip(&mut gathered).zip(by_protocol) {
                    let new = || Gatherer::new(row.len());
                    let site = gathered.sites.entry(seen.site()).or_insert_with(new);
                    site.add(seen.recording_name(), vehicle, row);
                    for manoeuvre in manoeuvres.iter().filter(|_| protocol.by_manoeuvre()) {
                        let gatherer = gathered.manoeuvres.entry(*manoeuvre).or_insert_with(new);
                        gatherer.add(seen.recording_name(), vehicle, row);
                    }
                }
            }
        }
        for (protocol, gathered) in metrics.keys().zip(gathered) {
            sheets.push(Sheet::new(model, *protocol, gathered));
        }
    }
    Ok(Evaluation { setting, metrics, sheets })
}

/// What the windows so far add to the metrics of one protocol.
#[derive(Clone, Default)]
struct Gathered<'a> {
    sites: BTreeMap<&'a str, Gatherer>,
    manoeuvres: BTreeMap<Manoeuvre, Gatherer>,
}

impl Sheet {
    fn new(model: &EvaluatedModel<'_>, protocol: Protocol, gathered: Gathered<'_>) -> Self {
        let mut sums: BTreeMap<String, MetricSums> =
            gathered.sites.into_iter().map(|(site, gatherer)| (site.to_owned(), gatherer.finish())).collect();
        let all = MetricSums::concatenated(sums.values());
        sums.insert(ALL_SITES.to_owned(), all);
        let sums = sums.into_iter().map(|(site, sums)| (site, Members::one(sums))).collect();
        let finished = gathered.manoeuvres.into_iter().map(|(key, gatherer)| (key, Members::one(gatherer.finish())));
        let (model, uses_future) = (model.name().to_owned(), model.uses_future());
        Self { model, protocol, uses_future, sums, manoeuvres: finished.collect() }
    }

    /// Seeds of the model.
    pub(crate) fn seeds(&self) -> usize {
        self.sums.get(ALL_SITES).map_or(1, Members::seeds)
    }
}

impl Evaluation {
    /// This evaluation and another of other models on the same windows, as one: for models that may
    /// enter under some protocols only.
    ///
    /// # Errors
    /// When the windows differ, or a model was scored under a protocol in both.
    pub fn joined(mut self, other: Self) -> Result<Self, EvalError> {
        if self.setting != other.setting {
            return Err(EvalError::OtherWindows { first: self.setting.windows, second: other.setting.windows });
        }
        for sheet in other.sheets {
            if self.sheets.iter().any(|own| own.model == sheet.model && own.protocol == sheet.protocol) {
                return Err(EvalError::SameName { model: sheet.model });
            }
            self.sheets.push(sheet);
        }
        // The same shape of windows gives a protocol the same metrics.
        self.metrics.extend(other.metrics);
        Ok(self)
    }

    /// This evaluation and another of some of its models, trained with another seed, on the same
    /// windows: what a window adds to a metric of such a model is the mean over its seeds, and intervals
    /// draw seeds as well as vehicles.
    ///
    /// # Errors
    /// When the windows differ, or a model was not scored here under a protocol.
    pub fn with_seed(mut self, other: Self) -> Result<Self, EvalError> {
        let windows = EvalError::OtherWindows { first: self.setting.windows, second: other.setting.windows };
        if self.setting != other.setting {
            return Err(windows);
        }
        for more in other.sheets {
            let key = |sheet: &Sheet| (sheet.model == more.model) && sheet.protocol == more.protocol;
            let Some(own) = self.sheets.iter_mut().find(|sheet| key(sheet)) else {
                let scored: BTreeSet<&str> = self.sheets.iter().map(|sheet| sheet.model.as_str()).collect();
                let scored = scored.into_iter().collect::<Vec<_>>().join(", ");
                return Err(EvalError::NotScored { model: more.model, scored });
            };
            let sums = seeded(std::mem::take(&mut own.sums), more.sums);
            let manoeuvres = seeded(std::mem::take(&mut own.manoeuvres), more.manoeuvres);
            let (Some(sums), Some(manoeuvres)) = (sums, manoeuvres) else { return Err(windows) };
            (own.sums, own.manoeuvres) = (sums, manoeuvres);
        }
        Ok(self)
    }

    /// This evaluation and another of the same models on other windows, as one: the folds of a
    /// cross-validation, in which a model is trained anew for each.
    ///
    /// # Errors
    /// When models, their seeds, protocols, kind of data or rate differ.
    pub fn pooled(mut self, other: Self) -> Result<Self, EvalError> {
        let refuse = |what| EvalError::NotPooled { what };
        let (own, more) = (&mut self.setting, other.setting);
        if own.dataset != more.dataset || own.rate_hz != more.rate_hz {
            return Err(refuse("kind of data and rate"));
        }
        own.simulated |= more.simulated;
        own.windows += more.windows;
        if self.metrics != other.metrics {
            return Err(refuse("protocols"));
        }
        let key = |sheet: &Sheet| (sheet.model.clone(), sheet.protocol, sheet.uses_future, sheet.seeds());
        if self.sheets.iter().map(key).ne(other.sheets.iter().map(key)) {
            return Err(refuse("models or their seeds"));
        }
        for (own, more) in self.sheets.iter_mut().zip(other.sheets) {
            merge(&mut own.sums, more.sums);
            merge(&mut own.manoeuvres, more.manoeuvres);
        }
        Ok(self)
    }

    /// What the scored windows have in common.
    #[must_use]
    pub fn setting(&self) -> &Setting {
        &self.setting
    }

    /// Every metric with its interval, by model, protocol and site; [`ALL_SITES`] comes last, and
    /// under `clean` after it the manoeuvres of all sites. A metric that applies to no window of a
    /// site has no score there.
    #[must_use]
    pub fn scores(&self, bootstrap: &Bootstrap) -> Vec<Score> {
        let mut scores = Vec::new();
        for sheet in &self.sheets {
            let all = sheet.sums.get_key_value(ALL_SITES);
            for (site, sums) in sheet.sums.iter().filter(|(site, _)| *site != ALL_SITES).chain(all) {
                self.score_group(sheet, (site, None), sums, bootstrap, &mut scores);
            }
            for (manoeuvre, sums) in &sheet.manoeuvres {
                self.score_group(sheet, (ALL_SITES, Some(*manoeuvre)), sums, bootstrap, &mut scores);
            }
        }
        scores
    }

    fn score_group(
        &self,
        sheet: &Sheet,
        (site, manoeuvre): (&str, Option<Manoeuvre>),
        sums: &Members,
        bootstrap: &Bootstrap,
        scores: &mut Vec<Score>,
    ) {
        let Some(metrics) = self.metrics.get(&sheet.protocol) else { return };
        let kinds: Vec<_> = metrics.iter().map(|metric| metric.kind).collect();
        let intervals = bootstrap.intervals(sums, &kinds);
        for (index, (metric, interval)) in metrics.iter().zip(intervals).enumerate() {
            let Some(value) = sums.value(index, metric.kind) else { continue };
            let (windows, vehicles) = sums.counts(index);
            scores.push(Score {
                dataset: self.setting.dataset,
                site: site.to_owned(),
                manoeuvre,
                model: sheet.model.clone(),
                seeds: sums.seeds(),
                protocol: sheet.protocol,
                metric: metric.kind.name().to_owned(),
                k: metric.k,
                horizon_s: metric.horizon_s,
                value,
                ci_low: interval.map(|interval| interval.low),
                ci_high: interval.map(|interval| interval.high),
                windows,
                vehicles,
                simulated: self.setting.simulated,
                uses_future: sheet.uses_future,
            });
        }
    }

    /// How much `a` differs from `b` on a site, vehicles (and seeds) resampled for both together: is one
    /// better?
    ///
    /// # Errors
    /// When one of them, the metric or the site was not scored under the protocol, or the metric
    /// applies to different windows.
    pub fn difference(
        &self,
        protocol: Protocol,
        site: &str,
        (a, b): (&str, &str),
        metric: Metric,
        bootstrap: &Bootstrap,
    ) -> Result<Difference, EvalError> {
        let unpaired = |problem| EvalError::Unpaired {
            a: a.to_owned(),
            b: b.to_owned(),
            metric: metric.to_string(),
            site: site.to_owned(),
            problem,
        };
        let index = self.metrics.get(&protocol).and_then(|metrics| metrics.iter().position(|m| *m == metric));
        let index = index.ok_or_else(|| unpaired("the protocol was not scored or does not have this metric"))?;
        let sums = |model: &str| {
            let sheet = self.sheets.iter().find(|sheet| sheet.model == model && sheet.protocol == protocol)?;
            sheet.sums.get(site)
        };
        let (Some(sums_a), Some(sums_b)) = (sums(a), sums(b)) else {
            return Err(unpaired("one of the models or the site was not scored"));
        };
        if sums_a.vehicles() != sums_b.vehicles() || sums_a.windows(index).ne(sums_b.windows(index)) {
            return Err(unpaired("they were not scored on the same windows"));
        }
        bootstrap
            .difference(sums_a, sums_b, index, metric.kind)
            .ok_or_else(|| unpaired("the metric applies to no window there"))
    }
}

/// Sums with those of another seed; `None` where they are not of the same windows.
fn seeded<K: Ord>(own: BTreeMap<K, Members>, mut more: BTreeMap<K, Members>) -> Option<BTreeMap<K, Members>> {
    let all: Option<BTreeMap<K, Members>> = own
        .into_iter()
        .map(|(key, sums)| {
            let more = more.remove(&key)?;
            Some((key, sums.with(more)?))
        })
        .collect();
    all.filter(|_| more.is_empty())
}

fn merge<K: Ord>(own: &mut BTreeMap<K, Members>, more: BTreeMap<K, Members>) {
    for (key, sums) in more {
        match own.entry(key) {
            Entry::Vacant(place) => drop(place.insert(sums)),
            Entry::Occupied(mut place) => {
                let merged = place.get().merged(&sums);
                place.insert(merged);
            }
        }
    }
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
fn in_order(set: &WindowSet<'_>, ids: &[WindowId]) -> Result<Vec<WindowId>, EvalError> {
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
fn batches<'a>(set: &'a WindowSet<'_>, ids: &'a [WindowId], size: usize) -> impl Iterator<Item = &'a [WindowId]> {
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
    model: &str,
    window: &Window<'_>,
    i: usize,
    answers: &BTreeMap<usize, Vec<Forecast>>,
    metrics: &BTreeMap<Protocol, Vec<Metric>>,
) -> Result<Vec<Vec<Option<f64>>>, EvalError> {
    let reference = Reference::of(window);
    let mut cases = BTreeMap::new();
    for (asked, forecasts) in answers {
        let case = ScoredWindow::new(&reference, &forecasts[i], *asked).map_err(|problem| EvalError::Forecast {
            model: model.to_owned(),
            window: window.key(),
            problem,
        })?;
        cases.insert(*asked, case);
    }
    let of_protocol = |(protocol, metrics): (&Protocol, &Vec<Metric>)| {
        let of_metric = |metric: &Metric| metric.contribution(&cases[&protocol.asks()[protocol.answer_for(metric)]]);
        metrics.iter().map(of_metric).collect()
    };
    metrics.iter().map(of_protocol).collect()
}
