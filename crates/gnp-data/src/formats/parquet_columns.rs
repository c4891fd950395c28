//! Columns of a Parquet file by name, a group of rows at a time.

use std::fs::File;
use std::io::Read as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type as PhysicalType};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;

use super::words::Words;
use crate::discover::only_a_file;
use crate::error::{DataError, TrackProblem};

/// Most rows that a byte of a file may stand for: constant columns take next to nothing, positions do not.
const MAX_RATIO: u64 = 64;

/// Columns that a message lists, and characters of their names.
const LISTED: usize = 400;

/// A Parquet file whose columns can be read.
pub(in crate::formats) struct ParquetTable {
    file: PathBuf,
    reader: SerializedFileReader<File>,
    /// Names of the columns, nested ones with points.
    names: Vec<String>,
}

/// A column that is wanted.
#[derive(Clone, Copy, Debug)]
pub(in crate::formats) struct ParquetColumn {
    index: usize,
    kind: Kind,
}

impl ParquetColumn {
    /// Whether its values are times with a unit, which come in s.
    pub(in crate::formats) fn has_time_unit(self) -> bool {
        matches!(self.kind, Kind::Number(divisor) if divisor > 1.)
    }
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Numbers, which are divided by so much.
    Number(f64),
    Text,
}

/// The values of a column in a group of rows.
#[derive(Clone, Debug)]
pub(in crate::formats) enum Cells {
    /// NaN where there is none.
    Number(Vec<f64>),
    /// Empty where there is none; numbers as they are written.
    Text(Words),
}

impl Cells {
    pub(in crate::formats) fn number(self) -> Vec<f64> {
        if let Self::Number(values) = self { values } else { Vec::new() }
    }

    pub(in crate::formats) fn text(self) -> Words {
        if let Self::Text(words) = self { words } else { Words::default() }
    }
}

/// Whether a file begins as Parquet does.
pub(in crate::formats) fn is_parquet(file: &Path) -> Result<bool, DataError> {
    only_a_file(file)?;
    let mut magic = Vec::with_capacity(4);
    let read = File::open(file).and_then(|file| file.take(4).read_to_end(&mut magic));
    read.map_err(|source| DataError::Io { file: file.into(), source })?;
    Ok(magic == b"PAR1")
}

impl ParquetTable {
    pub(in crate::formats) fn open(file: &Path) -> Result<Self, DataError> {
        only_a_file(file)?;
        let io = |source| DataError::Io { file: file.into(), source };
        let opened = File::open(file).map_err(io)?;
        let bytes = opened.metadata().map_err(io)?.len();
        let reader = guarded(|| SerializedFileReader::new(opened)).map_err(|reason| broken(file, &reason))?;
        let schema = reader.metadata().file_metadata().schema_descr();
        let names = schema.columns().iter().map(|column| column.path().string()).collect();
        let mut rows = 0u64;
        for group in reader.metadata().row_groups() {
            rows = rows.saturating_add(u64::try_from(group.num_rows()).unwrap_or(u64::MAX));
            let placed = group.columns().iter().all(|column| {
                column.dictionary_page_offset().unwrap_or(column.data_page_offset()) >= 0
                    && column.compressed_size() >= 0
            });
            if !placed {
                return Err(broken(file, "a column has no place in the file"));
            }
        }
        if rows > bytes.saturating_mul(MAX_RATIO) || rows >= u64::from(u32::MAX) {
            return Err(broken(file, &format!("{rows} rows in {bytes} bytes")));
        }
        Ok(Self { file: file.into(), reader, names })
    }

    /// Names of the columns.
    pub(in crate::formats) fn names(&self) -> &[String] {
        &self.names
    }

    /// Place of the column that has this name, in upper or lower case.
    pub(in crate::formats) fn place(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|have| have.eq_ignore_ascii_case(name))
    }

    /// The column of numbers at a place; times with a unit come in s.
    pub(in crate::formats) fn number(&self, index: usize) -> Result<ParquetColumn, DataError> {
        let column = self.column(index);
        let fits = matches!(
            column.physical_type(),
            PhysicalType::BOOLEAN
                | PhysicalType::INT32
                | PhysicalType::INT64
                | PhysicalType::FLOAT
                | PhysicalType::DOUBLE
        );
        match divisor(&column).filter(|_| fits && column.max_rep_level() == 0) {
            Some(divisor) => Ok(ParquetColumn { index, kind: Kind::Number(divisor) }),
            None => Err(self.wrong_type(index, "numbers: integers, or single or double precision")),
        }
    }

    /// The column of words at a place; whole numbers count as words.
    pub(in crate::formats) fn text(&self, index: usize) -> Result<ParquetColumn, DataError> {
        let column = self.column(index);
        let fits = matches!(
            column.physical_type(),
            PhysicalType::BYTE_ARRAY
                | PhysicalType::INT32
                | PhysicalType::INT64
                | PhysicalType::FLOAT
                | PhysicalType::DOUBLE
        );
        if !fits || column.max_rep_level() > 0 || divisor(&column) != Some(1.) {
            return Err(self.wrong_type(index, "text or whole numbers"));
        }
        Ok(ParquetColumn { index, kind: Kind::Text })
    }

    /// The column of a name that must be there, as [`ParquetTable::number`] or [`ParquetTable::text`] gives it.
    pub(in crate::formats) fn want(
        &self,
        name: &str,
        kind: fn(&Self, usize) -> Result<ParquetColumn, DataError>,
    ) -> Result<ParquetColumn, DataError> {
        let missing = || DataError::MissingColumn {
            file: self.file.clone(),
            column: name.to_owned(),
            found: gnp_file::excerpt(&self.names.join(", "), LISTED),
        };
        kind(self, self.place(name).ok_or_else(missing)?)
    }

    /// Groups of rows.
    pub(in crate::formats) fn groups(&self) -> usize {
        self.reader.num_row_groups()
    }

    /// The values of the wanted columns in a group of rows, in the order asked for.
    pub(in crate::formats) fn read(&self, group: usize, wanted: &[ParquetColumn]) -> Result<Vec<Cells>, DataError> {
        let read = || {
            let group = self.reader.get_row_group(group)?;
            let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            wanted
                .iter()
                .map(|column| {
                    let unsigned = matches!(
                        self.column(column.index).converted_type(),
                        ConvertedType::UINT_8
                            | ConvertedType::UINT_16
                            | ConvertedType::UINT_32
                            | ConvertedType::UINT_64
                    );
                    cells(group.get_column_reader(column.index)?, rows, column.kind, unsigned)
                })
                .collect()
        };
        guarded(read).map_err(|reason| broken(&self.file, &reason))
    }

    fn column(&self, index: usize) -> std::sync::Arc<ColumnDescriptor> {
        self.reader.metadata().file_metadata().schema_descr().column(index)
    }

    fn wrong_type(&self, index: usize, needs: &str) -> DataError {
        let column = self.column(index);
        let nested = if column.max_rep_level() > 0 { "lists of " } else { "" };
        let found = match column.logical_type_ref() {
            Some(logical) => gnp_file::excerpt(&format!("{logical:?}"), 60),
            None => column.physical_type().to_string(),
        };
        DataError::Tracks {
            problem: TrackProblem::Columns,
            place: format!("{}, column `{}`", self.file.display(), gnp_file::excerpt(&self.names[index], 60)),
            row: None,
            what: format!("it holds {nested}{found}"),
            remedy: format!("write {needs}"),
        }
    }
}

/// By how much numbers of a column are divided, so that times are in s; `None` for what is no number.
fn divisor(column: &ColumnDescriptor) -> Option<f64> {
    match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Timestamp(time) | LogicalType::Time(time)), _) => Some(match time.unit {
            TimeUnit::MILLIS => 1e3,
            TimeUnit::MICROS => 1e6,
            TimeUnit::NANOS => 1e9,
        }),
        (_, ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS) => Some(1e3),
        (_, ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS) => Some(1e6),
        (_, ConvertedType::DECIMAL | ConvertedType::DATE | ConvertedType::INTERVAL) => None,
        _ => Some(1.),
    }
}

/// parquet refuses most damaged files and panics at some.
fn guarded<T>(read: impl FnOnce() -> Result<T, ParquetError>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(read)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => {
            let text = gnp_file::excerpt(&error.to_string(), LISTED);
            let packed = text.contains("isabled feature") || text.contains("compression");
            let hint = if packed { "; write it uncompressed or with snappy" } else { "" };
            Err(format!("{text}{hint}"))
        }
        Err(_) => Err("it is damaged".to_owned()),
    }
}

fn broken(file: &Path, reason: &str) -> DataError {
    DataError::Table { file: file.into(), reason: reason.to_owned() }
}

fn cells(reader: ColumnReader, rows: usize, kind: Kind, unsigned: bool) -> Result<Cells, ParquetError> {
    let as_i32 = |v: i32| if unsigned { i64::from(v.cast_unsigned()) } else { i64::from(v) };
    match kind {
        Kind::Number(divisor) => {
            let long = |v: i64| if unsigned { v.cast_unsigned() as f64 } else { v as f64 };
            let values = match reader {
                ColumnReader::BoolColumnReader(reader) => all(reader, rows, |v| f64::from(u8::from(*v)))?,
                ColumnReader::Int32ColumnReader(reader) => all(reader, rows, |v| as_i32(*v) as f64)?,
                ColumnReader::Int64ColumnReader(reader) => all(reader, rows, |v| long(*v))?,
                ColumnReader::FloatColumnReader(reader) => all(reader, rows, |v| f64::from(*v))?,
                ColumnReader::DoubleColumnReader(reader) => all(reader, rows, |v| *v)?,
                _ => return Err(other_type()),
            };
            Ok(Cells::Number(values.into_iter().map(|value| value.map_or(f64::NAN, |v| v / divisor)).collect()))
        }
        Kind::Text => {
            let long = |v: i64| if unsigned { v.cast_unsigned().to_string() } else { v.to_string() };
            let mut words = Words::default();
            match reader {
                ColumnReader::ByteArrayColumnReader(reader) => {
                    for value in all(reader, rows, |v| v.clone())? {
                        let text = value.as_ref().map_or(Ok(""), |value| std::str::from_utf8(value.data()));
                        words.push(text.map_err(|_| ParquetError::General("a text is not in UTF-8".to_owned()))?);
                    }
                }
                ColumnReader::Int32ColumnReader(reader) => {
                    push(&mut words, all(reader, rows, |v| as_i32(*v).to_string())?)
                }
                ColumnReader::Int64ColumnReader(reader) => push(&mut words, all(reader, rows, |v| long(*v))?),
                // Whole numbers have no fraction in their text.
                ColumnReader::FloatColumnReader(reader) => push(&mut words, all(reader, rows, |v| v.to_string())?),
                ColumnReader::DoubleColumnReader(reader) => push(&mut words, all(reader, rows, |v| v.to_string())?),
                _ => return Err(other_type()),
            }
            Ok(Cells::Text(words))
        }
    }
}

fn push(words: &mut Words, values: Vec<Option<String>>) {
    values.iter().for_each(|value| words.push(value.as_deref().unwrap_or("")));
}

fn other_type() -> ParquetError {
    ParquetError::General("a column changes its type between groups of rows".to_owned())
}

/// All cells of a column.
fn all<D: DataType, T>(
    mut reader: ColumnReaderImpl<D>,
    rows: usize,
    of: impl Fn(&D::T) -> T,
) -> Result<Vec<Option<T>>, ParquetError> {
    let (mut values, mut levels) = (Vec::new(), Vec::new());
    let (read, ..) = reader.read_records(rows, Some(&mut levels), None, &mut values)?;
    if read != rows {
        return Err(ParquetError::EOF(format!("a column has {read} rows of {rows}")));
    }
    if levels.is_empty() {
        return Ok(values.iter().map(|value| Some(of(value))).collect());
    }
    // A column within optional groups has its highest level where there is a value.
    let most = levels.iter().copied().max().unwrap_or(0);
    if most == 0 {
        return Ok(levels.iter().map(|_| None).collect());
    }
    let mut values = values.iter();
    Ok(levels.iter().map(|level| if *level == most { values.next().map(&of) } else { None }).collect())
}
