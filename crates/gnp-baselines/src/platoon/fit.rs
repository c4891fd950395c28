//! Drivers fitted to training windows by least squares, with intervals.

use std::collections::{BTreeMap, BTreeSet};

use argmin::core::{CostFunction, Error, Executor, State};
use argmin::solver::neldermead::NelderMead;
use gnp_data::{Window, WindowShape};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::traffic::Traffic;
use super::{ActingTerms, Drivers, FittedDrivers, Motion, PlatoonParameters, PlatoonRule, roll_out, spans};
use crate::by_site::LEAST_VEHICLES;
use crate::motion::BaselineError;

/// Windows a fit looks at; of more, every n-th.
const MOST_WINDOWS: usize = 1000;
/// Steps of the search; it ends sooner where it finds nothing better.
const STEPS: u64 = 250;
/// Spread of the squared error among the corners of the search at which it ends, relative.
const TOLERANCE: f64 = 1e-5;
/// Weight of the typical value of a parameter beside the windows, in windows: where these say little, it stays.
const PRIOR_WINDOWS: f64 = 5.;

/// A parameter that is fitted: its name, where it stands, and the range that drivers of motorways have.
struct Parameter {
    name: &'static str,
    of: fn(&mut Drivers) -> &mut f64,
    range: [f64; 2],
}

const fn parameter(name: &'static str, of: fn(&mut Drivers) -> &mut f64, range: [f64; 2]) -> Parameter {
    Parameter { name, of, range }
}

const FITTED: [Parameter; 7] = [
    parameter("time_gap", |d| &mut d.time_gap, [0.4, 2.5]),
    parameter("own_gap", |d| &mut d.own_gap, [0., 1.]),
    parameter("acceleration", |d| &mut d.acceleration, [0.3, 2.5]),
    parameter("braking", |d| &mut d.braking, [1., 4.]),
    parameter("habit", |d| &mut d.habit, [0.005, 1.]),
    parameter("slow_habit", |d| &mut d.slow_habit, [0., 1.]),
    parameter("decay", |d| &mut d.decay, [1., 10.]),
];

/// A window reduced to what a fit needs.
struct Case {
    site: String,
    vehicle: (String, u32),
    column: Traffic,
    /// True position after each whole second, with its step.
    truth: Vec<(usize, f64)>,
}

/// Fits the drivers of every site and of all together.
///
/// # Errors
/// [`BaselineError::NoWindows`]; [`BaselineError::Shapes`] for windows of several shapes; [`BaselineError::Rule`] where the
/// search fails.
pub(super) fn fit(training: &[Window<'_>]) -> Result<PlatoonParameters, BaselineError> {
    let shape = training.first().ok_or(BaselineError::NoWindows)?.observation().shape();
    if training.iter().any(|window| !window.observation().shape().fits(&shape)) || shape.t_obs < 2 {
        return Err(BaselineError::Shapes);
    }
    let possible = |case: &Case| {
        let (mut followers, mut motion) = (Vec::new(), Motion::default());
        let rolled =
            roll_out(&Drivers::TYPICAL, case.column.vehicles(), &shape, ActingTerms::ALL, &mut followers, &mut motion);
        rolled.is_ok() && !case.truth.is_empty()
    };
    let all: Vec<Case> = training.par_iter().map(|window| case(window, shape)).collect();
    let (cases, left_out): (Vec<Case>, Vec<Case>) = all.into_iter().partition(possible);
    if cases.is_empty() {
        return Err(BaselineError::NoWindows);
    }
    let mut drivers: BTreeMap<&str, BTreeSet<&(String, u32)>> = BTreeMap::new();
    for case in &cases {
        drivers.entry(&case.site).or_default().insert(&case.vehicle);
    }
    let fitted = |site: Option<&str>| -> Result<FittedDrivers, BaselineError> {
        let here = |case: &&Case| site.is_none_or(|site| case.site == site);
        let of_site: Vec<&Case> = cases.iter().filter(here).collect();
        let step = of_site.len().div_ceil(MOST_WINDOWS).max(1);
        let taken: Vec<&Case> = of_site.into_iter().step_by(step).collect();
        let fitted = Problem::new(taken, shape).fit();
        let fitted =
            fitted.map_err(|e| BaselineError::Rule { rule: PlatoonRule::NAME.to_owned(), source: e.into() })?;
        Ok(FittedDrivers { left_out: left_out.iter().filter(here).count(), ..fitted })
    };
    // One site alone is what all together are.
    let own = drivers.iter().filter(|(_, vehicles)| drivers.len() > 1 && vehicles.len() >= LEAST_VEHICLES);
    let sites = own.map(|(site, _)| Ok(((*site).to_owned(), fitted(Some(site))?)));
    Ok(PlatoonParameters { sites: sites.collect::<Result<_, BaselineError>>()?, pooled: fitted(None)? })
}

fn case(window: &Window<'_>, shape: WindowShape) -> Case {
    let (observation, truth) = (window.observation(), window.truth());
    let key = window.key();
    let per_second = shape.rate_hz.round().max(1.) as usize;
    let steps = (per_second..=shape.t_pred).step_by(per_second);
    let truth: Vec<(usize, f64)> = steps.map(|step| (step, f64::from(truth.target(step - 1).x))).collect();
    Case {
        site: observation.site().to_owned(),
        vehicle: (key.recording, key.vehicle),
        column: Traffic::of(&observation, spans(shape)).target_alone(),
        truth,
    }
}

/// Windows, and the squared error of drivers on them.
struct Problem<'a> {
    cases: Vec<&'a Case>,
    vehicles: Vec<usize>,
    shape: WindowShape,
}

impl<'a> Problem<'a> {
    fn new(cases: Vec<&'a Case>, shape: WindowShape) -> Self {
        let names: BTreeSet<_> = cases.iter().map(|case| &case.vehicle).collect();
        let number: BTreeMap<_, usize> = names.into_iter().zip(0..).collect();
        let vehicles = cases.iter().map(|case| number[&case.vehicle]).collect();
        Self { cases, vehicles, shape }
    }

    /// Errors after each whole second of every window, m.
    fn errors(&self, drivers: &Drivers) -> Vec<Vec<f64>> {
        let room = || (Vec::new(), Motion::default());
        let of_case = |(followers, motion): &mut (Vec<_>, Motion), case: &&Case| match roll_out(
            drivers,
            case.column.vehicles(),
            &self.shape,
            ActingTerms::ALL,
            followers,
            motion,
        ) {
            Ok(()) => case.truth.iter().map(|(step, x)| motion.position(Traffic::TARGET, *step) - x).collect(),
            Err(_) => vec![0.; case.truth.len()],
        };
        self.cases.par_iter().with_min_len(32).map_init(room, of_case).collect()
    }

    fn fit(&self) -> Result<FittedDrivers, Error> {
        let start: Vec<f64> = FITTED.iter().map(|parameter| parameter.coordinate(&Drivers::TYPICAL)).collect();
        let mut corners = vec![start.clone()];
        corners.extend((0..start.len()).map(|i| {
            let mut corner = start.clone();
            corner[i] += if corner[i] > 0. { -0.7 } else { 0.7 };
            corner
        }));
        let solver = NelderMead::new(corners).with_sd_tolerance(TOLERANCE * self.cost(&start)?)?;
        let found = Executor::new(self, solver).configure(|state| state.max_iters(STEPS)).run()?;
        let best = found.state().get_best_param().cloned().unwrap_or(start);
        let drivers = drivers(&best);
        Ok(FittedDrivers {
            intervals: self.intervals(&best),
            drivers,
            windows: self.cases.len(),
            left_out: 0,
            vehicles: self.vehicles.iter().collect::<BTreeSet<_>>().len(),
        })
    }

    /// Intervals by the sandwich estimator with vehicles as clusters, in the coordinates of the search; a parameter that
    /// the windows do not tell has its whole range.
    fn intervals(&self, at: &[f64]) -> BTreeMap<String, [f64; 2]> {
        let flat = |at: &[f64]| -> Vec<f64> { self.errors(&drivers(at)).concat() };
        let (errors, count) = (flat(at), at.len());
        let mut jacobian = DMatrix::zeros(errors.len(), count);
        for i in 0..count {
            let moved = |by: f64| {
                flat(&at.iter().enumerate().map(|(j, v)| v + if i == j { by } else { 0. }).collect::<Vec<_>>())
            };
            let (up, down) = (moved(STEP), moved(-STEP));
            let column = up.iter().zip(&down).map(|(up, down)| (up - down) / (2. * STEP));
            jacobian.set_column(i, &DVector::from_iterator(errors.len(), column));
        }
        let per_window = errors.len() / self.cases.len().max(1);
        let mut scores = vec![DVector::<f64>::zeros(count); self.vehicles.iter().max().map_or(0, |most| most + 1)];
        for (row, error) in errors.iter().enumerate() {
            scores[self.vehicles[row / per_window.max(1)]] += jacobian.row(row).transpose() * *error;
        }
        let meat = scores.iter().fold(DMatrix::zeros(count, count), |sum, score| sum + score * score.transpose());
        let hessian = jacobian.transpose() * &jacobian;
        let bread = (&hessian + DMatrix::identity(count, count) * 1e-9).try_inverse();
        let vehicles = self.vehicles.iter().collect::<BTreeSet<_>>().len() as f64;
        let spread = |i: usize| match &bread {
            // Of as few vehicles as parameters, the scores say nothing about their spread.
            Some(bread) if hessian[(i, i)] > 1e-6 && vehicles > count as f64 + 1. => {
                ((bread * &meat * bread)[(i, i)].max(0.) * vehicles / (vehicles - 1.)).sqrt()
            }
            _ => f64::INFINITY,
        };
        let ends = |i: usize| [-1.96, 1.96].map(|z| FITTED[i].value(at[i] + (z * spread(i)).clamp(-30., 30.)));
        FITTED.iter().enumerate().map(|(i, parameter)| (parameter.name.to_owned(), ends(i))).collect()
    }
}

/// Step of the numerical derivative, in the coordinates of the search.
const STEP: f64 = 1e-3;

impl CostFunction for &Problem<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    /// Mean squared error, m², and what departs from typical values.
    fn cost(&self, at: &Vec<f64>) -> Result<f64, Error> {
        Problem::cost(self, at)
    }
}

impl Problem<'_> {
    fn cost(&self, at: &[f64]) -> Result<f64, Error> {
        let squares: f64 = self.errors(&drivers(at)).iter().flatten().map(|error| error * error).sum();
        let values = self.cases.iter().map(|case| case.truth.len()).sum::<usize>().max(1);
        let typical = FITTED.iter().map(|parameter| parameter.coordinate(&Drivers::TYPICAL));
        let departed: f64 = at.iter().zip(typical).map(|(at, typical)| (at - typical).powi(2)).sum();
        Ok(squares / values as f64 + departed * PRIOR_WINDOWS / self.cases.len().max(1) as f64)
    }
}

/// Drivers at coordinates of the search.
fn drivers(at: &[f64]) -> Drivers {
    let mut drivers = Drivers::TYPICAL;
    for (parameter, at) in FITTED.iter().zip(at) {
        *(parameter.of)(&mut drivers) = parameter.value(*at);
    }
    drivers
}

impl Parameter {
    /// The value at a coordinate: the whole line is the range, by a logistic curve.
    fn value(&self, at: f64) -> f64 {
        let [low, high] = self.range;
        low + (high - low) / (1. + (-at).exp())
    }

    /// The coordinate of its value.
    fn coordinate(&self, drivers: &Drivers) -> f64 {
        let [low, high] = self.range;
        let share = ((*(self.of)(&mut { *drivers }) - low) / (high - low)).clamp(1e-6, 1. - 1e-6);
        (share / (1. - share)).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_lead_back_to_the_values() {
        for parameter in FITTED {
            let found = parameter.value(parameter.coordinate(&Drivers::TYPICAL));
            let typical = *(parameter.of)(&mut { Drivers::TYPICAL });
            assert!((found - typical).abs() < 1e-9, "{}: {found}", parameter.name);
            assert!((parameter.range[0]..=parameter.range[1]).contains(&typical), "{}", parameter.name);
        }
    }
}
