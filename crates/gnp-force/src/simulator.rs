//! Many vehicles rolled out together.
mod adjoint;
mod contacts;
mod detector;
mod drive;
mod forces;
mod gap;
mod inflow;
mod lane_change;
mod noise;
mod order;
mod params;
mod profile;
#[cfg(feature = "serde")]
mod saved;
mod step;
mod vehicle;

pub use self::{
    adjoint::{Given, RollOut, RollOutGradient, SceneGradient, Undisturbed, VehicleGradient},
    detector::{Detector, Passage},
    drive::{AfterGoal, Drive},
    forces::{ForceBreakdown, Obstacle},
    gap::Gap,
    inflow::{Headways, Inflow},
    lane_change::Mobil,
    noise::Noise,
    params::{SimulatorParams, Steering},
    profile::Profile,
    step::Event,
    vehicle::Vehicle,
};
use self::{contacts::Contacts, order::LaneOrder};
use crate::{
    error::{ForceError, require},
    integrator::Workspace,
    road::Road,
    rule::{PairRule, Rule},
    scalar::lit,
    state::State,
};
use nalgebra::RealField;
use std::fmt;

/// Number of a vehicle in a [`Simulator`]: counts up from 0 and is never given twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct VehicleId(pub u64);

impl fmt::Display for VehicleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
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
/// A step takes time in proportion to the number of vehicles; with the feature `parallel` it uses the threads of rayon's
/// pool. The same scene and seed give the same bits, on any number of threads. A scene can be cloned at any time and
/// continued twice, and with the feature `serde` written and read.
///
/// Drivers change lanes by themselves if [`Vehicle::lane_change`] says how; a program may decide instead: ask
/// [`Simulator::surroundings`] and [`Simulator::gap_ahead`], and say so by [`Simulator::set_drive`], or for all vehicles by
/// [`Simulator::steer`]. The precision is that of the parameters, here `f64`.
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
pub struct Simulator<T: RealField, R = Rule<T>> {
    params: SimulatorParams<T>,
    road: Road<T>,
    ids: Vec<VehicleId>,
    vehicles: Vec<Vehicle<T, R>>,
    statuses: Vec<Status<T>>,
    next_id: u64,
    steps: u64,
    /// Fastest, slowest to respond and most pushed of all vehicles there ever were, for the bound on the speed.
    fastest: T,
    slowest_tau: T,
    most_push: T,
    order: LaneOrder,
    contacts: Contacts,
    states: Vec<State<T>>,
    workspace: Workspace<T>,
    events: Vec<Event<T, R>>,
}

/// What the simulator keeps of a vehicle from step to step.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Status<T> {
    /// What the driver's unsteadiness adds now, in m/s².
    noise: T,
    /// Step at which the driver last decided to change lanes.
    changed: Option<u64>,
    /// Where the vehicle was after the last step but one and after the last, in m, whatever a program did since; where it
    /// is for one that has not moved yet.
    before: T,
    after: T,
    /// Whether a program gave it a drive since the last step.
    #[cfg_attr(feature = "serde", serde(skip))]
    given_drive: bool,
}

impl<T: RealField + Copy> Simulator<T> {
    /// An empty road at time 0, for vehicles with the rules of this crate.
    ///
    /// # Errors
    /// When [`SimulatorParams::check`] refuses a parameter.
    pub fn new(params: SimulatorParams<T>, road: Road<T>) -> Result<Self, ForceError> {
        Self::for_rules(params, road)
    }
}

impl<T: RealField + Copy, R: PairRule<T>> Simulator<T, R> {
    /// An empty road at time 0, for vehicles with rules of any one type.
    ///
    /// # Errors
    /// When [`SimulatorParams::check`] refuses a parameter.
    pub fn for_rules(params: SimulatorParams<T>, road: Road<T>) -> Result<Self, ForceError> {
        params.check()?;
        let mut order = LaneOrder::default();
        order.rebuild::<T, R>(&[], &road);
        Ok(Self {
            params,
            road,
            ids: Vec::new(),
            vehicles: Vec::new(),
            statuses: Vec::new(),
            next_id: 0,
            steps: 0,
            fastest: T::zero(),
            slowest_tau: T::zero(),
            most_push: T::zero(),
            order,
            contacts: Contacts::default(),
            states: Vec::new(),
            workspace: Workspace::new(),
            events: Vec::new(),
        })
    }

    /// Puts a vehicle on the road and returns its number.
    ///
    /// # Errors
    /// - [`ForceError::Value`] when a number of the vehicle is not finite, a size is negative, tau is below one step, the
    ///   desired speed above the highest, a goal due already, or the rule refuses its parameters.
    /// - [`ForceError::OffRoad`] when its centre is beyond the outermost lines.
    /// - [`ForceError::Closed`] when its lane is closed there, or the road has ended before.
    /// - [`ForceError::Occupied`] when it would touch another vehicle.
    ///
    /// Recorded vehicles may be where they cannot be: see [`Simulator::place`].
    pub fn add(&mut self, vehicle: Vehicle<T, R>) -> Result<VehicleId, ForceError> {
        let y = vehicle.state.position.y;
        vehicle.check(&self.params, self.time())?;
        if !self.road.contains(y) {
            return Err(ForceError::OffRoad { y: y.to_subset_unchecked() });
        }
        self.check_place(&vehicle)?;
        if let Some(id) = self.touching(&vehicle) {
            return Err(ForceError::Occupied { id });
        }
        self.place(vehicle)
    }

    /// Refuses a place on a closed stretch or beyond the end of the road.
    fn check_place(&self, vehicle: &Vehicle<T, R>) -> Result<(), ForceError> {
        let (x, lane) = (vehicle.state.position.x, self.road.lane_at(vehicle.state.position.y));
        let closed = |closure: &crate::Closure<T>| closure.lane == lane && self.is_beside(vehicle, closure, T::zero());
        if self.road.closures().iter().any(closed) || self.road.end().is_some_and(|end| x > end) {
            return Err(ForceError::Closed { x: x.to_subset_unchecked(), lane });
        }
        Ok(())
    }

    /// Puts a vehicle anywhere, also beside the road and on top of another, as recordings have them. What it touches
    /// becomes an [`Event::Contact`] of the next step.
    ///
    /// # Errors
    /// The first kind of [`Simulator::add`].
    pub fn place(&mut self, mut vehicle: Vehicle<T, R>) -> Result<VehicleId, ForceError> {
        vehicle.check(&self.params, self.time())?;
        vehicle.state.position.x = self.road.wrapped(vehicle.state.position.x);
        self.note_extremes(&vehicle);
        let id = VehicleId(self.next_id);
        self.next_id += 1;
        self.ids.push(id);
        let x = vehicle.state.position.x;
        self.statuses.push(Status { noise: T::zero(), changed: None, before: x, after: x, given_drive: false });
        self.vehicles.push(vehicle);
        self.order.insert(&self.vehicles, &self.road);
        Ok(id)
    }

    /// Widens what the bound on the speed rests on.
    fn note_extremes(&mut self, vehicle: &Vehicle<T, R>) {
        let noise = vehicle.noise.map_or_else(T::zero, |noise| noise.most());
        // The neighbours together and the vehicle's own pull, each held at what the vehicle can do.
        let push = vehicle.limits.braking + vehicle.limits.acceleration * lit(2.0) + noise;
        self.fastest = self.fastest.max(vehicle.state.velocity.norm()).max(vehicle.drive.fastest());
        self.slowest_tau = self.slowest_tau.max(vehicle.tau);
        self.most_push = self.most_push.max(push);
    }

    /// Takes a vehicle off the road.
    ///
    /// # Errors
    /// When there is none of that number.
    pub fn remove(&mut self, id: VehicleId) -> Result<Vehicle<T, R>, ForceError> {
        let index = self.index(id)?;
        self.order.remove(index);
        self.ids.remove(index);
        self.statuses.remove(index);
        self.contacts.forget(id);
        Ok(self.vehicles.remove(index))
    }

    /// Keeps the vehicles for which `keep` holds and takes the others off the road.
    pub fn retain(&mut self, mut keep: impl FnMut(VehicleId, &Vehicle<T, R>) -> bool) {
        let stays: Vec<bool> = self.vehicles().map(|(id, vehicle)| keep(id, vehicle)).collect();
        if stays.iter().all(|stays| *stays) {
            return;
        }
        for (id, _) in self.ids.iter().zip(&stays).filter(|(_, stays)| !**stays) {
            self.contacts.forget(*id);
        }
        let mut at = stays.iter();
        self.ids.retain(|_| at.next().copied().unwrap_or(true));
        let mut at = stays.iter();
        self.statuses.retain(|_| at.next().copied().unwrap_or(true));
        let mut at = stays.iter();
        self.vehicles.retain(|_| at.next().copied().unwrap_or(true));
        self.order.rebuild(&self.vehicles, &self.road);
    }

    /// Gives a vehicle another wish: a new lane, speed or goal.
    ///
    /// # Errors
    /// When there is none of that number, or the wish is refused as by [`Simulator::add`].
    pub fn set_drive(&mut self, id: VehicleId, drive: Drive<T>) -> Result<(), ForceError> {
        drive.check(&self.params, self.time())?;
        let index = self.index(id)?;
        self.fastest = self.fastest.max(drive.fastest());
        self.vehicles[index].drive = drive;
        self.statuses[index].given_drive = true;
        self.order.aimed(index, &self.vehicles, &self.road);
        Ok(())
    }

    /// Asks `decide` for every vehicle in turn, and gives those for which it answers another wish; each sees what was
    /// decided before.
    ///
    /// # Errors
    /// As [`Simulator::set_drive`]; decisions before it stand.
    pub fn steer(
        &mut self,
        mut decide: impl FnMut(&Self, VehicleId, &Vehicle<T, R>) -> Option<Drive<T>>,
    ) -> Result<(), ForceError> {
        for index in 0..self.ids.len() {
            let id = self.ids[index];
            if let Some(drive) = decide(self, id, &self.vehicles[index]) {
                self.set_drive(id, drive)?;
            }
        }
        Ok(())
    }

    /// Gives a vehicle another driver.
    ///
    /// # Errors
    /// When there is none of that number, or the rule refuses its parameters.
    pub fn set_rule(&mut self, id: VehicleId, rule: R) -> Result<(), ForceError> {
        rule.check()?;
        let index = self.index(id)?;
        self.vehicles[index].rule = rule;
        Ok(())
    }

    /// Puts a vehicle elsewhere, such as one whose motion is recorded; also on top of another. The order of the vehicles
    /// is kept: moved a little, a vehicle costs nothing but that.
    ///
    /// # Errors
    /// When there is none of that number, or the state is not finite.
    pub fn set_state(&mut self, id: VehicleId, mut state: State<T>) -> Result<(), ForceError> {
        require(state.is_finite(), "state", state.velocity.norm(), "finite in all four numbers")?;
        let index = self.index(id)?;
        state.position.x = self.road.wrapped(state.position.x);
        self.vehicles[index].state = state;
        self.fastest = self.fastest.max(state.velocity.norm());
        self.order.touched(index, &self.vehicles, &self.road);
        Ok(())
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
    pub fn vehicles(&self) -> impl ExactSizeIterator<Item = (VehicleId, &Vehicle<T, R>)> {
        self.ids.iter().copied().zip(&self.vehicles)
    }

    /// The vehicle of that number, if it is on the road.
    #[must_use]
    pub fn vehicle(&self, id: VehicleId) -> Option<&Vehicle<T, R>> {
        self.index(id).ok().map(|index| &self.vehicles[index])
    }

    /// Who is around a vehicle now, at any distance.
    ///
    /// # Errors
    /// When there is none of that number.
    pub fn surroundings(&self, id: VehicleId) -> Result<Surroundings, ForceError> {
        let index = self.index(id)?;
        let ring = self.road.circumference().is_some();
        let own = self.order.lane(index);
        let find = |beside: isize| {
            let Some(lane) = own.checked_add_signed(beside) else { return [None; 2] };
            let behind = self.order.behind_in(index, lane, &self.vehicles);
            let is_own = usize::from(beside == 0);
            let next = self.order.ahead(lane, behind, is_own, ring).next();
            let last = self.order.behind(lane, behind, is_own, ring).next();
            [next, last].map(|seen| seen.map(|(other, _)| self.ids[other]))
        };
        let ([ahead, behind], [left_ahead, left_behind], [right_ahead, right_behind]) = (find(0), find(1), find(-1));
        Ok(Surroundings { ahead, behind, left_ahead, left_behind, right_ahead, right_behind })
    }

    /// Whether a program gave a vehicle a drive since the last step.
    fn was_given_a_drive(&self, id: VehicleId) -> bool {
        self.index(id).is_ok_and(|index| self.statuses[index].given_drive)
    }

    /// All states, in the order of [`Simulator::vehicles`].
    fn states(&self) -> Vec<State<T>> {
        self.vehicles.iter().map(|vehicle| vehicle.state).collect()
    }

    fn index(&self, id: VehicleId) -> Result<usize, ForceError> {
        self.ids.binary_search(&id).map_err(|_| ForceError::UnknownVehicle { id })
    }
}
