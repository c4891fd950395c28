//! The rows of `NN_tracks.csv`, in the road frame.

use std::collections::BTreeSet;

use super::meta::Listed;
use super::{HighD, TRACKS};
use crate::assemble::{NeighbourSource, Rows, VehicleBody};
use crate::error::DataError;
use crate::formats::findings::{MAX_LEFT_OUT, Tally};
use crate::formats::motion::in_order;
use crate::formats::periods::{Picked, out_of_order};
use crate::formats::table::{Kind, Table, Values, Wanted};
use crate::limits::{MAX_RECORDED_SPEED, MAX_SPEED};
use crate::slot::SLOTS;

/// Sizes in two tables that are nearer than this, m, are of one box.
const SAME_SIZE: f32 = 0.25;

/// Rows by vehicle and frame.
pub(super) struct Tracks {
    /// Which rows of the file these are.
    pub(super) rows: Picked,
    pub(super) vehicle: Vec<u32>,
    pub(super) frame: Vec<u32>,
    /// Centre, forward, m.
    pub(super) x: Vec<f32>,
    /// Centre, to the left, m.
    pub(super) y: Vec<f32>,
    /// Forward and to the left, m/s.
    pub(super) velocity: [Vec<f32>; 2],
    pub(super) lane: Vec<i16>,
    pub(super) neighbours: [Vec<i32>; SLOTS],
    /// Whether a row has another size than is listed.
    pub(super) resized: Vec<bool>,
    /// Bodies as they are listed.
    pub(super) body: Vec<VehicleBody>,
}

/// Reads the rows; `listed` are the vehicles of `meta`.
///
/// # Errors
/// Those of [`Table::read`]; for a value that cannot be, frames out of order and a vehicle that is not listed.
pub(super) fn read(table: &Table, meta: &Table, listed: &[Listed]) -> Result<Tracks, DataError> {
    let kind = |name: &str| match name {
        "x" | "y" | "width" | "height" | "xVelocity" | "yVelocity" => Kind::Real,
        _ => Kind::Whole,
    };
    let wanted: Vec<Wanted> = TRACKS.iter().map(|name| table.want(name, kind(name))).collect::<Result<_, _>>()?;
    let mut values = table.read(&wanted)?.into_iter();
    let mut next = || values.next();
    let whole = |values: Option<Values>| values.map(Values::whole).unwrap_or_default();
    let real = |values: Option<Values>| values.map(Values::real).unwrap_or_default();
    let frame = table.frames(whole(next()), wanted[0])?;
    let vehicle = table.natural(whole(next()), wanted[1])?;
    let mut x = table.positions(real(next()), wanted[2])?;
    let mut y = table.positions(real(next()), wanted[3])?;
    let lengths = table.positive(real(next()), wanted[4])?;
    let widths = table.positive(real(next()), wanted[5])?;
    let (mut vx, mut vy) = (real(next()), real(next()));
    let neighbours: [Vec<i32>; SLOTS] = std::array::from_fn(|_| whole(next()));
    let lane = table.lane_numbers(whole(next()), wanted[16])?;

    speeds(table, wanted[6], [&vx, &vy])?;
    if let (_, Some((row, previous))) = out_of_order(&vehicle, &frame, &Picked::All) {
        return Err(table.frame_order("frame", row, vehicle[row], frame[row], previous));
    }
    let body = bodies_of_rows(table, meta, &vehicle, listed)?;
    let mut resized = Vec::with_capacity(body.len());
    for (row, body) in body.iter().enumerate() {
        let [length, width] = [lengths[row], widths[row]];
        let other = (length - body.length).abs() > SAME_SIZE || (width - body.width).abs() > SAME_SIZE;
        resized.push(other);
        // The corner becomes the centre before anything is turned.
        x[row] += if other { body.length } else { length } / 2.;
        y[row] += if other { body.width } else { width } / 2.;
        if body.road == 0 {
            x[row] = -x[row];
            vx[row] = -vx[row];
        } else {
            y[row] = -y[row];
            vy[row] = -vy[row];
        }
    }
    let order = in_order(&vehicle, &frame, &Picked::All);
    let velocity = [vx, vy];
    let tracks = Tracks { rows: Picked::All, vehicle, frame, x, y, velocity, lane, neighbours, resized, body };
    Ok(tracks.picked(order))
}

/// Refuses velocities, m/s along x and y, that are in another unit or those of no vehicle.
fn speeds(table: &Table, column: Wanted, [vx, vy]: [&[f32]; 2]) -> Result<(), DataError> {
    let speed = |row: usize| vx[row].hypot(vy[row]);
    let fast = Tally::of((0..vx.len()).filter(|row| speed(*row) > MAX_RECORDED_SPEED));
    if let Some(first) = fast.first.filter(|_| fast.exceeds(MAX_LEFT_OUT, vx.len())) {
        return Err(DataError::Unit {
            file: table.file.clone(),
            place: format!("line {}, column `xVelocity`", table.line_of(first)?),
            what: format!(
                "{} of {} rows move at more than {MAX_RECORDED_SPEED} m/s, the first at {:.1} m/s",
                fast.count,
                vx.len(),
                speed(first)
            ),
            remedy: HighD::UNITS,
        });
    }
    // Another unit is that of all rows; one vehicle may be that fast.
    match (0..vx.len()).find(|row| speed(*row) > MAX_SPEED) {
        Some(row) => {
            let reason = format!("is more than {MAX_SPEED} m/s, which no vehicle drives; repair it or remove the row");
            Err(table.bad_value(row, column, format!("{:.1} m/s", speed(row)), &reason))
        }
        None => Ok(()),
    }
}

fn bodies_of_rows(
    table: &Table,
    meta: &Table,
    vehicle: &[u32],
    listed: &[Listed],
) -> Result<Vec<VehicleBody>, DataError> {
    let mut of_rows: Vec<VehicleBody> = Vec::with_capacity(vehicle.len());
    for (row, id) in vehicle.iter().enumerate() {
        if row > 0 && vehicle[row - 1] == *id {
            of_rows.push(of_rows[row - 1]);
            continue;
        }
        let Ok(place) = listed.binary_search_by_key(id, |it| it.vehicle) else {
            return Err(DataError::UnknownVehicle {
                file: table.file.clone(),
                line: table.line_of(row)?,
                column: "id".into(),
                vehicle: *id,
                meta: meta.file.clone(),
            });
        };
        of_rows.push(listed[place].body);
    }
    Ok(of_rows)
}

impl Tracks {
    /// Row of the file that row `i` is.
    pub(super) fn place(&self, i: usize) -> usize {
        self.rows.get(i).map_or(i, |row| *row as usize)
    }

    /// How many rows name one of these vehicles, for each slot.
    pub(super) fn names_of(&self, vehicles: &BTreeSet<u32>) -> [usize; SLOTS] {
        let named = |id: &&i32| u32::try_from(**id).is_ok_and(|id| vehicles.contains(&id));
        self.neighbours.each_ref().map(|ids| if vehicles.is_empty() { 0 } else { ids.iter().filter(named).count() })
    }

    /// The same without some vehicles.
    pub(super) fn without(self, vehicles: &BTreeSet<u32>) -> Self {
        if vehicles.is_empty() {
            return self;
        }
        let kept = (0..self.vehicle.len()).filter(|i| !vehicles.contains(&self.vehicle[*i]));
        let kept = Picked::Some(kept.map(|i| i as u32).collect());
        self.picked(kept)
    }

    /// The rows that are picked of these, in that order.
    fn picked(self, picked: Picked) -> Self {
        let Picked::Some(rows) = &picked else { return self };
        fn pick<T: Copy>(column: &[T], rows: &[u32]) -> Vec<T> {
            rows.iter().map(|row| column[*row as usize]).collect()
        }
        Self {
            rows: Picked::Some(rows.iter().map(|i| self.place(*i as usize) as u32).collect()),
            vehicle: pick(&self.vehicle, rows),
            frame: pick(&self.frame, rows),
            x: pick(&self.x, rows),
            y: pick(&self.y, rows),
            velocity: self.velocity.each_ref().map(|column| pick(column, rows)),
            lane: pick(&self.lane, rows),
            neighbours: self.neighbours.each_ref().map(|column| pick(column, rows)),
            resized: pick(&self.resized, rows),
            body: pick(&self.body, rows),
        }
    }

    /// What makes a recording of them, their bodies and their places in the file.
    pub(super) fn into_rows(self) -> (Rows, Vec<VehicleBody>, Picked) {
        let Self { rows: picked, vehicle, frame, x, y, velocity, lane, neighbours, body, .. } = self;
        let neighbours = NeighbourSource::Named(Box::new(neighbours));
        let rows = Rows { velocity: Some(velocity), lane, neighbours, ..Rows::new(vehicle, frame, x, y) };
        (rows, body, picked)
    }
}
