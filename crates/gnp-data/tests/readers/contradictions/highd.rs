//! highD: against positions, markings and the other two files.

use gnp_data::{DataError, Dataset, IngestReport, Recording};

use super::{counted, says};
use crate::highd::{Files, RECORDING_META, TRACKS, TRACKS_META};
use crate::read_all;

/// A row of highD's tracks.
#[derive(Clone)]
pub(super) struct Line {
    pub(super) frame: i64,
    pub(super) id: i64,
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) size: [f64; 2],
    pub(super) v: [f64; 2],
    pub(super) neighbours: [i64; 8],
    pub(super) lane: i64,
}

/// A vehicle of highD's tracksMeta.
#[derive(Clone)]
pub(super) struct Vehicle {
    pub(super) id: i64,
    pub(super) size: [f64; 2],
    pub(super) frames: [i64; 3],
    pub(super) direction: i64,
}

/// A recording in highD's layout.
pub(super) struct Made {
    pub(super) lines: Vec<Line>,
    pub(super) vehicles: Vec<Vehicle>,
    /// The row of recordingMeta, by column.
    pub(super) meta: Vec<(&'static str, String)>,
}

pub(super) const FRAMES: i64 = 60;
pub(super) const VEHICLES: i64 = 24;

impl Made {
    /// Twelve vehicles on each carriageway, two lanes wide, 30 m apart at 25 m/s, 5 m by 2 m; all weave by 0.6 m.
    pub(super) fn new() -> Self {
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

    pub(super) fn lines_of(&mut self, vehicles: std::ops::RangeInclusive<i64>) -> impl Iterator<Item = &mut Line> {
        self.lines.iter_mut().filter(move |line| vehicles.contains(&line.id))
    }

    pub(super) fn files(&self) -> Files {
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

pub(super) fn read(files: &Files) -> Result<(Recording, IngestReport), DataError> {
    let folder = tempfile::tempdir().unwrap();
    files.put(folder.path(), "05");
    read_all(folder.path(), Dataset::HIGHD).map(|mut all| all.remove(0))
}

pub(super) fn highd(change: impl Fn(&mut Made)) -> Result<(Recording, IngestReport), DataError> {
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

#[test]
fn highd_vehicles_that_move_otherwise_than_they_are_said_to() {
    let all = 1..=VEHICLES;
    refused(
        |made| made.vehicles.iter_mut().for_each(|it| it.direction = 3 - it.direction),
        &["05_tracksMeta.csv", "line 2", "drivingDirection", "24 of 24 vehicles drive against", "one download"],
    );
    let velocity = &["05_tracks.csv", "xVelocity", "have another velocity than their positions", "frameRate"];
    refused(|made| made.lines_of(all.clone()).for_each(|line| line.v[0] = 0.), velocity);
    refused(|made| made.lines_of(all.clone()).for_each(|line| line.v[0] *= -1.), velocity);
    refused(|made| made.lines_of(all.clone()).for_each(|line| line.v[0] *= 1.2), velocity);
    let sideways = &["line 2,", "`yVelocity`", "24 of 24 vehicles that move sideways have another velocity"];
    refused(|made| made.lines_of(all.clone()).for_each(|line| line.v[1] *= -1.), sideways);
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
        let absent = format!("{} neighbours named have no row in the frame: not taken", 2 * FRAMES);
        assert_eq!(report.remarks(), [format!("1 vehicle left out, of those that {why}"), absent]);
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
fn highd_rows_with_another_velocity_than_their_positions() {
    let still = |vehicles: std::ops::RangeInclusive<i64>| {
        highd(|made| {
            made.lines_of(vehicles.clone())
                .filter(|line| (20..35).contains(&line.frame))
                .for_each(|line| line.v[0] = 0.);
        })
    };
    let rows = "rows have a velocity more than 3 m/s off their positions";
    assert_eq!(counted(&still(7..=7).unwrap().1), (vec![], vec![(&*format!("{rows}: kept"), 15)]));
    says(&still(1..=VEHICLES).unwrap_err(), &["05_tracks.csv", "line 21", "xVelocity", &format!("360 of 1440 {rows}")]);
}

#[test]
fn highd_velocities_across_the_road_are_judged_by_those_that_move_so() {
    // All but a few keep their lane, and the sign of yVelocity is wrong.
    let few = |moving: i64, wrong: i64| {
        highd(|made| {
            for line in &mut made.lines {
                if line.id > moving {
                    let lane = [2.25, 5.75, 0., 20., 24.][(line.lane - 2) as usize];
                    (line.y, line.v[1]) = (lane - 1., 0.);
                } else if line.id <= wrong {
                    line.v[1] *= -1.;
                }
            }
        })
    };
    says(&few(3, 3).unwrap_err(), &["`yVelocity`", "3 of 3 vehicles that move sideways", "along x and y"]);
    let left_out = |moving, wrong| few(moving, wrong).unwrap().1.vehicles_left_out.into_values().sum::<u64>();
    assert_eq!([left_out(2, 2), left_out(4, 2), left_out(3, 0)], [2, 2, 0]);
}

#[test]
fn highd_markings_of_another_place() {
    let shifted = |made: &mut Made| made.lines.iter_mut().for_each(|line| line.y += 3.8);
    let parts = &[
        "05_tracks.csv",
        "`y`",
        "of 720 rows of carriageway 1 are more than 0.5 m outside its markings",
        "one download",
    ];
    refused(shifted, parts);
    refused(|made| made.set("upperLaneMarkings", "-3.00;0.50;4.00"), parts);
    refused(|made| made.set("lowerLaneMarkings", "22.00;26.00;30.00"), &["of 720 rows of carriageway 2"]);
    // A lane of a ramp, which is not marked, is counted.
    let ramp = |vehicles: std::ops::RangeInclusive<i64>| {
        highd(|made| {
            made.lines_of(vehicles.clone()).filter(|line| line.id % 2 == 0).for_each(|line| line.y -= 3.5);
            made.lines.iter_mut().for_each(|line| line.neighbours = [0; 8]);
        })
    };
    let rows = "rows of carriageway 1 are more than 0.5 m outside its markings: kept";
    assert_eq!(counted(&ramp(1..=6).unwrap().1), (vec![], vec![(rows, 180)]));
    says(&ramp(1..=8).unwrap_err(), &["240 of 720 rows of carriageway 1"]);
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
    let many = |count: usize| (0..count).map(|i| (i / 10).to_string()).collect::<Vec<_>>().join(";");
    let error = highd(|made| made.set("upperLaneMarkings", &many(10_000))).unwrap_err();
    says(&error, &["05_recordingMeta.csv", "line 2", "upperLaneMarkings", "are 10000, more than the 17"]);
    assert!(error.to_string().len() < 500, "the message has an end");
    let error = highd(|made| made.set("upperLaneMarkings", &many(100_000))).unwrap_err();
    says(&error, &["05_recordingMeta.csv", "line 2 is longer than 64 KiB"]);
    assert!(error.to_string().len() < 500, "the message has an end");
}

#[test]
fn highd_lane_numbers_that_are_not_lanes() {
    let lane = &["05_tracks.csv", "laneId", "contradicts y and the markings", "one lane between two markings"];
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
            &["05_tracks.csv", "precedingId", "of 1200 values name vehicles that are not there", "by the id of tracks"],
        );
    };
    names(&|line| line.neighbours[0] = line.id);
    names(&|line| line.neighbours[0] = 900);
    names(&|line| line.neighbours[0] = -7);
    names(&|line| line.neighbours[0] = line.neighbours[1].max(1));
    names(&|line| line.neighbours[0] = 25 - line.id);
    // In a column with few names that is counted, as behind a cut; vehicles taken out are a remedy.
    for (wrong, named) in [(1, 1), (12, 20)] {
        let name = |made: &mut Made| {
            made.lines_of(7..=7).take(named).for_each(|line| line.neighbours[5] = 6);
            made.lines_of(7..=7).take(wrong).for_each(|line| line.neighbours[5] = 900);
        };
        assert_eq!(highd(name).unwrap().1.unknown_neighbours, wrong as u64);
    }
    refused(
        |made| made.lines_of(7..=7).take(20).for_each(|line| line.neighbours[5] = 900),
        &["rightPrecedingId", "20 of 20 values", "set names of vehicles you took out to 0"],
    );
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
    assert_eq!(report.remarks(), ["1 row of tracksMeta repeats one before"]);

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
    // A table that was cut off, perhaps by whoever reads it.
    let remove = "remove initialFrame, finalFrame and numFrames";
    refused(|made| made.lines.truncate(1200), &["line 22", "4 of 24 vehicles", remove]);
    let mut files = Made::new().files();
    let rows: Vec<&str> = files.tracks.lines().collect();
    files.tracks = rows[..1201].join("\n");
    for column in ["initialFrame", "finalFrame", "numFrames"] {
        files.tracks_meta = files.tracks_meta.replace(column, &format!("my{column}"));
    }
    assert_eq!(counted(&read(&files).unwrap().1).1, []);
    let (_, report) = highd(|made| made.lines.truncate(1400)).unwrap();
    assert_eq!(counted(&report).1, [("vehicles have other frames in tracks than tracksMeta says: kept", 1)]);

    for (column, value) in [("numVehicles", "12"), ("numCars", "3"), ("duration", "0.8")] {
        let error = highd(|made| made.set(column, value));
        says(&error.unwrap_err(), &["05_recordingMeta.csv", "line 2", column, value, "another recording's"]);
    }
    let notes = |column: &str, value: &str| highd(|made| made.set(column, value)).unwrap().1.notes;
    assert_eq!(notes("numVehicles", "25"), ["recordingMeta has numVehicles 25, tracksMeta lists 24"]);
    // Vehicles may have been taken out of the other two.
    assert_eq!(notes("numVehicles", "50"), ["recordingMeta has numVehicles 50, tracksMeta lists 24"]);
    assert_eq!(notes("numTrucks", "9"), ["recordingMeta has numTrucks 9, tracksMeta lists 0"]);
    assert_eq!(notes("duration", "1.5"), Vec::<String>::new(), "within a second");
    assert_eq!(notes("duration", "900"), ["recordingMeta has duration 900 s, tracks last 2.4 s"]);
    assert!(notes("numTrucks", "n/a")[0].starts_with("numTrucks is not compared: "));
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
    let wrong = |frames: i64| {
        highd(|made| made.lines_of(7..=7).filter(|line| line.frame <= frames).for_each(|line| line.size = [9., 2.]))
            .unwrap()
    };
    assert_eq!(counted(&wrong(60).1).0, [("have another size than tracksMeta", 1)]);
    let (recording, report) = wrong(5);
    assert_eq!(
        counted(&report),
        (vec![], vec![("rows have another size than tracksMeta: that of tracksMeta is taken", 5)])
    );
    assert_eq!(recording.columns(), highd(|_| {}).unwrap().0.columns());
}

#[test]
fn one_highd_vehicle_does_not_condemn_a_small_recording() {
    let few = |bad: std::ops::RangeInclusive<i64>| {
        highd(|made| {
            made.lines.retain(|line| line.id <= 8);
            made.vehicles.truncate(8);
            for line in &mut made.lines {
                line.neighbours = [0; 8];
                if bad.contains(&line.id) {
                    line.v[0] = 0.;
                }
            }
        })
    };
    let report = few(3..=3).unwrap().1;
    assert_eq!(counted(&report).0, [("have another velocity than their positions", 1)]);
    says(&few(3..=4).unwrap_err(), &["2 of 8 vehicles have another velocity"]);
    // Nor do those that name it.
    let (_, report) = highd(|made| {
        let three = [1, 3, 5];
        made.lines.retain(|line| three.contains(&line.id));
        made.vehicles.retain(|it| three.contains(&it.id));
        made.lines_of(3..=3).for_each(|line| line.v[0] = 0.);
        made.lines_of(5..=5).for_each(|line| line.neighbours[1] = 0);
    })
    .unwrap();
    assert_eq!((report.vehicles, report.unknown_neighbours as i64), (2, 2 * FRAMES));
}

#[test]
fn highd_speeds_of_one_fast_vehicle() {
    let at = |speed: f64| {
        highd(|made| {
            for line in made.lines_of(7..=7) {
                line.x -= (speed - 25.) * line.frame as f64 / 25.;
                line.v[0] = -speed;
                line.neighbours = [0; 8];
            }
        })
    };
    let (recording, report) = at(71.5).unwrap();
    assert_eq!((recording.tracks().len(), counted(&report).0), (24, vec![]));
    let error = at(101.).unwrap_err();
    assert!(matches!(error, DataError::Value { line: 362, .. }), "{error}");
    says(&error, &["05_tracks.csv", "xVelocity", "101.0 m/s", "repair"]);
}
