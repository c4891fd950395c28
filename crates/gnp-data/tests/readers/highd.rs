//! highD: corner to centre, both carriageways, markings, named neighbours.

use std::path::Path;

use gnp_data::{Dataset, MarkingKind, Recording, Slot, VehicleClass};

use super::{fixtures, gzip, put, read_all};

pub(crate) const TRACKS: &str = "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,frontSightDistance,backSightDistance,dhw,thw,ttc,precedingXVelocity,precedingId,followingId,leftPrecedingId,leftAlongsideId,leftFollowingId,rightPrecedingId,rightAlongsideId,rightFollowingId,laneId";
pub(crate) const TRACKS_META: &str = "id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection,traveledDistance,minXVelocity,maxXVelocity,meanXVelocity,minDHW,minTHW,minTTC,numLaneChanges";
pub(crate) const RECORDING_META: &str = "id,frameRate,locationId,speedLimit,month,weekDay,startTime,duration,totalDrivenDistance,totalDrivenTime,numVehicles,numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings";

/// The three files of a recording as text.
#[derive(Clone)]
pub(crate) struct Files {
    pub(crate) tracks: String,
    pub(crate) tracks_meta: String,
    pub(crate) recording_meta: String,
}

impl Files {
    pub(crate) fn put(&self, folder: &Path, name: &str) {
        put(folder, &format!("{name}_tracks.csv"), &self.tracks);
        put(folder, &format!("{name}_tracksMeta.csv"), &self.tracks_meta);
        put(folder, &format!("{name}_recordingMeta.csv"), &self.recording_meta);
    }
}

/// Two vehicles on each carriageway for ten frames, each 5 m long and 2 m wide, at 25 m/s; the
/// first of each pair drifts 0.1 m a frame to the left of travel, the second keeps its lane to the
/// right of it. Corners in the image: carriageway 1 drives to the left, 2 to the right.
pub(crate) fn scene() -> Files {
    let mut tracks = format!("{TRACKS}\n");
    let mut row = |frame: i32, id: i32, x: f64, y: f64, v: [f64; 2], named: [i32; 8], lane: i32| {
        let named = named.map(|id| id.to_string()).join(",");
        let [vx, vy] = v;
        tracks += &format!("{frame},{id},{x:.2},{y:.2},5.00,2.00,{vx},{vy},0,0,0,0,0,0,0,0,{named},{lane}\n");
    };
    for frame in 1..=10 {
        let t = f64::from(frame - 1);
        // Left of travel is down in the image.
        row(frame, 1, 200. - t, 4. + 0.1 * t, [-25., 2.5], [0, 0, 0, 0, 0, 0, 0, 2], 2);
    }
    for frame in 1..=10 {
        let t = f64::from(frame - 1);
        row(frame, 2, 230. - t, 1., [-25., 0.], [0, 0, 1, 0, 0, 0, 0, 0], 1);
    }
    for frame in 1..=10 {
        let t = f64::from(frame - 1);
        // Left of travel is up in the image.
        row(frame, 3, 100. + t, 20. - 0.1 * t, [25., -2.5], [0, 0, 0, 0, 0, 0, 4, 0], 5);
    }
    for frame in 1..=10 {
        let t = f64::from(frame - 1);
        row(frame, 4, 102. + t, 24., [25., 0.], [0, 0, 0, 3, 0, 0, 0, 0], 6);
    }
    let body = |id: i32, class: &str, direction: i32| {
        format!("{id},5.00,2.00,1,10,10,{class},{direction},9,25,25,25,0,0,0,0\n")
    };
    let bodies = [body(1, "Car", 1), body(2, "Truck", 1), body(3, "Car", 2), body(4, "Car", 2)].concat();
    Files {
        tracks,
        tracks_meta: format!("{TRACKS_META}\n{bodies}"),
        recording_meta: format!(
            "{RECORDING_META}\n1,25,4,-1.0,9.2017,Tue,08:38,90.0,1,1,4,3,1,0.50;4.00;7.50,18.00;22.00;26.00\n"
        ),
    }
}

fn read_scene(files: &Files) -> Recording {
    let folder = tempfile::tempdir().unwrap();
    files.put(folder.path(), "09");
    let mut all = read_all(folder.path(), Dataset::HIGHD).unwrap();
    assert_eq!(all.len(), 1);
    all.remove(0).0
}

#[test]
fn both_carriageways_stand_where_their_metres_say() {
    let recording = read_scene(&scene());
    assert_eq!(recording.meta().site, "highd-4");
    assert_eq!((recording.meta().name.as_str(), recording.meta().rate_hz), ("09", 25.));
    let state = |vehicle: u32, frame: u32| {
        let track = recording.tracks().iter().find(|track| track.vehicle == vehicle).unwrap();
        (recording.state(track.row_at(frame).unwrap()), track.road)
    };
    let close = |found: [f32; 4], expected: [f32; 4]| {
        assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-4), "{found:?} for {expected:?}");
    };
    let array = |s: gnp_data::TrackState| [s.x, s.y, s.vx, s.vy];
    // Carriageway 1: corner (200, 4), centre (202.5, 5), rotated by pi after the flip.
    let (one, road) = state(1, 1);
    assert_eq!(road, 0);
    close(array(one), [-202.5, 5., 25., 2.5]);
    close(array(state(1, 10).0), [-193.5, 5.9, 25., 2.5]);
    // Carriageway 2: corner (100, 20), centre (102.5, 21).
    let (three, road) = state(3, 1);
    assert_eq!(road, 1);
    close(array(three), [102.5, -21., 25., 2.5]);
    close(array(state(3, 10).0), [111.5, -20.1, 25., 2.5]);
    // The second of each pair is to the right.
    assert!(state(2, 1).0.y < one.y && state(4, 1).0.y < three.y);
    assert_eq!(recording.tracks()[1].class, VehicleClass::Truck);
}

#[test]
fn markings_turn_with_their_carriageway() {
    let recording = read_scene(&scene());
    let lines = |road: usize| recording.roads()[road].lines.iter().map(|l| (l.kind, l.y)).collect::<Vec<_>>();
    use MarkingKind::{Boundary, LaneDivider};
    assert_eq!(lines(0), [(Boundary, 0.5), (LaneDivider, 4.), (Boundary, 7.5)]);
    assert_eq!(lines(1), [(Boundary, -26.), (LaneDivider, -22.), (Boundary, -18.)]);
    assert!(recording.roads().iter().all(|road| !road.fitted));
    // Vehicle 1 in lane 2 is left of the centre line, vehicle 2 in lane 1 right of it.
    assert!(recording.state(0).y > 4. && recording.state(10).y < 4.);
}

/// Centres in the image's metres, y down: what a forecast is given back in.
#[test]
fn positions_go_back_to_the_image() {
    let recording = read_scene(&scene());
    for (track, corner, drift) in [(0, [200., 4.], [-1., 0.1]), (2, [100., 20.], [1., -0.1])] {
        let track = &recording.tracks()[track];
        let road = &recording.roads()[usize::from(track.road)];
        for (t, row) in track.rows.clone().enumerate() {
            let centre = [0, 1].map(|i| corner[i] + [2.5, 1.][i] + drift[i] * t as f64);
            let c = recording.columns();
            let position = [c.x[row], c.y[row]];
            let back = recording.to_file_coordinates(track.road, position);
            assert!((back[0] - centre[0]).hypot(back[1] - centre[1]) < 1e-4, "{back:?} {centre:?}");
            let velocity = road.velocity_to_file_coordinates(position, [c.vx[row], c.vy[row]]);
            assert_eq!(velocity, [25. * drift[0], 25. * drift[1]].map(|v: f64| (v * 10.).round() / 10.));
        }
    }
}

#[test]
fn named_neighbours_are_tracks() {
    let recording = read_scene(&scene());
    let vehicle = |row: usize, slot: Slot| recording.neighbour(row, slot).map(|t| recording.tracks()[t].vehicle);
    assert_eq!(vehicle(3, Slot::RightFollowing), Some(2));
    assert_eq!(vehicle(13, Slot::LeftPreceding), Some(1));
    assert_eq!(vehicle(23, Slot::RightAlongside), Some(4));
    assert_eq!(vehicle(33, Slot::LeftAlongside), Some(3));
    assert_eq!(vehicle(33, Slot::RightAlongside), None);
}

#[test]
fn files_are_known_by_their_columns_packed_or_not() {
    let folder = tempfile::tempdir().unwrap();
    let files = scene();
    std::fs::write(folder.path().join("a_rows.txt.gz"), gzip(&files.tracks)).unwrap();
    std::fs::write(folder.path().join("a_cars.csv.gz"), gzip(&files.tracks_meta)).unwrap();
    put(folder.path(), "a_info.csv", &files.recording_meta);
    files.put(folder.path(), "b");
    put(folder.path(), "SIMULATED", "");
    let all = read_all(folder.path(), Dataset::HIGHD).unwrap();
    assert_eq!(all.len(), 2);
    assert_eq!(all[0].0.columns(), all[1].0.columns());
    assert!(all.iter().all(|(recording, _)| recording.meta().simulated));
    // One of the three files stands for its recording.
    let one = read_all(&folder.path().join("b_tracksMeta.csv"), Dataset::HIGHD).unwrap();
    assert_eq!(one.iter().map(|(r, _)| r.meta().name.as_str()).collect::<Vec<_>>(), ["b"]);
}

#[test]
fn the_embedded_recordings_are_whole_and_left_is_left_on_both_carriageways() {
    let all = read_all(&fixtures("highd"), Dataset::HIGHD).unwrap();
    let counts: Vec<(u64, u64)> = all.iter().map(|(_, q)| (q.vehicles, q.rows)).collect();
    assert_eq!(counts, [(132, 43_732), (177, 61_933), (168, 57_193)]);
    for (recording, quality) in &all {
        assert!(recording.meta().simulated && quality.simulated);
        assert_eq!((quality.unknown_neighbours, quality.overlaps, quality.gaps), (0, 0, 0));
        let c = recording.columns();
        let mut seen = [0; 2];
        for track in recording.tracks() {
            for row in track.rows.clone().step_by(20) {
                assert!(c.vx[row] > 0., "everybody drives forward");
                let side = |slot: Slot| {
                    let other = recording.neighbour(row, slot)?;
                    let frame = track.first_frame + (row - track.rows.start) as u32;
                    Some(recording.state(recording.tracks()[other].row_at(frame)?))
                };
                if let Some(left) = side(Slot::LeftPreceding) {
                    assert!(left.y > c.y[row] && left.x > c.x[row]);
                    seen[usize::from(track.road)] += 1;
                }
                if let Some(right) = side(Slot::RightFollowing) {
                    assert!(right.y < c.y[row] && right.x < c.x[row]);
                    seen[usize::from(track.road)] += 1;
                }
            }
        }
        assert!(seen.iter().all(|n| *n > 100), "{seen:?} rows with a neighbour aside");
    }
}

#[test]
fn recorded_velocities_are_those_of_the_positions() {
    let all = read_all(&fixtures("highd"), Dataset::HIGHD).unwrap();
    for (recording, _) in &all {
        let c = recording.columns();
        for track in recording.tracks() {
            let (a, b) = (track.rows.start, track.rows.end - 1);
            let seconds = (b - a) as f32 / 25.;
            let mean = |v: &[f32]| v[a..=b].iter().sum::<f32>() / (b - a + 1) as f32;
            let travelled = [(c.x[b] - c.x[a]) / seconds, (c.y[b] - c.y[a]) / seconds];
            assert!((mean(&c.vx) - travelled[0]).abs() < 0.5, "vehicle {}: {travelled:?}", track.vehicle);
            assert!((mean(&c.vy) - travelled[1]).abs() < 0.2, "vehicle {}: {travelled:?}", track.vehicle);
        }
    }
}
