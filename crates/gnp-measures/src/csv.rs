//! Tables as rows of comma-separated text, header first.

use crate::contacts::Contact;
use crate::lane_changes::{Beside, Direction, LaneChange};
use crate::safety::Conflict;
use crate::summary::Summary;

/// A number of four decimals at most; empty for none.
fn number(value: impl Into<Option<f64>>) -> String {
    // Adding 0 turns a negative zero into zero.
    value
        .into()
        .filter(|value| value.is_finite())
        .map_or_else(String::new, |value| ((value * 1e4).round() / 1e4 + 0.).to_string())
}

/// A text as a field: in quotes where it has to be.
fn text(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

fn lane(lane: Option<i16>) -> String {
    lane.map_or_else(|| "all".to_owned(), |lane| lane.to_string())
}

fn table<'a>(header: &str, rows: impl Iterator<Item = String> + 'a) -> impl Iterator<Item = String> + 'a {
    std::iter::once(header.to_owned()).chain(rows)
}

/// What detectors report: one row a detector, lane and interval.
pub fn detector_rows(summary: &Summary) -> impl Iterator<Item = String> + '_ {
    let header =
        "recording,simulated,road,lane,x_m,from_s,to_s,count,flow_veh_h,speed_m_s,harmonic_speed_m_s,occupancy";
    let name = text(&summary.recording);
    let row = move |it: &crate::DetectorInterval| {
        let numbers = [Some(it.flow_veh_h), it.speed, it.harmonic_speed, Some(it.occupancy)].map(number).join(",");
        let [from, to] = it.t.map(number);
        let (x, count) = (number(it.x), it.count);
        format!("{name},{},{},{},{x},{from},{to},{count},{numbers}", summary.simulated, it.road, lane(it.lane))
    };
    table(header, summary.detectors.iter().map(row))
}

/// Flow, density and speed: one row a cell.
pub fn cell_rows(summary: &Summary) -> impl Iterator<Item = String> + '_ {
    let header =
        "recording,simulated,road,lane,from_s,to_s,from_m,to_m,vehicle_m,vehicle_s,flow_veh_h,density_veh_km,speed_m_s";
    let name = text(&summary.recording);
    let row = move |it: &crate::Cell| {
        let [[t0, t1], [x0, x1]] = [it.t, it.x];
        let numbers =
            [t0, t1, x0, x1, it.vehicle_m, it.vehicle_s, it.flow_veh_h, it.density_veh_km].map(number).join(",");
        format!("{name},{},{},{},{numbers},{}", summary.simulated, it.road, lane(it.lane), number(it.speed))
    };
    table(header, summary.cells.iter().map(row))
}

/// Lane changes, surrogate conflicts and contacts: one row an event. `other` is the leader of a conflict, or the second
/// vehicle of a contact; `threshold` and `worst` are those of the measure that `kind` names, `worst` of a contact its depth in
/// m; leader, follower and their post-encroachment times (`pet`) are those of the new lane.
pub fn event_rows(summary: &Summary) -> impl Iterator<Item = String> + '_ {
    let header = "recording,simulated,kind,road,vehicle,other,x_m,from_s,to_s,threshold,worst,from_lane,to_lane,direction,\
                  duration_s,leader_gap_m,leader_speed_m_s,leader_pet_s,follower_gap_m,follower_speed_m_s,follower_pet_s";
    let start = format!("{},{}", text(&summary.recording), summary.simulated);
    let starts = [start.clone(), start.clone(), start];
    let [a, b, c] = starts;
    let change = move |it: &LaneChange| {
        let LaneChange { road, vehicle, from, to, .. } = it;
        let side = if it.direction == Direction::Left { "left" } else { "right" };
        let beside = |it: Option<Beside>| {
            let numbers = [it.map(|it| it.gap), it.map(|it| it.speed), it.and_then(|it| it.post_encroachment_s)];
            numbers.map(number).join(",")
        };
        let (leader, follower) = (beside(it.after.leader), beside(it.after.follower));
        let [x, time] = [it.x, it.time_s].map(number);
        let duration = number(it.duration_s);
        format!(
            "{a},lane_change,{road},{vehicle},,{x},{time},{time},,,{from},{to},{side},{duration},{leader},{follower}"
        )
    };
    let conflict = move |it: &Conflict| {
        let Conflict { road, vehicle, leader, .. } = it;
        let numbers = [it.x, it.t[0], it.t[1], it.threshold, it.worst].map(number).join(",");
        format!("{b},{},{road},{vehicle},{leader},{numbers}{}", it.measure.name(), ",".repeat(10))
    };
    let contact = move |it: &Contact| {
        let ([vehicle, other], road) = (it.vehicles, it.road);
        let [x, from, to, depth] = [it.x, it.t[0], it.t[1], it.depth].map(number);
        format!("{c},contact,{road},{vehicle},{other},{x},{from},{to},,{depth}{}", ",".repeat(10))
    };
    let changes = summary.lane_changes.changes.iter().map(change);
    let conflicts = summary.safety.conflicts.iter().map(conflict);
    table(header, changes.chain(conflicts).chain(summary.safety.contacts.iter().map(contact)))
}
