//! A format of another crate: found, read and cut into windows like those of this one.

#![allow(clippy::unwrap_used)] // also outside the test functions

use std::path::{Path, PathBuf};

use gnp_data::schema::{Column, Schema, TableSchema, describe};
use gnp_data::{
    DataError, Dataset, FORMATS, Format, IngestReport, Recording, RecordingMeta, Road, Rows, Slot, Source, VehicleBody,
    VehicleClass, WindowConfig, WindowSet, check_rate, discover_with, fit_lanes, format_of,
};

/// A made-up dataset: one file a recording, `time;car;lane;km;offset_cm`, 10 rows a second.
struct MadeUp;

const HEADER: &str = "time;car;lane;km;offset_cm";

const COLUMNS: [Column; 5] = [
    Column::new("time", "s", "time"),
    Column::new("car", "-", "vehicle"),
    Column::new("lane", "-", "lane, 1 leftmost"),
    Column::new("km", "km", "rear of the vehicle, along the road"),
    Column::new("offset_cm", "cm", "centre, from the left edge to the right"),
];

impl MadeUp {
    fn text(file: &Path) -> Result<String, DataError> {
        std::fs::read_to_string(file).map_err(|source| DataError::Io { file: file.into(), source })
    }
}

impl Format for MadeUp {
    fn dataset(&self) -> Dataset {
        "made-up".parse().unwrap()
    }

    fn title(&self) -> &str {
        "Made Up"
    }

    fn rate_hz(&self) -> f64 {
        10.
    }

    fn files(&self) -> &str {
        "files *.cars"
    }

    fn schema(&self) -> Schema {
        Schema::new("Made Up: one file a recording.\n", vec![TableSchema::new("Columns", &COLUMNS)], "Kilometres.\n")
    }

    fn extensions(&self) -> &[&str] {
        &["cars"]
    }

    fn recognise(&self, file: &Path) -> Result<bool, DataError> {
        Ok(Self::text(file)?.starts_with(HEADER))
    }

    fn site(&self, _file: &Path) -> Option<String> {
        Some("nowhere".to_owned())
    }

    fn read(&self, source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        let file = source.file()?;
        check_rate(file, &source.name, self.rate_hz(), rate_hz)?;
        let text = Self::text(file)?;
        let mut columns: [Vec<f32>; 5] = Default::default();
        for (line, row) in (2..).zip(text.lines().skip(1)) {
            for (name, (column, value)) in HEADER.split(';').zip(columns.iter_mut().zip(row.split(';'))) {
                column.push(value.parse().map_err(|_| DataError::Value {
                    file: file.into(),
                    line,
                    column: name.to_owned(),
                    value: value.to_owned(),
                    reason: "is not a number; repair it".to_owned(),
                })?);
            }
        }
        let [time, car, lane, km, offset] = columns;
        let frame = time.iter().map(|time| (time * 10.).round() as u32).collect();
        let vehicle = car.iter().map(|car| *car as u32).collect();
        let x = km.iter().map(|km| km * 1000. + 2.).collect();
        let y: Vec<f32> = offset.iter().map(|offset| -offset / 100.).collect();
        let lane: Vec<i16> = lane.iter().map(|lane| *lane as i16).collect();
        let road = Road { driving_direction: 2, lines: fit_lanes(&lane, &y).lines, fitted: true, axis: None };
        let mut rows = Rows::new(vehicle, frame, x, y);
        rows.lane = lane;
        let site = source.site.clone().unwrap_or_default();
        let meta = RecordingMeta::new(self.dataset(), site, &source.name, 10.).with_simulated(source.simulated);
        let body = |_: usize| VehicleBody { class: VehicleClass::Truck, length: 4., width: 2., road: 0 };
        Ok(vec![Recording::from_rows(meta, vec![road], rows, body)?])
    }
}

fn put(folder: &Path, name: &str, text: &str) -> PathBuf {
    let file = folder.join(name);
    std::fs::write(&file, text).unwrap();
    file
}

/// Two cars in two lanes for 9 s, car 2 to the right of car 1.
fn text() -> String {
    let row = |i: i32, car: i32| {
        let km = f64::from(i) * 0.0025 + 0.001 * f64::from(car);
        format!("{:.1};{car};{car};{km:.5};{}\n", f64::from(i) / 10., 350 * car - 175)
    };
    let rows: String = (0..90).flat_map(|i| [row(i, 1), row(i, 2)]).collect();
    format!("{HEADER}\n{rows}")
}

fn windows() -> WindowConfig {
    WindowConfig { observed_s: 3., predicted_s: 5., rate_hz: 10., stride_s: 0.5, site_stride_s: Default::default() }
}

#[test]
fn a_format_of_another_crate_gives_windows() {
    let folder = tempfile::tempdir().unwrap();
    put(folder.path(), "monday.cars", &text());
    put(folder.path(), "notes.cars", "rain\n");
    put(folder.path(), "other.csv", &text());
    let format: &dyn Format = &MadeUp;
    let sources = discover_with(folder.path(), format).unwrap();
    let [source] = &sources[..] else { panic!("{sources:?}") };
    assert_eq!((source.name.as_str(), source.site.as_deref(), source.simulated), ("monday", Some("nowhere"), false));
    let (recording, report) = format.read(source, Some(10.)).unwrap().remove(0);
    assert_eq!((report.rows_read, report.vehicles, report.dataset.as_str()), (180, 2, "made-up"));
    let recordings = [recording];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    assert_eq!(set.len(), 4);
    let window = set.iter().next().unwrap();
    let observation = window.observation();
    let state = observation.target(30);
    assert!((state.vx - 25.).abs() < 0.02 && state.y == 0., "{state:?}");
    assert!((window.truth().goal()[0] - 125.).abs() < 0.02);
    assert_eq!(observation.neighbour(Slot::RightAlongside).unwrap().vehicle(), 2);
    assert_eq!(observation.lines().count(), 3);
    // The dataset goes along into files.
    let file = folder.path().join("kept.rec");
    recordings[0].save(&file).unwrap();
    assert_eq!(Recording::load(&file).unwrap().meta(), recordings[0].meta());
}

#[test]
fn its_errors_are_those_of_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "a.cars", &text().replace("0.7;2", "0.7;two"));
    let source = &discover_with(&file, &MadeUp).unwrap()[0];
    let error = MadeUp.read(source, None).unwrap_err().to_string();
    assert!(error.contains("a.cars, line 17, column `car`"), "{error}");
    assert!(matches!(MadeUp.read(source, Some(25.)), Err(DataError::Rate { found_hz: 10., .. })));
    std::fs::remove_file(&file).unwrap();
    let error = discover_with(folder.path(), &MadeUp).unwrap_err().to_string();
    assert!(error.contains("files *.cars"), "{error}");
    let error = format_of(MadeUp.dataset()).err().unwrap().to_string();
    assert!(error.contains("made-up"), "{error}");
}

#[test]
fn descriptions_name_columns_and_units() {
    let text = describe(&MadeUp);
    for column in ["km         km", "offset_cm  cm", "neighbours"] {
        assert!(text.contains(column), "{column}:\n{text}");
    }
    let names: Vec<&str> = FORMATS.iter().map(|format| format.title()).collect();
    assert_eq!(
        names,
        if cfg!(feature = "readers") {
            &["NGSIM", "highD", "Plain tracks", "Argoverse 2", "SUMO FCD"][..]
        } else {
            &[]
        }
    );
    for format in FORMATS {
        assert!(describe(*format).starts_with(format.title()) && format.rate_hz() > 0.);
        assert_eq!(format_of(format.dataset()).unwrap().title(), format.title());
    }
}
