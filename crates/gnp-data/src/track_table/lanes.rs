//! Lane lines of a carriageway: given, fitted from lane numbers, or found from where vehicles drive.

use super::road::Placed;
use super::units::FEET;
use super::{LaneNumbers, TrackOptions, TrackTable};
use crate::error::{DataError, TrackProblem};
use crate::formats::findings::{MAX_DOUBTED, MAX_LEFT_OUT, Tally};
use crate::lanes::{LANE_WIDTH, fit_lanes, lane_between};
use crate::limits::{MAX_LANE_WIDTH, MAX_LINES};
use crate::recording::LaneMarking;

/// Lanes are not narrower, m.
const MIN_LANE_WIDTH: f32 = 2.;

/// A row may be this far from the middle of its lane, m: at a lane change half a lane.
const OFF_LANE: f32 = 3.;

/// A carriageway on which vehicles spread over less is one lane, m.
const ONE_LANE: f32 = 2.5;

/// Widths among which that of the lanes is looked for, m, and in which steps.
const WIDTHS: (f32, f32, f32) = (3., 4.2, 0.02);

/// A width that is this far from [`LANE_WIDTH`] must gather vehicles so much better, 1/m.
const PREFERENCE: f32 = 0.05;

/// Vehicles gather in lanes from this length of the mean of their phases on: 0 for evenly spread ones, 1 for a point.
const GATHERED: f32 = 0.45;

/// Part of the rows that makes a lane.
const LEAST_SHARE: f32 = 0.01;

/// Positions that are looked at, at most.
const SAMPLE: usize = 50_000;

/// An edge without lines lies this far beyond the outermost vehicles' centres, m.
const SHOULDER: f32 = LANE_WIDTH / 2.;

/// The lanes of a carriageway.
#[derive(Clone, Debug, Default)]
pub(super) struct Lanes {
    pub(super) lines: Vec<LaneMarking>,
    /// Whether the lines are given.
    pub(super) given: bool,
    numbering: Numbering,
    /// How the lanes were told.
    pub(super) note: String,
}

/// How a row's lane is told.
#[derive(Clone, Debug)]
enum Numbering {
    /// By its place between borders from right to left, m.
    Place(Vec<f32>),
    /// By the number that it has, counted from the other side where the highest number is given; within the lanes, by
    /// their middles, m.
    Number { highest: Option<i16>, middles: Vec<(i16, f32)> },
}

impl Default for Numbering {
    fn default() -> Self {
        Self::Place(Vec::new())
    }
}

impl Lanes {
    /// The lanes of carriageway `way`, which runs `along` the axis or against it.
    ///
    /// # Errors
    /// When lines are given and most vehicles are elsewhere; when lanes are as wide as no lanes are.
    pub(super) fn of(
        table: &TrackTable,
        placed: &Placed,
        way: u16,
        along: bool,
        options: &TrackOptions,
    ) -> Result<Self, DataError> {
        let rows = rows_of(placed, way);
        let y: Vec<f32> = rows.iter().map(|i| placed.d[*i] as f32).collect();
        if let Some(lines) = &options.lines
            && let Some(lanes) = given(table, placed, (&rows, &y), lines, along)?
        {
            return Ok(lanes);
        }
        if let Some(lane) = &table.lane {
            let numbers: Vec<i16> = rows.iter().map(|i| lane[placed.taken.row(*i)]).collect();
            if let Some(lanes) = numbered(table, placed, (&rows, &y), &numbers)? {
                return Ok(lanes);
            }
        }
        found(table, &y)
    }

    /// Lane of a row at `y`, m, with the number that it has in the table; 0 where unknown.
    pub(super) fn lane(&self, y: f32, number: Option<i16>) -> i16 {
        match &self.numbering {
            Numbering::Place(borders) => lane_between(borders.iter().copied(), y),
            Numbering::Number { highest, middles } => {
                let number = number.unwrap_or(0);
                let number = if number > 0 { mirrored(number, *highest) } else { 0 };
                let off = |(lane, middle): &(i16, f32)| *lane == number && (y - middle).abs() > OFF_LANE;
                if middles.iter().any(off) { 0 } else { number.max(0) }
            }
        }
    }
}

fn mirrored(number: i16, highest: Option<i16>) -> i16 {
    highest.map_or(number, |highest| highest.saturating_sub(number).saturating_add(1))
}

/// Places of the rows on a carriageway.
fn rows_of(placed: &Placed, way: u16) -> Vec<usize> {
    let spans = placed.taken.spans.iter().zip(&placed.way).filter(|(_, of)| **of == Some(way));
    spans.flat_map(|((_, span), _)| span.clone()).filter(|i| placed.d[*i].is_finite()).collect()
}

/// Lines that are given; `None` where they are those of the other carriageway.
fn given(
    table: &TrackTable,
    placed: &Placed,
    (rows, y): (&[usize], &[f32]),
    lines: &[LaneMarking],
    along: bool,
) -> Result<Option<Lanes>, DataError> {
    let lines: Vec<LaneMarking> = if along {
        lines.to_vec()
    } else {
        lines.iter().rev().map(|line| LaneMarking { y: -line.y, ..*line }).collect()
    };
    let grow = lines.windows(2).all(|pair| pair[0].y < pair[1].y);
    if !grow || !(2..=MAX_LINES).contains(&lines.len()) || lines.iter().any(|line| !line.y.is_finite()) {
        let what = format!("{} lane lines are given that are no lines of a road", lines.len());
        let remedy = format!("give 2 to {MAX_LINES} places across the road, m, from right to left");
        return Err(table.wrong(TrackProblem::Road, None, None, what, remedy));
    }
    let inside = lines[0].y..=lines[lines.len() - 1].y;
    let outside = Tally::of(rows.iter().zip(y).filter(|(_, y)| !inside.contains(y)).map(|(i, _)| placed.taken.row(*i)));
    if outside.exceeds(MAX_DOUBTED, rows.len()) {
        if !along {
            return Ok(None);
        }
        let what = format!("{} of {} rows are outside the lane lines given", outside.count, rows.len());
        let remedy = "lines are places across the road in m, growing to the left of travel; 0 is the road's line";
        return Err(table.wrong(TrackProblem::Road, outside.first, Some("y"), what, remedy));
    }
    let numbering = Numbering::Place(lines.iter().map(|line| line.y).collect());
    let note = format!("the {} lines given", lines.len());
    Ok(Some(Lanes { lines, given: true, numbering, note }))
}

/// Lines fitted from lane numbers; `None` where these are unknown or contradict where vehicles are.
fn numbered(
    table: &TrackTable,
    placed: &Placed,
    (rows, y): (&[usize], &[f32]),
    numbers: &[i16],
) -> Result<Option<Lanes>, DataError> {
    let known = numbers.iter().filter(|number| **number > 0).count();
    if 2 * known < numbers.len() || known == 0 {
        return Ok(None);
    }
    let highest = numbers.iter().copied().max();
    // Counted as the table says, else from the other side.
    let sides = match table.lane_numbers {
        LaneNumbers::FromLeft => [None, highest],
        LaneNumbers::FromRight => [highest, None],
    };
    for (side, highest) in sides.into_iter().enumerate() {
        let counted: Vec<i16> =
            numbers.iter().map(|number| if *number > 0 { mirrored(*number, highest) } else { 0 }).collect();
        let fit = fit_lanes(&counted, y);
        let off = |(i, number): (usize, &i16)| {
            let middle = fit.centres.iter().find(|(lane, _)| lane == number);
            middle.is_some_and(|(_, middle)| (y[i] - middle).abs() > OFF_LANE)
        };
        let off = counted.iter().enumerate().filter(|it| off(*it)).count();
        let width = fit.width.unwrap_or(LANE_WIDTH);
        let far = width > MAX_LANE_WIDTH || off as f64 <= MAX_LEFT_OUT * known as f64;
        if !fit.misplaced.is_empty() || fit.lines.is_empty() || !far {
            continue;
        }
        if !(MIN_LANE_WIDTH..=MAX_LANE_WIDTH).contains(&width) {
            let row = rows.first().map(|i| placed.taken.row(*i));
            let what = format!("lanes are {width:.1} m wide");
            return Err(table.wrong(TrackProblem::Unit, row, Some("lane"), what, FEET));
        }
        let from = match (table.lane_numbers, side) {
            (_, 0) => "",
            (LaneNumbers::FromLeft, _) => ", which count from the right",
            (LaneNumbers::FromRight, _) => ", which count from the left",
        };
        let numbering = Numbering::Number { highest, middles: fit.centres };
        return Ok(Some(Lanes {
            lines: fit.lines,
            given: false,
            numbering,
            note: format!("fitted from lane numbers{from}"),
        }));
    }
    Ok(None)
}

/// Lanes by where vehicles gather; edges alone where they do not.
fn found(table: &TrackTable, y: &[f32]) -> Result<Lanes, DataError> {
    let mut sorted: Vec<f32> = y.iter().copied().step_by(y.len().div_ceil(SAMPLE).max(1)).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let at = |part: usize| sorted.get(sorted.len().saturating_sub(1) * part / 100).copied().unwrap_or(0.);
    let (low, middle, high) = (at(1), at(50), at(99));
    if high - low < ONE_LANE {
        return Ok(evenly(middle, LANE_WIDTH, 0, 0, "one lane, about where vehicles drive"));
    }
    let Some((width, offset)) = gathered(&sorted) else {
        let edges = [low - SHOULDER, high + SHOULDER];
        let strips = (((edges[1] - edges[0]) / LANE_WIDTH).round() as usize).clamp(1, MAX_LINES - 1);
        let borders = (0..=strips).map(|i| edges[0] + (edges[1] - edges[0]) * i as f32 / strips as f32).collect();
        let lines = edges.map(|y| LaneMarking::new(y, true)).to_vec();
        let note = format!("no lanes are found, edges alone; neighbours are told by {strips} strips of equal width");
        return Ok(Lanes { lines, given: false, numbering: Numbering::Place(borders), note });
    };
    let lane = |y: f32| ((y - offset) / width).round() as i32;
    let least = ((sorted.len() as f32 * LEAST_SHARE) as usize).max(1);
    let occupied: Vec<i32> = sorted
        .chunk_by(|a, b| lane(*a) == lane(*b))
        .filter(|rows| rows.len() >= least)
        .map(|rows| lane(rows[0]))
        .collect();
    let (Some(first), Some(last)) = (occupied.first().copied(), occupied.last().copied()) else {
        return Ok(evenly(middle, LANE_WIDTH, 0, 0, "one lane, about where vehicles drive"));
    };
    // Lanes of 12 ft taken for 12 m stand at every third or fourth place.
    if occupied.len() >= 3 && occupied.windows(2).all(|pair| pair[1] - pair[0] >= 3) {
        let spacing = (last - first) as f32 * width / (occupied.len() - 1) as f32;
        let what = format!("vehicles drive in {} rows {spacing:.1} m apart", occupied.len());
        return Err(table.wrong(TrackProblem::Unit, None, Some("y"), what, FEET));
    }
    // No carriageway has more.
    let last = last.min(first + MAX_LINES as i32 - 2);
    let note = format!("{} lanes of {width:.2} m, found from where vehicles drive", last - first + 1);
    Ok(evenly(offset, width, first, last, &note))
}

/// Lanes `first` to `last` of one width, of which lane 0 has its middle at `offset`, m.
fn evenly(offset: f32, width: f32, first: i32, last: i32, note: &str) -> Lanes {
    let borders: Vec<f32> = (first..=last + 1).map(|lane| offset + width * (lane as f32 - 0.5)).collect();
    let edge = |i: usize| i == 0 || i + 1 == borders.len();
    let lines = borders.iter().enumerate().map(|(i, y)| LaneMarking::new(*y, edge(i))).collect();
    Lanes { lines, given: false, numbering: Numbering::Place(borders), note: note.to_owned() }
}

/// The width of lanes, m, by which positions gather best, and the middle of one; `None` where they do not.
fn gathered(y: &[f32]) -> Option<(f32, f32)> {
    let (from, to, step) = WIDTHS;
    let tried = (0..=((to - from) / step).round() as usize).map(|i| from + step * i as f32);
    let mut best: Option<(f32, f32, f32)> = None;
    for width in tried {
        let per_m = std::f64::consts::TAU / f64::from(width);
        let (sin, cos) = y.iter().fold((0f64, 0f64), |(sin, cos), y| {
            let (s, c) = (f64::from(*y) * per_m).sin_cos();
            (sin + s, cos + c)
        });
        let mean = (sin.hypot(cos) / y.len() as f64) as f32;
        let score = mean - PREFERENCE * (width - LANE_WIDTH).abs();
        if mean >= GATHERED && best.is_none_or(|(most, ..)| score > most) {
            best = Some((score, width, (sin.atan2(cos) / per_m) as f32));
        }
    }
    best.map(|(_, width, offset)| (width, offset))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;

    fn table() -> TrackTable {
        TrackTable::new(Dataset::TRACKS, "s", "n")
    }

    /// Positions about the middles of lanes, spread by half a metre.
    fn about(middles: &[f32]) -> Vec<f32> {
        let spread = |middle: &f32| (0..200).map(move |i| middle + 0.5 * (i as f32 * 0.7).sin()).collect::<Vec<f32>>();
        middles.iter().flat_map(spread).collect()
    }

    fn lines(middles: &[f32]) -> Vec<f32> {
        found(&table(), &about(middles)).unwrap().lines.iter().map(|line| line.y).collect()
    }

    fn near(found: &[f32], expected: &[f32]) {
        let close = found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.15);
        assert!(close, "{found:?}, expected {expected:?}");
    }

    #[test]
    fn lanes_are_found_where_vehicles_drive() {
        near(&lines(&[1.8, 5.4, 9.0]), &[0., 3.6, 7.2, 10.8]);
        near(&lines(&[-10.5, -7.0, -3.5]), &[-12.25, -8.75, -5.25, -1.75]);
        // An empty lane between two, and one lane alone.
        near(&lines(&[0., 7.4]), &[-1.85, 1.85, 5.55, 9.25]);
        near(&lines(&[4.]), &[2.2, 5.8]);
        let lanes = found(&table(), &about(&[1.8, 5.4])).unwrap();
        assert_eq!([1.8, 5.4, -3., 12.].map(|y| lanes.lane(y, None)), [2, 1, 0, 0]);
    }

    #[test]
    fn who_drives_anywhere_has_edges_and_no_dividers() {
        let anywhere: Vec<f32> = (0..1000).map(|i| 0.011 * i as f32).collect();
        let lanes = found(&table(), &anywhere).unwrap();
        near(&lanes.lines.iter().map(|line| line.y).collect::<Vec<_>>(), &[-1.72, 12.72]);
        assert!(lanes.note.contains("4 strips"), "{}", lanes.note);
        assert_eq!([0., 3., 6., 11.].map(|y| lanes.lane(y, None)), [4, 3, 2, 1]);
    }

    #[test]
    fn lanes_in_feet_are_no_lanes() {
        let error = found(&table(), &about(&[6., 18., 30., 42.])).unwrap_err();
        assert!(matches!(&error, DataError::Tracks { problem: TrackProblem::Unit, .. }), "{error}");
        assert!(error.to_string().contains("12.0 m apart"), "{error}");
    }
}
