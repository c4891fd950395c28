//! What is measured of traffic: the fundamental diagram, the speed field, detectors over time.

use crate::axes::{Axis, Panel};
use crate::chart::{ChartPanel, Scaling, Series, charts};
use crate::figure::{Figure, Legend, Sheet, Source};
use crate::palette::{BEST, INK, cividis, series as style_of};
use crate::road_view::{LEFT, SPAN};
use crate::space_time::Trace;
use crate::svg::Svg;

const HEIGHT: f64 = 190.;
/// Colours of the speed scale.
const LEVELS: usize = 16;
/// Where no vehicle was.
const EMPTY: &str = "#e4e7ec";
/// m/s to km/h.
const KMH: f64 = 3.6;

/// Points of a fundamental diagram and what was read from them.
#[derive(Clone, Debug, PartialEq)]
pub struct FlowDensity {
    /// Above the diagram.
    pub title: String,
    /// By lane: its name, and density (vehicles/km) and flow (vehicles/h) of each cell.
    pub lanes: Vec<(String, Vec<[f64; 2]>)>,
    /// Free speed, m/s.
    pub free_speed: Option<f64>,
    /// Speed of waves against the traffic, m/s, and jam density, vehicles/km.
    pub congested: Option<[f64; 2]>,
    /// Capacity of a lane, vehicles/h.
    pub capacity: Option<f64>,
}

/// Flow over density, a point a cell of one lane; the free and the congested branch as lines, capacity dotted.
#[must_use]
pub fn flow_density(diagram: &FlowDensity, source: &Source) -> Figure {
    let mut sheet = Sheet::new("fundamental-diagram", "Flow and density");
    sheet.note(&diagram.title);
    let names: Vec<&str> = diagram.lanes.iter().map(|(name, _)| name.as_str()).collect();
    let mut legend = Legend::under(sheet.y);
    for (i, name) in names.iter().enumerate() {
        let [x, y] = legend.place(10., name);
        dot(&mut sheet.svg, [x + 3., y - 3.], i, "1");
        sheet.svg.text([x + 10., y], name, &format!("font-size=\"9\" fill=\"{INK}\""));
    }
    sheet.y = legend.bottom();
    let points =
        || diagram.lanes.iter().flat_map(|(_, points)| points).filter(|p| p[0].is_finite() && p[1].is_finite());
    let high = |axis: usize| points().map(|p| p[axis]).fold(0f64, f64::max);
    let jam = diagram.congested.map_or(0., |[_, jam]| jam);
    // A jam far beyond the points would press them together.
    let (k, q) = (high(0).max(jam.min(2. * high(0))), high(1).max(diagram.capacity.unwrap_or(0.)));
    let (x, y) = (Axis::new(0., (k * 1.04).max(1.)), Axis::new(0., (q * 1.08).max(1.)));
    let panel = Panel { place: [LEFT, sheet.y + 6., SPAN, HEIGHT], x, y };
    panel.frame(&mut sheet.svg, "density (vehicles/km)", "flow (vehicles/h)", true);
    sheet.svg.clipped("fundamental-diagram", panel.place);
    for (i, (_, points)) in diagram.lanes.iter().enumerate() {
        for point in points.iter().filter(|p| p[0].is_finite() && p[1].is_finite()) {
            dot(&mut sheet.svg, panel.at(point[0], point[1]), i, "0.55");
        }
    }
    branches(&mut sheet.svg, &panel, diagram);
    sheet.svg.end();
    sheet.y = panel.place[1] + HEIGHT + 28.;
    for line in read_from(diagram) {
        sheet.note(&line);
    }
    let caption = "Flow over density; each point is a cell of space and time of one lane, its slope from the origin the space-mean \
                   speed. Solid: free speed and, where traffic was congested, the line through the congested cells, whose slope is the \
                   speed of waves. Dotted: capacity.";
    sheet.finish(caption, source)
}

fn branches(svg: &mut Svg, panel: &Panel, diagram: &FlowDensity) {
    let style = |class: &str, dashes: &str| {
        format!("class=\"{class}\" stroke=\"{INK}\" stroke-width=\"1.4\" fill=\"none\" stroke-dasharray=\"{dashes}\"")
    };
    let right = panel.x.data[1];
    if let Some(capacity) = diagram.capacity {
        svg.path(&[panel.at(0., capacity), panel.at(right, capacity)], &style("capacity", "1.5 3"));
    }
    // The branches meet; alone, the free one ends at capacity.
    let meet = diagram.free_speed.zip(diagram.congested).map(|(free, [wave, jam])| wave * jam / (free + wave));
    if let Some(free) = diagram.free_speed.map(|free| free * KMH) {
        let end = meet.unwrap_or_else(|| (diagram.capacity.unwrap_or(panel.y.data[1]) / free).min(right));
        svg.path(&[panel.at(0., 0.), panel.at(end, free * end)], &style("free", "none"));
    }
    if let Some([wave, jam]) = diagram.congested {
        // Alone, the congested one begins at capacity.
        let from =
            meet.unwrap_or_else(|| diagram.capacity.map_or(0., |capacity| (jam - capacity / (wave * KMH)).max(0.)));
        svg.path(&[panel.at(from, wave * KMH * (jam - from)), panel.at(jam, 0.)], &style("congested", "none"));
    }
}

/// What was read from a diagram, in words.
fn read_from(diagram: &FlowDensity) -> Vec<String> {
    let mut words = Vec::new();
    words.extend(diagram.free_speed.map(|free| format!("free speed {:.0} km/h", free * KMH)));
    words.extend(diagram.capacity.map(|capacity| format!("capacity {capacity:.0} vehicles/h a lane")));
    let congested =
        |[wave, jam]: [f64; 2]| format!("congested branch: slope {:.1} km/h, jam {jam:.0} vehicles/km", wave * KMH);
    let congested = diagram.congested.map_or_else(|| "no congested branch".to_owned(), congested);
    [words.join(", "), congested].into_iter().filter(|line| !line.is_empty()).collect()
}

/// A point of the `i`-th lane: colour and shape.
fn dot(svg: &mut Svg, [x, y]: [f64; 2], i: usize, opacity: &str) {
    let fill = format!("class=\"point s{i}\" fill=\"{}\" fill-opacity=\"{opacity}\"", style_of(i).0);
    match i % 3 {
        0 => svg.circle([x, y], 2., &fill),
        1 => svg.rect(x - 1.8, y - 1.8, 3.6, 3.6, &fill),
        _ => svg.area(&[[x, y - 2.5], [x + 2.3, y + 1.8], [x - 2.3, y + 1.8]], &fill),
    }
}

/// Speed over time and place.
#[derive(Clone, Debug, PartialEq)]
pub struct SpeedField {
    /// Carriageway and lane.
    pub title: String,
    /// Edges of the cells in time, s: one more than there are cells.
    pub t: Vec<f64>,
    /// Edges of the cells along the road, m.
    pub x: Vec<f64>,
    /// Speed of each cell, m/s, `[times][places]`; `None` where no vehicle was.
    pub speed: Vec<Option<f64>>,
    /// Vehicles to be drawn over it, perhaps none.
    pub traces: Vec<Trace>,
    /// Speed of waves against the traffic, m/s: drawn as a dashed line of that slope.
    pub wave_speed: Option<f64>,
}

/// Speed as colour over time and place, dark where it is slow; grey where no vehicle was.
#[must_use]
pub fn speed_field(field: &SpeedField, source: &Source) -> Figure {
    let mut sheet = Sheet::new("speed-field", "Speed over time and place");
    sheet.note(&field.title);
    let ends = |edges: &[f64]| [edges.first().copied().unwrap_or(0.), edges.last().copied().unwrap_or(1.)];
    let (t, x) = (ends(&field.t), ends(&field.x));
    let place = [LEFT, sheet.y + 4., SPAN, HEIGHT];
    let panel = Panel { place, x: Axis::new(t[0], t[1]), y: Axis::new(x[0], x[1]) };
    let fastest = field.speed.iter().flatten().copied().filter(|v| v.is_finite()).fold(1f64, f64::max);
    let fastest = (fastest * KMH / 10.).ceil() * 10.;
    let level = |v: f64| ((v.max(0.) * KMH / fastest * LEVELS as f64) as usize).min(LEVELS - 1);
    sheet.svg.clipped("speed-field", place);
    cells(&mut sheet.svg, &panel, field, &level);
    for trace in &field.traces {
        let points: Vec<_> = trace.points.iter().map(|p| panel.at(p[0], p[1])).collect();
        sheet.svg.path(
            &points,
            "class=\"trace\" fill=\"none\" stroke=\"#fff\" stroke-width=\"0.5\" stroke-opacity=\"0.55\"",
        );
    }
    if let Some(wave) = field.wave_speed {
        let at = |share: f64| [t[0] + (t[1] - t[0]) * share, x[0] + (x[1] - x[0]) * 0.96];
        // From above left, as far as the road goes.
        let [from, top] = at(0.12);
        let to = (from + (top - x[0]) * 0.95 / wave).min(t[1]);
        let ends = [panel.at(from, top), panel.at(to, top - wave * (to - from))];
        sheet.svg.path(&ends, "fill=\"none\" stroke=\"#fff\" stroke-width=\"3\"");
        let style =
            format!("class=\"wave\" fill=\"none\" stroke=\"{BEST}\" stroke-width=\"1.6\" stroke-dasharray=\"6 3\"");
        sheet.svg.path(&ends, &style);
    }
    sheet.svg.end();
    panel.frame(&mut sheet.svg, "time (s)", "along the road (m)", false);
    sheet.y = place[1] + HEIGHT + 30.;
    key(&mut sheet, field, fastest);
    let caption = "Space-mean speed in cells of time and place, dark where vehicles are slow, grey where there were none. Traffic runs \
                   upwards; a dark band that falls to the right is a wave that runs against it. Dashed, where it was found: the speed of \
                   such waves.";
    sheet.finish(caption, source)
}

/// Runs of one colour over time as one rectangle each.
fn cells(svg: &mut Svg, panel: &Panel, field: &SpeedField, level: &impl Fn(f64) -> usize) {
    let places = field.x.len().saturating_sub(1);
    let times = field.t.len().saturating_sub(1);
    let at = |time: usize, place: usize| {
        field.speed.get(time * places + place).copied().flatten().filter(|v| v.is_finite()).map(level)
    };
    svg.group("class=\"heat\" shape-rendering=\"crispEdges\"");
    for place in 0..places {
        let mut from = 0;
        while from < times {
            let this = at(from, place);
            let run = (from..times).take_while(|time| at(*time, place) == this).count();
            let [left, top] = panel.at(field.t[from], field.x[place + 1]);
            let [right, bottom] = panel.at(field.t[from + run], field.x[place]);
            let colour = this.map_or_else(|| EMPTY.to_owned(), |level| cividis((level as f64 + 0.5) / LEVELS as f64));
            svg.rect(left, top, right - left, bottom - top, &format!("fill=\"{colour}\""));
            from += run;
        }
    }
    svg.end();
}

fn key(sheet: &mut Sheet, field: &SpeedField, fastest: f64) {
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let mut legend = Legend::under(sheet.y);
    let fast = format!("{fastest:.0} km/h");
    let [x, y] = legend.place(10. + 6. * LEVELS as f64 + 4., &fast);
    sheet.svg.text([x, y], "0", &small);
    for i in 0..LEVELS {
        let colour = cividis((i as f64 + 0.5) / LEVELS as f64);
        sheet.svg.rect(x + 9. + 6. * i as f64, y - 7., 6.2, 8., &format!("fill=\"{colour}\""));
    }
    sheet.svg.text([x + 13. + 6. * LEVELS as f64, y], &fast, &small);
    if field.speed.iter().any(Option::is_none) {
        let [x, y] = legend.place(12., "no vehicle");
        sheet.svg.rect(x, y - 7., 8., 8., &format!("fill=\"{EMPTY}\""));
        sheet.svg.text([x + 12., y], "no vehicle", &small);
    }
    if let Some(wave) = field.wave_speed {
        let words = format!("waves, {:.1} km/h", wave * KMH);
        let [x, y] = legend.place(26., &words);
        let style = format!("stroke=\"{BEST}\" stroke-width=\"1.6\" stroke-dasharray=\"6 3\"");
        sheet.svg.line([x, y - 3.], [x + 22., y - 3.], &style);
        sheet.svg.text([x + 26., y], &words, &small);
    }
    sheet.y = legend.bottom();
}

/// What a detector, or a lane of it, reports over time.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectorSeries {
    /// Name in the legend.
    pub name: String,
    /// Middle of each interval, s.
    pub time: Vec<f64>,
    /// Flow in it, vehicles/h.
    pub flow: Vec<f64>,
    /// Mean speed in it, m/s; `None` where nobody passed.
    pub speed: Vec<Option<f64>>,
}

/// Flow and speed of detectors over time.
#[must_use]
pub fn detector_series(title: &str, detectors: &[DetectorSeries], source: &Source) -> Figure {
    let panel = |title: &str, y: &str, value: &dyn Fn(&DetectorSeries, usize) -> Option<f64>| ChartPanel {
        title: title.to_owned(),
        x: "time (s)".to_owned(),
        y: y.to_owned(),
        scaling: Scaling::FromZero,
        series: detectors
            .iter()
            .map(|detector| {
                let known = |(i, time): (usize, &f64)| Some([*time, value(detector, i)?]);
                let points: Vec<[f64; 2]> = detector.time.iter().enumerate().filter_map(known).collect();
                Series { name: detector.name.clone(), band: vec![None; points.len()], points }
            })
            .collect(),
    };
    let panels = [
        panel("Flow", "flow (vehicles/h)", &|detector, i| detector.flow.get(i).copied()),
        panel("Mean speed; intervals in which nobody passed have none", "speed (km/h)", &|detector, i| {
            detector.speed.get(i).copied().flatten().map(|speed| speed * KMH)
        }),
    ];
    let caption = "Flow and mean speed at detectors over time, a point an interval.";
    charts("detectors", title, caption, &panels, source)
}
