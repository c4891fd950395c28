//! Rows along and across a road, and the carriageways they are on.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use gnp_road::ReferenceLine;

use super::lanes::Lanes;
use super::layout::Taken;
use super::straight::LEAST_TRAVEL;
use super::{TrackOptions, TrackTable};
use crate::error::{DataError, TrackProblem};
use crate::formats::findings::{MAX_LEFT_OUT, Tally};
use crate::limits::MAX_POSITION;

/// Why a vehicle is left out.
const CROSSING: &str = "go across the road";
const BACKING: &str = "drive backwards among the others";
const OFF_LINE: &str = "are off the road's line for most of their way";

/// The rows that are taken, by a line along the road.
pub(super) struct Placed {
    pub(super) taken: Taken,
    /// Along the axis, m; NaN off it.
    pub(super) s: Vec<f64>,
    /// To the left of the axis, m.
    pub(super) d: Vec<f64>,
    /// Rates of both, m/s, where all are known.
    pub(super) rates: Option<[Vec<f64>; 2]>,
    /// Cosine of the angle between a vehicle and the axis, where known.
    facing: Option<Vec<f64>>,
    /// Carriageway of each span, and whether it runs along the axis; `None` for those left out.
    pub(super) way: Vec<Option<u16>>,
    /// Vehicles left out, by why.
    pub(super) left_out: BTreeMap<u32, String>,
    /// Rows without a place on the road.
    pub(super) off_line: u64,
}

impl Placed {
    /// # Errors
    /// When more than a tenth of the rows have no place on the road, or one is farther along than a recording may be.
    pub(super) fn of(
        table: &TrackTable,
        taken: Taken,
        axis: &ReferenceLine,
        straight: bool,
    ) -> Result<Self, DataError> {
        let rows = taken.rows.len();
        let (mut s, mut d) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
        let mut off = Tally::default();
        let velocity = velocity(table);
        let mut rates = velocity.is_some().then(|| [Vec::with_capacity(rows), Vec::with_capacity(rows)]);
        let mut facing = table.heading.as_ref().map(|_| Vec::with_capacity(rows));
        for row in taken.rows.iter().map(|row| *row as usize) {
            let position = [table.x[row], table.y[row]];
            let point = axis.to_road(position);
            if point.is_none() {
                off.add(row);
            }
            let (along, across) = point.map_or((f64::NAN, f64::NAN), |point| (point.s, point.d));
            if along.abs().max(across.abs()) > f64::from(MAX_POSITION) {
                let what = format!(
                    "({}, {}) is more than {MAX_POSITION} m from the beginning of the road",
                    position[0], position[1]
                );
                let remedy = "positions are in m; repair it, or cut the tracks into sections";
                return Err(table.wrong(TrackProblem::Value, Some(row), Some("x"), what, remedy));
            }
            s.push(along);
            d.push(across);
            if let (Some(rates), Some(velocity)) = (&mut rates, &velocity) {
                let rate = point.map_or([0.; 2], |point| point.velocity_to_road(velocity(row)));
                rates.iter_mut().zip(rate).for_each(|(all, rate)| all.push(rate));
            }
            if let (Some(facing), Some(heading)) = (&mut facing, &table.heading) {
                facing.push(point.map_or(f64::NAN, |point| (heading[row] - point.heading).cos()));
            }
        }
        if off.exceeds(MAX_LEFT_OUT, rows) && !straight {
            let row = off.first.unwrap_or(0);
            let why = axis.locate([table.x[row], table.y[row]]).err().map(|why| format!(": {why}")).unwrap_or_default();
            let what = format!("{} of {rows} rows are off the road's line{why}", off.count);
            let remedy = "give the line of this road, in the coordinates of the tracks";
            return Err(table.wrong(TrackProblem::Road, Some(row), Some("x"), what, remedy));
        }
        let way = vec![None; taken.spans.len()];
        let off_line = off.count as u64;
        Ok(Self { taken, s, d, rates, facing, way, left_out: BTreeMap::new(), off_line })
    }

    /// How far a vehicle comes along and across, m.
    pub(super) fn travel(&self, span: &Range<usize>) -> [f64; 2] {
        let step = |values: &[f64], i: usize| values[i] - values[i - 1];
        let steps = self.taken.steps(span).map(|i| [step(&self.s, i), step(&self.d, i)]);
        steps.filter(|step| step[0].is_finite()).fold([0.; 2], |[s, d], [ds, dd]| [s + ds, d + dd])
    }

    /// Positions across the axis of a vehicle, m.
    fn across(&self, span: &Range<usize>) -> impl Iterator<Item = f64> {
        self.d[span.clone()].iter().copied().filter(|d| d.is_finite())
    }
}

/// The velocity of each row, m/s, where all are known.
fn velocity(table: &TrackTable) -> Option<Box<dyn Fn(usize) -> [f64; 2] + '_>> {
    match (&table.velocity, &table.speed, &table.heading) {
        (Some([vx, vy]), ..) if vx.iter().chain(vy).all(|v| v.is_finite()) => Some(Box::new(|row| [vx[row], vy[row]])),
        (None, Some(speed), Some(heading)) if speed.iter().chain(heading).all(|v| v.is_finite()) => {
            Some(Box::new(|row| [speed[row] * heading[row].cos(), speed[row] * heading[row].sin()]))
        }
        _ => None,
    }
}

/// A carriageway: one direction of travel.
#[derive(Clone, Debug)]
pub(super) struct Way {
    /// Whether it runs along the axis, or against it.
    pub(super) along: bool,
    /// Across the axis, m: where its vehicles mostly are.
    across: [f64; 2],
    pub(super) lanes: Lanes,
}

/// The carriageways.
#[derive(Clone, Debug)]
pub(super) struct Ways(pub(super) Vec<Way>);

impl Ways {
    /// Finds them, and which vehicle is on which. `crossing` are left out.
    pub(super) fn of(
        table: &TrackTable,
        placed: &mut Placed,
        axis: &ReferenceLine,
        crossing: BTreeSet<u32>,
        options: &TrackOptions,
    ) -> Result<Self, DataError> {
        let mut across: [Vec<f64>; 2] = Default::default();
        for (vehicle, span) in &placed.taken.spans {
            if let Some(along) = direction(placed, span).filter(|_| !crossing.contains(vehicle)) {
                across[usize::from(!along)].extend(placed.across(span));
            }
        }
        let range = |values: &mut Vec<f64>| {
            values.sort_unstable_by(f64::total_cmp);
            let at = |part: usize| values.get(values.len().saturating_sub(1) * part / 20).copied();
            at(1).zip(at(19)).map(|(low, high)| [low, high])
        };
        let ranges = across.each_mut().map(range);
        let way = |along: bool, across: [f64; 2]| Way { along, across, lanes: Lanes::default() };
        let mut found: Vec<Way> =
            ranges.iter().zip([true, false]).filter_map(|(range, along)| Some(way(along, (*range)?))).collect();
        // Of one who backs among the others no carriageway is made.
        if let ([forward, _], [Some(there), Some(_)]) = (&mut found[..], &ranges) {
            let mut tally = Tally::default();
            let mut inside = true;
            for (_, span) in placed.taken.spans.iter().filter(|(vehicle, _)| !crossing.contains(vehicle)) {
                if direction(placed, span) == Some(false) {
                    tally.add(placed.taken.row(span.start));
                    let outside = placed.across(span).filter(|d| !(there[0]..=there[1]).contains(d)).count();
                    inside &= 2 * outside < span.len();
                }
            }
            if inside && forward.along && !tally.exceeds(MAX_LEFT_OUT, placed.taken.spans.len()) {
                found.pop();
            }
        }
        if found.is_empty() {
            // All stand: they are on the carriageway along the axis.
            let mut all: Vec<f64> = placed.taken.spans.iter().flat_map(|(_, span)| placed.across(span)).collect();
            found.push(way(true, range(&mut all).unwrap_or([0.; 2])));
        }
        let mut ways = Self(found);
        ways.assign(placed, axis, crossing);
        for index in 0..ways.0.len() {
            ways.0[index].lanes = Lanes::of(table, placed, index as u16, ways.0[index].along, options)?;
        }
        Ok(ways)
    }

    /// Says of every vehicle on which carriageway it is, or why it is left out, and gives positions in its frame.
    pub(super) fn assign(&self, placed: &mut Placed, axis: &ReferenceLine, crossing: BTreeSet<u32>) {
        let spans = std::mem::take(&mut placed.taken.spans);
        for (index, (vehicle, span)) in spans.iter().enumerate() {
            let off = placed.s[span.clone()].iter().filter(|s| !s.is_finite()).count();
            let reason = if crossing.contains(vehicle) {
                Some(CROSSING)
            } else if 2 * off >= span.len() {
                Some(OFF_LINE)
            } else {
                None
            };
            let way = match (reason, direction(placed, span)) {
                (Some(_), _) => None,
                (None, Some(along)) => self.0.iter().position(|way| way.along == along),
                (None, None) => self.nearest(placed, span),
            };
            match way {
                Some(way) => placed.way[index] = Some(way as u16),
                None => {
                    placed.left_out.insert(*vehicle, reason.unwrap_or(BACKING).to_owned());
                }
            }
        }
        // Against the axis everything is seen the other way.
        let length = axis.length();
        for ((_, span), way) in spans.iter().zip(&placed.way) {
            if way.is_none_or(|way| self.0[usize::from(way)].along) {
                continue;
            }
            for i in span.clone() {
                placed.s[i] = if length.is_finite() { length - placed.s[i] } else { -placed.s[i] };
                placed.d[i] = -placed.d[i];
                for rate in placed.rates.iter_mut().flatten() {
                    rate[i] = -rate[i];
                }
            }
        }
        placed.taken.spans = spans;
    }

    /// The carriageway nearest to a vehicle that does not move.
    fn nearest(&self, placed: &Placed, span: &Range<usize>) -> Option<usize> {
        let count = placed.across(span).count().max(1) as f64;
        let mean = placed.across(span).sum::<f64>() / count;
        let away = |way: &Way| (way.across[0] - mean).max(mean - way.across[1]).max(0.);
        let by_distance = |a: &(usize, &Way), b: &(usize, &Way)| away(a.1).total_cmp(&away(b.1));
        self.0.iter().enumerate().min_by(by_distance).map(|(index, _)| index)
    }
}

/// Whether a vehicle goes along the axis or against it; `None` where it moves too little and no heading tells.
fn direction(placed: &Placed, span: &Range<usize>) -> Option<bool> {
    let [s, _] = placed.travel(span);
    if s.abs() >= LEAST_TRAVEL {
        return Some(s > 0.);
    }
    let facing = placed.facing.as_ref()?;
    let facing = facing[span.clone()].iter().find(|facing| facing.is_finite())?;
    (facing.abs() > 0.5).then_some(*facing > 0.)
}
