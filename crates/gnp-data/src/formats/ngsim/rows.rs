//! Columns of a table, in metres where they are in feet.

use crate::error::DataError;
use crate::formats::table::{Kind, Table, Values, Wanted};
use crate::limits::MAX_RECORDED_SPEED;
use crate::recording::{NamedLeader, VehicleClass};

/// Names of the columns that tell the vehicle directly ahead, which a file need not have.
const LEADER: [&[&str]; 2] = [&["Preceding"], &["Space_Headway", "Space_Hdwy"]];

/// Headways from here on stand for none, ft.
const NO_HEADWAY: f32 = 9999.;

/// Metres in a foot.
const FOOT: f64 = 0.3048;

/// What is read of a table, row by row.
pub(super) struct Raw {
    pub(super) vehicle: Vec<u32>,
    pub(super) frame: Vec<u32>,
    pub(super) time: Vec<i64>,
    /// m, to the right of the left edge.
    pub(super) right: Vec<f32>,
    /// m, front of the vehicle.
    pub(super) front: Vec<f32>,
    pub(super) length: Vec<f32>,
    pub(super) width: Vec<f32>,
    pub(super) class: Vec<VehicleClass>,
    /// m/s, without a direction.
    pub(super) speed: Vec<f32>,
    pub(super) lane: Vec<i16>,
    pub(super) site: Option<(Vec<u16>, Vec<String>)>,
    pub(super) leader: Option<Vec<NamedLeader>>,
    /// Rows that name the vehicle ahead by a negative number.
    pub(super) negative_leaders: usize,
    /// Rows that the file says the row's vehicle has.
    pub(super) total: Option<Vec<i32>>,
    /// What is not done with columns that need not be there and cannot be read, and why.
    pub(super) unread: Vec<String>,
}

/// Reads the columns of a table.
///
/// # Errors
/// Those of [`Table::read`], and for a value that cannot be.
pub(super) fn read(table: &Table) -> Result<Raw, DataError> {
    let columns = [
        table.want("Vehicle_ID", Kind::Whole)?,
        table.want("Frame_ID", Kind::Whole)?,
        table.want("Global_Time", Kind::Time)?,
        table.want("Local_X", Kind::Real)?,
        table.want("Local_Y", Kind::Real)?,
        table.want("v_Length", Kind::Real)?,
        table.want("v_Width", Kind::Real)?,
        table.want("v_Class", Kind::Whole)?,
        table.want("v_Vel", Kind::Real)?,
        table.want("Lane_ID", Kind::Whole)?,
    ];
    let [vehicle, frame, _, right, front, length, width, class, speed, lane] = columns;
    let location = table.find(&["Location"], Kind::Word)?;
    let mut leader = table.find(LEADER[0], Kind::Whole)?.zip(table.find(LEADER[1], Kind::Real)?);
    let mut total = table.find(&["Total_Frames"], Kind::Whole)?;
    let needed: Vec<Wanted> = columns.into_iter().chain(location).collect();
    let mut unread = Vec::new();
    let values = loop {
        let optional = leader.into_iter().flat_map(|(a, b)| [a, b]).chain(total);
        let wanted: Vec<Wanted> = needed.iter().copied().chain(optional).collect();
        let wrong = match table.read(&wanted) {
            Err(wrong) if wanted.len() > needed.len() => wrong,
            read => break read?,
        };
        // What need not be there need not be right.
        let of_total =
            |total: Wanted| matches!(&wrong, DataError::Value { column, .. } if *column == table.columns[total.index]);
        if leader.is_none() || total.is_some_and(of_total) {
            total = None;
            unread.push(format!("numbers of rows are not compared: {wrong}"));
        } else {
            leader = None;
            unread.push(format!("vehicles ahead are not taken from the file: {wrong}"));
        }
    };
    let mut values = values;
    let site = location.map(|_| values.remove(columns.len()).words());
    let skipped = rows_left_out(site.as_ref());
    let mut values = values.into_iter();
    let mut next = || values.next();

    let whole = |values: Option<Values>| values.map(Values::whole).unwrap_or_default();
    let metres = |values: Option<Values>| {
        let mut values = values.map(Values::real).unwrap_or_default();
        values.iter_mut().for_each(|value| *value = (f64::from(*value) * FOOT) as f32);
        values
    };
    let vehicles = table.natural(whole(next()), vehicle)?;
    let frames = table.frames(whole(next()), frame)?;
    let time = next().map(Values::time).unwrap_or_default();
    let rights = table.positions(without(metres(next()), &skipped, 0.), right)?;
    let fronts = table.positions(without(metres(next()), &skipped, 0.), front)?;
    let lengths = table.positive(without(metres(next()), &skipped, 1.), length)?;
    let widths = table.positive(without(metres(next()), &skipped, 1.), width)?;
    let classes = without(whole(next()), &skipped, 2);
    let class_of = |code: &i32| match code {
        1 => Some(VehicleClass::Motorcycle),
        2 => Some(VehicleClass::Car),
        3 => Some(VehicleClass::Truck),
        _ => None,
    };
    if let Some(row) = classes.iter().position(|code| class_of(code).is_none()) {
        return Err(table.bad_value(row, class, classes[row], "is none of the classes 1, 2, 3; repair it"));
    }
    let speeds = without(metres(next()), &skipped, 0.);
    if let Some(row) = speeds.iter().position(|v| v.abs() > MAX_RECORDED_SPEED) {
        return Err(DataError::Unit {
            file: table.file.clone(),
            place: format!("line {}, column `{}`", table.line_of(row)?, table.columns[speed.index]),
            what: format!(
                "{:.1} m/s read as feet per second, no vehicle is faster than {MAX_RECORDED_SPEED} m/s",
                speeds[row]
            ),
            remedy: "NGSIM is in feet and feet per second; take the original file",
        });
    }
    let lanes = table.lane_numbers(without(whole(next()), &skipped, 0), lane)?;
    let named = leader.and_then(|_| next()).map(Values::whole);
    let negative_leaders = named.iter().flatten().filter(|vehicle| **vehicle < 0).count();
    let leader = named.map(|named| leaders(&named, &next().map(Values::real).unwrap_or_default()));
    let total = total.and_then(|_| next()).map(Values::whole);
    Ok(Raw {
        vehicle: vehicles,
        frame: frames,
        time,
        right: rights,
        front: fronts,
        length: lengths,
        width: widths,
        class: classes.iter().filter_map(class_of).collect(),
        speed: speeds,
        lane: lanes,
        site,
        leader,
        negative_leaders,
        total,
        unread,
    })
}

/// Rows of sites that are not motorways: whatever is in them does not matter.
fn rows_left_out(site: Option<&(Vec<u16>, Vec<String>)>) -> Vec<usize> {
    let Some((codes, words)) = site else { return Vec::new() };
    let read: Vec<bool> = words.iter().map(|word| super::motorway(word).is_some()).collect();
    (0..codes.len()).filter(|row| !read[usize::from(codes[*row])]).collect()
}

/// `values` with a value that can be in rows that are left out, so that no check refuses these.
fn without<T: Copy>(mut values: Vec<T>, rows: &[usize], value: T) -> Vec<T> {
    rows.iter().for_each(|row| values[*row] = value);
    values
}

/// The vehicle ahead of each row; headways in ft.
fn leaders(vehicles: &[i32], headways: &[f32]) -> Vec<NamedLeader> {
    let leader = |(vehicle, headway): (&i32, &f32)| NamedLeader {
        vehicle: u32::try_from(*vehicle).unwrap_or(0),
        headway: if *headway < NO_HEADWAY { (f64::from(*headway) * FOOT) as f32 } else { 0. },
    };
    vehicles.iter().zip(headways).map(leader).collect()
}
