//! Boxes, and whether a predicted one overlaps a recorded one.

use crate::case::ScoredWindow;

/// A path's heading is its direction over at least this distance, m: over one frame of slow driving
/// it would be noise.
const HEADING_BASE_M: f32 = 1.;

/// The ground a vehicle covers: a rectangle, window frame, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Footprint {
    centre: [f32; 2],
    /// Half the length and half the width.
    half: [f32; 2],
    /// Cosine and sine of the heading against the road.
    heading: [f32; 2],
}

impl Footprint {
    /// A vehicle of `size` (length, width) that points along the road. Recordings give no heading,
    /// and the angle between a motorway vehicle and its road is small.
    pub(crate) fn along_road(centre: [f32; 2], size: [f32; 2]) -> Self {
        Self { centre, half: [size[0] / 2., size[1] / 2.], heading: [1., 0.] }
    }

    /// Whether the two rectangles share ground; touching does not count. Two convex shapes are
    /// apart exactly when they are apart along a normal of one of their sides.
    fn overlaps(&self, other: &Self) -> bool {
        let between = [other.centre[0] - self.centre[0], other.centre[1] - self.centre[1]];
        let apart = |axis: [f32; 2]| dot(between, axis).abs() >= self.reach(axis) + other.reach(axis);
        let sides = [self.heading, normal(self.heading), other.heading, normal(other.heading)];
        !sides.into_iter().any(apart)
    }

    /// Half the extent along a unit vector.
    fn reach(&self, axis: [f32; 2]) -> f32 {
        self.half[0] * dot(self.heading, axis).abs() + self.half[1] * dot(normal(self.heading), axis).abs()
    }

    /// Half the diagonal: no ground is farther from the centre.
    fn radius(&self) -> f32 {
        self.half[0].hypot(self.half[1])
    }
}

/// Share of the first `k` modes whose box overlaps another vehicle's recorded box in any of
/// `frames` frames.
pub(super) fn share(case: &ScoredWindow<'_>, k: usize, frames: usize) -> f64 {
    let overlapping = case.modes()[..k].iter().filter(|mode| meets_another(case, &mode.path[..frames])).count();
    overlapping as f64 / k as f64
}

/// Whether the recorded boxes of the target and of another vehicle overlap in any of `frames` frames.
pub(super) fn recorded(case: &ScoredWindow<'_>, frames: usize) -> bool {
    meets_another(case, &case.reference().path()[..frames])
}

fn meets_another(case: &ScoredWindow<'_>, path: &[[f32; 2]]) -> bool {
    let reference = case.reference();
    (0..path.len()).any(|j| {
        let mut here = Footprint::along_road(path[j], reference.size());
        let near = |other: &&Footprint| {
            let reach = here.radius() + other.radius();
            let [dx, dy] = [other.centre[0] - here.centre[0], other.centre[1] - here.centre[1]];
            dx * dx + dy * dy < reach * reach
        };
        let mut near = reference.others(j).iter().filter(near).peekable();
        // Few frames have anybody near, so the heading is worked out only there.
        if near.peek().is_none() {
            return false;
        }
        let near: Vec<&Footprint> = near.collect();
        here.heading = heading(path, j);
        near.into_iter().any(|other| here.overlaps(other))
    })
}

/// Direction of the path at frame `j`: from the last earlier point at least [`HEADING_BASE_M`] away,
/// the window's origin included; along the road for a vehicle that has not moved that far.
pub(super) fn heading(path: &[[f32; 2]], j: usize) -> [f32; 2] {
    let earlier = path[..j].iter().rev().chain(std::iter::once(&[0.; 2]));
    for point in earlier {
        let [dx, dy] = [path[j][0] - point[0], path[j][1] - point[1]];
        let distance = dx.hypot(dy);
        if distance >= HEADING_BASE_M {
            return [dx / distance, dy / distance];
        }
    }
    [1., 0.]
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn normal(a: [f32; 2]) -> [f32; 2] {
    [-a[1], a[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(centre: [f32; 2], size: [f32; 2], degrees: f32) -> Footprint {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Footprint { heading: [cos, sin], ..Footprint::along_road(centre, size) }
    }

    #[test]
    fn boxes_overlap_by_their_sides_and_not_by_their_centres() {
        let car = Footprint::along_road([0., 0.], [4., 2.]);
        for (centre, overlap) in
            [([3.9, 0.], true), ([4.1, 0.], false), ([0., 1.9], true), ([0., 2.1], false), ([3.9, 2.1], false)]
        {
            let other = Footprint::along_road(centre, [4., 2.]);
            assert_eq!(car.overlaps(&other), overlap, "{centre:?}");
            assert_eq!(other.overlaps(&car), overlap, "{centre:?}");
        }
    }

    #[test]
    fn a_turned_box_reaches_where_its_corner_is() {
        let car = Footprint::along_road([0., 0.], [4., 2.]);
        // A square of side 2 on its corner reaches 1.414 m to each side.
        assert!(turned([0., 2.3], [2., 2.], 45.).overlaps(&car));
        assert!(!turned([0., 2.5], [2., 2.], 45.).overlaps(&car));
        // Near the corner of the car only the slanted side separates them.
        assert!(!turned([2.8, 1.8], [2., 2.], 45.).overlaps(&car));
        assert!(turned([2.6, 1.6], [2., 2.], 45.).overlaps(&car));
    }

    #[test]
    fn heading_is_taken_over_a_metre() {
        let path = [[0.2, 0.1], [0.4, -0.1], [3., 4.], [3., 4.1]];
        assert_eq!(heading(&path, 1), [1., 0.]);
        let [cos, sin] = heading(&path[..], 2);
        assert!((cos - 2.6 / 2.6f32.hypot(4.1)).abs() < 1e-6 && (sin - 4.1 / 2.6f32.hypot(4.1)).abs() < 1e-6);
        // The point before is 0.1 m away, so the one before that gives the direction.
        let [cos, sin] = heading(&path[..], 3);
        assert!((cos - 2.6 / 2.6f32.hypot(4.2)).abs() < 1e-6 && (sin - 4.2 / 2.6f32.hypot(4.2)).abs() < 1e-6);
    }
}
