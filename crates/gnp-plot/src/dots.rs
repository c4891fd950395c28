//! Many models by rows: a dot for each value with its interval, first row marked through all others.

use crate::axes::{Axis, Panel};
use crate::figure::{Figure, LETTER, Legend, Sheet, Source, WIDTH};
use crate::palette::{BEST, BLUE, GRID, INK};
use crate::svg::Svg;

/// Height of a row, user units.
const ROW: f64 = 12.;
/// Right edge of the names where none is longer, and left edge of what is written behind a row.
const NAMES: f64 = 116.;
const NOTES: f64 = WIDTH - 34.;

/// One value of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dot {
    /// The value, in the units of the panel.
    pub value: f64,
    /// Lower and upper end of its interval.
    pub interval: Option<[f64; 2]>,
}

/// A model, or a variant of one.
#[derive(Clone, Debug, PartialEq)]
pub struct DotRow {
    /// Its name.
    pub name: String,
    /// It is handed recorded futures: drawn hollow, and said so.
    pub uses_future: bool,
    /// A value for each column of the panel, `None` where it has none.
    pub dots: Vec<Option<Dot>>,
    /// Written behind the row, such as the last value.
    pub note: String,
}

/// How the axis of a panel runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DotScaling {
    /// Logarithmic: for errors over several horizons.
    Log,
    /// From zero.
    FromZero,
    /// Around zero, which is drawn: for differences. The axis is that of the rows that see the past alone; others may
    /// lie beyond it.
    Difference,
}

/// Rows over one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct DotPanel {
    /// Above it.
    pub title: String,
    /// The axis, with its unit.
    pub axis: String,
    /// Its scaling.
    pub scaling: DotScaling,
    /// What the dots of a row stand for, such as `1`; written above the first row if there are several.
    pub columns: Vec<String>,
    /// Above the notes.
    pub notes: String,
    /// The rows from top to bottom.
    pub rows: Vec<DotRow>,
}

/// Panels under each other.
#[must_use]
pub fn dot_rows(name: &str, title: &str, caption: &str, panels: &[DotPanel], source: &Source) -> Figure {
    let mut sheet = Sheet::new(name, title);
    if panels.iter().flat_map(|panel| &panel.rows).any(|row| row.uses_future) {
        legend(&mut sheet);
    }
    let longest = panels.iter().flat_map(|panel| &panel.rows).map(|row| row.name.chars().count()).max().unwrap_or(0);
    // One edge for all panels, so that they can be compared; at least a third of the width is left to the dots.
    let names = (LETTER * longest as f64 + 4.).clamp(NAMES, WIDTH / 2.);
    for panel in panels {
        sheet.note(&panel.title);
        draw(&mut sheet, panel, names);
    }
    sheet.finish(caption, source)
}

fn legend(sheet: &mut Sheet) {
    let mut legend = Legend::under(sheet.y);
    for (uses_future, words) in [(false, "sees the past alone"), (true, "is handed recorded futures (future input)")] {
        let [x, y] = legend.place(10., words);
        marker(&mut sheet.svg, [x + 4., y - 3.], uses_future, BLUE);
        sheet.svg.text([x + 12., y], words, &format!("font-size=\"9\" fill=\"{INK}\""));
    }
    sheet.y = legend.bottom();
}

fn draw(sheet: &mut Sheet, panel: &DotPanel, names: f64) {
    let several = panel.columns.len() > 1;
    let top = sheet.y + if several || !panel.notes.is_empty() { 14. } else { 3. };
    let height = ROW * panel.rows.len().max(1) as f64 + 4.;
    let x = axis_of(panel);
    let drawn = Panel { place: [names + 6., top, NOTES - names - 10., height], x, y: Axis::new(0., 1.) };
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let svg = &mut sheet.svg;
    svg.group("class=\"rows\"");
    drawn.frame_below(svg, &panel.axis);
    svg.text([NOTES, top - 4.], &panel.notes, &small);
    if panel.scaling == DotScaling::Difference {
        let zero = drawn.at(0., 0.)[0];
        svg.line([zero, top], [zero, top + height], &format!("class=\"zero\" stroke=\"{INK}\" stroke-width=\"0.9\""));
    } else if let Some(first) = panel.rows.first() {
        // What every other row is read against.
        for dot in first.dots.iter().flatten() {
            let x = drawn.at(dot.value, 0.)[0];
            let style = format!("class=\"first\" stroke=\"{BEST}\" stroke-width=\"0.7\" stroke-dasharray=\"2 2\"");
            svg.line([x, top], [x, top + height], &style);
        }
    }
    if several && let Some(first) = panel.rows.first() {
        for (words, dot) in panel.columns.iter().zip(&first.dots).filter_map(|(words, dot)| Some((words, (*dot)?))) {
            svg.text([drawn.at(dot.value, 0.)[0], top - 4.], words, &format!("text-anchor=\"middle\" {small}"));
        }
    }
    for (i, row) in panel.rows.iter().enumerate() {
        let y = top + 2. + ROW * (i as f64 + 0.5);
        row_at(svg, &drawn, row, i, y);
    }
    svg.end();
    sheet.y = top + height + 30.;
}

fn row_at(svg: &mut Svg, panel: &Panel, row: &DotRow, index: usize, y: f64) {
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let [left, _, width, _] = panel.place;
    let colour = if index == 0 { BEST } else { BLUE };
    svg.group(&format!("class=\"row{}\"", if row.uses_future { " uses_future" } else { "" }));
    svg.line([left, y], [left + width, y], &format!("stroke=\"{GRID}\" stroke-width=\"0.6\""));
    let weight = if index == 0 { "font-weight=\"bold\"" } else { "" };
    svg.text([left - 6., y + 3.2], &row.name, &format!("class=\"name\" text-anchor=\"end\" {weight} {small}"));
    svg.text([NOTES, y + 3.2], &row.note, &format!("class=\"note\" {small}"));
    for dot in row.dots.iter().flatten().filter(|dot| dot.value.is_finite()) {
        if let Some([low, high]) = dot.interval {
            let style = format!("class=\"interval\" stroke=\"{colour}\" stroke-width=\"1.6\" stroke-opacity=\"0.55\"");
            let end = |value: f64| panel.at(value, 0.)[0].clamp(left, left + width);
            svg.line([end(low), y], [end(high), y], &style);
        }
        let [from, to] = panel.x.data;
        match dot.value {
            value if value < from => beyond(svg, [left, y], -1., colour),
            value if value > to => beyond(svg, [left + width, y], 1., colour),
            value => marker(svg, [panel.at(value, 0.)[0], y], row.uses_future, colour),
        }
    }
    svg.end();
}

fn marker(svg: &mut Svg, at: [f64; 2], uses_future: bool, colour: &str) {
    let fill = if uses_future { "#fff" } else { colour };
    svg.circle(at, 2.6, &format!("class=\"dot\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"1.2\""));
}

/// A triangle at the end of the axis: the value lies farther out.
fn beyond(svg: &mut Svg, [x, y]: [f64; 2], way: f64, colour: &str) {
    let triangle = [[x, y], [x - way * 6., y - 3.2], [x - way * 6., y + 3.2]];
    svg.area(&triangle, &format!("class=\"beyond\" fill=\"#fff\" stroke=\"{colour}\" stroke-width=\"1.2\""));
}

fn axis_of(panel: &DotPanel) -> Axis {
    // Differences of what is handed the future are so large that they would hide all others.
    let counts = |row: &&DotRow| !(row.uses_future && panel.scaling == DotScaling::Difference);
    let dots = || panel.rows.iter().filter(counts).flat_map(|row| row.dots.iter().flatten());
    let ends = || dots().flat_map(|dot| dot.interval.into_iter().flatten().chain([dot.value]));
    let range = ends().filter(|v| v.is_finite());
    let [low, high] = range.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
    match panel.scaling {
        DotScaling::Log => Axis::log(ends().filter(|v| *v > 0.).fold(f64::INFINITY, f64::min) * 0.9, high * 1.1),
        DotScaling::FromZero => Axis::new(0., high * 1.06),
        DotScaling::Difference => {
            let (low, high) = (low.min(0.), high.max(0.));
            let pad = (high - low) * 0.06;
            Axis::new(low - pad, high + pad)
        }
    }
}

/// A value as a note: two decimals.
#[must_use]
pub fn dot_note(value: f64) -> String {
    format!("{value:.2}").replace('-', "\u{2212}")
}
