//! Traffic that enters the road.
use super::{
    Simulator, Vehicle, VehicleId,
    lane_change::Next,
    noise::{mix, uniform},
};
use crate::{
    error::{ForceError, require},
    rule::PairRule,
    scalar::lit,
};
use nalgebra::RealField;

/// Braking that an entering vehicle may ask of itself and of whoever comes from behind, in m/s².
const ENTRY_BRAKING: f64 = 2.0;

/// How the times between vehicles that want to enter are spread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Headways {
    /// All alike.
    Even,
    /// Exponentially, as if every vehicle came by itself.
    #[default]
    Random,
}

/// Vehicles that want to enter at a place, at a rate; those that find no room wait.
///
/// ```
/// use gnp_force::{Drive, Headways, Inflow, Road, Simulator, SimulatorParams, State, Vehicle};
/// let road = Road::motorway(1, 3.75)?.ending_at(1000.0)?;
/// let mut scene = Simulator::new(SimulatorParams::motorway(0.1_f64), road)?;
/// let mut inflow = Inflow::new(1200.0, Headways::Random, 7)?;
/// for _ in 0..6000 {
///     let car = |_| Vehicle::car(State::new(0.0, 1.875, 30.0, 0.0), Drive::Cruise { speed: 30.0, y: 1.875 });
///     scene.admit(&mut inflow, car)?;
///     scene.step();
/// }
/// assert!((inflow.entered() + inflow.waiting()).abs_diff(200) < 40); // 1200 vehicles an hour for ten minutes
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Unchecked<T>", into = "Unchecked<T>"))]
#[cfg_attr(
    feature = "serde",
    serde(bound(
        serialize = "T: RealField + Copy + serde::Serialize",
        deserialize = "T: RealField + Copy + serde::Deserialize<'de>"
    ))
)]
pub struct Inflow<T> {
    flow: T,
    headways: Headways,
    seed: u64,
    /// Vehicles still to be counted, at the flow of each moment, until the next one wants to enter.
    left: T,
    /// Up to when they are counted, in s.
    counted: T,
    drawn: u64,
    entered: u64,
}

impl<T: RealField + Copy> Inflow<T> {
    /// `flow` vehicles an hour, from time 0 on; for one that begins later start with 0 and [`Inflow::set_flow`].
    ///
    /// # Errors
    /// When the flow is negative or above 100,000 vehicles an hour.
    pub fn new(flow: T, headways: Headways, seed: u64) -> Result<Self, ForceError> {
        check_flow(flow)?;
        let mut inflow = Self { flow, headways, seed, left: T::zero(), counted: T::zero(), drawn: 0, entered: 0 };
        inflow.left = inflow.headway();
        Ok(inflow)
    }

    /// Changes the rate to `flow` vehicles an hour from time `from` in s on, which is now or later; 0 for none. Who would
    /// have come next comes so much sooner or later as the rates differ.
    ///
    /// # Errors
    /// When the flow is negative or above 100,000 vehicles an hour.
    pub fn set_flow(&mut self, flow: T, from: T) -> Result<(), ForceError> {
        check_flow(flow)?;
        self.come(from);
        self.flow = flow;
        Ok(())
    }

    /// How many have entered.
    #[must_use]
    pub fn entered(&self) -> u64 {
        self.entered
    }

    /// How many wait for room.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        self.drawn.saturating_sub(1).saturating_sub(self.entered)
    }

    /// The next time between two vehicles, as a share of the mean.
    fn headway(&mut self) -> T {
        self.drawn += 1;
        match self.headways {
            Headways::Even => T::one(),
            Headways::Random => lit(-uniform(mix(self.seed ^ mix(self.drawn))).ln()),
        }
    }

    /// Counts those who want to enter up to `time` s.
    fn come(&mut self, time: T) {
        self.left -= (time - self.counted).max(T::zero()) * self.flow / lit(3600.0);
        self.counted = self.counted.max(time);
        while self.left <= T::zero() {
            let headway = self.headway();
            self.left += headway;
        }
    }
}

impl<T: RealField + Copy, R: PairRule<T>> Simulator<T, R> {
    /// Lets the next vehicle of an inflow enter, if one is due and there is room; call it before every step. `make` gets
    /// how many entered before, and says what enters and where.
    ///
    /// # Errors
    /// As [`Simulator::enter`].
    pub fn admit(
        &mut self,
        inflow: &mut Inflow<T>,
        make: impl FnOnce(u64) -> Vehicle<T, R>,
    ) -> Result<Option<VehicleId>, ForceError> {
        inflow.come(self.time());
        if inflow.waiting() == 0 {
            return Ok(None);
        }
        let id = self.enter(make(inflow.entered))?;
        inflow.entered += u64::from(id.is_some());
        Ok(id)
    }

    /// Puts a vehicle on the road if there is room, and returns its number; none if there is not, and nothing changed.
    ///
    /// There is room if neither the vehicle nor who comes from behind would have to brake with more than 2 m/s². Behind a
    /// slower vehicle it enters more slowly if need be, down to that one's speed. It does not change lanes for
    /// [`Mobil::pause`](crate::Mobil::pause).
    ///
    /// # Errors
    /// When a number of the vehicle is refused or its place is beside the road, as by [`Simulator::add`].
    pub fn enter(&mut self, vehicle: Vehicle<T, R>) -> Result<Option<VehicleId>, ForceError> {
        vehicle.check(&self.params, self.time())?;
        let y = vehicle.state.position.y;
        if !self.road.contains(y) {
            return Err(ForceError::OffRoad { y: y.to_subset_unchecked() });
        }
        self.check_place(&vehicle)?;
        if self.touching(&vehicle).is_some() {
            return Ok(None);
        }
        let speed = vehicle.state.velocity.x;
        let id = self.place(vehicle)?;
        let index = self.index(id)?;
        let lane = self.order.lane(index);
        let leader = self.next(index, lane, true);
        let leading = leader.and_then(|next| next.who).map(|who| self.vehicles[who].state.velocity.x);
        let slower = leading.map_or(speed, |leading| speed.min(leading.max(T::zero())));
        let between = |quarters: f64| speed + (slower - speed) * lit(quarters / 4.0);
        let fits = [0.0, 1.0, 2.0, 3.0, 4.0].map(between).into_iter().any(|speed| {
            self.vehicles[index].state.velocity.x = speed;
            self.fits(index)
        });
        if !fits {
            self.remove(id)?;
            self.next_id = id.0;
            return Ok(None);
        }
        // Who enters stays in his lane for a pause: else a full lane empties into the one beside, where nobody can enter.
        self.statuses[index].changed = Some(self.steps);
        Ok(Some(id))
    }

    /// Whether a vehicle would neither brake hard nor make the one behind do so.
    fn fits(&self, index: usize) -> bool {
        let lane = self.order.lane(index);
        let bears = |who: usize, leader: Next<T>| {
            let ego = self.ego(who);
            self.vehicles[who].rule.behind(&ego, Some(&self.seen_ahead(&ego, leader))) >= -lit::<T>(ENTRY_BRAKING)
        };
        let behind = |Next { who, way }| who.is_none_or(|who| bears(who, Next { who: Some(index), way }));
        self.next(index, lane, true).is_none_or(|ahead| bears(index, ahead))
            && self.next(index, lane, false).is_none_or(behind)
    }
}

/// A lane carries 2,000 to 2,500 vehicles an hour.
fn check_flow<T: RealField + Copy>(flow: T) -> Result<(), ForceError> {
    require(flow >= T::zero() && flow <= lit(1e5), "inflow.flow", flow, "from 0 to 100000 vehicles an hour")
}

/// What an inflow is read from, before it is checked.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Unchecked<T> {
    flow: T,
    headways: Headways,
    seed: u64,
    left: T,
    counted: T,
    drawn: u64,
    entered: u64,
}

#[cfg(feature = "serde")]
impl<T: RealField + Copy> TryFrom<Unchecked<T>> for Inflow<T> {
    type Error = ForceError;

    fn try_from(from: Unchecked<T>) -> Result<Self, ForceError> {
        let Unchecked { flow, headways, seed, left, counted, drawn, entered } = from;
        check_flow(flow)?;
        require(left.is_finite(), "inflow.left", left, "finite")?;
        require(counted.is_finite(), "inflow.counted", counted, "finite")?;
        let number = |count: u64| lit::<T>(count as f64);
        require(drawn < u64::MAX / 2, "inflow.drawn", number(drawn), "a count of vehicles")?;
        require(entered <= drawn, "inflow.entered", number(entered), "at most `drawn`")?;
        Ok(Self { flow, headways, seed, left, counted, drawn, entered })
    }
}

#[cfg(feature = "serde")]
impl<T> From<Inflow<T>> for Unchecked<T> {
    fn from(inflow: Inflow<T>) -> Self {
        let Inflow { flow, headways, seed, left, counted, drawn, entered } = inflow;
        Self { flow, headways, seed, left, counted, drawn, entered }
    }
}
