//! A step of the simulator backwards.
mod drive;
mod gradient;
mod roll_out;

pub use self::{
    gradient::{SceneGradient, VehicleGradient},
    roll_out::{Given, RollOut, RollOutGradient, Undisturbed},
};
use super::{
    Simulator,
    forces::{Sight, Sums, share},
};
use crate::{
    integrator::{Accelerations, Workspace},
    line::line_force_vjp,
    rule::{DifferentiableRule, Ego, PairRule},
    scalar::lit,
    state::{State, StateGradient},
};
use nalgebra::{RealField, Vector2};
use std::borrow::Cow;

impl<T: RealField + Copy, R: DifferentiableRule<T>> Simulator<T, R> {
    /// Turns the gradient of a number with respect to the scene after the next step into that with respect to the scene as
    /// it is now. The scene itself does not move.
    ///
    /// The gradient is exactly that of what [`Simulator::step`] computes, limits included: at a limit that holds it is 0.
    /// Three things are taken as they are: who is a neighbour of whom, what drivers decide about lanes, and what their
    /// unsteadiness adds. Sizes, limits, profiles, the road and the parameters of the simulator are constants. A vehicle
    /// that leaves in the step counts as it left.
    ///
    /// It takes about as long as three steps.
    ///
    /// ```
    /// use gnp_force::{Drive, Road, SceneGradient, Simulator, SimulatorParams, State, Vehicle};
    /// let mut scene = Simulator::new(SimulatorParams::motorway(0.1_f64), Road::open())?;
    /// let car = scene.add(Vehicle::car(State::new(0.0, 0.0, 20.0, 0.0), Drive::Cruise { speed: 21.0, y: 0.0 }))?;
    /// let mut gradient = SceneGradient::zeros(&scene);
    /// gradient.of(car)?.state.velocity.x = 1.0; // of the speed after the step, 20 + 0.1 (21 - 20) m/s
    /// scene.step_vjp(&mut gradient);
    /// assert!((gradient.of(car)?.wish.x - 0.1).abs() < 1e-12); // how much a higher desired speed adds to it
    /// # Ok::<(), gnp_force::ForceError>(())
    /// ```
    pub fn step_vjp(&self, gradient: &mut SceneGradient<T>) {
        let scene = self.decided();
        let places = gradient.fit(&scene);
        let states = scene.states();
        let dt = scene.params.dt;
        let mut field = Backwards { scene: &scene, seen: Default::default(), gradient, places: &places };
        let step = scene.params.integrator.record_all(&states, dt, &mut field);

        let latest = dt * lit((scene.steps + 1) as f64) + dt * lit(0.5);
        let mut direct = Vec::with_capacity(states.len());
        let mut to_states = Vec::with_capacity(states.len());
        for ((vehicle, after), place) in scene.vehicles.iter().zip(step.after()).zip(&places) {
            let own = field.gradient.at(*place);
            vehicle.drive.settle_vjp(after, latest, &scene.params, own);
            let (found, before) = vehicle.advance_vjp(after, dt, own.state);
            to_states.push(found);
            direct.push(before);
        }
        step.vjp(&mut field, &mut to_states);
        for (index, place) in places.iter().enumerate() {
            let own = gradient.at(*place);
            own.state = to_states[index];
            own.state += direct[index];
            if scene.vehicles[index].drive != self.vehicles[index].drive {
                // The driver chose another lane in this step: where he wanted to be before does not matter.
                own.wish.y = T::zero();
            }
        }
    }

    /// The scene once drivers have decided and chance was drawn, as the step does first.
    fn decided(&self) -> Cow<'_, Self> {
        if self.vehicles.iter().all(|vehicle| vehicle.noise.is_none() && vehicle.lane_change.is_none()) {
            return Cow::Borrowed(self);
        }
        let mut scene = self.bare();
        scene.decide_lanes();
        scene.draw_noise();
        Cow::Owned(scene)
    }

    /// A copy without the memory that steps use again.
    fn bare(&self) -> Self {
        let mut copy = self.clone();
        copy.states = Vec::new();
        copy.workspace = Workspace::new();
        copy.events = Vec::new();
        copy
    }

    /// Adds the gradient of `cotangent` · acceleration of a vehicle.
    #[inline]
    fn acceleration_vjp(
        &self,
        index: usize,
        states: &[State<T>],
        time: T,
        (sums, cotangent): (&Sums<T>, Vector2<T>),
        gradient: &mut [StateGradient<T>],
        own: &mut VehicleGradient<T>,
    ) {
        let (vehicle, state) = (&self.vehicles[index], &states[index]);
        if !vehicle.drive.has_a_wish() {
            gradient[index].velocity += self.given_vjp(index, state, cotangent, own);
            return;
        }
        let me = vehicle.ego(state, time, &self.params);
        let cotangent = me.limits.hold_vjp(sums.total, me.state.velocity, cotangent);
        let mut mine = vehicle.drive.pull_vjp(&me, &vehicle.rule, time, &self.params, cotangent, own);
        let to_push = share_vjp(&me, sums.pushes, cotangent);
        self.for_each_seen(index, states, |sight, other| {
            let vjp = vehicle.rule.push_vjp(&me, &other, to_push, &mut own.rule);
            mine.state += vjp.me.state;
            mine.wish += vjp.me.wish;
            mine.tau += vjp.me.tau;
            match sight {
                Sight::Vehicle(other) => gradient[other] += vjp.other,
                // It stands across the lane, wherever in it the vehicle is.
                Sight::Closure(_) => mine.state.position.y += vjp.other.position.y,
            }
        });
        for line in self.road.lines() {
            let d = state.position.y - line.y;
            mine.state.position.y += line_force_vjp(line.kind, d, line.k, line.road, cotangent.y).d;
        }
        mine.state.position.x += vehicle.drive.wish_vjp(state, time, &self.params, mine.wish, own);
        own.tau += mine.tau;
        gradient[index] += mine.state;
    }

    /// Gradient of `cotangent` · acceleration of a vehicle that is moved, with respect to its velocity.
    fn given_vjp(
        &self,
        index: usize,
        state: &State<T>,
        cotangent: Vector2<T>,
        own: &mut VehicleGradient<T>,
    ) -> Vector2<T> {
        let limits = &self.vehicles[index].limits;
        let crate::Drive::Accelerate(along) = self.vehicles[index].drive else { return Vector2::zeros() };
        let (v, dt) = (state.velocity, self.params.dt);
        let mut gradient = Vector2::zeros();
        if v.x < T::zero() {
            if -v.x / dt < limits.braking {
                gradient.x = -cotangent.x / dt;
            }
        } else if limits.along(along) < (self.params.max_speed - v.x).max(T::zero()) / dt {
            if limits.leave_along(along) {
                own.wish.x += cotangent.x;
            }
        } else if v.x < self.params.max_speed {
            gradient.x = -cotangent.x / dt;
        }
        if (v.y / dt).abs() < limits.lateral {
            gradient.y = -cotangent.y / dt;
        }
        gradient
    }
}

/// Gradient with respect to `sum` of `cotangent` · `sum` [`share`].
#[inline]
fn share_vjp<T: RealField + Copy>(me: &Ego<T>, sum: Vector2<T>, cotangent: Vector2<T>) -> Vector2<T> {
    let share = share(me, sum);
    if share == T::one() {
        return cotangent;
    }
    let along = sum / sum.norm();
    (cotangent - along * along.dot(&cotangent)) * share
}

/// The accelerations of a scene, kept for the way back.
struct Backwards<'a, T: RealField + Copy, R: PairRule<T>> {
    scene: &'a Simulator<T, R>,
    seen: [Vec<Sums<T>>; 4],
    gradient: &'a mut SceneGradient<T>,
    places: &'a [usize],
}

impl<T: RealField + Copy, R: DifferentiableRule<T>> Accelerations<T> for Backwards<'_, T, R> {
    fn at(&mut self, stage: usize, states: &[State<T>], elapsed: T, out: &mut [Vector2<T>]) {
        let time = self.scene.time() + elapsed;
        self.seen[stage].clear();
        for (index, acceleration) in out.iter_mut().enumerate() {
            let (sums, held) = self.scene.sums(index, states, time);
            self.seen[stage].push(sums);
            *acceleration = held;
        }
    }

    fn vjp(
        &mut self,
        stage: usize,
        states: &[State<T>],
        elapsed: T,
        cotangents: &[Vector2<T>],
        gradient: &mut [StateGradient<T>],
    ) {
        let time = self.scene.time() + elapsed;
        for (index, cotangent) in cotangents.iter().enumerate() {
            if *cotangent != Vector2::zeros() {
                let own = self.gradient.at(self.places[index]);
                let sums = (&self.seen[stage][index], *cotangent);
                self.scene.acceleration_vjp(index, states, time, sums, gradient, own);
            }
        }
    }
}
