//! How unsteady drivers are: the acceleration that their model does not explain.
use super::stretches::Stretch;
use crate::chance::mix;
use gnp_force::{Driver, Noise};

/// Time over which accelerations are differenced, s. Noise of measurement reaches no farther; beyond it only what the
/// driver does is correlated.
const WINDOW_S: f64 = 1.;
/// Longest lag looked at, s.
const LONGEST_S: f64 = 5.;
/// Lags looked at.
const LAGS: usize = 17;
/// Correlation times tried, s: from, ratio from one to the next, and how many.
const TIMES: (f64, f64, i32) = (1., 1.05, 48);
/// Modelled braking from which the model, not the driver, is unsteady: where a recorded gap is far below the one that it
/// desires, m/s².
const HARD: f64 = -3.;
/// Fewer pairs of residuals at a lag say nothing, in seconds.
const LEAST_S: f64 = 20.;

/// The unsteadiness of drivers as an Ornstein-Uhlenbeck process; none where too little is recorded.
///
/// Its correlation time, and the most that its standard deviation can be, are those of [`residual`]. What is left there
/// is also what is wrong with model and measurement; the standard deviation is therefore not more than what makes drivers
/// deviate from their steady selves, in closed loop, as far as from the recorded ones.
pub(super) fn unsteadiness(of: &[(&Stretch, Driver<f64>)]) -> Option<Noise<f64>> {
    let most = residual(of)?;
    let (mut recorded, mut wandered) = (0., 0.);
    for (number, (stretch, driver)) in of.iter().enumerate() {
        let mut steady = vec![0.; stretch.own.len()];
        stretch.roll_out(driver, || 0., |at, x| steady[at] = x);
        let kept = (-stretch.dt / most.correlation).exp();
        let (mut step, mut value) = (0, most.sigma * normal(number as u64, 0));
        let wander = || {
            step += 1;
            value = value * kept + most.sigma * (1. - kept * kept).sqrt() * normal(number as u64, step);
            value
        };
        stretch.roll_out(driver, wander, |at, x| {
            wandered += (x - steady[at]).powi(2);
            recorded += (stretch.own[at][0] - steady[at]).powi(2);
        });
    }
    let share = if wandered > 0. { (recorded / wandered).sqrt().min(1.) } else { 1. };
    Some(Noise { sigma: most.sigma * share, ..most })
}

/// A standard normal number for a stretch and a step, by Box and Muller.
fn normal(stretch: u64, step: u64) -> f64 {
    let key = mix(stretch ^ mix(step));
    let uniform = |bits: u64| ((bits >> 11) + 1) as f64 / (1_u64 << 53) as f64;
    (-2. * uniform(mix(key ^ 1)).ln()).sqrt() * (std::f64::consts::TAU * uniform(mix(key ^ 2))).cos()
}

/// The process whose autocovariance, over lags from 1.2 s to 5 s, is nearest to that of the residuals of drivers in their
/// recorded places.
///
/// Averaged over a window `w` the process has the covariance `sigma² exp(-lag / c) (sinh(h) / h)²`, `h = w / 2c`.
fn residual(of: &[(&Stretch, Driver<f64>)]) -> Option<Noise<f64>> {
    let lags = (0..LAGS).map(|i| WINDOW_S + 0.2 + (LONGEST_S - WINDOW_S - 0.2) * i as f64 / (LAGS - 1) as f64);
    let lags: Vec<f64> = lags.collect();
    let mut sums = [[0.; 2]; LAGS];
    for (stretch, driver) in of {
        let residuals = residuals(stretch, driver);
        for (sum, lag) in sums.iter_mut().zip(&lags) {
            let later = residuals.get((lag / stretch.dt).round() as usize..).unwrap_or_default();
            for (a, b) in residuals.iter().zip(later).filter_map(|(a, b)| Some(((*a)?, (*b)?))) {
                *sum = [sum[0] + a * b * stretch.dt, sum[1] + stretch.dt];
            }
        }
    }
    let told: Vec<(f64, f64, f64)> = lags
        .iter()
        .zip(&sums)
        .filter(|(_, [_, weight])| *weight >= LEAST_S)
        .map(|(lag, [sum, weight])| (*lag, sum / weight, *weight))
        .collect();
    if told.len() < LAGS / 2 {
        return None;
    }
    let (from, ratio, count) = TIMES;
    let fits = (0..count).map(|i| {
        let correlation = from * ratio.powi(i);
        let half = WINDOW_S / 2. / correlation;
        let shape = |lag: f64| (-lag / correlation).exp() * (half.sinh() / half).powi(2);
        let [above, below] = told.iter().fold([0.; 2], |[above, below], (lag, covariance, weight)| {
            [above + weight * covariance * shape(*lag), below + weight * shape(*lag).powi(2)]
        });
        let variance = (above / below).max(0.);
        let left = |(lag, covariance, weight): &(f64, f64, f64)| weight * (covariance - variance * shape(*lag)).powi(2);
        (told.iter().map(left).sum::<f64>(), Noise { sigma: variance.sqrt(), correlation })
    });
    fits.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, noise)| noise)
}

/// Recorded less modelled acceleration, each over a window, m/s²; none where the model brakes hard.
fn residuals(stretch: &Stretch, driver: &Driver<f64>) -> Vec<Option<f64>> {
    let window = (WINDOW_S / stretch.dt).round().max(1.) as usize;
    let modelled: Vec<f64> = (0..stretch.own.len()).map(|at| stretch.acceleration(driver, at)).collect();
    let span = window as f64 * stretch.dt;
    let pairs = stretch.raw_speed.iter().zip(stretch.raw_speed.iter().skip(window));
    let modelled = modelled.windows(window).map(|of| of.iter().sum::<f64>() / window as f64);
    let left = |((from, to), modelled): ((&f64, &f64), f64)| (modelled > HARD).then(|| (to - from) / span - modelled);
    pairs.zip(modelled).map(left).collect()
}
