//! A straight road: lines along x, the lanes between them, where lanes end, and whether it closes to a ring.
use crate::{
    error::{ForceError, require, require_not_negative, require_positive},
    field::Line,
    line::{MarkingKind, Side},
    scalar::lit,
};
use nalgebra::RealField;

/// A stretch on which a lane cannot be used: works, or the place where it ends.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Closure<T> {
    /// The lane, 0 the rightmost.
    pub lane: usize,
    /// Where it begins, in m; to a vehicle in the lane, something that stands there.
    pub from: T,
    /// Where it ends, in m; beyond the end of the section for a lane that does not go on.
    pub to: T,
}

/// Lines along the road, from right to left, and the lanes between neighbouring lines.
///
/// Lane 0 is the rightmost. A place beyond the outermost line counts to the lane beside it. A road without lines is one
/// lane without edges.
///
/// ```
/// use gnp_force::Road;
/// let road = Road::motorway(3, 3.75)?;
/// assert_eq!((road.lanes(), road.lane_centre(1)), (3, Some(5.625)));
/// assert_eq!(road.lane_at(8.0), 2);
/// let works = road.ending_at(2000.0)?.closing(2, 1200.0, 1500.0)?; // the left lane is closed for 300 m
/// assert_eq!(works.closures().len(), 1);
/// let ring = Road::motorway(1, 3.75)?.ring(230.0)?;
/// assert_eq!(ring.distance(225.0, 5.0), 10.0); // over the seam
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Parts<T>", into = "Parts<T>"))]
#[cfg_attr(
    feature = "serde",
    serde(bound(
        serialize = "T: RealField + Copy + serde::Serialize",
        deserialize = "T: RealField + Copy + serde::Deserialize<'de>"
    ))
)]
pub struct Road<T> {
    lines: Vec<Line<T>>,
    circumference: Option<T>,
    end: Option<T>,
    closures: Vec<Closure<T>>,
}

impl<T: RealField + Copy> Road<T> {
    /// A road of these lines, in any order.
    ///
    /// # Errors
    /// When a position is not finite, two lines share one, or a strength is negative or not finite.
    pub fn new(mut lines: Vec<Line<T>>) -> Result<Self, ForceError> {
        for line in &lines {
            require(line.y.is_finite(), "line.y", line.y, "finite")?;
            require_not_negative("line.k", line.k)?;
        }
        lines.sort_by(|a, b| a.y.partial_cmp(&b.y).unwrap_or(std::cmp::Ordering::Equal));
        for pair in lines.windows(2) {
            require(pair[0].y < pair[1].y, "line.y", pair[1].y, "different for every line")?;
        }
        Ok(Self { lines, ..Self::open() })
    }

    /// A road without lines: one lane without edges.
    #[must_use]
    pub fn open() -> Self {
        Self { lines: Vec::new(), circumference: None, end: None, closures: Vec::new() }
    }

    /// A carriageway of `lanes` lanes of `lane_width` m, its right edge at y = 0.
    ///
    /// Centre lines have k = 0.2 m²/s², so that they push at most 0.17 m/s² and can be crossed; edges have
    /// k = 0.3 m⁴/s², which is 0.05 m/s² in the middle of a lane 3.75 m wide, 0.3 m/s² at 1 m, where the wheels reach
    /// the edge, and at most 2.4 m/s².
    ///
    /// # Errors
    /// Without a lane, or when the width is not positive.
    pub fn motorway(lanes: usize, lane_width: T) -> Result<Self, ForceError> {
        require(lanes > 0, "lanes", T::zero(), "at least 1")?;
        require_positive("lane_width", lane_width)?;
        let edge = |y, road| Line { kind: MarkingKind::Boundary, y, road, k: lit(0.3) };
        let mut lines = vec![edge(T::zero(), Side::Left)];
        let mut y = T::zero();
        for _ in 1..lanes {
            y += lane_width;
            lines.push(Line { kind: MarkingKind::LaneDivider, y, road: Side::Left, k: lit(0.2) });
        }
        lines.push(edge(y + lane_width, Side::Right));
        Self::new(lines)
    }

    /// The same road closed to a ring of `circumference` m: positions along it lie in `[0, circumference)`, and who
    /// passes the seam goes on at 0.
    ///
    /// # Errors
    /// When the circumference is not positive and finite, or the road has an end or a closure beyond the seam.
    pub fn ring(self, circumference: T) -> Result<Self, ForceError> {
        require_positive("ring", circumference)?;
        if let Some(end) = self.end {
            return require(false, "end", end, "none on a ring").map(|()| self);
        }
        let road = Self { circumference: Some(circumference), ..self };
        road.closures.iter().try_for_each(|closure| road.check_closure(closure))?;
        Ok(road)
    }

    /// The same road with an end at `x` m, where vehicles leave the scene.
    ///
    /// # Errors
    /// When `x` is not finite, or the road is a ring.
    pub fn ending_at(self, x: T) -> Result<Self, ForceError> {
        require(x.is_finite(), "end", x, "finite")?;
        require(self.circumference.is_none(), "end", x, "none on a ring")?;
        Ok(Self { end: Some(x), ..self })
    }

    /// The same road with one lane closed between `from` and `to` m.
    ///
    /// # Errors
    /// When there is no such lane, `to` is not beyond `from`, or on a ring the stretch crosses the seam.
    pub fn closing(mut self, lane: usize, from: T, to: T) -> Result<Self, ForceError> {
        let closure = Closure { lane, from, to };
        self.check_closure(&closure)?;
        self.closures.push(closure);
        Ok(self)
    }

    fn check_closure(&self, closure: &Closure<T>) -> Result<(), ForceError> {
        let Closure { lane, from, to } = *closure;
        require(lane < self.lanes(), "closure.lane", lit::<T>(lane as f64), "a lane of the road, 0 the rightmost")?;
        require(from.is_finite(), "closure.from", from, "finite")?;
        require(to > from && to.is_finite(), "closure.to", to, "finite and beyond `from`")?;
        if let Some(circumference) = self.circumference {
            let inside = from >= T::zero() && to <= circumference;
            require(inside, "closure.to", to, "on a ring, between 0 and the circumference")?;
        }
        Ok(())
    }

    /// The lines from right to left.
    #[must_use]
    pub fn lines(&self) -> &[Line<T>] {
        &self.lines
    }

    /// Where lanes are closed.
    #[must_use]
    pub fn closures(&self) -> &[Closure<T>] {
        &self.closures
    }

    /// Length of the ring in m; none for a road that is not one.
    #[must_use]
    pub fn circumference(&self) -> Option<T> {
        self.circumference
    }

    /// Where vehicles leave, in m; none for a road without an end.
    #[must_use]
    pub fn end(&self) -> Option<T> {
        self.end
    }

    /// Number of lanes, at least 1.
    #[must_use]
    pub fn lanes(&self) -> usize {
        self.lines.len().saturating_sub(1).max(1)
    }

    /// The lane at lateral position `y` in m, 0 the rightmost.
    #[inline]
    #[must_use]
    pub fn lane_at(&self, y: T) -> usize {
        self.lines.iter().filter(|line| line.y <= y).count().saturating_sub(1).min(self.lanes() - 1)
    }

    /// Lateral position of the middle of a lane in m; none for a lane that does not exist or has no edge.
    #[must_use]
    pub fn lane_centre(&self, lane: usize) -> Option<T> {
        let (right, left) = (self.lines.get(lane)?, self.lines.get(lane + 1)?);
        Some((right.y + left.y) * lit(0.5))
    }

    /// Whether `y` m is between the outermost lines; always so on a road without lines.
    #[must_use]
    pub fn contains(&self, y: T) -> bool {
        match self.lines.as_slice() {
            [] => true,
            // A single line has the road on one side.
            [line] => line.kind == MarkingKind::LaneDivider || (line.road == Side::Left) == (y >= line.y),
            [right, .., left] => right.y <= y && y <= left.y,
        }
    }

    /// The way forward from one place to another, in m: on a ring from 0 to less than the circumference, elsewhere their
    /// difference.
    #[must_use]
    pub fn distance(&self, from: T, to: T) -> T {
        self.wrapped(to - from)
    }

    /// A place along the road, on a ring in `[0, circumference)`.
    #[inline]
    #[must_use]
    pub fn wrapped(&self, x: T) -> T {
        let Some(circumference) = self.circumference else { return x };
        if x >= T::zero() && x < circumference {
            return x;
        }
        let inside = x - (x / circumference).floor() * circumference;
        // Rounding may give the circumference itself.
        if inside >= circumference { T::zero() } else { inside }
    }

    /// The most all lines together can push, in m/s²: 0.858 k for a centre line, 8 k for a boundary.
    #[must_use]
    pub fn strongest_push(&self) -> T {
        self.lines.iter().fold(T::zero(), |sum, line| {
            let most = match line.kind {
                MarkingKind::LaneDivider => lit::<T>((2.0_f64 / std::f64::consts::E).sqrt()),
                MarkingKind::Boundary => lit(8.0),
            };
            sum + line.k * most
        })
    }
}

/// What a road is read from and written as.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts<T> {
    lines: Vec<Line<T>>,
    #[serde(default = "none")]
    ring: Option<T>,
    #[serde(default = "none")]
    end: Option<T>,
    #[serde(default = "Vec::new")]
    closures: Vec<Closure<T>>,
}

#[cfg(feature = "serde")]
fn none<T>() -> Option<T> {
    None
}

#[cfg(feature = "serde")]
impl<T: RealField + Copy> TryFrom<Parts<T>> for Road<T> {
    type Error = ForceError;

    fn try_from(parts: Parts<T>) -> Result<Self, ForceError> {
        let mut road = Self::new(parts.lines)?;
        if let Some(circumference) = parts.ring {
            road = road.ring(circumference)?;
        }
        if let Some(end) = parts.end {
            road = road.ending_at(end)?;
        }
        parts.closures.into_iter().try_fold(road, |road, Closure { lane, from, to }| road.closing(lane, from, to))
    }
}

#[cfg(feature = "serde")]
impl<T> From<Road<T>> for Parts<T> {
    fn from(road: Road<T>) -> Self {
        Self { lines: road.lines, ring: road.circumference, end: road.end, closures: road.closures }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_belong_to_the_lane_between_two_lines_or_the_nearest() {
        let road = Road::motorway(3, 4.0).unwrap();
        let lanes = [-7.0, 0.0, 3.9, 4.0, 7.9, 8.1, 11.9, 12.0, 30.0].map(|y| road.lane_at(y));
        assert_eq!(lanes, [0, 0, 0, 1, 1, 2, 2, 2, 2]);
        assert_eq!([0, 1, 2, 3].map(|lane| road.lane_centre(lane)), [Some(2.0), Some(6.0), Some(10.0), None]);
        assert_eq!((Road::<f64>::open().lanes(), Road::<f64>::open().lane_at(99.0)), (1, 0));
        assert_eq!([-0.1, 0.0, 12.0, 12.1].map(|y| road.contains(y)), [false, true, true, false]);
        let edge = Line { kind: MarkingKind::Boundary, y: 1.0, road: Side::Left, k: 0.3 };
        assert_eq!([0.9, 1.1, 50.0].map(|y| Road::new(vec![edge]).unwrap().contains(y)), [false, true, true]);
    }

    #[test]
    fn lines_are_put_in_order_and_edges_face_the_road() {
        let sorted: Vec<Line<f64>> = Road::motorway(2, 3.5).unwrap().lines().to_vec();
        let reversed = sorted.iter().rev().copied().collect();
        assert_eq!(Road::new(reversed).unwrap().lines(), sorted);
        assert_eq!(
            sorted.iter().map(|line| line.kind).collect::<Vec<_>>(),
            [MarkingKind::Boundary, MarkingKind::LaneDivider, MarkingKind::Boundary]
        );
        assert_eq!((sorted[0].road, sorted[2].road), (Side::Left, Side::Right));
    }

    #[test]
    fn places_on_a_ring_stay_on_it() {
        let ring = Road::open().ring(230.0).unwrap();
        assert_eq!([-1.0, 0.0, 229.0, 230.0, 470.0].map(|x| ring.wrapped(x)), [229.0, 0.0, 229.0, 0.0, 10.0]);
        assert!(ring.wrapped(-1e-15) < 230.0, "rounding leads to 0, not to the seam from the other side");
        assert_eq!(Road::open().wrapped(-5.0), -5.0);
    }

    #[test]
    fn rings_ends_and_closures_that_contradict_each_other_are_refused() {
        let road = || Road::motorway(2, 3.75).unwrap();
        assert!(road().ring(0.0).is_err() && road().ring(f64::NAN).is_err());
        assert!(road().ring(100.0).unwrap().ending_at(50.0).is_err());
        assert!(road().ending_at(50.0).unwrap().ring(100.0).is_err());
        assert!(road().closing(2, 0.0, 1.0).is_err() && road().closing(0, 5.0, 5.0).is_err());
        assert!(road().closing(0, 50.0, 150.0).unwrap().ring(100.0).is_err());
    }
}
