//! What contradicts itself in the rows of one site and period, and what is not in feet.

use rayon::prelude::*;

use super::build::{Part, RAMP};
use super::rows::Raw;
use crate::error::DataError;
use crate::formats::findings::{Check, Findings, MAX_DOUBTED, MAX_LEFT_OUT, Tally};
use crate::formats::motion::{Motion, by_vehicle, flagged};
use crate::formats::table::Table;
use crate::lanes::{self, LaneFit};
use crate::limits::{self, MAX_LANE_WIDTH, MAX_RECORDED_SPEED};
use crate::recording::{LaneMarking, Recording};

/// Vehicles shorter than this in the median, or lanes narrower, were in metres already.
const MIN_LENGTH: f32 = 2.5;
const MIN_LANE_WIDTH: f32 = 2.;

/// Fraction of rows that may move faster than [`MAX_RECORDED_SPEED`]: single rows do by noise.
const FAST_FRACTION: f64 = 0.01;

/// A row may be this far from the middle of its lane, m: at a lane change half a lane, and the road bends.
const OFF_LANE: f32 = 3.;

/// A centre may be this far outside the fitted lines, m: ramps lie there, whose lanes are not fitted.
const OFF_ROAD: f32 = 20.;

/// No lane of the two motorways has a higher number.
const LAST_LANE: i16 = 8;

/// Sizes in a table that are nearer than this, m, are the same.
const SAME_SIZE: f32 = 0.1;

const SIZE: Check = Check {
    column: "v_Length",
    says: "are of no size a vehicle has (0.5 to 40 m by 0.3 to 5 m)",
    then: "left out",
    remedy: "NGSIM is in feet; take the original file",
};
const BACKWARDS: Check = Check {
    column: "Local_Y",
    says: "drive backwards",
    then: "left out",
    remedy: "Local_Y grows in the direction of travel; take the original file",
};
const ROAD: Check = Check {
    column: "Local_X",
    says: "drive more than 20 m outside the lanes",
    then: "left out",
    remedy: "Local_X is in feet from the left edge of the road; take the original file",
};
const CHANGING: Check = Check {
    column: "v_Length",
    says: "have another size than the first row of their track",
    then: "the first is taken",
    remedy: "a vehicle has one size; take the original file",
};
const SPEED: Check = Check {
    column: "v_Vel",
    says: "have another speed than their positions",
    then: "positions are taken",
    remedy: "v_Vel is in feet per second, Local_X and Local_Y in feet; take the original file",
};
const LANE: Check = Check {
    column: "Lane_ID",
    says: "have a Lane_ID that contradicts Local_X",
    then: "the lane is taken as unknown",
    remedy: "lanes are numbered from the left, and Local_X grows to the right; take the original file",
};
const TOTAL: Check = Check {
    column: "Total_Frames",
    says: "have another number of rows than Total_Frames says",
    then: "kept",
    remedy: "take the original file",
};

/// Leaves out vehicles that cannot be or drive backwards, and counts sizes that change and rows that are missing.
///
/// # Errors
/// When they are too many.
pub(super) fn vehicles(
    table: &Table,
    raw: &Raw,
    part: &Part,
    rate_hz: f64,
    findings: &mut Findings,
) -> Result<(), DataError> {
    let spans = by_vehicle(&part.vehicle);
    let place = |i: usize| part.place(i);
    let found = |wrong: &(dyn Fn(std::ops::Range<usize>) -> bool + Sync)| flagged(&spans, place, &part.vehicle, wrong);
    let odd = found(&|mut rows| rows.any(|i| !limits::is_size(part.size[i])));
    findings.leave_out(&SIZE, table, &odd, spans.len())?;
    let motion = Motion { frame: &part.frame, x: &part.x, y: &part.y, rate_hz };
    findings.leave_out(&BACKWARDS, table, &found(&|rows| motion.is_backwards(rows)), spans.len())?;

    let changed = |i: &usize| {
        let ([length, width], row) = (part.size[*i], place(*i));
        (raw.length[row] - length).abs() > SAME_SIZE || (raw.width[row] - width).abs() > SAME_SIZE
    };
    let changing = Tally::of((0..part.size.len()).filter(changed).map(place));
    findings.count(&CHANGING, table, changing, (part.size.len(), "rows"), MAX_DOUBTED)?;

    let Some(total) = &raw.total else { return Ok(()) };
    let miscounted = found(&|rows| {
        let frames = part.frame[rows.clone()].chunk_by(|a, b| a == b).count();
        usize::try_from(total[place(rows.start)]) != Ok(frames)
    });
    // Sections of a recording keep the number of the whole one.
    findings.count(&TOTAL, table, Tally::of(miscounted.into_iter().map(|it| it.1)), (spans.len(), "vehicles"), 1.)
}

/// Leaves out vehicles that are not on the road between `lines`.
///
/// # Errors
/// When they are too many.
pub(super) fn off_road(
    table: &Table,
    part: &Part,
    lines: &[LaneMarking],
    findings: &mut Findings,
) -> Result<(), DataError> {
    let ([right, ..], [.., left]) = (lines, lines) else { return Ok(()) };
    let spans = by_vehicle(&part.vehicle);
    let road = right.y - OFF_ROAD..=left.y + OFF_ROAD;
    let away =
        |rows: std::ops::Range<usize>| 2 * rows.clone().filter(|i| !road.contains(&part.y[*i])).count() > rows.len();
    let found = flagged(&spans, |i| part.place(i), &part.vehicle, &away);
    findings.leave_out(&ROAD, table, &found, spans.len())
}

/// Takes the lanes of rows that are elsewhere as unknown.
///
/// # Errors
/// When they are too many.
pub(super) fn lanes(table: &Table, part: &mut Part, fit: &LaneFit, findings: &mut Findings) -> Result<(), DataError> {
    let ramps = Tally::of((0..part.lane.len()).filter(|i| part.lane[*i] >= RAMP).map(|i| part.place(i)));
    if fit.centres.is_empty() && ramps.exceeds(MAX_DOUBTED, part.lane.len()) {
        let what =
            format!("{} of {} rows are on ramps (7, 8) or beyond, and none on lanes", ramps.count, part.lane.len());
        return Err(table.contradiction(ramps.first, LANE.column, what, LANE.remedy));
    }
    let wrong = |number: i16, y: f32| {
        let off = |(lane, centre): &(i16, f32)| *lane == number && (y - centre).abs() > OFF_LANE;
        number > LAST_LANE || fit.centres.iter().any(off) || fit.misplaced.contains(&number)
    };
    let rows: Vec<usize> = (0..part.lane.len()).into_par_iter().filter(|i| wrong(part.lane[*i], part.y[*i])).collect();
    let tally = Tally::of(rows.iter().map(|i| part.place(*i)));
    findings.count(&LANE, table, tally, (part.lane.len(), "rows"), MAX_LEFT_OUT)?;
    rows.into_iter().for_each(|i| part.lane[i] = 0);
    Ok(())
}

/// Vehicles whose speed is not that of their positions, of how many.
pub(super) struct WrongSpeeds(Tally, usize);

pub(super) fn speeds(part: &Part, rate_hz: f64) -> WrongSpeeds {
    let spans = by_vehicle(&part.vehicle);
    let motion = Motion { frame: &part.frame, x: &part.x, y: &part.y, rate_hz };
    let wrong = |rows| motion.contradicts_speed(rows, &part.speed);
    let found = flagged(&spans, |i| part.place(i), &part.vehicle, &wrong);
    WrongSpeeds(Tally::of(found.into_iter().map(|it| it.1)), spans.len())
}

impl WrongSpeeds {
    /// Counts them.
    ///
    /// # Errors
    /// When they are too many.
    pub(super) fn count(&self, table: &Table, findings: &mut Findings) -> Result<(), DataError> {
        findings.count(&SPEED, table, self.0, (self.1, "vehicles"), MAX_DOUBTED)
    }
}

/// Refuses lengths that were in metres already.
pub(super) fn feet_of_lengths(table: &Table, part: &Part) -> Result<(), DataError> {
    let mut lengths: Vec<f32> = part.size.iter().map(|size| size[0]).collect();
    let Some(median) = lanes::median(&mut lengths) else { return Ok(()) };
    if median >= MIN_LENGTH {
        return Ok(());
    }
    Err(DataError::Unit {
        file: table.file.clone(),
        place: "column `v_Length`".into(),
        what: format!("half of the vehicles are shorter than {median:.2} m when read as feet"),
        remedy: "the table seems to be in metres; NGSIM is read in feet, take the original file",
    })
}

/// Refuses lanes that are wider or narrower than lanes are.
pub(super) fn feet_of_lanes(table: &Table, width: Option<f32>) -> Result<(), DataError> {
    let Some(width) = width else { return Ok(()) };
    let (what, remedy) = if width > MAX_LANE_WIDTH {
        (
            format!("lanes are {width:.1} m wide, more than {MAX_LANE_WIDTH} m"),
            "the values seem not to be feet; take the original file",
        )
    } else if width < MIN_LANE_WIDTH {
        (
            format!("lanes are {width:.1} m wide when read as feet"),
            "the table seems to be in metres; NGSIM is read in feet, take the original file",
        )
    } else {
        return Ok(());
    };
    Err(DataError::Unit { file: table.file.clone(), place: "column `Local_X`".into(), what, remedy })
}

/// Refuses positions from which vehicles move faster than they can.
pub(super) fn feet_of_positions(table: &Table, recording: &Recording) -> Result<(), DataError> {
    let c = recording.columns();
    let fast = c.vx.iter().zip(&c.vy).filter(|(vx, vy)| vx.hypot(**vy) > MAX_RECORDED_SPEED).count();
    if fast as f64 <= FAST_FRACTION * recording.len() as f64 {
        return Ok(());
    }
    Err(DataError::Unit {
        file: table.file.clone(),
        place: "columns `Local_X`, `Local_Y`".into(),
        what: format!("{fast} of {} rows move faster than {MAX_RECORDED_SPEED} m/s", recording.len()),
        remedy: "the values seem not to be feet, or frames are missing; take the original file",
    })
}
