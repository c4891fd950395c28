//! Is one model better than another? Differences on the same windows, as rows of a file.

use std::path::Path;

use gnp_data::Dataset;
use serde::{Deserialize, Serialize};

use crate::bootstrap::{Bootstrap, Difference};
use crate::error::EvalError;
use crate::evaluation::{Evaluation, Sheet};
use crate::metric::Direction;
use crate::protocol::Protocol;
use crate::score::{ALL_SITES, load_lines, save_lines};

/// What a difference says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The first model is better: the interval by driver leaves out zero and, with 3 events or more, that by event
    /// too. With fewer events it rests on drivers alone.
    Better,
    /// The second model is better: as above.
    Worse,
    /// An interval holds zero, or there is none by driver; also where which way is better is no matter of sign.
    Open,
}

impl Verdict {
    /// What a difference says, given which way is better.
    #[must_use]
    pub fn of(difference: &Difference, direction: Direction) -> Self {
        let lower = difference.value < 0.;
        match direction {
            Direction::Lower if difference.is_clear() => [Self::Worse, Self::Better][usize::from(lower)],
            Direction::Higher if difference.is_clear() => [Self::Better, Self::Worse][usize::from(lower)],
            _ => Self::Open,
        }
    }

    /// Name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::Open => "open",
        }
    }
}

/// Two models compared by one metric; drivers, and once more events, resampled for both together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// The data family.
    pub dataset: Dataset,
    /// The site, or [`ALL_SITES`].
    pub site: String,
    /// The protocol.
    pub protocol: Protocol,
    /// Name of the metric.
    pub metric: String,
    /// Modes chosen from; null where all modes enter.
    pub k: Option<usize>,
    /// Time at which, or up to which, it was measured, s.
    pub horizon_s: f64,
    /// The first model.
    pub a: String,
    /// The second model.
    pub b: String,
    /// Seeds with which each of the two was trained.
    #[serde(default = "one_each")]
    pub seeds: [usize; 2],
    /// The first model's value minus the second's.
    pub value: f64,
    /// Lower end of the 95 % interval of the difference by driver; null with fewer than two.
    pub ci_low: Option<f64>,
    /// Upper end of it.
    pub ci_high: Option<f64>,
    /// Lower end of the interval by event; null with fewer than three.
    #[serde(default)]
    pub event_ci_low: Option<f64>,
    /// Upper end of it.
    #[serde(default)]
    pub event_ci_high: Option<f64>,
    /// Share of resamples by driver in which the first model is better; differences between trainings are not in it.
    pub share_better: f64,
    /// Whether the first model is better.
    pub verdict: Verdict,
    /// Windows that entered.
    pub windows: u64,
    /// Drivers that entered.
    pub vehicles: usize,
    /// Events that entered; 0 in files that do not say.
    #[serde(default)]
    pub events: usize,
    /// Whether any recording that was scored is simulated.
    pub simulated: bool,
    /// Whether one of the two is handed recorded futures.
    pub uses_future: bool,
}

/// Seeds in files written before a system could have several.
fn one_each() -> [usize; 2] {
    [1; 2]
}

impl Evaluation {
    /// Each other model against `model`, by protocol, site ([`ALL_SITES`] last, and only where there
    /// are several) and headline metric that both have: the first minus the second.
    ///
    /// # Errors
    /// [`EvalError::NotScored`] when `model` is not among those scored.
    pub fn comparisons(&self, model: &str, bootstrap: &Bootstrap) -> Result<Vec<Comparison>, EvalError> {
        if !self.sheets.iter().any(|sheet| sheet.model == model) {
            let mut models: Vec<&str> = self.sheets.iter().map(|sheet| sheet.model.as_str()).collect();
            models.dedup();
            return Err(EvalError::NotScored { model: model.to_owned(), scored: models.join(", ") });
        }
        let mut rows = Vec::new();
        for own in self.sheets.iter().filter(|sheet| sheet.model == model) {
            for site in sites(own) {
                for other in self.sheets.iter().filter(|sheet| sheet.protocol == own.protocol && sheet.model != model) {
                    self.compare(own, other, site, bootstrap, &mut rows)?;
                }
            }
        }
        Ok(rows)
    }

    fn compare(
        &self,
        own: &Sheet,
        other: &Sheet,
        site: &str,
        bootstrap: &Bootstrap,
        rows: &mut Vec<Comparison>,
    ) -> Result<(), EvalError> {
        let protocol = own.protocol;
        let Some(metrics) = self.metrics.get(&protocol) else { return Ok(()) };
        let last = metrics.iter().map(|metric| metric.horizon_s).fold(0., f64::max);
        for metric in protocol.headline_at(last) {
            let index = metrics.iter().position(|m| *m == metric).unwrap_or(0);
            let [counts, others] = [own, other].map(|it| it.sums.get(site).map(|sums| sums.counts(index)));
            // A model without densities has none of their metrics.
            let (Some(counts), Some(1..)) = (counts.filter(|it| it.windows > 0), others.map(|it| it.windows)) else {
                continue;
            };
            let difference = self.difference(protocol, site, (&own.model, &other.model), metric, bootstrap)?;
            rows.push(Comparison {
                dataset: self.setting().dataset,
                site: site.to_owned(),
                protocol,
                metric: metric.kind.name().to_owned(),
                k: metric.k,
                horizon_s: metric.horizon_s,
                a: own.model.clone(),
                b: other.model.clone(),
                seeds: [own.seeds(), other.seeds()],
                value: difference.value,
                ci_low: difference.interval.map(|interval| interval.low),
                ci_high: difference.interval.map(|interval| interval.high),
                event_ci_low: difference.by_event.map(|interval| interval.low),
                event_ci_high: difference.by_event.map(|interval| interval.high),
                share_better: difference.share_better,
                verdict: Verdict::of(&difference, metric.kind.direction()),
                windows: counts.windows,
                vehicles: counts.drivers,
                events: counts.events,
                simulated: self.setting().simulated,
                uses_future: own.uses_future || other.uses_future,
            });
        }
        Ok(())
    }
}

/// The sites of a model, all of them together last and only where there are several.
fn sites(sheet: &Sheet) -> Vec<&str> {
    let mut sites: Vec<&str> = sheet.sums.keys().map(String::as_str).collect();
    sites.sort_by_key(|site| *site == ALL_SITES);
    if let [_, ALL_SITES] = sites[..] {
        sites.pop();
    }
    sites
}

/// Writes `differences.json`: a JSON array, one comparison a line; the file appears whole or not at
/// all.
///
/// # Errors
/// When the file cannot be written.
pub fn save_comparisons(path: &Path, comparisons: &[Comparison]) -> Result<(), EvalError> {
    save_lines(path, comparisons)
}

/// Reads what [`save_comparisons`] wrote.
///
/// # Errors
/// When the file cannot be read or is not a list of comparisons.
pub fn load_comparisons(path: &Path) -> Result<Vec<Comparison>, EvalError> {
    load_lines(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bootstrap::Interval;

    fn verdicts(value: f64, interval: Option<(f64, f64)>, by_event: Option<(f64, f64)>) -> [Verdict; 3] {
        let [interval, by_event] = [interval, by_event].map(|it| it.map(|(low, high)| Interval { low, high }));
        let difference = Difference { value, interval, by_event, share_better: 0.5 };
        [Direction::Lower, Direction::Higher, Direction::Towards(0.5)].map(|it| Verdict::of(&difference, it))
    }

    #[test]
    fn only_an_interval_without_zero_decides() {
        let of = |value, interval| verdicts(value, interval, None);
        assert_eq!(of(-1., Some((-2., -0.1))), [Verdict::Better, Verdict::Worse, Verdict::Open]);
        assert_eq!(of(1., Some((0.1, 2.))), [Verdict::Worse, Verdict::Better, Verdict::Open]);
        assert_eq!(of(-1., Some((-2., 0.1))), [Verdict::Open; 3]);
        assert_eq!(of(-1., None), [Verdict::Open; 3]);
    }

    #[test]
    fn events_must_agree() {
        let of = |by_event| verdicts(-1., Some((-2., -0.1)), by_event)[0];
        assert_eq!(of(Some((-3., -0.05))), Verdict::Better);
        assert_eq!(of(Some((-3., 0.05))), Verdict::Open);
        assert_eq!(of(Some((0.1, 0.2))), Verdict::Open);
        assert_eq!(verdicts(1., Some((0.1, 2.)), Some((0.05, 3.)))[0], Verdict::Worse);
        assert_eq!(verdicts(1., None, Some((0.05, 3.)))[0], Verdict::Open);
    }
}
