//! From the frame of a carriageway back to the plane of the file that a recording comes from.

use crate::recording::{Recording, Road};

impl Road {
    /// A position of this carriageway's frame, m, in the plane of the file, m; unchanged where there is no `axis`.
    ///
    /// Positions are of centres, and in m, whatever the file has them of and in.
    #[must_use]
    pub fn to_file_coordinates(&self, [x, y]: [f32; 2]) -> [f64; 2] {
        let [s, d] = [f64::from(x), f64::from(y)];
        self.axis.as_ref().map_or([s, d], |axis| axis.to_world(s, d))
    }

    /// A velocity at `position` of this carriageway's frame, m/s, in the plane of the file: on a curve the outer vehicle
    /// is faster than its place along the road tells.
    #[must_use]
    pub fn velocity_to_file_coordinates(&self, [x, y]: [f32; 2], velocity: [f32; 2]) -> [f64; 2] {
        let velocity = velocity.map(f64::from);
        let axis = self.axis.as_ref();
        axis.map_or(velocity, |axis| axis.at(f64::from(x), f64::from(y)).velocity_to_world(velocity))
    }
}

impl Recording {
    /// A position of the frame of carriageway `road` (an index of [`Recording::roads`]), m, in the plane of the file, m:
    /// [`Road::to_file_coordinates`]. Unchanged where there is no such carriageway.
    #[must_use]
    pub fn to_file_coordinates(&self, road: u16, position: [f32; 2]) -> [f64; 2] {
        let road = self.roads.get(usize::from(road));
        road.map_or(position.map(f64::from), |road| road.to_file_coordinates(position))
    }
}
