//! What drives on: rules with drivers of one kind or drawn, and the simplest of all.
use super::{
    Actor, Scene, Trace,
    matched::weights,
    world::{Decides, drive},
};
use crate::{chance::uniform, error::SimulationError};
use gnp_force::{Drive, Driver, Idm, Mobil, MotorwayRule, Noise, Rule, State, Vehicle};
use std::collections::{BTreeMap, BTreeSet};

/// Something that drives everybody in a scene who is not moved as recorded.
pub trait ClosedLoop: Sync {
    /// Its name in tables.
    fn name(&self) -> &str;

    /// Whether each seed gives another course.
    fn draws(&self) -> bool;

    /// Whether it was made from what the scored vehicles did after the start. Tables mark it: it is no forecast.
    fn uses_future(&self) -> bool {
        false
    }

    /// What it makes of a scene. The same seed gives the same course.
    ///
    /// # Errors
    /// When the scene has no lanes, or the system fails.
    fn drive(&self, scene: &Scene, seed: u64) -> Result<Trace, SimulationError>;
}

/// Everybody keeps his speed and his place across the road, whatever is ahead.
#[derive(Clone, Copy, Debug, Default)]
pub struct ConstantVelocity;

impl ClosedLoop for ConstantVelocity {
    fn name(&self) -> &'static str {
        "constant velocity"
    }

    fn draws(&self) -> bool {
        false
    }

    fn drive(&self, scene: &Scene, seed: u64) -> Result<Trace, SimulationError> {
        struct Keep;
        impl Decides for Keep {
            fn vehicle(&mut self, _: &Scene, _: usize, mut base: Vehicle<f64>) -> Vehicle<f64> {
                base.state = along(&base.state);
                base
            }
        }
        drive(scene, seed, &mut Keep)
    }
}

/// The state without motion across the road or backwards.
pub(super) fn along(state: &State<f64>) -> State<f64> {
    State::new(state.position.x, state.position.y, state.velocity.x.max(0.0), 0.0)
}

/// Who drives a vehicle: a rule, the speed that he desires in m/s, and how unsteady he is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrivenBy {
    /// How he keeps his distance.
    pub rule: Rule<f64>,
    /// The speed that he desires, in m/s.
    pub desired_speed: f64,
    /// What wanders in his acceleration.
    pub noise: Option<Noise<f64>>,
}

impl From<Driver<f64>> for DrivenBy {
    fn from(driver: Driver<f64>) -> Self {
        Self { rule: Idm::of(&driver).into(), desired_speed: driver.desired_speed, noise: None }
    }
}

impl DrivenBy {
    /// The standard motorway rule at a desired speed of 120 km/h.
    #[must_use]
    pub fn motorway_rule() -> Self {
        Self { rule: MotorwayRule::standard().into(), desired_speed: 120.0 / 3.6, noise: None }
    }

    /// In a vehicle: at his aim in his lane, never wishing less than 0.
    pub(super) fn drives(&self, scene: &Scene, actor: &Actor, base: Vehicle<f64>) -> Vehicle<f64> {
        let speed = self.desired_speed.clamp(0.0, 69.0);
        let state = State::new(
            base.state.position.x,
            base.state.position.y,
            base.state.velocity.x.max(0.0),
            base.state.velocity.y,
        );
        let drive = Drive::Cruise { speed, y: scene.aim(actor) };
        Vehicle { state, drive, rule: self.rule, noise: self.noise, ..base }
    }
}

/// Which driver a vehicle gets.
#[derive(Clone, Debug, PartialEq)]
pub enum Drivers {
    /// Everybody the same.
    Same(DrivenBy),
    /// Fitted drivers by vehicle number; every vehicle gets one of them by chance, never one of a vehicle in the scene.
    Drawn(Vec<(u32, DrivenBy)>),
    /// As drawn, but those who would have done in the observed seconds what the vehicle did are drawn more often. Those who
    /// come later have no past: theirs are drawn as before.
    Matched(Vec<(u32, DrivenBy)>),
    /// Fitted drivers of the intelligent driver model by vehicle number; everybody gets, number by number, the median of
    /// those that are not in the scene.
    Median(Vec<(u32, Driver<f64>)>),
    /// Every vehicle has the driver that was fitted to itself; the others have the last one given. This uses the future.
    Own(BTreeMap<u32, DrivenBy>, DrivenBy),
}

/// Rules with drivers.
#[derive(Clone, Debug, PartialEq)]
pub struct RuleDrivers {
    /// Its name in tables.
    pub name: String,
    /// Who drives.
    pub drivers: Drivers,
    /// How they change lanes; nobody does so in a scene that is a sample.
    pub lane_change: Option<Mobil<f64>>,
}

impl RuleDrivers {
    /// Drivers under a name, who keep their lanes.
    #[must_use]
    pub fn new(name: impl Into<String>, drivers: Drivers) -> Self {
        Self { name: name.into(), drivers, lane_change: None }
    }

    /// The same drivers, who change lanes so.
    #[must_use]
    pub fn changing_lanes(self, mobil: Mobil<f64>) -> Self {
        Self { lane_change: Some(mobil), ..self }
    }
}

impl ClosedLoop for RuleDrivers {
    fn name(&self) -> &str {
        &self.name
    }

    fn draws(&self) -> bool {
        let noisy = |driver: &DrivenBy| driver.noise.is_some();
        match &self.drivers {
            Drivers::Same(driver) => noisy(driver),
            Drivers::Drawn(_) | Drivers::Matched(_) => true,
            Drivers::Median(_) => false,
            Drivers::Own(drivers, other) => noisy(other) || drivers.values().any(noisy),
        }
    }

    fn uses_future(&self) -> bool {
        matches!(self.drivers, Drivers::Own(..))
    }

    fn drive(&self, scene: &Scene, seed: u64) -> Result<Trace, SimulationError> {
        drive(scene, seed, &mut self.chosen(scene, seed)?)
    }
}

impl RuleDrivers {
    /// The drivers of a scene.
    pub(super) fn chosen(&self, scene: &Scene, seed: u64) -> Result<Chosen, SimulationError> {
        let there: BTreeSet<u32> = scene.actors.iter().map(|actor| actor.vehicle).collect();
        let none = || SimulationError::NoDrivers { system: self.name.clone(), scene: scene.name.clone() };
        let by_actor: Vec<DrivenBy> = match &self.drivers {
            Drivers::Same(driver) => vec![*driver; scene.actors.len()],
            Drivers::Own(own, other) => {
                scene.actors.iter().map(|actor| *own.get(&actor.vehicle).unwrap_or(other)).collect()
            }
            Drivers::Median(fitted) => {
                let others: Vec<Driver<f64>> =
                    fitted.iter().filter(|(vehicle, _)| !there.contains(vehicle)).map(|(_, driver)| *driver).collect();
                vec![DrivenBy::from(median(&others).ok_or_else(none)?); scene.actors.len()]
            }
            Drivers::Drawn(fitted) | Drivers::Matched(fitted) => {
                let others: Vec<&DrivenBy> =
                    fitted.iter().filter(|(vehicle, _)| !there.contains(vehicle)).map(|(_, driver)| driver).collect();
                if others.is_empty() {
                    return Err(none());
                }
                let matched = matches!(self.drivers, Drivers::Matched(_));
                let drawn = scene.actors.iter().enumerate().map(|(index, actor)| {
                    let weights = if matched { weights(scene, index, &others) } else { vec![1.0; others.len()] };
                    *others[weighted(uniform(&[seed, u64::from(actor.vehicle)]), &weights)]
                });
                drawn.collect()
            }
        };
        Ok(Chosen { by_actor, lane_change: self.lane_change.filter(|_| !scene.is_a_sample) })
    }
}

/// A driver for every actor of a scene.
pub(super) struct Chosen {
    pub(super) by_actor: Vec<DrivenBy>,
    lane_change: Option<Mobil<f64>>,
}

impl Decides for Chosen {
    fn vehicle(&mut self, scene: &Scene, index: usize, base: Vehicle<f64>) -> Vehicle<f64> {
        Vehicle { lane_change: self.lane_change, ..self.by_actor[index].drives(scene, &scene.actors[index], base) }
    }
}

/// The place of a number between 0 and 1 among weights that lie end to end.
fn weighted(number: f64, weights: &[f64]) -> usize {
    let mut left = number * weights.iter().sum::<f64>();
    let found = weights.iter().position(|weight| {
        left -= weight;
        left <= 0.0
    });
    found.unwrap_or(weights.len().saturating_sub(1))
}

/// Medians, number by number.
fn median(drivers: &[Driver<f64>]) -> Option<Driver<f64>> {
    let middle = |of: fn(&Driver<f64>) -> f64| {
        let mut values: Vec<f64> = drivers.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    Some(Driver {
        desired_speed: middle(|driver| driver.desired_speed)?,
        time_gap: middle(|driver| driver.time_gap)?,
        standstill_gap: middle(|driver| driver.standstill_gap)?,
        acceleration: middle(|driver| driver.acceleration)?,
        braking: middle(|driver| driver.braking)?,
    })
}
