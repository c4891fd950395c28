//! What moved a vehicle, cause by cause: bars from constant velocity to the path, and their growth over time.

use gnp_data::Account;

use crate::axes::{Axis, Panel, shown};
use crate::causes::{DrawnPart, bars, bars_of, drawn};
use crate::figure::{Figure, Sheet, Source};
use crate::palette::{BEST, INK, rim};
use crate::road_view::{LEFT, SPAN};
use crate::svg::Svg;

const HEIGHT: f64 = 120.;
/// Lateral parts below this have no bars, m.
const SIDEWAYS: f32 = 0.3;

/// The parts of a forecast at its end as bars, from constant velocity to the path, along the road and, where there is
/// something to see, across; below, how the parts along the road have grown. `what` says which window it is.
#[must_use]
pub fn contributions(name: &str, title: &str, what: &str, account: &Account, source: &Source) -> Figure {
    let mut sheet = Sheet::new(name, title);
    sheet.note(what);
    sheet.note(&account.sentence());
    let parts = drawn(account);
    let seconds = account.dt * account.steps() as f64;
    let end = format!("after {} s", shown((seconds * 100.).round() / 100.));
    let speed = account.velocity[0];
    bars(&mut sheet, &bars_of(&parts, 0, "path"), &format!("farther than at {speed:.1} m/s, {end} (m)"));
    if parts.iter().any(|part| part.end()[1].abs() >= SIDEWAYS) {
        sheet.note("Across the road:");
        bars(&mut sheet, &bars_of(&parts, 1, "path"), &format!("farther left than its velocity leads, {end} (m)"));
    }
    sheet.note("Growth, in the colours above: what moves it on is stacked upwards, what holds it back downwards; the line is their sum, the path.");
    growth(&mut sheet, &parts, account);
    let caption = format!(
        "{title}. Bars: what each cause moved the vehicle by the end, each from where the last one left it; 0 is where \
         its present velocity leads, the sum is the predicted path. Below: the same over time, along the road. The parts \
         add up exactly."
    );
    sheet.finish(&caption, source)
}

fn growth(sheet: &mut Sheet, parts: &[DrawnPart], account: &Account) {
    let (steps, dt) = (account.steps(), account.dt);
    let along = |part: &DrawnPart, step: usize| match step.checked_sub(1) {
        None => 0.,
        Some(step) => part.displacement.get(step).map_or(0., |at| f64::from(at[0])),
    };
    let stack = |count: usize, step: usize, up: bool| -> f64 {
        let values = parts[..count].iter().map(|part| along(part, step));
        values.filter(|value| value.is_finite() && (*value > 0.) == up).sum()
    };
    let extreme = |up: bool| (0..=steps).map(move |step| stack(parts.len(), step, up));
    let (low, high) = (extreme(false).fold(-0.1, f64::min), extreme(true).fold(0.1, f64::max));
    let margin = (high - low) * 0.05;
    let place = [LEFT, sheet.y + 3., SPAN, HEIGHT];
    let end = steps as f64 * dt;
    let panel = Panel { place, x: Axis::new(0., end), y: Axis::new(low - margin, high + margin) };
    let svg = &mut sheet.svg;
    svg.group("class=\"growth\"");
    panel.frame(svg, "time ahead (s)", "farther (m)", true);
    svg.clipped(&sheet.name, place);
    for (i, part) in parts.iter().enumerate() {
        for up in [true, false] {
            let line = |count: usize| -> Vec<[f64; 2]> {
                (0..=steps).map(|step| panel.at(step as f64 * dt, stack(count, step, up))).collect()
            };
            area(svg, line(i), &line(i + 1), part);
        }
    }
    let zero = panel.at(0., 0.)[1];
    svg.line([LEFT, zero], [LEFT + SPAN, zero], &format!("class=\"zero\" stroke=\"{INK}\" stroke-width=\"0.9\""));
    let sum: Vec<[f64; 2]> = (0..=steps).map(|step| panel.at(step as f64 * dt, account.sum(step)[0].into())).collect();
    svg.path(&sum, "class=\"sum-rim\" fill=\"none\" stroke=\"#ffffff\" stroke-width=\"3.6\"");
    svg.path(&sum, &format!("class=\"sum\" fill=\"none\" stroke=\"{BEST}\" stroke-width=\"2\""));
    svg.end();
    svg.end();
    sheet.y = place[1] + HEIGHT + 27.;
}

/// What lies between two lines, if anything does.
fn area(svg: &mut Svg, inner: Vec<[f64; 2]>, outer: &[[f64; 2]], part: &DrawnPart) {
    if inner.iter().zip(outer).all(|(a, b)| (a[1] - b[1]).abs() < 0.05) {
        return;
    }
    let colour = &part.colour;
    let rim = rim(colour).unwrap_or_else(|| colour.clone());
    let mut outline = inner;
    outline.extend(outer.iter().rev());
    svg.area(&outline, &format!("class=\"part\" fill=\"{colour}\" fill-opacity=\"0.75\""));
    svg.path(outer, &format!("class=\"stacked\" fill=\"none\" stroke=\"{rim}\" stroke-width=\"0.8\""));
}
