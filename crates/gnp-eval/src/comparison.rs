//! Is one model better than another? Differences on the same windows, as rows of a file.

use std::path::Path;

use gnp_data::Dataset;
use serde::{Deserialize, Serialize};

use crate::bootstrap::{Bootstrap, Difference};
use crate::error::EvalError;
use crate::evaluate::{Evaluation, Sheet};
use crate::metric::Direction;
use crate::protocol::Protocol;
use crate::score::{ALL_SITES, load_lines, save_lines};

/// What a difference says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The first model is better: the interval leaves out zero.
    Better,
    /// The second model is better: the interval leaves out zero.
    Worse,
    /// The interval holds zero, or there is none.
    Open,
}

impl Verdict {
    /// What a difference says, given which way is better.
    #[must_use]
    pub fn of(difference: &Difference, direction: Direction) -> Self {
        let lower = difference.value < 0.;
        match (difference.is_clear(), lower == (direction == Direction::Lower)) {
            (false, _) => Self::Open,
            (true, true) => Self::Better,
            (true, false) => Self::Worse,
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

/// Two models compared by one metric, vehicles and seeds resampled for both together.
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
    /// Lower end of the 95 % interval of the difference; null with fewer than two vehicles.
    pub ci_low: Option<f64>,
    /// Upper end of it.
    pub ci_high: Option<f64>,
    /// Share of resamples in which the first model is better.
    pub share_better: f64,
    /// Whether the first model is better.
    pub verdict: Verdict,
    /// Windows that entered.
    pub windows: u64,
    /// Vehicles that entered.
    pub vehicles: usize,
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
    /// are several) and headline metric: the first minus the second.
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
            let difference = self.difference(protocol, site, (&own.model, &other.model), metric, bootstrap)?;
            let index = metrics.iter().position(|m| *m == metric).unwrap_or(0);
            let (windows, vehicles) = own.sums.get(site).map_or((0, 0), |sums| sums.counts(index));
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
                share_better: difference.share_better,
                verdict: Verdict::of(&difference, metric.kind.direction()),
                windows,
                vehicles,
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

    #[test]
    fn only_an_interval_without_zero_decides() {
        let of = |value: f64, interval: Option<(f64, f64)>| {
            let interval = interval.map(|(low, high)| Interval { low, high });
            let difference = Difference { value, interval, share_better: 0.5 };
            [Direction::Lower, Direction::Higher].map(|direction| Verdict::of(&difference, direction))
        };
        assert_eq!(of(-1., Some((-2., -0.1))), [Verdict::Better, Verdict::Worse]);
        assert_eq!(of(1., Some((0.1, 2.))), [Verdict::Worse, Verdict::Better]);
        assert_eq!(of(-1., Some((-2., 0.1))), [Verdict::Open; 2]);
        assert_eq!(of(-1., None), [Verdict::Open; 2]);
    }
}
