//! Columns of a Parquet file by name, whatever their order and width.

use std::collections::BTreeMap;
use std::ops::Range;

use parquet::basic::{ConvertedType, Type as PhysicalType};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::errors::ParquetError;
use parquet::file::reader::RowGroupReader;
use parquet::schema::types::{ColumnDescriptor, SchemaDescriptor};

use super::{Detail, Failure, within};
use crate::error::PredictionProblem;
use crate::predictions::schema::{EXPLAINING, prediction_columns};

/// Where the columns of a prediction file stand.
pub(super) struct Columns {
    /// Name in our schema, index in the file, whether 32-bit numbers are unsigned.
    found: Vec<(&'static str, usize, bool)>,
    /// Indices of all explaining columns, or none.
    explaining: Vec<usize>,
}

/// What a column must hold.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Text,
    Whole,
    Number,
}

/// Our columns, and whether a file must have them.
const KNOWN: [(&str, Kind, bool); 11] = [
    ("scene", Kind::Text, true),
    ("vehicle", Kind::Whole, true),
    ("segment", Kind::Whole, false),
    ("t0", Kind::Whole, true),
    ("mode", Kind::Whole, true),
    ("probability", Kind::Number, true),
    ("step", Kind::Whole, true),
    ("x", Kind::Number, true),
    ("y", Kind::Number, true),
    ("origin_x", Kind::Number, false),
    ("origin_y", Kind::Number, false),
];

impl Columns {
    pub(super) fn find(schema: &SchemaDescriptor, detail: Detail) -> Result<Self, PredictionProblem> {
        let by_name: BTreeMap<String, usize> =
            schema.columns().iter().enumerate().map(|(i, column)| (column.path().string(), i)).collect();
        let mut found = Vec::new();
        for (name, kind, required) in KNOWN {
            let also = if name == "scene" { "recording" } else { name };
            let Some(index) = by_name.get(name).or_else(|| by_name.get(also)).copied() else {
                if required {
                    return Err(PredictionProblem::MissingColumn { column: name });
                }
                continue;
            };
            let column = schema.column(index);
            check_type(&column, kind)?;
            found.push((name, index, column.converted_type() == ConvertedType::UINT_32));
        }
        let explaining = if detail == Detail::Explanations { explaining(schema, &by_name)? } else { Vec::new() };
        Ok(Self { found, explaining })
    }

    /// All rows of a row group, whose first one is row `start` of the file.
    pub(super) fn read(&self, group: &dyn RowGroupReader, start: u64) -> Result<GroupRows, Failure> {
        let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        let mut read = GroupRows { start, rows, ..GroupRows::default() };
        for (name, index, unsigned) in &self.found {
            match group.get_column_reader(*index)? {
                ColumnReader::ByteArrayColumnReader(reader) => read.scenes = cells(reader, rows)?,
                ColumnReader::Int32ColumnReader(reader) => {
                    let widen = |value: i32| if *unsigned { i64::from(value as u32) } else { i64::from(value) };
                    let values = cells(reader, rows)?.into_iter().map(|value| value.map(widen));
                    read.whole.insert(name, values.collect());
                }
                ColumnReader::Int64ColumnReader(reader) => {
                    read.whole.insert(name, cells(reader, rows)?);
                }
                other => {
                    read.number.insert(name, numbers(other, rows)?);
                }
            }
        }
        for index in &self.explaining {
            read.explaining.push(numbers(group.get_column_reader(*index)?, rows)?);
        }
        Ok(read)
    }
}

/// Indices of the explaining columns; none unless all are there.
fn explaining(schema: &SchemaDescriptor, by_name: &BTreeMap<String, usize>) -> Result<Vec<usize>, PredictionProblem> {
    let all = prediction_columns();
    let names = all[all.len() - EXPLAINING..].iter().map(|column| by_name.get(&column.name).copied());
    let Some(indices) = names.collect::<Option<Vec<usize>>>() else { return Ok(Vec::new()) };
    for index in &indices {
        check_type(&schema.column(*index), Kind::Number)?;
    }
    Ok(indices)
}

fn check_type(column: &ColumnDescriptor, kind: Kind) -> Result<(), PredictionProblem> {
    let (needs, fits): (_, &[PhysicalType]) = match kind {
        Kind::Text => ("text", &[PhysicalType::BYTE_ARRAY]),
        Kind::Whole => ("whole numbers of 32 or 64 bits", &[PhysicalType::INT32, PhysicalType::INT64]),
        Kind::Number => ("numbers of single or double precision", &[PhysicalType::FLOAT, PhysicalType::DOUBLE]),
    };
    let physical = column.physical_type();
    if fits.contains(&physical) && column.max_rep_level() == 0 {
        return Ok(());
    }
    let nested = if column.max_rep_level() > 0 { "lists of " } else { "" };
    Err(PredictionProblem::ColumnType { column: column.path().string(), needs, found: format!("{nested}{physical}") })
}

/// The rows of a row group, `None` where a cell is null.
#[derive(Default)]
pub(super) struct GroupRows {
    start: u64,
    rows: usize,
    scenes: Vec<Option<ByteArray>>,
    whole: BTreeMap<&'static str, Vec<Option<i64>>>,
    number: BTreeMap<&'static str, Vec<Option<f32>>>,
    /// `[columns, rows]`.
    explaining: Vec<Vec<Option<f32>>>,
}

impl GroupRows {
    pub(super) fn len(&self) -> usize {
        self.rows
    }

    /// Row `i` as a row of the file.
    pub(super) fn row(&self, i: usize) -> u64 {
        self.start + i as u64
    }

    pub(super) fn scene(&self, i: usize) -> Result<&str, PredictionProblem> {
        let cell = self.scenes.get(i).and_then(Option::as_ref);
        let cell = cell.ok_or_else(|| self.bad(i, "scene", "is null".to_owned()))?;
        std::str::from_utf8(cell.data()).map_err(|error| self.bad(i, "scene", error.to_string()))
    }

    /// A whole number within `range`.
    pub(super) fn whole(&self, i: usize, column: &'static str, range: Range<i64>) -> Result<i64, PredictionProblem> {
        let cell = self.whole.get(column).and_then(|cells| cells.get(i).copied().flatten());
        let value = cell.ok_or_else(|| self.bad(i, column, "is null".to_owned()))?;
        within(value, &range).map_err(|problem| self.bad(i, column, problem))
    }

    /// A finite number.
    pub(super) fn number(&self, i: usize, column: &'static str) -> Result<f32, PredictionProblem> {
        match self.number.get(column).and_then(|cells| cells.get(i).copied().flatten()) {
            None => Err(self.bad(i, column, "is null".to_owned())),
            Some(value) if !value.is_finite() => Err(self.bad(i, column, format!("is {value}, not finite"))),
            Some(value) => Ok(value),
        }
    }

    /// 0 where the file has no segments.
    pub(super) fn segment(&self, i: usize) -> Result<u16, PredictionProblem> {
        if !self.whole.contains_key("segment") {
            return Ok(0);
        }
        self.whole(i, "segment", 0..1 << 16).map(|segment| segment as u16)
    }

    pub(super) fn origin(&self, i: usize) -> Option<[f32; 2]> {
        let of = |column| self.number.get(column)?.get(i).copied().flatten();
        Some([of("origin_x")?, of("origin_y")?])
    }

    /// The explaining numbers of a row, where it has them all.
    pub(super) fn explanation(&self, i: usize) -> Option<[f32; EXPLAINING]> {
        let mut values = [0.; EXPLAINING];
        if self.explaining.len() != EXPLAINING {
            return None;
        }
        for (value, cells) in values.iter_mut().zip(&self.explaining) {
            *value = cells.get(i).copied().flatten()?;
        }
        Some(values)
    }

    fn bad(&self, i: usize, column: &str, problem: String) -> PredictionProblem {
        PredictionProblem::Cell { row: self.row(i), column: column.to_owned(), problem }
    }
}

/// A column of floating-point numbers, in single precision.
fn numbers(reader: ColumnReader, rows: usize) -> Result<Vec<Option<f32>>, ParquetError> {
    match reader {
        ColumnReader::FloatColumnReader(reader) => cells(reader, rows),
        ColumnReader::DoubleColumnReader(reader) => {
            Ok(cells(reader, rows)?.into_iter().map(|value| value.map(|value| value as f32)).collect())
        }
        _ => Err(ParquetError::General("a column changes its type between row groups".to_owned())),
    }
}

/// All cells of a column.
fn cells<D: DataType>(mut reader: ColumnReaderImpl<D>, rows: usize) -> Result<Vec<Option<D::T>>, ParquetError> {
    let (mut values, mut levels) = (Vec::new(), Vec::new());
    let (read, ..) = reader.read_records(rows, Some(&mut levels), None, &mut values)?;
    if read != rows {
        return Err(ParquetError::EOF(format!("a column has {read} rows of {rows}")));
    }
    if levels.is_empty() {
        return Ok(values.into_iter().map(Some).collect());
    }
    // A column that is not nested has level 1 where there is a value and 0 where there is none.
    let mut values = values.into_iter();
    Ok(levels.iter().map(|level| if *level == 1 { values.next() } else { None }).collect())
}
