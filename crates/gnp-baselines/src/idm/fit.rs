//! Drivers of the Intelligent Driver Model fitted to training windows by least squares.

use argmin::core::{CostFunction, Error, Executor, State as _};
use argmin::solver::neldermead::NelderMead;
use gnp_data::{Window, WindowShape};
use rayon::prelude::*;

use super::{Follower, Idm, IdmParameters, NAME};
use crate::motion::BaselineError;
use crate::span::whole_seconds;

/// Windows a fit looks at; of more, every n-th.
const MOST_WINDOWS: usize = 1000;
/// Steps of the search; it ends sooner where it finds nothing better.
const STEPS: u64 = 250;
/// Spread of the squared error among the corners of the search at which it ends, relative.
const TOLERANCE: f64 = 1e-5;
/// Weight of the textbook's values beside the windows, in windows: where these say little, they stay.
const PRIOR_WINDOWS: f64 = 5.;

/// Where a parameter that is fitted stands.
type Place = fn(&mut IdmParameters) -> &mut f64;

/// What is fitted, with the range that drivers of motorways have.
const FITTED: [(Place, [f64; 2]); 5] = [
    (|p| &mut p.desired_speed, [15., 50.]),
    (|p| &mut p.headway, [0.4, 2.5]),
    (|p| &mut p.standstill_gap, [0.5, 6.]),
    (|p| &mut p.acceleration, [0.2, 2.5]),
    (|p| &mut p.braking, [0.5, 4.]),
];

/// A window reduced to what a fit needs: the driver, and the true position after each whole second, m.
struct Case {
    follower: Follower,
    truth: Vec<f64>,
}

struct Problem {
    cases: Vec<Case>,
    start: IdmParameters,
    shape: WindowShape,
    seconds: Vec<usize>,
}

/// The drivers with the least squared error, near `start` where windows say little; `start` where none has a leader.
pub(super) fn fit(windows: &[Window<'_>], start: IdmParameters) -> Result<IdmParameters, BaselineError> {
    let shape = windows.first().ok_or(BaselineError::NoWindows)?.observation().shape();
    let failed = |source: Error| BaselineError::Rule { rule: NAME.to_owned(), source: source.into() };
    let seconds = whole_seconds(shape);
    let mut cases = Vec::new();
    for window in windows {
        let follower = Follower::of(&window.observation(), start.span_s).map_err(|source| failed(source.into()))?;
        if follower.leader.is_some() {
            let truth = seconds.iter().map(|step| f64::from(window.truth().target(step - 1).x)).collect();
            cases.push(Case { follower, truth });
        }
    }
    let step = cases.len().div_ceil(MOST_WINDOWS).max(1);
    let cases: Vec<Case> = cases.into_iter().step_by(step).collect();
    if cases.is_empty() {
        return Ok(start);
    }
    Problem { cases, start, shape, seconds }.solve().map_err(failed)
}

impl Problem {
    fn solve(&self) -> Result<IdmParameters, Error> {
        let start = self.coordinates();
        let mut corners = vec![start.clone()];
        corners.extend((0..start.len()).map(|i| {
            let mut corner = start.clone();
            corner[i] += if corner[i] > 0. { -0.7 } else { 0.7 };
            corner
        }));
        let solver = NelderMead::new(corners).with_sd_tolerance(TOLERANCE * self.cost(&start)?)?;
        let found = Executor::new(self, solver).configure(|state| state.max_iters(STEPS)).run()?;
        Ok(self.parameters(found.state().get_best_param().unwrap_or(&start)))
    }

    fn parameters(&self, at: &[f64]) -> IdmParameters {
        let mut parameters = self.start;
        for ((place, [low, high]), at) in FITTED.iter().zip(at) {
            *place(&mut parameters) = low + (high - low) / (1. + (-at).exp());
        }
        parameters
    }

    /// Where `start` stands in the search.
    fn coordinates(&self) -> Vec<f64> {
        let of = |(place, [low, high]): &(Place, [f64; 2])| {
            let share = (*place(&mut { self.start }) - low) / (high - low);
            (share / (1. - share)).ln()
        };
        FITTED.iter().map(of).collect()
    }
}

impl CostFunction for Problem {
    type Param = Vec<f64>;
    type Output = f64;

    /// Mean squared error, m², and what departs from the start.
    fn cost(&self, at: &Vec<f64>) -> Result<f64, Error> {
        let idm = Idm { parameters: self.parameters(at) };
        let of_case = |case: &Case| -> f64 {
            let path: Vec<f64> = idm.roll_out(&case.follower, self.shape).collect();
            self.seconds.iter().zip(&case.truth).map(|(step, x)| (path[step - 1] - x).powi(2)).sum()
        };
        // In the order of the windows, so that the sum has the same bits on any number of threads.
        let squares: Vec<f64> = self.cases.par_iter().with_min_len(32).map(of_case).collect();
        let values = (self.cases.len() * self.seconds.len()) as f64;
        let departed: f64 = at.iter().zip(self.coordinates()).map(|(at, start)| (at - start).powi(2)).sum();
        Ok(squares.iter().sum::<f64>() / values + departed * PRIOR_WINDOWS / self.cases.len() as f64)
    }
}

impl CostFunction for &Problem {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, at: &Vec<f64>) -> Result<f64, Error> {
        Problem::cost(self, at)
    }
}
