//! Velocities that know no later row.

use crate::recording::{Dataset, Recording};

impl Recording {
    /// Velocity in `row` of `track`, m/s, road frame, with nothing in it from a later row; `None`
    /// where no row up to this one tells it.
    ///
    /// NGSIM records no velocity vector. It is differentiated from positions, centrally in
    /// [`Columns::vx`](crate::Columns::vx), here backwards over one frame, which the first row of a
    /// track does not allow. highD records velocities with every row, so its recorded one is taken.
    #[must_use]
    pub fn velocity_one_sided(&self, track: usize, row: usize) -> Option<[f32; 2]> {
        let c = &self.columns;
        match self.meta.dataset {
            Dataset::HighD => Some([c.vx[row], c.vy[row]]),
            Dataset::Ngsim if row > self.tracks[track].rows.start => {
                let rate = self.meta.rate_hz as f32;
                Some([(c.x[row] - c.x[row - 1]) * rate, (c.y[row] - c.y[row - 1]) * rate])
            }
            Dataset::Ngsim => None,
        }
    }
}
