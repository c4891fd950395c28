//! A piece of the curve: a cubic between two points.

use crate::plane::{Vector, add, cross, dot, length, scale, sub};

/// Abscissas and weights of Gauss and Legendre on [0, 1], five points: exact to rounding for a piece that turns by
/// 30 degrees.
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_23),
    (0.5, 0.284_444_444_444_444_45),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_23),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];

/// Steps of a search for a root, at most; each but the first few doubles the digits.
const STEPS: usize = 30;

/// A step as small as this, in spans, leaves an error of its square.
const LAST_STEP: f64 = 1e-9;

/// A place on the curve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) position: Vector,
    /// Unit vector along the curve.
    pub(crate) direction: Vector,
    /// Turn to the left by length, 1/m.
    pub(crate) curvature: f64,
}

/// A cubic over a parameter from 0 to `span`, which is nearly the length along it.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    coefficients: [Vector; 4],
    pub(crate) span: f64,
    /// Length of the curve before this piece, m.
    pub(crate) from: f64,
    /// Length of this piece, m.
    pub(crate) length: f64,
}

impl Piece {
    pub(crate) fn new(coefficients: [Vector; 4], span: f64) -> Self {
        let mut piece = Self { coefficients, span, from: 0., length: 0. };
        piece.length = piece.length_to(span);
        piece
    }

    fn position(&self, u: f64) -> Vector {
        let [a, b, c, d] = self.coefficients;
        add(a, scale(add(b, scale(add(c, scale(d, u)), u)), u))
    }

    fn velocity(&self, u: f64) -> Vector {
        let [_, b, c, d] = self.coefficients;
        add(b, scale(add(scale(c, 2.), scale(d, 3. * u)), u))
    }

    fn acceleration(&self, u: f64) -> Vector {
        let [_, _, c, d] = self.coefficients;
        add(scale(c, 2.), scale(d, 6. * u))
    }

    pub(crate) fn at(&self, u: f64) -> Place {
        let (v, a) = (self.velocity(u), self.acceleration(u));
        let speed = length(v);
        let direction = scale(v, 1. / speed);
        Place { position: self.position(u), direction, curvature: cross(v, a) / speed.powi(3) }
    }

    /// Length from the beginning of the piece to `u`, m.
    pub(crate) fn length_to(&self, u: f64) -> f64 {
        u * GAUSS.iter().map(|(at, weight)| weight * length(self.velocity(at * u))).sum::<f64>()
    }

    /// Parameter at a length from the beginning of the piece, m.
    pub(crate) fn parameter(&self, along: f64) -> f64 {
        let mut u = along * self.span / self.length;
        for _ in 0..STEPS {
            let step = (along - self.length_to(u)) / length(self.velocity(u));
            u = (u + step).clamp(0., self.span);
            if step.abs() <= LAST_STEP * self.span {
                break;
            }
        }
        u
    }

    /// Parameter of the point that is nearest to `position`, and its squared distance. It is the only nearest one
    /// where `position` is on the near side of the curve's centre of curvature.
    pub(crate) fn nearest(&self, position: Vector) -> (f64, f64) {
        let slope = |u: f64| dot(sub(self.position(u), position), self.velocity(u));
        let (mut low, mut high) = (0., self.span);
        let (at_low, at_high) = (slope(low), slope(high));
        let mut u = if at_low >= 0. {
            low
        } else if at_high <= 0. {
            high
        } else {
            low + (high - low) * at_low / (at_low - at_high)
        };
        for _ in 0..STEPS {
            if u <= 0. || u >= self.span {
                break;
            }
            let (offset, v) = (sub(self.position(u), position), self.velocity(u));
            let value = dot(offset, v);
            if value < 0. {
                low = u
            } else {
                high = u
            }
            let newton = u - value / (dot(v, v) + dot(offset, self.acceleration(u)));
            let next = if newton > low && newton < high { newton } else { (low + high) / 2. };
            let step = (next - u).abs();
            u = next;
            if step <= LAST_STEP * self.span {
                break;
            }
        }
        let offset = sub(self.position(u), position);
        (u, dot(offset, offset))
    }

    /// Smallest and largest x and y, of a box that holds the piece: that of its Bézier points.
    pub(crate) fn corners(&self) -> [Vector; 2] {
        let ([a, b, c, _], h) = (self.coefficients, self.span);
        let second = add(a, scale(b, h / 3.));
        let third = add(add(a, scale(b, 2. * h / 3.)), scale(c, h * h / 3.));
        let points = [a, second, third, self.position(h)];
        let fold = |pick: fn(f64, f64) -> f64| {
            points.iter().copied().reduce(|p, q| [pick(p[0], q[0]), pick(p[1], q[1])]).unwrap_or(a)
        };
        [fold(f64::min), fold(f64::max)]
    }
}
