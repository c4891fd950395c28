//! Vehicles that follow each other along the road, rolled out together.
//!
//! A vehicle with a leader accelerates by [`following_acceleration`](crate::following_acceleration); one without keeps its
//! speed. To either its habit is added: the driver's present deviation from that rule, the measured acceleration less the
//! rule's. It dies away as `habit exp(-t / decay)`, with the time of the middle of the step. The sum is limited to
//! [`HARDEST_BRAKING`] either way.
//!
//! A step is ballistic, with the accelerations of all vehicles as they are when it sets out:
//!
//! ```text
//! v' = max(0, v + a dt)        x' = x + (v + v') / 2 dt
//! ```
//!
//! A vehicle that would stop within the step moves on by `v² / (2 |a|)` and stands: nobody drives backwards.
//!
//! **What it cannot do.** Nobody changes lanes or leader, and whoever has no leader knows no road ahead: neither a desired
//! speed nor a jam beyond what was seen.
use crate::{
    car_following::{Following, HARDEST_BRAKING},
    driver::{Driver, SPEEDS},
    error::{ForceError, require, require_not_negative},
    scalar::lit,
};
use nalgebra::RealField;

/// Most steps of one roll-out.
const MOST_STEPS: usize = 1_000_000;
/// Longest step, in s.
const LONGEST_STEP: f64 = 10.0;
/// Greatest habit either way, in m/s².
const MOST_HABIT: f64 = 1e3;

/// A vehicle of a [`Platoon`] as the roll-out sets out.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Follower<T> {
    /// Centre along the road, in m.
    pub position: T,
    /// Speed along the road, in m/s, from 0 to 1000.
    pub speed: T,
    /// Length, in m.
    pub length: T,
    /// Number of the vehicle ahead in the same list; none for one that follows nobody.
    pub leader: Option<usize>,
    /// How it is driven; without a leader that does not matter.
    pub driver: Driver<T>,
    /// Acceleration beyond what the rule gives, in m/s², from -1000 to 1000; it dies away.
    pub habit: T,
}

/// What does not change about a vehicle in a roll-out.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Link<T> {
    law: Following<T>,
    leader: Option<usize>,
    /// Mean of both lengths, in m.
    body: T,
    habit: T,
    /// Whether the free road does not act.
    coasts: bool,
}

/// Vehicles that follow each other, after a roll-out; it keeps its memory for the next.
///
/// Every result is flat, `[vehicles, steps]`. Position and speed of a step are those at its end, the parts of the
/// acceleration those that acted in it.
///
/// ```
/// use gnp_force::{Driver, Follower, Platoon};
/// let leader =
///     Follower { position: 40.0_f64, speed: 20.0, length: 4.6, leader: None, driver: Driver::motorway(), habit: 0.0 };
/// let follower = Follower { position: 0.0, speed: 25.0, leader: Some(0), ..leader };
/// let platoon = Platoon::roll_out(&[leader, follower], 0.1, 50, 0.0)?;
/// assert!((platoon.positions()[49] - 140.0).abs() < 1e-9); // the leader keeps its speed
/// assert!(platoon.speeds()[99] < 21.0 && platoon.interaction()[50] < -1.0); // the follower brakes
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Platoon<T> {
    vehicles: usize,
    steps: usize,
    positions: Vec<T>,
    speeds: Vec<T>,
    free: Vec<T>,
    interaction: Vec<T>,
    habit: Vec<T>,
    links: Vec<Link<T>>,
    /// Position and speed of every vehicle as a step sets out, and at its end.
    states: [Vec<[T; 2]>; 2],
    /// On which walk along the leaders a vehicle was met, from 1.
    walks: Vec<usize>,
}

impl<T> Default for Platoon<T> {
    fn default() -> Self {
        Self {
            vehicles: 0,
            steps: 0,
            positions: Vec::new(),
            speeds: Vec::new(),
            free: Vec::new(),
            interaction: Vec::new(),
            habit: Vec::new(),
            links: Vec::new(),
            states: [Vec::new(), Vec::new()],
            walks: Vec::new(),
        }
    }
}

impl<T: RealField + Copy> Platoon<T> {
    /// Rolls `followers` out over `steps` steps of `dt` s.
    ///
    /// `decay` is the time in which a habit falls to 1/e, in s; at 0 there are no habits.
    ///
    /// # Errors
    /// - [`ForceError::Value`] for a number that is not finite or out of its range: `dt` above 0 and at most 10 s,
    ///   `decay` not negative, at most 1,000,000 steps, and what [`Follower`] and [`Driver`] say.
    /// - [`ForceError::Leader`] for a leader that is not in the list, or the vehicle itself.
    /// - [`ForceError::Circle`] where vehicles follow each other in a circle.
    pub fn roll_out(followers: &[Follower<T>], dt: T, steps: usize, decay: T) -> Result<Self, ForceError> {
        let mut platoon = Self::default();
        platoon.roll_out_into(followers, dt, steps, decay)?;
        Ok(platoon)
    }

    /// [`Platoon::roll_out`] in the memory of this one: a second roll-out of no more vehicles and steps allocates nothing.
    ///
    /// # Errors
    /// As [`Platoon::roll_out`]; the earlier results then stay.
    pub fn roll_out_into(
        &mut self,
        followers: &[Follower<T>],
        dt: T,
        steps: usize,
        decay: T,
    ) -> Result<(), ForceError> {
        self.roll_out_coasting_into(followers, None, dt, steps, decay)
    }

    /// [`Platoon::roll_out_into`] in which the free road does not act on the vehicle of that number, if any: its
    /// [`Platoon::free`] is 0, so that behind a leader it brakes and never draws on.
    ///
    /// # Errors
    /// As [`Platoon::roll_out`]; the earlier results then stay.
    pub fn roll_out_coasting_into(
        &mut self,
        followers: &[Follower<T>],
        coasting: Option<usize>,
        dt: T,
        steps: usize,
        decay: T,
    ) -> Result<(), ForceError> {
        check_time(dt, steps, decay)?;
        followers.iter().try_for_each(Follower::check)?;
        self.check_leaders(followers)?;
        self.set_out(followers, steps);
        if let Some(link) = coasting.and_then(|vehicle| self.links.get_mut(vehicle)) {
            link.coasts = true;
        }
        // The share of a habit that is left after half a step, and of that after every further step.
        let faded = |time: T| if decay > T::zero() { (-time / decay).exp() } else { T::zero() };
        let (mut left, fading) = (faded(dt * lit(0.5)), faded(dt));
        for step in 0..steps {
            self.step(step, dt, left);
            left *= fading;
        }
        Ok(())
    }

    /// Makes room for roll-outs of up to so many vehicles and steps, which then allocate nothing.
    pub fn reserve(&mut self, vehicles: usize, steps: usize) {
        let size = vehicles * steps;
        for result in [&mut self.positions, &mut self.speeds, &mut self.free, &mut self.interaction, &mut self.habit] {
            result.reserve(size.saturating_sub(result.len()));
        }
        self.links.reserve(vehicles.saturating_sub(self.links.len()));
        self.walks.reserve(vehicles.saturating_sub(self.walks.len()));
        for states in &mut self.states {
            states.reserve(vehicles.saturating_sub(states.len()));
        }
    }

    /// Number of vehicles.
    #[must_use]
    pub fn vehicles(&self) -> usize {
        self.vehicles
    }

    /// Number of steps.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Centre of every vehicle along the road at the end of every step, in m.
    #[must_use]
    pub fn positions(&self) -> &[T] {
        &self.positions
    }

    /// Speed at the end of every step, in m/s; never below 0.
    #[must_use]
    pub fn speeds(&self) -> &[T] {
        &self.speeds
    }

    /// Part of the free road in the acceleration of every step, in m/s².
    ///
    /// The three parts add up to what was integrated, `(v' - v) / dt`: where a limit acts or a vehicle stops, those
    /// that it acts on are shortened in the same proportion.
    #[must_use]
    pub fn free(&self) -> &[T] {
        &self.free
    }

    /// Part of the vehicle ahead, in m/s²; see [`Platoon::free`].
    #[must_use]
    pub fn interaction(&self) -> &[T] {
        &self.interaction
    }

    /// Part of the habit, in m/s²; see [`Platoon::free`].
    #[must_use]
    pub fn habit(&self) -> &[T] {
        &self.habit
    }

    /// Refuses leaders that do not exist and circles.
    fn check_leaders(&mut self, followers: &[Follower<T>]) -> Result<(), ForceError> {
        let vehicles = followers.len();
        for (vehicle, follower) in followers.iter().enumerate() {
            if let Some(leader) = follower.leader.filter(|leader| *leader >= vehicles || *leader == vehicle) {
                return Err(ForceError::Leader { vehicle, leader, vehicles });
            }
        }
        self.walks.clear();
        self.walks.resize(vehicles, 0);
        for first in 0..vehicles {
            let mut next = Some(first);
            // A walk ends where an earlier one went on, or where nobody is ahead; meeting itself, it has found a circle.
            while let Some(vehicle) = next {
                if self.walks[vehicle] == first + 1 {
                    return Err(ForceError::Circle { vehicle });
                }
                next = if self.walks[vehicle] == 0 { followers[vehicle].leader } else { None };
                self.walks[vehicle] = first + 1;
            }
        }
        Ok(())
    }

    /// Takes the vehicles as they are and makes room for the results.
    fn set_out(&mut self, followers: &[Follower<T>], steps: usize) {
        (self.vehicles, self.steps) = (followers.len(), steps);
        let size = followers.len() * steps;
        for result in [&mut self.positions, &mut self.speeds, &mut self.free, &mut self.interaction, &mut self.habit] {
            result.resize(size, T::zero());
        }
        self.links.clear();
        self.links.extend(followers.iter().map(|follower| {
            let ahead = follower.leader.map_or(follower.length, |leader| followers[leader].length);
            let body = (follower.length + ahead) * lit(0.5);
            Link {
                law: Following::new(&follower.driver),
                leader: follower.leader,
                body,
                habit: follower.habit,
                coasts: false,
            }
        }));
        for states in &mut self.states {
            states.clear();
            states.extend(followers.iter().map(|follower| [follower.position, follower.speed]));
        }
    }

    /// Moves every vehicle on by a step, with the share `left` of every habit.
    fn step(&mut self, step: usize, dt: T, left: T) {
        let [now, next] = &mut self.states;
        for (vehicle, (link, next)) in self.links.iter().zip(next.iter_mut()).enumerate() {
            let [x, v] = now[vehicle];
            let (free, interaction) = match link.leader {
                Some(leader) => {
                    let [ahead, speed] = now[leader];
                    let free = if link.coasts { T::zero() } else { link.law.free(v) };
                    (free, link.law.interaction(ahead - x, link.body, v, speed))
                }
                None => (T::zero(), T::zero()),
            };
            let habit = link.habit * left;
            let rule = free + interaction;
            let limited = rule.max(-lit::<T>(HARDEST_BRAKING));
            let wanted = limited + habit;
            let (state, acceleration) = advance([x, v], wanted, dt);
            let share = part(acceleration, wanted);
            let of_rule = share * part(limited, rule);
            let at = vehicle * self.steps + step;
            [self.positions[at], self.speeds[at]] = state;
            self.free[at] = free * of_rule;
            self.interaction[at] = interaction * of_rule;
            self.habit[at] = habit * share;
            *next = state;
        }
        std::mem::swap(now, next);
    }
}

/// What part of `whole` is left as `shortened`; all of it where both are 0.
#[inline(always)]
fn part<T: RealField + Copy>(shortened: T, whole: T) -> T {
    if shortened == whole { T::one() } else { shortened / whole }
}

/// Position and speed after a step with the `wanted` acceleration, and the mean acceleration that made them.
#[inline(always)]
fn advance<T: RealField + Copy>([x, v]: [T; 2], wanted: T, dt: T) -> ([T; 2], T) {
    let acceleration = wanted.max(-lit::<T>(HARDEST_BRAKING)).min(lit(HARDEST_BRAKING));
    let faster = v + acceleration * dt;
    if faster >= T::zero() {
        ([x + (v + faster) * (dt * lit(0.5)), faster], acceleration)
    } else {
        ([x + v * v / (-(acceleration + acceleration)), T::zero()], -v / dt)
    }
}

impl<T: RealField + Copy> Follower<T> {
    fn check(&self) -> Result<(), ForceError> {
        require(self.position.is_finite(), "follower.position", self.position, "finite")?;
        let moves = self.speed >= T::zero() && self.speed <= lit(SPEEDS[1]);
        require(moves, "follower.speed", self.speed, "from 0 to 1000 m/s")?;
        require_not_negative("follower.length", self.length)?;
        let small = self.habit.abs() <= lit(MOST_HABIT);
        require(small, "follower.habit", self.habit, "from -1000 to 1000 m/s²")?;
        self.driver.check()
    }
}

/// Refuses times that no roll-out has.
fn check_time<T: RealField + Copy>(dt: T, steps: usize, decay: T) -> Result<(), ForceError> {
    require(dt > T::zero() && dt <= lit(LONGEST_STEP), "dt", dt, "above 0 and at most 10 s")?;
    require(steps <= MOST_STEPS, "steps", steps as f64, "at most 1000000")?;
    require_not_negative("decay", decay)
}
