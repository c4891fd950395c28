//! Whether explanations are true: what they say of the leader, beside what happens to the forecast without him.
//!
//! In windows with a leader a predictor that explains itself is asked twice: with the scene as it was observed, and
//! with the leader deleted from it. Along the road, at the last predicted frame of the first future:
//!
//! - the **effect** `e` is how far the end point moves: with the leader less without him, m;
//! - the **part** `p` is what the explanation gives that vehicle, as leader and as neighbour, m;
//! - the **total** `t` is how far the end point is from where constant velocity leads, m;
//! - of the total `l` is **learned** ([`Cause::Intention`]), and `t - l` is of named physical causes.
//!
//! If explanations say what the model does, `e` and `p` are the same: a correlation and a slope of 1. The slope is the
//! least squares fit of `e` on `p` through the origin, `sum(e p) / sum(p²)`. How much of a forecast is explained by
//! physics at all is `mean |t - l| / (mean |t - l| + mean |l|)`, and beside it `1 - sum(l²) / sum(t²)`, at least 0.

use std::collections::BTreeMap;

use gnp_data::{Cause, EditedScene, Observation, Predictor, SceneEdit, Window};
use gnp_eval::{ALL_SITES, Bootstrap, Clusters, Interval, Table, TableCell, TableHead, VehicleId};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Material;
use super::systems::System;
use crate::error::Result;
use crate::machine::Machine;
use crate::run::folder::RunFolder;

/// File of a run.
pub(super) const FILE: &str = "faithfulness.json";

/// Most windows of a site that are asked; of more, every n-th is taken.
const MOST: usize = 1000;

/// Windows between two looks at whether to stop.
const CHUNK: usize = 32;

/// How true the explanations of a model are on one site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Faithfulness {
    /// Name of the model.
    pub model: String,
    /// The site, or [`ALL_SITES`].
    pub site: String,
    /// Time of the end point, s.
    pub horizon_s: f64,
    /// Windows with a leader that were asked.
    pub windows: u64,
    /// Their drivers.
    pub vehicles: usize,
    /// Whether any of them is simulated.
    pub simulated: bool,
    /// Mean size of the effect of deleting the leader, m.
    pub effect_m: f64,
    /// Mean size of the part that the explanation gives the leader, m.
    pub part_m: f64,
    /// Correlation of effect and part; null where one of them never varies.
    pub correlation: Option<Estimate>,
    /// Slope of effect on part, by least squares through the origin; null where no part differs from 0.
    pub slope: Option<Estimate>,
    /// Share of named physical causes: their mean size at the end, beside the mean size of what is learned; null where
    /// every forecast is constant velocity.
    pub physical_share: Option<Estimate>,
    /// 1 less the sum of squares of what is learned over that of the whole difference from constant velocity, at least
    /// 0; null as above.
    pub physical_share_of_squares: Option<Estimate>,
}

/// A number with its 95 % interval, by driver.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Lower end of the interval; null with fewer than two drivers.
    pub ci_low: Option<f64>,
    /// Upper end of the interval; null with fewer than two drivers.
    pub ci_high: Option<f64>,
}

/// Measures how true the explanations of `model` are by asking it again without the leader, by site ([`ALL_SITES`]
/// last, and only where there are several): at most 1000 windows a site, every n-th of those with a leader. Empty for a
/// model whose forecasts have no contributions. Each vehicle counts as a driver of its own.
///
/// # Errors
/// When a scene cannot be changed or the model fails.
pub fn faithfulness(
    model: &dyn Predictor,
    observations: &[Observation<'_>],
    bootstrap: &Bootstrap,
) -> Result<Vec<Faithfulness>> {
    let mut measured = Measured::default();
    measured.add(model.name(), model, &chosen(observations), &|vehicle| vehicle, &mut |_| Ok(()))?;
    Ok(measured.rows(bootstrap))
}

/// Sums over windows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sums {
    windows: f64,
    effect: f64,
    part: f64,
    effect_size: f64,
    part_size: f64,
    effect_squared: f64,
    part_squared: f64,
    product: f64,
    physical_size: f64,
    learned_size: f64,
    learned_squared: f64,
    total_squared: f64,
}

/// What was measured of one model on one site, by driver.
#[derive(Clone, Debug, Default)]
struct Site {
    horizon_s: f64,
    simulated: bool,
    drivers: BTreeMap<VehicleId, Sums>,
}

/// What was measured, by model in the order of the rows, and by site.
#[derive(Clone, Debug, Default)]
pub(crate) struct Measured(Vec<(String, BTreeMap<String, Site>)>);

impl Sums {
    fn of(effect: f64, part: f64, total: f64, learned: f64) -> Self {
        Self {
            windows: 1.,
            effect,
            part,
            effect_size: effect.abs(),
            part_size: part.abs(),
            effect_squared: effect * effect,
            part_squared: part * part,
            product: effect * part,
            physical_size: (total - learned).abs(),
            learned_size: learned.abs(),
            learned_squared: learned * learned,
            total_squared: total * total,
        }
    }

    /// These and the others `times` over.
    fn plus(self, other: &Self, times: f64) -> Self {
        Self {
            windows: self.windows + times * other.windows,
            effect: self.effect + times * other.effect,
            part: self.part + times * other.part,
            effect_size: self.effect_size + times * other.effect_size,
            part_size: self.part_size + times * other.part_size,
            effect_squared: self.effect_squared + times * other.effect_squared,
            part_squared: self.part_squared + times * other.part_squared,
            product: self.product + times * other.product,
            physical_size: self.physical_size + times * other.physical_size,
            learned_size: self.learned_size + times * other.learned_size,
            learned_squared: self.learned_squared + times * other.learned_squared,
            total_squared: self.total_squared + times * other.total_squared,
        }
    }

    fn correlation(&self) -> Option<f64> {
        let n = self.windows;
        let spread = |sum: f64, squared: f64| {
            let spread = n * squared - sum * sum;
            // What is left of equal numbers is rounding.
            (spread > 1e-9 * n * squared).then_some(spread)
        };
        let both = spread(self.effect, self.effect_squared)? * spread(self.part, self.part_squared)?;
        Some(((n * self.product - self.effect * self.part) / both.sqrt()).clamp(-1., 1.))
    }

    fn slope(&self) -> Option<f64> {
        (self.part_squared > 0.).then(|| self.product / self.part_squared)
    }

    fn physical_share(&self) -> Option<f64> {
        let whole = self.physical_size + self.learned_size;
        (whole > 0.).then(|| self.physical_size / whole)
    }

    fn physical_share_of_squares(&self) -> Option<f64> {
        (self.total_squared > 0.).then(|| (1. - self.learned_squared / self.total_squared).max(0.))
    }
}

impl Measured {
    /// Measures the systems that explain themselves.
    ///
    /// # Errors
    /// As [`faithfulness`]; [`Error::Stopped`](crate::Error::Stopped).
    pub(crate) fn of_systems(material: &Material<'_>, systems: &[System], machine: &Machine) -> Result<Self> {
        let mut measured = Self::default();
        if systems.iter().all(|system| system.explaining().is_none()) {
            return Ok(measured);
        }
        let windows: Vec<Window<'_>> = material.ids.iter().filter_map(|id| material.set.get(*id)).collect();
        let seen = chosen(&windows.iter().map(Window::observation).collect::<Vec<_>>());
        let clusters = Clusters::of(material.set);
        let driver = |vehicle: VehicleId| clusters.driver(&vehicle);
        for system in systems {
            let Some(model) = system.explaining() else { continue };
            let work = machine.work("faithfulness", seen.len(), "windows");
            measured.add(system.name(), model, &seen, &driver, &mut |done| {
                work.at(done as u64, system.name());
                machine.stop.check()
            })?;
        }
        Ok(measured)
    }

    /// This and what was measured on other windows as one.
    pub(crate) fn pooled(mut self, other: Self) -> Self {
        for (model, sites) in other.0 {
            for (site, more) in sites {
                let own = self.site(&model, &site);
                (own.horizon_s, own.simulated) = (more.horizon_s, own.simulated || more.simulated);
                for (driver, sums) in more.drivers {
                    let cell = own.drivers.entry(driver).or_default();
                    *cell = cell.plus(&sums, 1.);
                }
            }
        }
        self
    }

    /// One row a model and site, all sites together last and only where there are several.
    pub(crate) fn rows(&self, bootstrap: &Bootstrap) -> Vec<Faithfulness> {
        let mut rows = Vec::new();
        for (model, sites) in &self.0 {
            rows.extend(sites.iter().map(|(name, site)| site.row(model, name, bootstrap)));
            if sites.len() > 1 {
                let parts = sites
                    .values()
                    .map(|site| Self(vec![(model.clone(), BTreeMap::from([(ALL_SITES.to_owned(), site.clone())]))]));
                let all = parts.fold(Self::default(), Self::pooled);
                let sites = all.0.iter().flat_map(|(_, sites)| sites);
                rows.extend(sites.map(|(name, site)| site.row(model, name, bootstrap)));
            }
        }
        rows
    }

    fn site(&mut self, model: &str, site: &str) -> &mut Site {
        let found = self.0.iter().position(|(name, _)| name == model);
        let index = found.unwrap_or_else(|| {
            self.0.push((model.to_owned(), BTreeMap::new()));
            self.0.len() - 1
        });
        self.0[index].1.entry(site.to_owned()).or_default()
    }

    /// Asks a model about windows that have a leader; `driver` names the driver of a vehicle, `watch` is told how many
    /// are done.
    fn add(
        &mut self,
        name: &str,
        model: &dyn Predictor,
        observations: &[Observation<'_>],
        driver: &dyn Fn(VehicleId) -> VehicleId,
        watch: &mut dyn FnMut(usize) -> Result<()>,
    ) -> Result<()> {
        let mut done = 0;
        for chunk in observations.chunks(CHUNK) {
            let asked: Vec<Option<(Sums, bool)>> =
                chunk.par_iter().map(|seen| ask(model, seen)).collect::<Result<_>>()?;
            for (seen, answer) in chunk.iter().zip(asked) {
                let Some((sums, simulated)) = answer else { return Ok(()) };
                let site = self.site(name, seen.site());
                site.horizon_s = seen.shape().t_pred as f64 * seen.shape().dt();
                site.simulated |= simulated;
                let key = seen.key();
                let vehicle = VehicleId { recording: key.recording, vehicle: key.vehicle };
                let cell = site.drivers.entry(driver(vehicle)).or_default();
                *cell = cell.plus(&sums, 1.);
            }
            done += chunk.len();
            watch(done)?;
        }
        Ok(())
    }
}

impl Site {
    fn row(&self, model: &str, site: &str, bootstrap: &Bootstrap) -> Faithfulness {
        let by_driver: Vec<Sums> = self.drivers.values().copied().collect();
        let all = by_driver.iter().fold(Sums::default(), |all, sums| all.plus(sums, 1.));
        let estimate = |of: fn(&Sums) -> Option<f64>, [least, largest]: [f64; 2]| {
            let value = of(&all)?;
            let interval = bootstrap.interval(by_driver.len(), |times| {
                let drawn = by_driver.iter().zip(times);
                of(&drawn.fold(Sums::default(), |all, (sums, times)| all.plus(sums, *times)))
            });
            let ends = interval.map(|Interval { low, high }| (low.max(least), high.min(largest)));
            Some(Estimate { value, ci_low: ends.map(|ends| ends.0), ci_high: ends.map(|ends| ends.1) })
        };
        Faithfulness {
            model: model.to_owned(),
            site: site.to_owned(),
            horizon_s: self.horizon_s,
            windows: all.windows as u64,
            vehicles: by_driver.len(),
            simulated: self.simulated,
            effect_m: all.effect_size / all.windows.max(1.),
            part_m: all.part_size / all.windows.max(1.),
            correlation: estimate(Sums::correlation, [-1., 1.]),
            slope: estimate(Sums::slope, [f64::NEG_INFINITY, f64::INFINITY]),
            physical_share: estimate(Sums::physical_share, [0., 1.]),
            physical_share_of_squares: estimate(Sums::physical_share_of_squares, [0., 1.]),
        }
    }
}

/// Of each site the windows with a leader, at most [`MOST`].
fn chosen<'a>(observations: &[Observation<'a>]) -> Vec<Observation<'a>> {
    let mut by_site: BTreeMap<&str, Vec<Observation<'a>>> = BTreeMap::new();
    for seen in observations.iter().filter(|seen| seen.leader().is_some()) {
        by_site.entry(seen.site()).or_default().push(*seen);
    }
    let thinned = by_site.into_values().flat_map(|of_site| {
        let step = of_site.len().div_ceil(MOST).max(1);
        of_site.into_iter().step_by(step)
    });
    thinned.collect()
}

/// What one window adds, and whether it is simulated; `None` for a model that does not explain itself. One scene is
/// asked at a time: predictors may look at all windows of a call together, and a scene that lacks a vehicle is not the
/// one that has it.
fn ask(model: &dyn Predictor, seen: &Observation<'_>) -> Result<Option<(Sums, bool)>> {
    let Some(leader) = seen.leader().map(|leader| leader.vehicle()) else { return Ok(None) };
    let whole = EditedScene::of(seen);
    let first = |scene: &EditedScene| -> Result<_> {
        let forecast = model.predict(&[scene.observation(seen.vehicle())?], 1)?.into_iter().next();
        Ok(forecast.and_then(|forecast| forecast.modes.into_iter().next()))
    };
    let Some(with) = first(&whole)? else { return Ok(None) };
    let Some(explanation) = with.explanation.filter(|explanation| !explanation.contributions.is_empty()) else {
        return Ok(None);
    };
    let simulated = whole.snapshot().recording().meta().simulated;
    let removed = whole.with(&SceneEdit::Remove { vehicle: leader }).map_err(gnp_data::DataError::from)?;
    let Some(without) = first(&removed)? else { return Ok(None) };

    let end = |path: &[[f32; 2]]| f64::from(path.last().copied().unwrap_or_default()[0]);
    let sum = |counts: &dyn Fn(&Cause) -> bool| -> f64 {
        let parts = explanation.contributions.iter().filter(|part| counts(&part.cause));
        parts.map(|part| f64::from(part.at_end()[0])).sum()
    };
    let of_leader = sum(&|cause| match cause {
        Cause::Leader { vehicle, .. } | Cause::Neighbour { vehicle } => *vehicle == leader,
        _ => false,
    });
    let effect = end(&with.path) - end(&without.path);
    Ok(Some((Sums::of(effect, of_leader, sum(&|_| true), sum(&|cause| !cause.is_physical())), simulated)))
}

/// What a run's [`FILE`] says; nothing where it has none.
pub(super) fn load(folder: &RunFolder) -> Result<Vec<Faithfulness>> {
    if folder.usable(FILE)?.exists() { folder.read_json(FILE) } else { Ok(Vec::new()) }
}

/// The table of it; `None` where nothing was measured.
pub(crate) fn table(rows: &[Faithfulness], head: &TableHead) -> Option<Table> {
    let horizon_s = rows.first()?.horizon_s;
    let cell = |estimate: Option<Estimate>| {
        let interval = estimate.and_then(|of| Some(Interval { low: of.ci_low?, high: of.ci_high? }));
        TableCell {
            text: estimate.map_or_else(|| "-".to_owned(), |of| format!("{:.2}", of.value)),
            interval,
            by_event: None,
        }
    };
    let plain = |text: String| TableCell { text, interval: None, by_event: None };
    let row = |row: &Faithfulness| {
        let site = if row.site == ALL_SITES { "all sites" } else { &row.site };
        vec![
            plain(format!("{site}: {}", row.model)),
            plain(row.windows.to_string()),
            plain(row.vehicles.to_string()),
            plain(format!("{:.2}", row.effect_m)),
            plain(format!("{:.2}", row.part_m)),
            cell(row.correlation),
            cell(row.slope),
            cell(row.physical_share),
            cell(row.physical_share_of_squares),
        ]
    };
    let simulated = if rows.iter().any(|row| row.simulated) { " (*simulated*)" } else { "" };
    let header = [
        "site: model",
        "windows",
        "drivers",
        "effect (m)",
        "part (m)",
        "correlation",
        "slope",
        "physics",
        "of squares",
    ];
    Some(Table {
        name: "faithfulness".to_owned(),
        detail: false,
        caption: format!(
            "Faithfulness of explanations{simulated}, along the road at {horizon_s} s, first future, in windows with a \
             leader (at most {MOST} a site of a fold). Effect: how far the end point moves when the leader is \
             deleted and the model asked again; part: what the explanation gives him; mean sizes. Correlation of the \
             two; slope of effect on part, least squares through the origin; both are 1 where explanations are true. \
             Physics: mean |named physical causes| / (that + mean |learned|), of the end point's difference from \
             constant velocity; of squares: 1 - sum learned² / sum of the whole difference², at least 0. Split by {}; \
             intervals of 95 % by driver, one seed.",
            head.split
        ),
        header: header.map(str::to_owned).to_vec(),
        rows: rows.iter().map(row).collect(),
    })
}

#[cfg(test)]
mod tests;
