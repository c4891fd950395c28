//! Where everybody was: of a system, or as recorded.
use super::Scene;
use crate::error::SimulationError;
use gnp_data::{Recording, RecordingMeta, Road, Rows, VehicleBody};
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

impl Trace {
    /// The course as a recording that says it was simulated: frame 0 is the start, vehicles have the numbers of the file, lanes
    /// count from the left, 1 leftmost.
    ///
    /// # Errors
    /// When nobody was ever there.
    pub fn recording(&self, scene: &Scene, name: &str) -> Result<Recording, SimulationError> {
        let road = Road { driving_direction: 2, lines: scene.lines.clone(), fitted: false, axis: None };
        let lanes = scene.lines.len().saturating_sub(1).max(1);
        let mut rows = Rows::new(Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut velocity = [Vec::new(), Vec::new()];
        let mut bodies = Vec::new();
        for (actor, path) in scene.actors.iter().zip(&self.paths) {
            let [length, width] = actor.size;
            for (frame, state) in (path.first..).zip(&path.states) {
                rows.vehicle.push(actor.vehicle);
                rows.frame.push(frame as u32);
                rows.x.push(state.position.x as f32);
                rows.y.push(state.position.y as f32);
                rows.lane.push((lanes - scene.lane_at(state.position.y).min(lanes - 1)) as i16);
                velocity[0].push(state.velocity.x as f32);
                velocity[1].push(state.velocity.y as f32);
                bodies.push(VehicleBody { class: actor.class, length, width, road: 0 });
            }
        }
        rows.velocity = Some(velocity);
        let meta = RecordingMeta::new(scene.dataset, scene.site.as_str(), name, scene.rate_hz).with_simulated(true);
        let (recording, _) = Recording::from_rows(meta, vec![road], rows, |row| bodies[row])?;
        Ok(recording)
    }
}
