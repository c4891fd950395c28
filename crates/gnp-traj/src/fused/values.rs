//! A batch as plain numbers.

use gnp_force::Arity;

use crate::roll_out::Sizes;
use crate::terms::Terms;
use crate::{Phase, TrajConfig, TrajError};

/// What [`RollOutBatch`](crate::RollOutBatch) holds, with given neighbours, as plain numbers in the window frame; m and s.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RollOutValues {
    /// Number of windows.
    pub windows: usize,
    /// Observed frames of each.
    pub t_obs: usize,
    /// Goals of each.
    pub goals_each: usize,
    /// Neighbour slots of each; 0 without neighbours.
    pub slots: usize,
    /// Entries for lane lines of each; 0 without lines.
    pub most_lines: usize,
    /// Number of frames to predict.
    pub steps: usize,
    /// Frame period, in s.
    pub dt: f64,
    /// Observed states `(x, y, vx, vy)` `[windows, t_obs, 4]`.
    pub observed: Vec<f32>,
    /// `[windows, goals_each, 2]`
    pub goals: Vec<f32>,
    /// States `(x, y, vx, vy)` as each step sets out, `[windows, steps, slots, 4]`.
    pub neighbours: Vec<f32>,
    /// Which slots are taken, `[windows, slots]`.
    pub neighbour_present: Vec<bool>,
    /// `(y, kind, side)` as in [`Lines`](crate::Lines), `[windows, most_lines, 3]`.
    pub lines: Vec<f32>,
    /// Which entries are lines, `[windows, most_lines]`.
    pub line_present: Vec<bool>,
}

impl RollOutValues {
    /// Takes the sizes apart, after every length was compared.
    pub(crate) fn check(&self, cfg: &TrajConfig, terms: &Terms, phase: Phase) -> Result<Sizes, TrajError> {
        let Self { windows, t_obs, goals_each, slots, most_lines, steps, dt, .. } = *self;
        for (name, value) in [("windows", windows), ("t_obs", t_obs), ("goals_each", goals_each), ("steps", steps)] {
            if value == 0 {
                let problem = "is 0; give at least one window, frame, goal and step".to_owned();
                return Err(TrajError::Batch { name, problem });
            }
        }
        if !(dt.is_finite() && dt > 0.) {
            let problem = format!("is {dt} s; give the frame period, a positive number");
            return Err(TrajError::Batch { name: "dt", problem });
        }
        for (name, found, dims) in [
            ("observed", self.observed.len(), &[windows, t_obs, 4][..]),
            ("goals", self.goals.len(), &[windows, goals_each, 2]),
            ("neighbours", self.neighbours.len(), &[windows, steps, slots, 4]),
            ("neighbour_present", self.neighbour_present.len(), &[windows, slots]),
            ("lines", self.lines.len(), &[windows, most_lines, 3]),
            ("line_present", self.line_present.len(), &[windows, most_lines]),
        ] {
            if found != dims.iter().product::<usize>() {
                return Err(TrajError::Shape { name, found: vec![found], expected: format!("values for {dims:?}") });
            }
        }
        let seen = |arity, count| if terms.act_from(arity, cfg, phase) { count } else { 0 };
        let (slots, lines) = (seen(Arity::PerNeighbour, slots), seen(Arity::PerLine, most_lines));
        let [pull, k, k_line] = terms.learned(cfg, phase);
        let (k, k_line) = (k && slots > 0, k_line && lines > 0);
        Ok(Sizes { batch: windows, observed: t_obs, goals: goals_each, slots, lines, pull, k, k_line })
    }
}
