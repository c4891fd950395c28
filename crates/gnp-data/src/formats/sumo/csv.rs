//! Floating car data as a table of text, as SUMO and its xml2csv write it.

use std::path::Path;

use super::vehicle::{Other, Vehicle};
use super::xml::{number, time};
use crate::error::DataError;
use crate::formats::table::gzip::Blocks;
use crate::formats::table::sniff::{Head, Separator, split};

/// Columns that are read, under their names with and without the name of the element.
pub(super) const COLUMNS: [(&str, &str); 8] = [
    ("timestep_time", "time"),
    ("vehicle_id", "id"),
    ("vehicle_x", "x"),
    ("vehicle_y", "y"),
    ("vehicle_angle", "angle"),
    ("vehicle_speed", "speed"),
    ("vehicle_type", "type"),
    ("vehicle_lane", "lane"),
];

/// Columns without which nothing can be made of a row: the first five.
const NEEDED: usize = 5;

/// Where the columns are, and how many fields a line has.
pub(super) struct Layout {
    places: [Option<usize>; COLUMNS.len()],
    fields: usize,
    separator: Separator,
}

/// The places of the columns among `names`; `None` where these are of another table.
///
/// # Errors
/// When all but one of the columns that are needed are there.
pub(super) fn places(file: &Path, names: &[String]) -> Result<Option<[Option<usize>; COLUMNS.len()]>, DataError> {
    let named = |name: &str| names.iter().position(|have| have.eq_ignore_ascii_case(name));
    let places = COLUMNS.map(|(tagged, plain)| named(tagged).or_else(|| named(plain)));
    let tagged = COLUMNS[..3].iter().all(|(tagged, _)| named(tagged).is_some());
    // Without the names of elements only all of SUMO's columns together tell its table from anybody's.
    let plain = places.iter().all(Option::is_some) && named("slope").or_else(|| named("pos")).is_some();
    if !tagged && !plain {
        return Ok(None);
    }
    match places[..NEEDED].iter().position(Option::is_none) {
        None => Ok(Some(places)),
        Some(missing) => Err(DataError::MissingColumn {
            file: file.into(),
            column: COLUMNS[missing].0.to_owned(),
            found: gnp_file::excerpt(&names.join(", "), 400),
        }),
    }
}

/// The layout of a table of floating car data; `None` for any other file.
pub(super) fn recognise(file: &Path, head: &Head) -> Result<Option<Layout>, DataError> {
    let known: Vec<&str> = COLUMNS.iter().flat_map(|(tagged, plain)| [*tagged, *plain]).collect();
    let (header, _) = head.header(&known);
    let places = places(file, &header.names)?;
    Ok(places.map(|places| Layout { places, fields: header.names.len(), separator: header.separator }))
}

/// Hands every vehicle to `take`, in the order of the file, until that says that it has seen enough.
///
/// # Errors
/// When the file cannot be read or a line is no row of it; what `take` returns.
pub(super) fn vehicles(
    file: &Path,
    layout: &Layout,
    other: &mut Other,
    take: &mut dyn FnMut(&Vehicle<'_>) -> Result<bool, DataError>,
) -> Result<(), DataError> {
    let (mut blocks, mut header) = (Blocks::open(file)?, true);
    while let Some(block) = blocks.next()? {
        for (number, bytes) in (block.line..).zip(block.bytes.split(|byte| *byte == b'\n')) {
            if bytes.trim_ascii().is_empty() || std::mem::take(&mut header) {
                continue;
            }
            let line = Line { file, number, layout };
            let text = std::str::from_utf8(bytes).map_err(|_| line.broken("is not in UTF-8"))?;
            if !line.read(text, other, take)? {
                return Ok(());
            }
        }
    }
    Ok(())
}

/// A line of a table.
struct Line<'a> {
    file: &'a Path,
    number: u64,
    layout: &'a Layout,
}

impl Line<'_> {
    fn read(
        &self,
        text: &str,
        other: &mut Other,
        take: &mut dyn FnMut(&Vehicle<'_>) -> Result<bool, DataError>,
    ) -> Result<bool, DataError> {
        let (mut values, mut found) = ([""; COLUMNS.len()], 0);
        for (place, field) in split(text, self.layout.separator).enumerate() {
            if let Some(column) = self.layout.places.iter().position(|at| *at == Some(place)) {
                values[column] = field;
            }
            found = place + 1;
        }
        if found != self.layout.fields {
            let (file, line, expected) = (self.file.into(), self.number, self.layout.fields);
            return Err(DataError::FieldCount { file, line, found, expected });
        }
        let [now, id, x, y, angle, speed, kind, lane] = values;
        if id.is_empty() {
            // A time step without vehicles, or a person in it.
            other.persons +=
                u64::from(split(text, self.layout.separator).filter(|field| !field.is_empty()).count() > 1);
            return Ok(true);
        }
        let real = |column: usize, text: &str| {
            number(text).ok_or_else(|| self.bad(column, text, "is not a number; repair it or write the file anew"))
        };
        take(&Vehicle {
            place: self.number,
            time_s: time(now).ok_or_else(|| self.bad(0, now, "is not a time; write the file anew"))?,
            id,
            front: [real(2, x)?, real(3, y)?],
            angle: real(4, angle)?,
            speed: if speed.is_empty() { None } else { Some(real(5, speed)?) },
            kind,
            lane,
        })
    }

    fn bad(&self, column: usize, value: &str, reason: &str) -> DataError {
        DataError::Value {
            file: self.file.into(),
            line: self.number,
            column: COLUMNS[column].0.to_owned(),
            value: gnp_file::excerpt(value, 40),
            reason: reason.to_owned(),
        }
    }

    fn broken(&self, reason: &str) -> DataError {
        DataError::Table { file: self.file.into(), reason: format!("line {} {reason}", self.number) }
    }
}
