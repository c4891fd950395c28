//! A stretch of road seen from above: lanes, boxes, histories, paths, arrows.

use gnp_data::MarkingKind;

use crate::axes::{Axis, Panel};
use crate::figure::{Legend, WIDTH};
use crate::palette::{BEST, HISTORY, INK, OTHERS, ROAD, TARGET, TRUTH, VEHICLE, rim};
use crate::scene::Scene;
use crate::svg::Svg;

/// Left edge of a view, and its width.
pub(crate) const LEFT: f64 = 48.;
pub(crate) const SPAN: f64 = WIDTH - LEFT - 10.;
/// Road shown to each side of what moves, m.
const REACH: f64 = 8.;
/// Highest view, user units.
pub(crate) const HIGHEST: f64 = 118.;
/// Space under a view for its axis.
pub(crate) const AXIS_SPACE: f64 = 31.;

/// What is drawn of the forecast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Paths {
    /// The best of them dark red, the others lime green.
    Best,
    /// The prediction dark red, the others lime green.
    Prediction,
}

/// A panel for a scene and how much its lateral axis is stretched.
pub(crate) struct RoadView {
    pub(crate) panel: Panel,
    pub(crate) stretch: f64,
}

impl RoadView {
    /// Fits what moves, with some road around it, under `top`; not higher than `highest` unless the road is.
    pub(crate) fn fit(scene: &Scene, top: f64, highest: f64) -> Self {
        Self::fit_all(&[scene], &[], top, highest)
    }

    /// The same for several scenes of one place, and more points, m.
    pub(crate) fn fit_all(scenes: &[&Scene], more: &[[f32; 2]], top: f64, highest: f64) -> Self {
        let modes = || scenes.iter().flat_map(|scene| &scene.modes);
        let paths = modes().flat_map(|mode| mode.path.iter());
        let goals = modes().filter_map(|mode| mode.explanation.as_ref().map(|e| &e.goal));
        let seen = scenes.iter().flat_map(|scene| scene.history.iter().chain(&scene.truth));
        let moving = seen.chain(paths).chain(goals).chain(more);
        let (mut x, mut y) = ([-10f64, 10.], [0f64, 0.]);
        for p in moving.filter(|p| p[0].is_finite() && p[1].is_finite()) {
            x = [x[0].min(p[0].into()), x[1].max(p[0].into())];
            y = [y[0].min(p[1].into()), y[1].max(p[1].into())];
        }
        let edge = |pick: fn(f64, f64) -> f64, start| {
            scenes.iter().flat_map(|scene| &scene.lines).map(|l| f64::from(l.y)).fold(start, pick)
        };
        let (right, left) = (edge(f64::min, f64::INFINITY), edge(f64::max, f64::NEG_INFINITY));
        // Around what moves, but no grass without a reason.
        let low = (y[0] - REACH).max((right - 1.2).min(y[0] - 1.5));
        let high = (y[1] + REACH).min((left + 1.2).max(y[1] + 1.5));
        let (low, high) = if right < left { (low, high) } else { (y[0] - REACH, y[1] + REACH) };
        Self::over([x[0] - 8., x[1] + 8.], [low, high], top, highest)
    }

    /// A view of `x` by `y`, m.
    pub(crate) fn over(x: [f64; 2], y: [f64; 2], top: f64, highest: f64) -> Self {
        let unit = SPAN / (x[1] - x[0]);
        let stretch = ((highest / (unit * (y[1] - y[0])) * 2.).floor() / 2.).clamp(1., 10.);
        let height = unit * stretch * (y[1] - y[0]);
        let place = [LEFT, top, SPAN, height];
        Self { panel: Panel { place, x: Axis::new(x[0], x[1]), y: Axis::new(y[0], y[1]) }, stretch }
    }

    /// Lower edge.
    pub(crate) fn bottom(&self) -> f64 {
        self.panel.place[1] + self.panel.place[3]
    }

    /// Asphalt and lines; `y0` of the road is that of the panel.
    pub(crate) fn road(&self, svg: &mut Svg, scene: &Scene) {
        let [left, top, width, height] = self.panel.place;
        let y_of = |y: f32| self.panel.at(0., y.into())[1];
        match (scene.lines.first(), scene.lines.last()) {
            (Some(right), Some(leftmost)) if right.y < leftmost.y => {
                let (high, low) = (y_of(leftmost.y).max(top), y_of(right.y).min(top + height));
                svg.rect(left, high, width, low - high, &format!("class=\"road\" fill=\"{ROAD}\""));
            }
            _ => svg.rect(left, top, width, height, &format!("class=\"road\" fill=\"{ROAD}\"")),
        }
        for line in &scene.lines {
            let y = y_of(line.y);
            let style = match line.kind {
                MarkingKind::Boundary => "class=\"lane boundary\" stroke=\"#333\" stroke-width=\"1.4\"",
                MarkingKind::LaneDivider => {
                    "class=\"lane centre\" stroke=\"#777\" stroke-width=\"1\" stroke-dasharray=\"7 6\""
                }
            };
            svg.line([left, y], [left + width, y], style);
        }
    }

    /// A box around a centre; the drawing's stretch applies to it too.
    pub(crate) fn vehicle(&self, svg: &mut Svg, centre: [f32; 2], size: [f32; 2], attributes: &str) {
        let [x, y] = centre.map(f64::from);
        let [half, side] = size.map(|s| f64::from(s) / 2.);
        let [left, top] = self.panel.at(x - half, y + side);
        let [right, bottom] = self.panel.at(x + half, y - side);
        svg.rect(left, top, right - left, bottom - top, attributes);
    }

    /// The other vehicles with their histories, then the target.
    pub(crate) fn vehicles(&self, svg: &mut Svg, scene: &Scene) {
        for other in &scene.others {
            let line = thinned(self.panel.points(&other.history), 12);
            svg.path(&line, &format!("class=\"history\" fill=\"none\" stroke=\"{VEHICLE}\" stroke-width=\"0.9\""));
        }
        for other in &scene.others {
            let style = format!("class=\"vehicle\" fill=\"{VEHICLE}\" stroke=\"#4a5260\" stroke-width=\"0.7\"");
            self.vehicle(svg, other.now.centre, other.now.size, &style);
        }
        let style = format!("class=\"target\" fill=\"{TARGET}\" stroke=\"{INK}\" stroke-width=\"0.8\"");
        self.vehicle(svg, [0., 0.], scene.size, &style);
    }

    /// History, forecast and truth of the target.
    pub(crate) fn paths(&self, svg: &mut Svg, scene: &Scene, which: Paths) {
        let first = match which {
            Paths::Best => scene.best(),
            Paths::Prediction => 0,
        };
        let from_here = |path: &[[f32; 2]]| {
            let mut points = vec![self.panel.at(0., 0.)];
            points.extend(self.panel.points(path));
            thinned(points, 40)
        };
        for (i, mode) in scene.modes.iter().enumerate().rev().filter(|(i, _)| *i != first) {
            let points = from_here(&mode.path);
            svg.path(&points, &format!("class=\"mode m{i}\" fill=\"none\" stroke=\"{OTHERS}\" stroke-width=\"1.3\""));
            if let Some(end) = points.last() {
                svg.circle(*end, 1.6, &format!("fill=\"{OTHERS}\""));
            }
        }
        if let Some(mode) = scene.modes.get(first) {
            let points = from_here(&mode.path);
            svg.path(&points, &format!("class=\"best\" fill=\"none\" stroke=\"{BEST}\" stroke-width=\"2.4\""));
            if let Some(end) = points.last() {
                svg.circle(*end, 2.4, &format!("fill=\"{BEST}\""));
            }
        }
        let truth = from_here(&scene.truth);
        let style =
            format!("class=\"truth\" fill=\"none\" stroke=\"{TRUTH}\" stroke-width=\"1.3\" stroke-dasharray=\"3 2.4\"");
        svg.path(&truth, &style);
        let history = thinned(self.panel.points(&scene.history), 40);
        svg.path(&history, &format!("class=\"past\" fill=\"none\" stroke=\"{HISTORY}\" stroke-width=\"2\""));
        for change in &scene.lane_changes {
            let [x, y] = self.panel.at(change[0].into(), change[1].into());
            let diamond = [[x - 3.2, y], [x, y - 3.2], [x + 3.2, y], [x, y + 3.2]];
            svg.area(&diamond, "class=\"lane-change\" fill=\"#fff\" stroke=\"#000\" stroke-width=\"1\"");
        }
    }

    /// Frame and labels, the stretch said.
    pub(crate) fn frame(&self, svg: &mut Svg) {
        let forward = "forward of the vehicle (m)";
        let label = match self.stretch {
            stretch if stretch > 1. => format!("{forward}; lateral axis stretched \u{d7}{stretch}"),
            _ => forward.to_owned(),
        };
        self.panel.frame(svg, &label, "left (m)", false);
    }
}

/// Every n-th point, so that at most about `most` are left, and the last one.
pub(crate) fn thinned(points: Vec<[f64; 2]>, most: usize) -> Vec<[f64; 2]> {
    let (every, last) = (points.len().div_ceil(most).max(1), points.len().saturating_sub(1));
    points.into_iter().enumerate().filter(|(i, _)| i % every == 0 || *i == last).map(|(_, point)| point).collect()
}

/// An arrow from `at` (drawing) for a vector with y to the left, `scale` drawing units per unit; too
/// short ones are left out.
pub(crate) fn arrow(svg: &mut Svg, class: &str, at: [f64; 2], vector: [f64; 2], scale: f64, colour: &str) {
    // y grows downwards in the drawing.
    let (dx, dy) = (vector[0] * scale, -vector[1] * scale);
    let length = dx.hypot(dy);
    if !(length.is_finite() && length >= 1.5) {
        return;
    }
    let (ux, uy) = (dx / length, dy / length);
    let head = length.min(6.);
    let tip = [at[0] + dx, at[1] + dy];
    let neck = [tip[0] - ux * head, tip[1] - uy * head];
    let side = head * 0.45;
    let triangle = [tip, [neck[0] - uy * side, neck[1] + ux * side], [neck[0] + uy * side, neck[1] - ux * side]];
    svg.group(&format!("class=\"arrow {class}\""));
    let rim = rim(colour).unwrap_or_else(|| "#ffffff".to_owned());
    svg.line(at, neck, &format!("stroke=\"{rim}\" stroke-width=\"3.2\""));
    svg.area(&triangle, &format!("fill=\"{colour}\" stroke=\"{rim}\" stroke-width=\"0.8\""));
    svg.line(at, neck, &format!("stroke=\"{colour}\" stroke-width=\"1.9\""));
    svg.end();
}

/// Samples of what the lines mean, below `y`; returns where the next thing may be drawn.
pub(crate) fn path_legend(svg: &mut Svg, y: f64, first: &str, others: &str) -> f64 {
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let mut legend = Legend::under(y);
    let mut entry = |svg: &mut Svg, style: &str, words: &str| {
        let [x, y] = legend.place(22., words);
        svg.line([x, y - 3.], [x + 18., y - 3.], style);
        svg.text([x + 22., y], words, &small);
    };
    entry(svg, &format!("stroke=\"{HISTORY}\" stroke-width=\"2\""), "observed");
    entry(svg, &format!("stroke=\"{BEST}\" stroke-width=\"2.4\""), first);
    entry(svg, &format!("stroke=\"{OTHERS}\" stroke-width=\"1.3\""), others);
    entry(svg, &format!("stroke=\"{TRUTH}\" stroke-width=\"1.3\" stroke-dasharray=\"3 2.4\""), "truth");
    legend.bottom()
}
