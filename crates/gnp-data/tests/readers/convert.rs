//! Tracks from one format to another and back.

use std::collections::BTreeMap;
use std::path::Path;

use gnp_data::{
    DataError, Dataset, LaneNumbers, Recording, TableVehicle, TrackOptions, TrackTable, Tracks, VehicleClass, Written,
    discover, format_of,
};
use gnp_road::ReferenceLine;
use tempfile::tempdir;

use crate::fixtures;

/// Tracks of two vehicles that turn, one with a gap, and of one that goes the other way, for 15 s at 10 Hz.
fn made() -> TrackTable {
    named("a b <&> ü")
}

fn named(first: &str) -> TrackTable {
    let mut table = TrackTable::new(Dataset::TRACKS, "somewhere", "made");
    let names = [first, "7", "x"];
    let classes = [VehicleClass::Car, VehicleClass::Truck, VehicleClass::Motorcycle];
    let sizes = [[4.41, 1.83], [16.5, 2.55], [2.2, 0.85]];
    for ((name, class), [length, width]) in names.into_iter().zip(classes).zip(sizes) {
        let mut vehicle = TableVehicle::named(name);
        (vehicle.class, vehicle.length, vehicle.width) = (Some(class), Some(length), Some(width));
        table.vehicles.push(vehicle);
    }
    let (mut vx, mut vy, mut heading, mut lane) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for step in 0..150 {
        for (vehicle, start, speed, number) in [(0, 0., 30., 1), (1, 45.5, 22.25, 2), (2, 900., -25., 1)] {
            if vehicle == 1 && (60..75).contains(&step) {
                continue;
            }
            let (t, radius) = (0.1 * f64::from(step), 800. + 3.5 * f64::from(number));
            let angle = (start + speed * t) / radius;
            table.vehicle.push(vehicle);
            table.time_s.push(86_400. + t);
            table.x.push(691_000. + radius * angle.sin());
            table.y.push(5_334_000. - radius * angle.cos());
            vx.push(speed * angle.cos());
            vy.push(speed * angle.sin());
            heading.push(f64::atan2(speed * angle.sin(), speed * angle.cos()));
            lane.push(number as i16);
        }
    }
    (table.velocity, table.heading, table.lane) = (Some([vx, vy]), Some(heading), Some(lane));
    table.lane_numbers = LaneNumbers::FromLeft;
    table
}

fn write(tracks: &Tracks, to: Dataset, place: &Path, options: &TrackOptions) -> Result<Written, DataError> {
    format_of(to).unwrap().write(tracks, options, place)
}

fn read(place: &Path, dataset: Dataset) -> Vec<Tracks> {
    let format = format_of(dataset).unwrap();
    let all = discover(place, dataset).unwrap().into_iter();
    all.flat_map(|source| Tracks::of(format, &source, &TrackOptions::default()).unwrap()).map(|(it, _)| it).collect()
}

/// Position, class and size of every vehicle, by name and ms.
type States = BTreeMap<(String, i64), ([f64; 2], VehicleClass, [f32; 2])>;

fn states(all: &[Tracks]) -> States {
    let mut states = States::new();
    for tracks in all {
        let table = tracks.table();
        for row in 0..table.len() {
            let vehicle = &table.vehicles[table.vehicle[row] as usize];
            let (class, size) =
                (vehicle.class.unwrap(), [vehicle.length, vehicle.width].map(Option::unwrap_or_default));
            let key = (vehicle.name.clone(), (table.time_s[row] * 1e3).round() as i64);
            assert!(states.insert(key, ([table.x[row], table.y[row]], class, size)).is_none(), "a row stands twice");
        }
    }
    states
}

/// Whether all vehicles are where and what they were, to 1 cm.
fn assert_same(after: &States, before: &States, what: &str) {
    let other = after.keys().zip(before.keys()).find(|(a, b)| a != b);
    assert!(other.is_none() && after.len() == before.len(), "{what}: {other:?}, {} of {}", after.len(), before.len());
    for (key, (position, class, size)) in after {
        let (there, kind, box_) = before[key];
        let off = (position[0] - there[0]).hypot(position[1] - there[1]);
        assert!(off < 0.01, "{what}: {key:?} is {off} m off");
        assert_eq!(*class, kind, "{what}: {key:?}");
        assert!((size[0] - box_[0]).abs() < 0.01 && (size[1] - box_[1]).abs() < 0.01, "{what}: {key:?} {size:?}");
    }
}

#[test]
fn tracks_in_a_plane_come_back_as_they_were_on_any_road() {
    let folder = tempdir().unwrap();
    let (first, options) = (Tracks::Table(made()), TrackOptions::default());
    let before = states(std::slice::from_ref(&first));
    for (dataset, name) in [
        (Dataset::TRACKS, "a.csv"),
        (Dataset::TRACKS, "a.csv.gz"),
        (Dataset::TRACKS, "a.parquet"),
        (Dataset::SUMO, "a.xml"),
        (Dataset::SUMO, "a.xml.gz"),
    ] {
        let place = folder.path().join(name.replace('.', "-")).join(name);
        let written = write(&first, dataset, &place, &options).unwrap();
        assert_eq!((written.rows, written.vehicles), (435, 3), "{name}");
        let after = read(&place, dataset);
        assert_eq!(after.len(), 1, "{name}");
        assert!(!after[0].is_simulated(), "{name}: recorded tracks stay recorded");
        assert_same(&states(&after), &before, name);
        let (table, of_first) = (after[0].table().into_owned(), made());
        let velocity = |table: &TrackTable, row: usize| match (&table.velocity, &table.speed, &table.heading) {
            (Some([vx, vy]), ..) => [vx[row], vy[row]],
            (_, Some(speed), Some(heading)) => [speed[row] * heading[row].cos(), speed[row] * heading[row].sin()],
            _ => panic!("{name}: velocities are gone"),
        };
        for row in 0..table.len() {
            let (a, b) = (velocity(&table, row), velocity(&of_first, row));
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.01, "{name}: row {row}: {a:?}, {b:?}");
        }
        assert_eq!(table.lane, of_first.lane, "{name}");
    }
}

#[test]
fn scenarios_of_11_s_hold_everything_but_sizes_and_lanes() {
    let folder = tempdir().unwrap();
    let first = Tracks::Table(made());
    let written = write(&first, Dataset::AV2, &folder.path().join("made"), &TrackOptions::default()).unwrap();
    assert_eq!((written.files.len(), written.rows), (2, 435));
    let lost: Vec<(&str, u64)> = written.lost.iter().map(|(what, n)| (what.as_str(), *n)).collect();
    assert!(lost.iter().any(|(what, n)| what.contains("lengths") && *n == 3), "{lost:?}");
    assert!(lost.iter().any(|(what, n)| what.contains("trucks") && *n == 1), "{lost:?}");
    let all = read(folder.path(), Dataset::AV2);
    // A scenario begins at 0 again.
    let mut after = States::new();
    for (scenario, tracks) in all.iter().enumerate() {
        let start = 86_400_000 + 11_000 * scenario as i64;
        after.extend(states(std::slice::from_ref(tracks)).into_iter().map(|((name, t), it)| ((name, t + start), it)));
    }
    let mut before = states(std::slice::from_ref(&first));
    before.values_mut().for_each(|state| state.2 = [0.; 2]);
    assert_same(&after, &before, "scenarios");
    let mut slow = made();
    slow.time_s.iter_mut().for_each(|t| *t = 2. * (*t - 86_400.));
    let error = write(&Tracks::Table(slow), Dataset::AV2, &folder.path().join("slow"), &TrackOptions::default());
    assert!(matches!(error, Err(DataError::Unwritable { .. })), "another rate is refused");
}

/// A recording that comes with the project.
fn embedded(file: &str, dataset: Dataset) -> Recording {
    match read(&fixtures(file), dataset).remove(0) {
        Tracks::Recording(recording) => recording,
        _ => panic!("{file} lies along a road"),
    }
}

fn assert_same_recording(after: &Recording, before: &Recording, what: &str) {
    let ids = |it: &Recording| {
        it.tracks().iter().map(|t| (t.vehicle, t.first_frame, t.rows.clone(), t.class)).collect::<Vec<_>>()
    };
    let other = ids(after).into_iter().zip(ids(before)).find(|(a, b)| a != b);
    assert!(other.is_none() && after.tracks().len() == before.tracks().len(), "{what}: {other:?}");
    for row in 0..before.len() {
        let (a, b) = (after.state(row), before.state(row));
        assert!((a.x - b.x).abs() < 0.01 && (a.y - b.y).abs() < 0.01, "{what}: row {row}: {a:?}, {b:?}");
    }
    let sizes = after.tracks().iter().zip(before.tracks());
    assert!(
        sizes.into_iter().all(|(a, b)| (a.length - b.length).abs() < 0.01 && (a.width - b.width).abs() < 0.01),
        "{what}"
    );
}

#[test]
fn layouts_along_a_road_are_written_as_they_are_read() {
    let folder = tempdir().unwrap();
    let options = TrackOptions::default();
    let (ngsim, highd) =
        (embedded("ngsim/us101-13_1.csv.gz", Dataset::NGSIM), embedded("highd/03_tracks.csv.gz", Dataset::HIGHD));
    for name in ["b.csv", "b.txt", "b.csv.gz"] {
        let place = folder.path().join(name.replace('.', "-")).join(name);
        write(&Tracks::Recording(ngsim.clone()), Dataset::NGSIM, &place, &options).unwrap();
        let [Tracks::Recording(after)] = &read(&place, Dataset::NGSIM)[..] else { panic!("{name}") };
        assert_same_recording(after, &ngsim, name);
        assert_eq!(after.columns().lane, ngsim.columns().lane, "{name}: the embedded scene has main lanes alone");
        assert_eq!(after.meta().start_s, ngsim.meta().start_s, "{name}");
    }
    let place = folder.path().join("drone");
    std::fs::create_dir(&place).unwrap();
    let written = write(&Tracks::Recording(highd.clone()), Dataset::HIGHD, &place.join("09"), &options).unwrap();
    assert_eq!(written.files.len(), 3);
    let [Tracks::Recording(after)] = &read(&place, Dataset::HIGHD)[..] else { panic!("three files are one recording") };
    assert_same_recording(after, &highd, "highD");
    assert_eq!(after.columns().neighbours, highd.columns().neighbours);
    for (a, b) in after.roads().iter().zip(highd.roads()) {
        assert!(
            a.lines.iter().zip(&b.lines).all(|(a, b)| (a.y - b.y).abs() < 1e-3 && a.kind == b.kind),
            "{a:?}, {b:?}"
        );
    }
}

#[test]
fn a_road_and_plain_tracks_of_it_are_one() {
    let folder = tempdir().unwrap();
    let along_y = ReferenceLine::straight([0.; 2], std::f64::consts::FRAC_PI_2);
    for (dataset, before, road, plane) in [
        (Dataset::NGSIM, embedded("ngsim/us101-13_1.csv.gz", Dataset::NGSIM), along_y, Dataset::TRACKS),
        (
            Dataset::HIGHD,
            embedded("highd/03_tracks.csv.gz", Dataset::HIGHD),
            ReferenceLine::straight([0.; 2], 0.),
            Dataset::TRACKS,
        ),
        (
            Dataset::HIGHD,
            embedded("highd/03_tracks.csv.gz", Dataset::HIGHD),
            ReferenceLine::straight([0.; 2], 0.),
            Dataset::SUMO,
        ),
    ] {
        let folder = folder.path().join(format!("{dataset}-{plane}"));
        let options = TrackOptions { road: Some(road), ..TrackOptions::default() };
        let there = folder.join(if plane == Dataset::SUMO { "a.xml" } else { "a.csv" });
        let written = write(&Tracks::Recording(before.clone()), plane, &there, &options).unwrap();
        assert_eq!(written.rows as usize, before.len());
        let between = read(&there, plane);
        let back = folder.join("back");
        std::fs::create_dir(&back).unwrap();
        let name = if dataset == Dataset::HIGHD { "a" } else { "a.csv" };
        write(&between[0], dataset, &back.join(name), &options).unwrap();
        let [Tracks::Recording(after)] = &read(&back, dataset)[..] else { panic!("{dataset}") };
        assert_same_recording(after, &before, &format!("{dataset} through {plane}"));
    }
}

#[test]
fn what_a_layout_does_not_take_or_hold_is_said() {
    let folder = tempdir().unwrap();
    let options = TrackOptions::default();
    let highd = Tracks::Recording(embedded("highd/03_tracks.csv.gz", Dataset::HIGHD));
    let error = write(&highd, Dataset::NGSIM, &folder.path().join("a.csv"), &options).unwrap_err().to_string();
    assert!(error.contains("NGSIM") && error.contains("25 frames a second"), "{error}");
    assert!(!folder.path().join("a.csv").exists());
    let table = write(&highd, Dataset::TRACKS, &folder.path().join("a.csv"), &options).unwrap();
    assert!(table.lost.keys().any(|what| what.contains("SIMULATED")), "{:?}", table.lost);
    // A table of text has no quotes, Parquet and XML have.
    let quoted = Tracks::Table(named("a, \"b\""));
    let written = write(&quoted, Dataset::TRACKS, &folder.path().join("q.csv"), &options).unwrap();
    assert!(written.lost.iter().any(|(what, n)| what.contains("commas") && *n == 1), "{:?}", written.lost);
    for (dataset, name) in [(Dataset::TRACKS, "q.parquet"), (Dataset::SUMO, "q.xml")] {
        let place = folder.path().join("q").join(name);
        write(&quoted, dataset, &place, &options).unwrap();
        assert_eq!(read(&place, dataset)[0].table().vehicles[0].name, "a, \"b\"", "{name}");
    }
    let twins = Tracks::Table(named("7,"));
    assert!(matches!(
        write(&twins, Dataset::TRACKS, &folder.path().join("t.csv"), &options),
        Err(DataError::Unwritable { .. })
    ));
    // On a bend there is no road for a layout along one.
    let error = write(&Tracks::Table(made()), Dataset::HIGHD, &folder.path().join("b"), &options).unwrap_err();
    assert!(matches!(error, DataError::Tracks { .. }), "{error}");
    // Names become numbers, and who goes across is counted.
    let mut straight = made();
    for row in 0..straight.len() {
        let forward = straight.vehicle[row] != 2;
        let t = straight.time_s[row] - 86_400.;
        straight.x[row] = if forward { 30. * t } else { 900. - 25. * t };
        straight.y[row] = if forward { -3.5 * f64::from(straight.lane.as_ref().unwrap()[row]) } else { 12. };
        straight.heading.as_mut().unwrap()[row] = if forward { 0. } else { std::f64::consts::PI };
    }
    straight.velocity = None;
    straight.x.iter_mut().zip(&straight.vehicle).for_each(|(x, vehicle)| *x += 60. * f64::from(*vehicle == 1));
    let written = write(&Tracks::Table(straight), Dataset::NGSIM, &folder.path().join("c.csv"), &options).unwrap();
    assert_eq!(written.files.len(), 2, "a file for each direction");
    assert!(written.lost.iter().any(|(what, n)| what.contains("names") && *n == 3), "{:?}", written.lost);
}
