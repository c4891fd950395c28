//! The readers, from files to recordings: every layout, every quirk, every kind of bad input.

#![allow(clippy::unwrap_used, clippy::panic)] // also outside the test functions

mod bad_input;
mod cache;
mod contradictions;
mod convert;
mod copies;
mod files;
mod highd;
mod layouts;
mod leaders;
mod merged;
mod ngsim;
mod parts;
mod quality;
mod sumo;
mod text;
mod tracks;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use gnp_data::{DataError, Dataset, Expectation, IngestReport, Recording, discover, read};

/// Writes `text` to a file of a folder.
fn put(folder: &Path, name: &str, text: &str) -> PathBuf {
    let file = folder.join(name);
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::write(&file, text).unwrap();
    file
}

fn gzip(text: &str) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    encoder.finish().unwrap()
}

/// Everything below a path.
fn read_all(path: &Path, dataset: Dataset) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    read_at(path, dataset, None)
}

fn read_at(path: &Path, dataset: Dataset, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    let mut all = Vec::new();
    for source in discover(path, dataset)? {
        all.extend(read(&source, &Expectation { dataset, rate_hz })?);
    }
    Ok(all)
}

/// The folder of the embedded data.
fn fixtures(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(name)
}
