//! The Intelligent Driver Model along the lane.

use gnp_data::{Forecast, Mode, Neighbour, Observation, PredictError, Predictor, Slot};
use serde::{Deserialize, Serialize};

use crate::motion::{BaselineError, periods, slope, velocity};
use crate::rule::{Rule, parameters, parsed};

const NAME: &str = "IDM";

/// Nothing is fitted: drivers are [`IdmParameters::MOTORWAY`].
pub(crate) const RULE: Rule = Rule::new(
    NAME,
    "Every vehicle follows the one ahead as the Intelligent Driver Model says and stays in its lane.",
    |_| parameters(NAME, &IdmParameters::MOTORWAY),
    |of| Ok(Box::new(Idm::new(parsed(NAME, of)?)?)),
);

/// Time that speeds are estimated from, s: that of [`ConstantVelocity`](crate::ConstantVelocity).
const SPAN_S: f64 = crate::ConstantVelocity::SPAN_S;

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
}

impl IdmParameters {
    /// Motorway drivers: Treiber, Kesting, *Traffic Flow Dynamics* (2013), table 11.2.
    ///
    /// RMSE at 5 s of 5.9 m on the US-101 scenes in `fixtures/`, where almost every vehicle has a leader
    /// and constant velocity has 6.8 m; of 8.5 m against 5.4 m on the I-80 lanes, whose leaders are
    /// often not recorded. With [`IdmParameters::PROPOSED`] it is 6.2 m and 6.6 m.
    pub const MOTORWAY: Self = Self {
        desired_speed: 120. / 3.6,
        headway: 1.,
        standstill_gap: 2.,
        acceleration: 1.,
        braking: 1.5,
        settling: 1.,
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
        ];
        match all.into_iter().find(|(_, value, _)| !(value.is_finite() && *value > 0.)) {
            Some((key, value, default)) => Err(BaselineError::Parameter { key, value, default }),
            None => Ok(()),
        }
    }
}

/// Every vehicle follows the one ahead as the Intelligent Driver Model says and stays in the lane.
///
/// The leader is the vehicle in the preceding slot at the last observed frame; it goes on at its
/// speed of that moment. Where no vehicle is seen ahead, the road counts as empty: a vehicle at the edge
/// of what was recorded sets off towards its desired speed. Both speeds are estimated from positions
/// as [`ConstantVelocity`](crate::ConstantVelocity) does. Sideways the speed of
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

    /// Acceleration at `speed` (m/s), with the leader's speed (m/s) and the gap to it (m), in m/s².
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

impl Idm {
    fn drive(&self, observation: &Observation<'_>) -> Result<Forecast, PredictError> {
        let shape = observation.shape();
        let periods = periods(NAME, shape, SPAN_S, 1)?;
        let [vx, vy] = velocity(observation, periods);
        let mut leader = observation.neighbour(Slot::Preceding).map(|leader| {
            let gap = leader.now().x - (leader.size()[0] + observation.size()[0]) / 2.;
            Leader { speed: speed(&leader, shape.t_obs, periods, shape.dt()).max(0.), gap: f64::from(gap) }
        });
        let (dt, settling) = (shape.dt(), self.parameters.settling);
        let (mut x, mut speed) = (0., vx.max(0.));
        let path = (1..=shape.t_pred).map(|j| {
            // The acceleration holds for a frame ("ballistic" update), but no vehicle drives backwards.
            let acceleration = self.acceleration(speed, leader);
            let next = (speed + acceleration * dt).max(0.);
            let driving = if next > 0. || speed <= 0. { dt } else { speed / -acceleration };
            let moved = (speed + next) / 2. * driving;
            if let Some(leader) = &mut leader {
                leader.gap += leader.speed * dt - moved;
            }
            x += moved;
            speed = next;
            let y = vy * settling * (1. - (-(j as f64) * dt / settling).exp());
            [x as f32, y as f32]
        });
        Ok(Forecast { modes: vec![Mode { probability: 1., path: path.collect(), explanation: None }] })
    }
}

/// Speed forward of a neighbour, m/s, by least squares over the last `periods` frame periods, or as
/// many of them as it was there without a gap; that of its state where it has just appeared.
fn speed(neighbour: &Neighbour<'_>, t_obs: usize, periods: usize, dt: f64) -> f64 {
    let back = (0..=periods).map_while(|back| neighbour.state(t_obs.checked_sub(1 + back)?));
    let x: Vec<f64> = back.map(|state| f64::from(state.x)).collect();
    if x.len() < 2 { f64::from(neighbour.now().vx) } else { slope(x.into_iter().rev()) / dt }
}
