//! The rows of plain tracks, a block of a text or a group of rows of Parquet at a time.

use std::ops::ControlFlow;
use std::path::Path;

use super::Plain;
use super::columns::{Field, Found, names};
use crate::error::{DataError, TrackProblem};
use crate::format::{Format as _, Source};
use crate::formats::parquet_columns::{ParquetTable, is_parquet};
use crate::formats::table::sniff::Head;
use crate::formats::table::{Kind, Table, Wanted};
use crate::formats::words::Words;
use crate::track_table::{RowPlaces, TableVehicle, TrackTable};

/// A column of a block.
enum Values {
    Numbers(Vec<f64>),
    Words(Words),
}

/// Hands the rows of a source to `take`, in the order of the file, in parts that fit into memory, until it breaks.
///
/// # Errors
/// As [`Table::read_blocks`] and [`ParquetTable::read`]; what `take` returns.
pub(super) fn read(
    source: &Source,
    take: &mut dyn FnMut(TrackTable) -> Result<ControlFlow<()>, DataError>,
) -> Result<(), DataError> {
    let file = source.file()?;
    let other = || DataError::NoRecordings {
        folder: file.into(),
        expected: Plain.files().to_owned(),
        seen: "a table or text of another kind".to_owned(),
    };
    let mut first = 0;
    if is_parquet(file)? {
        let table = ParquetTable::open(file)?;
        let found = Found::among(file, table.names())?.ok_or_else(other)?;
        let mut wanted = found.wanted();
        let column = |(field, place): &(Field, usize)| match field {
            Field::Id | Field::Class => table.text(*place),
            _ => table.number(*place),
        };
        let columns = wanted.iter().map(column).collect::<Result<Vec<_>, _>>()?;
        for ((field, _), column) in wanted.iter_mut().zip(&columns) {
            if *field == Field::TimeMs && column.has_time_unit() {
                *field = Field::Time;
            }
        }
        for group in 0..table.groups() {
            let cells = table.read(group, &columns)?;
            let fields = wanted.iter().zip(cells).map(|((field, _), cells)| match field {
                Field::Id | Field::Class => (*field, Values::Words(cells.text())),
                _ => (*field, Values::Numbers(cells.number())),
            });
            let place = RowPlaces::Rows { file: file.into(), first };
            let part = part(source, &found, place, fields)?;
            first += part.len() as u64;
            if take(part)?.is_break() {
                break;
            }
        }
        return Ok(());
    }
    let (table, found) = text(file)?.ok_or_else(other)?;
    let wanted = found.wanted();
    let column = |(field, index): &(Field, usize)| {
        let kind = match field {
            Field::Id => Kind::Name,
            Field::Class => Kind::Label,
            Field::Time | Field::TimeMs | Field::X | Field::Y => Kind::Double,
            _ => Kind::Sparse,
        };
        Wanted { index: *index, kind }
    };
    let columns: Vec<Wanted> = wanted.iter().map(column).collect();
    table.read_blocks(&columns, &mut |values| {
        let fields = wanted.iter().zip(values).map(|((field, _), values)| match field {
            Field::Id | Field::Class => (*field, Values::Words(values.names())),
            _ => (*field, Values::Numbers(values.double())),
        });
        let place = RowPlaces::Lines { file: file.into(), first };
        let part = part(source, &found, place, fields)?;
        first += part.len() as u64;
        take(part)
    })
}

/// A table of text and its columns; `None` for any other.
fn text(file: &Path) -> Result<Option<(Table, Found)>, DataError> {
    let Some(head) = Head::read(file)? else { return Ok(None) };
    let (header, _) = head.header(&names());
    let found = Found::among(file, &header.names)?;
    Ok(found.map(|found| (Table::new(file, header), found)))
}

/// A part of the table from its columns.
fn part(
    source: &Source,
    found: &Found,
    places: RowPlaces,
    fields: impl Iterator<Item = (Field, Values)>,
) -> Result<TrackTable, DataError> {
    let site = source.site.clone().unwrap_or_else(|| source.dataset.to_string());
    let mut table = TrackTable::new(source.dataset, site, &source.name);
    table.simulated = source.simulated;
    table.notes.clone_from(&source.notes);
    table.places = places;
    table.columns = found.called.clone();
    let (mut vx, mut vy, mut length, mut width, mut lane, mut class) = (None, None, None, None, None, None);
    for (field, values) in fields {
        match (field, values) {
            (Field::Id, Values::Words(words)) => {
                table.vehicles = words.list.into_iter().map(TableVehicle::named).collect();
                table.vehicle = words.codes;
            }
            (Field::Class, Values::Words(words)) => class = Some(words),
            (Field::Time, Values::Numbers(values)) => table.time_s = values,
            (Field::TimeMs, Values::Numbers(values)) => table.time_s = values.into_iter().map(|ms| ms / 1e3).collect(),
            (Field::X, Values::Numbers(values)) => table.x = values,
            (Field::Y, Values::Numbers(values)) => table.y = values,
            (Field::Heading, Values::Numbers(values)) => table.heading = Some(values),
            (Field::HeadingDegrees, Values::Numbers(values)) => {
                table.heading = Some(values.into_iter().map(f64::to_radians).collect());
            }
            (Field::Speed, Values::Numbers(values)) => table.speed = Some(values),
            (Field::Vx, Values::Numbers(values)) => vx = Some(values),
            (Field::Vy, Values::Numbers(values)) => vy = Some(values),
            (Field::Length, Values::Numbers(values)) => length = Some(values),
            (Field::Width, Values::Numbers(values)) => width = Some(values),
            (Field::Lane, Values::Numbers(values)) => lane = Some(values),
            _ => {}
        }
    }
    table.velocity = vx.zip(vy).map(|(vx, vy)| [vx, vy]);
    if let Some(index) = table.vehicles.iter().position(|vehicle| vehicle.name.trim().is_empty()) {
        let row = table.vehicle.iter().position(|vehicle| *vehicle as usize == index);
        let what = "the row has no id".to_owned();
        return Err(table.wrong(TrackProblem::Value, row, Some("id"), what, "fill it in or remove the row"));
    }
    if let Some(values) = lane {
        let known = |value: &f64| value.is_nan() || (value.fract() == 0. && value.abs() <= f64::from(i16::MAX));
        if let Some(row) = values.iter().position(|value| !known(value)) {
            let what = format!("{} is no lane number", values[row]);
            let remedy = "write whole numbers, 0 where the lane is unknown";
            return Err(table.wrong(TrackProblem::Value, Some(row), Some("lane"), what, remedy));
        }
        table.lane = Some(values.into_iter().map(|value| if value.is_nan() { 0 } else { value as i16 }).collect());
    }
    let words: Option<Vec<&str>> = class.as_ref().map(|class| class.iter().collect());
    table.set_bodies(length.as_deref(), width.as_deref(), words.as_deref());
    Ok(table)
}
