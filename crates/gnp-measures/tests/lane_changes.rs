//! Lane changes made by hand.

#![allow(clippy::unwrap_used)] // tests

mod road;

use gnp_measures::{Course, Direction, LaneChangeSettings, LaneChanges, Traffic};
use road::{Row, drive, near, recording};

fn found(rows: &[Row]) -> LaneChanges {
    let recording = recording(rows);
    Traffic::new(&recording, Course::Open).unwrap().lane_changes(&LaneChangeSettings::default()).unwrap()
}

/// Moves from the right lane to the left one between 5 and 9 s at 20 m/s, its centre over the line at 7 s.
fn change() -> Vec<Row> {
    (0..150)
        .map(|frame| {
            let t = f64::from(frame) / 10.;
            let y = -5.625 + 3.75 * ((t - 5.) / 4.).clamp(0., 1.);
            (1, frame, 20. * t, y, 20., if y >= -3.75 { 1 } else { 2 })
        })
        .collect()
}

#[test]
fn a_change_has_its_time_side_gaps_and_duration() {
    let mut rows = change();
    rows.extend(drive(2, 1, 0..150, |t| (30. * t - 90., 30.))); // at 7 s 120 m, 20 m behind the changer's 140 m
    rows.extend(drive(3, 1, 0..150, |t| (25. + 20. * t, 20.))); // 25 m ahead
    rows.extend(drive(4, 2, 0..150, |t| (20. * t - 35., 20.))); // left behind
    let found = found(&rows);
    assert_eq!((found.changes.len(), found.by_direction, found.flips, found.cut_off), (1, [1, 0], 0, 0));
    let change = &found.changes[0];
    assert_eq!((change.vehicle, change.from, change.to, change.lanes), (1, 2, 1, 1));
    assert_eq!(change.direction, Direction::Left);
    near(change.time_s, 7., 1e-9);
    near(change.x, 140., 1e-3);
    near(change.duration_s.unwrap(), 4., 0.65); // to within the span of the lateral speed
    let (leader, follower) = (change.after.leader.unwrap(), change.after.follower.unwrap());
    assert_eq!((leader.vehicle, follower.vehicle), (3, 2));
    near(leader.gap, 20., 1e-3);
    near(follower.gap, 15., 1e-3);
    near(follower.speed, 30., 1e-6);
    // 15 m at 30 m/s; 20 m at 20 m/s.
    near(follower.post_encroachment_s.unwrap(), 0.5, 1e-3);
    near(leader.post_encroachment_s.unwrap(), 1., 1e-3);
    let before = change.before;
    assert!(before.leader.is_none());
    near(before.follower.unwrap().post_encroachment_s.unwrap(), 1.5, 1e-3);
    let kilometres = (20. * 3. + 30.) * 14.9 / 1000.;
    near(found.per_vehicle_km.unwrap(), 1. / kilometres, 1e-3 / kilometres);
}

#[test]
fn the_side_is_where_the_lane_is_and_not_its_number() {
    // The same motion, the numbers the other way round.
    let rows: Vec<Row> =
        change().into_iter().map(|(vehicle, frame, x, y, v, lane)| (vehicle, frame, x, y, v, 3 - lane)).collect();
    let change = &found(&rows).changes[0];
    assert_eq!((change.from, change.to, change.direction), (1, 2, Direction::Left));
    // And in a mirror.
    let rows: Vec<Row> = change_mirrored();
    let change = &found(&rows).changes[0];
    assert_eq!((change.from, change.to, change.direction), (2, 1, Direction::Right));
    near(change.duration_s.unwrap(), 4., 0.65); // to within the span of the lateral speed
}

fn change_mirrored() -> Vec<Row> {
    change().into_iter().map(|(vehicle, frame, x, y, v, lane)| (vehicle, frame, x, -7.5 - y, v, lane)).collect()
}

#[test]
fn a_flip_is_no_change_and_an_unknown_lane_hides_none() {
    let lanes = |of: &dyn Fn(u32) -> i16| -> Vec<Row> {
        (0..100).map(|f| (1, f, 2. * f64::from(f), if of(f) == 1 { -1.8 } else { -5.6 }, 20., of(f))).collect()
    };
    let flip = found(&lanes(&|f| if (40..50).contains(&f) { 2 } else { 1 }));
    assert_eq!((flip.changes.len(), flip.flips), (0, 1));
    let there_and_back = found(&lanes(&|f| if (40..51).contains(&f) { 2 } else { 1 }));
    assert_eq!((there_and_back.changes.len(), there_and_back.by_direction, there_and_back.flips), (2, [1, 1], 0));
    let unknown = found(&lanes(&|f| {
        if f < 40 {
            1
        } else if f < 60 {
            0
        } else {
            2
        }
    }));
    assert_eq!((unknown.changes.len(), unknown.through_unknown), (1, 1));
    near(unknown.changes[0].time_s, 6., 1e-9);
    let same = found(&lanes(&|f| if (40..60).contains(&f) { 0 } else { 1 }));
    assert_eq!(same.changes.len(), 0);
}

#[test]
fn a_change_that_the_track_cuts_off_has_no_duration_and_no_time_that_was_not_seen() {
    let mut rows: Vec<Row> = change().into_iter().filter(|row| (60..=72).contains(&row.1)).collect();
    rows.extend(drive(2, 1, 60..73, |t| (20. * t - 20., 20.)));
    let found = found(&rows);
    assert_eq!((found.changes.len(), found.cut_off), (1, 1));
    let follower = found.changes[0].after.follower.unwrap();
    near(follower.gap, 15., 1e-3);
    assert_eq!((found.changes[0].duration_s, follower.post_encroachment_s), (None, None));
}
