//! Writing prediction files.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gnp_data::{Forecast, WindowKey};
use gnp_file::NamedTempFile;
use parquet::basic::Compression;
use parquet::data_type::{ByteArray, ByteArrayType, FloatType, Int32Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};

use crate::error::EvalError;
use crate::predictions::schema::{EXPLAINING, Provenance, explanation_of, parquet_schema};

/// Rows held in memory before they are written, about 12 MB.
const GROUP_ROWS: usize = 1 << 16;

/// Writes predictions window by window. Memory does not grow with their number, and the file
/// appears under its name only when it is [finished](PredictionWriter::finish).
pub struct PredictionWriter {
    path: PathBuf,
    file: NamedTempFile,
    parquet: SerializedFileWriter<File>,
    dt: f64,
    rows: Rows,
}

/// Rows not yet written, by column.
#[derive(Default)]
struct Rows {
    scene: Vec<ByteArray>,
    /// vehicle, segment, t0, mode, step.
    whole: [Vec<i32>; 5],
    /// probability, t_s, x, y, origin_x, origin_y.
    number: [Vec<f32>; 6],
    explaining: Vec<Vec<f32>>,
    /// 1 where a row is explained.
    explained: Vec<i16>,
}

impl PredictionWriter {
    /// Opens a temporary file beside `path`.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn create(path: &Path, provenance: &Provenance) -> Result<Self, EvalError> {
        let io = |source| EvalError::Io { path: path.into(), source };
        let parquet = |source| EvalError::Parquet { path: path.into(), source };
        let file = gnp_file::beside(path).map_err(io)?;
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_key_value_metadata(Some(provenance.key_values()))
            .build();
        let schema = parquet_schema().map_err(parquet)?;
        let handle = file.reopen().map_err(io)?;
        let parquet = SerializedFileWriter::new(handle, schema, Arc::new(properties)).map_err(parquet)?;
        Ok(Self { path: path.into(), file, parquet, dt: 1. / provenance.rate_hz, rows: Rows::new() })
    }

    /// Adds one window's forecast; `origin` is the window's origin in the road frame, m.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&mut self, key: &WindowKey, origin: [f32; 2], forecast: &Forecast) -> Result<(), EvalError> {
        let scene = ByteArray::from(key.recording.as_bytes().to_vec());
        for (number, mode) in forecast.modes.iter().enumerate() {
            for (j, [x, y]) in mode.path.iter().enumerate() {
                let rows = &mut self.rows;
                rows.scene.push(scene.clone());
                // Parquet keeps unsigned numbers as the signed ones of the same bits.
                let whole = [key.vehicle, u32::from(key.segment), key.t0, number as u32, j as u32 + 1];
                for (column, value) in rows.whole.iter_mut().zip(whole) {
                    column.push(value as i32);
                }
                let t_s = ((j + 1) as f64 * self.dt) as f32;
                let numbers = [mode.probability, t_s, *x, *y, origin[0], origin[1]];
                for (column, value) in rows.number.iter_mut().zip(numbers) {
                    column.push(value);
                }
                let explanation = explanation_of(mode.explanation.as_ref(), j);
                rows.explained.push(i16::from(explanation.is_some()));
                for (column, value) in rows.explaining.iter_mut().zip(explanation.into_iter().flatten()) {
                    column.push(value);
                }
            }
        }
        if self.rows.scene.len() >= GROUP_ROWS { self.flush() } else { Ok(()) }
    }

    /// Writes what is left and gives the file its name.
    ///
    /// # Errors
    /// When the file cannot be written or renamed.
    pub fn finish(mut self) -> Result<(), EvalError> {
        self.flush()?;
        self.parquet.close().map_err(|source| EvalError::Parquet { path: self.path.clone(), source })?;
        self.file.persist(&self.path).map_err(|error| EvalError::Io { path: self.path, source: error.error })?;
        Ok(())
    }

    fn flush(&mut self) -> Result<(), EvalError> {
        if self.rows.scene.is_empty() {
            return Ok(());
        }
        let rows = std::mem::replace(&mut self.rows, Rows::new());
        let mut write = || {
            let mut group = self.parquet.next_row_group()?;
            rows.write(&mut group)?;
            group.close()
        };
        write().map(drop).map_err(|source: ParquetError| EvalError::Parquet { path: self.path.clone(), source })
    }
}

impl Rows {
    fn new() -> Self {
        Self { explaining: vec![Vec::new(); EXPLAINING], ..Self::default() }
    }

    /// Columns in the order of the schema.
    fn write(&self, group: &mut SerializedRowGroupWriter<'_, File>) -> Result<(), ParquetError> {
        let [vehicle, segment, t0, mode, step] = &self.whole;
        let [probability, t_s, x, y, origin_x, origin_y] = &self.number;
        if let Some(mut column) = group.next_column()? {
            column.typed::<ByteArrayType>().write_batch(&self.scene, None, None)?;
            column.close()?;
        }
        for values in [vehicle, segment, t0, mode] {
            write_whole(group, values)?;
        }
        write_numbers(group, probability, None)?;
        write_whole(group, step)?;
        for values in [t_s, x, y, origin_x, origin_y] {
            write_numbers(group, values, None)?;
        }
        for values in &self.explaining {
            write_numbers(group, values, Some(&self.explained))?;
        }
        Ok(())
    }
}

fn write_whole(group: &mut SerializedRowGroupWriter<'_, File>, values: &[i32]) -> Result<(), ParquetError> {
    let Some(mut column) = group.next_column()? else { return Ok(()) };
    column.typed::<Int32Type>().write_batch(values, None, None)?;
    column.close()
}

fn write_numbers(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[f32],
    present: Option<&[i16]>,
) -> Result<(), ParquetError> {
    let Some(mut column) = group.next_column()? else { return Ok(()) };
    column.typed::<FloatType>().write_batch(values, present, None)?;
    column.close()
}
