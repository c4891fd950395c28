//! The forces behind a forecast, by term.

use std::sync::Arc;

use gnp_force::TermDescriptor;

/// Why a path is what it is: the goal, and the terms of the force, which add up to the acceleration of each step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Explanation {
    /// Where the vehicle is drawn to, m, window frame.
    pub goal: [f32; 2],
    /// The terms that act, in the order in which they are added up.
    pub terms: Vec<TermForces>,
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
        let explanation = Explanation { goal: [9., 9.], terms: vec![term.clone(), term] };
        assert_eq!((explanation.steps(), explanation.total(0)), (2, [3., 2.]));
        assert!(explanation.term("push").is_some() && explanation.term("pull").is_none());
    }

    #[test]
    fn lists_of_other_lengths_do_no_harm() {
        let term = TermForces::new(descriptor(), 2, vec![[1., 1.]; 5], vec![vec![1.], vec![2.]]);
        assert_eq!((term.totals().len(), term.parameter(0, 1)), (2, &[0., 0.][..]));
        let none = TermForces::new(descriptor(), 0, vec![[1., 1.]; 5], Vec::new()).with_totals(vec![[1., 0.]; 3]);
        assert_eq!((none.totals().len(), none.forces(0).len(), none.sources()), (3, 0, 0));
    }
}
