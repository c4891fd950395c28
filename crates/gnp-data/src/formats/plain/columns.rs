//! The columns of plain tracks and their other names.

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::{DataError, TrackProblem};

/// A column that has a meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Field {
    Id,
    Time,
    TimeMs,
    X,
    Y,
    Heading,
    HeadingDegrees,
    Speed,
    Vx,
    Vy,
    Length,
    Width,
    Lane,
    Class,
}

/// Every field with its names, the first of which is the one that messages know.
pub(super) const FIELDS: [(Field, &[&str]); 14] = [
    (Field::Id, &["id", "track_id", "trackid", "vehicle_id", "vehicle", "agent_id"]),
    (Field::Time, &["time", "t", "time_s", "timestamp", "timestamp_s"]),
    (Field::TimeMs, &["time_ms", "timestamp_ms"]),
    (Field::X, &["x", "x_m", "pos_x", "position_x"]),
    (Field::Y, &["y", "y_m", "pos_y", "position_y"]),
    (Field::Heading, &["heading", "yaw", "psi_rad", "heading_rad"]),
    (Field::HeadingDegrees, &["heading_deg", "yaw_deg"]),
    (Field::Speed, &["speed", "v"]),
    (Field::Vx, &["vx", "v_x", "velocity_x"]),
    (Field::Vy, &["vy", "v_y", "velocity_y"]),
    (Field::Length, &["length"]),
    (Field::Width, &["width"]),
    (Field::Lane, &["lane", "lane_id"]),
    (Field::Class, &["class", "type", "object_type", "vehicle_class", "agent_type"]),
];

/// Names that often stand beside those and are not read.
const BESIDE: [&str; 4] = ["frame", "frame_id", "", "index"];

/// All names.
pub(super) fn names() -> Vec<&'static str> {
    FIELDS.iter().flat_map(|(_, names)| names.iter().copied()).collect()
}

/// Where the columns of a table are.
#[derive(Clone, Debug)]
pub(super) struct Found {
    places: Vec<(Field, usize)>,
    /// What columns are called, where that is another name: as a table of tracks keeps it.
    pub(super) called: BTreeMap<&'static str, String>,
}

impl Found {
    /// The columns among `names`; `None` where these are of another table.
    ///
    /// # Errors
    /// When two columns are of one meaning, or when one is missing of a table that otherwise has nothing but what plain
    /// tracks have.
    pub(super) fn among(file: &Path, names: &[String]) -> Result<Option<Self>, DataError> {
        let mut places: Vec<(Field, usize)> = Vec::new();
        let mut called = BTreeMap::new();
        let mut twice = None;
        for (field, known) in FIELDS {
            let is = |name: &&String| known.iter().any(|known| name.trim().eq_ignore_ascii_case(known));
            let mut found = names.iter().zip(0..).filter(|(name, _)| is(name));
            let Some((name, place)) = found.next() else { continue };
            if let Some((other, second)) = found.next() {
                twice = twice.or(Some((known[0], [name, other], [place, second])));
            }
            if name != known[0] {
                // Two fields of one meaning, as times in s and in ms, go by one name.
                let meaning = match field {
                    Field::TimeMs => "time",
                    Field::HeadingDegrees => "heading",
                    _ => known[0],
                };
                called.entry(meaning).or_insert_with(|| gnp_file::excerpt(name, 60));
            }
            places.push((field, place));
        }
        let found = Self { places, called };
        let time = if found.place(Field::Time).is_some() { Field::Time } else { Field::TimeMs };
        let needed = [(Field::Id, "id"), (time, "time"), (Field::X, "x"), (Field::Y, "y")];
        let missing: Vec<&str> =
            needed.iter().filter(|(field, _)| found.place(*field).is_none()).map(|(_, name)| *name).collect();
        let listed = || gnp_file::excerpt(&names.join(", "), 400);
        let ours = || {
            let known = |name: &String| {
                let name = name.trim();
                let fields = FIELDS.iter().flat_map(|(_, names)| names.iter()).chain(&BESIDE);
                fields.into_iter().any(|known| name.eq_ignore_ascii_case(known))
            };
            names.iter().all(known)
        };
        match (&missing[..], twice) {
            ([], None) => Ok(Some(found)),
            ([], Some((meaning, [first, second], places))) => {
                let place = format!("{}, line 1", file.display());
                let [first, second] = [first, second].map(|name| gnp_file::excerpt(name, 60));
                let what = format!(
                    "columns {} and {}, `{first}` and `{second}`, are both the {meaning}",
                    places[0] + 1,
                    places[1] + 1
                );
                let remedy = "rename or remove the wrong one".to_owned();
                Err(DataError::Tracks { problem: TrackProblem::Columns, place, row: None, what, remedy })
            }
            ([one], _) if ours() => {
                let place = format!("{}, line 1", file.display());
                let what = format!("column `{one}` is missing (the header has: {})", listed());
                let remedy = match *one {
                    "time" => "add the time of each row in s, such as frame / rate".to_owned(),
                    _ => "add it: plain tracks have id, time, x and y (docs/data.md)".to_owned(),
                };
                Err(DataError::Tracks { problem: TrackProblem::Columns, place, row: None, what, remedy })
            }
            _ => Ok(None),
        }
    }

    /// Place of a column in the table.
    pub(super) fn place(&self, field: Field) -> Option<usize> {
        self.places.iter().find(|(have, _)| *have == field).map(|(_, place)| *place)
    }

    /// The columns to read, each with its place: of two that say the same the first.
    pub(super) fn wanted(&self) -> Vec<(Field, usize)> {
        let has = |field| self.place(field).is_some();
        let wanted = |field: Field| match field {
            Field::TimeMs => !has(Field::Time),
            Field::HeadingDegrees => !has(Field::Heading),
            Field::Vx => has(Field::Vy),
            Field::Vy => has(Field::Vx),
            _ => true,
        };
        self.places.iter().copied().filter(|(field, _)| wanted(*field)).collect()
    }
}
