//! The numbers of MOBIL from recorded lane changes.
use super::{
    error::DriverError,
    fit::FittedTraffic,
    situations::{Gain, Situation, Situations, longest, situations},
};
use argmin::core::{CostFunction, Error, Executor, State};
use argmin::solver::neldermead::NelderMead;
use gnp_data::{Recording, Track};
use gnp_force::Mobil;
use rayon::prelude::*;

/// Fewer changes say nothing about four numbers.
const LEAST_CHANGES: usize = 10;
/// Steps of the search.
const STEPS: u64 = 600;
/// Spread of the cost among the corners of the search at which it ends.
const TOLERANCE: f64 = 1e-5;
/// Mean and standard deviation of the prior: of politeness, of the preference for the right (m/s²), and of the logarithm
/// of the unsteadiness in m/s².
const PRIOR: [[f64; 2]; 3] = [[0.2, 0.3], [0., 0.2], [-1.2, 1.]];
/// Gains beyond count as this, m/s²: where a recorded gap is far from the one that a driver's model desires, the model says
/// more than the driver feels.
const MOST_GAIN: f64 = 1.5;
/// Gain of log-likelihood from which politeness and preference are believed: three numbers more than a constant rate has
/// (Akaike 1974).
const LEAST_GAIN: f64 = 3.;
/// Thresholds tried, m/s²: the greatest, and how many.
const THRESHOLDS: (f64, usize) = (4., 401);

/// How the drivers of recordings change lanes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaneChangeFit {
    /// The rule; [`Mobil::standard`] where too few changes are recorded.
    pub mobil: Mobil<f64>,
    /// Recorded changes to the left.
    pub to_left: usize,
    /// Recorded changes to the right.
    pub to_right: usize,
    /// Way driven by all vehicles, km.
    pub vehicle_km: f64,
    /// Moments, one a second of every vehicle, at which somebody could have changed.
    pub situations: usize,
    /// Changes per vehicle kilometre of simulated drivers; none where they were not compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulated_per_vehicle_km: Option<f64>,
    /// How it was fitted; none where too few changes are recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub likelihood: Option<LaneChangeLikelihood>,
}

/// How well a fit tells who changes lanes, and when.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaneChangeLikelihood {
    /// Changes out of a situation in which the side was safe and had room.
    pub changes: usize,
    /// Logarithm of the likelihood, less that of a constant rate on every side that could be taken.
    pub gain: f64,
    /// Gain at which a driver changes within a second with probability one half, m/s².
    pub threshold: f64,
    /// How uncertain the decision is: the scale of the logistic choice, m/s².
    pub spread: f64,
    /// How often drivers come to want a change by the rule with its threshold: as often as they did, as far as a
    /// threshold of 0 or more allows.
    pub wishes: usize,
}

impl LaneChangeFit {
    /// Recorded changes per vehicle kilometre.
    #[must_use]
    pub fn per_vehicle_km(&self) -> f64 {
        (self.to_left + self.to_right) as f64 / self.vehicle_km.max(1e-9)
    }
}

/// Fits politeness, threshold and preference for the right lane to recorded lane changes.
///
/// Once a second every driver, unless he is changing or did within 3 s, chooses between staying and the sides that are
/// safe and have room: a logistic choice by the incentive of [`Mobil`], from the accelerations of the drivers in
/// `traffic`; he chose a side if he begins to move there within the second, and crosses the line. Politeness, preference
/// and scale have a weak prior; where all this explains no more than a constant rate does, politeness is that of
/// [`Mobil::standard`] and neither side is preferred.
///
/// A rule without chance changes lanes as soon as it wants to, and drivers do not: the threshold of the result is therefore
/// the least one at which drivers, where they were recorded, come to want a change at most as often as they made one.
/// [`DriverDistribution::fit`](super::DriverDistribution::fit) goes on to the rate in simulated traffic.
///
/// Fewer than 10 changes are not fitted. Changes that drivers must make, at exits and where lanes end, are not told from
/// others.
///
/// # Errors
/// [`DriverError::Search`] when the search fails.
pub fn fit_lane_changes(recordings: &[Recording], traffic: &FittedTraffic) -> Result<LaneChangeFit, DriverError> {
    let seen_in = traffic.config.shared_vehicles.then(|| longest(recordings));
    let of_recording = |(number, recording): (usize, &Recording)| {
        let counts = |track: &Track| seen_in.as_ref().is_none_or(|of| of.get(&track.vehicle) == Some(&number));
        situations(recording, number, traffic, counts)
    };
    let found: Vec<Situations> = recordings.par_iter().enumerate().map(of_recording).collect();
    let sum = |side: usize| found.iter().map(|it| it.changes[side]).sum();
    let could =
        |it: &&Situation| it.sides.iter().any(Option::is_some) && it.taken.is_none_or(|s| it.sides[s].is_some());
    let all: Vec<Situation> = found.iter().flat_map(|it| &it.all).filter(could).copied().collect();
    let changes = all.iter().filter(|it| it.taken.is_some()).count();
    let fit = LaneChangeFit {
        mobil: Mobil::standard(),
        to_left: sum(0),
        to_right: sum(1),
        vehicle_km: found.iter().map(|it| it.vehicle_km).sum(),
        situations: all.len(),
        simulated_per_vehicle_km: None,
        likelihood: None,
    };
    if changes < LEAST_CHANGES {
        return Ok(fit);
    }
    let problem = Problem { situations: &all };
    let mut choice = problem.fit().map_err(|error| DriverError::Search(error.to_string()))?;
    let gain = problem.log_likelihood(&choice) - base(&all, changes);
    if gain < LEAST_GAIN {
        choice = Choice { politeness: fit.mobil.politeness, keep_right: 0., ..choice };
    }
    let (threshold, wishes) = calibrated(&all, &choice, changes);
    let Choice { politeness, threshold: even, keep_right, spread } = choice;
    let likelihood = LaneChangeLikelihood { changes, gain, threshold: even, spread, wishes };
    let mobil = Mobil { politeness, threshold, keep_right, ..fit.mobil };
    Ok(LaneChangeFit { mobil, likelihood: Some(likelihood), ..fit })
}

/// Log-likelihood of a constant rate on every side that could be taken.
fn base(situations: &[Situation], changes: usize) -> f64 {
    let open = |it: &Situation| it.sides.iter().flatten().count() as f64;
    let sides: f64 = situations.iter().map(open).sum();
    let rate = changes as f64 / sides;
    let of = |it: &Situation| if it.taken.is_some() { rate } else { 1. - rate * open(it) };
    situations.iter().map(|it| of(it).max(f64::MIN_POSITIVE).ln()).sum()
}

/// The least threshold at which wishes are at most as many as changes, and how many they then are.
fn calibrated(situations: &[Situation], choice: &Choice, changes: usize) -> (f64, usize) {
    let wanted: Vec<f64> = situations.iter().map(|it| choice.best(it)).collect();
    let wishes = |threshold: f64| {
        let begins = |i: &usize| {
            let before = i.checked_sub(1).filter(|before| situations[*before].key == situations[*i].key);
            wanted[*i] > threshold && before.is_none_or(|before| wanted[before] <= threshold)
        };
        (0..wanted.len()).filter(begins).count()
    };
    let (most, count) = THRESHOLDS;
    let tried =
        (0..count).map(|i| most * i as f64 / (count - 1) as f64).map(|threshold| (threshold, wishes(threshold)));
    let mut last = (most, 0);
    for it in tried {
        last = it;
        if it.1 <= changes {
            break;
        }
    }
    last
}

/// A driver who chooses.
#[derive(Clone, Copy, Debug)]
struct Choice {
    politeness: f64,
    threshold: f64,
    keep_right: f64,
    spread: f64,
}

impl Choice {
    /// At coordinates of the search, in which every number is free.
    fn at(at: &[f64]) -> Self {
        let get = |i: usize| at.get(i).copied().unwrap_or_default();
        Self { politeness: get(0).max(0.), threshold: get(1), keep_right: get(2), spread: get(3).clamp(-7., 3.).exp() }
    }

    /// What a side is worth before the threshold, m/s².
    fn worth(&self, side: usize, gain: &Gain) -> f64 {
        let right = if side == 1 { self.keep_right } else { -self.keep_right };
        let [own, others] = [gain.own, gain.others].map(|gain| gain.clamp(-MOST_GAIN, MOST_GAIN));
        own + self.politeness * others + right
    }

    /// Of the better side.
    fn best(&self, situation: &Situation) -> f64 {
        let worth = |(side, gain): (usize, &Option<Gain>)| gain.as_ref().map(|gain| self.worth(side, gain));
        situation.sides.iter().enumerate().filter_map(worth).fold(f64::NEG_INFINITY, f64::max)
    }
}

struct Problem<'a> {
    situations: &'a [Situation],
}

impl Problem<'_> {
    fn log_likelihood(&self, choice: &Choice) -> f64 {
        let of = |it: &Situation| {
            let utility =
                |side: usize| it.sides[side].map(|gain| (choice.worth(side, &gain) - choice.threshold) / choice.spread);
            let sides = [utility(0), utility(1)];
            let most = sides.iter().flatten().fold(0., |most: f64, it| most.max(*it));
            let sum = (-most).exp() + sides.iter().flatten().map(|it| (it - most).exp()).sum::<f64>();
            it.taken.and_then(|side| sides[side]).unwrap_or(0.) - most - sum.ln()
        };
        self.situations.iter().map(of).sum()
    }

    fn fit(&self) -> Result<Choice, Error> {
        let start = vec![0.2, 1., 0., -1.2];
        let mut corners = vec![start.clone()];
        corners.extend([0.3, 0.5, 0.3, 0.7].into_iter().enumerate().map(|(i, step)| {
            let mut corner = start.clone();
            corner[i] += step;
            corner
        }));
        let solver = NelderMead::new(corners).with_sd_tolerance(TOLERANCE)?;
        let found = Executor::new(self, solver).configure(|state| state.max_iters(STEPS)).run()?;
        Ok(Choice::at(&found.state().get_best_param().cloned().unwrap_or(start)))
    }
}

impl CostFunction for &Problem<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    /// The negative logarithm of the posterior density, but for a constant.
    fn cost(&self, at: &Vec<f64>) -> Result<f64, Error> {
        let numbers = [at[0], at[2], at[3]];
        let departed = numbers.iter().zip(PRIOR).map(|(at, [mean, spread])| ((at - mean) / spread).powi(2) / 2.);
        Ok(departed.sum::<f64>() - self.log_likelihood(&Choice::at(at)))
    }
}
