//! Roads that curve: a [`ReferenceLine`] along the road, by which a position in the plane, `[x, y]`, is a distance
//! along it and one across it, `(s, d)`, and back.
//!
//! All lengths are in m, angles in rad, in f64. `s` grows along the line; `d` grows to its left, where the plane is
//! right-handed (x to the right, y up), and [`ReferenceLine::mirrored`] keeps it so where y points down.
//! [`RoadFile`] reads the line from a file.
//!
//! ```
//! use gnp_road::ReferenceLine;
//!
//! // A quarter of a circle with a radius of 500 m, to the left, as points 20 m apart.
//! let points: Vec<[f64; 2]> = (0..40).map(|i| f64::from(i) * 0.04).map(|a| [500. * a.sin(), 500. - 500. * a.cos()]).collect();
//! let line = ReferenceLine::from_points(&points)?;
//! // 3.5 m to the left of the line, at 45 degrees:
//! let a = std::f64::consts::FRAC_PI_4;
//! let point = line.locate([496.5 * a.sin(), 500. - 496.5 * a.cos()])?;
//! assert!((point.s - 500. * a).abs() < 0.001 && (point.d - 3.5).abs() < 0.001);
//! assert!((point.heading - a).abs() < 1e-4 && (point.curvature - 1. / 500.).abs() < 1e-5);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod boxes;
mod error;
mod file;
mod geojson;
mod lane_lines;
mod line;
mod opendrive;
mod piece;
mod plane;
mod points;
mod spline;

pub use crate::error::{LineError, OffLine};
pub use crate::file::{RoadFile, RoadFileError};
pub use crate::lane_lines::{LaneLinesError, check_lane_lines, parse_lane_lines};
pub use crate::line::{EXTENSION, REACH, ReferenceLine, RoadPoint};
pub use crate::points::{MAX_LENGTH, MAX_POINTS, MAX_TURN, MIN_RADIUS, MIN_SPACING};
