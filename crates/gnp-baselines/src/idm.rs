//! The Intelligent Driver Model along the lane.

use gnp_data::{Forecast, Mode, Observation, PredictError, Predictor, Window, WindowShape};
use serde::{Deserialize, Serialize};

use crate::by_site::BySite;
use crate::motion::{BaselineError, periods, slope, velocity};
use crate::rule::{Rule, parameters, parsed};
use crate::velocity::ConstantVelocity;

mod fit;

const NAME: &str = "IDM";

/// Drivers are fitted by site.
pub(crate) const RULE: Rule = Rule::new(
    NAME,
    "Every vehicle follows the one ahead as the Intelligent Driver Model says and stays in its lane.",
    |training| parameters(NAME, &BySite::fit(training, |windows| Ok(Idm::fit(windows)?.parameters))?),
    |of| Ok(Box::new(parsed::<BySite<IdmParameters>>(NAME, of)?.made(Idm::new)?)),
);

/// No vehicle brakes harder than this, m/s²: dry asphalt.
const HARDEST_BRAKING: f64 = 9.;

/// Gaps below this count as this, m: boxes overlap in recordings, and the model divides by the gap.
const LEAST_GAP: f64 = 0.1;

/// What a driver wants.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdmParameters {
    /// Speed on an empty road, m/s.
    pub desired_speed: f64,
    /// Time to the vehicle ahead, s.
    pub headway: f64,
    /// Distance to the vehicle ahead when stationary, bumper to bumper, m.
    pub standstill_gap: f64,
    /// Acceleration of a stationary vehicle on an empty road, m/s².
    pub acceleration: f64,
    /// Comfortable braking, a positive number, m/s².
    pub braking: f64,
    /// Time in which a speed sideways dies away to 1/e, s. Not of the model, which has one dimension.
    pub settling: f64,
    /// Time that speeds are estimated from, s. Not of the model either.
    pub span_s: f64,
}

impl IdmParameters {
    /// Motorway drivers: Treiber, Kesting, *Traffic Flow Dynamics* (2013), table 11.2. A fit starts from them.
    pub const MOTORWAY: Self = Self {
        desired_speed: 120. / 3.6,
        headway: 1.,
        standstill_gap: 2.,
        acceleration: 1.,
        braking: 1.5,
        settling: 1.,
        span_s: ConstantVelocity::SPAN_S,
    };

    /// The values the model was proposed with: Treiber, Hennecke, Helbing, *Congested traffic states
    /// in empirical observations and microscopic simulations*, Phys. Rev. E 62 (2000), table I.
    pub const PROPOSED: Self = Self { headway: 1.6, acceleration: 0.73, braking: 1.67, ..Self::MOTORWAY };

    fn check(&self) -> Result<(), BaselineError> {
        let default = Self::MOTORWAY;
        let all = [
            ("desired_speed", self.desired_speed, default.desired_speed),
            ("headway", self.headway, default.headway),
            ("standstill_gap", self.standstill_gap, default.standstill_gap),
            ("acceleration", self.acceleration, default.acceleration),
            ("braking", self.braking, default.braking),
            ("settling", self.settling, default.settling),
            ("span_s", self.span_s, default.span_s),
        ];
        match all.into_iter().find(|(_, value, _)| !(value.is_finite() && *value > 0.)) {
            Some((key, value, default)) => Err(BaselineError::Parameter { key, value, default }),
            None => Ok(()),
        }
    }
}

/// Every vehicle follows the one ahead as the Intelligent Driver Model says and stays in the lane.
///
/// The leader is that of the last observed frame ([`Observation::leader`]), recorded or named; it goes on at its
/// speed of that moment. A vehicle that sees no leader keeps its speed: at the edge of what was recorded the road is
/// unknown, not empty. Both speeds are estimated from positions as [`ConstantVelocity`] does. Sideways the speed of
/// the last moments dies away exponentially. No speed forward is ever below 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Idm {
    parameters: IdmParameters,
}

impl Idm {
    /// Drivers with `parameters`.
    ///
    /// # Errors
    /// When a parameter is not a positive number.
    pub fn new(parameters: IdmParameters) -> Result<Self, BaselineError> {
        parameters.check()?;
        Ok(Self { parameters })
    }

    /// Drivers with the least squared error along the road over whole seconds of `windows` (training ones), near
    /// [`IdmParameters::MOTORWAY`] where these say little. Their speeds are estimated over the span that suits
    /// [`ConstantVelocity`] best; `settling` stays. Windows without a leader say nothing.
    ///
    /// # Errors
    /// When there is no window, or they differ in shape or have a single observed frame, or the search fails.
    pub fn fit(windows: &[Window<'_>]) -> Result<Self, BaselineError> {
        let span_s = ConstantVelocity::fit(windows)?.span_s();
        Self::new(fit::fit(windows, IdmParameters { span_s, ..IdmParameters::MOTORWAY })?)
    }

    /// What its drivers want.
    #[must_use]
    pub fn parameters(&self) -> IdmParameters {
        self.parameters
    }

    /// Acceleration at `speed` (m/s), with the leader's speed (m/s) and the gap to it (m), in m/s². Without a leader the road
    /// is empty; a *prediction* without one keeps its speed instead.
    #[must_use]
    pub fn acceleration(&self, speed: f64, leader: Option<Leader>) -> f64 {
        let p = &self.parameters;
        let wish = (speed / p.desired_speed).powi(4);
        let crowd = leader.map_or(0., |leader| {
            let closing = speed * (speed - leader.speed) / (2. * (p.acceleration * p.braking).sqrt());
            let wanted = p.standstill_gap + (speed * p.headway + closing).max(0.);
            (wanted / leader.gap.max(LEAST_GAP)).powi(2)
        });
        (p.acceleration * (1. - wish - crowd)).max(-HARDEST_BRAKING)
    }
}

impl Default for Idm {
    /// With [`IdmParameters::MOTORWAY`].
    fn default() -> Self {
        Self { parameters: IdmParameters::MOTORWAY }
    }
}

/// The vehicle ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leader {
    /// Its speed, m/s.
    pub speed: f64,
    /// From the target's front to its rear, m.
    pub gap: f64,
}

impl Predictor for Idm {
    fn name(&self) -> &str {
        NAME
    }

    fn predict(&self, observations: &[Observation<'_>], _k: usize) -> Result<Vec<Forecast>, PredictError> {
        observations.iter().map(|observation| self.drive(observation)).collect()
    }
}

/// A driver and the vehicle ahead at the last observed frame.
#[derive(Clone, Copy, Debug)]
struct Follower {
    /// Speed forward and to the left, m/s.
    velocity: [f64; 2],
    leader: Option<Leader>,
}

impl Follower {
    fn of(observation: &Observation<'_>, span_s: f64) -> Result<Self, PredictError> {
        let shape = observation.shape();
        let periods = periods(NAME, shape, span_s, 1)?;
        let leader = observation.leader().map(|leader| {
            let gap = leader.now().x - (leader.size()[0] + observation.size()[0]) / 2.;
            Leader { speed: speed(&leader, shape.t_obs, periods, shape.dt()).max(0.), gap: f64::from(gap) }
        });
        Ok(Self { velocity: velocity(observation, periods), leader })
    }
}

impl Idm {
    fn drive(&self, observation: &Observation<'_>) -> Result<Forecast, PredictError> {
        let shape = observation.shape();
        let (dt, IdmParameters { settling, span_s, .. }) = (shape.dt(), self.parameters);
        let follower = Follower::of(observation, span_s)?;
        let path = self.roll_out(&follower, shape).zip(1..).map(|(x, j)| {
            let y = follower.velocity[1] * settling * (1. - (-f64::from(j) * dt / settling).exp());
            [x as f32, y as f32]
        });
        Ok(Forecast { modes: vec![Mode { probability: 1., path: path.collect(), explanation: None }] })
    }

    /// How far the driver gets after each predicted frame, m.
    fn roll_out(&self, follower: &Follower, shape: WindowShape) -> impl Iterator<Item = f64> {
        let dt = shape.dt();
        let Follower { velocity: [vx, _], mut leader } = *follower;
        let (mut x, mut speed) = (0., vx.max(0.));
        (0..shape.t_pred).map(move |_| {
            // The acceleration holds for a frame ("ballistic" update), but no vehicle drives backwards.
            let acceleration = leader.map_or(0., |leader| self.acceleration(speed, Some(leader)));
            let next = (speed + acceleration * dt).max(0.);
            let driving = if next > 0. || speed <= 0. { dt } else { speed / -acceleration };
            let moved = (speed + next) / 2. * driving;
            if let Some(leader) = &mut leader {
                leader.gap += leader.speed * dt - moved;
            }
            x += moved;
            speed = next;
            x
        })
    }
}

/// Speed forward of a leader, m/s, by least squares over the last `periods` frame periods, or as
/// many of them as it was there without a gap; that of its state where it has just appeared.
fn speed(leader: &gnp_data::Leader<'_>, t_obs: usize, periods: usize, dt: f64) -> f64 {
    let back = (0..=periods).map_while(|back| leader.state(t_obs.checked_sub(1 + back)?));
    let x: Vec<f64> = back.map(|state| f64::from(state.x)).collect();
    if x.len() < 2 { f64::from(leader.now().vx) } else { slope(x.into_iter().rev()) / dt }
}
