//! A Kalman filter of constant velocity: a mean, and how sure it is.

use std::f64::consts::TAU;

use gnp_data::{Forecast, Observation, PredictError, Predictor, Window, WindowShape};
use serde::{Deserialize, Serialize};

use crate::by_site::{BySite, check_shapes};
use crate::motion::{BaselineError, certain};
use crate::rule::{Rule, parameters, parsed};

const NAME: &str = "Kalman filter";

/// Most training windows that the noise is fitted to, evenly chosen: more do not change it.
const FIT_WINDOWS: usize = 2000;

/// The noise is fitted by site.
pub(crate) const RULE: Rule = Rule::new(
    NAME,
    "Constant velocity disturbed by white acceleration, seen through noisy positions; the noise is fitted.",
    |training| {
        let fit = |windows: &[Window<'_>]| {
            let step = windows.len().div_ceil(FIT_WINDOWS).max(1);
            Kalman::fit(&windows.iter().step_by(step).copied().collect::<Vec<_>>())
        };
        parameters(NAME, &BySite::fit(training, fit)?)
    },
    |of| Ok(Box::new(parsed::<BySite<Kalman>>(NAME, of)?.made(|of| Kalman::new(of.noise))?)),
);

/// What is believed of a speed before anything is seen: 0 give or take this, m/s. Large enough that
/// the second frame overrules it.
const SPEED_BEFORE: f64 = 100.;

/// How the filter's model is wrong along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisNoise {
    /// Standard deviation of a recorded position about the true one, m.
    pub position: f64,
    /// Root of the spectral density of a white acceleration, m/s^1.5: after `t` seconds the speed
    /// has wandered by `wander * sqrt(t)`, one standard deviation.
    pub wander: f64,
}

/// A normal distribution of a position, its axes independent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// Mean, m, window frame.
    pub mean: [f64; 2],
    /// Standard deviation of each axis, m.
    pub sigma: [f64; 2],
}

impl Gaussian {
    /// Negative logarithm of the density (per m²) at a position (m), in nats.
    #[must_use]
    pub fn nll(&self, position: [f64; 2]) -> f64 {
        let axis = |i: usize| self.sigma[i].ln() + ((position[i] - self.mean[i]) / self.sigma[i]).powi(2) / 2.;
        TAU.ln() + axis(0) + axis(1)
    }
}

/// Constant velocity, disturbed by white acceleration, seen through noisy positions.
///
/// Each axis is filtered for itself over all observed frames, from positions alone. The means keep
/// the last filtered velocity, which is at least 0 forward; the spreads are those
/// of a *recorded* position, noise included, and do not depend on what was observed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kalman {
    noise: [AxisNoise; 2],
}

impl Kalman {
    /// Noise forward and to the left where nothing else is asked for and nothing is fitted: that of tracks as noisy as those
    /// of US-101. Fitted to smoothed tracks a filter trusts each position to less than a millimetre.
    pub const NOISE: [AxisNoise; 2] =
        [AxisNoise { position: 0.17, wander: 0.92 }, AxisNoise { position: 0.21, wander: 0.16 }];

    /// A filter of the given noise forward and to the left.
    ///
    /// # Errors
    /// When a value is not a positive number.
    pub fn new(noise: [AxisNoise; 2]) -> Result<Self, BaselineError> {
        for (axis, default) in noise.iter().zip(Self::NOISE) {
            for (key, value, default) in
                [("position", axis.position, default.position), ("wander", axis.wander, default.wander)]
            {
                if !(value.is_finite() && value > 0.) {
                    return Err(BaselineError::Parameter { key, value, default });
                }
            }
        }
        Ok(Self { noise })
    }

    /// The noise under which the futures of `windows` (training ones) are likeliest, on average
    /// over predicted frames: each axis by a pattern search to about 1 % of each value.
    ///
    /// # Errors
    /// When there is no window, or they differ in shape or have a single observed frame.
    pub fn fit(windows: &[Window<'_>]) -> Result<Self, BaselineError> {
        check_shapes(windows)?;
        let shape = windows[0].observation().shape();
        let mut noise = Self::NOISE;
        for (axis, noise) in noise.iter_mut().enumerate() {
            *noise = search(*noise, |noise| {
                let filter = Filter::new(noise, shape);
                windows.iter().map(|window| filter.loss(window, axis)).sum()
            });
        }
        Ok(Self { noise })
    }

    /// Noise forward and to the left.
    #[must_use]
    pub fn noise(&self) -> [AxisNoise; 2] {
        self.noise
    }

    /// Where the target will be recorded in each predicted frame.
    ///
    /// # Errors
    /// When the window has a single observed frame.
    pub fn gaussians(&self, observation: &Observation<'_>) -> Result<Vec<Gaussian>, PredictError> {
        let shape = observation.shape();
        let filters = self.filters(shape)?;
        let states = [0, 1].map(|axis| filters[axis].last(observation, axis));
        Ok((0..shape.t_pred)
            .map(|j| Gaussian {
                mean: states.map(|state| state.at((j + 1) as f64 * shape.dt())),
                sigma: [0, 1].map(|axis: usize| filters[axis].variances[j].sqrt()),
            })
            .collect())
    }

    fn filters(&self, shape: WindowShape) -> Result<[Filter; 2], PredictError> {
        if shape.t_obs >= 2 {
            return Ok(self.noise.map(|noise| Filter::new(noise, shape)));
        }
        let found = shape.t_obs.to_string();
        Err(PredictError::Shape { model: NAME.to_owned(), needs: "2 observed frames or more".to_owned(), found })
    }
}

impl Default for Kalman {
    /// With [`Kalman::NOISE`].
    fn default() -> Self {
        Self { noise: Self::NOISE }
    }
}

impl Predictor for Kalman {
    fn name(&self) -> &str {
        NAME
    }

    fn predict(&self, observations: &[Observation<'_>], _k: usize) -> Result<Vec<Forecast>, PredictError> {
        let Some(first) = observations.first() else { return Ok(Vec::new()) };
        let mut shape = first.shape();
        let mut filters = self.filters(shape)?;
        let one = |observation: &Observation<'_>| {
            if observation.shape() != shape {
                shape = observation.shape();
                filters = self.filters(shape)?;
            }
            let states = [0, 1].map(|axis| filters[axis].last(observation, axis));
            Ok(certain(shape, |time| states.map(|state| state.at(time))))
        };
        observations.iter().map(one).collect()
    }
}

/// Mean of position (m) and velocity (m/s) of one axis at the last observed frame.
#[derive(Clone, Copy, Debug)]
struct Mean {
    position: f64,
    velocity: f64,
}

impl Mean {
    fn at(self, time: f64) -> f64 {
        self.position + self.velocity * time
    }
}

/// What does not depend on the observations: a covariance follows from the noise and the times alone.
#[derive(Debug)]
struct Filter {
    shape: WindowShape,
    /// Fraction of an innovation that position and velocity (1/s) take, from the second frame on.
    gains: Vec<[f64; 2]>,
    /// Variance of a recorded position in each predicted frame, m².
    variances: Vec<f64>,
}

impl Filter {
    fn new(noise: AxisNoise, shape: WindowShape) -> Self {
        let (dt, measured) = (shape.dt(), noise.position.powi(2));
        let density = noise.wander.powi(2);
        // Variances of position and velocity, and their covariance, after the first frame.
        let (mut pp, mut pv, mut vv) = (measured, 0., SPEED_BEFORE.powi(2));
        let mut gains = Vec::with_capacity(shape.t_obs);
        let mut variances = Vec::with_capacity(shape.t_pred);
        for frame in 1..shape.t_obs + shape.t_pred {
            pp += dt * (2. * pv + dt * vv) + density * dt.powi(3) / 3.;
            pv += dt * vv + density * dt.powi(2) / 2.;
            vv += density * dt;
            let innovation = pp + measured;
            if frame >= shape.t_obs {
                variances.push(innovation);
                continue;
            }
            let gain = [pp / innovation, pv / innovation];
            vv -= gain[1] * pv;
            pv -= gain[0] * pv;
            pp -= gain[0] * pp;
            gains.push(gain);
        }
        Self { shape, gains, variances }
    }

    fn last(&self, observation: &Observation<'_>, axis: usize) -> Mean {
        let recorded = |frame: usize| {
            let state = observation.target(frame);
            f64::from([state.x, state.y][axis])
        };
        let (mut position, mut velocity) = (recorded(0), 0.);
        for (i, gain) in self.gains.iter().enumerate() {
            position += velocity * self.shape.dt();
            let innovation = recorded(i + 1) - position;
            position += gain[0] * innovation;
            velocity += gain[1] * innovation;
        }
        // Vehicles do not drive backwards.
        Mean { position, velocity: if axis == 0 { velocity.max(0.) } else { velocity } }
    }

    /// Mean over predicted frames of the negative log density along `axis`, less a constant.
    fn loss(&self, window: &Window<'_>, axis: usize) -> f64 {
        let (mean, truth) = (self.last(&window.observation(), axis), window.truth());
        let frame = |(j, variance): (usize, &f64)| {
            let state = truth.target(j);
            let off = f64::from([state.x, state.y][axis]) - mean.at((j + 1) as f64 * self.shape.dt());
            (variance.ln() + off * off / variance) / 2.
        };
        self.variances.iter().enumerate().map(frame).sum::<f64>() / self.variances.len() as f64
    }
}

/// The noise with the smallest `loss` near `start`: a pattern search over the logarithms.
fn search(start: AxisNoise, loss: impl Fn(AxisNoise) -> f64) -> AxisNoise {
    const BOUNDS: [f64; 2] = [1e-4, 1e2];
    let (mut best, mut factor) = (start, 4f64);
    let mut least = loss(best);
    while factor > 1.01 {
        let mut moved = false;
        for [position, wander] in [[1., factor], [1., 1. / factor], [factor, 1.], [1. / factor, 1.]] {
            let tried = AxisNoise {
                position: (best.position * position).clamp(BOUNDS[0], BOUNDS[1]),
                wander: (best.wander * wander).clamp(BOUNDS[0], BOUNDS[1]),
            };
            let value = loss(tried);
            if value < least {
                (best, least, moved) = (tried, value, true);
            }
        }
        if !moved {
            factor = factor.sqrt();
        }
    }
    best
}
