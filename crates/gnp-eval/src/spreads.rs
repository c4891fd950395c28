//! Densities of forecasts, by one definition for every system.
//!
//! A forecast is a set of paths with probabilities, of which few systems say how wide they are. At each whole second it
//! is read as a mixture of Gaussians with its modes as means and their probabilities as weights. All its components
//! have the same two standard deviations, along and across the road, and so have all windows of a site: these are the
//! only numbers that are fitted, by maximum likelihood, to windows on which the system is not scored. A rule of one
//! future has one Gaussian.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use gnp_data::{Mode, Predictor, Window, WindowId, WindowSet};
use rayon::prelude::*;

use crate::case::{Reference, ScoredWindow, whole_seconds};
use crate::error::EvalError;
use crate::evaluate::{Batch, EvaluatedModel, batches, in_order};
use crate::protocol::Protocol;
use crate::sums::VehicleId;

/// Least standard deviation, m: positions are not measured better than this, and a system without any error on the
/// windows of the fit still has a density.
const LEAST_M: f64 = 0.01;
/// Fewest vehicles of a site for standard deviations of its own: windows of one vehicle err alike.
const LEAST_VEHICLES: usize = 10;
/// Most windows of a site that enter the fit, about; of more, every n-th instant is taken.
const MOST_WINDOWS: usize = 2000;
/// Steps of the fit, at most.
const STEPS: usize = 500;
/// Relative change of both variances below which the fit has settled.
const SETTLED: f64 = 1e-6;

/// Standard deviations of the components of a forecast's density at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Time after the last observed frame, s.
    pub horizon_s: f64,
    /// Along the road, m.
    pub along_m: f64,
    /// Across the road, m.
    pub across_m: f64,
}

/// The spreads of one system, by site and whole second.
#[derive(Clone, Debug, PartialEq)]
pub struct Spreads {
    sites: BTreeMap<String, Vec<Spread>>,
    /// Of all windows, for sites that have no spreads of their own.
    pooled: Vec<Spread>,
}

/// One mode at one time: its probability, and how far the record is from it along and across, m.
type Component = [f64; 3];

/// The modes of each window by whole second, `[seconds][windows][modes]`.
type Recorded = Vec<Vec<Vec<Component>>>;

/// What a site adds to the fit.
#[derive(Default)]
struct SiteWindows {
    vehicles: BTreeSet<VehicleId>,
    recorded: Recorded,
}

impl Spreads {
    /// Fits the spreads of `model` to the windows `ids` of `set`, which must not be among those that are scored.
    ///
    /// The model is asked for as many futures as metrics of all modes are taken from. Sites with windows of fewer than
    /// 10 vehicles (a vehicle of two recordings counts twice), and those that are not among the windows at all, get the
    /// spreads of all windows together. `watch` sees every answer and may stop.
    ///
    /// # Errors
    /// When there is no window, no whole second has a frame, the model fails or gives a forecast that cannot be scored,
    /// or `watch` says so.
    pub fn fit(
        set: &WindowSet<'_>,
        ids: &[WindowId],
        model: &dyn Predictor,
        batch: usize,
        watch: &mut dyn FnMut(&Batch<'_>) -> Result<(), EvalError>,
    ) -> Result<Self, EvalError> {
        let seconds = whole_seconds(&set.shape())?;
        let ids = thinned(set, &in_order(set, ids)?);
        let asked = Protocol::Clean.asks().iter().copied().max().unwrap_or(1);
        let model = EvaluatedModel::Predictor(model);
        let mut sites: BTreeMap<&str, SiteWindows> = BTreeMap::new();
        let (mut done, total) = (0, ids.len());
        for batch in batches(set, &ids, batch.max(1)) {
            let windows: Vec<Window<'_>> = batch.iter().filter_map(|id| set.get(*id)).collect();
            let forecasts = model.predict(&windows, asked)?;
            done += windows.len();
            watch(&Batch { model: model.name(), asked, windows: &windows, forecasts: &forecasts, done, total })?;
            for (window, forecast) in windows.iter().zip(&forecasts) {
                let reference = Reference::of(window);
                let case = ScoredWindow::new(&reference, forecast, asked).map_err(|problem| EvalError::Forecast {
                    model: model.name().to_owned(),
                    window: window.key(),
                    problem,
                })?;
                let site = sites.entry(window.observation().site()).or_default();
                let key = window.key();
                site.vehicles.insert(VehicleId { recording: key.recording, vehicle: key.vehicle });
                site.recorded.resize_with(seconds.len(), Vec::new);
                for (recorded, second) in site.recorded.iter_mut().zip(&seconds) {
                    recorded.push(components(&case, reference.frames(*second)?));
                }
            }
        }
        if total == 0 {
            return Err(EvalError::NoWindows);
        }
        let all: Vec<&Recorded> = sites.values().map(|site| &site.recorded).collect();
        let own = sites.iter().filter(|(_, site)| site.vehicles.len() >= LEAST_VEHICLES);
        Ok(Self {
            sites: own.map(|(name, site)| ((*name).to_owned(), by_second(&[&site.recorded], &seconds))).collect(),
            pooled: by_second(&all, &seconds),
        })
    }

    /// The spreads of a site by whole second.
    #[must_use]
    pub fn of(&self, site: &str) -> &[Spread] {
        self.sites.get(site).unwrap_or(&self.pooled)
    }
}

/// Of each site about [`MOST_WINDOWS`] windows: whole instants, so that models that predict a scene together see it.
fn thinned(set: &WindowSet<'_>, ids: &[WindowId]) -> Vec<WindowId> {
    let site = |id: &WindowId| set.recording(*id).map_or("", |recording| recording.meta().site.as_str());
    let mut windows: BTreeMap<&str, usize> = BTreeMap::new();
    ids.iter().for_each(|id| *windows.entry(site(id)).or_default() += 1);
    let mut instants: BTreeMap<&str, usize> = BTreeMap::new();
    let mut kept = Vec::new();
    for instant in batches(set, ids, 1) {
        let Some(site) = instant.first().map(site) else { continue };
        let number = instants.entry(site).or_default();
        let every = windows.get(site).map_or(1, |windows| windows.div_ceil(MOST_WINDOWS).max(1));
        if number.is_multiple_of(every) {
            kept.extend_from_slice(instant);
        }
        *number += 1;
    }
    kept
}

fn by_second(sites: &[&Recorded], seconds: &[f64]) -> Vec<Spread> {
    let spread = |(index, horizon_s): (usize, &f64)| {
        let windows: Vec<&[Component]> = sites.iter().flat_map(|site| &site[index]).map(Vec::as_slice).collect();
        let [along_m, across_m] = likeliest(&windows);
        Spread { horizon_s: *horizon_s, along_m, across_m }
    };
    seconds.par_iter().enumerate().map(spread).collect()
}

/// The modes of a forecast in the last of `frames` frames, those without probability left out.
fn components(case: &ScoredWindow<'_>, frames: usize) -> Vec<Component> {
    let total: f64 = case.modes().iter().map(|mode| f64::from(mode.probability)).sum();
    let truth = case.reference().path()[frames - 1];
    let component = |mode: &Mode| {
        let off = |axis: usize| f64::from(truth[axis]) - f64::from(mode.path[frames - 1][axis]);
        [f64::from(mode.probability) / total, off(0), off(1)]
    };
    case.modes().iter().filter(|mode| mode.probability > 0.).map(component).collect()
}

/// Standard deviations along and across, m, under which the windows are likeliest: expectation and maximisation from a
/// wide and from a narrow start, of which the better end counts. Both reach [`LEAST_M`] at least.
fn likeliest(windows: &[&[Component]]) -> [f64; 2] {
    let count = windows.len().max(1) as f64;
    let floor = LEAST_M.powi(2);
    let wide: [f64; 2] = std::array::from_fn(|axis| {
        let of = |window: &&[Component]| window.iter().map(|it| it[0] * it[axis + 1].powi(2)).sum::<f64>();
        (windows.iter().map(of).sum::<f64>() / count).max(floor)
    });
    let narrow: [f64; 2] = std::array::from_fn(|axis| {
        let size = |it: &Component| it[1].hypot(it[2]);
        let nearest = |window: &&[Component]| window.iter().min_by(|a, b| size(a).total_cmp(&size(b))).copied();
        (windows.iter().filter_map(nearest).map(|it| it[axis + 1].powi(2)).sum::<f64>() / count).max(floor)
    });
    let ends = [wide, narrow].map(|start| settled(windows, start));
    let [(wide, wide_likelihood), (narrow, narrow_likelihood)] = ends;
    let variances = if narrow_likelihood > wide_likelihood { narrow } else { wide };
    variances.map(f64::sqrt)
}

/// Variances along and across after steps of expectation and maximisation, m², and the log likelihood at the last.
fn settled(windows: &[&[Component]], start: [f64; 2]) -> ([f64; 2], f64) {
    let mut variances = start;
    let mut likelihood = f64::NEG_INFINITY;
    for _ in 0..STEPS {
        let mut sums = [0.; 2];
        likelihood = 0.;
        for window in windows {
            let (log_density, shares) = log_density(window, variances.map(f64::sqrt));
            likelihood += log_density;
            for (component, share) in window.iter().zip(shares) {
                sums[0] += share * component[1].powi(2);
                sums[1] += share * component[2].powi(2);
            }
        }
        let next = sums.map(|sum| (sum / windows.len().max(1) as f64).max(LEAST_M.powi(2)));
        let moved = next.iter().zip(variances).map(|(new, old)| (new / old - 1.).abs()).fold(0., f64::max);
        if moved < SETTLED {
            break;
        }
        variances = next;
    }
    (variances, likelihood)
}

/// Log of the density of the record, nats, the density per m², and the share of each component in it.
fn log_density(components: &[Component], [along, across]: [f64; 2]) -> (f64, Vec<f64>) {
    let logs = components.iter().map(|[p, dx, dy]| p.ln() - 0.5 * ((dx / along).powi(2) + (dy / across).powi(2)));
    let mut shares: Vec<f64> = logs.collect();
    let largest = shares.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    shares.iter_mut().for_each(|log| *log = (*log - largest).exp());
    let total: f64 = shares.iter().sum();
    shares.iter_mut().for_each(|share| *share /= total);
    (largest + total.ln() - (TAU * along * across).ln(), shares)
}

/// Negative log likelihood of what happened in the last of `frames` frames, nats; the density is per m².
pub(crate) fn negative_log_likelihood(case: &ScoredWindow<'_>, frames: usize, spread: &Spread) -> f64 {
    -log_density(&components(case, frames), [spread.along_m, spread.across_m]).0
}

/// Probability that the forecast gives to less distance along the road than was driven, in the last of `frames` frames.
pub(crate) fn share_below(case: &ScoredWindow<'_>, frames: usize, spread: &Spread) -> f64 {
    let normal = |z: f64| 0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2);
    components(case, frames).iter().map(|[p, dx, _]| p * normal(dx / spread.along_m)).sum()
}

#[cfg(test)]
mod tests;
