//! Flow, density and speed of traffic whose numbers are known.

#![allow(clippy::unwrap_used)] // tests

mod road;

use gnp_measures::{CellSize, Course, DiagramSettings, FundamentalDiagram, MeasureError, Missing, Traffic};
use road::{Row, drive, near, recording};

const SIZE: CellSize = CellSize { x: 100., t: 10. };

/// Cars 40 m apart at 20 m/s on the left lane, 80 m apart at 10 m/s on the right one, seen between 0 and 400 m.
fn uniform() -> Vec<Row> {
    let mut rows = Vec::new();
    for (lane, apart, speed, first) in [(1, 40., 20., 0), (2, 80., 10., 500)] {
        for car in 0..60 {
            let start = 400. - apart * f64::from(car);
            let seen = |frame: &u32| (0. ..=400.).contains(&(start + speed * f64::from(*frame) / 10.));
            let (from, to) = ((0..600).find(seen), (0..600).rfind(seen));
            if let (Some(from), Some(to)) = (from, to) {
                rows.extend(drive(first + car + 1, lane, from..to + 1, |t| (start + speed * t, speed)));
            }
        }
    }
    rows
}

#[test]
fn uniform_flow_is_density_times_speed_in_every_cell() {
    let recording = recording(&uniform());
    let traffic = Traffic::new(&recording, Course::Open).unwrap();
    let cells = traffic.cells(0, SIZE).unwrap().unwrap();
    // Vehicles appear up to a frame's way behind 0 and disappear up to as much before 400.
    near(cells.x().from, 2., 2.);
    near(cells.x().to, 398., 2.);
    let mut inner = 0;
    for cell in cells.iter() {
        let speed = cell.speed.unwrap();
        near(cell.flow_veh_h, cell.density_veh_km * speed * 3.6, 1e-9 * cell.flow_veh_h);
        let inside = cell.x[0] > 20. && cell.x[1] < 380.;
        match cell.lane {
            Some(1) => near(speed, 20., 1e-4),
            Some(2) => near(speed, 10., 1e-4),
            _ => {}
        }
        // A cell is not a whole number of gaps long: its density is right on average over time.
        if inside {
            inner += 1;
            match cell.lane {
                Some(1) => near(cell.density_veh_km, 25., 1.3),
                Some(2) => near(cell.density_veh_km, 12.5, 1.6),
                _ => near(cell.density_veh_km, 37.5, 3.),
            }
        }
    }
    assert_eq!(inner, 3 * 6 * 2);
    let of = |lane| cells.iter().filter(move |cell| cell.lane == lane).map(|cell| cell.vehicle_m).sum::<f64>();
    near(of(None), of(Some(1)) + of(Some(2)), 1e-6);
}

#[test]
fn a_loop_counts_times_and_is_occupied_as_long_as_boxes_are_over_it() {
    let recording = recording(&uniform());
    let traffic = Traffic::new(&recording, Course::Open).unwrap();
    let station = traffic.station(0, 201., 3.).unwrap();
    let of_lane = |lane| {
        let all = station.intervals(20.).unwrap();
        all.into_iter().filter(|it| it.lane == lane).collect::<Vec<_>>()
    };
    // Fronts pass at 1.925 s and every 2 s from then on; the last interval ends at 59.9 s.
    assert_eq!(of_lane(Some(1)).iter().map(|it| it.count).collect::<Vec<_>>(), [10, 10, 9]);
    assert_eq!(of_lane(Some(2)).iter().map(|it| it.count).collect::<Vec<_>>(), [3, 2, 3]);
    for interval in of_lane(Some(1)) {
        near(interval.flow_veh_h, interval.count as f64 * 3600. / (interval.t[1] - interval.t[0]), 1e-9);
        near(interval.speed.unwrap(), 20., 1e-5);
        // 5 m of car and 3 m of loop every 40 m.
        near(interval.occupancy, 0.2, 0.01);
    }
    assert_eq!(of_lane(None).iter().map(|it| it.count).sum::<u64>(), 29 + 8);
    for (all, [one, two]) in
        of_lane(None).iter().zip(of_lane(Some(1)).iter().zip(&of_lane(Some(2))).map(|(a, b)| [a, b]))
    {
        near(all.occupancy, (one.occupancy + two.occupancy) / 2., 1e-12);
        let (n1, n2) = (one.count as f64, two.count as f64);
        near(all.speed.unwrap(), (20. * n1 + 10. * n2) / (n1 + n2), 1e-4);
        near(all.harmonic_speed.unwrap(), (n1 + n2) / (n1 / 20. + n2 / 10.), 1e-4);
    }
    assert_eq!(station.without_lane(), 0);
}

/// Three cars around a ring of 90 m at 15 m/s, its x starting anew at the seam or counting on.
fn around(wrapped: bool) -> Vec<Row> {
    let at = |car: u32, t: f64| 30. * f64::from(car) + 15. * t;
    let place = |x: f64| if wrapped { x.rem_euclid(90.) } else { x };
    (0..3).flat_map(|car| drive(car + 1, 1, 0..601, |t| (place(at(car, t)), 15.))).collect()
}

#[test]
fn a_ring_is_the_same_wrapped_and_counted_on() {
    for rows in [around(true), around(false)] {
        let recording = recording(&rows);
        let traffic = Traffic::new(&recording, Course::Ring { circumference: 90. }).unwrap();
        let cells = traffic.cells(0, CellSize { x: 30., t: 12. }).unwrap().unwrap();
        for cell in cells.iter() {
            near(cell.density_veh_km, 1000. / 30., 1e-3);
            near(cell.flow_veh_h, 1800., 0.1);
        }
        assert!(cells.outside_s() < 1e-9);
        near(cells.iter().filter(|cell| cell.lane.is_none()).map(|cell| cell.vehicle_s).sum(), 180., 1e-6);
        near(traffic.distance_m(), 2700., 0.01);
        // 60 s at one car every 2 s; the seam itself is a place like any other.
        for place in [0., 47., 90., -43.] {
            let station = traffic.station(0, place, 0.).unwrap();
            let all = station.intervals(60.).unwrap().pop().unwrap();
            near(all.count as f64, 30., 1.);
            near(all.occupancy, 5. / 30., 0.01);
            near(all.speed.unwrap(), 15., 1e-5);
        }
    }
}

/// Speed on a triangular diagram: 30 m/s, waves of 5 m/s upstream, 140 vehicles/km in a jam.
fn on_triangle(cars: u32) -> f64 {
    f64::min(30., 5. * (140. / f64::from(cars) - 1.))
}

/// Lanes of a ring of 1 km, each uniform with its own number of cars and speed.
fn lanes(lanes: &[(u32, f64)]) -> Vec<Row> {
    let mut rows = Vec::new();
    for (lane, (cars, speed)) in (1..).zip(lanes) {
        for car in 0..*cars {
            let start = 1000. * f64::from(car) / f64::from(*cars);
            let vehicle = 1 + car + 200 * (lane as u32 % 4) + 100_000 * lane as u32;
            rows.extend(drive(vehicle, lane, 0..41, |t| (start + speed * t, *speed)));
        }
    }
    // All on the first carriageway.
    let mut names: Vec<u32> = rows.iter().map(|row| row.0).collect();
    names.dedup();
    rows.iter_mut().for_each(|row| row.0 = names.iter().position(|name| *name == row.0).unwrap() as u32 % 1000);
    rows
}

fn diagram(cars: &[u32]) -> FundamentalDiagram {
    diagram_of(&cars.iter().map(|cars| (*cars, on_triangle(*cars))).collect::<Vec<_>>())
}

fn diagram_of(cars: &[(u32, f64)]) -> FundamentalDiagram {
    let recording = recording(&lanes(cars));
    let traffic = Traffic::new(&recording, Course::Ring { circumference: 1000. }).unwrap();
    let cells = traffic.cells(0, CellSize { x: 500., t: 2. }).unwrap().unwrap();
    FundamentalDiagram::of(&cells, &DiagramSettings::default()).unwrap().pop().unwrap()
}

#[test]
fn a_triangular_diagram_is_found_again() {
    let found = diagram(&[4, 8, 10, 20, 30, 40, 50, 60, 70, 80, 90]);
    assert_eq!((found.lane, found.points.len(), found.empty_cells), (None, 11 * 4, 0));
    near(found.free_speed.unwrap(), 30., 1e-3);
    let branch = found.congested.unwrap();
    near(branch.wave_speed, 5., 0.2);
    near(branch.jam_density_veh_km, 140., 3.);
    // At 20 vehicles a kilometre: 30 m/s times 20, in vehicles an hour.
    let capacity = found.capacity.unwrap();
    near(capacity.flow_veh_h, 2160., 110.);
    assert_eq!((capacity.quantile, capacity.cells), (0.98, 44));
}

#[test]
fn a_dense_lane_that_has_not_broken_down_yet_does_not_turn_the_branch() {
    let cars = [4, 8, 10, 30, 40, 50, 60, 70, 80, 90, 100];
    let mut lanes: Vec<(u32, f64)> = cars.iter().map(|cars| (*cars, on_triangle(*cars))).collect();
    lanes.push((92, 9.)); // half as much flow again as the triangle has at its top
    let branch = diagram_of(&lanes).congested.unwrap();
    near(branch.wave_speed, 5., 0.3);
    near(branch.jam_density_veh_km, 140., 4.);
}

#[test]
fn what_a_diagram_does_not_show_has_a_reason() {
    let free = diagram(&[4, 8, 10]);
    let few = Missing::FewPoints { which: "of congested traffic", found: 0, needed: 10 };
    assert_eq!(free.congested, Err(few));
    assert!(free.free_speed.is_ok());
    let jam = diagram(&[20, 70, 70, 72]);
    assert!(matches!(jam.congested, Err(Missing::NarrowBranch { .. })), "{:?}", jam.congested);
    assert!(matches!(jam.free_speed, Err(Missing::FewPoints { found: 0, .. })));
}

#[test]
fn lanes_are_ordered_by_where_they_are_and_rows_without_one_are_counted() {
    // Numbers grow to the left here: 7 is left of 3.
    let row = |vehicle, lane, y| (0..20).map(move |frame| (vehicle, frame, 10. * f64::from(frame), y, 100., lane));
    let rows: Vec<Row> = row(1, 3, -5.).chain(row(2, 7, -1.)).chain(row(3, 0, -1.)).chain(row(1001, 2, -2.)).collect();
    let recording = recording(&rows);
    let traffic = Traffic::new(&recording, Course::Open).unwrap();
    let lanes: Vec<_> =
        traffic.lanes().iter().map(|lane| (lane.road, lane.number, lane.from_left, lane.centre)).collect();
    assert_eq!(lanes, [(0, 7, 0, -1.875), (0, 3, 1, -5.625), (1, 2, 0, -1.875)]);
    let cells = traffic.cells(0, SIZE).unwrap().unwrap();
    assert_eq!(cells.lanes(), [7, 3]);
    near(cells.no_lane_s(), 1.9, 1e-9);
    let all: f64 = cells.iter().filter(|cell| cell.lane.is_none()).map(|cell| cell.vehicle_s).sum();
    near(all, 3. * 1.9, 1e-9);
    assert_eq!(traffic.station(0, 55., 0.).unwrap().without_lane(), 1);
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let rows = uniform();
    let road = recording(&rows);
    let traffic = Traffic::new(&road, Course::Open).unwrap();
    assert!(matches!(traffic.cells(0, CellSize { x: 0., t: 1. }), Err(MeasureError::Setting { .. })));
    assert!(matches!(traffic.cells(0, CellSize { x: 1e-6, t: 1e-3 }), Err(MeasureError::TooFine { .. })));
    assert!(traffic.station(0, f64::NAN, 0.).is_err() && traffic.station(0, 0., -1.).is_err());
    assert_eq!(traffic.cells(1, SIZE), Ok(None)); // an empty carriageway
    assert_eq!(traffic.cells(9, SIZE), Ok(None));
    assert!(Traffic::new(&road, Course::Ring { circumference: -1. }).is_err());
    let still = recording(&rows[..1]);
    assert!(matches!(Traffic::new(&still, Course::Open), Err(MeasureError::NoTime { .. })));
}
