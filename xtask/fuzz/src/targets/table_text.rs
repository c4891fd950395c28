//! Any bytes as a text table: both formats must refuse them or read a recording.

use std::io;
use std::path::Path;

use gnp_data::{DataError, Dataset, Expectation, IngestReport, Recording, discover, format_of, read};

use crate::finding::promise;
use crate::made::kind;
use crate::table::pack;
use crate::{Finding, Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "table_text",
    about: "any bytes as a table of NGSIM and of highD: recognised, read",
    run,
    seeds: |_| Ok(vec![b"a1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18\n".to_vec()]),
    words: &["Vehicle_ID", "Frame_ID", "Local_X", "Lane_ID", "laneId", "frame,id,x,y,width,height", "frameRate"],
};

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    let (name, content) = as_table(kind, rest)?;
    let file = scratch.only(name, &content)?;
    for dataset in [Dataset::NGSIM, Dataset::HIGHD] {
        if let Err(error) = format_of(dataset).map_err(Finding::case)?.recognise(&file) {
            checks::refusal(&error, "case")?;
        }
        reads(scratch, scratch.given(), dataset)?;
    }
    Ok(())
}

/// Name and content of a table that a kind of input stands for: as it stands, packed by gzip, or as if it were so.
pub(super) fn as_table(kind: u8, content: &[u8]) -> io::Result<(&'static str, Vec<u8>)> {
    Ok(match kind {
        b'z' => ("case.csv.gz", pack(content)?),
        b'g' => ("case.csv.gz", content.to_vec()),
        b't' => ("case.txt", content.to_vec()),
        _ => ("case.csv", content.to_vec()),
    })
}

/// Reads everything below a path; each recording must be one, each refusal must name a file of the case.
pub(super) fn reads(scratch: &Scratch, path: &Path, dataset: Dataset) -> Result<(), Finding> {
    let folder = scratch.given().display().to_string();
    match read_all(path, dataset) {
        Ok(recordings) => recordings.iter().try_for_each(|(recording, report)| {
            let rows = report.rows == recording.len() as u64 && report.rows <= report.rows_read;
            promise(rows, || format!("{} rows, of which the report says {}", recording.len(), report.rows))?;
            checks::recording(scratch, recording)
        }),
        // What is wrong with a recording and with no line of its file names the recording, which is called after it.
        Err(error @ DataError::Parts { .. }) => checks::refusal(&error, "case"),
        Err(error) => checks::refusal(&error, &folder),
    }
}

pub(super) fn read_all(path: &Path, dataset: Dataset) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    let mut all = Vec::new();
    for source in discover(path, dataset)? {
        all.extend(read(&source, &Expectation { dataset, rate_hz: None })?);
    }
    Ok(all)
}
