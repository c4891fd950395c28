//! Files of forecasts: what a model says of vehicles whose future nobody knows, in the coordinates of the tracks.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gnp_data::{Forecast, WindowKey};
use parquet::basic::Compression;
use parquet::column::writer::ColumnCloseResult;
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::file::metadata::{FileMetaData, ParquetMetaData};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;

use crate::error::EvalError;
use crate::predictions::schema::{Cell, Column, ColumnInfo, Kind, Layout, Moment, Provenance, all_columns, published};
use crate::predictions::writer::{LongWriter, Written, not_written};

/// Name and version of the schema of a file of forecasts.
pub(super) const SCHEMA: &str = "gnp-forecasts 1";
/// The columns in which such a file has what a file of predictions has in `x` and `y`.
pub(super) const WINDOW_FRAME: [&str; 2] = ["forward", "left"];

/// Files of forecasts.
static FORECASTS: Layout = Layout {
    schema: SCHEMA,
    frame: "x and y in the coordinates of the tracks; s along the road and d to its left; forward and left from the last \
            observed centre of the box, as goals, forces and displacements",
    columns: &COLUMNS,
    why: true,
};

/// The columns that every row has a value in, in the order of the file.
static COLUMNS: [Column; 19] = {
    use Kind::{Double, Number, Text, Whole};
    [
        Column::new("recording", Text, "", "name of the recording", |row| Cell::Text(row.scene.clone())),
        Column::new("vehicle", Whole, "", "number of the vehicle in the recording", |row| Cell::Whole(row.key.vehicle)),
        Column::new("vehicle_name", Text, "", "its name in the tracks; its number where it has no other", |row| {
            Cell::Text(row.moment.name.clone())
        }),
        Column::new("segment", Whole, "", "gap-free stretch of that vehicle, from 0", |row| {
            Cell::Whole(u32::from(row.key.segment))
        }),
        Column::new("t0", Whole, "frame", "frame number of the last observed frame", |row| Cell::Whole(row.key.t0)),
        Column::new("time_s", Double, "s", "time of the last observed frame, on the clock of the tracks", |row| {
            Cell::Double(row.moment.time_s)
        }),
        Column::new("mode", Whole, "", "number of the future; 0 is the prediction", |row| Cell::Whole(row.mode as u32)),
        Column::new("probability", Number, "", "of the future, the same in all its rows; sums to 1", |row| {
            Cell::Number(row.probability)
        }),
        Column::new("step", Whole, "", "predicted frame, from 1", |row| Cell::Whole(row.step as u32)),
        Column::new("horizon_s", Number, "s", "time after the last observed frame", |row| Cell::Number(row.t_s)),
        Column::new("x", Double, "m", "centre, in the coordinates of the tracks", |row| Cell::Double(row.places[0][0])),
        Column::new("y", Double, "m", "centre, in the coordinates of the tracks", |row| Cell::Double(row.places[0][1])),
        Column::new("s", Double, "m", "centre, along the road in the direction of travel", |row| {
            Cell::Double(row.places[1][0])
        }),
        Column::new("d", Double, "m", "centre, to the left in the direction of travel", |row| {
            Cell::Double(row.places[1][1])
        }),
        Column::new("forward", Number, "m", "centre, forward from the last observed one", |row| {
            Cell::Number(row.at[0])
        }),
        Column::new("left", Number, "m", "centre, to the left of the last observed one", |row| Cell::Number(row.at[1])),
        Column::new("past", Text, "", "`full`, or `filled` where less than the model needs was seen", |row| {
            Cell::Text(row.moment.past.clone())
        }),
        Column::new(
            "observed_s",
            Number,
            "s",
            "time for which the vehicle was seen, up to what the model needs",
            |row| Cell::Number(row.moment.observed_s),
        ),
        Column::new("model", Text, "", "name of the model", |row| Cell::Text(row.moment.model.clone())),
    ]
};

/// The schema of a file of forecasts with the published terms of the force, in the order of its columns.
#[must_use]
pub fn forecast_columns() -> Vec<ColumnInfo> {
    all_columns(&FORECASTS, &published())
}

/// What is known of a vehicle whose forecast is written.
#[derive(Clone, Debug)]
pub struct ForecastOf<'a> {
    /// Recording, vehicle, last observed frame.
    pub key: &'a WindowKey,
    /// Name of the vehicle in the tracks.
    pub vehicle_name: &'a str,
    /// Time of the last observed frame, s, on the clock of the tracks.
    pub time_s: f64,
    /// How much of its past was seen: `full`, `filled`.
    pub past: &'static str,
    /// For how long it was seen, s.
    pub observed_s: f64,
    /// Its last observed centre: forward and left in the frame of its carriageway, m.
    pub origin: [f32; 2],
    /// A sentence on what moves it.
    pub why: Option<String>,
}

/// Writes a file of forecasts, vehicle by vehicle. The file appears under its name only when it is
/// [finished](ForecastWriter::finish).
pub struct ForecastWriter {
    rows: LongWriter,
    model: ByteArray,
}

impl ForecastWriter {
    /// Opens a temporary file beside `path`.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn create(path: &Path, provenance: &Provenance) -> Result<Self, EvalError> {
        let model = ByteArray::from(provenance.model.as_str());
        Ok(Self { rows: LongWriter::create(path, provenance, &FORECASTS)?, model })
    }

    /// Adds the forecast of a vehicle; `place` gives a point of the frame of its carriageway, m, in the coordinates of the
    /// tracks.
    ///
    /// # Errors
    /// As [`PredictionWriter::write`](crate::PredictionWriter::write).
    pub fn write(
        &mut self,
        of: &ForecastOf<'_>,
        forecast: &Forecast,
        place: impl Fn([f32; 2]) -> [f64; 2],
    ) -> Result<(), EvalError> {
        let moment = Moment {
            name: ByteArray::from(of.vehicle_name),
            model: self.model.clone(),
            past: ByteArray::from(of.past),
            observed_s: of.observed_s as f32,
            time_s: of.time_s,
        };
        let written = Written { key: of.key, origin: of.origin, forecast, moment: &moment, why: of.why.clone() };
        self.rows.write(&written, |at| {
            let on_road = [0, 1].map(|axis| of.origin[axis] + at[axis]);
            [place(on_road), on_road.map(f64::from)]
        })
    }

    /// Writes what is left and gives the file its name.
    ///
    /// # Errors
    /// When the file cannot be written or renamed.
    pub fn finish(self) -> Result<(), EvalError> {
        self.rows.finish()
    }
}

/// Joins files of forecasts of one model into one, in their order, by copying their row groups. The file appears whole or
/// not at all.
///
/// # Errors
/// When there is none, one cannot be read or has other columns than the first, or the file cannot be written.
pub fn join_forecasts(parts: &[PathBuf], path: &Path) -> Result<(), EvalError> {
    let Some(first) = parts.first() else {
        return Err(EvalError::NoParts { path: path.into() });
    };
    let (_, metadata) = open(first)?;
    let mut out = gnp_file::beside(path).map_err(|source| EvalError::Io { path: path.into(), source })?;
    let file = out.as_file_mut().try_clone().map_err(|source| EvalError::Io { path: path.into(), source })?;
    let head = metadata.file_metadata();
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(head.key_value_metadata().cloned())
        .build();
    let schema = head.schema_descr().root_schema_ptr();
    let begun = SerializedFileWriter::new(file, schema, Arc::new(properties));
    let mut writer = begun.map_err(|error| not_written(path, error))?;
    for part in parts {
        let (file, metadata) = open(part)?;
        if !alike(head, metadata.file_metadata()) {
            return Err(EvalError::OtherColumns { path: part.into(), first: first.clone() });
        }
        copy(&file, &metadata, &mut writer).map_err(|error| not_written(path, error))?;
    }
    writer.close().map_err(|error| not_written(path, error))?;
    out.persist(path).map_err(|source| EvalError::Io { path: path.into(), source })
}

fn open(path: &Path) -> Result<(File, ParquetMetaData), EvalError> {
    let io = |source| EvalError::Io { path: path.into(), source };
    let file = File::open(path).map_err(io)?;
    let reader = SerializedFileReader::new(file.try_clone().map_err(io)?);
    let reader = reader.map_err(|source| EvalError::Parquet { path: path.into(), source })?;
    Ok((file, reader.metadata().clone()))
}

/// Whether two files have the same columns.
fn alike(a: &FileMetaData, b: &FileMetaData) -> bool {
    a.schema_descr().root_schema() == b.schema_descr().root_schema()
}

/// Copies all row groups of `file`.
fn copy(file: &File, metadata: &ParquetMetaData, writer: &mut SerializedFileWriter<File>) -> Result<(), ParquetError> {
    for group in metadata.row_groups() {
        let mut to = writer.next_row_group()?;
        for column in group.columns() {
            let close = ColumnCloseResult {
                bytes_written: column.compressed_size() as u64,
                rows_written: group.num_rows() as u64,
                metadata: column.clone(),
                bloom_filter: None,
                column_index: None,
                offset_index: None,
            };
            to.append_column(file, close)?;
        }
        to.close()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use gnp_data::{Dataset, Mode};
    use parquet::record::Field;

    use super::*;
    use crate::predictions::{Detail, read_predictions};

    fn provenance(model: &str) -> Provenance {
        Provenance {
            model: model.to_owned(),
            dataset: Dataset::NGSIM,
            rate_hz: 10.,
            simulated: false,
            uses_future: false,
        }
    }

    fn forecast(start: f32) -> Forecast {
        let mode = |probability, start: f32| Mode {
            probability,
            path: (1..=5).map(|step| [start * step as f32, -0.5]).collect(),
            explanation: None,
        };
        Forecast { modes: vec![mode(0.25, start), mode(0.75, 2. * start)] }
    }

    fn key(vehicle: u32) -> WindowKey {
        WindowKey { recording: "a".to_owned(), vehicle, segment: 0, t0: 30 }
    }

    /// A file of these vehicles, far from the origin of the plane.
    fn write(path: &Path, vehicles: &[u32]) {
        let mut writer = ForecastWriter::create(path, &provenance("m")).unwrap();
        for vehicle in vehicles {
            let of = ForecastOf {
                key: &key(*vehicle),
                vehicle_name: "ego",
                time_s: 1e9 + 0.1,
                past: "filled",
                observed_s: 1.5,
                origin: [100., 2.],
                why: Some(format!("vehicle {vehicle}")),
            };
            let place = |at: [f32; 2]| [5e6 + f64::from(at[1]), f64::from(at[0])];
            writer.write(&of, &forecast(*vehicle as f32), place).unwrap();
        }
        writer.finish().unwrap();
    }

    #[test]
    fn a_file_is_read_and_scored_by_its_window_frame() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f.parquet");
        write(&path, &[3, 7]);
        let read = read_predictions(&path, Detail::Paths).unwrap();
        assert_eq!((read.len(), &read.get(&key(7)).unwrap().forecast), (2, &forecast(7.)));
        let reader = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
        let row = reader.get_row_iter(None).unwrap().next().unwrap().unwrap();
        let of = |name: &str| row.get_column_iter().find(|(found, _)| *found == name).unwrap().1.clone();
        assert_eq!((of("x"), of("y")), (Field::Double(5e6 + 1.5), Field::Double(103.)));
        assert_eq!((of("time_s"), of("vehicle_name")), (Field::Double(1e9 + 0.1), Field::Str("ego".to_owned())));
        assert_eq!((of("why"), of("leader")), (Field::Null, Field::Null));
    }

    #[test]
    fn joined_parts_are_as_one_file_and_strangers_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        write(&path("a"), &[1, 2]);
        write(&path("b"), &[3]);
        write(&path("whole"), &[1, 2, 3]);
        join_forecasts(&[path("a"), path("b")], &path("joined")).unwrap();
        let rows = |name: &str| -> Vec<String> {
            let reader = SerializedFileReader::new(File::open(path(name)).unwrap()).unwrap();
            reader.get_row_iter(None).unwrap().map(|row| row.unwrap().to_string()).collect()
        };
        assert_eq!(rows("joined"), rows("whole"));
        let pairs = |name: &str| open(&path(name)).unwrap().1.file_metadata().key_value_metadata().cloned();
        assert_eq!(pairs("joined"), pairs("whole"));

        let mut other = crate::PredictionWriter::create(&path("other"), &provenance("m")).unwrap();
        other.write(&key(1), [0.; 2], &forecast(1.)).unwrap();
        other.finish().unwrap();
        let error = join_forecasts(&[path("a"), path("other")], &path("new")).unwrap_err();
        assert!(matches!(error, EvalError::OtherColumns { .. }), "{error}");
        assert!(matches!(join_forecasts(&[], &path("new")), Err(EvalError::NoParts { .. })));
        std::fs::write(path("torn"), &std::fs::read(path("a")).unwrap()[..100]).unwrap();
        assert!(matches!(join_forecasts(&[path("torn")], &path("new")), Err(EvalError::Parquet { .. })));
        assert!(!path("new").exists());
    }

    #[test]
    fn lengths_and_times_have_units() {
        for column in forecast_columns() {
            let measured = ["x", "y", "s", "d", "forward", "left", "time_s", "horizon_s", "observed_s", "t0"];
            if measured.contains(&column.name.as_str()) {
                assert!(!column.unit.is_empty(), "{}", column.name);
            }
        }
    }
}
