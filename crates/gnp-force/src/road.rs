//! A straight road: lines along x, and the lanes between them.
use crate::{
    error::{ForceError, require, require_not_negative, require_positive},
    field::Line,
    line::{MarkingKind, Side},
    scalar::lit,
};
use nalgebra::RealField;

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
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Vec<Line<T>>", into = "Vec<Line<T>>"))]
#[cfg_attr(
    feature = "serde",
    serde(bound(
        serialize = "T: RealField + Copy + serde::Serialize",
        deserialize = "T: RealField + Copy + serde::Deserialize<'de>"
    ))
)]
pub struct Road<T> {
    lines: Vec<Line<T>>,
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
        Ok(Self { lines })
    }

    /// A road without lines: one lane without edges.
    #[must_use]
    pub fn open() -> Self {
        Self { lines: Vec::new() }
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

    /// The lines from right to left.
    #[must_use]
    pub fn lines(&self) -> &[Line<T>] {
        &self.lines
    }

    /// Number of lanes, at least 1.
    #[must_use]
    pub fn lanes(&self) -> usize {
        self.lines.len().saturating_sub(1).max(1)
    }

    /// The lane at lateral position `y` in m, 0 the rightmost.
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

impl<T: RealField + Copy> TryFrom<Vec<Line<T>>> for Road<T> {
    type Error = ForceError;

    fn try_from(lines: Vec<Line<T>>) -> Result<Self, ForceError> {
        Self::new(lines)
    }
}

impl<T> From<Road<T>> for Vec<Line<T>> {
    fn from(road: Road<T>) -> Self {
        road.lines
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
    }

    #[test]
    fn lines_are_put_in_order_and_edges_face_the_road() {
        let mut lines: Vec<Line<f64>> = Road::motorway(2, 3.5).unwrap().into();
        let sorted = lines.clone();
        lines.reverse();
        assert_eq!(Road::new(lines).unwrap().lines(), sorted);
        assert_eq!(
            sorted.iter().map(|line| line.kind).collect::<Vec<_>>(),
            [MarkingKind::Boundary, MarkingKind::LaneDivider, MarkingKind::Boundary]
        );
        assert_eq!((sorted[0].road, sorted[2].road), (Side::Left, Side::Right));
    }
}
