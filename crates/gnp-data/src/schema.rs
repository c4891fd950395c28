//! What a format's files hold and what comes out: columns, units, conventions, as text.

use std::fmt::Write as _;

use crate::format::Format;

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Column {
    /// Its name.
    pub name: &'static str,
    /// Its unit; `-` for none.
    pub unit: &'static str,
    /// What it means.
    pub meaning: &'static str,
}

impl Column {
    /// A column.
    #[must_use]
    pub const fn new(name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self { name, unit, meaning }
    }
}

/// A table of a format.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct TableSchema {
    /// Heading, such as `Columns read of NN_tracks.csv`.
    pub title: &'static str,
    /// The columns that are read.
    pub columns: &'static [Column],
}

impl TableSchema {
    /// A table.
    #[must_use]
    pub const fn new(title: &'static str, columns: &'static [Column]) -> Self {
        Self { title, columns }
    }
}

/// The description of a format.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Schema {
    /// Which files, and at what rate: a line or a few, each ended by a newline.
    pub about: &'static str,
    /// Their tables.
    pub tables: Vec<TableSchema>,
    /// What is done to the values, in lines ended by newlines.
    pub conversion: &'static str,
}

impl Schema {
    /// A description.
    #[must_use]
    pub fn new(about: &'static str, tables: Vec<TableSchema>, conversion: &'static str) -> Self {
        Self { about, tables, conversion }
    }
}

/// Columns of a recording, whatever it was read from.
const RECORDING: [Column; 10] = [
    Column::new("vehicle", "-", "vehicle of the file"),
    Column::new("segment", "-", "gap-free stretch of the vehicle, from 0"),
    Column::new("frame", "1/rate_hz s", "frame of the file"),
    Column::new("x", "m", "centre of the box, forward along the road"),
    Column::new("y", "m", "centre of the box, to the left of travel"),
    Column::new("vx", "m/s", "velocity forward"),
    Column::new("vy", "m/s", "velocity to the left"),
    Column::new("length, width", "m", "extent of the box along and across the road"),
    Column::new("lane", "-", "lane of the file, 0 unknown"),
    Column::new(
        "neighbours",
        "-",
        "tracks in the eight slots: preceding, following, left and right preceding, alongside, following",
    ),
];

/// The columns that are read of a format's files, those of the recording they become, and their units.
#[must_use]
pub fn describe(format: &dyn Format) -> String {
    let schema = format.schema();
    let mut text = schema.about.to_owned();
    for of in &schema.tables {
        table(&mut text, of.title, of.columns);
    }
    // Writing to a String cannot fail.
    let _ = write!(text, "\n{}", schema.conversion);
    table(&mut text, "Columns of the recording", &RECORDING);
    text
}

fn table(text: &mut String, title: &str, columns: &[Column]) {
    let name = columns.iter().map(|column| column.name.len()).max().unwrap_or(0);
    let unit = columns.iter().map(|column| column.unit.len()).max().unwrap_or(0);
    let _ = writeln!(text, "\n{title}");
    for column in columns {
        let _ = writeln!(text, "  {:name$}  {:unit$}  {}", column.name, column.unit, column.meaning);
    }
}
