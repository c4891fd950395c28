//! The error on training windows beside that on the windows that are scored, and the mean error along the road: what is
//! under-trained or saturates shows as a lag on windows that it learned from.

use std::collections::BTreeMap;

use gnp_data::WindowId;
use gnp_eval::{ALL_SITES, Batch, EvalConfig, EvalError, EvaluatedModel, Protocol, Table, TableCell};
use serde::Serialize;

use super::Fold;
use crate::error::{Error, Result};
use crate::evaluation::systems::System;

/// Most training windows of a site and fold; of more, every n-th is taken.
const MOST: usize = 1000;

/// What a system got on the windows of one site that it was trained on and on those that are scored, of the first
/// future it gives. Pooled over folds and seeds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Row {
    model: String,
    site: String,
    /// The last whole second of a window, s.
    horizon_s: f64,
    /// Windows of the training parts, counted once a fold and seed.
    training_windows: u64,
    /// Root of the mean squared error at `horizon_s`, m.
    training_rmse_m: f64,
    test_rmse_m: f64,
    /// Mean error along the road at `horizon_s`, m: predicted minus recorded, below 0 for one that lags.
    training_bias_m: f64,
    test_bias_m: f64,
    /// `test_rmse_m` by the same one second earlier; null where windows are shorter than two.
    ratio: Option<f64>,
}

/// Sums of one system at one site.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    windows: u64,
    squared: f64,
    squared_before: f64,
    along: f64,
}

impl Sums {
    fn add(&mut self, more: &Self) {
        self.windows += more.windows;
        self.squared += more.squared;
        self.squared_before += more.squared_before;
        self.along += more.along;
    }

    fn rmse(&self) -> f64 {
        (self.squared / self.windows as f64).sqrt()
    }
}

/// By system, then by site: of training windows, and of those that are scored.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fit {
    horizon_s: f64,
    systems: Vec<(String, BTreeMap<String, [Sums; 2]>)>,
}

impl Fit {
    /// Asks `systems` for their forecasts of the training windows of a fold, thinned evenly, and of those that its
    /// configuration has scored.
    ///
    /// # Errors
    /// When a system fails; [`Error::Stopped`].
    pub(crate) fn measure(fold: &Fold<'_>, systems: &[System]) -> Result<Self> {
        let Fold { run, set, split } = fold;
        let mut by_site: BTreeMap<&str, Vec<WindowId>> = BTreeMap::new();
        for id in split.train() {
            let Some(window) = set.get(*id) else { continue };
            by_site.entry(window.observation().site()).or_default().push(*id);
        }
        let every = |ids: &[WindowId]| ids.len().div_ceil(MOST).max(1);
        let training: Vec<WindowId> =
            by_site.values().flat_map(|ids| ids.iter().copied().step_by(every(ids))).collect();
        // The only protocol that asks for one future and lets in those that are handed recorded ones.
        let config = EvalConfig { protocols: vec![Protocol::Literature], ..run.config.evaluate.clone() };
        let models: Vec<EvaluatedModel<'_>> = systems.iter().map(|system| system.model(None)).collect();
        let shape = set.shape();
        let last = (shape.t_pred as f64 / shape.rate_hz + 1e-9).floor();
        let frame = |second: f64| ((second * shape.rate_hz).round() as usize).checked_sub(1);
        let frames = [frame(last), frame(last - 1.)];
        let names = systems.iter().map(|system| (system.name().to_owned(), BTreeMap::new()));
        let mut fit = Self { horizon_s: last, systems: names.collect() };
        for (part, ids) in [&training[..], split.subset(config.subset)].into_iter().enumerate() {
            let work = run.machine.work("training error", ids.len() * models.len(), "forecasts");
            let result = gnp_eval::evaluate(set, ids, &models, &config, &mut |batch| {
                fit.add(batch, part, frames);
                work.at(batch.done as u64, batch.model);
                if run.machine.stop.is_requested() { Err(EvalError::Stopped) } else { Ok(()) }
            });
            match result {
                Err(EvalError::Stopped) => return Err(Error::Stopped { kept: None }),
                other => drop(other?),
            }
        }
        Ok(fit)
    }

    fn add(&mut self, batch: &Batch<'_>, part: usize, [last, before]: [Option<usize>; 2]) {
        let Some((_, sites)) = self.systems.iter_mut().find(|(name, _)| name == batch.model) else { return };
        for (window, forecast) in batch.windows.iter().zip(batch.forecasts) {
            let truth = window.truth();
            let error = |frame: Option<usize>| -> Option<[f64; 2]> {
                let at = forecast.modes.first()?.path.get(frame?)?;
                let was = truth.target(frame?);
                Some([f64::from(at[0]) - f64::from(was.x), f64::from(at[1]) - f64::from(was.y)])
            };
            let Some(end) = error(last) else { continue };
            let squared = |[x, y]: [f64; 2]| x * x + y * y;
            let squared_before = error(before).map_or(0., squared);
            let one = Sums { windows: 1, squared: squared(end), squared_before, along: end[0] };
            for site in [window.observation().site(), ALL_SITES] {
                sites.entry(site.to_owned()).or_default()[part].add(&one);
            }
        }
    }

    /// This and another fold or seed as one; a system that is not in both keeps what it has.
    pub(crate) fn with(mut self, other: Self) -> Self {
        for (name, sites) in other.systems {
            let Some((_, own)) = self.systems.iter_mut().find(|(own, _)| *own == name) else {
                self.systems.push((name, sites));
                continue;
            };
            for (site, sums) in sites {
                let own = own.entry(site).or_default();
                own.iter_mut().zip(&sums).for_each(|(own, more)| own.add(more));
            }
        }
        self
    }

    /// By site, all sites last, then by system.
    pub(crate) fn rows(&self) -> Vec<Row> {
        let mut rows: Vec<Row> = Vec::new();
        for (model, sites) in &self.systems {
            for (site, [training, test]) in sites {
                if training.windows == 0 || test.windows == 0 {
                    continue;
                }
                let bias = |sums: &Sums| sums.along / sums.windows as f64;
                rows.push(Row {
                    model: model.clone(),
                    site: site.clone(),
                    horizon_s: self.horizon_s,
                    training_windows: training.windows,
                    training_rmse_m: training.rmse(),
                    test_rmse_m: test.rmse(),
                    training_bias_m: bias(training),
                    test_bias_m: bias(test),
                    ratio: (test.squared_before > 0.).then(|| (test.squared / test.squared_before).sqrt()),
                });
            }
        }
        rows.sort_by(|a, b| (a.site == ALL_SITES, &a.site).cmp(&(b.site == ALL_SITES, &b.site)));
        rows
    }
}

/// One table a site.
pub(crate) fn tables(rows: &[Row]) -> Vec<Table> {
    let plain = |text: String| TableCell { text, interval: None, by_event: None };
    let of_site = |rows: &[Row]| -> Option<Table> {
        let first = rows.first()?;
        let (all, second) = (first.site == ALL_SITES, first.horizon_s);
        let site = if all { "all sites" } else { &first.site };
        let header = ["training RMSE", "test RMSE", "training bias", "test bias", "growth of test RMSE"];
        let cells = |row: &Row| {
            let metres = [row.training_rmse_m, row.test_rmse_m].map(|metres| format!("{metres:.2}"));
            let biases = [row.training_bias_m, row.test_bias_m].map(|metres| format!("{metres:+.2}"));
            let ratio = row.ratio.map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.2}"));
            let name = std::iter::once(row.model.clone());
            name.chain(metres).chain(biases).chain([ratio]).map(plain).collect::<Vec<_>>()
        };
        Some(Table {
            name: format!("training {}", first.site),
            detail: all,
            caption: format!(
                "{site}, error on training windows (at most {MOST} a site of a fold) beside that on the windows scored, at \
                 {second} s, m. Bias: mean error along the road, predicted minus recorded. Growth: RMSE at {second} s by \
                 that at {} s. Pooled over folds and seeds; first future.",
                second - 1.
            ),
            header: std::iter::once("model").chain(header).map(str::to_owned).collect(),
            rows: rows.iter().map(cells).collect(),
        })
    };
    rows.chunk_by(|a, b| a.site == b.site).filter_map(of_site).collect()
}
