//! Following the vehicle ahead: the intelligent driver model (Treiber, Hennecke and Helbing, Physical Review E 62, 2000).
//!
//! Along the road only, in two parts that add up to the acceleration:
//!
//! ```text
//! free road     F = a (1 - (v / v0)^4)
//! interaction   F = -a (s* / s)²        s* = s0 + max(0, v T + v (v - v_leader) / (2 sqrt(a b)))
//! ```
//!
//! `s` is the gap from bumper to bumper: the distance of the centres less the mean of both lengths. `v` is the speed
//! forward, 0 for a vehicle that rolls backwards. The five numbers v0, T, s0, a, b are a [`Driver`].
//!
//! **Potential and dissipation.** Of the free road, `a` is a constant drive with the potential `-a x`, and
//! `-a (v / v0)^4` is minus the gradient in v of the dissipation function `a v^5 / (5 v0^4)`. Of the interaction,
//! `-a (s0 / s)²` is minus the gradient in x of [`standstill_potential`], `a s0² / s`; the rest, which depends on the
//! speeds, never does work on the vehicle: it only dissipates.
//!
//! **Finite everywhere.** The gap counts as at least [`LEAST_GAP`], speeds as at most 1000 m/s, and a number of the driver
//! outside of its range as the end of the range. The free road never brakes with more than [`HARDEST_BRAKING`], the
//! interaction never with more than `HARDEST_BRAKING + a`. As the free road gives at most `a`, neither limit changes the sum
//! of both when that is limited to `HARDEST_BRAKING`, as [`Platoon`](crate::Platoon) does. A leader whose centre is not
//! ahead has been passed and does not act.
//!
//! **Kinks.** The gradient at a kink is that of the side on which the argument no longer matters: 0 in the speed of a
//! vehicle that stands, in the gap at `LEAST_GAP`, and in everything but `a` at a limit; only the standstill part counts
//! where the `max` is 0.
use crate::{
    driver::{Driver, SPEEDS},
    scalar::lit,
    state::State,
    term::{Arity, ForceTerm, Source, TermDescriptor, TermParameter, TermVjp},
};
use nalgebra::{RealField, Vector2};

/// Least gap from bumper to bumper, in m; a smaller one, and an overlap, count as this one.
pub const LEAST_GAP: f64 = 0.1;

/// Hardest braking of a vehicle, in m/s²: what tyres give on a dry road.
pub const HARDEST_BRAKING: f64 = 9.0;

/// `speed` as the laws use it, from `least` to the greatest speed.
#[inline(always)]
fn bounded_speed<T: RealField + Copy>(speed: T, least: T) -> T {
    speed.max(least).min(lit(SPEEDS[1]))
}

/// The two laws of one driver, with the root worked out once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Following<T> {
    driver: Driver<T>,
    /// `2 sqrt(a b)`, in m/s².
    twice_root: T,
}

impl<T: RealField + Copy> Following<T> {
    #[inline]
    pub(crate) fn new(driver: &Driver<T>) -> Self {
        let driver = driver.bounded();
        Self { driver, twice_root: lit::<T>(2.0) * (driver.acceleration * driver.braking).sqrt() }
    }

    /// [`free_acceleration`] of this driver.
    #[inline]
    pub(crate) fn free(&self, speed: T) -> T {
        let ratio = bounded_speed(speed, T::zero()) / self.driver.desired_speed;
        let square = ratio * ratio;
        (self.driver.acceleration * (T::one() - square * square)).max(-lit::<T>(HARDEST_BRAKING))
    }

    /// [`interaction`] of this driver.
    #[inline]
    pub(crate) fn interaction(&self, distance: T, body: T, speed: T, leader_speed: T) -> T {
        if distance <= T::zero() {
            return T::zero();
        }
        let gap = (distance - body).max(lit(LEAST_GAP));
        let (v, leader) = self.speeds(speed, leader_speed);
        let ratio = (self.driver.standstill_gap + self.dynamic_gap(v, leader).max(T::zero())) / gap;
        -(self.driver.acceleration * ratio * ratio).min(self.hardest())
    }

    /// Both speeds within what the laws take, in m/s.
    #[inline(always)]
    fn speeds(&self, speed: T, leader_speed: T) -> (T, T) {
        (bounded_speed(speed, T::zero()), bounded_speed(leader_speed, -lit::<T>(SPEEDS[1])))
    }

    /// What the speeds add to the desired gap, in m; below 0 behind a leader that draws away.
    #[inline(always)]
    fn dynamic_gap(&self, v: T, leader: T) -> T {
        v * (self.driver.time_gap + (v - leader) / self.twice_root)
    }

    /// The hardest braking of the interaction, in m/s².
    #[inline(always)]
    fn hardest(&self) -> T {
        lit::<T>(HARDEST_BRAKING) + self.driver.acceleration
    }
}

/// Acceleration on an empty road, `a (1 - (v / v0)^4)`, in m/s²; at most `a`, and never below -[`HARDEST_BRAKING`].
///
/// `speed` along the road in m/s; of the driver, `desired_speed` and `acceleration` matter.
///
/// ```
/// use gnp_force::{Driver, free_acceleration};
/// let driver = Driver { desired_speed: 30.0, ..Driver::motorway() };
/// assert_eq!(free_acceleration(0.0, &driver), 1.0);
/// assert_eq!(free_acceleration(15.0, &driver), 0.9375);
/// assert_eq!(free_acceleration(30.0, &driver), 0.0);
/// ```
#[inline]
#[must_use]
pub fn free_acceleration<T: RealField + Copy>(speed: T, driver: &Driver<T>) -> T {
    Following::new(driver).free(speed)
}

/// Acceleration due to the vehicle ahead, `-a (s* / s)²`, in m/s²; at most 0, and never below
/// `-(HARDEST_BRAKING + a)`.
///
/// - `distance`: centre of the leader less that of the vehicle, along the road, in m; from 0 down there is no force
/// - `body`: mean of both lengths, in m, so that the gap is `distance - body`
/// - `speed`, `leader_speed`: along the road, in m/s
/// - `driver`: all but `desired_speed` matters
///
/// ```
/// use gnp_force::{Driver, interaction};
/// // At 20 m/s behind a vehicle of 20 m/s the driver wants 2 m + 1 s * 20 m/s; twice that gap brakes by a quarter of a.
/// let push = interaction(48.6, 4.6, 20.0, 20.0, &Driver::motorway());
/// assert!((push + 0.25_f64).abs() < 1e-12);
/// ```
#[inline]
#[must_use]
pub fn interaction<T: RealField + Copy>(distance: T, body: T, speed: T, leader_speed: T, driver: &Driver<T>) -> T {
    Following::new(driver).interaction(distance, body, speed, leader_speed)
}

/// Both parts together, [`free_acceleration`] and [`interaction`], in m/s²; never below -[`HARDEST_BRAKING`].
///
/// The arguments are those of [`interaction`].
///
/// ```
/// use gnp_force::{Driver, following_acceleration};
/// let driver = Driver::motorway();
/// assert_eq!(following_acceleration(1e9, 4.6, 0.0, 0.0, &driver), 1.0); // nobody near
/// assert_eq!(following_acceleration(14.6, 4.6, 30.0, 0.0, &driver), -9.0); // 10 m before one that stands
/// ```
#[inline]
#[must_use]
pub fn following_acceleration<T: RealField + Copy>(
    distance: T,
    body: T,
    speed: T,
    leader_speed: T,
    driver: &Driver<T>,
) -> T {
    let law = Following::new(driver);
    let sum = law.free(speed) + law.interaction(distance, body, speed, leader_speed);
    sum.max(-lit::<T>(HARDEST_BRAKING))
}

/// Potential of the interaction with a leader at standstill, `a s0² / gap`, in m²/s²; linear where the force is held.
///
/// `gap` from bumper to bumper in m. Minus its gradient in the vehicle's position is [`interaction`] at speed 0.
#[inline]
#[must_use]
pub fn standstill_potential<T: RealField + Copy>(gap: T, driver: &Driver<T>) -> T {
    let law = Following::new(driver);
    let Driver { standstill_gap, acceleration, .. } = law.driver;
    let knee = (standstill_gap * (acceleration / law.hardest()).sqrt()).max(lit(LEAST_GAP));
    let beyond = gap.max(knee);
    let push = acceleration * (standstill_gap / knee) * (standstill_gap / knee);
    acceleration * standstill_gap * standstill_gap / beyond + push * (beyond - gap)
}

/// Gradient of `cotangent * F` for the free road; see [`free_acceleration_vjp`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeVjp<T> {
    /// With respect to the speed.
    pub speed: T,
    /// With respect to each number of the driver; 0 for those that do not matter, and out of range.
    pub driver: Driver<T>,
}

/// Vector-Jacobian product of [`free_acceleration`]: the gradient of `cotangent * F` with respect to every argument.
#[inline]
#[must_use]
pub fn free_acceleration_vjp<T: RealField + Copy>(speed: T, driver: &Driver<T>, cotangent: T) -> FreeVjp<T> {
    let law = Following::new(driver);
    let Driver { desired_speed, acceleration, .. } = law.driver;
    let v = bounded_speed(speed, T::zero());
    let ratio = v / desired_speed;
    let fourth = ratio * ratio * ratio * ratio;
    if acceleration * (T::one() - fourth) <= -lit::<T>(HARDEST_BRAKING) {
        return FreeVjp { speed: T::zero(), driver: Driver::zeros() };
    }
    let steep = lit::<T>(4.0) * acceleration * fourth * cotangent;
    let gradient = Driver {
        desired_speed: steep / desired_speed,
        acceleration: (T::one() - fourth) * cotangent,
        ..Driver::zeros()
    };
    let moves = v == speed && v > T::zero();
    FreeVjp { speed: if moves { -steep / v } else { T::zero() }, driver: driver.free_of_bounds(gradient) }
}

/// Gradient of `cotangent * F` for the interaction; see [`interaction_vjp`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InteractionVjp<T> {
    /// With respect to the distance of the centres: the gradient in the leader's position, and minus the one in the
    /// vehicle's.
    pub distance: T,
    /// With respect to the mean length.
    pub body: T,
    /// With respect to the vehicle's speed.
    pub speed: T,
    /// With respect to the leader's speed.
    pub leader_speed: T,
    /// With respect to each number of the driver; 0 for those that do not matter, and out of range.
    pub driver: Driver<T>,
}

/// Vector-Jacobian product of [`interaction`]: the gradient of `cotangent * F` with respect to every argument.
#[must_use]
pub fn interaction_vjp<T: RealField + Copy>(
    distance: T,
    body: T,
    speed: T,
    leader_speed: T,
    driver: &Driver<T>,
    cotangent: T,
) -> InteractionVjp<T> {
    let zero = T::zero();
    let gradient = |driver| InteractionVjp { distance: zero, body: zero, speed: zero, leader_speed: zero, driver };
    if distance <= zero {
        return gradient(Driver::zeros());
    }
    let law = Following::new(driver);
    let Driver { time_gap, standstill_gap, acceleration, braking, .. } = law.driver;
    let gap = (distance - body).max(lit(LEAST_GAP));
    let (v, leader) = law.speeds(speed, leader_speed);
    let dynamic = law.dynamic_gap(v, leader);
    let ratio = (standstill_gap + dynamic.max(zero)) / gap;
    if acceleration * ratio * ratio >= law.hardest() {
        return gradient(driver.free_of_bounds(Driver { acceleration: -cotangent, ..Driver::zeros() }));
    }
    let wanted = -lit::<T>(2.0) * acceleration * ratio / gap * cotangent;
    let along = if gap > lit(LEAST_GAP) { -wanted * ratio } else { zero };
    let dynamic_wanted = if dynamic > zero { wanted } else { zero };
    // The closing speed's share of the desired gap goes with 1 / sqrt(a b).
    let closing = v * (v - leader) / law.twice_root * dynamic_wanted * lit(0.5);
    let to_driver = Driver {
        time_gap: v * dynamic_wanted,
        standstill_gap: wanted,
        acceleration: -ratio * ratio * cotangent - closing / acceleration,
        braking: -closing / braking,
        ..Driver::zeros()
    };
    let (moves, followed) = (v == speed && v > zero, leader == leader_speed);
    let to_speed = time_gap + (v + v - leader) / law.twice_root;
    InteractionVjp {
        distance: along,
        body: -along,
        speed: if moves { to_speed * dynamic_wanted } else { zero },
        leader_speed: if followed { -v / law.twice_root * dynamic_wanted } else { zero },
        driver: driver.free_of_bounds(to_driver),
    }
}

/// The free road as a term of the force: [`free_acceleration`] along x with the parameters `desired_speed` and
/// `acceleration`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FreeRoad;

impl FreeRoad {
    /// Its name in files.
    pub const NAME: &'static str = "free_road";
}

static FREE_PARAMETERS: [TermParameter; 2] = [
    TermParameter::constant("desired_speed", "m/s", "speed on an empty road"),
    TermParameter::constant("acceleration", "m/s²", "acceleration of a standing vehicle on an empty road"),
];
static FREE_DESCRIPTOR: TermDescriptor = TermDescriptor::fixed(
    [FreeRoad::NAME, "free road", "wish to drive at the desired speed"],
    "#009e73",
    Arity::One,
    &FREE_PARAMETERS,
);

/// The driver with those parameters of [`FreeRoad`]; the others do not matter.
fn free_driver<T: RealField + Copy>(desired_speed: T, acceleration: T) -> Driver<T> {
    Driver { desired_speed, acceleration, ..Driver::motorway() }
}

impl<T: RealField + Copy> ForceTerm<T> for FreeRoad {
    fn descriptor(&self) -> &TermDescriptor {
        &FREE_DESCRIPTOR
    }

    #[inline]
    fn force(&self, state: &State<T>, source: &Source<T>, parameters: &[T]) -> Vector2<T> {
        let (Source::Goal { .. }, &[desired_speed, acceleration]) = (source, parameters) else {
            return Vector2::zeros();
        };
        let force = free_acceleration(state.velocity.x, &free_driver(desired_speed, acceleration));
        Vector2::new(force, T::zero())
    }

    #[inline]
    fn vjp(
        &self,
        state: &State<T>,
        source: &Source<T>,
        parameters: &[T],
        cotangent: Vector2<T>,
        dparameters: &mut [T],
    ) -> TermVjp<T> {
        let (Source::Goal { .. }, &[desired_speed, acceleration], [ddesired_speed, dacceleration]) =
            (source, parameters, dparameters)
        else {
            return TermVjp::zeros();
        };
        let driver = free_driver(desired_speed, acceleration);
        let vjp = free_acceleration_vjp(state.velocity.x, &driver, cotangent.x);
        (*ddesired_speed, *dacceleration) = (vjp.driver.desired_speed, vjp.driver.acceleration);
        TermVjp { velocity: Vector2::new(vjp.speed, T::zero()), ..TermVjp::zeros() }
    }
}

/// The interaction as a term of the force: [`interaction`] along x with the vehicle in slot 0, the one ahead in the lane.
///
/// The parameters are those of a [`Driver`] but the desired speed, and `body`, the mean of both lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CarFollowing;

impl CarFollowing {
    /// Its name in files.
    pub const NAME: &'static str = "car_following";
}

static FOLLOWING_PARAMETERS: [TermParameter; 5] = [
    TermParameter::constant("acceleration", "m/s²", "acceleration of a standing vehicle on an empty road"),
    TermParameter::constant("braking", "m/s²", "comfortable braking"),
    TermParameter::constant("time_gap", "s", "time to the vehicle ahead at a steady speed"),
    TermParameter::constant("standstill_gap", "m", "gap to the vehicle ahead at standstill"),
    TermParameter::constant("body", "m", "mean length of both vehicles"),
];
static FOLLOWING_DESCRIPTOR: TermDescriptor = TermDescriptor::fixed(
    [CarFollowing::NAME, "vehicle ahead", "keeping a gap to the vehicle ahead"],
    "#cc79a7",
    Arity::PerNeighbour,
    &FOLLOWING_PARAMETERS,
);

impl<T: RealField + Copy> ForceTerm<T> for CarFollowing {
    fn descriptor(&self) -> &TermDescriptor {
        &FOLLOWING_DESCRIPTOR
    }

    #[inline]
    fn force(&self, state: &State<T>, source: &Source<T>, parameters: &[T]) -> Vector2<T> {
        let (Source::Vehicle { slot: 0, state: leader }, &[acceleration, braking, time_gap, standstill_gap, body]) =
            (source, parameters)
        else {
            return Vector2::zeros();
        };
        let driver = Driver { acceleration, braking, time_gap, standstill_gap, ..Driver::motorway() };
        let distance = leader.position.x - state.position.x;
        let force = interaction(distance, body, state.velocity.x, leader.velocity.x, &driver);
        Vector2::new(force, T::zero())
    }

    #[inline]
    fn vjp(
        &self,
        state: &State<T>,
        source: &Source<T>,
        parameters: &[T],
        cotangent: Vector2<T>,
        dparameters: &mut [T],
    ) -> TermVjp<T> {
        let (&[acceleration, braking, time_gap, standstill_gap, body], [da, db, dtime, dstandstill, dbody]) =
            (parameters, dparameters)
        else {
            return TermVjp::zeros();
        };
        let Source::Vehicle { slot: 0, state: leader } = source else {
            for d in [da, db, dtime, dstandstill, dbody] {
                *d = T::zero();
            }
            return TermVjp::zeros();
        };
        let driver = Driver { acceleration, braking, time_gap, standstill_gap, ..Driver::motorway() };
        let distance = leader.position.x - state.position.x;
        let vjp = interaction_vjp(distance, body, state.velocity.x, leader.velocity.x, &driver, cotangent.x);
        (*da, *db, *dtime) = (vjp.driver.acceleration, vjp.driver.braking, vjp.driver.time_gap);
        (*dstandstill, *dbody) = (vjp.driver.standstill_gap, vjp.body);
        let along = |value| Vector2::new(value, T::zero());
        TermVjp {
            position: along(-vjp.distance),
            velocity: along(vjp.speed),
            source_position: along(vjp.distance),
            source_velocity: along(vjp.leader_speed),
        }
    }
}
