//! From the rows of one site and period to a recording.

use std::collections::BTreeSet;

use gnp_road::ReferenceLine;

use super::checks;
use super::rows::Raw;
use crate::assemble::{NeighbourSource, Rows, VehicleBody};
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::format::{Source, check_rate};
use crate::formats::findings::Findings;
use crate::formats::motion::in_order;
use crate::formats::periods::{Group, Moments, Picked, out_of_order};
use crate::formats::table::Table;
use crate::ingest_report::IngestReport;
use crate::lanes;
use crate::recording::{Recording, RecordingMeta, Road};

/// Lane numbers from here on are ramps, which all lie to the right of the lane before, at different
/// places along the road.
pub(super) const RAMP: i16 = 7;

/// Frames per second of NGSIM, taken where the times of a file do not tell.
pub(super) const RATE: f64 = 10.;

/// Rows of a recording by vehicle and frame, in the road frame.
pub(super) struct Part {
    /// Which rows of the file these are.
    pub(super) rows: Picked,
    pub(super) vehicle: Vec<u32>,
    pub(super) frame: Vec<u32>,
    /// Centre, forward, m.
    pub(super) x: Vec<f32>,
    /// Centre, to the left, m.
    pub(super) y: Vec<f32>,
    /// m/s, without a direction.
    pub(super) speed: Vec<f32>,
    pub(super) lane: Vec<i16>,
    /// Length and width in the first row of the gap-free stretch that each row is of, m.
    pub(super) size: Vec<[f32; 2]>,
}

impl Part {
    fn of(raw: &Raw, rows: Picked) -> Self {
        let count = rows.len(raw.vehicle.len());
        let at = |i: usize| place(&rows, i);
        let vehicle: Vec<u32> = (0..count).map(|i| raw.vehicle[at(i)]).collect();
        let frame: Vec<u32> = (0..count).map(|i| raw.frame[at(i)]).collect();
        let mut size: Vec<[f32; 2]> = Vec::with_capacity(count);
        for i in 0..count {
            // The front is what was measured: with one length its track does not jump where the length does.
            let goes_on = i > 0 && vehicle[i] == vehicle[i - 1] && frame[i] - frame[i - 1] <= 1;
            let own = || [raw.length[at(i)], raw.width[at(i)]];
            size.push(size.last().filter(|_| goes_on).copied().unwrap_or_else(own));
        }
        let x = (0..count).map(|i| raw.front[at(i)] - size[i][0] / 2.).collect();
        let y = (0..count).map(|i| -raw.right[at(i)]).collect();
        let speed = (0..count).map(|i| raw.speed[at(i)]).collect();
        let lane = (0..count).map(|i| raw.lane[at(i)]).collect();
        Self { rows, vehicle, frame, x, y, speed, lane, size }
    }

    /// The same without the rows of some vehicles.
    fn without(self, raw: &Raw, vehicles: &BTreeSet<u32>) -> Self {
        if !self.vehicle.iter().any(|vehicle| vehicles.contains(vehicle)) {
            return self;
        }
        let kept = (0..self.vehicle.len()).filter(|i| !vehicles.contains(&self.vehicle[*i]));
        let rows = Picked::Some(kept.map(|i| self.place(i) as u32).collect());
        Self::of(raw, rows)
    }

    /// Row of the file that row `i` is.
    pub(super) fn place(&self, i: usize) -> usize {
        place(&self.rows, i)
    }
}

fn place(rows: &Picked, i: usize) -> usize {
    rows.get(i).map_or(i, |row| *row as usize)
}

/// The recording of one site and period. `merged`: the file is the merged export, whose rows come in any order.
///
/// # Errors
/// When the rate is another than expected, rows are out of order, units are wrong, or the rows contradict
/// themselves as a whole.
pub(super) fn build(
    table: &Table,
    raw: &Raw,
    group: &Group,
    name: String,
    source: &Source,
    expected_hz: Option<f64>,
    merged: bool,
) -> Result<(Recording, IngestReport), DataError> {
    let moments = Moments { vehicle: &raw.vehicle, frame: &raw.frame, time: &raw.time };
    let steps = moments.steps(group);
    let rate_hz = steps.rate(RATE);
    check_rate(&table.file, &name, rate_hz, expected_hz)?;
    if let stride @ 2.. = steps.stride() {
        // Rows left out: the frames that remain are numbered as if none were missing.
        let found_hz = rate_hz / f64::from(stride);
        let expected_hz = expected_hz.unwrap_or(rate_hz);
        return Err(DataError::Rate { file: table.file.clone(), recording: name, found_hz, expected_hz });
    }
    let (out_of_order, first) = out_of_order(&raw.vehicle, &raw.frame, &group.rows);
    if let Some((row, previous)) = first.filter(|_| !merged) {
        return Err(table.frame_order("Frame_ID", row, raw.vehicle[row], raw.frame[row], previous));
    }

    let all = Part::of(raw, in_order(&raw.vehicle, &raw.frame, &group.rows));
    let rows = all.vehicle.len();
    checks::feet_of_lengths(table, &all)?;
    let mut findings = Findings::default();
    checks::vehicles(table, raw, &all, rate_hz, &mut findings)?;
    let part = all.without(raw, &findings.left_out());
    let fit = lanes::fit_lanes(&part.lane, &part.y);
    checks::feet_of_lanes(table, fit.width)?;
    checks::off_road(table, &part, &fit.lines, &mut findings)?;
    let mut part = part.without(raw, &findings.left_out());
    let rows_left_out = rows - part.vehicle.len();
    checks::lanes(table, &mut part, &fit, &mut findings)?;
    let wrong_speeds = checks::speeds(&part, rate_hz);

    let Part { rows: picked, vehicle, frame, x, y, lane, .. } = part;
    let at = |i: usize| place(&picked, i);
    let neighbours = NeighbourSource::Lanes(|lane| lane.min(RAMP));
    let leader = raw.leader.as_ref().map(|leader| (0..vehicle.len()).map(|i| leader[at(i)]).collect());
    let rows = Rows { lane, neighbours, leader, ..Rows::new(vehicle, frame, x, y) };
    let body = |i: usize| {
        let row = at(i);
        VehicleBody { class: raw.class[row], length: raw.length[row], width: raw.width[row], road: 0 }
    };
    let meta = RecordingMeta::new(Dataset::NGSIM, group.site.clone(), name, rate_hz).with_simulated(source.simulated);
    // Local_Y runs along the road, Local_X to its right.
    let axis = Some(ReferenceLine::straight([0., 0.], std::f64::consts::FRAC_PI_2));
    let roads = vec![Road { driving_direction: 2, lines: fit.lines, fitted: true, axis }];
    let (recording, mut quality) = Recording::from_rows(meta, roads, rows, body)?;
    quality.out_of_order = out_of_order;
    checks::feet_of_positions(table, &recording)?;
    wrong_speeds.count(table, &mut findings)?;
    findings.report(&mut quality, rows_left_out);
    Ok((recording, quality))
}
