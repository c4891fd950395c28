//! What contradicts itself is refused, or counted and not used.

use gnp_data::{DataError, Dataset, IngestReport, Recording};

use super::highd::{Files, RECORDING_META, TRACKS, TRACKS_META};
use super::ngsim::{self, HEADER, Row};
use super::{fixtures, put, read_all};

/// A row of highD's tracks.
#[derive(Clone)]
struct Line {
    frame: i64,
    id: i64,
    x: f64,
    y: f64,
    size: [f64; 2],
    v: [f64; 2],
    neighbours: [i64; 8],
    lane: i64,
}

/// A vehicle of highD's tracksMeta.
#[derive(Clone)]
struct Vehicle {
    id: i64,
    size: [f64; 2],
    frames: [i64; 3],
    direction: i64,
}

/// A recording in highD's layout.
struct Made {
    lines: Vec<Line>,
    vehicles: Vec<Vehicle>,
    /// The row of recordingMeta, by column.
    meta: Vec<(&'static str, String)>,
}

const FRAMES: i64 = 60;
const VEHICLES: i64 = 24;

impl Made {
    /// Twelve vehicles on each carriageway, two lanes wide, 30 m apart at 25 m/s, 5 m by 2 m; all weave by 0.6 m.
    fn new() -> Self {
        let mut lines = Vec::new();
        let mut vehicles = Vec::new();
        for id in 1..=VEHICLES {
            let direction = if id <= 12 { 1 } else { 2 };
            let (forward, lane) =
                (if direction == 1 { -1. } else { 1. }, 2 + id % 2 + if direction == 1 { 0 } else { 3 });
            // Those of one lane have every second number; who is ahead has a smaller one where x falls.
            let ahead = if direction == 1 { id - 2 } else { id + 2 };
            let there = |other: i64| {
                if (1..=12).contains(&other) == (direction == 1) && (1..=24).contains(&other) { other } else { 0 }
            };
            for frame in 1..=FRAMES {
                let t = frame as f64 / 25.;
                let phase = std::f64::consts::TAU * t / 2.4;
                let centre = [2.25, 5.75, 0., 20., 24.][(lane - 2) as usize] + 0.6 * phase.sin();
                let x = 100. + 30. * id as f64 + forward * 25. * t;
                let mut neighbours = [0; 8];
                (neighbours[0], neighbours[1]) = (there(ahead), there(2 * id - ahead));
                lines.push(Line {
                    frame,
                    id,
                    x: x - 2.5,
                    y: centre - 1.,
                    size: [5., 2.],
                    v: [forward * 25., 0.6 * std::f64::consts::TAU / 2.4 * phase.cos()],
                    neighbours,
                    lane,
                });
            }
            vehicles.push(Vehicle { id, size: [5., 2.], frames: [1, FRAMES, FRAMES], direction });
        }
        let meta = RECORDING_META.split(',').map(|column| {
            let value = match column {
                "id" => "5",
                "frameRate" => "25",
                "locationId" => "2",
                "duration" => "2.4",
                "numVehicles" | "numCars" => "24",
                "upperLaneMarkings" => "0.50;4.00;7.50",
                "lowerLaneMarkings" => "18.00;22.00;26.00",
                _ => "0",
            };
            (column, value.to_owned())
        });
        Self { lines, vehicles, meta: meta.collect() }
    }

    fn set(&mut self, column: &str, value: &str) {
        self.meta.iter_mut().find(|(name, _)| *name == column).unwrap().1 = value.to_owned();
    }

    fn lines_of(&mut self, vehicles: std::ops::RangeInclusive<i64>) -> impl Iterator<Item = &mut Line> {
        self.lines.iter_mut().filter(move |line| vehicles.contains(&line.id))
    }

    fn files(&self) -> Files {
        let mut tracks = format!("{TRACKS}\n");
        for Line { frame, id, x, y, size: [w, h], v: [vx, vy], neighbours, lane } in &self.lines {
            let named = neighbours.map(|id| id.to_string()).join(",");
            tracks += &format!("{frame},{id},{x:.2},{y:.2},{w},{h},{vx:.2},{vy:.2},0,0,0,0,0,0,0,0,{named},{lane}\n");
        }
        let mut tracks_meta = format!("{TRACKS_META}\n");
        for Vehicle { id, size: [w, h], frames: [first, last, all], direction } in &self.vehicles {
            tracks_meta += &format!("{id},{w},{h},{first},{last},{all},Car,{direction},60,25,25,25,0,0,0,0\n");
        }
        let (names, values): (Vec<&str>, Vec<&str>) =
            self.meta.iter().map(|(name, value)| (*name, value.as_str())).unzip();
        let recording_meta = format!("{}\n{}\n", names.join(","), values.join(","));
        Files { tracks, tracks_meta, recording_meta }
    }
}

fn read(files: &Files) -> Result<(Recording, IngestReport), DataError> {
    let folder = tempfile::tempdir().unwrap();
    files.put(folder.path(), "05");
    read_all(folder.path(), Dataset::HIGHD).map(|mut all| all.remove(0))
}

fn highd(change: impl Fn(&mut Made)) -> Result<(Recording, IngestReport), DataError> {
    let mut made = Made::new();
    change(&mut made);
    read(&made.files())
}

/// The message of the contradiction that `change` makes has all `parts`.
fn refused(change: impl Fn(&mut Made), parts: &[&str]) {
    let error = highd(change).unwrap_err();
    assert!(matches!(error, DataError::Contradiction { .. }), "{error}");
    says(&error, parts);
}

fn says(error: &DataError, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

/// Vehicles left out and what is counted.
fn counted(report: &IngestReport) -> (Vec<(&str, u64)>, Vec<(&str, u64)>) {
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
fn highd_vehicles_that_move_otherwise_than_they_are_said_to() {
    let all = 1..=VEHICLES;
    refused(
        |made| made.vehicles.iter_mut().for_each(|it| it.direction = 3 - it.direction),
        &["05_tracksMeta.csv", "line 2", "drivingdirection", "24 of 24 vehicles drive against", "one download"],
    );
    let velocity = &["05_tracks.csv", "xvelocity", "have another velocity than their positions", "frameRate"];
    refused(|made| made.lines_of(all.clone()).for_each(|line| line.v[0] = 0.), velocity);
    refused(|made| made.lines_of(all.clone()).for_each(|line| line.v[0] *= -1.), velocity);
    refused(|made| made.lines_of(all.clone()).for_each(|line| line.v[1] *= -1.), velocity);
    refused(|made| made.lines_of(all.clone()).for_each(|line| line.v[0] *= 1.2), velocity);
    // The signs of one carriageway alone; the first line of vehicle 13.
    refused(|made| made.lines_of(13..=24).for_each(|line| line.v[0] *= -1.), &["line 722", "12 of 24 vehicles"]);
    refused(|made| made.set("frameRate", "20"), velocity);
    // However the rows are sorted.
    refused(
        |made| {
            made.lines_of(all.clone()).for_each(|line| line.v[0] = 0.);
            made.lines.sort_by_key(|line| line.frame);
        },
        &["line 2,", "24 of 24"],
    );
}

#[test]
fn a_highd_vehicle_that_contradicts_itself_is_left_out() {
    let left_out = |change: &dyn Fn(&mut Made), why: &str| {
        let (recording, report) = highd(change).unwrap();
        assert_eq!(counted(&report).0, [(why, 1)], "{:?}", report.remarks());
        assert!(recording.tracks().iter().all(|track| track.vehicle != 7));
        assert_eq!((report.vehicles as i64, report.rows_read as i64), (VEHICLES - 1, FRAMES * VEHICLES));
        // Vehicles 5 and 9 name it.
        assert_eq!(report.unknown_neighbours as i64, 2 * FRAMES);
        assert!(report.remarks().iter().any(|remark| remark.contains(why)), "{:?}", report.remarks());
    };
    left_out(
        &|made| made.lines_of(7..=7).for_each(|line| line.v[0] = 0.),
        "have another velocity than their positions",
    );
    left_out(
        &|made| made.lines_of(7..=7).for_each(|line| (line.x, line.v[0]) = (500. - line.x, 25.)),
        "drive against their drivingDirection",
    );
    left_out(
        &|made| made.lines_of(7..=7).for_each(|line| line.y += 500.),
        "drive more than 4 m outside the markings of their carriageway",
    );
    left_out(
        &|made| {
            made.vehicles[6].size = [99., 0.1];
            made.lines_of(7..=7).for_each(|line| line.size = [99., 0.1]);
        },
        "are of no size a vehicle has (0.5 to 40 m by 0.3 to 5 m)",
    );
}

#[test]
fn highd_vehicles_off_the_road() {
    let road = &["05_tracks.csv", "line 2", "column `y`", "24 of 24 vehicles drive more than 4 m outside"];
    refused(|made| made.lines_of(1..=VEHICLES).for_each(|line| line.y += 500.), road);
    // A lane of a ramp without markings is no contradiction; a few rows beyond are kept.
    let (_, report) = highd(|made| made.lines_of(7..=7).for_each(|line| line.y -= 3.)).unwrap();
    assert_eq!(counted(&report).0, []);
    let (recording, report) =
        highd(|made| made.lines_of(7..=7).filter(|line| line.frame > 50).for_each(|line| line.y += 90.)).unwrap();
    assert_eq!(recording.len() as i64, FRAMES * VEHICLES);
    let rows = ("rows are more than 4 m outside the markings of their carriageway: kept", 10);
    assert!(counted(&report).1.contains(&rows), "{:?}", report.remarks());
}

#[test]
fn highd_markings_that_are_not_two_carriageways() {
    let markings = |upper: &'static str, lower: &'static str| {
        move |made: &mut Made| {
            made.set("upperLaneMarkings", upper);
            made.set("lowerLaneMarkings", lower);
        }
    };
    let overlap = &["05_recordingMeta.csv", "line 2", "upperLaneMarkings", "overlap or are exchanged", "original"];
    refused(markings("0.50;4.00;7.50", "0.50;4.00;7.50"), overlap);
    refused(markings("0.50;4.00;7.50", "7.00;11.00"), overlap);
    refused(markings("18.00;22.00;26.00", "0.50;4.00;7.50"), overlap);
    let many: String = (0..100_000).map(|i| format!("{}", i / 10)).collect::<Vec<_>>().join(";");
    let error = highd(|made| made.set("upperLaneMarkings", &many)).unwrap_err();
    says(&error, &["05_recordingMeta.csv", "line 2", "upperLaneMarkings", "are 100000, more than the 17"]);
    assert!(error.to_string().len() < 500, "the message has an end");
}

#[test]
fn highd_lane_numbers_that_are_not_lanes() {
    let lane = &["05_tracks.csv", "laneid", "contradicts y and the markings", "one lane between two markings"];
    refused(|made| made.lines_of(1..=VEHICLES).for_each(|line| line.lane = 99), lane);
    refused(|made| made.lines_of(1..=VEHICLES).for_each(|line| line.lane = 2 + line.frame % 5), lane);
    // A few rows get the number of the lane that they are in.
    let wrong = |made: &mut Made| made.lines_of(7..=7).take(5).for_each(|line| line.lane = 2);
    let (recording, report) = highd(wrong).unwrap();
    let rows = ("rows have a laneId that contradicts y and the markings: the lane at y is taken", 5);
    assert_eq!(counted(&report), (vec![], vec![rows]));
    assert_eq!(recording.columns(), highd(|_| {}).unwrap().0.columns());
}

#[test]
fn highd_neighbours_that_are_not_there() {
    let names = |change: &dyn Fn(&mut Line)| {
        refused(
            |made| made.lines_of(1..=VEHICLES).filter(|line| line.neighbours[0] != 0).for_each(change),
            &["05_tracks.csv", "precedingid", "of 1200 values name vehicles that are not there", "by the id of tracks"],
        );
    };
    names(&|line| line.neighbours[0] = line.id);
    names(&|line| line.neighbours[0] = 900);
    names(&|line| line.neighbours[0] = -7);
    names(&|line| line.neighbours[0] = line.neighbours[1].max(1));
    names(&|line| line.neighbours[0] = 25 - line.id);
    // In some rows: the slots stay empty, for each reason counted.
    let (recording, report) = highd(|made| {
        for line in made.lines_of(7..=7) {
            line.neighbours[0] = match line.frame % 5 {
                0 => 7,
                1 => 900,
                2 => -7,
                3 => 9,
                _ => 6,
            };
        }
    })
    .unwrap();
    let not_taken = |who: &str, n: u64| (format!("neighbours named are {who}: not taken"), n);
    let expected = [
        not_taken("a negative number", 12),
        not_taken("a vehicle that is elsewhere along the road", 12),
        not_taken("a vehicle that is in another lane", 12),
        not_taken("the vehicle itself", 12),
    ];
    assert_eq!(report.contradictions.clone().into_iter().collect::<Vec<_>>(), expected);
    assert_eq!(report.unknown_neighbours, 12);
    let seven = recording.tracks().iter().find(|track| track.vehicle == 7).unwrap();
    assert!(seven.rows.clone().all(|row| recording.neighbour(row, gnp_data::Slot::Preceding).is_none()));
    // -1 stands for none.
    let none = highd(|made| {
        made.lines.iter_mut().flat_map(|line| &mut line.neighbours).for_each(|n| *n -= i64::from(*n == 0))
    });
    assert_eq!(none.unwrap().1.remarks(), Vec::<String>::new());
}

#[test]
fn two_rows_of_one_highd_vehicle_or_recording() {
    refused(
        |made| {
            let mut again = made.vehicles[3].clone();
            again.direction = 2;
            made.vehicles.push(again);
        },
        &["05_tracksMeta.csv", "lines 5 and 26", "vehicle 4 is listed twice", "remove the wrong row"],
    );
    let (recording, report) = highd(|made| made.vehicles.push(made.vehicles[3].clone())).unwrap();
    assert_eq!(recording.columns(), highd(|_| {}).unwrap().0.columns());
    assert_eq!(report.remarks(), ["1 rows of tracksMeta repeat one before"]);

    let mut files = Made::new().files();
    let row = files.recording_meta.lines().nth(1).unwrap().to_owned();
    files.recording_meta += &format!("{}\n", row.replace(",25,", ",30,"));
    says(&read(&files).unwrap_err(), &["05_recordingMeta.csv", "line 3", "2 rows describe one recording", "remove"]);
}

#[test]
fn highd_frames_and_counts_that_are_not_those_of_the_rows() {
    for column in 0..3 {
        refused(
            |made| made.vehicles.iter_mut().for_each(|it| it.frames[column] += 3),
            &["05_tracksMeta.csv", "line 2", "24 of 24 vehicles have other frames in tracks", "download"],
        );
    }
    // A table that was cut off.
    refused(|made| made.lines.truncate(1200), &["line 22", "4 of 24 vehicles"]);
    let (_, report) = highd(|made| made.lines.truncate(1400)).unwrap();
    assert_eq!(counted(&report).1, [("vehicles have other frames in tracks than tracksMeta says: kept", 1)]);

    for (column, value) in [("numVehicles", "50"), ("numCars", "3"), ("numTrucks", "9"), ("duration", "0.8")] {
        let error = highd(|made| made.set(column, value));
        says(
            &error.unwrap_err(),
            &["05_recordingMeta.csv", "line 2", &column.to_lowercase(), value, "another recording's"],
        );
    }
    let notes = |column: &str, value: &str| highd(|made| made.set(column, value)).unwrap().1.notes;
    assert_eq!(notes("numVehicles", "25"), ["recordingMeta has numVehicles 25, tracksMeta lists 24"]);
    assert_eq!(notes("duration", "1.5"), Vec::<String>::new(), "within a second");
    assert_eq!(notes("duration", "900"), ["recordingMeta has duration 900 s, tracks last 2.4 s"]);
    assert_eq!(notes("id", "6"), ["recordingMeta is of recording 6, the file is named 5"]);
}

#[test]
fn highd_sizes() {
    refused(
        |made| made.vehicles.iter_mut().for_each(|it| it.size = [99., 0.1]),
        &["05_tracksMeta.csv", "line 2", "width", "24 of 24 vehicles are of no size"],
    );
    refused(
        |made| made.vehicles.iter_mut().for_each(|it| it.size = [2., 5.]),
        &["05_tracks.csv", "line 2", "24 of 24 vehicles have another size than tracksMeta"],
    );
    let (_, report) = highd(|made| made.vehicles[6].size = [5.5, 2.]).unwrap();
    let rows = "vehicles have another size than tracksMeta: the corner is that of the row, the size that of tracksMeta";
    assert_eq!(counted(&report), (vec![], vec![(rows, 1)]));
}

#[test]
fn a_place_beyond_all_roads() {
    let error = highd(|made| made.lines[4].x = 1e30).unwrap_err();
    says(&error, &["05_tracks.csv", "line 6", "column `x`", "131 km", "repair"]);
    let error = highd(|made| made.lines[4].y = -2e5).unwrap_err();
    says(&error, &["05_tracks.csv", "line 6", "column `y`"]);
    for column in ["local_x", "local_y"] {
        let error = ngsim(|rows| if column == "local_x" { rows[4].x = 1e30 } else { rows[4].y = 1e30 }).unwrap_err();
        says(&error, &["made.csv", "line 6", column, "131 km", "repair"]);
    }
}

#[test]
fn two_columns_of_one_name() {
    for (from, to, places) in [("yVelocity", "xVelocity", "7 and 8"), ("leftFollowingId", "laneId", "21 and 25")] {
        let mut files = Made::new().files();
        files.tracks = files.tracks.replace(from, to);
        // The other's name may be missing as well; which is said first does not matter.
        let message = read(&files).unwrap_err().to_string();
        assert!(message.contains(&format!("columns {places} are both named")), "{message}");
        assert!(message.contains("05_tracks.csv, line 1") && message.contains(&to.to_lowercase()), "{message}");
    }
    let text = ngsim::csv(&traffic());
    for (from, to, places) in [("Global_Y", "Local_Y", "6 and 8"), ("Time_Headway", "Space_Headway", "17 and 18")] {
        let folder = tempfile::tempdir().unwrap();
        let file = put(folder.path(), "made.csv", &text.replace(from, to));
        let error = read_all(&file, Dataset::NGSIM).unwrap_err();
        assert!(matches!(error, DataError::DuplicateColumn { .. }), "{error}");
        says(&error, &["made.csv, line 1", &format!("columns {places} are both named"), "remove or rename"]);
    }
}

/// Twenty vehicles in four lanes for 60 frames.
fn traffic() -> Vec<Row> {
    let vehicles: Vec<(u32, i32, f64)> = (0..20).map(|i| (i + 1, 1 + (i % 4) as i32, 60. * f64::from(i))).collect();
    ngsim::rows(&vehicles, 0..60)
}

fn read_ngsim(text: &str) -> Result<(Recording, IngestReport), DataError> {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "made.csv", text);
    read_all(&file, Dataset::NGSIM).map(|mut all| all.remove(0))
}

fn ngsim(change: impl Fn(&mut Vec<Row>)) -> Result<(Recording, IngestReport), DataError> {
    let mut rows = traffic();
    change(&mut rows);
    read_ngsim(&ngsim::csv(&rows))
}

/// The rows with the fields of each changed, by place.
fn fields(change: impl Fn(&Row, &mut Vec<String>)) -> String {
    let lines = traffic().into_iter().map(|row| {
        let mut fields = row.fields();
        fields[2] = "60".into();
        change(&row, &mut fields);
        fields.join(",")
    });
    format!("{HEADER}\n{}\n", lines.collect::<Vec<_>>().join("\n"))
}

fn refused_ngsim(result: Result<(Recording, IngestReport), DataError>, parts: &[&str]) {
    let error = result.unwrap_err();
    assert!(matches!(error, DataError::Contradiction { .. }), "{error}");
    says(&error, parts);
}

#[test]
fn ngsim_vehicles_that_drive_backwards() {
    refused_ngsim(
        ngsim(|rows| rows.iter_mut().for_each(|row| row.y = 4000. - row.y)),
        &["made.csv", "line 2", "local_y", "20 of 20 vehicles drive backwards", "direction of travel"],
    );
    let back = |rows: &mut Vec<Row>| {
        rows.iter_mut().filter(|row| row.vehicle == 7).for_each(|row| row.y = 2000. - row.y);
    };
    let (recording, report) = ngsim(back).unwrap();
    assert_eq!(counted(&report).0, [("drive backwards", 1)]);
    assert_eq!((recording.tracks().len(), report.rows_read, report.rows), (19, 1200, 1140));
}

#[test]
fn ngsim_sizes() {
    let size = |vehicles: std::ops::Range<u32>, length: f64| {
        ngsim(|rows| rows.iter_mut().filter(|row| vehicles.contains(&row.vehicle)).for_each(|row| row.length = length))
    };
    let no_size = "are of no size a vehicle has (0.5 to 40 m by 0.3 to 5 m)";
    refused_ngsim(size(1..21, 1e9), &["made.csv", "line 2", "v_length", "20 of 20 vehicles", no_size]);
    let (recording, report) = size(7..8, 1e9).unwrap();
    assert_eq!((counted(&report).0, recording.tracks().len()), (vec![(no_size, 1)], 19));
    // One that changes is that of the first row, and does not move the centre.
    let (recording, report) = ngsim(|rows| rows[20..30].iter_mut().for_each(|row| row.length = 40.)).unwrap();
    let rows = "rows have another size than the first row of their track: the first is taken";
    assert!(counted(&report).1.contains(&(rows, 10)), "{:?}", report.remarks());
    assert_eq!(recording.columns().x, ngsim(|_| {}).unwrap().0.columns().x);
    refused_ngsim(
        ngsim(|rows| rows.iter_mut().for_each(|row| row.length = 15. + f64::from(row.frame % 7))),
        &["v_length", "rows have another size than the first row"],
    );
}

#[test]
fn ngsim_speeds_that_are_not_those_of_positions() {
    let speed = |vehicle: u32, value: &str| {
        let change = |row: &Row, fields: &mut Vec<String>| {
            if row.vehicle >= vehicle {
                fields[11] = value.into();
            }
        };
        read_ngsim(&fields(change))
    };
    for wrong in ["0", "15.24", "90"] {
        refused_ngsim(speed(1, wrong), &["made.csv", "line 2", "v_vel", "20 of 20 vehicles have another speed"]);
    }
    let (_, report) = speed(19, "0").unwrap();
    assert_eq!(
        counted(&report),
        (vec![], vec![("vehicles have another speed than their positions: positions are taken", 2)])
    );
    assert_eq!(speed(1, "52").unwrap().1.remarks(), Vec::<String>::new());
}

#[test]
fn ngsim_lanes_that_are_not_those_of_positions() {
    let lane = &["made.csv", "lane_id", "contradicts Local_X", "from the left"];
    refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.lane = 2)), lane);
    refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.lane = 5 - row.lane)), lane);
    refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.lane = 1 + (row.frame % 4) as i32)), lane);
    refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.x = 60. - row.x)), lane);
    let (recording, report) = ngsim(|rows| rows[..10].iter_mut().for_each(|row| row.lane = 4)).unwrap();
    let rows = "rows have a Lane_ID that contradicts Local_X: the lane is taken as unknown";
    assert!(counted(&report).1.contains(&(rows, 10)), "{:?}", report.remarks());
    assert_eq!(&recording.columns().lane[..11], [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
    assert!(recording.neighbour(5, gnp_data::Slot::Following).is_none());
}

#[test]
fn ngsim_leaders_that_positions_contradict() {
    // Vehicle i + 4 is 240 ft before vehicle i; 900 has no rows.
    let leaders = |named: &dyn Fn(&Row) -> (i64, f64)| {
        let (recording, report) = read_ngsim(&fields(|row, fields| {
            let (vehicle, headway) = named(row);
            (fields[14], fields[16]) = (vehicle.to_string(), headway.to_string());
        }))
        .unwrap();
        (recording.columns().named_leader.is_some(), report)
    };
    let ahead = |row: &Row| if row.vehicle <= 16 { i64::from(row.vehicle) + 4 } else { 900 };
    let (taken, report) = leaders(&|row| (ahead(row), 240.));
    assert!(taken && report.named_leaders == 4 * 60);
    assert_eq!(counted(&report), (vec![], vec![]));
    // The distance or the vehicle is wrong throughout: those that cannot be compared are not believed either.
    let rows = |report: &IngestReport| counted(report).1[0].1;
    for wrong in [&|row: &Row| (ahead(row), 120.) as (i64, f64), &|row: &Row| {
        (if row.vehicle > 4 { i64::from(row.vehicle) - 4 } else { 900 }, 240.)
    }] as [&dyn Fn(&Row) -> (i64, f64); 2]
    {
        let (taken, report) = leaders(wrong);
        assert!(!taken && report.named_leaders == 0);
        assert_eq!(rows(&report), 16 * 60, "{:?}", report.remarks());
        assert!(report.leaders_not_taken["most rows that can be compared contradict positions"] >= 60);
    }
    // In one row it is counted.
    let (taken, report) = leaders(&|row| (ahead(row), if row.vehicle == 3 && row.frame == 9 { 300. } else { 240. }));
    assert!(taken);
    assert_eq!(counted(&report).1, [("rows have a headway that is more than 5 m off the positions", 1)]);
    let (taken, report) = leaders(&|_| (-4, 240.));
    assert!(!taken);
    assert_eq!(counted(&report).1, [("rows have a negative number for the vehicle ahead: none is taken", 1200)]);
    let (_, report) = leaders(&|row| (i64::from(row.vehicle), 240.));
    assert_eq!(report.leaders_not_taken["it is the vehicle itself"], 1200);
}

#[test]
fn ngsim_numbers_of_rows_that_are_not_there() {
    let (_, report) =
        read_ngsim(&fields(|row, fields| fields[2] = if row.vehicle < 4 { "99" } else { "60" }.into())).unwrap();
    assert_eq!(
        counted(&report),
        (vec![], vec![("vehicles have another number of rows than Total_Frames says: kept", 3)])
    );
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

#[test]
fn no_recording_has_what_cannot_be() {
    let (good, _) = highd(|_| {}).unwrap();
    let refused = |change: &dyn Fn(&mut gnp_data::Columns, &mut Vec<gnp_data::Track>, &mut Vec<gnp_data::Road>)| {
        let (mut columns, mut tracks, mut roads) =
            (good.columns().clone(), good.tracks().to_vec(), good.roads().to_vec());
        change(&mut columns, &mut tracks, &mut roads);
        Recording::from_parts(good.meta().clone(), roads, tracks, columns).unwrap_err().to_string()
    };
    for part in [refused(&|c, _, _| c.x[3] = 1e30), refused(&|c, _, _| c.y[3] = -131_073.)] {
        assert!(part.contains("row 3 is more than 131072 m from the origin"), "{part}");
    }
    let fast = refused(&|c, _, _| (c.vx[3], c.vy[3]) = (90., 50.));
    assert!(fast.contains("row 3 moves at more than 100 m/s"), "{fast}");
    for size in [[99., 0.1], [1e9, 2.], [5., 0.2], [0.4, 1.]] {
        let message = refused(&|_, tracks, _| [tracks[2].length, tracks[2].width] = size);
        assert!(message.contains("vehicle 3") && message.contains("0.5 to 40 m long and 0.3 to 5 m wide"), "{message}");
    }
    let lines = refused(&|_, _, roads| {
        roads[1].lines = (0..18u8).map(|i| gnp_data::LaneMarking::new(f32::from(i), true)).collect();
    });
    assert!(lines.contains("carriageway 1 has 18 lines"), "{lines}");
    // Velocities of noisy positions are what they are.
    let (noisy, _) = ngsim(|rows| rows[30].y += 300.).unwrap();
    assert!(noisy.columns().vx.iter().any(|vx| *vx > 200.));
}
