//! Files of roads: polylines as CSV and GeoJSON, and OpenDRIVE.

use std::path::{Path, PathBuf};

use crate::error::LineError;
use crate::geojson;
use crate::lane_lines::{LaneLinesError, check_lane_lines, parse_lane_lines};
use crate::line::ReferenceLine;
use crate::opendrive;
use crate::plane::Vector;

/// Largest file, bytes: a million points have a hundredth of it.
const MAX_BYTES: u64 = 1 << 30;

/// A road as a file describes it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RoadFile {
    /// The reference line, in the direction of travel, in the plane of the file, m.
    pub line: ReferenceLine,
    /// Where lane lines lie beside it, from right to left, m, positive to the left; the outer two are the edges of the
    /// carriageway. `None` where the file does not say.
    pub lane_lines: Option<Vec<f64>>,
}

/// A file of a road that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RoadFileError {
    /// The file cannot be opened or read.
    #[error("{}: cannot be read", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// What stands in it is no road.
    #[error("{}{}: {reason}", file.display(), line.map(|line| format!(", line {line}")).unwrap_or_default())]
    Content {
        /// The file.
        file: PathBuf,
        /// The line of the text, from 1, where it is known.
        line: Option<usize>,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// Its points make no line.
    #[error("{}{}: no reference line", file.display(), line.map(|line| format!(", line {line}")).unwrap_or_default())]
    Line {
        /// The file.
        file: PathBuf,
        /// The line of the text, from 1, on which the point stands, where it is known.
        line: Option<usize>,
        /// What is wrong with the points.
        source: LineError,
    },
    /// Its lane lines make no lanes.
    #[error("{}: no lane lines", file.display())]
    LaneLines {
        /// The file.
        file: PathBuf,
        /// What is wrong with them.
        source: LaneLinesError,
    },
}

/// What a file says, before it is believed.
#[derive(Debug, Default)]
pub(crate) struct Content {
    pub(crate) points: Vec<Vector>,
    /// Line of the text on which each point stands; empty where that is not known.
    pub(crate) text_lines: Vec<usize>,
    pub(crate) lane_lines: Option<Vec<f64>>,
}

/// What is wrong with a file, and on which line of its text.
pub(crate) struct Wrong {
    pub(crate) line: Option<usize>,
    pub(crate) reason: String,
}

impl Wrong {
    pub(crate) fn new(reason: impl Into<String>) -> Self {
        Self { line: None, reason: reason.into() }
    }

    fn at(line: usize, reason: impl Into<String>) -> Self {
        Self { line: Some(line), reason: reason.into() }
    }
}

impl RoadFile {
    /// Reads a road, in m, in the coordinates of the tracks and in the direction of travel:
    ///
    /// - CSV: columns `x` and `y` (or `easting` and `northing`), separated by commas, semicolons or blanks; others are
    ///   passed over. Without a header the first two columns. Lines that begin with `#` are comments, but for
    ///   `# lane lines: -3.7, 0, 3.7`.
    /// - GeoJSON: one `LineString`, alone, as a feature or in a collection, in projected coordinates; a property
    ///   `lane_lines` of the feature, `[-3.7, 0, 3.7]`.
    /// - OpenDRIVE: the reference line of the only road, of `FILE#ID`, or of several one after the other, `FILE#ID,ID`; with
    ///   lane lines where lanes have the same widths all along.
    ///
    /// # Errors
    /// [`RoadFileError`]: the file cannot be read, is no such file, has degrees instead of m, or its points make no line.
    pub fn read(file: &Path) -> Result<Self, RoadFileError> {
        let (file, ids) = named(file);
        let file = file.as_path();
        let io = |source| RoadFileError::Io { file: file.into(), source };
        let wrong = |Wrong { line, reason }| RoadFileError::Content { file: file.into(), line, reason };
        // Of what is no plain file the size is not known, and reading it may not end.
        let size = std::fs::metadata(file).map_err(io)?;
        if !size.is_file() {
            return Err(wrong(Wrong::new("is no file; give a road as CSV, GeoJSON or OpenDRIVE")));
        }
        if size.len() > MAX_BYTES {
            return Err(wrong(Wrong::new("is larger than 1 GB; a road's line has a few hundred points")));
        }
        let text = std::fs::read(file).map_err(io)?;
        let text = String::from_utf8(text)
            .map_err(|_| wrong(Wrong::new("is no text; give a road as CSV, GeoJSON or OpenDRIVE")))?;
        let content = content(&text, ids.as_deref()).map_err(wrong)?;
        let line = ReferenceLine::from_points(&content.points).map_err(|source| {
            let at = source.point().and_then(|point| content.text_lines.get(point - 1));
            RoadFileError::Line { file: file.into(), line: at.copied(), source }
        })?;
        if let Some(lines) = &content.lane_lines {
            check_lane_lines(lines).map_err(|source| RoadFileError::LaneLines { file: file.into(), source })?;
        }
        Ok(Self { line, lane_lines: content.lane_lines })
    }
}

/// The file, and what stands behind a `#` where there is no file of the whole name.
fn named(file: &Path) -> (PathBuf, Option<String>) {
    let name = file.file_name().and_then(|name| name.to_str());
    match name.and_then(|name| name.rsplit_once('#')).filter(|_| !file.exists()) {
        Some((name, ids)) => (file.with_file_name(name), Some(ids.to_owned())),
        None => (file.to_owned(), None),
    }
}

/// What a text says of a road.
fn content(text: &str, ids: Option<&str>) -> Result<Content, Wrong> {
    let text = text.trim_start_matches('\u{feff}');
    let content = match text.trim_start().chars().next() {
        None => return Err(Wrong::new("is empty; give a road as CSV, GeoJSON or OpenDRIVE")),
        Some('{') => geojson::content(text)?,
        Some('<') => opendrive::content(text, ids)?,
        Some(_) => csv(text)?,
    };
    match degrees(&content.points) {
        Some(remedy) => Err(Wrong::new(remedy)),
        None => Ok(content),
    }
}

/// What to do about points that are longitudes and latitudes.
fn degrees(points: &[Vector]) -> Option<String> {
    let within = |position: &Vector| position[0].abs() <= 180. && position[1].abs() <= 90.;
    let [x, y] = *points.first()?;
    let near = |position: &Vector| (position[0] - x).abs() < 5. && (position[1] - y).abs() < 5.;
    if points.len() < 2 || !points.iter().all(|position| within(position) && near(position)) {
        return None;
    }
    let zone = (((x + 180.) / 6.).floor() as i64).clamp(0, 59) + 1;
    let code = if y < 0. { 32_700 + zone } else { 32_600 + zone };
    Some(format!(
        "the line spans less than 5 units: these seem to be degrees of longitude and latitude. Project it to m, as the tracks \
         are: `ogr2ogr -t_srs EPSG:{code} OUT.geojson IN.geojson` (UTM zone {zone})"
    ))
}

fn csv(text: &str) -> Result<Content, Wrong> {
    let mut content = Content::default();
    let mut columns = None;
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        if let Some(comment) = line.strip_prefix('#') {
            let lines = comment.trim().strip_prefix("lane lines:");
            let lines = lines.map(parse_lane_lines).transpose().map_err(|e| Wrong::at(number, e.to_string()))?;
            content.lane_lines = lines.or(content.lane_lines);
            continue;
        }
        if line.is_empty() {
            continue;
        }
        let separator = [',', ';', '\t'].into_iter().find(|separator| line.contains(*separator));
        let fields: Vec<&str> = match separator {
            Some(separator) => line.split(separator).map(|field| field.trim().trim_matches('"')).collect(),
            None => line.split_whitespace().collect(),
        };
        let [x, y] = match columns {
            Some(columns) => columns,
            None => {
                let header = fields.iter().any(|field| field.parse::<f64>().is_err());
                let found = if header { header_columns(&fields).map_err(|e| Wrong::at(number, e))? } else { [0, 1] };
                columns = Some(found);
                if header {
                    continue;
                }
                found
            }
        };
        let value = |column: usize, name: &str| {
            let field = fields.get(column).copied().unwrap_or_default();
            field.parse::<f64>().map_err(|_| {
                let seen: String = field.chars().take(30).collect();
                Wrong::at(
                    number,
                    format!("column {name} is {seen:?}, no number; give coordinates in m with a decimal point"),
                )
            })
        };
        content.points.push([value(x, "x")?, value(y, "y")?]);
        content.text_lines.push(number);
    }
    Ok(content)
}

/// The columns of coordinates by a header.
fn header_columns(fields: &[&str]) -> Result<[usize; 2], String> {
    let names: Vec<String> = fields.iter().map(|field| field.to_ascii_lowercase()).collect();
    let find = |known: &[&str]| known.iter().find_map(|name| names.iter().position(|have| have == name));
    match (find(&["x", "easting"]), find(&["y", "northing"])) {
        (Some(x), Some(y)) => Ok([x, y]),
        _ if find(&["lon", "longitude", "lat", "latitude"]).is_some() => {
            Err("longitude and latitude: project the line to m, as the tracks are, and name the columns x and y".into())
        }
        _ => Err("no columns x and y; give a polyline in m as CSV with the header `x,y`, or as GeoJSON".into()),
    }
}
