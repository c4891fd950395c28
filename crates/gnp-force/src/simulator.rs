//! Many vehicles rolled out together.
mod drive;
mod forces;
mod order;
mod params;
mod repulsion;

use self::order::LaneOrder;
pub use self::{
    drive::{Drive, Vehicle},
    forces::ForceBreakdown,
    params::{CruiseParams, NeighbourSearch, SimulatorParams},
    repulsion::{MotorwayRule, Repulsion},
};
use crate::{
    error::{ForceError, require},
    integrator::Workspace,
    road::Road,
    scalar::lit,
    state::State,
};
use nalgebra::RealField;
use std::{borrow::Cow, fmt};

/// Number of a vehicle in a [`Simulator`]: counts up from 0 and is never given twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct VehicleId(pub u64);

impl fmt::Display for VehicleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A vehicle that left the scene because its time was up; see [`Drive::Goal`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival<T: RealField> {
    /// Its number.
    pub id: VehicleId,
    /// How it arrived.
    pub vehicle: Vehicle<T>,
}

/// Nearest vehicles ahead of and behind a vehicle, by centre, in its lane and the two beside it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Surroundings {
    /// In the own lane, ahead.
    pub ahead: Option<VehicleId>,
    /// In the own lane, behind.
    pub behind: Option<VehicleId>,
    /// In the lane to the left, ahead.
    pub left_ahead: Option<VehicleId>,
    /// In the lane to the left, behind.
    pub left_behind: Option<VehicleId>,
    /// In the lane to the right, ahead.
    pub right_ahead: Option<VehicleId>,
    /// In the lane to the right, behind.
    pub right_behind: Option<VehicleId>,
}

/// A road and the vehicles on it, all moved together, each pushed by its neighbours where they are now.
///
/// A step takes time in proportion to the number of vehicles. It uses no random numbers and one thread: the same scene
/// gives the same bits. A scene can be cloned at any time and continued twice.
///
/// When to change lanes or speed is the driver's decision and no force: ask [`Simulator::surroundings`], decide, and say
/// so by [`Simulator::set_drive`]. The precision is that of the parameters, here `f64`.
///
/// ```
/// use gnp_force::{Drive, Road, Simulator, SimulatorParams, State, Vehicle};
/// let road = Road::motorway(2, 3.75)?;
/// let y = 1.875; // middle of the right lane
/// let mut scene = Simulator::new(SimulatorParams::motorway(0.04_f64), road)?;
/// let truck = scene.add(Vehicle::truck(State::new(80.0, y, 22.0, 0.0), Drive::Cruise { speed: 22.0, y }))?;
/// let car = scene.add(Vehicle::car(State::new(0.0, y, 33.0, 0.0), Drive::Cruise { speed: 33.0, y }))?;
/// for _ in 0..1500 {
///     scene.step();
/// }
/// let speed = |id| scene.vehicle(id).map(|vehicle| vehicle.state.velocity.x);
/// assert!((speed(car).unwrap() - speed(truck).unwrap()).abs() < 0.1); // caught up, and follows
/// assert_eq!(scene.surroundings(car)?.ahead, Some(truck));
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Simulator<T: RealField> {
    params: SimulatorParams<T>,
    road: Road<T>,
    ids: Vec<VehicleId>,
    vehicles: Vec<Vehicle<T>>,
    next_id: u64,
    steps: u64,
    /// Fastest and slowest to respond of all vehicles there ever were, for the bound on the speed.
    fastest: T,
    slowest_tau: T,
    order: LaneOrder,
    states: Vec<State<T>>,
    workspace: Workspace<T>,
    arrivals: Vec<Arrival<T>>,
}

impl<T: RealField + Copy> Simulator<T> {
    /// An empty road at time 0.
    ///
    /// # Errors
    /// When [`SimulatorParams::check`] refuses a parameter.
    pub fn new(params: SimulatorParams<T>, road: Road<T>) -> Result<Self, ForceError> {
        params.check()?;
        Ok(Self {
            params,
            road,
            ids: Vec::new(),
            vehicles: Vec::new(),
            next_id: 0,
            steps: 0,
            fastest: T::zero(),
            slowest_tau: T::zero(),
            order: LaneOrder::default(),
            states: Vec::new(),
            workspace: Workspace::new(),
            arrivals: Vec::new(),
        })
    }

    /// Puts a vehicle on the road and returns its number.
    ///
    /// # Errors
    /// When a number of the vehicle is not finite, a size is negative, tau is below one step, the desired speed above
    /// the highest, or a goal due already.
    pub fn add(&mut self, vehicle: Vehicle<T>) -> Result<VehicleId, ForceError> {
        vehicle.check(&self.params, self.time())?;
        let id = VehicleId(self.next_id);
        self.next_id += 1;
        self.fastest = self.fastest.max(vehicle.state.velocity.norm());
        self.slowest_tau = self.slowest_tau.max(vehicle.tau);
        self.ids.push(id);
        self.vehicles.push(vehicle);
        self.order.reset();
        Ok(id)
    }

    /// Takes a vehicle off the road.
    ///
    /// # Errors
    /// When there is none of that number.
    pub fn remove(&mut self, id: VehicleId) -> Result<Vehicle<T>, ForceError> {
        let index = self.index(id)?;
        self.ids.remove(index);
        self.order.reset();
        Ok(self.vehicles.remove(index))
    }

    /// Keeps the vehicles for which `keep` holds and takes the others off the road, such as those past its end.
    pub fn retain(&mut self, mut keep: impl FnMut(VehicleId, &Vehicle<T>) -> bool) {
        let stays: Vec<bool> = self.vehicles().map(|(id, vehicle)| keep(id, vehicle)).collect();
        let (mut id_stays, mut vehicle_stays) = (stays.iter(), stays.iter());
        self.ids.retain(|_| id_stays.next().copied().unwrap_or(true));
        self.vehicles.retain(|_| vehicle_stays.next().copied().unwrap_or(true));
        self.order.reset();
    }

    /// Gives a vehicle another wish: a new lane, speed or goal.
    ///
    /// # Errors
    /// When there is none of that number, or the wish is refused as by [`Simulator::add`].
    pub fn set_drive(&mut self, id: VehicleId, drive: Drive<T>) -> Result<(), ForceError> {
        drive.check(&self.params, self.time())?;
        let index = self.index(id)?;
        self.vehicles[index].drive = drive;
        Ok(())
    }

    /// Puts a vehicle elsewhere, such as one whose motion is recorded.
    ///
    /// # Errors
    /// When there is none of that number, or the state is not finite.
    pub fn set_state(&mut self, id: VehicleId, state: State<T>) -> Result<(), ForceError> {
        require(state.is_finite(), "state", state.velocity.norm(), "finite in all four numbers")?;
        let index = self.index(id)?;
        self.vehicles[index].state = state;
        self.fastest = self.fastest.max(state.velocity.norm());
        self.order.reset();
        Ok(())
    }

    /// Moves all vehicles by one step and returns those that arrived with it; they are no longer in the scene.
    pub fn step(&mut self) -> &[Arrival<T>] {
        if !self.order.is_current() {
            self.order.rebuild(&self.vehicles, &self.road);
        }
        let mut states = std::mem::take(&mut self.states);
        let mut workspace = std::mem::take(&mut self.workspace);
        states.clear();
        states.extend(self.vehicles.iter().map(|vehicle| vehicle.state));
        let time = self.time();
        self.params.integrator.step_all(&mut states, self.params.dt, &mut workspace, |states, elapsed, out| {
            for (vehicle, acceleration) in out.iter_mut().enumerate() {
                *acceleration = self.acceleration(vehicle, states, time + elapsed);
            }
        });
        for (vehicle, state) in self.vehicles.iter_mut().zip(&states) {
            vehicle.advance(*state);
        }
        self.states = states;
        self.workspace = workspace;
        self.steps += 1;
        self.take_arrivals();
        self.order.rebuild(&self.vehicles, &self.road);
        &self.arrivals
    }

    /// Time since the simulator was made, in s: a whole number of steps.
    #[must_use]
    pub fn time(&self) -> T {
        self.params.dt * lit(self.steps as f64)
    }

    /// The parameters it was made with.
    #[must_use]
    pub fn params(&self) -> &SimulatorParams<T> {
        &self.params
    }

    /// The road it was made with.
    #[must_use]
    pub fn road(&self) -> &Road<T> {
        &self.road
    }

    /// The vehicles on the road, in the order in which they were added.
    pub fn vehicles(&self) -> impl ExactSizeIterator<Item = (VehicleId, &Vehicle<T>)> {
        self.ids.iter().copied().zip(&self.vehicles)
    }

    /// The vehicle of that number, if it is on the road.
    #[must_use]
    pub fn vehicle(&self, id: VehicleId) -> Option<&Vehicle<T>> {
        self.index(id).ok().map(|index| &self.vehicles[index])
    }

    /// Who is around a vehicle now, at any distance.
    ///
    /// # Errors
    /// When there is none of that number.
    pub fn surroundings(&self, id: VehicleId) -> Result<Surroundings, ForceError> {
        let index = self.index(id)?;
        let order = self.current_order();
        let name = |found: Option<usize>| found.map(|other| self.ids[other]);
        Ok(Surroundings {
            ahead: name(order.ahead(index, 0).next()),
            behind: name(order.behind(index, 0).next()),
            left_ahead: name(order.ahead(index, 1).next()),
            left_behind: name(order.behind(index, 1).next()),
            right_ahead: name(order.ahead(index, -1).next()),
            right_behind: name(order.behind(index, -1).next()),
        })
    }

    /// The order of the vehicles as they stand, sorted anew if they were touched since the last step.
    fn current_order(&self) -> Cow<'_, LaneOrder> {
        if self.order.is_current() {
            return Cow::Borrowed(&self.order);
        }
        let mut order = LaneOrder::default();
        order.rebuild(&self.vehicles, &self.road);
        Cow::Owned(order)
    }

    /// Takes vehicles whose time is up off the road.
    fn take_arrivals(&mut self) {
        self.arrivals.clear();
        let latest = self.time() + self.params.dt * lit(0.5);
        let arrived = |vehicle: &Vehicle<T>| matches!(vehicle.drive, Drive::Goal { due, .. } if due <= latest);
        if !self.vehicles.iter().any(arrived) {
            return;
        }
        let gone = self.ids.iter().zip(&self.vehicles).filter(|(_, vehicle)| arrived(vehicle));
        self.arrivals.extend(gone.map(|(id, vehicle)| Arrival { id: *id, vehicle: *vehicle }));
        self.retain(|_, vehicle| !arrived(vehicle));
    }

    fn index(&self, id: VehicleId) -> Result<usize, ForceError> {
        self.ids.binary_search(&id).map_err(|_| ForceError::UnknownVehicle { id })
    }
}
