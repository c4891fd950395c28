//! A forecast as it is and in a changed scene, under each other, and the difference by cause.

use gnp_data::Account;

use crate::axes::shown;
use crate::causes::{DrawnPart, bars, bars_of, drawn};
use crate::figure::{Figure, Legend, Sheet, Source};
use crate::palette::{BEST, INK};
use crate::road_view::{AXIS_SPACE, HIGHEST, Paths, RoadView, path_legend, thinned};
use crate::scene::{Scene, VehicleBox};
use crate::svg::Svg;

/// A vehicle that is spoken of. Where it is elsewhere in the changed scene, or not there, a dashed box shows where it was.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// What is written beside it, such as its number.
    pub label: String,
    /// Where it is as it is, in the frame of that scene.
    pub before: Option<VehicleBox>,
    /// Where it is in the changed scene, in the frame of that one.
    pub after: Option<VehicleBox>,
}

/// Two forecasts of one moment.
#[derive(Clone, Debug)]
pub struct WhatIf<'a> {
    /// What was changed, such as `without vehicle 34`.
    pub what: &'a str,
    /// As it is.
    pub before: &'a Scene,
    /// With the change.
    pub after: &'a Scene,
    /// Origin of the frame of `before` in that of `after`, m: none but where the vehicle itself is moved.
    pub shift: [f32; 2],
    /// Vehicles that are spoken of.
    pub marks: &'a [Mark],
    /// What the change does to the prediction, cause by cause: [`Account::change_to`].
    pub change: &'a Account,
}

/// Both scenes on one scale, the first prediction in the second one too; below, what the difference is made of.
#[must_use]
pub fn what_if(name: &str, title: &str, both: &WhatIf<'_>, source: &Source) -> Figure {
    let WhatIf { what, before, after, shift, marks, change } = both;
    let shifted = |[x, y]: [f32; 2]| [x + shift[0], y + shift[1]];
    let mut sheet = Sheet::new(name, title);
    sheet.note(&before.title);
    sheet.y = path_legend(&mut sheet.svg, sheet.y, "prediction", "other futures");
    sheet.y = ghost_legend(&mut sheet.svg, sheet.y);
    let boxes = marks.iter().flat_map(|mark| {
        let was = mark.before.map(|at| VehicleBox { centre: shifted(at.centre), ..at });
        [mark.before, was, mark.after]
    });
    let ends = |at: VehicleBox| [-0.5f32, 0.5].map(|half| [at.centre[0] + half * at.size[0], at.centre[1]]);
    let mut seen: Vec<[f32; 2]> = boxes.flatten().flat_map(ends).collect();
    seen.extend(before.modes.iter().flat_map(|mode| mode.path.iter().copied().map(shifted)));
    for (scene, words, changed) in [(before, "As it is:", false), (after, *what, true)] {
        let words = if changed { format!("{}:", capital(words)) } else { words.to_owned() };
        sheet.note(&words);
        let view = RoadView::fit_all(&[*before, *after], &seen, sheet.y + 3., HIGHEST);
        sheet.svg.group(if changed { "class=\"scene changed\"" } else { "class=\"scene\"" });
        sheet.svg.clipped(name, view.panel.place);
        view.road(&mut sheet.svg, scene);
        view.vehicles(&mut sheet.svg, scene);
        view.paths(&mut sheet.svg, scene, Paths::Prediction);
        if changed && let Some(mode) = before.modes.first() {
            let path: Vec<[f32; 2]> = [[0.; 2]].iter().chain(&mode.path).copied().map(shifted).collect();
            let points = view.panel.points(&path);
            // The changed prediction may lie on it; its end stays to be seen.
            let end = points.last().copied();
            sheet.svg.path(&thinned(points, 40), &ghost("as-it-is"));
            if let Some(end) = end {
                sheet.svg.circle(end, 3., &end_of_ghost());
            }
        }
        for mark in *marks {
            let was =
                mark.before.map(|at| VehicleBox { centre: if changed { shifted(at.centre) } else { at.centre }, ..at });
            let now = if changed { mark.after } else { was };
            let ghost = was.filter(|was| now.is_none_or(|now| apart(was.centre, now.centre) > SAME_PLACE));
            if let Some(at) = now.or(ghost) {
                label(&mut sheet.svg, &view, at, &mark.label);
            }
            now.iter().for_each(|at| outline(&mut sheet.svg, &view, *at, ""));
            ghost.iter().for_each(|at| outline(&mut sheet.svg, &view, *at, "stroke-dasharray=\"2 1.5\""));
        }
        sheet.svg.end();
        view.frame(&mut sheet.svg);
        sheet.svg.end();
        sheet.y = view.bottom() + AXIS_SPACE;
    }
    sheet.note(&change.sentence_of_change(&capital(what)));
    let mut parts = drawn(change);
    let start = change.velocity[0] * (change.dt * change.steps() as f64) as f32;
    if start.abs() >= 0.05 {
        let displacement = (1..=change.steps()).map(|step| change.constant_velocity(step)).collect();
        let name = "constant velocity".to_owned();
        parts.insert(0, DrawnPart { name, colour: INK.to_owned(), displacement });
    }
    let seconds = shown((change.dt * change.steps() as f64 * 100.).round() / 100.);
    bars(&mut sheet, &bars_of(&parts, 0, "difference"), &format!("farther than as it is, after {seconds} s (m)"));
    let caption = format!(
        "{title}. The forecast as it is and {what}, on one scale; the prediction as it is stands dashed in the second \
         scene. Below: the difference of both predictions along the road at the end, by cause."
    );
    sheet.finish(&caption, source)
}

fn ghost(class: &str) -> String {
    format!("class=\"{class}\" fill=\"none\" stroke=\"{BEST}\" stroke-width=\"1.2\" stroke-dasharray=\"1.5 2\"")
}

fn end_of_ghost() -> String {
    format!("class=\"as-it-is\" fill=\"#ffffff\" stroke=\"{BEST}\" stroke-width=\"1.2\"")
}

fn ghost_legend(svg: &mut Svg, y: f64) -> f64 {
    let mut legend = Legend::under(y);
    let words = "prediction as it is";
    let [x, y] = legend.place(25., words);
    svg.line([x, y - 3.], [x + 18., y - 3.], &ghost("key"));
    svg.circle([x + 18., y - 3.], 3., &end_of_ghost().replace("as-it-is", "key"));
    svg.text([x + 25., y], words, &format!("font-size=\"9\" fill=\"{INK}\""));
    legend.bottom()
}

/// Boxes nearer than this are the same, m.
const SAME_PLACE: f32 = 0.05;

fn apart(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn outline(svg: &mut Svg, view: &RoadView, at: VehicleBox, dashes: &str) {
    let style = format!("class=\"mark\" fill=\"none\" stroke=\"{INK}\" stroke-width=\"1.1\" {dashes}");
    view.vehicle(svg, at.centre, at.size, &style);
}

fn label(svg: &mut Svg, view: &RoadView, at: VehicleBox, words: &str) {
    let [x, y] = at.centre;
    let [left, top] = view.panel.at(x.into(), (y + at.size[1] / 2.).into());
    let style = "font-size=\"9\" text-anchor=\"middle\" stroke=\"#ffffff\" stroke-width=\"2\" paint-order=\"stroke\"";
    svg.text([left, top - 2.5], words, &format!("class=\"label\" {style} fill=\"{INK}\""));
}

/// With a capital letter, as a sentence begins.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
