//! Argoverse 2 motion forecasting: one Parquet file a scenario of 11 s at 10 Hz from streets of American cities, in m.

use std::ops::ControlFlow;
use std::path::Path;

use super::parquet_columns::{Cells, ParquetTable, is_parquet};
use super::words::Words;
use crate::dataset::Dataset;
use crate::error::{DataError, TrackProblem};
use crate::format::{Format, Source};
use crate::ingest_report::IngestReport;
use crate::recording::{Recording, VehicleClass};
use crate::schema::{Column, Schema, TableSchema};
use crate::track_options::TrackOptions;
use crate::track_table::{RowPlaces, TableVehicle, TrackTable};
use crate::tracks::{TrackFile, Tracks};
use crate::write::{self, Written};

/// The format.
pub(super) struct Argoverse;

/// Frames per second.
const RATE: f64 = 10.;

/// Columns that are described.
const READ: [Column; 11] = [
    Column::new("track_id", "-", "vehicle; AV is the one that recorded"),
    Column::new("object_type", "-", "vehicle, bus and motorcyclist are read, others are counted and left out"),
    Column::new("timestep", "0.1 s", "from 0 to 109"),
    Column::new("position_x", "m", "centre of the box, in the coordinates of the city"),
    Column::new("position_y", "m", "centre of the box"),
    Column::new("heading", "rad", "direction, anticlockwise from x"),
    Column::new("velocity_x", "m/s", "velocity"),
    Column::new("velocity_y", "m/s", "velocity"),
    Column::new("city", "-", "site, where the file has it"),
    Column::new("focal_track_id", "-", "the vehicle that the scenario is about, for a note"),
    Column::new("observed, object_category", "-", "not read: all 11 s are"),
];

/// Columns that tell a scenario from any other table.
const KNOWN: [&str; 5] = ["track_id", "object_type", "timestep", "position_x", "position_y"];

/// Object types that are read.
const CLASSES: [(&str, VehicleClass); 3] =
    [("vehicle", VehicleClass::Car), ("bus", VehicleClass::Truck), ("motorcyclist", VehicleClass::Motorcycle)];

impl Format for Argoverse {
    fn dataset(&self) -> Dataset {
        Dataset::AV2
    }

    fn title(&self) -> &str {
        "Argoverse 2"
    }

    fn rate_hz(&self) -> f64 {
        RATE
    }

    fn files(&self) -> &str {
        "scenarios of motion forecasting (scenario_*.parquet)"
    }

    fn schema(&self) -> Schema {
        Schema::new(
            "Argoverse 2 motion forecasting: one Parquet file a scenario, scenario_ID.parquet.\n\
             Rate: 10 frames per second; frame 0 is timestep 0.\n",
            vec![TableSchema::new("Columns read", &READ)],
            "The road is taken for straight, in the median direction of travel; most scenarios are of junctions and are refused \
             for that, unless the line of the road is given (--road). The files have no sizes: those of the class are taken, \
             2.2 m x 0.8 m, 4.8 m x 1.8 m, 12 m x 2.5 m. Lane lines are those given, or found from where vehicles drive; the \
             map beside a scenario is not read.\n",
        )
    }

    fn extensions(&self) -> &[&str] {
        &["parquet"]
    }

    fn recognise(&self, file: &Path) -> Result<bool, DataError> {
        if !is_parquet(file)? {
            return Ok(false);
        }
        let table = ParquetTable::open(file)?;
        Ok(KNOWN.iter().all(|name| table.place(name).is_some()))
    }

    fn read(&self, source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        self.read_with(source, &TrackOptions { rate_hz, ..TrackOptions::default() })
    }

    fn read_with(&self, source: &Source, options: &TrackOptions) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        table(source)?.recordings(options)
    }

    fn track_file(&self, source: &Source) -> Result<Option<Box<dyn TrackFile>>, DataError> {
        Ok(Some(Box::new(Scenario { source: source.clone() })))
    }

    fn written_as(&self) -> &[&str] {
        &[""]
    }

    fn write(&self, tracks: &Tracks, _: &TrackOptions, to: &Path) -> Result<Written, DataError> {
        write::argoverse::write(&tracks.table(), to)
    }
}

/// A scenario, which is small: one table.
struct Scenario {
    source: Source,
}

impl TrackFile for Scenario {
    fn tables(
        &self,
        _: usize,
        take: &mut dyn FnMut(TrackTable) -> Result<ControlFlow<()>, DataError>,
    ) -> Result<(), DataError> {
        take(table(&self.source)?).map(drop)
    }
}

/// The tracks of a scenario.
fn table(source: &Source) -> Result<TrackTable, DataError> {
    let file = source.file()?;
    if !is_parquet(file)? {
        let (folder, expected) = (file.into(), Argoverse.files().to_owned());
        return Err(DataError::NoRecordings { folder, expected, seen: "a file of another kind".to_owned() });
    }
    let parquet = ParquetTable::open(file)?;
    let number = |name| parquet.want(name, ParquetTable::number);
    let text = |name| parquet.want(name, ParquetTable::text);
    let mut columns = vec![text("track_id")?, text("object_type")?];
    for name in ["timestep", "position_x", "position_y", "heading", "velocity_x", "velocity_y"] {
        columns.push(number(name)?);
    }
    let about: Vec<&str> =
        ["city", "focal_track_id"].into_iter().filter(|name| parquet.place(name).is_some()).collect();
    for name in &about {
        columns.push(text(name)?);
    }
    let mut all: Option<TrackTable> = None;
    for group in 0..parquet.groups() {
        let first = all.as_ref().map_or(0, TrackTable::len) as u64;
        let places = RowPlaces::Rows { file: file.into(), first };
        let part = part(source, places, parquet.read(group, &columns)?, &about)?;
        match &mut all {
            Some(all) => all.append(part),
            None => all = Some(part),
        }
    }
    all.ok_or_else(|| DataError::Empty { file: file.into() })
}

/// The tracks of a group of rows.
fn part(source: &Source, places: RowPlaces, cells: Vec<Cells>, about: &[&str]) -> Result<TrackTable, DataError> {
    let mut cells = cells.into_iter();
    let mut words = || cells.next().map_or_else(Words::default, Cells::text);
    let (id, class) = (words(), words());
    let mut numbers = || cells.next().map_or_else(Vec::new, Cells::number);
    let [timestep, x, y, heading, vx, vy] = std::array::from_fn(|_| numbers());
    // Of the whole scenario, in every row.
    let said: Vec<Option<String>> =
        cells.map(|cells| cells.text().list.into_iter().find(|word| !word.is_empty())).collect();
    let said = |name: &str| about.iter().position(|have| *have == name).and_then(|i| said.get(i)?.as_deref());

    let site = said("city").or(source.site.as_deref()).unwrap_or("av2").to_lowercase();
    let mut table = TrackTable::new(source.dataset, gnp_file::excerpt(&site, 60), &source.name);
    table.simulated = source.simulated;
    table.places = places;
    for (name, called) in [("id", "track_id"), ("time", "timestep"), ("x", "position_x"), ("y", "position_y")] {
        table.columns.insert(name, called.to_owned());
    }
    table.columns.insert("vx", "velocity_x".to_owned());
    table.vehicles = id.list.into_iter().map(TableVehicle::named).collect();
    table.vehicle = id.codes;
    if let Some(row) = timestep.iter().position(|step| step.fract() != 0. || step.abs() > 1e9) {
        let what = format!("{} is no number of a frame", timestep[row]);
        let remedy = "take the original file";
        return Err(table.wrong(TrackProblem::Value, Some(row), Some("time"), what, remedy));
    }
    table.time_s = timestep.into_iter().map(|step| step / RATE).collect();
    (table.x, table.y, table.heading, table.velocity) = (x, y, Some(heading), Some([vx, vy]));
    for (vehicle, word) in table.vehicle.iter().zip(class.iter()) {
        let Some(vehicle) = table.vehicles.get_mut(*vehicle as usize) else { continue };
        match CLASSES.iter().find(|(known, _)| *known == word) {
            Some((_, class)) => vehicle.class = Some(*class),
            None => vehicle.left_out = Some(format!("are of class {}", gnp_file::excerpt(word, 30))),
        }
    }
    table.notes.clone_from(&source.notes);
    table.notes.extend(
        said("focal_track_id").map(|id| format!("the scenario is about vehicle {}", gnp_file::excerpt(id, 60))),
    );
    Ok(table)
}
