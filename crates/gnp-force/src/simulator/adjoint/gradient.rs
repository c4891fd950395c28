//! Gradients of a number with respect to everything that a scene starts from.
use crate::{
    error::ForceError,
    rule::DifferentiableRule,
    simulator::{Drive, Simulator, VehicleId},
    state::StateGradient,
};
use nalgebra::{RealField, Vector2};

/// Gradient of a number with respect to one vehicle of a scene; its size and its limits are constants.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleGradient<T: RealField> {
    /// With respect to its position and velocity.
    pub state: StateGradient<T>,
    /// With respect to the two numbers of its wish: speed and lateral position of [`Drive::Cruise`], the place of
    /// [`Drive::Goal`], the acceleration of [`Drive::Accelerate`] and 0; for other drives both 0.
    pub wish: Vector2<T>,
    /// With respect to its relaxation time.
    pub tau: T,
    /// With respect to the parameters of its rule, in the order of [`DifferentiableRule::names`].
    pub rule: Vec<T>,
}

impl<T: RealField + Copy> VehicleGradient<T> {
    /// That of a number which does not depend on the vehicle, for a rule with that many parameters.
    #[must_use]
    pub fn zeros(parameters: usize) -> Self {
        let (state, wish) = (StateGradient::zeros(), Vector2::zeros());
        Self { state, wish, tau: T::zero(), rule: vec![T::zero(); parameters] }
    }
}

/// Gradient of a number with respect to a scene, by vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneGradient<T: RealField> {
    /// In the order of numbers.
    vehicles: Vec<(VehicleId, VehicleGradient<T>)>,
}

impl<T: RealField> Default for SceneGradient<T> {
    fn default() -> Self {
        Self { vehicles: Vec::new() }
    }
}

impl<T: RealField + Copy> SceneGradient<T> {
    /// That of a number which does not depend on the scene.
    #[must_use]
    pub fn zeros<R: DifferentiableRule<T>>(scene: &Simulator<T, R>) -> Self {
        let mut gradient = Self::default();
        gradient.fit(scene);
        gradient
    }

    /// The gradient with respect to one vehicle; none if there is none of that number.
    #[must_use]
    pub fn get(&self, id: VehicleId) -> Option<&VehicleGradient<T>> {
        self.vehicles.binary_search_by_key(&id, |(id, _)| *id).ok().map(|at| &self.vehicles[at].1)
    }

    /// The gradient with respect to one vehicle, to be changed.
    ///
    /// # Errors
    /// When there is none of that number.
    pub fn of(&mut self, id: VehicleId) -> Result<&mut VehicleGradient<T>, ForceError> {
        let at = self.vehicles.binary_search_by_key(&id, |(id, _)| *id);
        at.map(|at| &mut self.vehicles[at].1).map_err(|_| ForceError::UnknownVehicle { id })
    }

    /// All vehicles, in the order of their numbers.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (VehicleId, &VehicleGradient<T>)> {
        self.vehicles.iter().map(|(id, gradient)| (*id, gradient))
    }

    /// Has an entry for every vehicle of the scene, and says where.
    pub(super) fn fit<R: DifferentiableRule<T>>(&mut self, scene: &Simulator<T, R>) -> Vec<usize> {
        let mut places = Vec::with_capacity(scene.ids.len());
        let mut at = 0;
        for (id, vehicle) in scene.vehicles() {
            while self.vehicles.get(at).is_some_and(|(other, _)| *other < id) {
                at += 1;
            }
            let parameters = vehicle.rule.names().len();
            if self.vehicles.get(at).is_none_or(|(other, _)| *other != id) {
                self.vehicles.insert(at, (id, VehicleGradient::zeros(parameters)));
            }
            self.vehicles[at].1.rule.resize(parameters, T::zero());
            places.push(at);
        }
        places
    }

    /// The entry at a place that [`SceneGradient::fit`] named.
    #[inline]
    pub(super) fn at(&mut self, place: usize) -> &mut VehicleGradient<T> {
        &mut self.vehicles[place].1
    }

    /// Takes the gradient with respect to what a program gave vehicles out of the one with respect to the scene, `edited`,
    /// after which it is that with respect to the scene as it was, `before`.
    pub(super) fn take_given<R: DifferentiableRule<T>>(
        &mut self,
        before: &Simulator<T, R>,
        edited: &Simulator<T, R>,
    ) -> Vec<(VehicleId, VehicleGradient<T>)> {
        let mut given = Vec::new();
        for (id, was) in before.vehicles() {
            let (Some(is), Ok(gradient)) = (edited.vehicle(id), self.of(id)) else { continue };
            let parameters = is.rule.names().len();
            let mut taken = VehicleGradient::zeros(parameters);
            let mut any = false;
            let mut take = |was: T, is: T, from: &mut T, to: &mut T| {
                if was != is {
                    any = true;
                    *to = *from;
                    *from = T::zero();
                }
            };
            for i in 0..2 {
                let (from, to) = (&mut gradient.state, &mut taken.state);
                take(was.state.position[i], is.state.position[i], &mut from.position[i], &mut to.position[i]);
                take(was.state.velocity[i], is.state.velocity[i], &mut from.velocity[i], &mut to.velocity[i]);
            }
            // An acceleration that is given anew is given, also when it is the same: what an open-loop control sets.
            let steered = matches!(is.drive, Drive::Accelerate(_)) && edited.was_given_a_drive(id);
            let same_kind = !steered && std::mem::discriminant(&was.drive) == std::mem::discriminant(&is.drive);
            let (wanted, wants) = (wish_of(&was.drive), wish_of(&is.drive));
            for i in 0..2 {
                let wanted = if same_kind { wanted[i] } else { wants[i] + T::one() };
                take(wanted, wants[i], &mut gradient.wish[i], &mut taken.wish[i]);
            }
            let (old, new) = (was.rule.parameters(), is.rule.parameters());
            if was.rule.names() == is.rule.names() {
                for i in 0..parameters {
                    take(old[i], new[i], &mut gradient.rule[i], &mut taken.rule[i]);
                }
            } else {
                any = true;
                taken.rule = std::mem::replace(&mut gradient.rule, vec![T::zero(); old.len()]);
            }
            if any {
                given.push((id, taken));
            }
        }
        given
    }
}

/// The numbers that [`VehicleGradient::wish`] is about.
fn wish_of<T: RealField + Copy>(drive: &Drive<T>) -> Vector2<T> {
    match drive {
        Drive::Goal { goal, .. } => goal.coords,
        Drive::Cruise { speed, y } => Vector2::new(*speed, *y),
        Drive::Accelerate(along) => Vector2::new(*along, T::zero()),
        Drive::Follow(_) | Drive::Steady => Vector2::zeros(),
    }
}
