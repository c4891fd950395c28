//! Whether points make a line.

use crate::error::LineError;
use crate::piece::Piece;
use crate::plane::{Vector, cross, dot, length, sub};

/// Most points of a line.
pub const MAX_POINTS: usize = 1_000_000;

/// Least distance between two points that follow one another, m.
pub const MIN_SPACING: f64 = 0.05;

/// Largest angle between the chords before and after a point, degrees: on a radius of 150 m points are then up to 75 m
/// apart, and a junction's corner is none of a road.
pub const MAX_TURN: f64 = 30.;

/// Least radius of the curve, m: half of that of the tightest ramps.
pub const MIN_RADIUS: f64 = 20.;

/// Longest line, m: from one end of a country to the other.
pub const MAX_LENGTH: f64 = 2e6;

/// Largest coordinate, m: that of no map projection in m is beyond it.
pub(crate) const MAX_COORDINATE: f64 = 1e8;

/// Refuses points of which no line can be made.
pub(crate) fn check(points: &[Vector]) -> Result<(), LineError> {
    match points.len() {
        few @ ..2 => return Err(LineError::TooFew(few)),
        many if many > MAX_POINTS => return Err(LineError::TooMany(many)),
        _ => {}
    }
    // NaN is within no bound.
    let within = |position: &Vector| position.iter().all(|c| c.abs() <= MAX_COORDINATE);
    if let Some(i) = points.iter().position(|position| !within(position)) {
        return Err(LineError::Coordinate { point: i + 1, position: points[i] });
    }
    for (i, pair) in points.windows(2).enumerate() {
        let distance = length(sub(pair[1], pair[0]));
        if distance < MIN_SPACING {
            return Err(LineError::Repeated { point: i + 1, distance });
        }
    }
    let chords: f64 = points.windows(2).map(|pair| length(sub(pair[1], pair[0]))).sum();
    if chords > MAX_LENGTH {
        return Err(LineError::TooLong(chords));
    }
    for (i, three) in points.windows(3).enumerate() {
        let (before, after) = (sub(three[1], three[0]), sub(three[2], three[1]));
        let degrees = cross(before, after).atan2(dot(before, after)).abs().to_degrees();
        if degrees > MAX_TURN {
            return Err(LineError::Kink { point: i + 2, position: three[1], degrees });
        }
    }
    Ok(())
}

/// Refuses a curve through `points` that bends more than a road.
pub(crate) fn check_bends(points: &[Vector], pieces: &[Piece]) -> Result<(), LineError> {
    for (i, piece) in pieces.iter().enumerate() {
        for part in [0., 0.5, 1.] {
            let radius = piece.at(part * piece.span).curvature.abs().recip();
            if radius < MIN_RADIUS {
                let point = if part > 0.5 { i + 1 } else { i };
                return Err(LineError::Bend { point: point + 1, position: points[point], radius });
            }
        }
    }
    Ok(())
}
