//! Roads whose course is known exactly: curvature linear in the length, piece by piece, as roads are built.

use std::f64::consts::TAU;

/// Straights, arcs and clothoids, one after the other.
pub(crate) struct Road {
    /// Length, curvature at the beginning and at the end, of each element.
    elements: Vec<[f64; 3]>,
    origin: [f64; 2],
    heading: f64,
}

/// A place on a road: position and heading.
pub(crate) type Pose = ([f64; 2], f64);

impl Road {
    pub(crate) fn new(elements: &[[f64; 3]]) -> Self {
        Self { elements: elements.to_vec(), origin: [0., 0.], heading: 0. }
    }

    pub(crate) fn at(self, origin: [f64; 2], heading: f64) -> Self {
        Self { origin, heading, ..self }
    }

    /// Straight, clothoid, arc of radius 150 m, clothoid, and the same to the right.
    pub(crate) fn s_curve() -> Self {
        let k = 1. / 150.;
        Self::new(&[
            [120., 0., 0.],
            [80., 0., k],
            [150., k, k],
            [80., k, 0.],
            [40., 0., 0.],
            [80., 0., -k],
            [150., -k, -k],
            [80., -k, 0.],
            [120., 0., 0.],
        ])
    }

    /// The elements as the plan view of an OpenDRIVE file, road `id`, with `lanes`.
    pub(crate) fn open_drive(&self, id: &str, lanes: &str) -> String {
        let mut starts = vec![0.];
        for element in &self.elements {
            starts.push(starts[starts.len() - 1] + element[0]);
        }
        let poses = self.poses(&starts);
        let geometry = |((s, ([x, y], heading)), [length, first, last]): ((&f64, &Pose), &[f64; 3])| {
            let shape = match (first == last, *first) {
                (true, 0.) => "<line/>".to_owned(),
                (true, curvature) => format!("<arc curvature=\"{curvature}\"/>"),
                _ => format!("<spiral curvStart=\"{first}\" curvEnd=\"{last}\"/>"),
            };
            format!(
                "<geometry s=\"{s}\" x=\"{x}\" y=\"{y}\" hdg=\"{heading}\" length=\"{length}\">{shape}</geometry>\n"
            )
        };
        let view: String = starts.iter().zip(&poses).zip(&self.elements).map(geometry).collect();
        let length = self.length();
        format!("<road id=\"{id}\" junction=\"-1\" length=\"{length}\"><planView>{view}</planView>{lanes}</road>\n")
    }

    pub(crate) fn length(&self) -> f64 {
        self.elements.iter().map(|element| element[0]).sum()
    }

    /// Curvature at `s`.
    pub(crate) fn curvature(&self, s: f64) -> f64 {
        let mut from = 0.;
        for [length, first, last] in &self.elements {
            if s <= from + length {
                return first + (last - first) * (s - from) / length;
            }
            from += length;
        }
        0.
    }

    /// Poses at growing lengths, by Simpson's rule over steps of a few centimetres.
    pub(crate) fn poses(&self, at: &[f64]) -> Vec<Pose> {
        let heading_over = |from: f64, to: f64| {
            let middle = (from + to) / 2.;
            (to - from) * (self.curvature(from) + 4. * self.curvature(middle) + self.curvature(to)) / 6.
        };
        let (mut position, mut heading, mut s) = (self.origin, self.heading, 0.);
        at.iter()
            .map(|to| {
                let steps = ((to - s) / 0.05).ceil().max(1.);
                let h = (to - s) / steps;
                for _ in 0..steps as usize {
                    let (half, whole) = (heading + heading_over(s, s + h / 2.), heading + heading_over(s, s + h));
                    for (axis, f) in [(0, f64::cos as fn(f64) -> f64), (1, f64::sin)] {
                        position[axis] += h * (f(heading) + 4. * f(half) + f(whole)) / 6.;
                    }
                    (s, heading) = (s + h, whole);
                }
                (position, heading)
            })
            .collect()
    }
}

/// From 0 to `length` in steps of `step` or a little less.
pub(crate) fn every(step: f64, length: f64) -> Vec<f64> {
    let count = (length / step).ceil() as usize;
    (0..=count).map(|i| length * i as f64 / count as f64).collect()
}

/// `d` to the left of a pose.
pub(crate) fn beside((position, heading): Pose, d: f64) -> [f64; 2] {
    [position[0] - d * heading.sin(), position[1] + d * heading.cos()]
}

pub(crate) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Difference of two angles, from -pi to pi.
pub(crate) fn turn(from: f64, to: f64) -> f64 {
    let angle = (to - from).rem_euclid(TAU);
    if angle > TAU / 2. { angle - TAU } else { angle }
}
