//! Plain tracks: a table of text or a Parquet file with a row a vehicle and moment.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::Path;

use super::columns::{Cells, write_columns};
use super::{Written, atomically, to_file};
use crate::error::DataError;
use crate::recording::VehicleClass;
use crate::track_table::{TableVehicle, TrackTable};

/// Writes tracks as Parquet where the name of the file says so, else as a table of text with commas.
///
/// # Errors
/// When the file cannot be written.
pub(crate) fn write(table: &TrackTable, to: &Path) -> Result<Written, DataError> {
    let columns = Columns::of(table);
    let (rows, vehicles) = (table.len() as u64, table.vehicles.len() as u64);
    let mut written = Written { files: vec![to.to_owned()], rows, vehicles, ..Written::default() };
    if to.extension().is_some_and(|end| end.eq_ignore_ascii_case("parquet")) {
        atomically(to, |file| write_columns(file, table.len(), &columns.cells()))?;
    } else {
        let (names, changed) = names(table)?;
        to_file(to, |out| columns.text(out, &names))?;
        written.lose("commas and quotes in names of vehicles become blanks", changed);
    }
    if table.simulated {
        written.lose(SIMULATED, 1);
    }
    Ok(written)
}

/// Names as a table of text holds them, where commas part fields, and how many are others than in the tracks.
fn names(table: &TrackTable) -> Result<(Vec<String>, usize), DataError> {
    let part = |c: char| if c == ',' || c == '"' || c.is_control() { ' ' } else { c };
    let names: Vec<String> = table.vehicles.iter().map(|it| it.name.chars().map(part).collect()).collect();
    let changed = names.iter().zip(&table.vehicles).filter(|(name, it)| **name != it.name).count();
    let different: BTreeSet<&str> = names.iter().map(|name| name.trim()).collect();
    if different.len() < names.len() {
        return Err(DataError::Unwritable {
            recording: table.name.clone(),
            layout: "plain tracks in a table of text".to_owned(),
            reason: "names of vehicles differ by commas, quotes or blanks alone; write Parquet instead".to_owned(),
        });
    }
    Ok((names, changed))
}

/// What is lost where no file can say that it was simulated.
pub(crate) const SIMULATED: &str =
    "that the traffic is simulated is not in the layout: a file named SIMULATED beside it says so";

/// What the table says of its rows.
struct Columns<'a> {
    table: &'a TrackTable,
    /// Ids, where all of them are whole numbers.
    numbers: Option<Vec<i64>>,
    lane: Option<&'a [i16]>,
    speed: Option<&'a [f64]>,
    heading: Option<&'a [f64]>,
    velocity: Option<[&'a [f64]; 2]>,
    sized: bool,
    classed: bool,
}

impl<'a> Columns<'a> {
    fn of(table: &'a TrackTable) -> Self {
        let number = |name: &str| name.parse::<u32>().ok().filter(|number| number.to_string() == name).map(i64::from);
        let numbers: Option<Vec<i64>> = table.vehicles.iter().map(|it| number(&it.name)).collect();
        // A column that is not known throughout is no column that a reader can use.
        let whole = |column: &'a Option<Vec<f64>>| {
            column.as_deref().filter(|column| column.iter().all(|value| value.is_finite()))
        };
        let finite = |[vx, vy]: &&'a [Vec<f64>; 2]| vx.iter().chain(vy).all(|value| value.is_finite());
        let velocity = table.velocity.as_ref().filter(finite).map(|[vx, vy]| [vx.as_slice(), vy.as_slice()]);
        Self {
            table,
            numbers,
            lane: table.lane.as_deref(),
            speed: whole(&table.speed).filter(|_| velocity.is_none()),
            heading: whole(&table.heading),
            velocity,
            sized: table.vehicles.iter().all(|it| it.length.is_some() && it.width.is_some()),
            classed: table.vehicles.iter().all(|it| it.class.is_some()),
        }
    }

    fn vehicle(&self, row: usize) -> &'a TableVehicle {
        &self.table.vehicles[self.table.vehicle[row] as usize]
    }

    fn class(&self, row: usize) -> &'static str {
        match self.vehicle(row).class {
            Some(VehicleClass::Truck) => "truck",
            Some(VehicleClass::Motorcycle) => "motorcycle",
            _ => "car",
        }
    }

    /// The columns with their names.
    fn cells(&self) -> Vec<(&'static str, Cells<'_>)> {
        fn real<'b>(of: impl Fn(usize) -> f64 + 'b) -> Cells<'b> {
            Cells::Real(Box::new(of))
        }
        let table = self.table;
        let id = match &self.numbers {
            Some(numbers) => Cells::Whole(Box::new(|row| numbers[table.vehicle[row] as usize])),
            None => Cells::Text(Box::new(|row| self.vehicle(row).name.as_str())),
        };
        let mut cells = vec![
            ("id", id),
            ("time", real(|row| table.time_s[row])),
            ("x", real(|row| table.x[row])),
            ("y", real(|row| table.y[row])),
        ];
        if let Some([vx, vy]) = self.velocity {
            cells.extend([("vx", real(move |row| vx[row])), ("vy", real(move |row| vy[row]))]);
        }
        if let Some(speed) = self.speed {
            cells.push(("speed", real(move |row| speed[row])));
        }
        if let Some(heading) = self.heading {
            cells.push(("heading", real(move |row| heading[row])));
        }
        if self.sized {
            let size = |of: Option<f32>| f64::from(of.unwrap_or(f32::NAN));
            cells.push(("length", real(move |row| size(self.vehicle(row).length))));
            cells.push(("width", real(move |row| size(self.vehicle(row).width))));
        }
        if let Some(lane) = self.lane {
            cells.push(("lane", Cells::Whole(Box::new(move |row| lane[row].max(0).into()))));
        }
        if self.classed {
            cells.push(("class", Cells::Text(Box::new(|row| self.class(row)))));
        }
        cells
    }

    fn text(&self, out: &mut dyn Write, names: &[String]) -> io::Result<()> {
        let cells = self.cells();
        writeln!(out, "{}", cells.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(","))?;
        for row in 0..self.table.len() {
            for (place, (name, cells)) in cells.iter().enumerate() {
                if place > 0 {
                    write!(out, ",")?;
                }
                match cells {
                    Cells::Flag(of) => write!(out, "{}", of(row))?,
                    Cells::Whole(of) => write!(out, "{}", of(row))?,
                    Cells::Real(of) => write!(out, "{}", rounded(of(row), name))?,
                    Cells::Text(_) if *name == "id" => {
                        write!(out, "{}", names[self.table.vehicle[row] as usize])?;
                    }
                    Cells::Text(of) => write!(out, "{}", of(row))?,
                }
            }
            writeln!(out)?;
        }
        Ok(())
    }
}

/// Lengths to the millimetre, times to the microsecond, directions to 1e-5 rad, as short as that is.
fn rounded(value: f64, column: &str) -> f64 {
    let digits = match column {
        "time" => 1e6,
        "heading" => 1e5,
        _ => 1e3,
    };
    let near = (value * digits).round() / digits;
    // No minus before zero.
    if near == 0. { 0. } else { near }
}
