//! Scenes with the forces behind the prediction: arrows at chosen steps, and every step over time.

use gnp_data::Explanation;
use gnp_force::TermDescriptor;

use crate::axes::{Axis, Panel, nice, shown};
use crate::figure::{Figure, Legend, Sheet, Source};
use crate::palette::{INK, TARGET, TOTAL, rim};
use crate::road_view::{AXIS_SPACE, HIGHEST, LEFT, Paths, RoadView, SPAN, arrow, path_legend};
use crate::scene::Scene;
use crate::svg::{Svg, escape};

/// Longest arrow, user units.
const LONGEST: f64 = 34.;
const CHART: f64 = 62.;
/// Space between the two charts, for the labels of the second.
const BETWEEN: f64 = 54.;

/// Scenes under each other: road, vehicles, all paths, and along the prediction the forces as
/// arrows, `every_s` apart, each from where the vehicle then is. Below each scene the forces of every
/// step. One scale of arrows and of forces for all scenes.
#[must_use]
pub fn force_scenes(name: &str, title: &str, scenes: &[Scene], every_s: f64, source: &Source) -> Figure {
    let mut sheet = Sheet::new(name, title);
    sheet.y = path_legend(&mut sheet.svg, sheet.y, "prediction", "other futures");
    let terms = terms(scenes);
    let all = scenes.iter().filter_map(explanation).flat_map(|e| &e.terms);
    let largest = all.flat_map(|term| term.totals()).copied().map(norm);
    let largest = largest.filter(|force| force.is_finite()).fold(1e-3, f64::max);
    let scale = LONGEST / largest;
    sheet.y = arrow_legend(&mut sheet.svg, sheet.y, &terms, scale, largest);
    for scene in scenes {
        sheet.note(&scene.title);
        let view = RoadView::fit(scene, sheet.y + 3., HIGHEST);
        sheet.svg.group("class=\"scene\"");
        sheet.svg.clipped(name, view.panel.place);
        view.road(&mut sheet.svg, scene);
        view.vehicles(&mut sheet.svg, scene);
        view.paths(&mut sheet.svg, scene, Paths::Prediction);
        arrows(&mut sheet.svg, &view, scene, every_s, scale);
        sheet.svg.end();
        view.frame(&mut sheet.svg);
        sheet.svg.end();
        sheet.y = view.bottom() + AXIS_SPACE;
        if let Some(explanation) = explanation(scene) {
            over_time(&mut sheet.svg, explanation, scene.dt, sheet.y);
            sheet.y += CHART + AXIS_SPACE + 4.;
        }
    }
    let caption = format!(
        "{title}. Boxes at the last observed frame, observed paths, forecast and truth; a diamond is where the lane \
         number changes. Arrows: forces along the prediction every {} s, each from where the vehicle then is; \
         below, the same forces at every step.",
        shown(every_s)
    );
    sheet.finish(&caption, source)
}

fn explanation(scene: &Scene) -> Option<&Explanation> {
    scene.modes.first()?.explanation.as_ref().filter(|e| e.steps() > 0)
}

/// Every term that acts in one of the scenes, once.
fn terms(scenes: &[Scene]) -> Vec<&TermDescriptor> {
    let mut terms: Vec<&TermDescriptor> = Vec::new();
    for term in scenes.iter().filter_map(explanation).flat_map(|e| &e.terms).map(|term| term.term()) {
        if terms.iter().all(|known| known.name != term.name) {
            terms.push(term);
        }
    }
    terms
}

fn norm(force: [f32; 2]) -> f64 {
    f64::from(force[0]).hypot(f64::from(force[1]))
}

/// The forces of step `j` act on the vehicle where step `j - 1` has left it.
fn arrows(svg: &mut Svg, view: &RoadView, scene: &Scene, every_s: f64, scale: f64) {
    let (Some(mode), Some(explanation)) = (scene.modes.first(), explanation(scene)) else { return };
    let every = ((every_s / scene.dt).round() as usize).max(1);
    let shown: Vec<(usize, [f32; 2])> = (0..explanation.steps())
        .step_by(every)
        .filter_map(|j| if j == 0 { Some((0, [0., 0.])) } else { mode.path.get(j - 1).map(|p| (j, *p)) })
        .collect();
    for (_, at) in shown.iter().skip(1) {
        let style = format!(
            "class=\"ghost\" fill=\"none\" stroke=\"{TARGET}\" stroke-width=\"0.8\" stroke-dasharray=\"2 1.5\""
        );
        view.vehicle(svg, *at, scene.size, &style);
    }
    for (j, at) in shown {
        let from = view.panel.at(at[0].into(), at[1].into());
        // The first term on top.
        for term in explanation.terms.iter().rev() {
            let TermDescriptor { name, colour, .. } = term.term();
            arrow(svg, &escape(name), from, term.total(j).map(f64::from), scale, &escape(colour));
        }
    }
}

fn arrow_legend(svg: &mut Svg, y: f64, terms: &[&TermDescriptor], scale: f64, largest: f64) -> f64 {
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let mut legend = Legend::under(y);
    for TermDescriptor { name, label, colour, .. } in terms {
        let [x, y] = legend.place(22., label);
        arrow(svg, &format!("key {}", escape(name)), [x, y - 3.], [18., 0.], 1., &escape(colour));
        svg.text([x + 22., y], label, &small);
    }
    let [x, y] = legend.place(22., "sum");
    let style = format!("stroke=\"{TOTAL}\" stroke-width=\"1.2\" stroke-dasharray=\"3 2\"");
    svg.line([x, y - 3.], [x + 18., y - 3.], &style);
    svg.text([x + 22., y], "sum", &small);
    let size = nice(largest * 0.4);
    let (long, words) = (size * scale, format!("{} m/s\u{b2}", shown(size)));
    let [x, y] = legend.place(long + 5., &words);
    for (from, to) in [([0., -3.], [long, -3.]), ([0., -6.], [0., 0.]), ([long, -6.], [long, 0.])] {
        let style = format!("stroke=\"{INK}\" stroke-width=\"1\"");
        svg.line([x + from[0], y + from[1]], [x + to[0], y + to[1]], &style);
    }
    svg.text([x + long + 5., y], &words, &small);
    legend.bottom()
}

/// Longitudinal and lateral forces side by side.
fn over_time(svg: &mut Svg, explanation: &Explanation, dt: f64, top: f64) {
    let steps = explanation.steps();
    let end = steps as f64 * dt;
    let width = (SPAN - BETWEEN) / 2.;
    let sums: Vec<[f32; 2]> = (0..steps).map(|j| explanation.total(j)).collect();
    for (i, (axis, label)) in [(0, "forward (m/s\u{b2})"), (1, "left (m/s\u{b2})")].into_iter().enumerate() {
        let drawn = explanation.terms.iter().map(|term| term.totals()).chain([&sums[..]]);
        let values = drawn.flatten().map(|force| f64::from(force[axis])).filter(|v| v.is_finite());
        let (low, high) = values.fold((-0.1f64, 0.1f64), |(l, h), v| (l.min(v), h.max(v)));
        let margin = (high - low) * 0.08;
        let place = [LEFT + i as f64 * (width + BETWEEN), top, width, CHART];
        let panel = Panel { place, x: Axis::new(0., end), y: Axis::new(low - margin, high + margin) };
        panel.frame(svg, "time ahead (s)", label, true);
        let curve = |forces: &[[f32; 2]]| -> Vec<[f64; 2]> {
            forces.iter().enumerate().map(|(j, force)| panel.at(j as f64 * dt, force[axis].into())).collect()
        };
        for term in &explanation.terms {
            let TermDescriptor { name, colour, .. } = term.term();
            let (points, name, colour) = (curve(term.totals()), escape(name), escape(colour));
            if let Some(rim) = rim(&colour) {
                svg.path(&points, &format!("fill=\"none\" stroke=\"{rim}\" stroke-width=\"2.6\""));
            }
            svg.path(&points, &format!("class=\"{name}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.4\""));
        }
        svg.path(
            &curve(&sums),
            &format!("class=\"total\" fill=\"none\" stroke=\"{TOTAL}\" stroke-width=\"1.2\" stroke-dasharray=\"3 2\""),
        );
    }
}
