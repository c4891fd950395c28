//! The column of vehicles ahead, rolled out together: the rule that a prediction must beat.

mod acting;
mod fit;
mod traffic;

use std::collections::BTreeMap;

use gnp_data::{Forecast, Mode, Observation, PredictError, Predictor, WindowShape};
use gnp_force::{Driver, Follower, ForceError, following_acceleration};
use serde::{Deserialize, Serialize};

pub use self::acting::ActingTerms;
use self::traffic::{GatherRoom, Spans};
pub use self::traffic::{SeenBehind, SeenMotion, SeenVehicle, Traffic};
use crate::by_site::BySite;
use crate::motion::{BaselineError, periods, velocity};
use crate::rule::{Rule, parameters, parsed};

const NAME: &str = PlatoonRule::NAME;

/// Drivers are fitted by site.
pub(crate) const RULE: Rule = Rule::new(
    NAME,
    "The column of vehicles ahead drives together as the Intelligent Driver Model says; what each does beyond it dies away.",
    |training| parameters(NAME, &fit::fit(training)?),
    |of| Ok(Box::new(PlatoonRule::new(parsed(NAME, of)?)?)),
);

/// Time over which speeds are estimated, s.
const SPEED_SPAN_S: f64 = 1.2;
/// Times over which accelerations are estimated, s: short, and long.
const ACCELERATION_SPANS_S: [f64; 2] = [1., 3.];
/// No measurement is believed to be better, as a variance of accelerations, m²/s⁴.
const LEAST_VARIANCE: f64 = 1e-6;
/// No acceleration is believed to be larger, m/s².
const MOST_ACCELERATION: f64 = 3.;
/// Below this speed a time gap says nothing, m/s.
const LEAST_SPEED: f64 = 3.;
/// Least gap that a time gap is read from, m: boxes overlap in recordings.
const LEAST_GAP: f64 = 0.1;
/// No vehicle is faster, m/s.
const FASTEST: f64 = 200.;
/// A driver wants to go so many times as fast as he does, at least.
const SPARE_SPEED: f64 = 1.2;
/// Time gaps that drivers keep, s.
const TIME_GAPS: [f64; 2] = [0.3, 3.];
/// Time in which a speed sideways dies away to 1/e, s.
const SETTLING_S: f64 = 0.5;

/// How the drivers of a site follow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drivers {
    /// Time gap that all have in common, s.
    pub time_gap: f64,
    /// Share of a driver's own present time gap in the one he keeps, 0 to 1; the rest is the common one.
    pub own_gap: f64,
    /// Acceleration of a standing vehicle on an empty road, m/s².
    pub acceleration: f64,
    /// Comfortable braking, m/s².
    pub braking: f64,
    /// Gap at standstill, bumper to bumper, m.
    pub standstill_gap: f64,
    /// Speed on an empty road, m/s; for a driver who is near it or faster, a fifth more than he drives now.
    pub desired_speed: f64,
    /// Standard deviation of what drivers do beyond the rule, m/s²: an acceleration that is measured worse than that
    /// counts for little.
    pub habit: f64,
    /// Of what does not count of the acceleration over a short time, the share that the one over a long time takes.
    pub slow_habit: f64,
    /// Time in which that dies away to 1/e, s.
    pub decay: f64,
}

/// The drivers of one site, or of all: what was fitted, to how much, and how well it is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedDrivers {
    /// The parameters.
    pub drivers: Drivers,
    /// Their 95 % intervals, by name, for those that are fitted; vehicles count as independent, windows of one do not.
    pub intervals: BTreeMap<String, [f64; 2]>,
    /// Windows that they were fitted to.
    pub windows: usize,
    /// Windows that say nothing about them: the traffic cannot be rolled out, or the future is shorter than a second.
    pub left_out: usize,
    /// Vehicles of these windows.
    pub vehicles: usize,
}

/// Parameters of the platoon.
pub type PlatoonParameters = BySite<FittedDrivers>;

impl Drivers {
    /// What is typical of full motorways; what is not fitted stays like this.
    pub const TYPICAL: Self = Self {
        time_gap: 0.85,
        own_gap: 0.5,
        acceleration: 0.65,
        braking: 1.9,
        standstill_gap: 2.,
        desired_speed: 30.,
        habit: 0.06,
        slow_habit: 0.06,
        decay: 8.,
    };

    fn check(&self) -> Result<(), BaselineError> {
        let typical = Self::TYPICAL;
        let all = [
            ("time_gap", self.time_gap, typical.time_gap),
            ("acceleration", self.acceleration, typical.acceleration),
            ("braking", self.braking, typical.braking),
            ("standstill_gap", self.standstill_gap, typical.standstill_gap),
            ("desired_speed", self.desired_speed, typical.desired_speed),
            ("habit", self.habit, typical.habit),
            ("decay", self.decay, typical.decay),
        ];
        match all.into_iter().find(|(_, value, _)| !(value.is_finite() && *value > 0.)) {
            Some((key, value, default)) => Err(BaselineError::Parameter { key, value, default }),
            None => [("own_gap", self.own_gap, typical.own_gap), ("slow_habit", self.slow_habit, typical.slow_habit)]
                .into_iter()
                .find(|(_, share, _)| !(0. ..=1.).contains(share))
                .map_or(Ok(()), |(key, value, default)| Err(BaselineError::Parameter { key, value, default })),
        }
    }
}

/// Every vehicle of the column ahead follows the next one as the Intelligent Driver Model says, all at once, and stays in
/// its lane; see [`gnp_force::Platoon`].
///
/// A driver's time gap is blended from the common one and the one he keeps now. What he does now beyond the rule, his
/// habit, goes on and dies away, as far as it can be told from noise: of the difference between his acceleration over the
/// last second and the rule's, the share `h² / (h² + se²)` with `h` the spread of such differences among drivers
/// ([`Drivers::habit`]) and `se` the standard error of the measurement; of what is missing to 1, the acceleration over the
/// last three seconds has a share ([`Drivers::slow_habit`]). A vehicle with nobody ahead keeps its speed but for that.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "PlatoonParameters", into = "PlatoonParameters")]
pub struct PlatoonRule {
    parameters: PlatoonParameters,
}

impl TryFrom<PlatoonParameters> for PlatoonRule {
    type Error = BaselineError;

    fn try_from(parameters: PlatoonParameters) -> Result<Self, BaselineError> {
        Self::new(parameters)
    }
}

impl From<PlatoonRule> for PlatoonParameters {
    fn from(rule: PlatoonRule) -> Self {
        rule.parameters
    }
}

/// Room to gather traffic and to roll it out in, again and again.
#[derive(Clone, Debug, Default)]
pub struct PlatoonRoom {
    gather: GatherRoom,
    followers: Vec<Follower<f64>>,
}

/// Traffic as it moves under the rule.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    steps: usize,
    /// Position (m) and speed (m/s) of each vehicle as the roll-out sets out.
    start: Vec<[f64; 2]>,
    platoon: gnp_force::Platoon<f64>,
}

impl Motion {
    /// Centre of the vehicle at `place` after `step` steps, m; after the last one beyond it, and 0 where no vehicle is.
    #[must_use]
    pub fn position(&self, place: usize, step: usize) -> f64 {
        self.state(place, step, self.platoon.positions(), 0)
    }

    /// Its speed then, m/s.
    #[must_use]
    pub fn speed(&self, place: usize, step: usize) -> f64 {
        self.state(place, step, self.platoon.speeds(), 1)
    }

    fn state(&self, place: usize, step: usize, values: &[f64], which: usize) -> f64 {
        match step.min(self.steps).checked_sub(1) {
            None => self.start.get(place).map_or(0., |start| start[which]),
            Some(step) => values.get(place * self.steps + step).copied().unwrap_or_default(),
        }
    }

    /// What accelerates the target in `step`, m/s²: free road, interaction with the leader, habit; 0 after the last step.
    #[must_use]
    pub fn acceleration(&self, step: usize) -> [f64; 3] {
        [self.platoon.free(), self.platoon.interaction(), self.platoon.habit()]
            .map(|part| part.get(..self.steps).and_then(|part| part.get(step)).copied().unwrap_or_default())
    }
}

impl PlatoonRule {
    /// Its name in tables and files.
    pub const NAME: &str = "platoon";

    /// Drivers with `parameters`.
    ///
    /// # Errors
    /// When a parameter is not a positive number, or a share not between 0 and 1.
    pub fn new(parameters: PlatoonParameters) -> Result<Self, BaselineError> {
        parameters.pooled.drivers.check()?;
        parameters.sites.values().try_for_each(|site| site.drivers.check())?;
        Ok(Self { parameters })
    }

    /// One kind of drivers for every site.
    ///
    /// # Errors
    /// As [`PlatoonRule::new`].
    pub fn of_drivers(drivers: Drivers) -> Result<Self, BaselineError> {
        let pooled = FittedDrivers { drivers, intervals: BTreeMap::new(), windows: 0, left_out: 0, vehicles: 0 };
        Self::new(PlatoonParameters { pooled, sites: BTreeMap::new() })
    }

    /// Fits drivers to training windows, by site where a site has enough of them.
    ///
    /// # Errors
    /// [`BaselineError::NoWindows`], [`BaselineError::Shapes`] for windows of several shapes, [`BaselineError::Rule`] where
    /// the search fails.
    pub fn fit(training: &[gnp_data::Window<'_>]) -> Result<Self, BaselineError> {
        Self::new(fit::fit(training)?)
    }

    /// The parameters.
    #[must_use]
    pub fn parameters(&self) -> &PlatoonParameters {
        &self.parameters
    }

    /// The drivers of a site.
    #[must_use]
    pub fn drivers(&self, site: &str) -> &Drivers {
        &self.parameters.at(site).drivers
    }

    /// What an observation shows of the traffic ahead of its target and of its neighbours.
    #[must_use]
    pub fn traffic(&self, observation: &Observation<'_>) -> Traffic {
        Traffic::of(observation, spans(observation.shape()))
    }

    /// [`PlatoonRule::traffic`] into `traffic`: after a first call nothing is allocated.
    pub fn traffic_into(&self, observation: &Observation<'_>, traffic: &mut Traffic, room: &mut PlatoonRoom) {
        traffic.reserve();
        traffic.gather(observation, spans(observation.shape()), &mut room.gather);
    }

    /// Where the target is in each predicted frame, m, window frame, with lengths and speeds along the road `along`-fold;
    /// sizes of vehicles stay. 1 is the prediction.
    ///
    /// # Errors
    /// When the window observes too few frames, or the traffic in it cannot be.
    pub fn path(&self, observation: &Observation<'_>, along: f64) -> Result<Vec<[f32; 2]>, PredictError> {
        let shape = observation.shape();
        let [_, vy] = velocity(observation, periods(NAME, shape, crate::ConstantVelocity::SPAN_S, 1)?);
        let motion = self
            .roll_out(observation.site(), &self.traffic(observation).scaled(along), &shape)
            .map_err(|source| PredictError::Model { model: NAME.to_owned(), source: Box::new(source) })?;
        let at = |step: usize| [motion.position(Traffic::TARGET, step), lateral(vy, step as f64 * shape.dt())];
        Ok((1..=shape.t_pred).map(|step| at(step).map(|value| value as f32)).collect())
    }

    /// Rolls traffic out over the predicted frames of `shape` with the drivers of `site`.
    ///
    /// # Errors
    /// [`ForceError`] for traffic that cannot be: positions or lengths that are not finite.
    pub fn roll_out(&self, site: &str, traffic: &Traffic, shape: &WindowShape) -> Result<Motion, ForceError> {
        self.roll_out_with(site, traffic, shape, ActingTerms::ALL)
    }

    /// [`PlatoonRule::roll_out`] with the terms that act on the target; on the others all act.
    ///
    /// # Errors
    /// As [`PlatoonRule::roll_out`].
    pub fn roll_out_with(
        &self,
        site: &str,
        traffic: &Traffic,
        shape: &WindowShape,
        acting: ActingTerms,
    ) -> Result<Motion, ForceError> {
        let mut motion = Motion::default();
        let drivers = self.drivers(site);
        roll_out(drivers, traffic.vehicles(), shape, acting, &mut Vec::new(), &mut motion)?;
        Ok(motion)
    }

    /// [`PlatoonRule::roll_out_with`] into `motion`: after a first call of as many frames nothing is allocated.
    ///
    /// # Errors
    /// As [`PlatoonRule::roll_out`].
    pub fn roll_out_into(
        &self,
        site: &str,
        traffic: &Traffic,
        shape: &WindowShape,
        acting: ActingTerms,
        motion: &mut Motion,
        room: &mut PlatoonRoom,
    ) -> Result<(), ForceError> {
        motion.platoon.reserve(Traffic::MOST, shape.t_pred);
        motion.start.reserve(Traffic::MOST.saturating_sub(motion.start.len()));
        room.followers.reserve(Traffic::MOST.saturating_sub(room.followers.len()));
        roll_out(self.drivers(site), traffic.vehicles(), shape, acting, &mut room.followers, motion)
    }
}

fn spans(shape: WindowShape) -> Spans {
    let of = |seconds: f64| ((seconds * shape.rate_hz).round() as usize).clamp(1, shape.t_obs.saturating_sub(1).max(1));
    let [short, long] = ACCELERATION_SPANS_S;
    Spans { speed: of(SPEED_SPAN_S), acceleration: of(short), slow_acceleration: of(long) }
}

/// Rolls `vehicles` out into `motion`; `followers` is room to work in.
fn roll_out(
    drivers: &Drivers,
    vehicles: &[SeenVehicle],
    shape: &WindowShape,
    acting: ActingTerms,
    followers: &mut Vec<Follower<f64>>,
    motion: &mut Motion,
) -> Result<(), ForceError> {
    // Shares of the short and the long acceleration, and both together.
    let measured = |it: &SeenMotion| {
        let short = drivers.habit.powi(2) / (drivers.habit.powi(2) + it.variance + LEAST_VARIANCE);
        let long = (1. - short) * drivers.slow_habit;
        let bounded = |value: f64| value.clamp(-MOST_ACCELERATION, MOST_ACCELERATION);
        (short + long, short * bounded(it.acceleration) + long * bounded(it.slow_acceleration))
    };
    // A jump in a track is no speed that anybody drives.
    let speed = |it: &SeenMotion| (it.speed.max(0.) + it.since * measured(it).1).clamp(0., FASTEST);
    followers.clear();
    followers.extend(vehicles.iter().map(|it| {
        let speed = speed(&it.motion);
        let desired_speed = drivers.desired_speed.max(speed * SPARE_SPEED);
        let Drivers { time_gap, standstill_gap, acceleration, braking, .. } = *drivers;
        Follower {
            position: it.position,
            speed,
            length: it.length,
            leader: it.leader,
            driver: Driver { desired_speed, time_gap, standstill_gap, acceleration, braking },
            habit: 0.,
        }
    }));
    let [free, following, habit] = acting.flags();
    if let Some(target) = followers.get_mut(Traffic::TARGET).filter(|_| !following) {
        target.leader = None;
    }
    for (i, it) in vehicles.iter().enumerate() {
        // Distance, length and speed of whom it follows now, and of whom it was seen behind.
        let ahead = |leader: Option<usize>| {
            let ahead = followers.get(leader?)?;
            Some((ahead.position - it.position, ahead.length, ahead.speed))
        };
        let now = ahead(followers[i].leader);
        let then = match it.behind {
            SeenBehind::Leader => ahead(it.leader),
            SeenBehind::Nobody => None,
            SeenBehind::Other { distance, motion, length } => Some((distance, length, speed(&motion))),
        };
        let own = &mut followers[i];
        if let Some((distance, length, _)) = then {
            let gap = (distance - (length + own.length) / 2.).max(LEAST_GAP) - drivers.standstill_gap;
            let kept = (gap / own.speed.max(LEAST_SPEED)).clamp(TIME_GAPS[0], TIME_GAPS[1]);
            own.driver.time_gap += drivers.own_gap * (kept - own.driver.time_gap);
        }
        let rule = |ahead: Option<(f64, f64, f64)>| {
            ahead.map_or(0., |(distance, length, speed)| {
                following_acceleration(distance, (length + own.length) / 2., own.speed, speed, &own.driver)
            })
        };
        // Who does not brake as the rule asks of him so near his leader does not speed up for it once that one is gone: a habit
        // makes up for no more of the rule than there is now.
        let asks = rule(now);
        let made_up_for = rule(then).clamp(asks.min(0.), asks.max(0.));
        let (share, measured) = measured(&it.motion);
        own.habit = measured - share * made_up_for;
    }
    if let Some(target) = followers.get_mut(Traffic::TARGET).filter(|_| !habit) {
        target.habit = 0.;
    }
    motion.steps = shape.t_pred;
    motion.start.clear();
    motion.start.extend(followers.iter().map(|it| [it.position, it.speed]));
    let coasting = (!free).then_some(Traffic::TARGET);
    motion.platoon.roll_out_coasting_into(followers, coasting, shape.dt(), shape.t_pred, drivers.decay)
}

impl Predictor for PlatoonRule {
    fn name(&self) -> &str {
        NAME
    }

    fn predict(&self, observations: &[Observation<'_>], _k: usize) -> Result<Vec<Forecast>, PredictError> {
        let certain = |path| Forecast { modes: vec![Mode { probability: 1., path, explanation: None }] };
        observations.iter().map(|observation| self.path(observation, 1.).map(certain)).collect()
    }
}

/// How far a lateral speed `vy` (m/s) that dies away has carried after `time` s, m.
#[must_use]
pub fn lateral(vy: f64, time: f64) -> f64 {
    vy * SETTLING_S * (1. - (-time / SETTLING_S).exp())
}
