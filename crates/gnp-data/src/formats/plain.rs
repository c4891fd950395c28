//! Plain tracks: any table with an id, a time and a position, the format that everybody can write.

use std::ops::ControlFlow;
use std::path::Path;

use self::columns::Found;
use super::parquet_columns::{ParquetTable, is_parquet};
use super::table::sniff::{Head, Separator};
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::format::{Format, Source};
use crate::ingest_report::IngestReport;
use crate::recording::Recording;
use crate::schema::{Column, Schema, TableSchema};
use crate::track_options::TrackOptions;
use crate::track_table::TrackTable;
use crate::tracks::{TrackFile, Tracks, whole};
use crate::write::{self, Written};

mod columns;
mod rows;

/// The format.
pub(super) struct Plain;

/// Columns that are described.
const READ: [Column; 12] = [
    Column::new("id", "-", "vehicle: any text or number; also track_id, vehicle_id, vehicle, agent_id"),
    Column::new("time", "s", "uniform to 1 ms; also t, time_s, timestamp; time_ms, timestamp_ms in ms"),
    Column::new("x", "m", "centre of the box in any plane, x to the right; also x_m, pos_x, position_x"),
    Column::new("y", "m", "centre of the box, y up; also y_m, pos_y, position_y"),
    Column::new(
        "heading",
        "rad",
        "direction, anticlockwise from x; also yaw, psi_rad; heading_deg, yaw_deg in degrees",
    ),
    Column::new("speed", "m/s", "along the heading; also v"),
    Column::new("vx, vy", "m/s", "velocity along x and y, instead of speed; also velocity_x, velocity_y"),
    Column::new("length", "m", "of the vehicle"),
    Column::new("width", "m", "of the vehicle"),
    Column::new("lane", "-", "number, counted from the left or from the right; also lane_id; 0 unknown"),
    Column::new("class", "-", "car, truck, bus, motorcycle ...; also type, object_type, vehicle_class, agent_type"),
    Column::new("(other)", "-", "not read"),
];

impl Format for Plain {
    fn dataset(&self) -> Dataset {
        Dataset::TRACKS
    }

    fn title(&self) -> &str {
        "Plain tracks"
    }

    /// That of many cameras; any other is found in the times.
    fn rate_hz(&self) -> f64 {
        10.
    }

    fn files(&self) -> &str {
        "tables (.csv, .txt or .parquet, text plain or .gz) with the columns id, time, x and y"
    }

    fn schema(&self) -> Schema {
        Schema::new(
            "Plain tracks: one table a recording, a row for a vehicle and moment, in any order: text with commas (or blanks) and \
             a header, plain or .gz, or Parquet (uncompressed or snappy). id, time, x and y must be there, the other columns \
             need not; upper and lower case are the same.\n\
             Rate: any; it is found in the times. A lower one is made by leaving out frames.\n",
            vec![TableSchema::new("Columns read", &READ)],
            "The road is taken for straight, in the median direction of travel, and refused where it turns by more than 5 \
             degrees, unless its line is given (--road). Who drives the other way is on a carriageway of their own. Lane lines \
             are those given, or fitted from lane numbers, or found from where vehicles drive. Sizes that are not known are \
             those of the class: 2.2 m x 0.8 m, 4.8 m x 1.8 m, 12 m x 2.5 m. Velocities are those given, or derived.\n",
        )
    }

    fn extensions(&self) -> &[&str] {
        &["csv", "txt", "parquet"]
    }

    fn recognise(&self, file: &Path) -> Result<bool, DataError> {
        if is_parquet(file)? {
            return Ok(Found::among(file, ParquetTable::open(file)?.names())?.is_some());
        }
        let head = Head::read(file)?.ok_or_else(|| DataError::Empty { file: file.into() })?;
        let (header, _) = head.header(&columns::names());
        let found = Found::among(file, &header.names)?;
        match header.separator {
            Separator::Other(separator) if found.is_some() => {
                Err(DataError::Delimiter { file: file.into(), found: separator, expected: "commas" })
            }
            _ => Ok(found.is_some()),
        }
    }

    fn read(&self, source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        self.read_with(source, &TrackOptions { rate_hz, ..TrackOptions::default() })
    }

    fn read_with(&self, source: &Source, options: &TrackOptions) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        let table = whole(&Tables { source: source.clone() }, source)?;
        table.recordings(options)
    }

    fn track_file(&self, source: &Source) -> Result<Option<Box<dyn TrackFile>>, DataError> {
        Ok(Some(Box::new(Tables { source: source.clone() })))
    }

    fn written_as(&self) -> &[&str] {
        &[".csv", ".parquet"]
    }

    fn write(&self, tracks: &Tracks, _: &TrackOptions, to: &Path) -> Result<Written, DataError> {
        write::plain::write(&tracks.table(), to)
    }
}

/// The rows of a source, by blocks of a text or groups of rows of Parquet, whatever number is asked for.
struct Tables {
    source: Source,
}

impl TrackFile for Tables {
    fn tables(
        &self,
        _: usize,
        take: &mut dyn FnMut(TrackTable) -> Result<ControlFlow<()>, DataError>,
    ) -> Result<(), DataError> {
        rows::read(&self.source, take)
    }
}
