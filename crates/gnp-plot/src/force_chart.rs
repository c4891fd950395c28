//! Scenes with the forces behind the likeliest path: arrows at chosen steps, and every step over time.

use gnp_data::{Explanation, StepForces};

use crate::axes::{Axis, Panel, nice, shown};
use crate::figure::{Figure, Legend, Sheet, Source};
use crate::palette::{GOAL, GOAL_RIM, INK, LINES, NEIGHBOURS, TARGET, TOTAL};
use crate::road_view::{AXIS_SPACE, HIGHEST, LEFT, Paths, RoadView, SPAN, arrow, path_legend};
use crate::scene::Scene;
use crate::svg::Svg;

/// Longest arrow, user units.
const LONGEST: f64 = 34.;
const CHART: f64 = 62.;
/// Space between the two charts, for the labels of the second.
const BETWEEN: f64 = 54.;

/// Scenes under each other: road, vehicles, all paths, and along the likeliest one the forces as
/// arrows, `every_s` apart, each from where the vehicle then is. Below each scene the forces of every
/// step. One scale of arrows and of forces for all scenes.
#[must_use]
pub fn force_scenes(name: &str, title: &str, scenes: &[Scene], every_s: f64, source: &Source) -> Figure {
    let mut sheet = Sheet::new(name, title);
    sheet.y = path_legend(&mut sheet.svg, sheet.y, "likeliest", "other futures");
    let largest = scenes.iter().filter_map(explanation).flat_map(|e| &e.steps).flat_map(parts).map(norm);
    let largest = largest.filter(|force| force.is_finite()).fold(1e-3, f64::max);
    let scale = LONGEST / largest;
    sheet.y = arrow_legend(&mut sheet.svg, sheet.y, scale, largest);
    for scene in scenes {
        sheet.note(&scene.title);
        let view = RoadView::fit(scene, sheet.y + 3., HIGHEST);
        sheet.svg.group("class=\"scene\"");
        sheet.svg.clipped(name, view.panel.place);
        view.road(&mut sheet.svg, scene);
        view.vehicles(&mut sheet.svg, scene);
        view.paths(&mut sheet.svg, scene, Paths::Likeliest);
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
         number changes. Arrows: forces along the likeliest path every {} s, each from where the vehicle then is; \
         below, the same forces at every step.",
        shown(every_s)
    );
    sheet.finish(&caption, source)
}

fn explanation(scene: &Scene) -> Option<&Explanation> {
    scene.modes.first()?.explanation.as_ref().filter(|e| !e.steps.is_empty())
}

fn parts(step: &StepForces) -> [[f32; 2]; 3] {
    [step.goal, step.neighbours, step.lines]
}

fn norm(force: [f32; 2]) -> f64 {
    f64::from(force[0]).hypot(f64::from(force[1]))
}

/// The forces of step `j` act on the vehicle where step `j - 1` has left it.
fn arrows(svg: &mut Svg, view: &RoadView, scene: &Scene, every_s: f64, scale: f64) {
    let (Some(mode), Some(explanation)) = (scene.modes.first(), explanation(scene)) else { return };
    let every = ((every_s / scene.dt).round() as usize).max(1);
    let shown: Vec<(usize, [f32; 2])> = (0..explanation.steps.len())
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
        let step = &explanation.steps[j];
        for (class, force, colour) in
            [("lines", step.lines, LINES), ("neighbours", step.neighbours, NEIGHBOURS), ("goal", step.goal, GOAL)]
        {
            arrow(svg, class, from, force.map(f64::from), scale, colour);
        }
    }
}

fn arrow_legend(svg: &mut Svg, y: f64, scale: f64, largest: f64) -> f64 {
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let mut legend = Legend::under(y);
    for (class, colour) in [("goal", GOAL), ("neighbours", NEIGHBOURS), ("lines", LINES)] {
        let [x, y] = legend.place(22., class);
        arrow(svg, &format!("key {class}"), [x, y - 3.], [18., 0.], 1., colour);
        svg.text([x + 22., y], class, &small);
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
    let steps = &explanation.steps;
    let end = steps.len() as f64 * dt;
    let width = (SPAN - BETWEEN) / 2.;
    for (i, (axis, label)) in [(0, "forward (m/s\u{b2})"), (1, "left (m/s\u{b2})")].into_iter().enumerate() {
        let values = steps.iter().flat_map(parts).map(|f| f64::from(f[axis])).filter(|v| v.is_finite());
        let totals = steps.iter().map(|s| f64::from(s.goal[axis] + s.neighbours[axis] + s.lines[axis]));
        let (low, high) = values.chain(totals).fold((-0.1f64, 0.1f64), |(l, h), v| (l.min(v), h.max(v)));
        let margin = (high - low) * 0.08;
        let place = [LEFT + i as f64 * (width + BETWEEN), top, width, CHART];
        let panel = Panel { place, x: Axis::new(0., end), y: Axis::new(low - margin, high + margin) };
        panel.frame(svg, "time ahead (s)", label, true);
        let curve = |pick: fn(&StepForces) -> [f32; 2]| -> Vec<[f64; 2]> {
            steps.iter().enumerate().map(|(j, s)| panel.at(j as f64 * dt, pick(s)[axis].into())).collect()
        };
        let goal = curve(|s| s.goal);
        svg.path(&goal, &format!("fill=\"none\" stroke=\"{GOAL_RIM}\" stroke-width=\"2.6\""));
        svg.path(&goal, &format!("class=\"goal\" fill=\"none\" stroke=\"{GOAL}\" stroke-width=\"1.5\""));
        svg.path(
            &curve(|s| s.neighbours),
            &format!("class=\"neighbours\" fill=\"none\" stroke=\"{NEIGHBOURS}\" stroke-width=\"1.4\""),
        );
        svg.path(
            &curve(|s| s.lines),
            &format!("class=\"lines\" fill=\"none\" stroke=\"{LINES}\" stroke-width=\"1.2\""),
        );
        let total = curve(|s| std::array::from_fn(|i| s.goal[i] + s.neighbours[i] + s.lines[i]));
        svg.path(
            &total,
            &format!("class=\"total\" fill=\"none\" stroke=\"{TOTAL}\" stroke-width=\"1.2\" stroke-dasharray=\"3 2\""),
        );
    }
}
