//! What contradicts itself is refused, or counted and not used.

use gnp_data::{Columns, DataError, Dataset, IngestReport, LaneMarking, Recording, Road, Track};

use self::highd::{FRAMES, Made, VEHICLES, highd};
use self::ngsim::{ngsim, traffic};
use super::{fixtures, put, read_all};

mod highd;
mod ngsim;

fn says(error: &DataError, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

/// How often what was found.
type Counts<'a> = Vec<(&'a str, u64)>;

/// Vehicles left out and what is counted.
fn counted(report: &IngestReport) -> (Counts<'_>, Counts<'_>) {
    fn list(map: &std::collections::BTreeMap<String, u64>) -> Vec<(&str, u64)> {
        map.iter().map(|(what, count)| (what.as_str(), *count)).collect()
    }
    (list(&report.vehicles_left_out), list(&report.contradictions))
}

#[test]
fn what_does_not_contradict_itself_is_read_without_a_remark() {
    let (recording, report) = highd(|_| {}).unwrap();
    assert_eq!((recording.len() as i64, report.remarks()), (FRAMES * VEHICLES, Vec::new()));
    // Rows by frame are the same recording.
    let (by_frame, report) = highd(|made| made.lines.sort_by_key(|line| line.frame)).unwrap();
    assert_eq!((by_frame.columns(), report.remarks()), (recording.columns(), Vec::new()));
}

#[test]
fn a_place_beyond_all_roads() {
    let error = highd(|made| made.lines[4].x = 1e30).unwrap_err();
    says(&error, &["05_tracks.csv", "line 6", "column `x`", "131 km", "repair"]);
    let error = highd(|made| made.lines[4].y = -2e5).unwrap_err();
    says(&error, &["05_tracks.csv", "line 6", "column `y`"]);
    for column in ["Local_X", "Local_Y"] {
        let error = ngsim(|rows| if column == "Local_X" { rows[4].x = 1e30 } else { rows[4].y = 1e30 }).unwrap_err();
        says(&error, &["made.csv", "line 6", column, "131 km", "repair"]);
    }
}

#[test]
fn two_columns_of_one_name() {
    for (from, to, places) in [("yVelocity", "xVelocity", "7 and 8"), ("leftFollowingId", "laneId", "21 and 25")] {
        let mut files = Made::new().files();
        files.tracks = files.tracks.replace(from, to);
        // The other's name may be missing as well; which is said first does not matter.
        let message = highd::read(&files).unwrap_err().to_string();
        assert!(message.contains(&format!("columns {places} are both named")), "{message}");
        assert!(message.contains("05_tracks.csv, line 1") && message.contains(to), "{message}");
    }
    let text = super::ngsim::csv(&traffic());
    for (from, to, places) in [("Global_Y", "Local_Y", "6 and 8"), ("Time_Headway", "Space_Headway", "17 and 18")] {
        let folder = tempfile::tempdir().unwrap();
        let file = put(folder.path(), "made.csv", &text.replace(from, to));
        let error = read_all(&file, Dataset::NGSIM).unwrap_err();
        assert!(matches!(error, DataError::DuplicateColumn { .. }), "{error}");
        says(&error, &["made.csv, line 1", &format!("columns {places} are both named"), "remove or rename"]);
    }
}

#[test]
fn the_embedded_recordings_do_not_contradict_themselves() {
    for (folder, dataset) in [("highd", Dataset::HIGHD), ("highd-congested", Dataset::HIGHD), ("ngsim", Dataset::NGSIM)]
    {
        for (recording, report) in read_all(&fixtures(folder), dataset).unwrap() {
            // On I-80 some headways are not those of the positions.
            let expected: &[(&str, u64)] = match recording.meta().name.as_str() {
                "i80-lanes123" => &[("rows have a headway that is more than 5 m off the positions", 22)],
                _ => &[],
            };
            assert_eq!(counted(&report), (vec![], expected.to_vec()), "{}", recording.meta().name);
        }
    }
}

#[test]
fn older_reports_are_read() {
    let (_, report) = highd(|_| {}).unwrap();
    let mut json = serde_json::to_value(&report).unwrap();
    json.as_object_mut().unwrap().remove("vehicles_left_out").unwrap();
    json.as_object_mut().unwrap().remove("contradictions").unwrap();
    assert_eq!(serde_json::from_value::<IngestReport>(json).unwrap(), report);
}

/// What a recording is made of.
struct Parts {
    columns: Columns,
    tracks: Vec<Track>,
    roads: Vec<Road>,
}

#[test]
fn no_recording_has_what_cannot_be() {
    let (good, _) = highd(|_| {}).unwrap();
    let refused = |change: &dyn Fn(&mut Parts)| {
        let mut parts =
            Parts { columns: good.columns().clone(), tracks: good.tracks().to_vec(), roads: good.roads().to_vec() };
        change(&mut parts);
        let Parts { columns, tracks, roads } = parts;
        Recording::from_parts(good.meta().clone(), roads, tracks, columns).unwrap_err().to_string()
    };
    for place in [refused(&|it| it.columns.x[3] = 1e30), refused(&|it| it.columns.y[3] = -131_073.)] {
        assert!(place.contains("row 3 is more than 131072 m from the origin"), "{place}");
    }
    let fast = refused(&|it| (it.columns.vx[3], it.columns.vy[3]) = (90., 50.));
    assert!(fast.contains("row 3 moves at more than 100 m/s"), "{fast}");
    for size in [[99., 0.1], [1e9, 2.], [5., 0.2], [0.4, 1.]] {
        let message = refused(&|it| [it.tracks[2].length, it.tracks[2].width] = size);
        assert!(message.contains("vehicle 3") && message.contains("0.5 to 40 m long and 0.3 to 5 m wide"), "{message}");
    }
    let lines = refused(&|it| it.roads[1].lines = (0..18u8).map(|i| LaneMarking::new(f32::from(i), true)).collect());
    assert!(lines.contains("carriageway 1 has 18 lines"), "{lines}");
    // Velocities of noisy positions are what they are.
    let (noisy, _) = ngsim(|rows| rows[30].y += 300.).unwrap();
    assert!(noisy.columns().vx.iter().any(|vx| *vx > 200.));
}
