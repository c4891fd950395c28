//! Velocities from positions: central where both sides are known, one-sided at the ends.

use crate::recording::{Dataset, Recording, State};

impl Recording {
    /// State in `row` of `track` with nothing in it from a later row.
    ///
    /// NGSIM records no velocity vector: it is differentiated from positions, here backwards over
    /// one frame. highD records velocities; the recorded one of this row is returned. The first
    /// row of a track has no earlier one and borrows the next.
    #[must_use]
    pub fn state_one_sided(&self, track: usize, row: usize) -> State {
        let state = self.state(row);
        if self.meta.dataset == Dataset::HighD || row == self.tracks[track].rows.start {
            return state;
        }
        let rate = self.meta.rate_hz as f32;
        let c = &self.columns;
        State { vx: (c.x[row] - c.x[row - 1]) * rate, vy: (c.y[row] - c.y[row - 1]) * rate, ..state }
    }
}
