//! Vectors of the plane.

pub(crate) type Vector = [f64; 2];

pub(crate) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1]]
}

pub(crate) fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1]]
}

pub(crate) fn scale(a: Vector, by: f64) -> Vector {
    [a[0] * by, a[1] * by]
}

pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Positive where `b` points to the left of `a`.
pub(crate) fn cross(a: Vector, b: Vector) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// Coordinates are far from where squares overflow, and a square root takes a tenth of `hypot`.
pub(crate) fn length(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// A quarter of a turn to the left.
pub(crate) fn left(a: Vector) -> Vector {
    [-a[1], a[0]]
}

pub(crate) fn is_finite(a: Vector) -> bool {
    a[0].is_finite() && a[1].is_finite()
}
