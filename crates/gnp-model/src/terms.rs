//! The terms of a model's force: which there are, one more, and some fewer.

use std::sync::Arc;

use gnp_baselines::PlatoonRule;
use gnp_force::TermDescriptor;
use gnp_traj::ForceTerm;

use crate::error::ModelError;
use crate::gnp::{Gnp, Trained};

impl Gnp {
    /// The same model with one more term of the force, with these values of its parameters.
    ///
    /// Where the reference path is the platoon's, the force acts in a frame that moves with it along the road: positions
    /// and velocities that the term is given are relative to it, those of neighbours alike.
    ///
    /// # Errors
    /// As [`gnp_traj::SocialForce::with_term`]; [`ModelError::Config`] for a model without physics, in which a term could not act.
    pub fn with_term(mut self, law: Arc<dyn ForceTerm<f32>>, parameters: &[f64]) -> Result<Self, ModelError> {
        let own = Arc::make_mut(&mut self.trained);
        let Some((force, phase)) = own.force.take() else {
            return Err(ModelError::config("force", "is not part of this model: a term has nothing to act in"));
        };
        own.force = Some((force.with_term(law, parameters)?, phase));
        Ok(self)
    }

    /// The terms of the force in the order of explanations, whether they act or are switched off; none for a model
    /// without physics.
    #[must_use]
    pub fn term_descriptors(&self) -> Vec<Arc<TermDescriptor>> {
        let Trained { force, features, .. } = &*self.trained;
        let Some((force, _)) = force else { return Vec::new() };
        let of_platoon = features.platoon().map(|_| PlatoonRule::terms());
        force.term_descriptors().cloned().chain(of_platoon.into_iter().flatten()).collect()
    }

    /// The same model without the terms of these names, which [`Gnp::term_descriptors`] lists: they exert no force, and
    /// explanations name neither them nor what they cause. The networks are shared.
    ///
    /// The networks see the scene as it is and expect the same deviation from the reference path, in which the terms of the
    /// platoon no longer act on the target: without `car_following` it drives as if nobody were ahead, without `free_road` it
    /// only ever brakes for a leader, without `habit` nothing of its present acceleration goes on. Without `goal` the vehicle
    /// keeps to the reference path but for the other forces, and sideways to its velocity. Without any term it keeps its
    /// velocity. Other vehicles drive with all terms; with [`NeighbourFuture::Joint`](crate::NeighbourFuture::Joint) they lose those of the force, too.
    ///
    /// # Errors
    /// [`ModelError::UnknownTerm`] with the names that there are.
    pub fn without_terms(&self, names: &[&str]) -> Result<Self, ModelError> {
        let known = self.term_descriptors();
        if let Some(name) = names.iter().find(|name| known.iter().all(|term| term.name != **name)) {
            let known = known.iter().map(|term| term.name.to_string()).collect();
            return Err(ModelError::UnknownTerm { name: (*name).to_owned(), known });
        }
        let mut changed = self.clone();
        let Some((force, phase)) = &self.trained.force else { return Ok(changed) };
        let is_of_force = |name: &&str| force.term_descriptors().any(|term| term.name == **name);
        let (of_force, of_platoon): (Vec<&str>, Vec<&str>) = names.iter().copied().partition(is_of_force);
        changed.acting =
            of_platoon.into_iter().fold(self.acting, |acting, name| acting.without(name).unwrap_or(acting));
        if !of_force.is_empty() {
            let force = force.clone().without_terms(&of_force)?;
            Arc::make_mut(&mut changed.trained).force = Some((force, *phase));
        }
        Ok(changed)
    }
}
