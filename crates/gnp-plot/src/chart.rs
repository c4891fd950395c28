//! Line charts with intervals: error by horizon, learning curves.

use crate::axes::{Axis, Panel};
use crate::figure::{Figure, Legend, Sheet, Source};
use crate::palette::{INK, series as style_of};
use crate::road_view::{LEFT, SPAN};
use crate::svg::Svg;

const HEIGHT: f64 = 130.;

/// A curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend; the same name has the same colour in every panel.
    pub name: String,
    /// Points, in the units of the panel.
    pub points: Vec<[f64; 2]>,
    /// Lower and upper end of an interval at each point, or none at all.
    pub band: Vec<Option<[f64; 2]>>,
}

/// How the vertical axis runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scaling {
    /// From zero.
    FromZero,
    /// Logarithmic: for losses, which fall over decades.
    Log,
}

/// One chart of a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartPanel {
    /// Above the chart.
    pub title: String,
    /// Horizontal axis, with its unit.
    pub x: String,
    /// Vertical axis, with its unit.
    pub y: String,
    /// Vertical scaling.
    pub scaling: Scaling,
    /// The curves.
    pub series: Vec<Series>,
}

/// Charts under each other with one legend.
#[must_use]
pub fn charts(name: &str, title: &str, caption: &str, panels: &[ChartPanel], source: &Source) -> Figure {
    let mut sheet = Sheet::new(name, title);
    let mut names: Vec<&str> = Vec::new();
    for series in panels.iter().flat_map(|panel| &panel.series) {
        if !names.contains(&series.name.as_str()) {
            names.push(&series.name);
        }
    }
    legend(&mut sheet, &names);
    for chart in panels {
        sheet.note(&chart.title);
        let panel = panel_of(chart, sheet.y + 3.);
        sheet.svg.group("class=\"chart\"");
        panel.frame(&mut sheet.svg, &chart.x, &chart.y, true);
        sheet.svg.clipped(name, panel.place);
        for series in &chart.series {
            let index = names.iter().position(|n| *n == series.name).unwrap_or(0);
            draw(&mut sheet.svg, &panel, series, index);
        }
        sheet.svg.end();
        sheet.svg.end();
        sheet.y = panel.place[1] + HEIGHT + 30.;
    }
    sheet.finish(caption, source)
}

fn panel_of(chart: &ChartPanel, top: f64) -> Panel {
    let points = || chart.series.iter().flat_map(|s| s.points.iter()).filter(|p| p[0].is_finite() && p[1].is_finite());
    let bands = || chart.series.iter().flat_map(|s| s.band.iter().flatten()).filter(|b| b[1].is_finite());
    let x = points().fold([f64::INFINITY, f64::NEG_INFINITY], |r, p| [r[0].min(p[0]), r[1].max(p[0])]);
    let high = points().map(|p| p[1]).chain(bands().map(|b| b[1])).fold(f64::NEG_INFINITY, f64::max);
    let low = points().map(|p| p[1]).filter(|v| *v > 0.).fold(f64::INFINITY, f64::min);
    let pad = (x[1] - x[0]) * 0.03;
    let y = match chart.scaling {
        Scaling::FromZero => Axis::new(0., high * 1.06),
        Scaling::Log => Axis::log(low * 0.85, high * 1.15),
    };
    Panel { place: [LEFT, top, SPAN, HEIGHT], x: Axis::new(x[0] - pad, x[1] + pad), y }
}

fn draw(svg: &mut Svg, panel: &Panel, series: &Series, index: usize) {
    let (colour, dashes) = style_of(index);
    let at = |x: f64, y: f64| panel.at(x, y);
    let band: Vec<_> = series.points.iter().zip(&series.band).filter_map(|(p, b)| b.map(|b| (p[0], b))).collect();
    let mut outline: Vec<[f64; 2]> = band.iter().map(|(x, b)| at(*x, b[1])).collect();
    outline.extend(band.iter().rev().map(|(x, b)| at(*x, b[0])));
    svg.area(&outline, &format!("class=\"interval\" fill=\"{colour}\" fill-opacity=\"0.16\""));
    let points: Vec<_> = series.points.iter().filter(|p| p[1].is_finite()).map(|p| at(p[0], p[1])).collect();
    let style = format!(
        "class=\"series s{index}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.7\" stroke-dasharray=\"{dashes}\""
    );
    svg.path(&points, &style);
    for point in &points {
        marker(svg, *point, index, colour);
    }
}

/// A different shape for each series.
fn marker(svg: &mut Svg, [x, y]: [f64; 2], index: usize, colour: &str) {
    let fill = format!("class=\"marker s{index}\" fill=\"{colour}\"");
    match index % 4 {
        0 => svg.circle([x, y], 2.4, &fill),
        1 => svg.rect(x - 2.1, y - 2.1, 4.2, 4.2, &fill),
        2 => svg.area(&[[x, y - 2.8], [x + 2.6, y + 2.], [x - 2.6, y + 2.]], &fill),
        _ => svg.area(&[[x - 2.8, y], [x, y - 2.8], [x + 2.8, y], [x, y + 2.8]], &fill),
    }
}

fn legend(sheet: &mut Sheet, names: &[&str]) {
    let mut legend = Legend::under(sheet.y);
    for (i, name) in names.iter().enumerate() {
        let [x, y] = legend.place(28., name);
        let (colour, dashes) = style_of(i);
        let style = format!("stroke=\"{colour}\" stroke-width=\"1.7\" stroke-dasharray=\"{dashes}\"");
        sheet.svg.line([x, y - 3.], [x + 24., y - 3.], &style);
        marker(&mut sheet.svg, [x + 12., y - 3.], i, colour);
        sheet.svg.text([x + 28., y], name, &format!("font-size=\"9\" fill=\"{INK}\""));
    }
    sheet.y = legend.bottom();
}
