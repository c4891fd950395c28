//! Figures of traffic: fundamental diagram, speed over time and place, detectors, time-space diagram.

use std::collections::BTreeMap;

use gnp_data::Recording;
use gnp_measures::{Cell, FundamentalDiagram, Summary, Traffic};
use gnp_plot::{
    DetectorSeries, Figure, FlowDensity, Source, SpaceTime, SpeedField, Trace, detector_series, flow_density,
    space_time, speed_field,
};

use crate::error::Result;

/// What the figures are called.
pub(super) const NAMES: [&str; 4] = ["fundamental-diagram", "speed-field", "detectors", "time-space"];
/// Most vehicles whose lines are drawn, and points of a line.
const MOST: [usize; 2] = [400, 400];
/// Most detectors that are drawn.
const DETECTORS: usize = 6;

/// The figures of the busiest carriageway.
pub(super) fn all(
    recording: &Recording,
    traffic: &Traffic<'_>,
    summary: &Summary,
    source: &Source,
) -> Result<Vec<Figure>> {
    let Some(road) = busiest(summary) else { return Ok(Vec::new()) };
    let several = recording.roads().len() > 1;
    let name = if several { format!("carriageway {road}, the busiest, ") } else { String::new() };
    let mut figures = Vec::new();
    figures.extend(diagram(summary, road, &name, source));
    figures.extend(field(summary, road, &name, source));
    figures.extend(detectors(summary, road, &name, source));
    figures.extend(lines(recording, traffic, summary, road, &name, source));
    Ok(figures)
}

/// The carriageway on which most is driven.
fn busiest(summary: &Summary) -> Option<u16> {
    let mut driven: BTreeMap<u16, f64> = BTreeMap::new();
    for cell in summary.cells.iter().filter(|cell| cell.lane.is_none()) {
        *driven.entry(cell.road).or_default() += cell.vehicle_s;
    }
    driven.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(road, _)| road)
}

fn diagram(summary: &Summary, road: u16, name: &str, source: &Source) -> Option<Figure> {
    let of = |lane: Option<i16>| summary.diagrams.iter().find(move |it| it.road == road && it.lane == lane);
    let all: &FundamentalDiagram = of(None)?;
    let lanes = summary.lanes.iter().filter(|lane| lane.road == road);
    let lanes = lanes.filter_map(|lane| {
        let points = of(Some(lane.number))?.points.iter().map(|point| [point.density_veh_km, point.flow_veh_h]);
        Some((format!("lane {}", lane.number), points.collect()))
    });
    let diagram = FlowDensity {
        title: format!(
            "{name}a point: one lane over {:.0} m and {:.0} s",
            summary.settings.cells.x, summary.settings.cells.t
        ),
        lanes: lanes.collect(),
        free_speed: all.free_speed.as_ref().ok().copied(),
        congested: all.congested.as_ref().ok().map(|branch| [branch.wave_speed, branch.jam_density_veh_km]),
        capacity: all.capacity.as_ref().ok().map(|capacity| capacity.flow_veh_h),
    };
    Some(flow_density(&diagram, source))
}

fn field(summary: &Summary, road: u16, name: &str, source: &Source) -> Option<Figure> {
    let cells: Vec<&Cell> = summary.cells.iter().filter(|cell| cell.road == road && cell.lane.is_none()).collect();
    let edges = |axis: &dyn Fn(&Cell) -> [f64; 2]| {
        let mut edges: Vec<f64> = cells.iter().flat_map(|cell| axis(cell)).collect();
        edges.sort_by(f64::total_cmp);
        edges.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
        edges
    };
    let (t, x) = (edges(&|cell| cell.t), edges(&|cell| cell.x));
    let (times, places) = (t.len().checked_sub(1)?, x.len().checked_sub(1)?);
    let mut speed = vec![None; times * places];
    let index = |edges: &[f64], at: f64| edges.partition_point(|edge| *edge <= at + 1e-6).checked_sub(1);
    for cell in &cells {
        if let (Some(i), Some(j)) = (index(&t, cell.t[0]), index(&x, cell.x[0]))
            && let Some(slot) = speed.get_mut(i * places + j)
        {
            *slot = cell.speed;
        }
    }
    let wave = summary.waves.iter().find(|waves| waves.road == road && waves.lane.is_none());
    let wave_speed = wave.and_then(|waves| waves.speed.as_ref().ok()).map(|wave| wave.speed);
    let title = format!("{name}all lanes");
    Some(speed_field(&SpeedField { title, t, x, speed, traces: Vec::new(), wave_speed }, source))
}

fn detectors(summary: &Summary, road: u16, name: &str, source: &Source) -> Option<Figure> {
    let mut by_place: BTreeMap<i64, DetectorSeries> = BTreeMap::new();
    for it in summary.detectors.iter().filter(|it| it.road == road && it.lane.is_none()) {
        let series = by_place.entry((it.x * 100.).round() as i64).or_insert_with(|| DetectorSeries {
            name: format!("at {:.0} m", it.x),
            time: Vec::new(),
            flow: Vec::new(),
            speed: Vec::new(),
        });
        series.time.push((it.t[0] + it.t[1]) / 2.);
        series.flow.push(it.flow_veh_h);
        series.speed.push(it.harmonic_speed);
    }
    let series: Vec<DetectorSeries> = by_place.into_values().take(DETECTORS).collect();
    // A single interval is no line.
    if series.iter().all(|it| it.time.len() < 2) {
        return None;
    }
    Some(detector_series(&format!("Flow and speed at detectors, {name}all lanes"), &series, source))
}

/// The paths of vehicles in the lane that is driven most.
fn lines(
    recording: &Recording,
    traffic: &Traffic<'_>,
    summary: &Summary,
    road: u16,
    name: &str,
    source: &Source,
) -> Option<Figure> {
    let lane = summary.lanes.iter().filter(|lane| lane.road == road).max_by_key(|lane| lane.rows)?;
    let columns = recording.columns();
    let tracks: Vec<_> = recording.tracks().iter().filter(|track| track.road == road).collect();
    let every = tracks.len().div_ceil(MOST[0]).max(1);
    let mut traces = Vec::new();
    for track in tracks.into_iter().step_by(every) {
        let apart = track.rows.len().div_ceil(MOST[1]).max(1);
        let mut points: Vec<[f64; 2]> = Vec::new();
        let mut flush = |points: &mut Vec<[f64; 2]>| {
            if points.len() > 1 {
                traces.push(Trace { points: std::mem::take(points) });
            }
            points.clear();
        };
        for row in track.rows.clone().step_by(apart) {
            let frame = track.first_frame + (row - track.rows.start) as u32;
            let place = traffic.place(traffic.x(row));
            // On a ring a line ends at the seam.
            let seam = points.last().is_some_and(|last| place < last[1] - 20.);
            if columns.lane[row] != lane.number || seam {
                flush(&mut points);
            }
            if columns.lane[row] == lane.number {
                points.push([traffic.time_s(frame), place]);
            }
        }
        flush(&mut points);
    }
    if traces.is_empty() {
        return None;
    }
    let some = if every > 1 { format!(", one vehicle of {every}") } else { String::new() };
    let title = format!("{name}lane {}{some}", lane.number);
    Some(space_time(&SpaceTime { title, traces, forecasts: Vec::new() }, source))
}
