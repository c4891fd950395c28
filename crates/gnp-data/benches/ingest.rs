//! Ingest of the embedded data as plain CSV: rows a second, each recording eight times over under
//! other vehicle numbers so that a file is about as long as a real one.

#![allow(missing_docs)] // criterion's macros write functions without

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gnp_data::{Dataset, Expectation, discover, read};

const COPIES: u32 = 8;

/// The text of `file` with its rows `COPIES` times, `shift` added to the numbers in `ids`, none
/// where they are 0.
fn copies(file: &Path, ids: &[usize], shift: u32) -> std::io::Result<(String, u64)> {
    let mut text = String::new();
    if file.extension().is_some_and(|end| end == "gz") {
        flate2::read::GzDecoder::new(File::open(file)?).read_to_string(&mut text)?;
    } else {
        File::open(file)?.read_to_string(&mut text)?;
    }
    let (header, rows) = text.split_once('\n').unwrap_or_default();
    let mut all = format!("{header}\n");
    let mut count = 0;
    for copy in 0..COPIES {
        for row in rows.lines() {
            for (i, field) in row.split(',').enumerate() {
                let comma = if i == 0 { "" } else { "," };
                let _ = match field.parse::<u32>() {
                    Ok(id @ 1..) if ids.contains(&i) => write!(all, "{comma}{}", id + copy * shift),
                    _ => write!(all, "{comma}{field}"),
                };
            }
            all.push('\n');
            count += 1;
        }
    }
    Ok((all, count))
}

fn ingest(criterion: &mut Criterion) -> Result<(), Box<dyn std::error::Error>> {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures");
    let mut group = criterion.benchmark_group("ingest");
    group.sample_size(10);

    let folder = tempfile::tempdir()?;
    let (ngsim, rows) = copies(&fixtures.join("ngsim/i80-lanes123.csv.gz"), &[0], 4000)?;
    std::fs::write(folder.path().join("i80.csv"), ngsim)?;
    group.throughput(Throughput::Elements(rows));
    let expect = Expectation { dataset: Dataset::NGSIM, rate_hz: None };
    let sources = discover(folder.path(), Dataset::NGSIM)?;
    group.bench_function(format!("ngsim_csv/{rows}_rows"), |b| b.iter(|| read(&sources[0], &expect)));

    let folder = tempfile::tempdir()?;
    let ids: Vec<usize> = std::iter::once(1).chain(16..24).collect();
    let (tracks, rows) = copies(&fixtures.join("highd/02_tracks.csv.gz"), &ids, 1000)?;
    let (bodies, _) = copies(&fixtures.join("highd/02_tracksMeta.csv"), &[0], 1000)?;
    std::fs::write(folder.path().join("02_tracks.csv"), tracks)?;
    std::fs::write(folder.path().join("02_tracksMeta.csv"), bodies)?;
    std::fs::copy(fixtures.join("highd/02_recordingMeta.csv"), folder.path().join("02_recordingMeta.csv"))?;
    group.throughput(Throughput::Elements(rows));
    let expect = Expectation { dataset: Dataset::HIGHD, rate_hz: None };
    let sources = discover(folder.path(), Dataset::HIGHD)?;
    group.bench_function(format!("highd_csv/{rows}_rows"), |b| b.iter(|| read(&sources[0], &expect)));
    group.finish();
    Ok(())
}

fn run(criterion: &mut Criterion) {
    if let Err(e) = ingest(criterion) {
        eprintln!("{e}");
    }
}

criterion_group!(benches, run);
criterion_main!(benches);
