//! The frame in which futures are clustered, and the way there and back.

use serde::{Deserialize, Serialize};

/// What a mode's coordinates mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModeFrame {
    /// Position relative to the last observed one, in m, x along the heading. The paper's choice:
    /// many of its modes differ in speed alone.
    Position,
    /// As `Position`, minus where constant velocity would have brought the vehicle: what the driver
    /// does, whatever the speed.
    Deviation,
}

/// From where and how fast a vehicle sets out: its state in the last observed frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Last observed position, m.
    pub origin: [f32; 2],
    /// Direction of travel, rad, counter-clockwise from x. 0 in the travel-aligned road frame.
    pub heading: f32,
    /// Last observed velocity, m/s, in the frame of the path.
    pub velocity: [f32; 2],
    /// Frame period, s: step `j` (from 0) of a path is `(j + 1) dt` after the reference.
    pub dt: f32,
}

impl Reference {
    /// Where constant velocity is at step `j`, in the frame of the path, m.
    fn drift(&self, j: usize, frame: ModeFrame) -> [f64; 2] {
        let [x, y] = self.origin.map(f64::from);
        match frame {
            ModeFrame::Position => [x, y],
            ModeFrame::Deviation => {
                let time = (j + 1) as f64 * f64::from(self.dt);
                [x + f64::from(self.velocity[0]) * time, y + f64::from(self.velocity[1]) * time]
            }
        }
    }
}

/// A path `[t_pred, 2]` in the frame of `reference`, moved into a mode's `frame`: subtract what the
/// frame subtracts, then turn the heading onto x. A last odd value is left out.
#[must_use]
pub fn to_mode_frame(path: &[f32], reference: &Reference, frame: ModeFrame) -> Vec<f32> {
    let (sin, cos) = f64::from(reference.heading).sin_cos();
    path.chunks_exact(2)
        .enumerate()
        .flat_map(|(j, p)| {
            let [x0, y0] = reference.drift(j, frame);
            let (x, y) = (f64::from(p[0]) - x0, f64::from(p[1]) - y0);
            [(cos * x + sin * y) as f32, (cos * y - sin * x) as f32]
        })
        .collect()
}

/// The inverse of [`to_mode_frame`].
#[must_use]
pub fn from_mode_frame(path: &[f32], reference: &Reference, frame: ModeFrame) -> Vec<f32> {
    let (sin, cos) = f64::from(reference.heading).sin_cos();
    path.chunks_exact(2)
        .enumerate()
        .flat_map(|(j, p)| {
            let [x0, y0] = reference.drift(j, frame);
            let (x, y) = (f64::from(p[0]), f64::from(p[1]));
            [(x0 + cos * x - sin * y) as f32, (y0 + sin * x + cos * y) as f32]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLANTED: Reference = Reference { origin: [3., -7.], heading: 0.4, velocity: [12., 5.], dt: 0.1 };

    #[test]
    fn there_and_back_is_where_we_were() {
        let path = [4., -6.5, 5.5, -6.25, 7., -5.5];
        for frame in [ModeFrame::Position, ModeFrame::Deviation] {
            let back = from_mode_frame(&to_mode_frame(&path, &SLANTED, frame), &SLANTED, frame);
            for (a, b) in path.iter().zip(&back) {
                assert!((a - b).abs() < 1e-5, "{frame:?}: {path:?} became {back:?}");
            }
        }
    }

    #[test]
    fn constant_velocity_has_no_deviation() {
        let path: Vec<f32> = (1..=4).flat_map(|j| [3. + 1.2 * j as f32, -7. + 0.5 * j as f32]).collect();
        let deviation = to_mode_frame(&path, &SLANTED, ModeFrame::Deviation);
        assert!(deviation.iter().all(|d| d.abs() < 1e-5), "{deviation:?}");
    }

    #[test]
    fn the_heading_is_turned_onto_x() {
        let north = Reference { origin: [1., 2.], heading: std::f32::consts::FRAC_PI_2, velocity: [0., 0.], dt: 1. };
        // Three metres ahead, then one to the left of it.
        let moved = to_mode_frame(&[1., 5., 0., 5.], &north, ModeFrame::Position);
        for (a, b) in moved.iter().zip([3., 0., 3., 1.]) {
            assert!((a - b).abs() < 1e-6, "{moved:?}");
        }
    }
}
