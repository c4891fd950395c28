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
    /// As `Position`, minus where a vehicle that follows the column ahead would be: what the driver does
    /// that following does not say.
    PlatoonDeviation,
}

/// What a path is measured against: where the vehicle is, where it heads, and which path counts as none.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Last observed position, m.
    pub origin: [f32; 2],
    /// Direction of travel, rad, counter-clockwise from x. 0 in the travel-aligned road frame.
    pub heading: f32,
    /// Way from the origin that is subtracted, `[t_pred, 2]` in m, in the frame of the path; 0 beyond its end, so that
    /// an empty one subtracts nothing ([`ModeFrame::Position`]).
    pub way: Vec<[f32; 2]>,
}

impl Reference {
    /// The way at constant `velocity` (m/s) over `steps` steps of `dt` s ([`ModeFrame::Deviation`]).
    #[must_use]
    pub fn constant_velocity(velocity: [f32; 2], dt: f32, steps: usize) -> Vec<[f32; 2]> {
        (1..=steps).map(|step| Self::after(velocity, dt, step)).collect()
    }

    /// The way after `step` steps of [`Reference::constant_velocity`].
    #[must_use]
    pub fn after(velocity: [f32; 2], dt: f32, step: usize) -> [f32; 2] {
        velocity.map(|v| (f64::from(v) * (step as f64 * f64::from(dt))) as f32)
    }

    /// What is subtracted at step `j`, in the frame of the path, m.
    fn drift(&self, j: usize) -> [f64; 2] {
        let way = self.way.get(j).copied().unwrap_or_default();
        [0, 1].map(|axis| f64::from(self.origin[axis]) + f64::from(way[axis]))
    }
}

/// A path `[t_pred, 2]` measured against `reference`: subtract what it subtracts, then turn the heading onto x. A last
/// odd value is left out.
#[must_use]
pub fn to_mode_frame(path: &[f32], reference: &Reference) -> Vec<f32> {
    let (sin, cos) = f64::from(reference.heading).sin_cos();
    path.chunks_exact(2)
        .enumerate()
        .flat_map(|(j, p)| {
            let [x0, y0] = reference.drift(j);
            let (x, y) = (f64::from(p[0]) - x0, f64::from(p[1]) - y0);
            [(cos * x + sin * y) as f32, (cos * y - sin * x) as f32]
        })
        .collect()
}

/// The inverse of [`to_mode_frame`].
#[must_use]
pub fn from_mode_frame(path: &[f32], reference: &Reference) -> Vec<f32> {
    let (sin, cos) = f64::from(reference.heading).sin_cos();
    path.chunks_exact(2)
        .enumerate()
        .flat_map(|(j, p)| {
            let [x0, y0] = reference.drift(j);
            let (x, y) = (f64::from(p[0]), f64::from(p[1]));
            [(x0 + cos * x - sin * y) as f32, (y0 + sin * x + cos * y) as f32]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slanted(way: Vec<[f32; 2]>) -> Reference {
        Reference { origin: [3., -7.], heading: 0.4, way }
    }

    #[test]
    fn there_and_back_is_where_we_were() {
        let path = [4., -6.5, 5.5, -6.25, 7., -5.5];
        for way in [Vec::new(), Reference::constant_velocity([12., 5.], 0.1, 3)] {
            let reference = slanted(way);
            let back = from_mode_frame(&to_mode_frame(&path, &reference), &reference);
            for (a, b) in path.iter().zip(&back) {
                assert!((a - b).abs() < 1e-5, "{reference:?}: {path:?} became {back:?}");
            }
        }
    }

    #[test]
    fn constant_velocity_has_no_deviation() {
        let path: Vec<f32> = (1..=4).flat_map(|j| [3. + 1.2 * j as f32, -7. + 0.5 * j as f32]).collect();
        let deviation = to_mode_frame(&path, &slanted(Reference::constant_velocity([12., 5.], 0.1, 4)));
        assert!(deviation.iter().all(|d| d.abs() < 1e-5), "{deviation:?}");
    }

    #[test]
    fn the_heading_is_turned_onto_x() {
        let north = Reference { origin: [1., 2.], heading: std::f32::consts::FRAC_PI_2, way: Vec::new() };
        // Three metres ahead, then one to the left of it.
        let moved = to_mode_frame(&[1., 5., 0., 5.], &north);
        for (a, b) in moved.iter().zip([3., 0., 3., 1.]) {
            assert!((a - b).abs() < 1e-6, "{moved:?}");
        }
    }
}
