//! A straight road through tracks: its direction, and whether it is one.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;

use gnp_road::ReferenceLine;

use super::TrackTable;
use super::layout::Taken;
use super::road::Placed;
use super::units::turned;
use crate::error::{DataError, TrackProblem};
use crate::formats::findings::{MAX_LEFT_OUT, Tally};
use crate::limits::MAX_POSITION;

/// Most that the median direction of travel may turn along a road that is taken for straight, degrees, where three
/// vehicles or more tell.
pub const MAX_TURN_DEGREES: f64 = 5.;

/// The same where one or two vehicles tell, who may be changing lanes.
pub const MAX_TURN_OF_FEW_DEGREES: f64 = 15.;

/// Vehicles from which on a direction is that of the road.
const MANY: usize = 3;

/// A vehicle that travels less, m, does not tell the direction of the road, or on which carriageway it is.
pub(super) const LEAST_TRAVEL: f64 = 5.;

/// From here on, m, a vehicle's direction is not that of its noise or of a lane change.
const LONG_TRAVEL: f64 = 20.;

/// A vehicle that goes at more than this angle to the road crosses it, degrees.
const CROSSING_DEGREES: f64 = 15.;

/// The road is looked at in pieces of this length, of which a vehicle must travel half, m.
const PIECE: f64 = 50.;

/// The axis goes through the origin of the coordinates where these are not larger, m.
const NEAR: f64 = MAX_POSITION as f64 / 4.;

/// An axis is parallel to one of the coordinates where that moves nothing sideways by more than this, m.
const PARALLEL: f64 = 0.5;

const REMEDY: &str = "give its reference line with `--road FILE`, or a straight section alone";

/// The line in the median direction of travel, of most of it; through the origin of the coordinates, or where that is far
/// away, near the tracks.
///
/// # Errors
/// When nothing moves and no heading tells.
pub(super) fn axis(table: &TrackTable, taken: &Taken) -> Result<ReferenceLine, DataError> {
    let mut travels: Vec<[f64; 2]> = taken
        .spans
        .iter()
        .map(|(_, span)| {
            taken.steps(span).fold([0.; 2], |[x, y], i| {
                let (row, before) = (taken.row(i), taken.row(i - 1));
                [x + table.x[row] - table.x[before], y + table.y[row] - table.y[before]]
            })
        })
        .collect();
    travels.retain(|[x, y]| x.hypot(*y) >= LEAST_TRAVEL);
    if travels.iter().any(|[x, y]| x.hypot(*y) >= LONG_TRAVEL) {
        travels.retain(|[x, y]| x.hypot(*y) >= LONG_TRAVEL);
    }
    if travels.is_empty() {
        // Where all stand, vehicles still point along the road.
        let heading = table.heading.iter().flat_map(|heading| taken.rows.iter().map(|row| heading[*row as usize]));
        travels = heading.filter(|heading| heading.is_finite()).map(|heading| [heading.cos(), heading.sin()]).collect();
    }
    if travels.is_empty() {
        let what = format!("no vehicle moves by {LEAST_TRAVEL} m, so that nothing tells where the road goes");
        let remedy = "give longer tracks, a column `heading`, or the road's line with `--road FILE`";
        return Err(table.wrong(TrackProblem::Road, None, None, what, remedy));
    }
    // Doubled angles make both directions one.
    let (mut cos, mut sin) = (0., 0.);
    for [x, y] in &travels {
        let length = x.hypot(*y);
        cos += (x * x - y * y) / length;
        sin += 2. * x * y / length;
    }
    let mean = sin.atan2(cos) / 2.;
    // Some change lanes: the median does not.
    let mut off: Vec<(f64, f64)> = travels.iter().map(|[x, y]| (unsigned(y.atan2(*x) - mean), x.hypot(*y))).collect();
    off.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = off.iter().map(|(_, length)| length).sum::<f64>() / 2.;
    let mut sum = 0.;
    let middle = off.iter().find(|(_, length)| {
        sum += length;
        sum >= half
    });
    let mut heading = mean + middle.map_or(0., |(off, _)| *off);
    let forward: f64 = travels.iter().map(|[x, y]| x * heading.cos() + y * heading.sin()).sum();
    if forward < 0. {
        heading += 2. * FRAC_PI_2;
    }

    let range = |values: &[f64]| {
        taken
            .rows
            .iter()
            .map(|row| values[*row as usize])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let (x, y) = (range(&table.x), range(&table.y));
    let quarter = (heading / FRAC_PI_2).round() * FRAC_PI_2;
    if (heading - quarter).sin().abs() * (x.1 - x.0).hypot(y.1 - y.0) < PARALLEL {
        heading = quarter;
    }
    let near = [x.0, x.1, y.0, y.1].iter().all(|value| value.abs() <= NEAR);
    let origin = if near { [0.; 2] } else { [x.0.floor(), y.0.floor()] };
    Ok(ReferenceLine::straight(origin, heading))
}

/// An angle between lines, which have no direction, from -pi/2 to pi/2.
fn unsigned(angle: f64) -> f64 {
    turned(2. * angle) / 2.
}

/// Vehicles that go across the road.
///
/// # Errors
/// When they are too many for one straight road.
pub(super) fn crossing(table: &TrackTable, placed: &Placed) -> Result<BTreeSet<u32>, DataError> {
    let (mut across, mut judged, mut tally, mut worst) = (BTreeSet::new(), 0, Tally::default(), 0.);
    for (vehicle, span) in &placed.taken.spans {
        let [s, d] = placed.travel(span);
        if s.hypot(d) < LONG_TRAVEL {
            continue;
        }
        judged += 1;
        let angle = d.abs().atan2(s.abs()).to_degrees();
        if angle > CROSSING_DEGREES {
            across.insert(*vehicle);
            tally.add(placed.taken.row(span.start));
            worst = angle.max(worst);
        }
    }
    if !tally.exceeds(MAX_LEFT_OUT, judged) {
        return Ok(across);
    }
    let what = format!(
        "the road is not straight: {} of {judged} vehicles go at an angle to the median direction of travel, by up to \
         {worst:.0} degrees",
        tally.count
    );
    Err(table.wrong(TrackProblem::Road, tally.first, None, what, REMEDY))
}

/// Refuses a road that turns: the direction of travel, in the median of the vehicles, differs from piece to piece.
pub(super) fn check(table: &TrackTable, placed: &Placed, across: &BTreeSet<u32>) -> Result<(), DataError> {
    let taken = &placed.taken;
    // Directions in each piece of the road, degrees, with a row.
    let mut pieces: BTreeMap<i64, Vec<(f64, usize)>> = BTreeMap::new();
    let piece = |i: usize| (placed.s[i] / PIECE).floor() as i64;
    for (_, span) in taken.spans.iter().filter(|(vehicle, _)| !across.contains(vehicle)) {
        let mut from = span.start;
        for i in span.start..span.end {
            let goes_on = i + 1 < span.end && taken.goes_on(span, i + 1) && piece(i + 1) == piece(from);
            if goes_on {
                continue;
            }
            let [mut s, mut d] = [placed.s[i] - placed.s[from], placed.d[i] - placed.d[from]];
            if s < 0. {
                [s, d] = [-s, -d];
            }
            if s >= PIECE / 2. {
                pieces.entry(piece(from)).or_default().push((d.atan2(s).to_degrees(), taken.row(from)));
            }
            from = i + 1;
        }
    }
    for (least, most) in [(MANY, MAX_TURN_DEGREES), (1, MAX_TURN_OF_FEW_DEGREES)] {
        let medians = pieces.iter_mut().filter(|(_, found)| found.len() >= least).map(|(piece, found)| {
            let middle = found.len() / 2;
            let (angle, row) = *found.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0)).1;
            (*piece, angle, row)
        });
        let medians: Vec<(i64, f64, usize)> = medians.collect();
        let by_angle = |a: &&(i64, f64, usize), b: &&(i64, f64, usize)| a.1.total_cmp(&b.1);
        let (Some(right), Some(left)) = (medians.iter().min_by(by_angle), medians.iter().max_by(by_angle)) else {
            continue;
        };
        let turn = left.1 - right.1;
        if turn <= most {
            continue;
        }
        // The later piece is the one into which the road turns.
        let last = if left.0 > right.0 { left } else { right };
        let first = if left.0 > right.0 { right } else { left };
        let name = table.name_of(table.vehicle[last.2]);
        let what = format!(
            "the road turns by {turn:.1} degrees within {:.0} m, as vehicle {name} shows, more than the {most} degrees of a \
             road that is taken for straight",
            (last.0 - first.0 + 1) as f64 * PIECE
        );
        return Err(table.wrong(TrackProblem::Road, Some(last.2), None, what, REMEDY));
    }
    Ok(())
}
