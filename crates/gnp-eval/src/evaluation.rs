//! What models got: put together from folds and seeds, and turned into scores with intervals.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use gnp_data::Dataset;

use crate::bootstrap::{Bootstrap, Difference};
use crate::clusters::Draw;
use crate::error::EvalError;
use crate::manoeuvre::Manoeuvre;
use crate::metric::Metric;
use crate::protocol::Protocol;
use crate::score::{ALL_SITES, Score};
use crate::sums::{Gatherer, Members, MetricSums};

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
    pub(crate) setting: Setting,
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

/// What the windows so far add to the metrics of one protocol.
#[derive(Clone, Default)]
pub(crate) struct Gathered<'a> {
    pub(crate) sites: BTreeMap<&'a str, Gatherer>,
    pub(crate) manoeuvres: BTreeMap<Manoeuvre, Gatherer>,
}

impl Sheet {
    /// A model under its name, and whether it is handed recorded futures.
    pub(crate) fn new((model, uses_future): (&str, bool), protocol: Protocol, gathered: Gathered<'_>) -> Self {
        let mut sums: BTreeMap<String, MetricSums> =
            gathered.sites.into_iter().map(|(site, gatherer)| (site.to_owned(), gatherer.finish())).collect();
        let all = MetricSums::concatenated(sums.values());
        sums.insert(ALL_SITES.to_owned(), all);
        let sums = sums.into_iter().map(|(site, sums)| (site, Members::one(sums))).collect();
        let finished = gathered.manoeuvres.into_iter().map(|(key, gatherer)| (key, Members::one(gatherer.finish())));
        Self { model: model.to_owned(), protocol, uses_future, sums, manoeuvres: finished.collect() }
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
    /// are widened by what trainings differ.
    ///
    /// # Errors
    /// When the windows, their drivers or events differ, or a model was not scored here under a protocol.
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
    /// When models, their seeds, protocols, kind of data or rate differ, or a vehicle of both has another driver or
    /// event in one.
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
            let merged = merge(&mut own.sums, more.sums).and_then(|()| merge(&mut own.manoeuvres, more.manoeuvres));
            merged.ok_or_else(|| refuse("drivers or events"))?;
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
        let [by_driver, by_event] = [Draw::Drivers, Draw::Events].map(|draw| bootstrap.intervals(sums, &kinds, draw));
        for (index, (metric, (interval, wide))) in metrics.iter().zip(by_driver.iter().zip(by_event)).enumerate() {
            let Some(value) = sums.value(index, metric.kind) else { continue };
            let counts = sums.counts(index);
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
                event_ci_low: wide.map(|interval| interval.low),
                event_ci_high: wide.map(|interval| interval.high),
                windows: counts.windows,
                vehicles: counts.drivers,
                events: counts.events,
                simulated: self.setting.simulated,
                uses_future: sheet.uses_future,
            });
        }
    }

    /// How much `a` differs from `b` on a site, drivers and events resampled for both together:
    /// is one better?
    ///
    /// # Errors
    /// When one of them, the metric or the site was not scored under the protocol, or the metric
    /// applies to different windows, or these have other drivers or events.
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
        if !sums_a.same_clusters(sums_b) || sums_a.windows(index).ne(sums_b.windows(index)) {
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

/// Adds the sums of other windows; `None` where a vehicle of both has not the same driver and event.
fn merge<K: Ord>(own: &mut BTreeMap<K, Members>, more: BTreeMap<K, Members>) -> Option<()> {
    for (key, sums) in more {
        match own.entry(key) {
            Entry::Vacant(place) => drop(place.insert(sums)),
            Entry::Occupied(mut place) => {
                let merged = place.get().merged(&sums)?;
                place.insert(merged);
            }
        }
    }
    Some(())
}
