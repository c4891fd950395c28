//! What is behind a forecast: the forces by term, and what each cause moved.

use std::fmt;
use std::sync::Arc;

use gnp_force::TermDescriptor;

/// Why a path is what it is: the goal, the terms of the force, which add up to the acceleration of each step, and the
/// contributions, which add up to the way from constant velocity to the path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Explanation {
    /// Where the vehicle is drawn to, m, window frame.
    pub goal: [f32; 2],
    /// The terms that act, in the order in which they are added up.
    pub terms: Vec<TermForces>,
    /// Velocity at the last observed frame, m/s: where it leads is what contributions are counted from.
    pub velocity: [f32; 2],
    /// What moved the vehicle away from that velocity, cause by cause; empty where it was not asked for.
    pub contributions: Vec<Contribution>,
}

/// How far one cause moved a vehicle away from its present velocity.
#[derive(Clone, Debug, PartialEq)]
pub struct Contribution {
    /// The cause.
    pub cause: Cause,
    /// Displacement after each predicted frame, m, window frame.
    pub displacement: Vec<[f32; 2]>,
}

/// What moves a vehicle away from its present velocity.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// The driver alone, as if nobody were known ahead: what is left of the present acceleration. Otherwise the speed
    /// stays: the wish for another one acts behind a leader, up to whom the road is known to be free.
    FreeRoad,
    /// A vehicle ahead in the lane: how the path changes by it, where the nearer ones are gone. It mostly holds back; it
    /// draws on where the road up to it is freer than what is known without it.
    Leader {
        /// Number of the vehicle.
        vehicle: u32,
        /// Its place in the column ahead, from 1.
        place: usize,
    },
    /// All vehicles farther ahead in the lane than the nearest one together, where they are not told apart.
    FartherLeaders,
    /// What the network expects the driver to do beyond that: the pull of the goal.
    Intention,
    /// The repulsion of a neighbour.
    Neighbour {
        /// Number of the vehicle.
        vehicle: u32,
    },
    /// The repulsion of all neighbours together, where they are not told apart.
    Neighbours,
    /// Another term of the force, by its name, such as `lines`.
    Term(String),
}

impl Cause {
    /// Whether a law of physics with named parameters speaks here, not what a network expects of the driver.
    #[must_use]
    pub fn is_physical(&self) -> bool {
        *self != Self::Intention
    }

    /// The vehicle that it is, where it is one.
    #[must_use]
    pub fn vehicle(&self) -> Option<u32> {
        match self {
            Self::Leader { vehicle, .. } | Self::Neighbour { vehicle } => Some(*vehicle),
            _ => None,
        }
    }

    /// Whether it is the same one in another forecast: a leader stays himself where his place in the column changes.
    #[must_use]
    pub fn is_same_as(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Leader { vehicle, .. }, Self::Leader { vehicle: other, .. }) => vehicle == other,
            _ => self == other,
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FreeRoad => f.write_str("free road"),
            Self::Leader { vehicle, place: 1 } => write!(f, "leader {vehicle}"),
            Self::Leader { vehicle, place } => write!(f, "leader {vehicle} ({place} ahead)"),
            Self::FartherLeaders => f.write_str("farther leaders"),
            Self::Intention => f.write_str("intention"),
            Self::Neighbour { vehicle } => write!(f, "neighbour {vehicle}"),
            Self::Neighbours => f.write_str("neighbours"),
            Self::Term(name) => f.write_str(name),
        }
    }
}

impl Contribution {
    /// Displacement after `step` steps, m: none before the first.
    #[must_use]
    pub fn after(&self, step: usize) -> [f32; 2] {
        step.checked_sub(1).and_then(|step| self.displacement.get(step)).copied().unwrap_or_default()
    }

    /// The last of its displacements, m.
    #[must_use]
    pub fn at_end(&self) -> [f32; 2] {
        self.displacement.last().copied().unwrap_or_default()
    }
}

/// One term of the force over the predicted steps, as accelerations in m/s².
#[derive(Clone, Debug, PartialEq)]
pub struct TermForces {
    term: Arc<TermDescriptor>,
    /// Of all sources together, one entry a predicted frame.
    totals: Vec<[f32; 2]>,
    /// Sources of every step.
    sources: usize,
    /// `[steps, sources]`
    forces: Vec<[f32; 2]>,
    /// `[steps, sources]` of each parameter that varies.
    parameters: Vec<Vec<f32>>,
}

impl TermForces {
    /// A term of `sources` sources: their forces `[steps, sources]`, and for each parameter that varies its values
    /// `[steps, sources]`. What is missing counts as 0, and what is too much is left out.
    #[must_use]
    pub fn new(
        term: Arc<TermDescriptor>,
        sources: usize,
        mut forces: Vec<[f32; 2]>,
        mut parameters: Vec<Vec<f32>>,
    ) -> Self {
        let steps = forces.len().checked_div(sources).unwrap_or(0);
        forces.truncate(steps * sources);
        parameters.resize_with(term.varying().count(), Vec::new);
        parameters.iter_mut().for_each(|values| values.resize(steps * sources, 0.));
        let total = |step: &[[f32; 2]]| match step {
            // Kept as it is, down to the sign of a zero.
            [one] => *one,
            all => all.iter().fold([0f32; 2], |sum, force| [sum[0] + force[0], sum[1] + force[1]]),
        };
        let totals = forces.chunks_exact(sources.max(1)).map(total).collect();
        Self { term, totals, sources, forces, parameters }
    }

    /// The same term with these sums, where they are known better than as a sum of sources.
    #[must_use]
    pub fn with_totals(self, totals: Vec<[f32; 2]>) -> Self {
        Self { totals, ..self }
    }

    /// What the term is called, and how it is drawn.
    #[must_use]
    pub fn term(&self) -> &TermDescriptor {
        &self.term
    }

    /// The force of all sources together, one entry a predicted frame.
    #[must_use]
    pub fn totals(&self) -> &[[f32; 2]] {
        &self.totals
    }

    /// The force of all sources together in a step; 0 where there is no such step.
    #[must_use]
    pub fn total(&self, step: usize) -> [f32; 2] {
        self.totals.get(step).copied().unwrap_or_default()
    }

    /// Number of sources: 1, the neighbour slots, or the lane lines from right to left; 0 where only sums are known.
    #[must_use]
    pub fn sources(&self) -> usize {
        self.sources
    }

    /// The force of each source in a step; an empty slot gives 0. Nothing where there is no such step.
    #[must_use]
    pub fn forces(&self, step: usize) -> &[[f32; 2]] {
        self.forces.get(step * self.sources..(step + 1) * self.sources).unwrap_or_default()
    }

    /// The `i`-th of the parameters that vary ([`TermDescriptor::varying`]) in a step, by source. Nothing where there is no
    /// such parameter or step.
    #[must_use]
    pub fn parameter(&self, i: usize, step: usize) -> &[f32] {
        let values = self.parameters.get(i).map_or(&[][..], Vec::as_slice);
        values.get(step * self.sources..(step + 1) * self.sources).unwrap_or_default()
    }
}

impl Explanation {
    /// Where constant velocity and all contributions lead, `[steps, 2]` in m, `dt` s a step; empty without contributions.
    #[must_use]
    pub fn path(&self, dt: f32) -> Vec<[f32; 2]> {
        let steps = self.contributions.iter().map(|part| part.displacement.len()).max().unwrap_or(0);
        let at = |step: usize| {
            let start = self.velocity.map(|v| v * dt * (step + 1) as f32);
            let parts = self.contributions.iter().filter_map(|part| part.displacement.get(step));
            parts.fold(start, |sum, part| [sum[0] + part[0], sum[1] + part[1]])
        };
        (0..steps).map(at).collect()
    }

    /// The sum of the contributions of one kind after the last frame, m.
    #[must_use]
    pub fn moved_by(&self, is: impl Fn(&Cause) -> bool) -> [f32; 2] {
        let parts = self.contributions.iter().filter(|part| is(&part.cause)).map(Contribution::at_end);
        parts.fold([0.; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]])
    }

    /// Number of explained steps.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.terms.iter().map(|term| term.totals.len()).max().unwrap_or(0)
    }

    /// The term of that name.
    #[must_use]
    pub fn term(&self, name: &str) -> Option<&TermForces> {
        self.terms.iter().find(|term| term.term.name == name)
    }

    /// The acceleration of a step: the sum over all terms, m/s².
    #[must_use]
    pub fn total(&self, step: usize) -> [f32; 2] {
        self.terms
            .iter()
            .map(|term| term.total(step))
            .fold([0.; 2], |sum, force| [sum[0] + force[0], sum[1] + force[1]])
    }
}

#[cfg(test)]
mod tests {
    use gnp_force::{Arity, TermParameter};

    use super::*;

    fn descriptor() -> Arc<TermDescriptor> {
        let parameters =
            vec![TermParameter::constant("c", "1/s", "a constant"), TermParameter::varying("k", "m/s²", "k")];
        Arc::new(TermDescriptor::new("push", Arity::PerNeighbour, "#000000").with(parameters))
    }

    #[test]
    fn sources_add_up_and_steps_stay_apart() {
        let forces = vec![[1., 2.], [0.5, -1.], [3., 0.], [0., 4.]];
        let term = TermForces::new(descriptor(), 2, forces, vec![vec![1., 2., 3., 4.]]);
        assert_eq!(term.totals(), [[1.5, 1.], [3., 4.]]);
        assert_eq!((term.forces(1), term.parameter(0, 1)), (&[[3., 0.], [0., 4.]][..], &[3., 4.][..]));
        assert!(term.forces(2).is_empty() && term.parameter(1, 0).is_empty() && term.total(2) == [0., 0.]);
        let explanation = Explanation { goal: [9., 9.], terms: vec![term.clone(), term], ..Explanation::default() };
        assert_eq!((explanation.steps(), explanation.total(0)), (2, [3., 2.]));
        assert!(explanation.term("push").is_some() && explanation.term("pull").is_none());
    }

    #[test]
    fn contributions_lead_from_constant_velocity_to_the_path() {
        let part = |cause, displacement: &[[f32; 2]]| Contribution { cause, displacement: displacement.to_vec() };
        let leader = Cause::Leader { vehicle: 7, place: 1 };
        let explanation = Explanation {
            velocity: [10., 1.],
            contributions: vec![
                part(leader, &[[-1., 0.], [-3., 0.]]),
                part(Cause::Intention, &[[0., 0.5], [1., 0.25]]),
            ],
            ..Explanation::default()
        };
        assert_eq!(explanation.path(0.5), [[4., 1.], [8., 1.25]]);
        assert_eq!(explanation.moved_by(Cause::is_physical), [-3., 0.]);
        assert_eq!(explanation.contributions[0].cause.to_string(), "leader 7");
    }

    #[test]
    fn lists_of_other_lengths_do_no_harm() {
        let term = TermForces::new(descriptor(), 2, vec![[1., 1.]; 5], vec![vec![1.], vec![2.]]);
        assert_eq!((term.totals().len(), term.parameter(0, 1)), (2, &[0., 0.][..]));
        let none = TermForces::new(descriptor(), 0, vec![[1., 1.]; 5], Vec::new()).with_totals(vec![[1., 0.]; 3]);
        assert_eq!((none.totals().len(), none.forces(0).len(), none.sources()), (3, 0, 0));
    }
}
