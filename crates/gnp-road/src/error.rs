//! What can be wrong with a line, and why a position has no place on one.

use crate::line::{EXTENSION, REACH};
use crate::points::{MAX_COORDINATE, MAX_LENGTH, MAX_POINTS, MAX_TURN, MIN_RADIUS, MIN_SPACING};

/// Points of which no reference line can be made. Points are counted from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// Fewer than two points.
    #[error("{0} points make no line; give two or more, in the order of travel")]
    TooFew(usize),
    /// More points than [`MAX_POINTS`].
    #[error("{0} points; a line may have {MAX_POINTS}: thin them out, 5 to 20 m apart is enough")]
    TooMany(usize),
    /// A coordinate that is not a number, infinite, or farther out than any map projection goes.
    #[error("point {point} is ({}, {}); coordinates must be finite and within {MAX_COORDINATE:.0} m", position[0], position[1])]
    Coordinate {
        /// Which point.
        point: usize,
        /// Where it is.
        position: [f64; 2],
    },
    /// Two points in the same place, or nearer than [`MIN_SPACING`].
    #[error("points {point} and {} are {distance:.3} m apart; keep one of them ({MIN_SPACING} m is the least)", point + 1)]
    Repeated {
        /// The first of the two.
        point: usize,
        /// Distance between them, m.
        distance: f64,
    },
    /// A line longer than [`MAX_LENGTH`].
    #[error("the line is {0:.0} m long, more than {MAX_LENGTH:.0}; check the unit, which must be m")]
    TooLong(f64),
    /// The line turns at a point by more than [`MAX_TURN`].
    #[error(
        "the line turns by {degrees:.0} degrees at point {point}, ({:.1}, {:.1}), more than {MAX_TURN:.0}; \
         add points where the road bends, or look for one that is out of order",
        position[0], position[1]
    )]
    Kink {
        /// Which point.
        point: usize,
        /// Where it is.
        position: [f64; 2],
        /// Angle between the chords before and after it, degrees.
        degrees: f64,
    },
    /// The smooth curve through the points is narrower than [`MIN_RADIUS`].
    #[error(
        "the line bends with a radius of {radius:.1} m at point {point}, ({:.1}, {:.1}), less than {MIN_RADIUS:.0} m; \
         the points are noisy: smooth them or thin them out, 5 to 20 m apart is enough",
        position[0], position[1]
    )]
    Bend {
        /// The nearest point.
        point: usize,
        /// Where it is.
        position: [f64; 2],
        /// Radius, m.
        radius: f64,
    },
    /// The line crosses itself, or comes back within [`REACH`].
    #[error(
        "the line comes back to {distance:.1} m of itself near ({:.1}, {:.1}), {:.0} m and {:.0} m along it, where a \
         position would have two places; cut it in two",
        position[0], position[1], along[0], along[1]
    )]
    Crossing {
        /// Where it comes back.
        position: [f64; 2],
        /// Distances along the line of the two places, m.
        along: [f64; 2],
        /// How near they are, m.
        distance: f64,
    },
}

impl LineError {
    /// The point that is at fault, from 1, where it is one.
    #[must_use]
    pub fn point(&self) -> Option<usize> {
        match self {
            Self::Coordinate { point, .. }
            | Self::Repeated { point, .. }
            | Self::Kink { point, .. }
            | Self::Bend { point, .. } => Some(*point),
            _ => None,
        }
    }
}

/// Why a position has no place along and across a line.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OffLine {
    /// A coordinate is not finite.
    #[error("the position is not finite")]
    NotFinite,
    /// Farther than [`REACH`] to the side.
    #[error("the position is more than {REACH} m from the road's line")]
    TooFar,
    /// Before the beginning or behind the end by more than [`EXTENSION`].
    #[error("the position is more than {EXTENSION} m beyond the ends of the road's line")]
    BeyondTheEnds,
    /// On the inner side of a bend and so near its centre that places along the line run together there.
    #[error("the position is at the centre of a bend of the road's line")]
    InsideBend,
}
