//! The potential that neighbours and lane lines make around a vehicle, as a heat map with iso-lines.

use gnp_data::{MarkingKind, SLOTS, TermForces};
use gnp_force::na::Vector2;
use gnp_force::{LineRepulsion, Side, TermDescriptor, VehicleRepulsion, line_potential, term, vehicle_potential};

use crate::axes::{nice, shown};
use crate::figure::{Figure, Sheet, Source};
use crate::palette::{INK, TARGET, cividis};
use crate::road_view::{AXIS_SPACE, HIGHEST, LEFT, RoadView, SPAN, arrow};
use crate::scene::Scene;
use crate::svg::{Svg, escape};

const COLUMNS: usize = 121;
const ROWS: usize = 61;
const LEVELS: usize = 12;

/// What repels at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Potential {
    /// Centre, m, and strength, m/s², of each neighbour.
    pub neighbours: Vec<([f32; 2], f32)>,
    /// Distance over which the push of a neighbour falls to 1/e, m.
    pub r_col: f64,
    /// Strength of each lane line of the scene, from right to left.
    pub k_lines: Vec<f32>,
}

impl Potential {
    /// At the last observed frame: `slots` holds the neighbours' centres, the forecast's first
    /// mode their strengths. `None` without forces.
    #[must_use]
    pub fn of(scene: &Scene, slots: &[Option<[f32; 2]>; SLOTS], r_col: f64) -> Option<Self> {
        let explanation = scene.modes.first()?.explanation.as_ref().filter(|explanation| explanation.steps() > 0)?;
        // Both laws have one parameter that varies, the strength.
        let strengths = |name| explanation.term(name).map_or(&[][..], |term| term.parameter(0, 0));
        let at = slots.iter().zip(strengths(VehicleRepulsion::NAME)).filter_map(|(at, k)| at.map(|at| (at, *k)));
        Some(Self { neighbours: at.collect(), r_col, k_lines: strengths(LineRepulsion::NAME).to_vec() })
    }

    /// At a point of the scene, m²/s².
    #[must_use]
    pub fn at(&self, scene: &Scene, x: f64, y: f64) -> f64 {
        let vehicle = |(at, k): &([f32; 2], f32)| {
            let r = Vector2::new(x - f64::from(at[0]), y - f64::from(at[1]));
            vehicle_potential(r, f64::from(*k), self.r_col)
        };
        let last = scene.lines.len().saturating_sub(1);
        let line = |(i, (line, k)): (usize, (&gnp_data::LaneMarking, &f32))| {
            let side = if i == last && last > 0 { Side::Right } else { Side::Left };
            line_potential(line.kind, y - f64::from(line.y), f64::from(*k), side)
        };
        self.neighbours.iter().map(vehicle).sum::<f64>()
            + scene.lines.iter().zip(&self.k_lines).enumerate().map(line).sum::<f64>()
    }
}

/// The field around the target with lane lines, boxes, iso-lines and the forces on the target.
#[must_use]
pub fn potential_field(scene: &Scene, potential: &Potential, source: &Source) -> Figure {
    let mut sheet = Sheet::new("potential-field", "Potential of neighbours and lane lines around a vehicle");
    sheet.note(&scene.title);
    let view = view_of(scene, sheet.y + 4.);
    let (x, y) = (view.panel.x.data, view.panel.y.data);
    let place = |i: usize, n: usize, r: [f64; 2]| r[0] + (r[1] - r[0]) * i as f64 / (n - 1) as f64;
    let grid: Vec<Vec<f64>> = (0..ROWS)
        .map(|j| (0..COLUMNS).map(|i| potential.at(scene, place(i, COLUMNS, x), place(j, ROWS, y))).collect())
        .collect();
    let mut sorted: Vec<f64> = grid.iter().flatten().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let low = sorted.first().copied().unwrap_or(0.);
    // A boundary is so steep that it would leave one colour for all the rest.
    let high = sorted.get(sorted.len() * 96 / 100).copied().unwrap_or(1.).max(low + 1e-6);
    let band = |v: f64| (((v - low) / (high - low) * LEVELS as f64).max(0.) as usize).min(LEVELS - 1);
    sheet.svg.clipped("field", view.panel.place);
    cells(&mut sheet.svg, &view, &grid, &band);
    for level in (1..LEVELS).step_by(2) {
        let value = low + (high - low) * level as f64 / LEVELS as f64;
        let light = if level * 2 < LEVELS { "#ffffff" } else { "#000000" };
        let segments = iso_line(&grid, value, |i, j| {
            let x = x[0] + (x[1] - x[0]) * i / (COLUMNS - 1) as f64;
            view.panel.at(x, y[0] + (y[1] - y[0]) * j / (ROWS - 1) as f64)
        });
        let style =
            format!("class=\"iso\" fill=\"none\" stroke=\"{light}\" stroke-opacity=\"0.6\" stroke-width=\"0.7\"");
        sheet.svg.paths(&segments, &style);
    }
    let [left, _, width, _] = view.panel.place;
    for line in &scene.lines {
        let at = view.panel.at(0., line.y.into())[1];
        let dashes = if line.kind == MarkingKind::LaneDivider { "stroke-dasharray=\"7 6\"" } else { "" };
        sheet.svg.line(
            [left, at],
            [left + width, at],
            &format!("class=\"lane\" stroke=\"#fff\" stroke-width=\"2.6\" {dashes}"),
        );
        sheet.svg.line([left, at], [left + width, at], &format!("stroke=\"#000\" stroke-width=\"1.1\" {dashes}"));
    }
    let blue = term::<f64>(VehicleRepulsion::NAME).map_or("#fff", |term| &*term.descriptor().colour);
    for other in &scene.others {
        let pushes = potential.neighbours.iter().any(|(at, _)| {
            let [x, y] = other.now.centre;
            (at[0] - x).hypot(at[1] - y) < 0.1
        });
        let (class, fill) = if pushes { ("neighbour", blue) } else { ("bystander", "#fff") };
        let style = format!("class=\"vehicle {class}\" fill=\"{fill}\" stroke=\"#000\" stroke-width=\"0.8\"");
        view.vehicle(&mut sheet.svg, other.now.centre, other.now.size, &style);
    }
    view.vehicle(&mut sheet.svg, [0., 0.], scene.size, &format!("class=\"target\" fill=\"{TARGET}\" stroke=\"#000\""));
    forces(&mut sheet.svg, &view, scene);
    sheet.svg.end();
    view.frame(&mut sheet.svg);
    sheet.y = view.bottom() + AXIS_SPACE + 2.;
    colour_bar(&mut sheet, [low, high]);
    let caption = format!(
        "Potential of the neighbours and the lane lines around the vehicle (orange) at the last observed frame, with \
         the strengths that the networks give there: a vehicle is pushed from bright to dark. Colours end at {} m²/s², \
         above which lie the edges of the road. Arrows as in the scenes; vehicles in the eight neighbour slots are blue, \
         the white ones make no potential.",
        shown((high * 100.).round() / 100.)
    );
    sheet.finish(&caption, source)
}

fn view_of(scene: &Scene, top: f64) -> RoadView {
    let edge = |pick: fn(f64, f64) -> f64, start| scene.lines.iter().map(|l| f64::from(l.y)).fold(start, pick);
    let (right, left) = (edge(f64::min, f64::INFINITY), edge(f64::max, f64::NEG_INFINITY));
    let (low, high) = if right < left { (right - 0.8, left + 0.8) } else { (-8., 8.) };
    RoadView::over([-34., 34.], [low.max(-13.), high.min(13.)], top, HIGHEST)
}

/// Runs of equal colour as one rectangle each.
fn cells(svg: &mut Svg, view: &RoadView, grid: &[Vec<f64>], band: &impl Fn(f64) -> usize) {
    let [left, top, width, height] = view.panel.place;
    let (w, h) = (width / (COLUMNS - 1) as f64, height / (ROWS - 1) as f64);
    svg.group("class=\"heat\" shape-rendering=\"crispEdges\"");
    for (j, row) in grid.iter().enumerate() {
        let y = top + height - (j as f64 + 0.5) * h;
        let mut from = 0;
        while from < row.len() {
            let level = band(row[from]);
            let run = row[from..].iter().take_while(|v| band(**v) == level).count();
            let colour = cividis((level as f64 + 0.5) / LEVELS as f64);
            svg.rect(left + (from as f64 - 0.5) * w, y, run as f64 * w, h + 0.3, &format!("fill=\"{colour}\""));
            from += run;
        }
    }
    svg.end();
}

/// Marching squares: the pieces of the line where the grid has `value`; `place` maps grid to drawing.
fn iso_line(grid: &[Vec<f64>], value: f64, place: impl Fn(f64, f64) -> [f64; 2]) -> Vec<Vec<[f64; 2]>> {
    let mut pieces = Vec::new();
    for j in 0..grid.len().saturating_sub(1) {
        for i in 0..grid[j].len().saturating_sub(1) {
            let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            let mut crossings = Vec::with_capacity(4);
            for side in 0..4 {
                let ((i0, j0), (i1, j1)) = (corners[side], corners[(side + 1) % 4]);
                let (a, b) = (grid[j0][i0] - value, grid[j1][i1] - value);
                if (a < 0.) != (b < 0.) {
                    let t = a / (a - b);
                    let mix = |p: usize, q: usize| p as f64 + (q as f64 - p as f64) * t;
                    crossings.push(place(mix(i0, i1), mix(j0, j1)));
                }
            }
            pieces.extend(crossings.chunks_exact(2).map(<[_]>::to_vec));
        }
    }
    joined(pieces)
}

/// Chains pieces that follow each other in a row of cells, which makes the text shorter.
fn joined(pieces: Vec<Vec<[f64; 2]>>) -> Vec<Vec<[f64; 2]>> {
    let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-6;
    let mut lines: Vec<Vec<[f64; 2]>> = Vec::new();
    for piece in pieces {
        let ends = lines.iter_mut().find_map(|line| {
            let last = *line.last()?;
            let next = if near(last, piece[0]) {
                piece[1]
            } else if near(last, piece[1]) {
                piece[0]
            } else {
                return None;
            };
            line.push(next);
            Some(())
        });
        if ends.is_none() {
            lines.push(piece);
        }
    }
    lines
}

fn forces(svg: &mut Svg, view: &RoadView, scene: &Scene) {
    let explanation = scene.modes.first().and_then(|mode| mode.explanation.as_ref());
    let terms = explanation.map_or(&[][..], |explanation| &explanation.terms);
    let force = |term: &TermForces| term.total(0).map(f64::from);
    let largest = terms.iter().map(force).map(|[x, y]| x.hypot(y)).fold(1e-3, f64::max);
    for term in terms {
        let TermDescriptor { name, colour, .. } = term.term();
        arrow(svg, &escape(name), view.panel.at(0., 0.), force(term), 32. / largest, &escape(colour));
    }
}

fn colour_bar(sheet: &mut Sheet, [low, high]: [f64; 2]) {
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let (top, cell) = (sheet.y + 4., SPAN / LEVELS as f64);
    for level in 0..LEVELS {
        let colour = cividis((level as f64 + 0.5) / LEVELS as f64);
        sheet.svg.rect(LEFT + level as f64 * cell, top, cell + 0.3, 8., &format!("fill=\"{colour}\""));
    }
    let step = nice((high - low) / 6.);
    let mut value = (low / step).ceil() * step;
    while value <= high {
        let x = LEFT + SPAN * (value - low) / (high - low);
        sheet.svg.text([x, top + 18.], &shown(value), &format!("text-anchor=\"middle\" {small}"));
        value += step;
    }
    sheet.svg.text(
        [LEFT + SPAN / 2., top + 30.],
        "potential (m\u{b2}/s\u{b2})",
        &format!("text-anchor=\"middle\" {small}"),
    );
    sheet.y = top + 34.;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_iso_line_lies_where_the_value_is() {
        // Height is the column, so that the line of 1.5 is upright between columns 1 and 2.
        let grid: Vec<Vec<f64>> = (0..4).map(|_| (0..4).map(f64::from).collect()).collect();
        let lines = iso_line(&grid, 1.5, |i, j| [i, j]);
        assert_eq!(lines, [[[1.5, 0.], [1.5, 1.], [1.5, 2.], [1.5, 3.]].to_vec()]);
    }
}
