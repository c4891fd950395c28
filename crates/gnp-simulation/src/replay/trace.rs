//! Where everybody was: of a system, or as recorded.
use gnp_force::State;

/// A course of a scene, one path an actor, in the order of [`Scene::actors`](super::Scene::actors).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// By actor; those who never came have no states.
    pub paths: Vec<Path>,
    /// Time that driven vehicles waited at the entry, together, in s, of those who came in and those who did not.
    pub waited_s: f64,
    /// Driven vehicles that came later than recorded.
    pub late: usize,
    /// Driven vehicles that were to come and did not.
    pub never: usize,
    /// Frames of driven vehicles in which the system could not decide and another one drove, such as a predictor without
    /// enough past.
    pub stood_in: usize,
}

/// States of one actor, a frame each, without a gap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    /// Frame of the first state, counted from the start.
    pub first: usize,
    /// Centre in m and velocity in m/s.
    pub states: Vec<State<f64>>,
}

impl Path {
    /// The state in a frame, if it is there.
    #[must_use]
    pub fn at(&self, frame: usize) -> Option<&State<f64>> {
        self.states.get(frame.checked_sub(self.first)?)
    }

    /// Frame after the last state.
    #[must_use]
    pub fn end(&self) -> usize {
        self.first + self.states.len()
    }
}
