//! Floating car data as Parquet, with the columns of the table of text.

use std::path::Path;

use super::csv::{COLUMNS, places};
use super::vehicle::{Other, Vehicle};
use super::xml::time;
use crate::error::DataError;
use crate::formats::parquet_columns::{Cells, ParquetColumn, ParquetTable};

/// Where the columns are.
pub(super) struct Layout {
    places: [Option<usize>; COLUMNS.len()],
}

/// The layout of a Parquet file of floating car data; `None` for any other.
pub(super) fn recognise(file: &Path) -> Result<Option<Layout>, DataError> {
    Ok(places(file, ParquetTable::open(file)?.names())?.map(|places| Layout { places }))
}

/// Hands every vehicle to `take`, in the order of the file, until that says that it has seen enough.
///
/// # Errors
/// When the file cannot be read, or a row lacks a number; what `take` returns.
pub(super) fn vehicles(
    file: &Path,
    layout: &Layout,
    other: &mut Other,
    take: &mut dyn FnMut(&Vehicle<'_>) -> Result<bool, DataError>,
) -> Result<(), DataError> {
    let table = ParquetTable::open(file)?;
    let wanted: Vec<(usize, usize)> =
        layout.places.iter().enumerate().filter_map(|(column, place)| Some((column, (*place)?))).collect();
    let mut clock_times = false;
    let mut columns: Vec<ParquetColumn> = Vec::with_capacity(wanted.len());
    for (column, place) in &wanted {
        columns.push(match column {
            1 | 6 | 7 => table.text(*place)?,
            // SUMO writes clock times as text.
            0 => match table.number(*place) {
                Ok(number) => number,
                Err(_) => {
                    clock_times = true;
                    table.text(*place)?
                }
            },
            _ => table.number(*place)?,
        });
    }
    let mut first = 0;
    for group in 0..table.groups() {
        let mut cells: [Option<Cells>; COLUMNS.len()] = Default::default();
        for ((column, _), values) in wanted.iter().zip(table.read(group, &columns)?) {
            cells[*column] = Some(values);
        }
        let mut next = cells.into_iter();
        let mut cell = || next.next().flatten();
        let times = cell().unwrap_or(Cells::Number(Vec::new()));
        let ids = cell().map(Cells::text).unwrap_or_default();
        let [x, y, angle, speed] = [cell(), cell(), cell(), cell()].map(|cells| cells.map(Cells::number));
        let words = [cell(), cell()].map(|cells| cells.map(Cells::text));
        let times: Vec<f64> = match times {
            Cells::Text(words) if clock_times => words.iter().map(|word| time(word).unwrap_or(f64::NAN)).collect(),
            other => other.number(),
        };
        let ids: Vec<&str> = ids.iter().collect();
        let texts = words.each_ref().map(|words| words.as_ref().map(|words| words.iter().collect::<Vec<&str>>()));
        for (row, id) in ids.iter().enumerate() {
            if id.is_empty() {
                other.persons += 1;
                continue;
            }
            let place = first + row as u64;
            let real = |column: usize, values: &Option<Vec<f64>>| {
                let value = values.as_ref().and_then(|values| values.get(row)).copied().unwrap_or(f64::NAN);
                if value.is_finite() { Ok(value) } else { Err(missing(file, place, column)) }
            };
            let word =
                |column: usize| texts[column].as_ref().and_then(|words| words.get(row)).copied().unwrap_or_default();
            let time_s = times.get(row).copied().filter(|time| time.is_finite());
            let go_on = take(&Vehicle {
                place,
                time_s: time_s.ok_or_else(|| missing(file, place, 0))?,
                id,
                front: [real(2, &x)?, real(3, &y)?],
                angle: real(4, &angle)?,
                speed: speed.as_ref().and_then(|speed| speed.get(row)).copied().filter(|speed| speed.is_finite()),
                kind: word(0),
                lane: word(1),
            })?;
            if !go_on {
                return Ok(());
            }
        }
        first += ids.len() as u64;
    }
    Ok(())
}

fn missing(file: &Path, row: u64, column: usize) -> DataError {
    DataError::Table { file: file.into(), reason: format!("row {row} has no number in column `{}`", COLUMNS[column].0) }
}
