//! NGSIM: feet, 10 frames per second, the front centre of the vehicle, no carriageway but one.
//!
//! Layouts: a period of a site in 18 columns, separated by commas or blanks, with or without a
//! header; the same with `Location`; the merged export of 25 columns. `Local_Y` runs along the
//! road, `Local_X` from its left edge to the right.

use std::collections::BTreeMap;
use std::path::Path;

use self::build::{RATE, build};
use self::rows::Raw;
use super::periods::{Moments, Sites, separate};
use super::table::sniff::{Head, Header, Separator};
use super::table::{Kind, Table};
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::format::{Format, Source};
use crate::ingest_report::IngestReport;
use crate::recording::Recording;
use crate::schema::{Column, Schema, TableSchema};
use crate::track_options::TrackOptions;
use crate::tracks::Tracks;
use crate::write::{self, Written, along_road};

mod build;
mod checks;
mod rows;

/// The format.
pub(super) struct Ngsim;

/// Columns that are described.
const READ: [Column; 14] = [
    Column::new("Vehicle_ID", "-", "vehicle; begins again in every period, and may return after a gap"),
    Column::new("Frame_ID", "0.1 s", "frame; begins again in every period"),
    Column::new("Global_Time", "ms", "time; tells periods and the rate"),
    Column::new("Local_X", "ft", "front centre, from the left edge of the road to the right"),
    Column::new("Local_Y", "ft", "front centre, along the road"),
    Column::new("v_Length", "ft", "length of the vehicle"),
    Column::new("v_Width", "ft", "width of the vehicle"),
    Column::new("v_Class", "-", "1 motorcycle, 2 car, 3 truck"),
    Column::new("v_Vel", "ft/s", "speed, a scalar: checked, then left; velocities come from positions"),
    Column::new("Lane_ID", "-", "lane, 1 leftmost; 7 and 8 are ramps; 0 unknown"),
    Column::new("Total_Frames", "-", "rows of the vehicle, where the file has it: checked, then left"),
    Column::new("Preceding", "-", "vehicle directly ahead, where the file has it; 0 none"),
    Column::new("Space_Headway", "ft", "from its front to that of the vehicle ahead, where the file has it"),
    Column::new(
        "Location",
        "-",
        "site, where the file has it: us-101 and i-80 are read, streets are counted and skipped",
    ),
];

impl Format for Ngsim {
    fn dataset(&self) -> Dataset {
        Dataset::NGSIM
    }

    fn title(&self) -> &str {
        "NGSIM"
    }

    fn sites(&self) -> Option<&str> {
        Some("US-101 and I-80")
    }

    fn rate_hz(&self) -> f64 {
        RATE
    }

    fn files(&self) -> &str {
        "NGSIM tables (.csv or .txt, plain or .gz) of 18 or 25 columns"
    }

    fn schema(&self) -> Schema {
        Schema::new(
            "NGSIM: one table a period and site, .csv or .txt, plain or .gz, 18 columns separated by commas or blanks, with or \
             without a header; with `Location` as well; or the merged export of 25 columns.\n\
             Rate: 10 frames per second, measured from Global_Time.\n",
            vec![TableSchema::new("Columns read", &READ)],
            "feet become metres; the front centre becomes the centre, half a length back; x = Local_Y, y = -Local_X. The data \
             has no markings: lane lines are fitted midway between the lanes' median positions, with edges 3.66 m beyond the \
             outermost. Neighbours come from Lane_ID and x; Preceding counts where the vehicle it names has no row of its own.\n",
        )
    }

    fn recognise(&self, file: &Path) -> Result<bool, DataError> {
        let head = Head::read(file)?.ok_or_else(|| DataError::Empty { file: file.into() })?;
        Ok(recognise(file, &head)?.is_some())
    }

    fn site(&self, file: &Path) -> Option<String> {
        site_of(file)
    }

    fn read(&self, source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        read(source, rate_hz)
    }

    fn written_as(&self) -> &[&str] {
        &[".csv", ".txt"]
    }

    fn write(&self, tracks: &Tracks, options: &TrackOptions, to: &Path) -> Result<Written, DataError> {
        let options = TrackOptions { rate_hz: options.rate_hz.or(Some(RATE)), ..options.clone() };
        along_road(tracks, &options, |recording| write::ngsim::write(recording, to))
    }
}

/// The columns of a period's file, which has no header in the official text form.
pub(crate) const COLUMNS: [&str; 18] = [
    "Vehicle_ID",
    "Frame_ID",
    "Total_Frames",
    "Global_Time",
    "Local_X",
    "Local_Y",
    "Global_X",
    "Global_Y",
    "v_Length",
    "v_Width",
    "v_Class",
    "v_Vel",
    "v_Acc",
    "Lane_ID",
    "Preceding",
    "Following",
    "Space_Headway",
    "Time_Headway",
];

/// Columns that a damaged first line of a file without a header may have more or fewer than [`COLUMNS`].
const DAMAGE: usize = 3;

/// Columns from which a header is recognised: those that are read.
const KNOWN: [&str; 10] = [
    "Vehicle_ID",
    "Frame_ID",
    "Global_Time",
    "Local_X",
    "Local_Y",
    "v_Length",
    "v_Width",
    "v_Class",
    "v_Vel",
    "Lane_ID",
];

/// Columns that tell the merged export from a period's file.
const MERGED: [&str; 3] = ["O_Zone", "D_Zone", "Section_ID"];

/// Sites that are motorways. Lankershim and Peachtree are streets with junctions.
const SITES: [&str; 2] = ["us-101", "i-80"];

/// The table, if the file is one of NGSIM's.
fn recognise(file: &Path, head: &Head) -> Result<Option<Table>, DataError> {
    let (header, hits) = head.header(&KNOWN);
    if hits > KNOWN.len() / 2 {
        if let Separator::Other(found) = header.separator {
            return Err(DataError::Delimiter { file: file.into(), found, expected: "commas or blanks" });
        }
        let table = Table::new(file, header);
        // Of two columns of one name the other's is missing, and that is not the fault.
        for column in KNOWN {
            table.find(&[column], Kind::Real)?;
        }
        for column in KNOWN {
            table.want(column, Kind::Real)?;
        }
        return Ok(Some(table));
    }
    let Some((separator, fields)) = head.numbers() else { return Ok(None) };
    // Any other table or list of numbers is no damaged one.
    if fields.abs_diff(COLUMNS.len()) > DAMAGE {
        return Ok(None);
    }
    if let Separator::Other(found) = separator {
        return Err(DataError::Delimiter { file: file.into(), found, expected: "commas or blanks" });
    }
    if fields != COLUMNS.len() {
        return Err(DataError::FieldCount { file: file.into(), line: 1, found: fields, expected: COLUMNS.len() });
    }
    let names = COLUMNS.map(str::to_owned).to_vec();
    Ok(Some(Table { has_header: false, ..Table::new(file, Header { separator, names }) }))
}

/// Site that the name of a file, or of the nearest folder above it, tells, as the official downloads
/// are named.
fn site_of(file: &Path) -> Option<String> {
    file.components().rev().find_map(|part| {
        let name = part.as_os_str().to_string_lossy().to_ascii_lowercase();
        let any = |hints: &[&str]| hints.iter().any(|hint| name.contains(hint));
        // Periods of the downloads: US-101 in the morning, I-80 in the afternoon.
        if any(&["us-101", "us101", "us_101", "0750am", "0805am", "0820am"]) {
            Some("us-101".to_owned())
        } else if any(&["i-80", "i80", "i_80", "0400-0415", "0400pm", "0500-0515", "0500pm", "0515-0530", "0515pm"]) {
            Some("i-80".to_owned())
        } else {
            None
        }
    })
}

/// Recordings of a file: one for each site and period.
fn read(source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    let file = source.file()?;
    let table = Head::read(file)?.map(|head| recognise(file, &head)).transpose()?.flatten();
    let table = table.ok_or_else(|| DataError::NoRecordings {
        folder: file.into(),
        expected: Ngsim.files().to_owned(),
        seen: "a table or text of another kind".to_owned(),
    })?;
    let merged = MERGED.iter().any(|column| table.columns.iter().any(|have| have.eq_ignore_ascii_case(column)));
    let raw = rows::read(&table)?;
    let (sites, mut skipped) = sites_of(&raw, source);
    let moments = Moments { vehicle: &raw.vehicle, frame: &raw.frame, time: &raw.time };
    let groups = separate(&moments, &sites);
    if groups.is_empty() {
        return Err(DataError::NoRecordings {
            folder: file.into(),
            expected: "rows of us-101 or i-80".into(),
            // Any text may stand in the column.
            seen: format!(
                "only {}",
                skipped.keys().take(10).map(|site| site.chars().take(40).collect()).collect::<Vec<String>>().join(", ")
            ),
        });
    }
    let several = groups.len() > 1;
    let mut recordings = Vec::with_capacity(groups.len());
    for group in &groups {
        let name = match (&group.site, several) {
            (_, false) => source.name.clone(),
            (site, true) => format!("{}-{site}-{}", source.name, group.period),
        };
        let (recording, mut quality) = build(&table, &raw, group, name, source, rate_hz, merged)?;
        quality.skipped_rows = std::mem::take(&mut skipped);
        quality.notes.extend(source.notes.iter().cloned());
        quality.notes.extend(raw.unread.iter().cloned());
        recordings.push((recording, quality));
    }
    // Of the whole file, as rows of sites that are left out are.
    if let Some((_, first)) = recordings.first_mut().filter(|_| raw.negative_leaders > 0) {
        let what = "rows have a negative number for the vehicle ahead: none is taken";
        first.contradictions.insert(what.to_owned(), raw.negative_leaders as u64);
    }
    Ok(recordings)
}

/// The name of a site that is read.
fn motorway(word: &str) -> Option<String> {
    let site = word.trim().to_ascii_lowercase();
    SITES.contains(&site.as_str()).then_some(site)
}

/// Site of every row by code, the list of sites with `None` for those that are not motorways, and
/// the rows of the latter.
fn sites_of<'a>(raw: &'a Raw, source: &Source) -> (Sites<'a>, BTreeMap<String, u64>) {
    let mut skipped = BTreeMap::new();
    let Some((codes, words)) = &raw.site else {
        let name = source.site.clone().unwrap_or_else(|| "ngsim".into());
        return (Sites { codes: &[], names: vec![Some(name)] }, skipped);
    };
    let mut rows = vec![0u64; words.len()];
    for code in codes {
        rows[usize::from(*code)] += 1;
    }
    let names = words.iter().zip(rows).map(|(word, rows)| {
        let site = motorway(word);
        if site.is_none() {
            let street = word.trim().to_ascii_lowercase();
            *skipped.entry(format!("site {street} is not a motorway")).or_insert(0) += rows;
        }
        site
    });
    let names = names.collect();
    (Sites { codes, names }, skipped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn describes_every_column_that_is_read() {
        assert!(KNOWN.iter().all(|known| READ.iter().any(|column| column.name == *known)));
    }
}
