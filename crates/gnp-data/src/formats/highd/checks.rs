//! What contradicts itself in the three files of a recording.

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use super::TRACKS;
use super::meta::{COUNTS, Listed, Stated};
use super::tracks::Tracks;
use crate::error::DataError;
use crate::formats::findings::{Check, Findings, MAX_DOUBTED, MAX_LEFT_OUT, MIN_JUDGED, Tally};
use crate::formats::motion::{Motion, by_vehicle, flagged};
use crate::formats::table::Table;
use crate::limits;
use crate::named::Names;
use crate::recording::{Road, VehicleClass};
use crate::slot::SLOTS;

/// A centre may be this far outside the outer markings, m: on a lane of a ramp that is not marked.
const OFF_ROAD: f32 = 4.;

/// A centre may be this far outside the lane that its row tells, or the markings, m: numbers are not taken from the
/// rounded positions.
const OFF_LANE: f32 = 0.5;

/// Fraction of a carriageway's rows that may be outside its markings: there may be a lane that is not marked.
const MAX_OUTSIDE: f64 = 0.25;

/// A recording may be this much longer than is stated, s.
const SAME_TIME: f64 = 1.;

const SIZE: Check = Check {
    column: "width",
    says: "are of no size a vehicle has (0.5 to 40 m by 0.3 to 5 m)",
    then: "left out",
    remedy: "width is the length and height the width, in metres; take the original file",
};
const DIRECTION: Check = Check {
    column: "drivingDirection",
    says: "drive against their drivingDirection",
    then: "left out",
    remedy: "1 drives towards smaller x, 2 towards larger; take tracks and tracksMeta from one download",
};
const VELOCITY: Check = Check {
    column: "xVelocity",
    says: "have another velocity than their positions",
    then: "left out",
    remedy: "velocities are in m/s along x and y of the image, at the frameRate of recordingMeta; take the original files",
};
const SIDEWAYS: Check = Check {
    column: "yVelocity",
    says: "that move sideways have another velocity there than their positions",
    ..VELOCITY
};
const ROAD: Check = Check {
    column: "y",
    says: "drive more than 4 m outside the markings of their carriageway",
    then: "left out",
    remedy: "take tracks and recordingMeta from one download",
};
const OTHER_SIZE: Check = Check {
    column: "width",
    says: "have another size than tracksMeta",
    then: "left out",
    remedy: "take tracks and tracksMeta from one download",
};
const ROW_SIZE: Check = Check { then: "that of tracksMeta is taken", ..OTHER_SIZE };
const ROW_VELOCITY: Check =
    Check { says: "have a velocity more than 3 m/s off their positions", then: "kept", ..VELOCITY };
const ROWS_OFF_ROAD: Check =
    Check { says: "are more than 4 m outside the markings of their carriageway", then: "kept", ..ROAD };
const OUTSIDE: Check = Check { says: "are more than 0.5 m outside its markings", then: "kept", ..ROAD };
const LANE: Check = Check {
    column: "laneId",
    says: "have a laneId that contradicts y and the markings",
    then: "the lane at y is taken",
    remedy: "each laneId stands for one lane between two markings; take tracks and recordingMeta from one download",
};
const FRAMES: Check = Check {
    column: "numFrames",
    says: "have other frames in tracks than tracksMeta says",
    then: "kept",
    remedy: "rows are missing or of another recording; download both again, or, for rows you cut or resampled yourself, remove initialFrame, finalFrame and numFrames from tracksMeta",
};
const NEIGHBOURS: &str = "neighbours are named by the id of tracks, 0 for none; take the original file, or set names of vehicles you took out to 0";

/// A column of neighbours is refused only if this fraction of the recording's rows name wrong ones: a few names say
/// little of a column, and are counted.
const MIN_WRONG_NAMES: f64 = 0.01;

const COUNTED: &str = "the file is another recording's; take all three from one download";
const DURATION: &str = "the file is another recording's, or frameRate is wrong; take all three from one download";

/// The tables of a recording.
pub(super) struct Tables<'a> {
    pub(super) tracks: &'a Table,
    pub(super) tracks_meta: &'a Table,
    pub(super) recording_meta: &'a Table,
}

/// Vehicles that cannot be as they are listed, or that move otherwise than the files say; and what is counted of them.
///
/// # Errors
/// When they are too many.
pub(super) fn vehicles(
    tables: &Tables<'_>,
    stated: &Stated,
    listed: &[Listed],
    tracks: &Tracks,
    findings: &mut Findings,
) -> Result<(), DataError> {
    let spans = by_vehicle(&tracks.vehicle);
    let all = spans.len();
    let meta_row = |vehicle: u32| listed.binary_search_by_key(&vehicle, |it| it.vehicle).map_or(0, |i| listed[i].row);
    let found =
        |wrong: &(dyn Fn(Range<usize>) -> bool + Sync)| flagged(&spans, |i| tracks.place(i), &tracks.vehicle, wrong);
    let in_meta = |found: Vec<(u32, usize)>| -> Vec<(u32, usize)> {
        found.into_iter().map(|(vehicle, _)| (vehicle, meta_row(vehicle))).collect()
    };
    let motion = Motion { frame: &tracks.frame, x: &tracks.x, y: &tracks.y, rate_hz: stated.rate_hz };

    let odd = in_meta(found(&|rows| {
        let body = tracks.body[rows.start];
        !limits::is_size([body.length, body.width])
    }));
    findings.leave_out(&SIZE, tables.tracks_meta, &odd, all)?;
    let other = found(&|rows| 2 * rows.clone().filter(|i| tracks.resized[*i]).count() > rows.len());
    findings.leave_out(&OTHER_SIZE, tables.tracks, &other, all)?;
    let against = in_meta(found(&|rows| motion.is_backwards(rows)));
    findings.leave_out(&DIRECTION, tables.tracks_meta, &against, all)?;
    let [vx, vy] = &tracks.velocity;
    findings.leave_out(&VELOCITY, tables.tracks, &found(&|rows| motion.contradicts(rows, vx)), all)?;
    let sideways = |rows: &Range<usize>| Some((rows.start, motion.contradicts_sideways(rows.clone(), vy)?));
    let judged: Vec<(usize, bool)> = spans.par_iter().filter_map(sideways).collect();
    let wrong = judged.iter().filter(|(_, wrong)| *wrong).map(|(i, _)| (tracks.vehicle[*i], tracks.place(*i)));
    let wrong: Vec<(u32, usize)> = wrong.collect();
    // Most vehicles keep their lane and tell nothing of it: the bound is of those that do.
    let tally = Tally::of(wrong.iter().map(|(_, row)| *row));
    if judged.len() >= MIN_JUDGED && tally.exceeds(MAX_DOUBTED, judged.len()) {
        let who = format!("{} of {} vehicles", tally.count, judged.len());
        return Err(SIDEWAYS.error(tables.tracks, tally.first, &who));
    }
    findings.leave_out(&SIDEWAYS, tables.tracks, &wrong, all)?;
    let off = |i: usize| off_road(&stated.roads[usize::from(tracks.body[i].road)], tracks.y[i]);
    let away = found(&|rows| 2 * rows.clone().filter(|i| off(*i)).count() > rows.len());
    findings.leave_out(&ROAD, tables.tracks, &away, all)?;

    let left_out = findings.left_out();
    let rows_off = (0..tracks.y.len()).filter(|i| off(*i) && !left_out.contains(&tracks.vehicle[*i]));
    let rows_off = Tally::of(rows_off.map(|i| tracks.place(i)));
    findings.count(&ROWS_OFF_ROAD, tables.tracks, rows_off, (tracks.y.len(), "rows"), MAX_LEFT_OUT)?;

    let kept = |rows: &&Range<usize>| !left_out.contains(&tracks.vehicle[rows.start]);
    let other = spans.par_iter().filter(kept).map(|rows| motion.other_rows(rows.clone(), |i| [vx[i], vy[i]]));
    let other = other.map(|(count, first)| Tally { count, first: first.map(|i| tracks.place(i)) });
    let other = other.reduce(Tally::default, Tally::merge);
    findings.count(&ROW_VELOCITY, tables.tracks, other, (tracks.y.len(), "rows"), MAX_LEFT_OUT)?;
    let resized = (0..tracks.y.len()).filter(|i| tracks.resized[*i] && !left_out.contains(&tracks.vehicle[*i]));
    let resized = Tally::of(resized.map(|i| tracks.place(i)));
    findings.count(&ROW_SIZE, tables.tracks, resized, (tracks.y.len(), "rows"), MAX_LEFT_OUT)?;
    frames(tables, listed, tracks, &spans, findings)
}

/// Compares the frames of vehicles with those that are listed.
fn frames(
    tables: &Tables<'_>,
    listed: &[Listed],
    tracks: &Tracks,
    spans: &[Range<usize>],
    findings: &mut Findings,
) -> Result<(), DataError> {
    let other = listed.iter().filter(|it| {
        let span = spans.binary_search_by_key(&it.vehicle, |span| tracks.vehicle[span.start]);
        let frames = span.map_or(&[][..], |span| &tracks.frame[spans[span].clone()]);
        let number = frames.chunk_by(|a, b| a == b).count();
        let have = [frames.first().copied(), frames.last().copied(), u32::try_from(number).ok()];
        it.frames.iter().zip(have).any(|(says, have)| says.is_some_and(|n| u32::try_from(n).ok() != have))
    });
    let tally = Tally::of(other.map(|it| it.row));
    findings.count(&FRAMES, tables.tracks_meta, tally, (listed.len(), "vehicles"), MAX_LEFT_OUT)
}

fn off_road(road: &Road, y: f32) -> bool {
    outside(road, y, OFF_ROAD)
}

/// Whether `y` is more than a distance, m, outside the outer markings.
fn outside(road: &Road, y: f32, distance: f32) -> bool {
    let edge = |line: Option<&crate::LaneMarking>| line.map_or(y, |line| line.y);
    y < edge(road.lines.first()) - distance || y > edge(road.lines.last()) + distance
}

/// Counts rows outside the markings of each carriageway, which those of another recording leave many of.
fn outside_markings(table: &Table, roads: &[Road], tracks: &Tracks, findings: &mut Findings) -> Result<(), DataError> {
    for (number, road) in roads.iter().enumerate() {
        let here = |i: &usize| usize::from(tracks.body[*i].road) == number;
        let all = (0..tracks.y.len()).filter(here).count();
        let off = |i: &usize| here(i) && tracks.lane[*i] != 0 && outside(road, tracks.y[*i], OFF_LANE);
        let rows: Vec<usize> = (0..tracks.y.len()).filter(off).collect();
        let vehicles = rows.chunk_by(|a, b| tracks.vehicle[*a] == tracks.vehicle[*b]).count();
        let fraction = if vehicles < MIN_JUDGED { 1. } else { MAX_OUTSIDE };
        let what = format!("rows of carriageway {}", road.driving_direction);
        let tally = Tally::of(rows.into_iter().map(|i| tracks.place(i)));
        findings.count(&OUTSIDE, table, tally, (all, &what), fraction)?;
    }
    Ok(())
}

/// Lanes between markings, with the number that most rows there have, for one carriageway.
#[derive(Clone, Debug, Default)]
struct Lanes {
    /// Rows by number and place from the right.
    rows: BTreeMap<(i16, usize), usize>,
}

impl Lanes {
    /// The number of each lane from the right, 0 where none is known: that of the most rows, and of the lanes that
    /// a number has most rows in one.
    fn numbers(&self, lanes: usize) -> Vec<i16> {
        let mut numbers = vec![0; lanes];
        let mut by_rows: Vec<(&(i16, usize), &usize)> = self.rows.iter().collect();
        by_rows.sort_by_key(|(key, rows)| (std::cmp::Reverse(**rows), **key));
        for ((number, lane), _) in by_rows {
            if numbers[*lane] == 0 && !numbers.contains(number) {
                numbers[*lane] = *number;
            }
        }
        numbers
    }
}

/// Place of the lane at `y` from the right; `None` outside the markings.
fn lane_at(road: &Road, y: f32) -> Option<usize> {
    let right = road.lines.partition_point(|line| line.y <= y);
    (right > 0 && right < road.lines.len()).then(|| right - 1)
}

/// Compares lane numbers with the markings, and takes the number of the lane at `y` where they differ.
///
/// # Errors
/// When they are too many.
pub(super) fn lanes(
    tables: &Tables<'_>,
    roads: &[Road],
    tracks: &mut Tracks,
    findings: &mut Findings,
) -> Result<(), DataError> {
    outside_markings(tables.tracks, roads, tracks, findings)?;
    let mut seen = vec![Lanes::default(); roads.len()];
    let known = |tracks: &Tracks, i: usize| {
        let road = usize::from(tracks.body[i].road);
        (tracks.lane[i] != 0).then(|| Some((road, lane_at(&roads[road], tracks.y[i])?))).flatten()
    };
    for i in 0..tracks.lane.len() {
        if let Some((road, lane)) = known(tracks, i) {
            *seen[road].rows.entry((tracks.lane[i], lane)).or_insert(0) += 1;
        }
    }
    let numbers: Vec<Vec<i16>> =
        seen.iter().zip(roads).map(|(lanes, road)| lanes.numbers(road.lines.len().saturating_sub(1))).collect();
    let contradicts = |i: &usize| {
        let (road, lane) = known(tracks, *i)?;
        let (number, y) = (tracks.lane[*i], tracks.y[*i]);
        let own = numbers[road].iter().position(|have| *have == number);
        let near = own.is_some_and(|own| {
            let lines = &roads[road].lines;
            (lines[own].y - OFF_LANE..=lines[own + 1].y + OFF_LANE).contains(&y)
        });
        (!near).then_some((*i, numbers[road][lane]))
    };
    let wrong: Vec<(usize, i16)> = (0..tracks.lane.len()).into_par_iter().filter_map(|i| contradicts(&i)).collect();
    let tally = Tally::of(wrong.iter().map(|(i, _)| tracks.place(*i)));
    findings.count(&LANE, tables.tracks, tally, (tracks.lane.len(), "rows"), MAX_LEFT_OUT)?;
    for (i, number) in wrong {
        tracks.lane[i] = number;
    }
    Ok(())
}

/// Refuses a column of neighbours most of which are not there, in a recording of so many `rows`. Names of vehicles that
/// were `left_out` here, so many for each slot, are no fault of the column; `place` gives the row of the file of a row.
///
/// # Errors
/// When there is one.
pub(super) fn neighbours(
    table: &Table,
    names: &[Names; SLOTS],
    left_out: [usize; SLOTS],
    rows: usize,
    place: impl Fn(usize) -> usize,
) -> Result<(), DataError> {
    for ((column, names), left_out) in TRACKS[TRACKS.len() - 1 - SLOTS..].iter().zip(names).zip(left_out) {
        let (named, wrong) = (names.named.saturating_sub(left_out), names.wrong.saturating_sub(left_out));
        let tally = Tally { count: wrong, first: names.first.map(&place) };
        if tally.exceeds(MAX_DOUBTED, named) && tally.exceeds(MIN_WRONG_NAMES, rows) {
            let what = format!("{wrong} of {named} values name vehicles that are not there");
            return Err(table.contradiction(tally.first, column, what, NEIGHBOURS));
        }
    }
    Ok(())
}

/// Compares what the recording's meta file counts with what is there; a sentence for each that differs a little.
///
/// # Errors
/// When more is there than is counted, by over a tenth, so that the file is another recording's. Less is there where
/// somebody took vehicles or frames out.
pub(super) fn counts(
    tables: &Tables<'_>,
    stated: &Stated,
    listed: &[Listed],
    frames: [u32; 2],
) -> Result<Vec<String>, DataError> {
    let table = tables.recording_meta;
    let of_class = |class: VehicleClass| listed.iter().filter(|it| it.body.class == class).count() as f64;
    let seconds = f64::from(frames[1].saturating_sub(frames[0]).saturating_add(1)) / stated.rate_hz;
    let all = listed.len() as f64;
    let [id, counted @ .., duration] = stated.counts;
    let mut notes = Vec::new();
    for ((column, says), have) in
        COUNTS[1..].iter().zip(counted).zip([all, of_class(VehicleClass::Car), of_class(VehicleClass::Truck)])
    {
        let Some(says) = says.map(f64::from).filter(|says| *says != have) else { continue };
        if have - says > MAX_LEFT_OUT * all {
            let what = format!("{says} where tracksMeta lists {have}");
            return Err(table.contradiction(Some(0), column, what, COUNTED));
        }
        notes.push(format!("recordingMeta has {column} {says}, tracksMeta lists {have}"));
    }
    if let Some(says) = duration.map(f64::from) {
        if seconds > says * (1. + MAX_LEFT_OUT) + SAME_TIME {
            let what = format!("{says} s where tracks last {seconds:.1} s");
            return Err(table.contradiction(Some(0), "duration", what, DURATION));
        }
        if seconds < says * (1. - MAX_LEFT_OUT) - SAME_TIME {
            notes.push(format!("recordingMeta has duration {says} s, tracks last {seconds:.1} s"));
        }
    }
    // Files may be named anyhow; a number that is not the recording's is worth a word.
    let stem = table.file.file_name().and_then(|name| name.to_str()).and_then(|name| name.split('_').next());
    let number = stem.and_then(|stem| stem.parse::<u32>().ok()).map(f64::from);
    if let (Some(id), Some(number)) = (id.map(f64::from), number)
        && id != number
    {
        notes.push(format!("recordingMeta is of recording {id}, the file is named {number}"));
    }
    Ok(notes)
}
