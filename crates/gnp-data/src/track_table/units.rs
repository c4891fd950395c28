//! Values that can only come from another unit or convention, and ids that are not unique.

use super::layout::Taken;
use super::{TableVehicle, TrackTable};
use crate::error::{DataError, TrackProblem};
use crate::formats::findings::{MAX_LEFT_OUT, Tally};
use crate::lanes::median;
use crate::limits::{self, MAX_RECORDED_SPEED, MAX_SPEED};

pub(super) const FEET: &str = "positions and sizes are in m, speeds in m/s and times in s: multiply feet by 0.3048, miles per hour by 0.44704 \
                    and kilometres per hour by 0.27778";

/// Half of the vehicles are not wider, m: the widest lorries are.
const WIDE: f32 = 3.;

/// Units in which a speed may be by mistake, and how much larger the number is than in m/s.
const SPEED_UNITS: [(&str, f64); 3] = [("km/h", 3.6), ("ft/s", 3.28084), ("mph", 2.23694)];

/// From this speed on, m/s, the direction of motion tells that of the vehicle.
const MOVING: f64 = 2.;

/// A heading may differ from the direction of motion by this, rad, in the median of a vehicle.
const OFF_HEADING: f64 = 0.5;

/// Refuses a table in which vehicles have several rows at one time.
pub(super) fn one_row_a_frame(table: &TrackTable, taken: &Taken) -> Result<(), DataError> {
    let mut tally = Tally::default();
    for (_, span) in &taken.spans {
        for i in span.start + 1..span.end {
            let (row, before) = (taken.row(i), taken.row(i - 1));
            let elsewhere = table.x[row] != table.x[before] || table.y[row] != table.y[before];
            if taken.frame[i] == taken.frame[i - 1] && elsewhere {
                tally.add(row);
            }
        }
    }
    if !tally.exceeds(MAX_LEFT_OUT, taken.rows.len()) {
        return Ok(());
    }
    let row = tally.first.unwrap_or(0);
    let name = table.name_of(table.vehicle[row]);
    let what = format!(
        "vehicle {name} is in two places at {} s, as {} of {} rows are",
        table.time_s[row],
        tally.count,
        taken.rows.len()
    );
    let remedy = "an id is of one vehicle; give one row a vehicle and moment, and one recording a table";
    Err(table.wrong(TrackProblem::Duplicate, Some(row), Some("id"), what, remedy))
}

/// Refuses positions between which vehicles move faster than they can, and speeds that no vehicle has.
pub(super) fn speeds(table: &TrackTable, taken: &Taken, rate_hz: f64) -> Result<(), DataError> {
    let (mut fast, mut steps) = (Tally::default(), 0);
    for (_, span) in &taken.spans {
        for i in taken.steps(span) {
            let (row, before) = (taken.row(i), taken.row(i - 1));
            steps += 1;
            let speed = (table.x[row] - table.x[before]).hypot(table.y[row] - table.y[before]) * rate_hz;
            if speed > f64::from(MAX_RECORDED_SPEED) {
                fast.add(row);
            }
        }
    }
    if fast.exceeds(MAX_LEFT_OUT, steps) {
        let what = format!("{} of {steps} steps are faster than {MAX_RECORDED_SPEED} m/s", fast.count);
        return Err(table.wrong(TrackProblem::Unit, fast.first, Some("x"), what, FEET));
    }
    let over = |speed: f64| speed.is_finite() && speed.abs() > f64::from(MAX_SPEED);
    let speed = table.speed.as_ref().and_then(|column| column.iter().position(|speed| over(*speed)));
    let velocity = table.velocity.as_ref().and_then(|[vx, vy]| vx.iter().zip(vy).position(|(x, y)| over(x.hypot(*y))));
    match (speed, velocity) {
        (None, None) => Ok(()),
        (row, other) => {
            let column = if row.is_some() { "speed" } else { "vx" };
            let what = format!("the vehicle is faster than {MAX_SPEED} m/s");
            Err(table.wrong(TrackProblem::Unit, row.or(other), Some(column), what, FEET))
        }
    }
}

/// Refuses headings that are not those of the motion.
pub(super) fn headings(table: &TrackTable, taken: &Taken) -> Result<(), DataError> {
    let Some(heading) = &table.heading else { return Ok(()) };
    let (mut wrong, mut judged, mut offs) = (Tally::default(), 0, Vec::new());
    for (_, span) in &taken.spans {
        let mut off: Vec<f32> = Vec::new();
        for i in taken.steps(span) {
            let (row, before) = (taken.row(i), taken.row(i - 1));
            let [dx, dy] = [table.x[row] - table.x[before], table.y[row] - table.y[before]];
            let time = table.time_s[row] - table.time_s[before];
            if dx.hypot(dy) > MOVING * time && heading[row].is_finite() {
                let direction = dy.atan2(dx);
                off.push(turned(heading[row] - direction).abs() as f32);
                offs.push((heading[row], direction));
            }
        }
        let Some(middle) = median(&mut off) else { continue };
        judged += 1;
        if f64::from(middle) > OFF_HEADING {
            wrong.add(taken.row(span.start));
        }
    }
    if !wrong.exceeds(MAX_LEFT_OUT, judged) {
        return Ok(());
    }
    let fits = |as_meant: &dyn Fn(f64) -> f64| {
        let near = offs.iter().filter(|(heading, way)| turned(as_meant(*heading) - way).abs() < OFF_HEADING).count();
        2 * near > offs.len()
    };
    // No angle in rad is larger than a full turn.
    let degrees = offs.iter().any(|(heading, _)| heading.abs() > 7.);
    let rad = |heading: f64| if degrees { heading.to_radians() } else { heading };
    let hint = match (fits(&rad), fits(&|heading| std::f64::consts::FRAC_PI_2 - rad(heading))) {
        (true, _) => "they seem to be in degrees",
        (_, true) => "they seem to be clockwise from north",
        _ => "they contradict it",
    };
    let what = format!("{} of {judged} vehicles have another heading than the way they move; {hint}", wrong.count);
    let remedy =
        "a heading is in rad anticlockwise from the x axis (`heading_deg` in degrees); repair or remove the column";
    Err(table.wrong(TrackProblem::Contradiction, wrong.first, Some("heading"), what, remedy))
}

/// An angle from -pi to pi.
pub(super) fn turned(angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    sin.atan2(cos)
}

/// Refuses sizes that are those of vehicles in feet.
pub(super) fn sizes(table: &TrackTable) -> Result<(), DataError> {
    let read = || table.vehicles.iter().filter(|vehicle| vehicle.left_out.is_none());
    let mut widths: Vec<f32> = read().filter_map(|vehicle| vehicle.width).collect();
    let Some(width) = median(&mut widths).filter(|width| *width > WIDE) else { return Ok(()) };
    let what = format!("half of the vehicles are {width:.1} m wide or wider");
    let row = first_row(table, |vehicle| vehicle.width.is_some_and(|width| width > WIDE));
    Err(table.wrong(TrackProblem::Unit, row, Some("width"), what, FEET))
}

/// Vehicles whose size no vehicle has.
pub(super) fn odd_sizes(table: &TrackTable, size: impl Fn(&TableVehicle) -> [f32; 2]) -> Result<Vec<u32>, DataError> {
    let odd = |vehicle: &TableVehicle| vehicle.left_out.is_none() && !limits::is_size(size(vehicle));
    let found: Vec<u32> = table.vehicles.iter().zip(0..).filter(|(vehicle, _)| odd(vehicle)).map(|(_, i)| i).collect();
    let all = table.vehicles.iter().filter(|vehicle| vehicle.left_out.is_none()).count();
    let tally = Tally { count: found.len(), first: first_row(table, odd) };
    if !tally.exceeds(MAX_LEFT_OUT, all) {
        return Ok(found);
    }
    let what = format!("{} of {all} vehicles are of no size a vehicle has ({})", found.len(), limits::sizes());
    Err(table.wrong(TrackProblem::Unit, tally.first, Some("length"), what, FEET))
}

fn first_row(table: &TrackTable, is: impl Fn(&TableVehicle) -> bool) -> Option<usize> {
    table.vehicle.iter().position(|vehicle| table.vehicles.get(*vehicle as usize).is_some_and(&is))
}

/// The error for velocities that are not those of the positions; `ratios` are those of speeds stated to measured.
pub(super) fn velocities(table: &TrackTable, wrong: Tally, judged: usize, ratios: &mut [f32]) -> Result<(), DataError> {
    if !wrong.exceeds(MAX_LEFT_OUT, judged) {
        return Ok(());
    }
    let ratio = median(ratios).map_or(1., f64::from);
    let unit = SPEED_UNITS.iter().find(|(_, factor)| (ratio / factor - 1.).abs() < 0.1);
    let hint = unit.map_or_else(String::new, |(unit, _)| format!("; they seem to be in {unit}"));
    let what = format!("{} of {judged} vehicles have another speed than their positions{hint}", wrong.count);
    let column = if table.velocity.is_some() { "vx" } else { "speed" };
    let remedy = "speeds are in m/s, vx and vy along x and y, speed along the heading; repair or remove the columns";
    Err(table.wrong(TrackProblem::Contradiction, wrong.first, Some(column), what, remedy))
}
