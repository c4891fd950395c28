//! Rows a second of ingest, and what it found: `ingest_rate ngsim|highd PATH [COPIES]`.
//!
//! Reads every recording below PATH, COPIES times over, and prints a line for each, the rate, and
//! (on Linux) the most memory that was in use.

use std::path::Path;
use std::time::Instant;

use gnp_data::{DataError, Dataset, Expectation, discover, read};

fn main() -> Result<(), DataError> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let dataset = if arguments.first().is_some_and(|name| name == "highd") { Dataset::HIGHD } else { Dataset::NGSIM };
    let path = arguments.get(1).map_or("fixtures/ngsim", String::as_str);
    let copies: usize = arguments.get(2).and_then(|copies| copies.parse().ok()).unwrap_or(1);

    let sources = discover(Path::new(path), dataset)?;
    let expect = Expectation { dataset, rate_hz: None };
    let start = Instant::now();
    let mut rows = 0;
    for copy in 0..copies {
        for source in &sources {
            for (_, quality) in read(source, &expect)? {
                rows += quality.rows_read;
                if copy == 0 {
                    println!(
                        "{} {}: {} rows, {} vehicles, {} tracks, {} duplicates, {} conflicts, {} jumps, {} overlaps, \
                         {} lane flips, {} unknown neighbours, {} lines",
                        quality.site,
                        quality.recording,
                        quality.rows,
                        quality.vehicles,
                        quality.tracks,
                        quality.duplicates,
                        quality.conflicts,
                        quality.jumps,
                        quality.overlaps,
                        quality.lane_flips,
                        quality.unknown_neighbours,
                        quality.lane_lines,
                    );
                }
            }
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    println!("{rows} rows in {seconds:.2} s: {:.2} million rows/s", rows as f64 / seconds / 1e6);
    if let Ok(status) = std::fs::read_to_string("/proc/self/status") {
        status.lines().filter(|line| line.starts_with("VmHWM")).for_each(|line| println!("{line}"));
    }
    Ok(())
}
