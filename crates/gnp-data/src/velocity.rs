//! Velocities that know no later row.

use crate::recording::{Recording, VelocitySource};

impl Recording {
    /// Velocity in `row` of `track`, m/s, road frame, with nothing in it from a later row; `None`
    /// where no row up to this one tells it: in the first row of a track whose velocities are derived.
    ///
    /// A recorded velocity is taken as it is. A derived one is central in
    /// [`Columns::vx`](crate::Columns::vx); here it is the backward difference over one frame.
    #[must_use]
    pub fn velocity_one_sided(&self, track: usize, row: usize) -> Option<[f32; 2]> {
        let c = &self.columns;
        match self.meta.velocities {
            VelocitySource::Recorded if self.without_velocity.binary_search(&(track as u32)).is_ok() => None,
            VelocitySource::Recorded => Some([c.vx[row], c.vy[row]]),
            VelocitySource::Derived if row > self.tracks[track].rows.start => {
                let rate = self.meta.rate_hz as f32;
                Some([(c.x[row] - c.x[row - 1]) * rate, (c.y[row] - c.y[row - 1]) * rate])
            }
            VelocitySource::Derived => None,
        }
    }
}
