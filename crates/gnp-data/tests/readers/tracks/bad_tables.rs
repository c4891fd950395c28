//! Tables of tracks that are refused, or believed in part.

use super::*;

#[test]
fn tracks_without_rows_or_vehicles_are_refused() {
    let empty = TrackTable::new(Dataset::TRACKS, "A 9", "monday");
    let (problem, message) = fault(&empty);
    assert_eq!(problem, TrackProblem::Empty);
    assert!(message.contains("tracks monday"), "{message}");
    let mut walkers = traffic(0., 10., 20);
    walkers
        .vehicles
        .iter_mut()
        .for_each(|it| it.left_out = Some("are no motor vehicles but of class pedestrian".into()));
    assert!(fault(&walkers).1.contains("pedestrian"));
}

#[test]
fn values_that_cannot_be_name_row_and_column() {
    for (value, column) in [(f64::NAN, "x"), (f64::INFINITY, "y"), (f64::NEG_INFINITY, "time"), (1e300, "x")] {
        let mut table = traffic(0., 10., 20);
        match column {
            "x" => table.x[17] = value,
            "y" => table.y[17] = value,
            _ => table.time_s[17] = value,
        }
        let (problem, message) = fault(&table);
        assert_eq!(problem, TrackProblem::Value);
        assert!(message.contains(&format!("row 17, column `{column}`")), "{message}");
    }
    let mut short = traffic(0., 10., 20);
    short.y.pop();
    assert_eq!(fault(&short).0, TrackProblem::Columns);
    let mut unknown = traffic(0., 10., 20);
    unknown.vehicle[3] = 9;
    assert_eq!(fault(&unknown).0, TrackProblem::Columns);
}

#[test]
fn feet_are_not_metres() {
    let feet = |table: &mut TrackTable| table.x.iter_mut().chain(&mut table.y).for_each(|value| *value /= 0.3048);
    // Fast traffic by its speeds, slow traffic by its lanes, by where it drives, or by its sizes.
    let mut fast = traffic(0., 10., 40);
    feet(&mut fast);
    let (problem, message) = fault(&fast);
    assert!(problem == TrackProblem::Unit && message.contains("faster than 70 m/s"), "{message}");
    assert!(message.contains("multiply feet by 0.3048"), "{message}");
    let mut slow = traffic(0., 10., 40);
    slow.x.iter_mut().for_each(|x| *x *= 0.3);
    let mut numbered = slow.clone();
    feet(&mut numbered);
    let (problem, message) = fault(&numbered);
    assert!(problem == TrackProblem::Unit && message.contains("11.8 m wide"), "{message}");
    numbered.lane = None;
    let (problem, message) = fault(&numbered);
    assert!(problem == TrackProblem::Unit && message.contains("m apart"), "{message}");
    slow.vehicles.iter_mut().for_each(|it| (it.length, it.width) = (Some(15.), Some(6.)));
    let (problem, message) = fault(&slow);
    assert!(problem == TrackProblem::Unit && message.contains("6.0 m wide"), "{message}");
}

#[test]
fn speeds_in_another_unit_are_named() {
    for (factor, unit) in [(3.6, "km/h"), (2.23694, "mph")] {
        let mut table = traffic(0.5, 10., 40);
        let slow = |i: usize| factor * (30. - 3. * (i % 9 % 3) as f64);
        table.speed = Some((0..table.len()).map(|i| slow(i) * 0.5).collect());
        // At half the speed, so that no number is beyond every vehicle.
        (0..table.len()).for_each(|i| {
            let (t, v) = (table.time_s[i], 0.5 * slow(i) / factor);
            table.x[i] -= v * t * 0.5f64.cos();
            table.y[i] -= v * t * 0.5f64.sin();
        });
        table.heading = Some(vec![0.5; table.len()]);
        let (problem, message) = fault(&table);
        assert!(problem == TrackProblem::Contradiction && message.contains(unit), "{message}");
    }
}

#[test]
fn headings_of_another_convention_are_named() {
    let heading = 0.5f64;
    for (value, hint) in [
        (heading.to_degrees(), "in degrees"),
        (std::f64::consts::FRAC_PI_2 - heading, "clockwise from north"),
        (90. - heading.to_degrees(), "clockwise from north"),
    ] {
        let mut table = traffic(heading, 10., 40);
        table.heading = Some(vec![value; table.len()]);
        let (problem, message) = fault(&table);
        assert!(problem == TrackProblem::Contradiction && message.contains(hint), "{value}: {message}");
    }
}

#[test]
fn one_id_for_several_vehicles_is_refused_and_a_repeated_row_is_not() {
    let mut twins = traffic(0., 10., 20);
    twins.vehicle.iter_mut().for_each(|vehicle| *vehicle /= 2);
    let (problem, message) = fault(&twins);
    assert_eq!(problem, TrackProblem::Duplicate);
    assert!(message.contains("in two places at 0 s"), "{message}");
    let mut repeated = traffic(0., 10., 20);
    repeated.append(traffic(0., 10., 2));
    let (recording, report) = read_table(&repeated).unwrap();
    assert_eq!((recording.len(), report.duplicates, report.rows_read), (180, 18, 198));
}

#[test]
fn crossing_traffic_is_no_road() {
    let mut crossing = traffic(0., 10., 40);
    for i in (0..crossing.len()).filter(|i| i % 3 == 0) {
        (crossing.x[i], crossing.y[i]) = (crossing.y[i], crossing.x[i]);
    }
    let (problem, message) = fault(&crossing);
    assert!(problem == TrackProblem::Road && message.contains("3 of 9 vehicles"), "{message}");
    // One of twelve is left out.
    let mut one = traffic(0., 10., 40);
    for i in (0..one.len()).filter(|i| i % 9 == 0) {
        (one.x[i], one.y[i]) = (one.y[i], one.x[i]);
    }
    let (recording, report) = read_table(&one).unwrap();
    assert_eq!(recording.tracks().len(), 8);
    assert_eq!(report.vehicles_left_out.get("go across the road"), Some(&1));
}

#[test]
fn what_stands_still_needs_a_heading() {
    let mut queue = traffic(0., 10., 20);
    for i in 0..queue.len() {
        queue.x[i] = 25. * (i % 9) as f64;
    }
    let (problem, message) = fault(&queue);
    assert!(problem == TrackProblem::Road && message.contains("no vehicle moves"), "{message}");
    queue.heading = Some(vec![0.; queue.len()]);
    assert_eq!(read_table(&queue).unwrap().0.tracks().len(), 9);
}

#[test]
fn ten_thousand_vehicles_are_read() {
    let vehicles: Vec<Vehicle> = (0..10_000)
        .map(|i| Vehicle { left: 1.8 + 3.6 * f64::from(i % 4), from: 8. * f64::from(i / 4), speed: 20., lane: 0 })
        .collect();
    let (recording, report) = read_table(&table(&vehicles, 0.3, 10., 10)).unwrap();
    assert_eq!((report.vehicles, recording.len()), (10_000, 100_000));
    assert_eq!(recording.roads()[0].lines.len(), 5);
}
