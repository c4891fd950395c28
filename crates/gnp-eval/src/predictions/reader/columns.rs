//! Columns of a Parquet file by name, whatever their order and width.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use gnp_force::TermDescriptor;
use parquet::basic::{ConvertedType, Type as PhysicalType};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::errors::ParquetError;
use parquet::file::reader::RowGroupReader;
use parquet::schema::types::{ColumnDescriptor, SchemaDescriptor};

use super::{Detail, FARTHEST_M, Failure, within};
use crate::error::PredictionProblem;
use crate::predictions::schema::{COLUMNS, Explaining, Kind, LEADER, Part, explaining, published};

/// Where the columns of a prediction file stand.
pub(super) struct Columns {
    /// Name in our schema, index in the file, whether 32-bit numbers are unsigned.
    found: Vec<(&'static str, usize, bool)>,
    /// What the file explains a step by.
    pub(super) explained: Explained,
}

/// The columns of a file that explain a step; empty in a file that explains nothing.
#[derive(Default)]
pub(super) struct Explained {
    /// Terms all of whose columns are there.
    pub(super) terms: Vec<Arc<TermDescriptor>>,
    pub(super) columns: Vec<Explaining>,
    indices: Vec<usize>,
}

impl Columns {
    /// `positions` are the columns that stand for `x` and `y`. `terms` are those that the file says it has; without them
    /// the published ones are looked for.
    pub(super) fn find(
        schema: &SchemaDescriptor,
        positions: [&'static str; 2],
        terms: Option<Vec<TermDescriptor>>,
        detail: Detail,
    ) -> Result<Self, PredictionProblem> {
        let by_name: BTreeMap<String, usize> =
            schema.columns().iter().enumerate().map(|(i, column)| (column.path().string(), i)).collect();
        let mut found = Vec::new();
        for known in COLUMNS.iter().filter(|column| column.read) {
            let also = || known.also.and_then(|also| by_name.get(also));
            let name = match known.name {
                "x" => positions[0],
                "y" => positions[1],
                name => name,
            };
            let Some(index) = by_name.get(name).or_else(also).copied() else {
                if known.required {
                    return Err(PredictionProblem::MissingColumn { column: name });
                }
                continue;
            };
            let column = schema.column(index);
            check_type(&column, known.kind)?;
            found.push((known.name, index, column.converted_type() == ConvertedType::UINT_32));
        }
        let explained = match detail {
            Detail::Paths => Explained::default(),
            Detail::Explanations => Explained::find(
                schema,
                &by_name,
                terms.map_or_else(published, |t| t.into_iter().map(Arc::new).collect()),
            )?,
        };
        if explained.columns.iter().any(|column| column.part.is_share())
            && let Some(index) = by_name.get(LEADER)
        {
            let column = schema.column(*index);
            check_type(&column, Kind::Whole)?;
            found.push((LEADER, *index, column.converted_type() == ConvertedType::UINT_32));
        }
        Ok(Self { found, explained })
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
        for index in &self.explained.indices {
            read.explaining.push(numbers(group.get_column_reader(*index)?, rows)?);
        }
        Ok(read)
    }
}

impl Explained {
    /// The terms that are there, with the goal; nothing without the goal or any term.
    fn find(
        schema: &SchemaDescriptor,
        by_name: &BTreeMap<String, usize>,
        mut terms: Vec<Arc<TermDescriptor>>,
    ) -> Result<Self, PredictionProblem> {
        let absent = |column: &Explaining| !by_name.contains_key(&column.info.name);
        let missing: Vec<Part> =
            explaining(&terms).iter().filter(|column| absent(column)).map(|column| column.part).collect();
        let mut number = 0..;
        terms.retain(|_| {
            let term = number.next();
            missing.iter().all(|part| part.term().is_none() || part.term() != term)
        });
        if missing.iter().any(|part| matches!(part, Part::Goal { .. })) || terms.is_empty() {
            return Ok(Self::default());
        }
        let mut columns = explaining(&terms);
        if missing.iter().any(|part| part.is_share()) {
            columns.retain(|column| !column.part.is_share());
        }
        let indices: Vec<usize> = columns.iter().filter_map(|column| by_name.get(&column.info.name).copied()).collect();
        for index in &indices {
            check_type(&schema.column(*index), Kind::Number)?;
        }
        Ok(Self { terms, columns, indices })
    }
}

fn check_type(column: &ColumnDescriptor, kind: Kind) -> Result<(), PredictionProblem> {
    let (needs, fits): (_, &[PhysicalType]) = match kind {
        Kind::Text => ("text", &[PhysicalType::BYTE_ARRAY]),
        Kind::Whole => ("whole numbers of 32 or 64 bits", &[PhysicalType::INT32, PhysicalType::INT64]),
        Kind::Number | Kind::Double => {
            ("numbers of single or double precision", &[PhysicalType::FLOAT, PhysicalType::DOUBLE])
        }
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

    /// A number from 0 to 1.
    pub(super) fn probability(&self, i: usize) -> Result<f32, PredictionProblem> {
        let value = self.number(i, "probability")?;
        if (0. ..=1.).contains(&value) {
            return Ok(value);
        }
        Err(self.bad(i, "probability", format!("is {value}, not from 0 to 1")))
    }

    /// A position in a window's frame.
    pub(super) fn position(&self, i: usize, column: &'static str) -> Result<f32, PredictionProblem> {
        let value = self.number(i, column)?;
        if value.abs() > FARTHEST_M {
            let problem = format!(
                "is {value}, farther than {FARTHEST_M} m; positions are counted in m from the last observed centre of \
                 the vehicle, x forward and y to the left"
            );
            return Err(self.bad(i, column, problem));
        }
        Ok(value)
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

    /// The vehicle ahead, where the file names it.
    pub(super) fn leader(&self, i: usize) -> Option<u32> {
        let cell = self.whole.get(LEADER)?.get(i).copied().flatten()?;
        u32::try_from(cell).ok()
    }

    /// Appends the explaining numbers of a row, where it has a goal; NaN stands for a null.
    pub(super) fn explanation(&self, i: usize, values: &mut Vec<f32>) -> bool {
        let cell = |cells: &Vec<Option<f32>>| cells.get(i).copied().flatten();
        let [goal_x, goal_y, ..] = &self.explaining[..] else { return false };
        if cell(goal_x).is_none() || cell(goal_y).is_none() {
            return false;
        }
        values.extend(self.explaining.iter().map(|cells| cell(cells).unwrap_or(f32::NAN)));
        true
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
