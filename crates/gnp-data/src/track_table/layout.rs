//! What the parts of a table have in common: clock, road, lanes, numbers of vehicles; and the rows by vehicle and frame.

use std::collections::BTreeSet;
use std::ops::Range;

use gnp_road::ReferenceLine;

use super::bodies::Numbering;
use super::road::{Placed, Ways};
use super::times::Clock;
use super::{TrackOptions, TrackTable, straight, units};
use crate::error::{DataError, TrackProblem};

/// What the parts of long tracks have in common: clock, road, carriageways, lane lines, numbers of vehicles. Found in one
/// table ([`TrackTable::layout`]) and taken as it is for others, so that a file can be read in parts.
#[derive(Clone, Debug)]
pub struct TrackLayout {
    pub(super) clock: Clock,
    /// x of the carriageway that runs along it.
    pub(super) axis: ReferenceLine,
    /// Whether the axis was found and not given.
    pub(super) straight: bool,
    pub(super) ways: Ways,
    pub(super) numbering: Numbering,
}

/// Rows of a table by vehicle and frame, of those that are taken.
pub(super) struct Taken {
    /// Rows of the table.
    pub(super) rows: Vec<u32>,
    pub(super) frame: Vec<u32>,
    /// Vehicles of the table with their places in `rows`.
    pub(super) spans: Vec<(u32, Range<usize>)>,
    /// Rows that stand after a later one of their vehicle.
    pub(super) out_of_order: u64,
    /// Rows between the frames that were asked for.
    pub(super) between: u64,
}

impl TrackLayout {
    /// Finds everything in one table.
    ///
    /// # Errors
    /// As [`TrackTable::recordings`].
    pub(super) fn of(table: &TrackTable, options: &TrackOptions) -> Result<(Self, Placed), DataError> {
        table.check()?;
        let (sorted, out_of_order) = sorted(table)?;
        let clock = Clock::of(table, &sorted, options)?;
        let taken = Taken::of(table, &sorted, &clock, out_of_order)?;
        units::speeds(table, &taken, clock.rate_hz())?;
        units::headings(table, &taken)?;
        let axis = match &options.road {
            Some(road) => road.clone(),
            None => straight::axis(table, &taken)?,
        };
        let straight = options.road.is_none();
        let mut placed = Placed::of(table, taken, &axis, straight)?;
        let mut across = BTreeSet::new();
        if straight {
            across = straight::crossing(table, &placed)?;
            straight::check(table, &placed, &across)?;
        }
        let far = straight && axis.to_world(0., 0.) != [0., 0.];
        if far && options.lines.is_some() {
            let what = "lane lines are given and no road from which they are counted".to_owned();
            let remedy = "give the road's line with them; the coordinates of the tracks begin too far away";
            return Err(table.wrong(TrackProblem::Road, None, None, what, remedy));
        }
        let ways = Ways::of(table, &mut placed, &axis, across, options)?;
        Ok((Self { clock, axis, straight, ways, numbering: Numbering::of(table) }, placed))
    }

    /// Places another part of the same tracks.
    ///
    /// # Errors
    /// As [`TrackTable::recordings`], for values and times.
    pub(super) fn place(&self, table: &TrackTable) -> Result<Placed, DataError> {
        table.check()?;
        let (sorted, out_of_order) = sorted(table)?;
        self.clock.check(table)?;
        let taken = Taken::of(table, &sorted, &self.clock, out_of_order)?;
        let mut placed = Placed::of(table, taken, &self.axis, self.straight)?;
        let across = if self.straight { straight::crossing(table, &placed)? } else { BTreeSet::new() };
        self.ways.assign(&mut placed, &self.axis, across);
        Ok(placed)
    }
}

impl Taken {
    fn of(table: &TrackTable, sorted: &[u32], clock: &Clock, out_of_order: u64) -> Result<Self, DataError> {
        let (mut rows, mut frame) = (Vec::with_capacity(sorted.len()), Vec::with_capacity(sorted.len()));
        let mut spans: Vec<(u32, Range<usize>)> = Vec::new();
        for row in sorted {
            let Some(at) = clock.frame(table.time_s[*row as usize]) else { continue };
            let vehicle = table.vehicle[*row as usize];
            match spans.last_mut() {
                Some((of, span)) if *of == vehicle => span.end += 1,
                _ => spans.push((vehicle, rows.len()..rows.len() + 1)),
            }
            rows.push(*row);
            frame.push(at);
        }
        let between = (sorted.len() - rows.len()) as u64;
        let taken = Self { rows, frame, spans, out_of_order, between };
        units::one_row_a_frame(table, &taken)?;
        Ok(taken)
    }

    /// Whether the row at `i` is the frame after that at `i - 1`, of the same vehicle.
    pub(super) fn goes_on(&self, span: &Range<usize>, i: usize) -> bool {
        i > span.start && self.frame[i] - self.frame[i - 1] == 1
    }

    /// Steps of a vehicle over one frame, by the place of the later row.
    pub(super) fn steps<'a>(&'a self, span: &'a Range<usize>) -> impl Iterator<Item = usize> + 'a {
        span.clone().filter(|i| self.goes_on(span, *i))
    }

    /// Row of the table at `i`.
    pub(super) fn row(&self, i: usize) -> usize {
        self.rows[i] as usize
    }
}

/// Rows by vehicle and time of the vehicles that are read, and how many stand after a later one.
fn sorted(table: &TrackTable) -> Result<(Vec<u32>, u64), DataError> {
    let read = |row: &u32| table.vehicles[table.vehicle[*row as usize] as usize].left_out.is_none();
    let mut rows: Vec<u32> = (0..table.len() as u32).filter(read).collect();
    if rows.is_empty() {
        let why: BTreeSet<&str> = table.vehicles.iter().filter_map(|vehicle| vehicle.left_out.as_deref()).collect();
        let why = why.into_iter().take(5).collect::<Vec<_>>().join(", ");
        let what = format!("there is no vehicle to read: all {why}");
        return Err(table.wrong(TrackProblem::Empty, None, None, what, "give tracks of cars, trucks or motorcycles"));
    }
    let mut latest = vec![f64::NEG_INFINITY; table.vehicles.len()];
    let mut out_of_order = 0;
    for row in &rows {
        let (time, latest) = (table.time_s[*row as usize], &mut latest[table.vehicle[*row as usize] as usize]);
        out_of_order += u64::from(time < *latest);
        *latest = latest.max(time);
    }
    let key = |row: &u32| (table.vehicle[*row as usize], table.time_s[*row as usize], *row);
    let before = |a: &u32, b: &u32| {
        let (a, b) = (key(a), key(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2))
    };
    rows.sort_unstable_by(before);
    Ok((rows, out_of_order))
}
