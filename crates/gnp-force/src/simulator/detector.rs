//! A loop in the road that notes who passes.
use super::{Simulator, VehicleId};
use crate::rule::PairRule;
use nalgebra::RealField;

/// A vehicle that passed a place.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Passage<T> {
    /// When its centre passed, in s: between two steps, as if its speed had not changed in between.
    pub time: T,
    /// Its number.
    pub id: VehicleId,
    /// The lane that it is in.
    pub lane: usize,
    /// Speed along the road, in m/s.
    pub speed: T,
    /// Length, in m.
    pub length: T,
}

/// A detector across the road at a place: look with it after every step.
///
/// ```
/// use gnp_force::{Detector, Drive, Road, Simulator, SimulatorParams, State, Vehicle};
/// let mut scene = Simulator::new(SimulatorParams::motorway(0.1_f64), Road::motorway(1, 3.75)?)?;
/// for i in 0..10 {
///     let state = State::new(-60.0 * f64::from(i), 1.875, 30.0, 0.0);
///     scene.add(Vehicle::car(state, Drive::Steady))?;
/// }
/// let mut detector = Detector::new(100.0);
/// for _ in 0..300 {
///     scene.step();
///     detector.watch(&scene);
/// }
/// assert_eq!(detector.passages().len(), 10);
/// let flow = detector.flow(None, 3.0, 23.0).unwrap(); // a vehicle every 2 s
/// assert!((flow - 1800.0).abs() < 1e-9);
/// assert!((detector.speed(None, 0.0, 30.0).unwrap() - 30.0).abs() < 1e-9);
/// assert!((detector.density(None, 3.0, 23.0).unwrap() - 1000.0 / 60.0).abs() < 1e-9);
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Detector<T> {
    x: T,
    passages: Vec<Passage<T>>,
}

impl<T: RealField + Copy> Detector<T> {
    /// A detector at `x` m.
    #[must_use]
    pub fn new(x: T) -> Self {
        Self { x, passages: Vec::new() }
    }

    /// Where it is, in m.
    #[must_use]
    pub fn x(&self) -> T {
        self.x
    }

    /// Notes who passed in the last step. A vehicle that left the scene with that step is not seen: keep a detector off the
    /// very end of the road.
    pub fn watch<R: PairRule<T>>(&mut self, scene: &Simulator<T, R>) {
        let (now, dt) = (scene.time(), scene.params.dt);
        for (index, (vehicle, status)) in scene.vehicles.iter().zip(&scene.statuses).enumerate() {
            let way = scene.road.distance(status.before, vehicle.state.position.x);
            let to = scene.road.distance(status.before, self.x);
            // On a ring a way of almost a lap is a vehicle that rolled back a little.
            let forward = scene.road.circumference().is_none_or(|circumference| way + way < circumference);
            if !forward || way <= T::zero() || to <= T::zero() || to > way {
                continue;
            }
            self.passages.push(Passage {
                time: now - dt + dt * (to / way),
                id: scene.ids[index],
                lane: scene.order.lane(index),
                speed: vehicle.state.velocity.x,
                length: vehicle.extent.length,
            });
        }
    }

    /// Who passed, in the order of steps.
    #[must_use]
    pub fn passages(&self) -> &[Passage<T>] {
        &self.passages
    }

    /// Vehicles an hour in a lane, or in all, from a time to another in s; none without time between them.
    #[must_use]
    pub fn flow(&self, lane: Option<usize>, from: T, to: T) -> Option<T> {
        let count = self.between(lane, from, to).count();
        (to > from).then(|| nalgebra::convert::<f64, T>(count as f64 * 3600.0) / (to - from))
    }

    /// Harmonic mean of the speeds in m/s, which is the mean over the road; none when nobody passed, or one stood.
    #[must_use]
    pub fn speed(&self, lane: Option<usize>, from: T, to: T) -> Option<T> {
        let (mut count, mut slowness) = (T::zero(), T::zero());
        for passage in self.between(lane, from, to) {
            count += T::one();
            slowness += T::one() / passage.speed;
        }
        (count > T::zero() && slowness.is_finite()).then(|| count / slowness)
    }

    /// Vehicles per kilometre, from flow and mean speed; none when nobody passed.
    #[must_use]
    pub fn density(&self, lane: Option<usize>, from: T, to: T) -> Option<T> {
        let kmh = self.speed(lane, from, to)? * nalgebra::convert(3.6);
        self.flow(lane, from, to).map(|flow| flow / kmh)
    }

    fn between(&self, lane: Option<usize>, from: T, to: T) -> impl Iterator<Item = &Passage<T>> {
        let inside = move |passage: &&Passage<T>| {
            passage.time >= from && passage.time < to && lane.is_none_or(|lane| lane == passage.lane)
        };
        self.passages.iter().filter(inside)
    }
}
