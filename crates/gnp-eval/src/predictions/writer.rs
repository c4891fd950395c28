//! Writing prediction files.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gnp_data::{Explanation, Forecast, WindowKey};
use gnp_file::Temporary;
use gnp_force::TermDescriptor;
use parquet::basic::Compression;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};

use crate::error::EvalError;
use crate::predictions::schema::{
    Cell, Column, ExplainedMode, Explaining, Kind, Layout, Moment, PREDICTIONS, Provenance, Row, explaining,
    parquet_schema, published,
};
use crate::predictions::shares::Shares;

/// Rows held in memory before they are written, about 12 MB.
const GROUP_ROWS: usize = 1 << 16;

/// Writes predictions window by window. Memory does not grow with their number, and the file
/// appears under its name only when it is [finished](PredictionWriter::finish).
///
/// The columns are those of the published terms of the force and of any other that explains the first explained
/// forecast.
pub struct PredictionWriter {
    rows: LongWriter,
}

impl PredictionWriter {
    /// Opens a temporary file beside `path`.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn create(path: &Path, provenance: &Provenance) -> Result<Self, EvalError> {
        Ok(Self { rows: LongWriter::create(path, provenance, &PREDICTIONS)? })
    }

    /// Adds one window's forecast; `origin` is the window's origin in the road frame, m.
    ///
    /// # Errors
    /// When the file cannot be written, or a force of the forecast has no column because those explained before had no
    /// such term.
    pub fn write(&mut self, key: &WindowKey, origin: [f32; 2], forecast: &Forecast) -> Result<(), EvalError> {
        self.rows.write(&Written { key, origin, forecast, moment: &Moment::default(), why: None }, |_| [[0.; 2]; 2])
    }

    /// Writes what is left and gives the file its name.
    ///
    /// # Errors
    /// When the file cannot be written or renamed.
    pub fn finish(self) -> Result<(), EvalError> {
        self.rows.finish()
    }
}

/// A forecast to be written.
pub(super) struct Written<'a> {
    pub(super) key: &'a WindowKey,
    pub(super) origin: [f32; 2],
    pub(super) forecast: &'a Forecast,
    pub(super) moment: &'a Moment,
    /// Goes into the last row of the first mode.
    pub(super) why: Option<String>,
}

/// Writes forecasts in long form, whatever else stands in their rows.
pub(super) struct LongWriter {
    path: PathBuf,
    file: Temporary,
    provenance: Provenance,
    layout: &'static Layout,
    /// Once the columns are settled.
    columns: Option<Columns>,
    /// From the first group of rows on.
    parquet: Option<SerializedFileWriter<File>>,
    rows: Rows,
}

/// The columns of the file that explain a step.
struct Columns {
    terms: Vec<Arc<TermDescriptor>>,
    explaining: Vec<Explaining>,
}

impl Columns {
    fn of(explanation: Option<&Explanation>) -> Self {
        let mut terms = published();
        for term in explanation.into_iter().flat_map(|explanation| &explanation.terms) {
            if terms.iter().all(|known| known.name != term.term().name) {
                terms.push(Arc::new(term.term().clone()));
            }
        }
        let explaining = explaining(&terms);
        Self { terms, explaining }
    }
}

/// Rows not yet written, by column.
#[derive(Default)]
struct Rows {
    count: usize,
    always: Vec<Values>,
    explaining: Vec<Nullable<f32>>,
    leader: Nullable<i32>,
    why: Nullable<ByteArray>,
    /// Columns that every row has a value in.
    columns: &'static [Column],
}

/// Values of a column.
enum Values {
    Text(Vec<ByteArray>),
    Whole(Vec<i32>),
    Number(Vec<f32>),
    Double(Vec<f64>),
}

/// Values of a column with nulls, and 1 for each row that has one.
#[derive(Clone, Default)]
struct Nullable<T> {
    values: Vec<T>,
    levels: Vec<i16>,
}

impl LongWriter {
    pub(super) fn create(path: &Path, provenance: &Provenance, layout: &'static Layout) -> Result<Self, EvalError> {
        let file = gnp_file::beside(path).map_err(|source| EvalError::Io { path: path.into(), source })?;
        let (provenance, rows) = (provenance.clone(), Rows::new(layout));
        Ok(Self { path: path.into(), file, provenance, layout, columns: None, parquet: None, rows })
    }

    /// `places` gives a point of the window's frame in the file's coordinates and along and across the road.
    pub(super) fn write(
        &mut self,
        written: &Written<'_>,
        places: impl Fn([f32; 2]) -> [[f64; 2]; 2],
    ) -> Result<(), EvalError> {
        let Written { key, origin, forecast, moment, why } = written;
        let scene = ByteArray::from(key.recording.as_bytes().to_vec());
        let dt = 1. / self.provenance.rate_hz;
        for (number, mode) in forecast.modes.iter().enumerate() {
            let explanation = mode.explanation.as_ref();
            if explanation.is_some() && self.columns.is_none() {
                self.settle(explanation);
            }
            let columns = self.columns.as_ref();
            let explained = match (columns, explanation) {
                (Some(columns), Some(explanation)) => {
                    let unknown = |name: &str| columns.terms.iter().all(|known| known.name != name);
                    if let Some(term) = explanation.terms.iter().find(|term| unknown(&term.term().name)) {
                        return Err(EvalError::Term { path: self.path.clone(), term: term.term().name.to_string() });
                    }
                    let terms = columns.terms.iter().map(|known| explanation.term(&known.name)).collect();
                    Some(ExplainedMode { goal: explanation.goal, terms, shares: Shares::of(explanation) })
                }
                _ => None,
            };
            let steps = explanation.map_or(0, Explanation::steps);
            for (j, at) in mode.path.iter().enumerate() {
                let row = Row {
                    scene: &scene,
                    key,
                    mode: number,
                    probability: mode.probability,
                    step: j + 1,
                    t_s: ((j + 1) as f64 * dt) as f32,
                    at: *at,
                    origin: *origin,
                    moment,
                    places: places(*at),
                };
                let explained = explained.as_ref().filter(|_| j < steps);
                self.rows.push(&row);
                self.rows.leader.push(explained.and_then(|explained| explained.shares.leader).map(|it| it as i32));
                if self.layout.why {
                    let last = number == 0 && j + 1 == mode.path.len();
                    self.rows.why.push(why.as_deref().filter(|_| last).map(ByteArray::from));
                }
                for (values, column) in self.rows.explaining.iter_mut().zip(columns.iter().flat_map(|c| &c.explaining))
                {
                    values.push(explained.and_then(|explained| column.part.value(explained, j)));
                }
            }
        }
        if self.rows.count >= GROUP_ROWS { self.flush() } else { Ok(()) }
    }

    pub(super) fn finish(mut self) -> Result<(), EvalError> {
        self.flush()?;
        let parquet = self.open()?;
        parquet.close().map_err(|error| not_written(&self.path, error))?;
        self.file.persist(&self.path).map_err(|source| EvalError::Io { path: self.path, source })
    }

    /// Chooses the columns; the rows so far explain nothing.
    fn settle(&mut self, explanation: Option<&Explanation>) -> &Columns {
        let rows = &mut self.rows;
        self.columns.get_or_insert_with(|| {
            let columns = Columns::of(explanation);
            let nulls = Nullable { values: Vec::new(), levels: vec![0; rows.count] };
            rows.explaining = vec![nulls; columns.explaining.len()];
            columns
        })
    }

    /// The file, begun if it is not.
    fn open(&mut self) -> Result<SerializedFileWriter<File>, EvalError> {
        if let Some(parquet) = self.parquet.take() {
            return Ok(parquet);
        }
        let file = self.file.as_file_mut().try_clone();
        let handle = file.map_err(|source| EvalError::Io { path: self.path.clone(), source })?;
        let (provenance, layout) = (self.provenance.clone(), self.layout);
        let columns = self.settle(None);
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_key_value_metadata(Some(provenance.key_values(layout, &columns.terms)))
            .build();
        let begin =
            || SerializedFileWriter::new(handle, parquet_schema(layout, &columns.explaining)?, Arc::new(properties));
        begin().map_err(|error| not_written(&self.path, error))
    }

    fn flush(&mut self) -> Result<(), EvalError> {
        if self.rows.count == 0 {
            return Ok(());
        }
        let mut parquet = self.open()?;
        let mut write = || {
            let mut group = parquet.next_row_group()?;
            self.rows.write(&mut group)?;
            group.close()
        };
        write().map(drop).map_err(|error| not_written(&self.path, error))?;
        let columns = self.rows.explaining.len();
        self.rows = Rows { explaining: vec![Nullable::default(); columns], ..Rows::new(self.layout) };
        self.parquet = Some(parquet);
        Ok(())
    }
}

/// Why a file cannot be written: what the system said, where it was the system, such as that the disk is full.
pub(super) fn not_written(path: &Path, error: ParquetError) -> EvalError {
    let path = path.to_owned();
    match error {
        ParquetError::External(cause) => match cause.downcast::<io::Error>() {
            Ok(source) => EvalError::Io { path, source: *source },
            Err(cause) => EvalError::WriteParquet { path, source: ParquetError::External(cause) },
        },
        source => EvalError::WriteParquet { path, source },
    }
}

impl Rows {
    fn new(layout: &'static Layout) -> Self {
        let values = |kind| match kind {
            Kind::Text => Values::Text(Vec::new()),
            Kind::Whole => Values::Whole(Vec::new()),
            Kind::Number => Values::Number(Vec::new()),
            Kind::Double => Values::Double(Vec::new()),
        };
        let columns = layout.columns;
        Self { always: columns.iter().map(|column| values(column.kind)).collect(), columns, ..Self::default() }
    }

    /// A row, apart from what explains it.
    fn push(&mut self, row: &Row<'_>) {
        self.count += 1;
        for (values, column) in self.always.iter_mut().zip(self.columns) {
            match (values, (column.cell)(row)) {
                (Values::Text(values), Cell::Text(value)) => values.push(value),
                // Parquet keeps unsigned numbers as the signed ones of the same bits.
                (Values::Whole(values), Cell::Whole(value)) => values.push(value as i32),
                (Values::Number(values), Cell::Number(value)) => values.push(value),
                (Values::Double(values), Cell::Double(value)) => values.push(value),
                // A cell of another kind than its column: Parquet refuses a column that is too short.
                _ => {}
            }
        }
    }

    /// Columns in the order of the schema.
    fn write(&self, group: &mut SerializedRowGroupWriter<'_, File>) -> Result<(), ParquetError> {
        for values in &self.always {
            match values {
                Values::Text(values) => write_column::<ByteArrayType>(group, values, None)?,
                Values::Whole(values) => write_column::<Int32Type>(group, values, None)?,
                Values::Number(values) => write_column::<FloatType>(group, values, None)?,
                Values::Double(values) => write_column::<DoubleType>(group, values, None)?,
            }
        }
        for Nullable { values, levels } in &self.explaining {
            write_column::<FloatType>(group, values, Some(levels))?;
        }
        write_column::<Int32Type>(group, &self.leader.values, Some(&self.leader.levels))?;
        // Where there is no such column, none is left.
        write_column::<ByteArrayType>(group, &self.why.values, Some(&self.why.levels))
    }
}

impl<T> Nullable<T> {
    fn push(&mut self, value: Option<T>) {
        self.levels.push(i16::from(value.is_some()));
        self.values.extend(value);
    }
}

fn write_column<D: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[D::T],
    present: Option<&[i16]>,
) -> Result<(), ParquetError> {
    let Some(mut column) = group.next_column()? else { return Ok(()) };
    column.typed::<D>().write_batch(values, present, None)?;
    column.close()
}

#[cfg(test)]
mod tests {
    use gnp_data::{Dataset, Mode};

    use super::*;

    fn provenance() -> Provenance {
        Provenance {
            model: "m".to_owned(),
            dataset: Dataset::NGSIM,
            rate_hz: 10.,
            uses_future: false,
            simulated: false,
        }
    }

    /// `/dev/full` takes nothing, as a full disk does.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_said_to_be_full() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = LongWriter::create(&folder.path().join("p.parquet"), &provenance(), &PREDICTIONS).unwrap();
        let full = File::options().write(true).open("/dev/full").unwrap();
        writer.settle(None);
        let schema = parquet_schema(&PREDICTIONS, &writer.columns.as_ref().unwrap().explaining).unwrap();
        writer.parquet = Some(SerializedFileWriter::new(full, schema, Arc::default()).unwrap());
        let key = WindowKey { recording: "a".to_owned(), vehicle: 1, segment: 0, t0: 30 };
        let forecast = Forecast { modes: vec![Mode { probability: 1., path: vec![[1., 0.]; 50], explanation: None }] };
        let moment = Moment::default();
        let written = Written { key: &key, origin: [0.; 2], forecast: &forecast, moment: &moment, why: None };
        writer.write(&written, |_| [[0.; 2]; 2]).unwrap();
        match writer.finish().unwrap_err() {
            EvalError::Io { path, source } => {
                assert_eq!(source.kind(), io::ErrorKind::StorageFull);
                assert!(path.ends_with("p.parquet"));
            }
            other => panic!("{other}"),
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "no temporary file stays");
    }

    #[test]
    fn what_only_parquet_refuses_is_not_taken_for_a_file_to_read() {
        let error = not_written(Path::new("p.parquet"), ParquetError::General("too few values".to_owned()));
        assert_eq!(error.to_string(), "cannot write p.parquet as Parquet");
    }
}
