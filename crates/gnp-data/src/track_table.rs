//! Tracks as a file or a program has them, in any plane, and the one way from them to recordings.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use crate::dataset::Dataset;
use crate::error::{DataError, TrackProblem};
use crate::ingest_report::IngestReport;
use crate::recording::{Recording, VehicleClass};
use crate::track_options::TrackOptions;

mod bodies;
mod build;
mod lanes;
mod layout;
mod road;
mod straight;
mod times;
mod units;

pub use self::bodies::{DEFAULT_SIZES, VehicleWord};
pub use self::layout::TrackLayout;
pub use self::straight::{MAX_TURN_DEGREES, MAX_TURN_OF_FEW_DEGREES};

/// Tracks by column, a row for a vehicle and a moment, in any order and any right-handed plane (x to the right, y up).
///
/// What a column does not say is found or assumed, and the report says so: see [`TrackTable::recordings`]. Messages
/// name rows as [`TrackTable::places`] says.
///
/// ```
/// use gnp_data::{Dataset, TrackOptions, TrackTable};
///
/// let mut tracks = TrackTable::new(Dataset::TRACKS, "A 9", "monday");
/// let names: Vec<&str> = (0..20).flat_map(|_| ["ego", "truck"]).collect();
/// tracks.set_names(names.iter().copied());
/// tracks.time_s = (0..40).map(|row| 0.1 * f64::from(row / 2)).collect();
/// tracks.x = tracks.time_s.iter().zip(&names).map(|(t, name)| if *name == "ego" { 30. * t } else { 40. + 22. * t }).collect();
/// tracks.y = names.iter().map(|name| if *name == "ego" { 3.6 } else { 0. }).collect();
/// let (recording, report) = tracks.recordings(&TrackOptions::default())?.remove(0);
/// assert_eq!((recording.meta().rate_hz, report.vehicles), (10., 2));
/// assert_eq!(recording.vehicle_name(2), "truck");
/// # Ok::<(), gnp_data::DataError>(())
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TrackTable {
    /// Data family of the recordings.
    pub dataset: Dataset,
    /// Site of the recordings.
    pub site: String,
    /// Name of the recording.
    pub name: String,
    /// Made by a simulator.
    pub simulated: bool,
    /// The vehicles, in the order in which numbers are given to them.
    pub vehicles: Vec<TableVehicle>,
    /// Index in [`TrackTable::vehicles`] of each row.
    pub vehicle: Vec<u32>,
    /// Time, s.
    pub time_s: Vec<f64>,
    /// Centre of the box, m.
    pub x: Vec<f64>,
    /// Centre of the box, m.
    pub y: Vec<f64>,
    /// Velocity in the plane, m/s; not taken unless all of it is finite.
    pub velocity: Option<[Vec<f64>; 2]>,
    /// Speed, m/s: a velocity together with `heading`; NaN where unknown.
    pub speed: Option<Vec<f64>>,
    /// Direction of the vehicle, rad, anticlockwise from the x axis; NaN where unknown.
    pub heading: Option<Vec<f64>>,
    /// Lane number; 0 or less where unknown.
    pub lane: Option<Vec<i16>>,
    /// From where lanes are counted.
    pub lane_numbers: LaneNumbers,
    /// Where the rows stand, for messages.
    pub places: RowPlaces,
    /// Names of columns in the file, where they are others than those here: `x` is called `position_x`.
    pub columns: BTreeMap<&'static str, String>,
    /// Rows of the file that are not in the table, by reason.
    pub skipped_rows: BTreeMap<String, u64>,
    /// Anything that the report should say.
    pub notes: Vec<String>,
}

/// A vehicle of a [`TrackTable`].
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct TableVehicle {
    /// Name in the data, unique in the table.
    pub name: String,
    /// Kind of vehicle; told from the length where `None`.
    pub class: Option<VehicleClass>,
    /// Length, m; that of its class where `None`: see [`DEFAULT_SIZES`].
    pub length: Option<f32>,
    /// Width, m.
    pub width: Option<f32>,
    /// Why it is not read, such as `are of class pedestrian`: it is counted and left out.
    pub left_out: Option<String>,
}

impl TableVehicle {
    /// A vehicle of which nothing is known but its name.
    #[must_use]
    pub fn named(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }
}

/// From where lanes are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LaneNumbers {
    /// 1 is the leftmost in the direction of travel.
    #[default]
    FromLeft,
    /// 1 is the rightmost.
    FromRight,
}

/// Where the rows of a table stand.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum RowPlaces {
    /// A program's own rows, the first being 0.
    #[default]
    Program,
    /// Rows of a file without lines; the first of the table is row `first` of the file, which counts from 0.
    Rows {
        /// The file.
        file: PathBuf,
        /// Row of the file that the table begins with.
        first: u64,
    },
    /// Lines of a text with a header; the first row of the table is data row `first` of the file, from 0. The line is
    /// found by reading the file again.
    Lines {
        /// The file.
        file: PathBuf,
        /// Data row of the file that the table begins with.
        first: u64,
    },
    /// Each row has a number of its own, such as a line.
    Numbers {
        /// The file.
        file: PathBuf,
        /// What is numbered: `line`.
        what: &'static str,
        /// The number of each row.
        numbers: Vec<u64>,
    },
}

impl TrackTable {
    /// A table without rows.
    #[must_use]
    pub fn new(dataset: Dataset, site: impl Into<String>, name: impl Into<String>) -> Self {
        Self {
            dataset,
            site: site.into(),
            name: name.into(),
            simulated: false,
            vehicles: Vec::new(),
            vehicle: Vec::new(),
            time_s: Vec::new(),
            x: Vec::new(),
            y: Vec::new(),
            velocity: None,
            speed: None,
            heading: None,
            lane: None,
            lane_numbers: LaneNumbers::FromLeft,
            places: RowPlaces::Program,
            columns: BTreeMap::new(),
            skipped_rows: BTreeMap::new(),
            notes: Vec::new(),
        }
    }

    /// Sets the vehicle of every row by its name; vehicles come in the order in which they appear.
    pub fn set_names<'a>(&mut self, names: impl IntoIterator<Item = &'a str>) {
        let mut known: HashMap<&str, u32> = HashMap::new();
        self.vehicles.clear();
        self.vehicle.clear();
        for name in names {
            let next = known.len() as u32;
            let index = *known.entry(name).or_insert(next);
            if index == next {
                self.vehicles.push(TableVehicle::named(name));
            }
            self.vehicle.push(index);
        }
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.vehicle.len()
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.vehicle.is_empty()
    }

    /// The recordings that these tracks make, with a report on each; one, unless there is nothing in common.
    ///
    /// - Times must be uniform to 1 ms. A lower rate that is asked for is made by leaving out frames, such that the last
    ///   one stays; nothing is interpolated. Frame 0 is the first moment, whose time is
    ///   [`RecordingMeta::start_s`](crate::RecordingMeta::start_s).
    /// - Vehicles whose names are all whole numbers of 32 bits keep them; otherwise they are numbered from 1 in the order
    ///   of appearance, and [`Recording::vehicle_name`] gives the name.
    /// - x runs along the road: the line given, or straight in the median direction of travel; y to the left. Who drives
    ///   the other way is on a carriageway of its own.
    /// - Lane lines are those given, or fitted from lane numbers (which may count from either side), or found from where
    ///   vehicles drive; where none are found a carriageway has edges alone, and neighbours are told by strips of equal
    ///   width.
    /// - What is not known of a vehicle's size is assumed by its class ([`DEFAULT_SIZES`]) and counted.
    ///
    /// # Errors
    /// [`DataError::Tracks`], with its [`TrackProblem`] and the place of the first row where it shows: no rows, values
    /// that cannot be, times that are not uniform, units that are not m and s, a road that is not straight, columns that
    /// contradict one another. [`DataError::WindowRate`] for a rate that whole steps do not give. As
    /// [`Recording::from_rows`].
    pub fn recordings(&self, options: &TrackOptions) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        let (layout, placed) = TrackLayout::of(self, options)?;
        Ok(vec![layout.build(self, placed)?])
    }

    /// What [`TrackTable::recordings`] finds in these tracks, for reading other parts of them alike. It should be found in
    /// a table that has every vehicle.
    ///
    /// # Errors
    /// As [`TrackTable::recordings`].
    pub fn layout(&self, options: &TrackOptions) -> Result<TrackLayout, DataError> {
        TrackLayout::of(self, options).map(|(layout, _)| layout)
    }

    /// What a column is called where the table comes from.
    pub(crate) fn column<'a>(&'a self, name: &'a str) -> &'a str {
        self.columns.get(name).map_or(name, String::as_str)
    }

    /// Where the table comes from.
    pub(crate) fn place(&self) -> String {
        match &self.places {
            RowPlaces::Program => format!("tracks {}", self.name),
            RowPlaces::Rows { file, .. } | RowPlaces::Lines { file, .. } | RowPlaces::Numbers { file, .. } => {
                file.display().to_string()
            }
        }
    }

    /// Where a row stands.
    fn place_of(&self, row: usize) -> String {
        let place = self.place();
        match &self.places {
            RowPlaces::Program => format!("{place}, row {row}"),
            RowPlaces::Rows { first, .. } => format!("{place}, row {}", first + row as u64),
            RowPlaces::Lines { file, first } => match crate::formats::line_of(file, row + *first as usize) {
                Ok(line) => format!("{place}, line {line}"),
                Err(_) => format!("{place}, data row {}", first + row as u64),
            },
            RowPlaces::Numbers { what, numbers, .. } => match numbers.get(row) {
                Some(number) => format!("{place}, {what} {number}"),
                None => place,
            },
        }
    }

    /// An error about `row`, in `column` where that tells more.
    pub(crate) fn wrong(
        &self,
        problem: TrackProblem,
        row: Option<usize>,
        column: Option<&str>,
        what: String,
        remedy: impl Into<String>,
    ) -> DataError {
        let mut place = row.map_or_else(|| self.place(), |row| self.place_of(row));
        if let Some(column) = column {
            place += &format!(", column `{}`", self.column(column));
        }
        DataError::Tracks { problem, place, row, what, remedy: remedy.into() }
    }

    /// Name of a vehicle for a message, whatever its length.
    fn name_of(&self, vehicle: u32) -> String {
        let name = self.vehicles.get(vehicle as usize).map_or("", |vehicle| vehicle.name.as_str());
        gnp_file::excerpt(name, 60)
    }

    /// Refuses columns of different lengths and values that cannot be.
    fn check(&self) -> Result<(), DataError> {
        let rows = self.len();
        let wrong =
            |problem, row, column, what: String, remedy: &str| Err(self.wrong(problem, row, column, what, remedy));
        let velocity = self.velocity.iter().flatten();
        let optional =
            velocity.chain(&self.speed).chain(&self.heading).map(Vec::len).chain(self.lane.as_ref().map(Vec::len));
        let lengths: Vec<usize> = [&self.time_s, &self.x, &self.y].into_iter().map(Vec::len).chain(optional).collect();
        if lengths.iter().any(|n| *n != rows) {
            let what = format!("columns have {lengths:?} rows where there are {rows} ids");
            return wrong(TrackProblem::Columns, None, None, what, "give columns of one length");
        }
        if let Some(row) = self.vehicle.iter().position(|vehicle| *vehicle as usize >= self.vehicles.len()) {
            let what = format!("vehicle {} of {} does not exist", self.vehicle[row], self.vehicles.len());
            return wrong(TrackProblem::Columns, Some(row), None, what, "give indices of vehicles");
        }
        if rows == 0 {
            let remedy = "give a row for each vehicle and moment";
            return wrong(TrackProblem::Empty, None, None, "there are no tracks".to_owned(), remedy);
        }
        if rows >= u32::MAX as usize {
            let what = format!("{rows} rows are more than a recording may have");
            return wrong(TrackProblem::Columns, None, None, what, "cut the tracks into several");
        }
        for (name, column) in [("time", &self.time_s), ("x", &self.x), ("y", &self.y)] {
            if let Some(row) = column.iter().position(|value| !value.is_finite() || value.abs() > LARGEST) {
                let what = format!("{} is no number that can be", column[row]);
                return wrong(TrackProblem::Value, Some(row), Some(name), what, "repair the value or remove the row");
            }
        }
        Ok(())
    }
}

/// Largest value of a coordinate, m, or a time, s: no projection and no clock goes further.
const LARGEST: f64 = 1e11;
