//! The reference line of a road.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::boxes::Boxes;
use crate::error::{LineError, OffLine};
use crate::piece::{Piece, Place};
use crate::plane::{Vector, add, cross, dot, is_finite, left, length, scale, sub};
use crate::{points, spline};

/// Farthest that a position may be from a curved line, m: both carriageways of eight lanes, from either edge.
pub const REACH: f64 = 50.;

/// Farthest that a position may be beyond the ends of a curved line, m, where it goes on straight.
pub const EXTENSION: f64 = 300.;

/// Least part of its length that a stretch of the line keeps at a position to the inside of a bend.
const LEAST_STRETCH: f64 = 0.1;

/// The nearest place is not farther than this from where the position stands square to the line, m.
const SQUARE: f64 = 1e-6;

/// How far apart places along a line are that may not come near one another, in times of [`REACH`]: half a circle of that
/// radius is as long, so that a loop of a ramp is none.
const APART: f64 = std::f64::consts::PI;

/// A smooth line along a road, by which positions in the plane are places along and across it.
///
/// A curve through points is a cubic spline with continuous curvature ([`ReferenceLine::from_points`]); beyond its ends
/// it goes on straight. Cloning is cheap: the curve is shared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Saved", into = "Saved")]
pub struct ReferenceLine {
    shape: Shape,
    /// Travelled from the end to the beginning.
    reversed: bool,
    /// `d` grows to the other side: the plane's y points down.
    mirrored: bool,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    /// Without ends.
    Straight {
        origin: Vector,
        heading: f64,
        direction: Vector,
    },
    Curve(Arc<Curve>),
}

struct Curve {
    points: Vec<Vector>,
    pieces: Vec<Piece>,
    boxes: Boxes,
    length: f64,
    /// First and last place.
    ends: [Place; 2],
}

/// The pieces are many and follow from the points.
impl std::fmt::Debug for Curve {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Curve").field("points", &self.points).field("length", &self.length).finish_non_exhaustive()
    }
}

/// The pieces follow from the points.
impl PartialEq for Curve {
    fn eq(&self, other: &Self) -> bool {
        self.points == other.points
    }
}

/// A position by the line: where it is along and across, and how the line lies there.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct RoadPoint {
    /// Length along the line, m; negative before its beginning.
    pub s: f64,
    /// Distance from the line, m; positive to the left of travel.
    pub d: f64,
    /// Direction of the line at `s` in the plane, rad, from -pi to pi, anticlockwise from the x axis (where the plane is
    /// mirrored, clockwise as seen).
    pub heading: f64,
    /// Curvature of the line at `s`, 1/m: positive where it bends to the left of travel.
    pub curvature: f64,
    /// Unit vector along the line.
    direction: Vector,
    /// Unit vector to the left of travel.
    across: Vector,
}

impl RoadPoint {
    /// How much longer a path parallel to the line is at this offset than the line: `1 - d * curvature`.
    #[must_use]
    pub fn stretch(&self) -> f64 {
        1. - self.d * self.curvature
    }

    /// Rates of `s` and `d`, m/s, of what moves with `velocity`, m/s, in the plane.
    #[must_use]
    pub fn velocity_to_road(&self, velocity: [f64; 2]) -> [f64; 2] {
        [dot(velocity, self.direction) / self.stretch(), dot(velocity, self.across)]
    }

    /// Velocity in the plane, m/s, of what moves with `rates` of `s` and `d`, m/s.
    #[must_use]
    pub fn velocity_to_world(&self, rates: [f64; 2]) -> [f64; 2] {
        add(scale(self.direction, rates[0] * self.stretch()), scale(self.across, rates[1]))
    }

    /// Direction in the plane, rad, of what moves with `rates` of `s` and `d`, m/s; that of the line for what stands.
    #[must_use]
    pub fn heading_of(&self, rates: [f64; 2]) -> f64 {
        let [x, y] = self.velocity_to_world(rates);
        if x == 0. && y == 0. { self.heading } else { y.atan2(x) }
    }
}

impl ReferenceLine {
    /// A smooth curve through `points`, m, in the order of travel: 5 to 20 m apart where it bends is enough. On a
    /// radius of 150 m and on clothoids that lead to it the curve is then within 1 cm of the true one. Coordinates are taken
    /// to the micrometre.
    ///
    /// # Errors
    /// [`LineError`]: fewer than two points, too many, one that is not finite, two in one place, a kink of more than
    /// [`MAX_TURN`](crate::MAX_TURN), a bend narrower than [`MIN_RADIUS`](crate::MIN_RADIUS), a line that comes back
    /// within [`REACH`] of itself.
    pub fn from_points(points: &[[f64; 2]]) -> Result<Self, LineError> {
        points::check(points)?;
        let points: Vec<Vector> = points.iter().map(|point| point.map(kept)).collect();
        let pieces = spline::through(&points);
        points::check_bends(&points, &pieces)?;
        let boxes = Boxes::new(&pieces);
        let length = pieces.last().map_or(0., |last| last.from + last.length);
        let first = pieces[0].at(0.);
        let ends = [first, pieces.last().map_or(first, |last| last.at(last.span))];
        let curve = Curve { points, pieces, boxes, length, ends };
        curve.check_apart()?;
        Ok(Self { shape: Shape::Curve(Arc::new(curve)), reversed: false, mirrored: false })
    }

    /// A straight line without ends through `origin`, m, where `s` is 0, in the direction `heading`, rad, anticlockwise
    /// from the x axis. Both must be finite, else no position has a place on it.
    #[must_use]
    pub fn straight(origin: [f64; 2], heading: f64) -> Self {
        let (origin, heading) = (origin.map(kept), (heading * 1e12).round() / 1e12);
        let (y, x) = heading.sin_cos();
        // Along an axis exactly, where the angle is rounded.
        let exact = |c: f64| if c.abs() < 1e-12 { 0. } else { c };
        let shape = Shape::Straight { origin, heading, direction: [exact(x), exact(y)] };
        Self { shape, reversed: false, mirrored: false }
    }

    /// The same line, travelled the other way: left becomes right. A curve's `s` begins at its other end.
    #[must_use]
    pub fn reversed(&self) -> Self {
        Self { reversed: !self.reversed, ..self.clone() }
    }

    /// The same line in a plane whose y points down, as in an image: `d` grows to what is the left of travel there.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        Self { mirrored: !self.mirrored, ..self.clone() }
    }

    /// Length between its ends, m; infinite for [`ReferenceLine::straight`].
    #[must_use]
    pub fn length(&self) -> f64 {
        match &self.shape {
            Shape::Straight { .. } => f64::INFINITY,
            Shape::Curve(curve) => curve.length,
        }
    }

    /// The points of which it was made, in the order of travel; none for [`ReferenceLine::straight`].
    #[must_use]
    pub fn points(&self) -> Vec<[f64; 2]> {
        match &self.shape {
            Shape::Straight { .. } => Vec::new(),
            Shape::Curve(curve) if self.reversed => curve.points.iter().rev().copied().collect(),
            Shape::Curve(curve) => curve.points.clone(),
        }
    }

    /// Where a position, m, is along and across the line: by its nearest point.
    ///
    /// # Errors
    /// [`OffLine`]: a position that is not finite. Off a curve, one that is more than [`REACH`] to its side, more than
    /// [`EXTENSION`] beyond its ends, or about the centre of a bend.
    pub fn locate(&self, position: [f64; 2]) -> Result<RoadPoint, OffLine> {
        if !is_finite(position) {
            return Err(OffLine::NotFinite);
        }
        let (along, place) = match &self.shape {
            Shape::Straight { origin, direction, .. } => {
                let along = dot(sub(position, *origin), *direction);
                (along, straight_on(*origin, *direction, along))
            }
            Shape::Curve(curve) => curve.nearest(position)?,
        };
        let left_of = cross(place.direction, sub(position, place.position));
        let point = self.point(along, left_of, &place);
        if !(point.s.is_finite() && point.d.is_finite()) {
            return Err(OffLine::NotFinite);
        }
        if point.stretch() < LEAST_STRETCH {
            return Err(OffLine::InsideBend);
        }
        Ok(point)
    }

    /// [`ReferenceLine::locate`] without a reason: `None` for a position that has no place on the line.
    #[must_use]
    pub fn to_road(&self, position: [f64; 2]) -> Option<RoadPoint> {
        self.locate(position).ok()
    }

    /// The position, m, at `s` along and `d` across the line, m, also beyond its ends and its reach.
    #[must_use]
    pub fn to_world(&self, s: f64, d: f64) -> [f64; 2] {
        let (along, place) = self.place(s);
        let point = self.point(along, 0., &place);
        add(place.position, scale(point.across, d))
    }

    /// The line itself at `s`, m: its heading and curvature there, with `d` as given, m.
    #[must_use]
    pub fn at(&self, s: f64, d: f64) -> RoadPoint {
        let (along, place) = self.place(s);
        RoadPoint { d, ..self.point(along, 0., &place) }
    }

    /// Place on the shape, and how far along the shape it is.
    fn place(&self, s: f64) -> (f64, Place) {
        let along = self.turned(s);
        match &self.shape {
            Shape::Straight { origin, direction, .. } => (along, straight_on(*origin, *direction, along)),
            Shape::Curve(curve) => (along, curve.at(along)),
        }
    }

    /// `s` as the shape counts it, or back.
    fn turned(&self, s: f64) -> f64 {
        match &self.shape {
            Shape::Straight { .. } if self.reversed => -s,
            Shape::Curve(curve) if self.reversed => curve.length - s,
            _ => s,
        }
    }

    /// From what the shape says, without its flags.
    fn point(&self, along: f64, left_of: f64, place: &Place) -> RoadPoint {
        let ahead = if self.reversed { -1. } else { 1. };
        let side = if self.mirrored { -ahead } else { ahead };
        let direction = scale(place.direction, ahead);
        RoadPoint {
            s: self.turned(along),
            d: side * left_of,
            heading: direction[1].atan2(direction[0]),
            curvature: side * place.curvature,
            direction,
            across: scale(left(place.direction), side),
        }
    }
}

/// A coordinate to the micrometre: so many digits come back from a file of text as they were, all 17 may not.
fn kept(coordinate: f64) -> f64 {
    (coordinate * 1e6).round() / 1e6
}

fn straight_on(from: Vector, direction: Vector, along: f64) -> Place {
    Place { position: add(from, scale(direction, along)), direction, curvature: 0. }
}

impl Curve {
    fn at(&self, along: f64) -> Place {
        let [first, last] = self.ends;
        if along < 0. {
            return straight_on(first.position, first.direction, along);
        }
        if along > self.length {
            return straight_on(last.position, last.direction, along - self.length);
        }
        let after = self.pieces.partition_point(|piece| piece.from <= along);
        let piece = &self.pieces[after.saturating_sub(1)];
        piece.at(piece.parameter(along - piece.from))
    }

    /// The nearest place and how far along it is; negative before the beginning.
    fn nearest(&self, position: Vector) -> Result<(f64, Place), OffLine> {
        let [first, last] = self.ends;
        let mut within = REACH * REACH;
        let mut found = None;
        let mut beyond = false;
        for (end, outwards, from) in [(first, -1., 0.), (last, 1., self.length)] {
            let offset = sub(position, end.position);
            let along = dot(offset, end.direction);
            let aside = cross(end.direction, offset).powi(2);
            if along * outwards <= 0. || aside > within {
                continue;
            }
            if along.abs() > EXTENSION {
                beyond = true;
            } else {
                within = aside;
                found = Some((from + along, straight_on(end.position, end.direction, along)));
            }
        }
        let mut parameter = 0.;
        let nearest = self.boxes.nearest(position, within, |piece| {
            let (u, distance2) = self.pieces[piece].nearest(position);
            // Only the last one asked for that is nearer is the nearest.
            if distance2 < within {
                (within, parameter) = (distance2, u);
            }
            distance2
        });
        if let Some((piece, _)) = nearest {
            let piece = &self.pieces[piece];
            let place = piece.at(parameter);
            // Beyond the centre of a bend the distance may have several least values, of which an end of a piece is none.
            if dot(sub(position, place.position), place.direction).abs() > SQUARE {
                return Err(OffLine::InsideBend);
            }
            found = Some((piece.from + piece.length_to(parameter), place));
        }
        found.ok_or(if beyond { OffLine::BeyondTheEnds } else { OffLine::TooFar })
    }

    /// Refuses a curve that comes back to itself.
    fn check_apart(&self) -> Result<(), LineError> {
        // Every place of the curve is within half a step of one of these.
        let step = REACH / 4.;
        let count = (self.length / step).ceil() as usize;
        let places: Vec<(f64, Vector)> =
            (0..=count).map(|i| (i as f64 * step).min(self.length)).map(|s| (s, self.at(s).position)).collect();
        let cell = |position: Vector| position.map(|c| (c / REACH).floor() as i64);
        let mut order: Vec<([i64; 2], usize)> = places.iter().map(|(_, p)| cell(*p)).zip(0..).collect();
        order.sort_unstable();
        for (s, position) in &places {
            let [column, row] = cell(*position);
            for x in column - 1..=column + 1 {
                let start = order.partition_point(|(at, _)| *at < [x, row - 1]);
                for (_, other) in order[start..].iter().take_while(|(at, _)| *at <= [x, row + 1]) {
                    let (t, there) = places[*other];
                    let distance = length(sub(there, *position));
                    if t - s > APART * REACH && distance < REACH {
                        return Err(LineError::Crossing { position: *position, along: [*s, t], distance });
                    }
                }
            }
        }
        Ok(())
    }
}

/// A line as it is kept.
#[derive(Clone, Serialize, Deserialize)]
struct Saved {
    #[serde(flatten)]
    shape: SavedShape,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    reversed: bool,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    mirrored: bool,
}

#[derive(Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SavedShape {
    Straight { origin: Vector, heading: f64 },
    Points(Vec<Vector>),
}

impl From<ReferenceLine> for Saved {
    fn from(line: ReferenceLine) -> Self {
        let shape = match line.shape {
            Shape::Straight { origin, heading, .. } => SavedShape::Straight { origin, heading },
            Shape::Curve(curve) => SavedShape::Points(curve.points.clone()),
        };
        Self { shape, reversed: line.reversed, mirrored: line.mirrored }
    }
}

impl TryFrom<Saved> for ReferenceLine {
    type Error = LineError;

    fn try_from(saved: Saved) -> Result<Self, LineError> {
        let line = match saved.shape {
            SavedShape::Straight { origin, heading } => Self::straight(origin, heading),
            SavedShape::Points(points) => Self::from_points(&points)?,
        };
        Ok(Self { reversed: saved.reversed, mirrored: saved.mirrored, ..line })
    }
}
