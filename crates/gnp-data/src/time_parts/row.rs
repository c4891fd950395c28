//! Rows of tables, one by one.

use std::collections::{BTreeSet, HashMap};

use crate::error::DataError;
use crate::track_table::{RowPlaces, TableVehicle, TrackTable};

/// A row of a table; what its table has no column for is NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Row {
    /// Index among all vehicles of the file.
    pub(super) vehicle: u32,
    pub(super) lane: i16,
    pub(super) time_s: f64,
    /// x, y, velocity, speed, heading.
    values: [f64; 6],
    /// Where it stands in the file.
    place: u64,
}

impl Row {
    /// Bytes of a row in a temporary file.
    pub(super) const BYTES: usize = 4 + 2 + 8 + 6 * 8 + 8;

    /// The rows of a table; `known` has all its vehicles.
    pub(super) fn all<'a>(table: &'a TrackTable, known: &HashMap<String, u32>) -> impl Iterator<Item = Self> + 'a {
        let vehicles: Vec<u32> =
            table.vehicles.iter().map(|vehicle| known.get(&vehicle.name).copied().unwrap_or(0)).collect();
        let place = |row: usize| match &table.places {
            RowPlaces::Rows { first, .. } | RowPlaces::Lines { first, .. } => first + row as u64,
            RowPlaces::Numbers { numbers, .. } => numbers.get(row).copied().unwrap_or(0),
            RowPlaces::Program => row as u64,
        };
        let of = |column: &Option<Vec<f64>>, row: usize| column.as_ref().map_or(f64::NAN, |column| column[row]);
        (0..table.len()).map(move |row| {
            let [vx, vy] = table.velocity.as_ref().map_or([f64::NAN; 2], |[vx, vy]| [vx[row], vy[row]]);
            Self {
                vehicle: vehicles[table.vehicle[row] as usize],
                lane: table.lane.as_ref().map_or(0, |lane| lane[row]),
                time_s: table.time_s[row],
                values: [table.x[row], table.y[row], vx, vy, of(&table.speed, row), of(&table.heading, row)],
                place: place(row),
            }
        })
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) {
        out.extend(self.vehicle.to_le_bytes());
        out.extend(self.lane.to_le_bytes());
        out.extend(self.time_s.to_le_bytes());
        self.values.iter().for_each(|value| out.extend(value.to_le_bytes()));
        out.extend(self.place.to_le_bytes());
    }

    /// A row from its bytes; `None` where they are too few.
    pub(super) fn read(bytes: &[u8]) -> Option<Self> {
        let (vehicle, rest) = bytes.split_first_chunk()?;
        let (lane, mut rest) = rest.split_first_chunk()?;
        let mut next = || {
            let (value, after) = rest.split_first_chunk()?;
            rest = after;
            Some(u64::from_le_bytes(*value))
        };
        let time_s = f64::from_bits(next()?);
        let mut values = [0.; 6];
        for value in &mut values {
            *value = f64::from_bits(next()?);
        }
        let (vehicle, lane) = (u32::from_le_bytes(*vehicle), i16::from_le_bytes(*lane));
        Some(Self { vehicle, lane, time_s, values, place: next()? })
    }
}

/// Rows of a file whose tables are like `outline.0` and whose vehicles are `outline.1`.
pub(super) struct Rows<'a> {
    pub(super) outline: (&'a TrackTable, &'a [TableVehicle]),
    pub(super) rows: &'a [Row],
}

impl Rows<'_> {
    /// A table of them.
    pub(super) fn table(&self) -> TrackTable {
        let (like, vehicles) = self.outline;
        let mut table = TrackTable::new(like.dataset, &like.site, &like.name);
        table.simulated = like.simulated;
        table.lane_numbers = like.lane_numbers;
        table.columns.clone_from(&like.columns);
        table.notes.clone_from(&like.notes);
        let present: BTreeSet<u32> = self.rows.iter().map(|row| row.vehicle).collect();
        let index: HashMap<u32, u32> = present.iter().copied().zip(0..).collect();
        table.vehicles = present.iter().map(|vehicle| vehicles[*vehicle as usize].clone()).collect();
        table.vehicle = self.rows.iter().filter_map(|row| index.get(&row.vehicle).copied()).collect();
        table.time_s = self.rows.iter().map(|row| row.time_s).collect();
        let column = |place: usize| self.rows.iter().map(|row| row.values[place]).collect::<Vec<f64>>();
        (table.x, table.y) = (column(0), column(1));
        table.velocity = like.velocity.as_ref().map(|_| [column(2), column(3)]);
        table.speed = like.speed.as_ref().map(|_| column(4));
        table.heading = like.heading.as_ref().map(|_| column(5));
        table.lane = like.lane.as_ref().map(|_| self.rows.iter().map(|row| row.lane).collect());
        let numbers = || self.rows.iter().map(|row| row.place).collect();
        table.places = match &like.places {
            RowPlaces::Program => RowPlaces::Program,
            RowPlaces::Rows { file, .. } => RowPlaces::Numbers { file: file.clone(), what: "row", numbers: numbers() },
            RowPlaces::Lines { file, .. } => {
                RowPlaces::Numbers { file: file.clone(), what: "data row", numbers: numbers() }
            }
            RowPlaces::Numbers { file, what, .. } => {
                RowPlaces::Numbers { file: file.clone(), what, numbers: numbers() }
            }
        };
        table
    }
}

/// A table of one row of another, with the columns of that.
pub(super) fn only(table: &TrackTable, row: usize) -> TrackTable {
    let mut one = TrackTable::new(table.dataset, &table.site, &table.name);
    one.vehicles = vec![table.vehicles[table.vehicle[row] as usize].clone()];
    one.vehicle = vec![0];
    (one.time_s, one.x, one.y) = (vec![table.time_s[row]], vec![table.x[row]], vec![table.y[row]]);
    let at = |column: &Vec<f64>| vec![column[row]];
    one.velocity = table.velocity.as_ref().map(|velocity| velocity.each_ref().map(at));
    one.speed = table.speed.as_ref().map(at);
    one.heading = table.heading.as_ref().map(at);
    one.lane = table.lane.as_ref().map(|lane| vec![lane[row]]);
    one
}

/// A table without its rows and their memory: what it says of vehicles and of what is left out.
pub(super) fn without_rows(mut table: TrackTable) -> TrackTable {
    table.vehicle = Vec::new();
    let given = table.velocity.iter_mut().flatten().chain(&mut table.speed).chain(&mut table.heading);
    for column in [&mut table.time_s, &mut table.x, &mut table.y].into_iter().chain(given) {
        *column = Vec::new();
    }
    table.lane = table.lane.map(|_| Vec::new());
    if let RowPlaces::Numbers { numbers, .. } = &mut table.places {
        *numbers = Vec::new();
    }
    table
}

/// Adds what another table says of a vehicle where this one says nothing.
pub(super) fn complete(vehicle: &mut TableVehicle, other: &TableVehicle) {
    vehicle.class = vehicle.class.or(other.class);
    vehicle.length = vehicle.length.or(other.length);
    vehicle.width = vehicle.width.or(other.width);
    if vehicle.left_out.is_none() {
        vehicle.left_out.clone_from(&other.left_out);
    }
}

/// The rows of a temporary file.
pub(super) fn rows(bytes: &[u8], file: &std::path::Path) -> Result<Vec<Row>, DataError> {
    let rows = bytes.chunks(Row::BYTES).map(Row::read).collect::<Option<Vec<Row>>>();
    rows.ok_or_else(|| {
        let source = std::io::Error::new(std::io::ErrorKind::UnexpectedEof, "a temporary file is cut off");
        DataError::Io { file: file.into(), source }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_read_as_it_was_written() {
        let row = Row { vehicle: 7, lane: -2, time_s: 0.1, values: [1., -2.5, f64::INFINITY, 0., 3., 1e-9], place: 99 };
        let mut bytes = Vec::new();
        row.write(&mut bytes);
        assert_eq!((bytes.len(), Row::read(&bytes)), (Row::BYTES, Some(row)));
        assert_eq!(Row::read(&bytes[1..]), None);
        assert!(rows(&[bytes.clone(), bytes[..9].to_vec()].concat(), "x".as_ref()).is_err());
    }
}
