//! What the networks read of windows, as tensors in the published axes and unit.

use candle_core::{Device, Result, Tensor};
use gnp_data::{Neighbour, TrackState, Truth, VehicleClass};

use crate::grid::{LANE_CELLS, by_lane};
use crate::oriented_view::{OrientedView, Variation};
use crate::time_grid::{RATE_HZ, TimeGrid};

/// Brings windows to the published networks' form: points at 5 Hz, first axis to the right, second
/// forward, lengths in `unit_m` (a foot as published).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Inputs {
    /// Which frames are points.
    pub(crate) clock: TimeGrid,
    /// Length of the networks' unit, m.
    pub(crate) unit_m: f32,
}

/// The past of a batch of windows. Time is the first dimension, so that a recurrent layer reads
/// whole slices.
#[derive(Clone, Debug)]
pub(crate) struct Past {
    /// Paths of the targets relative to their last point, `[points, windows, 2]`.
    pub(crate) history: Tensor,
    /// Paths of the vehicles in the grid, relative to the target's last point,
    /// `[points, occupied, 2]`, by window and cell.
    pub(crate) neighbours: Tensor,
    /// Their cells, `39 * window + 13 * column + row`.
    pub(crate) cells: Vec<u32>,
    /// Class, speed and acceleration of targets and neighbours, `[points, windows or occupied, 3]`,
    /// for networks that read them. Both rates are backward differences of points.
    pub(crate) features: Option<[Tensor; 2]>,
    /// Vehicles left out because a nearer one stands in their cell.
    pub(crate) collisions: usize,
}

impl Past {
    /// Number of windows.
    ///
    /// # Errors
    /// When the history does not have three dimensions.
    pub(crate) fn windows(&self) -> Result<usize> {
        self.history.dim(1)
    }
}

impl Inputs {
    /// A point or displacement of the window's frame (m, forward and to the left) in the networks'.
    #[must_use]
    pub(crate) fn point(&self, state: TrackState) -> [f32; 2] {
        [-state.y / self.unit_m, state.x / self.unit_m]
    }

    /// The inverse of [`Inputs::point`].
    #[must_use]
    pub(crate) fn metres(&self, [right, forward]: [f32; 2]) -> [f32; 2] {
        [forward * self.unit_m, -right * self.unit_m]
    }

    /// The target's path, oldest point first.
    pub(crate) fn target(&self, seen: &OrientedView<'_>) -> Vec<[f32; 2]> {
        self.frames().map(|frame| self.point(seen.variation.turn(seen.observation.target(frame)))).collect()
    }

    /// A neighbour's path in the target's window frame.
    pub(crate) fn neighbour(&self, neighbour: &Neighbour<'_>, variation: Variation) -> Vec<[f32; 2]> {
        self.frames().map(|frame| self.point(variation.turn(neighbour.state(frame).unwrap_or_default()))).collect()
    }

    fn frames(&self) -> impl Iterator<Item = usize> {
        let clock = self.clock;
        (0..clock.past()).map(move |k| clock.observed_frame(k))
    }

    /// The past of windows with their grids by lane; class, speed and acceleration on request.
    ///
    /// # Errors
    /// When the tensors cannot be made.
    pub(crate) fn past(&self, windows: &[OrientedView<'_>], features: bool, device: &Device) -> Result<Past> {
        let (mut targets, mut neighbours, mut cells) = (Vec::new(), Vec::new(), Vec::new());
        let (mut target_classes, mut neighbour_classes) = (Vec::new(), Vec::new());
        let mut collisions = 0;
        for (b, seen) in windows.iter().enumerate() {
            targets.push(self.target(seen));
            target_classes.push(seen.observation.class());
            let grid = by_lane(&seen.observation, seen.variation.along);
            collisions += grid.collisions;
            for occupant in grid.occupants {
                neighbours.push(self.neighbour(&occupant.neighbour, seen.variation));
                neighbour_classes.push(occupant.neighbour.class());
                cells.push((LANE_CELLS * b + seen.variation.lane_cell(occupant.cell)) as u32);
            }
        }
        let points = self.clock.past();
        let of = |paths: &[Vec<[f32; 2]>], classes: &[VehicleClass]| {
            let rows: Vec<Vec<[f32; 3]>> = paths.iter().zip(classes).map(|(path, class)| rates(path, *class)).collect();
            by_time(&rows, points, device)
        };
        let features =
            if features { Some([of(&targets, &target_classes)?, of(&neighbours, &neighbour_classes)?]) } else { None };
        Ok(Past {
            history: by_time(&targets, points, device)?,
            neighbours: by_time(&neighbours, points, device)?,
            cells,
            features,
            collisions,
        })
    }

    /// True futures, `[windows, points, 2]`: for losses and scores alone.
    ///
    /// # Errors
    /// When the tensor cannot be made.
    pub(crate) fn futures<'t>(
        &self,
        truths: impl ExactSizeIterator<Item = (Truth<'t>, Variation)>,
        device: &Device,
    ) -> Result<Tensor> {
        let (windows, points) = (truths.len(), self.clock.future());
        let mut values = Vec::with_capacity(windows * points * 2);
        for (truth, variation) in truths {
            for k in 0..points {
                values.extend(self.point(variation.turn(truth.target(self.clock.predicted_frame(k)))));
            }
        }
        Tensor::from_vec(values, (windows, points, 2), device)
    }
}

/// Rows of `N` values a point as `[points, rows, N]`.
pub(crate) fn by_time<const N: usize>(rows: &[Vec<[f32; N]>], points: usize, device: &Device) -> Result<Tensor> {
    let values: Vec<f32> = (0..points).flat_map(|k| rows.iter().flat_map(move |row| row[k])).collect();
    Tensor::from_vec(values, (points, rows.len(), N), device)
}

/// Class code, speed and acceleration at each point of a path, from the points up to it. The first
/// point takes the speed of the second, and the acceleration is 0 until two speeds are known.
fn rates(path: &[[f32; 2]], class: VehicleClass) -> Vec<[f32; 3]> {
    let code = match class {
        VehicleClass::Motorcycle => 1.,
        VehicleClass::Car => 2.,
        VehicleClass::Truck => 3.,
    };
    let rate = RATE_HZ as f32;
    let mut speeds: Vec<f32> =
        path.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]) * rate).collect();
    speeds.insert(0, speeds.first().copied().unwrap_or_default());
    let acceleration = |k: usize| if k < 2 { 0. } else { (speeds[k] - speeds[k - 1]) * rate };
    speeds.iter().enumerate().map(|(k, speed)| [code, *speed, acceleration(k)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_look_back_alone() {
        // 1, 2 and 4 units a fifth of a second: 5, 10 and 20 a second.
        let path = [[0., 0.], [0., 1.], [0., 3.], [0., 7.]];
        let found = rates(&path, VehicleClass::Truck);
        assert_eq!(found, [[3., 5., 0.], [3., 5., 0.], [3., 10., 25.], [3., 20., 50.]]);
    }

    #[test]
    fn points_turn_and_turn_back() {
        let shape = gnp_data::WindowShape { t_obs: 31, t_pred: 50, step: 1, rate_hz: 10. };
        let inputs = Inputs { clock: TimeGrid::new(shape).unwrap(), unit_m: 0.5 };
        let state = TrackState { x: 3., y: 1., ..TrackState::default() };
        assert_eq!(inputs.point(state), [-2., 6.]);
        assert_eq!(inputs.metres([-2., 6.]), [3., 1.]);
    }
}
