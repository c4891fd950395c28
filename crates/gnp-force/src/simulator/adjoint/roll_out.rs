//! Many steps backwards, with few copies of the scene.
use super::gradient::{SceneGradient, VehicleGradient};
use crate::{
    error::ForceError,
    rule::{DifferentiableRule, Rule},
    simulator::{Simulator, VehicleId},
};
use nalgebra::RealField;
use std::fmt;

/// Changes nothing between steps.
pub type Undisturbed<T, R> = fn(usize, &mut Simulator<T, R>) -> Result<(), ForceError>;

/// A roll-out of a scene that can be gone back for gradients.
///
/// Of `n` steps about `sqrt(n)` scenes are kept, and going back another `sqrt(n)` for a while: every step is computed once
/// forward and once more on the way back. The gradient is the same to the bit, however many are kept.
///
/// ```
/// use gnp_force::{Drive, Driver, Idm, Road, RollOut, Simulator, SimulatorParams, State, Vehicle};
/// let mut scene = Simulator::for_rules(SimulatorParams::motorway(0.1_f64), Road::open())?;
/// let rule = Idm::of(&Driver::motorway());
/// let car = |x, speed| Vehicle::car(State::new(x, 0.0, speed, 0.0), Drive::Cruise { speed, y: 0.0 }).with_rule(rule);
/// let leader = scene.add(car(0.0, 20.0))?;
/// let follower = scene.add(car(-30.0, 25.0))?;
/// let roll_out = RollOut::record(&mut scene, 100);
/// // How the place of the follower after ten seconds depends on everything at the beginning:
/// let gradient = roll_out.vjp(|step, _, gradient| {
///     if step == 100 {
///         gradient.of(follower)?.state.position.x += 1.0;
///     }
///     Ok(())
/// })?;
/// let by_time_gap = gradient.scene.get(follower).map(|gradient| gradient.rule[0]);
/// assert!(by_time_gap < Some(-10.0)); // a second more of time gap: more than 10 m further back
/// assert!(gradient.scene.get(leader).is_some_and(|gradient| gradient.wish.x > 1.0));
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
#[derive(Clone)]
pub struct RollOut<T: RealField, R = Rule<T>, F = Undisturbed<T, R>> {
    steps: usize,
    copies: Vec<Copied<T, R, F>>,
}

/// The scene before a step, and what changes it from there on.
#[derive(Clone)]
struct Copied<T: RealField, R, F> {
    step: usize,
    scene: Simulator<T, R>,
    control: F,
}

/// Gradient of a number with respect to everything that a roll-out started from and was given on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct RollOutGradient<T: RealField> {
    /// With respect to the scene at the beginning; of vehicles that entered later, with respect to how they entered.
    pub scene: SceneGradient<T>,
    /// With respect to what vehicles were given on the way, the latest first.
    pub given: Vec<Given<T>>,
}

/// Gradient of a number with respect to what a vehicle was given before a step: a state, a wish, another rule.
#[derive(Clone, Debug, PartialEq)]
pub struct Given<T: RealField> {
    /// The step before which.
    pub step: usize,
    /// Number of the vehicle.
    pub id: VehicleId,
    /// With respect to the numbers that became others; 0 with respect to those that stayed as they were.
    pub gradient: VehicleGradient<T>,
}

impl<T, R> RollOut<T, R>
where
    T: RealField + Copy,
    R: DifferentiableRule<T>,
{
    /// Moves the scene by that many steps and remembers how.
    #[must_use]
    pub fn record(scene: &mut Simulator<T, R>, steps: usize) -> Self {
        let nothing: Undisturbed<T, R> = |_, _| Ok(());
        let mut roll_out = Self { steps, copies: Vec::new() };
        for step in 0..steps {
            if step.is_multiple_of(spacing(steps)) {
                roll_out.keep(step, scene, &nothing);
            }
            scene.step();
        }
        if steps == 0 {
            roll_out.keep(0, scene, &nothing);
        }
        roll_out
    }
}

impl<T, R, F> RollOut<T, R, F>
where
    T: RealField + Copy,
    R: DifferentiableRule<T>,
    F: FnMut(usize, &mut Simulator<T, R>) -> Result<(), ForceError> + Clone,
{
    /// Moves the scene by that many steps, calls `control` before each with the number of steps so far, and remembers how.
    ///
    /// `control` may add, place, admit and remove vehicles and set their states, wishes and rules. What it sets counts as
    /// given, whatever it was computed from ([`RollOutGradient::given`]), but for a number that it sets to what it was anyhow;
    /// an acceleration ([`Drive::Accelerate`](crate::Drive::Accelerate)) always counts. It is copied with the scene and called again on
    /// the way back, with what it has captured: an [`Inflow`](crate::Inflow) that it owns repeats itself.
    ///
    /// # Errors
    /// Those of `control`; the scene is left as it was then.
    pub fn controlled(scene: &mut Simulator<T, R>, steps: usize, control: F) -> Result<Self, ForceError> {
        Self::spaced(scene, steps, spacing(steps), control)
    }

    /// The same, with a copy of the scene every `between` steps, rather than every `sqrt(steps)`.
    ///
    /// # Errors
    /// As [`RollOut::controlled`].
    pub fn spaced(
        scene: &mut Simulator<T, R>,
        steps: usize,
        between: usize,
        mut control: F,
    ) -> Result<Self, ForceError> {
        let mut roll_out = Self { steps, copies: Vec::new() };
        for step in 0..steps {
            if step.is_multiple_of(between.max(1)) {
                roll_out.keep(step, scene, &control);
            }
            control(step, scene)?;
            scene.step();
        }
        if steps == 0 {
            roll_out.keep(0, scene, &control);
        }
        Ok(roll_out)
    }

    /// Steps of the roll-out.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Copies of the scene that are kept.
    #[must_use]
    pub fn copies(&self) -> usize {
        self.copies.len()
    }

    /// Gradient of a number that depends on the scenes of the roll-out.
    ///
    /// `cotangents` is called for every scene, the last first: with the steps taken so far, from [`RollOut::steps`] to 0, the
    /// scene after them, and the gradient so far, to which it adds the gradient of the number with respect to that scene.
    /// Vehicles that left in the last of these steps have an entry too, with respect to how they left.
    ///
    /// # Errors
    /// Those of `cotangents`, and of what controls the roll-out.
    pub fn vjp(
        &self,
        mut cotangents: impl FnMut(usize, &Simulator<T, R>, &mut SceneGradient<T>) -> Result<(), ForceError>,
    ) -> Result<RollOutGradient<T>, ForceError> {
        let mut gradient: Option<SceneGradient<T>> = None;
        let mut given = Vec::new();
        let mut end = self.steps;
        for copied in self.copies.iter().rev() {
            let (mut before, mut after) = copied.again(end)?;
            let gradient = gradient.get_or_insert_with(|| SceneGradient::zeros(&after));
            while let Some(Copied { step, scene, mut control }) = before.pop() {
                let mut edited = scene.bare();
                control(step, &mut edited)?;
                gradient.fit(&edited);
                cotangents(step + 1, &after, gradient)?;
                edited.step_vjp(gradient);
                gradient.fit(&scene);
                let taken = gradient.take_given(&scene, &edited);
                given.extend(taken.into_iter().map(|(id, gradient)| Given { step, id, gradient }));
                after = scene;
            }
            if copied.step == 0 {
                cotangents(0, &after, gradient)?;
            }
            end = copied.step;
        }
        let scene = gradient.unwrap_or_default();
        Ok(RollOutGradient { scene, given })
    }

    fn keep(&mut self, step: usize, scene: &Simulator<T, R>, control: &F) {
        self.copies.push(Copied { step, scene: scene.bare(), control: control.clone() });
    }
}

impl<T, R, F> Copied<T, R, F>
where
    T: RealField + Copy,
    R: DifferentiableRule<T>,
    F: FnMut(usize, &mut Simulator<T, R>) -> Result<(), ForceError> + Clone,
{
    /// The scenes before the steps up to `end`, and the one after the last.
    fn again(&self, end: usize) -> Result<(Vec<Self>, Simulator<T, R>), ForceError> {
        let (mut scene, mut control) = (self.scene.bare(), self.control.clone());
        let mut before = Vec::with_capacity(end - self.step);
        for step in self.step..end {
            before.push(Self { step, scene: scene.bare(), control: control.clone() });
            control(step, &mut scene)?;
            scene.step();
        }
        Ok((before, scene))
    }
}

impl<T: RealField + fmt::Debug, R, F> fmt::Debug for RollOut<T, R, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RollOut").field("steps", &self.steps).field("copies", &self.copies.len()).finish()
    }
}

/// Steps between copies, such that there are about as many copies as steps between two.
fn spacing(steps: usize) -> usize {
    steps.isqrt().max(1)
}
