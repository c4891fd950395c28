//! Lane lines fitted from lane numbers and lateral positions, for data that has no markings.

use std::collections::BTreeMap;

use gnp_force::MarkingKind;

use crate::recording::LaneMarking;

/// Width of a lane of an American motorway: 12 feet, m.
pub(crate) const LANE_WIDTH: f32 = 3.66;

/// Lanes beyond this number are ramps: they lie beside the main lanes only for a part of the road.
const MAIN_LANES: i16 = 6;

/// A lane with a smaller fraction of the rows than this does not take part in the fit.
const MIN_FRACTION: f64 = 0.005;

/// Nor does one with fewer rows.
const MIN_ROWS: usize = 20;

/// Neighbouring lanes have their centres at least this far apart, m.
const MIN_SPACING: f32 = 1.5;

/// Positions a lane's centre is the median of, at most; an even choice of more.
const SAMPLE: usize = 50_000;

/// Lines of a carriageway fitted to rows, from right to left, for data without markings. `lane` is
/// the lane number of each row, 1 the leftmost, 0 unknown; `y` its lateral position, growing to the
/// left, m. Empty where no lane is known.
///
/// A line between two lanes lies midway between the medians of their lateral positions; the edges
/// lie one lane's width (3.66 m) beyond the outermost of these. A single lane has its edges half a
/// lane's width from its median. Lanes with very few rows, and numbers beyond 6 (ramps), are left
/// out; a lane without rows between two others gets its lines by equal spacing.
#[must_use]
pub fn fit_lanes(lane: &[i16], y: &[f32]) -> LaneFit {
    let (centres, misplaced) = centres(lane, y);
    LaneFit { lines: lines(&centres), width: width(&centres), centres, misplaced }
}

/// Number of the lane at `y`, m, between `lines` from right to left, 1 the leftmost; 0 outside them.
pub(crate) fn lane_at(lines: &[LaneMarking], y: f32) -> i16 {
    lane_between(lines.iter().map(|line| line.y), y)
}

/// Lanes fitted by [`fit_lanes`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LaneFit {
    /// Lane lines from right to left.
    pub lines: Vec<LaneMarking>,
    /// Mean distance between the centres of neighbouring lanes, m; `None` with fewer than two lanes.
    pub width: Option<f32>,
    /// Lanes that took part with the medians of their lateral positions, m, from left to right.
    pub(crate) centres: Vec<(i16, f32)>,
    /// Lanes whose numbers do not grow to the right with their positions.
    pub(crate) misplaced: Vec<i16>,
}

fn lines(centres: &[(i16, f32)]) -> Vec<LaneMarking> {
    let centre_line = |y| LaneMarking { kind: MarkingKind::LaneDivider, y };
    let mut lines: Vec<LaneMarking> = Vec::new();
    for pair in centres.windows(2) {
        let [(left, y_left), (right, y_right)] = [pair[0], pair[1]];
        let lanes = right - left;
        let line = |i: i16| y_left + (y_right - y_left) * f32::from(2 * i + 1) / f32::from(2 * lanes);
        lines.extend((0..lanes).map(|i| centre_line(line(i))));
    }
    let (left, right) = match (lines.first(), lines.last(), centres.first()) {
        (Some(left), Some(right), _) => (left.y + LANE_WIDTH, right.y - LANE_WIDTH),
        (_, _, Some((_, y))) => (y + LANE_WIDTH / 2., y - LANE_WIDTH / 2.),
        _ => return Vec::new(),
    };
    lines.push(LaneMarking { kind: MarkingKind::Boundary, y: right });
    lines.reverse();
    lines.push(LaneMarking { kind: MarkingKind::Boundary, y: left });
    lines
}

fn width(centres: &[(i16, f32)]) -> Option<f32> {
    let ((left, y_left), (right, y_right)) = (centres.first()?, centres.last()?);
    (right > left).then(|| (y_left - y_right) / f32::from(right - left))
}

/// Lanes that take part, with the median of their lateral positions, from left to right, and those that contradict
/// that order.
fn centres(lane: &[i16], y: &[f32]) -> (Vec<(i16, f32)>, Vec<i16>) {
    let mut counts: BTreeMap<i16, usize> = BTreeMap::new();
    for number in lane.iter().filter(|number| (1..=MAIN_LANES).contains(*number)) {
        *counts.entry(*number).or_default() += 1;
    }
    let all: usize = counts.values().sum();
    // A recording of a few rows still has lanes: the bound never exceeds a tenth of it.
    let least = ((all as f64 * MIN_FRACTION) as usize).max(MIN_ROWS.min(all / 10));
    let mut centres: Vec<(i16, f32, usize)> = Vec::new();
    let mut misplaced = Vec::new();
    for (number, count) in counts.into_iter().filter(|(_, count)| *count >= least) {
        let rows = lane.iter().zip(y).filter(|(have, _)| **have == number);
        let mut positions: Vec<f32> = rows.map(|(_, y)| *y).step_by(count.div_ceil(SAMPLE)).collect();
        let Some(centre) = median(&mut positions) else { continue };
        // Numbers must grow to the right; of two lanes that contradict it the one with more rows stays.
        while let Some((left, y_left, rows)) = centres.last().copied() {
            if y_left - centre >= MIN_SPACING * f32::from(number - left) || rows >= count {
                break;
            }
            centres.pop();
            misplaced.push(left);
        }
        let fits = |(left, y_left, _): &(i16, f32, usize)| y_left - centre >= MIN_SPACING * f32::from(number - left);
        if centres.last().is_none_or(fits) {
            centres.push((number, centre, count));
        } else {
            misplaced.push(number);
        }
    }
    (centres.into_iter().map(|(number, centre, _)| (number, centre)).collect(), misplaced)
}

/// Number of the lane at `y`, m, between borders from right to left, 1 the leftmost; 0 outside.
pub(crate) fn lane_between(borders: impl ExactSizeIterator<Item = f32>, y: f32) -> i16 {
    let count = borders.len();
    let to_the_right = borders.filter(|border| *border <= y).count();
    if (1..count).contains(&to_the_right) { (count - to_the_right) as i16 } else { 0 }
}

/// The median, reordering `values`; the upper one of an even number.
pub(crate) fn median(values: &mut [f32]) -> Option<f32> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of lanes given as (number, centre, rows), spread a little about the centre.
    fn rows(lanes: &[(i16, f32, usize)]) -> (Vec<i16>, Vec<f32>) {
        lanes
            .iter()
            .flat_map(|(number, centre, rows)| (0..*rows).map(move |i| (*number, centre + 0.3 * (i % 5) as f32 - 0.6)))
            .unzip()
    }

    fn lines(lanes: &[(i16, f32, usize)]) -> Vec<(MarkingKind, f32)> {
        let (lane, y) = rows(lanes);
        fit_lanes(&lane, &y).lines.iter().map(|line| (line.kind, (line.y * 100.).round() / 100.)).collect()
    }

    use MarkingKind::{Boundary, LaneDivider};

    #[test]
    fn lines_lie_midway_and_edges_a_lane_beyond() {
        let found = lines(&[(1, -1.8, 100), (2, -5.4, 105), (3, -9.2, 95)]);
        assert_eq!(found, [(Boundary, -10.96), (LaneDivider, -7.3), (LaneDivider, -3.6), (Boundary, 0.06)]);
    }

    #[test]
    fn a_lane_without_rows_is_spaced_evenly() {
        let found = lines(&[(1, -2., 100), (3, -10., 100)]);
        assert_eq!(found, [(Boundary, -11.66), (LaneDivider, -8.), (LaneDivider, -4.), (Boundary, -0.34)]);
    }

    #[test]
    fn stray_rows_and_ramps_do_not_move_a_line() {
        let clean = lines(&[(1, -1.8, 5000), (2, -5.4, 5000)]);
        let stray = lines(&[(1, -1.8, 5000), (2, -5.4, 5000), (3, 40., 7), (7, -6., 3000), (0, 9., 50)]);
        assert_eq!(clean, stray);
        let contradiction = lines(&[(1, -1.8, 5000), (2, -5.4, 5000), (3, -5.6, 200)]);
        assert_eq!(clean, contradiction);
    }

    #[test]
    fn one_lane_has_two_edges_and_none_has_no_line() {
        assert_eq!(lines(&[(4, -3., 50)]), [(Boundary, -4.83), (Boundary, -1.17)]);
        assert_eq!(lines(&[(0, -3., 50)]), []);
    }
}
