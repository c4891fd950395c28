//! Near misses and contacts made by hand.

#![allow(clippy::unwrap_used)] // tests

mod road;

use gnp_data::NamedLeader;
use gnp_measures::{Course, Exposure, Measure, Safety, SafetySettings, Traffic, Unpaired, drac, time_gap, ttc};
use road::{Row, drive, near, recording, with_leaders};

fn safety(rows: &[Row], course: Course) -> Safety {
    let recording = recording(rows);
    Traffic::new(&recording, course).unwrap().safety(&SafetySettings::default()).unwrap()
}

fn exposure(safety: &Safety, measure: Measure, threshold: f64) -> &Exposure {
    safety.exposures.iter().find(|it| it.measure == measure && it.threshold == threshold).unwrap()
}

/// Closes in on a leader at 20 m/s by 10 m/s from a gap of 30.5 m, until after 2.5 s it has its speed and a gap of 5.5 m.
fn near_miss() -> Vec<Row> {
    let leader = drive(1, 1, 0..60, |t| (35.5 + 20. * t, 20.));
    let follower = drive(2, 1, 0..60, |t| if t < 2.45 { (30. * t, 30.) } else { (25. + 20. * t, 20.) });
    leader.into_iter().chain(follower).collect()
}

#[test]
fn a_near_miss_has_the_known_times_and_decelerations() {
    let found = safety(&near_miss(), Course::Open);
    near(found.vehicle_s, 12., 1e-9);
    near(found.following_s, 6., 1e-9);
    near(found.no_leader_s, 6., 1e-9);
    assert_eq!((found.no_lane_s, found.overlapping_s), (0., 0.));
    // Below 1.5 s while the gap is below 15 m: from 1.6 s (14.5 m) to 2.4 s (6.5 m), nine frames.
    let below = exposure(&found, Measure::Ttc, 1.5);
    near(below.vehicle_s, 0.9, 1e-9);
    near(below.share, 0.9 / 12., 1e-9);
    assert_eq!(below.events, 1);
    let event = found.conflicts.iter().find(|it| it.measure == Measure::Ttc && it.threshold == 1.5).unwrap();
    assert_eq!((event.vehicle, event.leader), (2, 1));
    near(event.t[0], 1.6, 1e-9);
    near(event.t[1], 2.4, 1e-9);
    near(event.worst, 0.65, 1e-5);
    near(event.x, 72., 1e-4);
    // 10² / (2 gap) is above 5 m/s² below a gap of 10 m, above 3 below 16.7.
    let hard = found.conflicts.iter().find(|it| it.measure == Measure::Drac && it.threshold == 5.).unwrap();
    near(hard.t[0], 2.1, 1e-9);
    near(hard.worst, 100. / 13., 1e-4);
    near(exposure(&found, Measure::Drac, 3.).vehicle_s, 1.1, 1e-9);
    // The time gap stays short after it: 5.5 m at 20 m/s.
    let short = found.conflicts.iter().find(|it| it.measure == Measure::TimeGap && it.threshold == 0.5).unwrap();
    near(short.t[1], 5.9, 1e-9);
    near(short.worst, 6.5 / 30., 1e-5);
    assert!(found.contacts.is_empty());
}

#[test]
fn measures_are_none_where_they_mean_nothing() {
    assert_eq!(
        [ttc(10., 20., 20.), ttc(-1., 20., 10.), drac(10., 5., 6.), time_gap(10., 0.9), time_gap(0., 9.)],
        [None; 5]
    );
    assert_eq!([ttc(10., 20., 15.), drac(10., 20., 10.), time_gap(10., 20.)], [Some(2.), Some(5.), Some(0.5)]);
}

#[test]
fn a_short_pause_is_one_event_and_a_long_one_two() {
    // 10 m behind, 10 m/s faster for 1 s, twice: gaps stay put so that only the speeds matter.
    let event_count = |pause: u32| {
        let leader = drive(1, 1, 0..80, |t| (15. + 20. * t, 20.));
        let fast = move |frame: u32| (10..20).contains(&frame) || (20 + pause..30 + pause).contains(&frame);
        let follower = drive(2, 1, 0..80, |t| (20. * t, if fast((t * 10.).round() as u32) { 30. } else { 20. }));
        let rows: Vec<Row> = leader.into_iter().chain(follower).collect();
        let found = safety(&rows, Course::Open);
        let below = exposure(&found, Measure::Ttc, 1.5);
        near(below.vehicle_s, 2., 1e-9);
        below.events
    };
    assert_eq!([event_count(5), event_count(6)], [1, 2]);
}

#[test]
fn on_a_ring_the_last_follows_the_first() {
    // Two cars on 100 m, 30 m apart: gaps of 25 and 65 m; the second drives over the seam.
    for wrapped in [true, false] {
        let place = |x: f64| if wrapped { x.rem_euclid(100.) } else { x };
        let rows: Vec<Row> =
            [drive(1, 1, 0..200, |t| (place(10. * t), 10.)), drive(2, 1, 0..200, |t| (place(30. + 10. * t), 10.))]
                .concat();
        let recording = recording(&rows);
        let traffic = Traffic::new(&recording, Course::Ring { circumference: 100. }).unwrap();
        for row in 0..200 {
            let (one, two) = (traffic.following(0, row).unwrap(), traffic.following(1, 200 + row).unwrap());
            assert_eq!((one.leader, two.leader), (2, 1));
            near(one.gap, 25., 1e-4);
            near(two.gap, 65., 1e-4);
        }
        let open = Traffic::new(&recording, Course::Open).unwrap();
        assert_eq!(open.following(1, 200), Err(Unpaired::NoLeader));
    }
    // Alone on it nobody is ahead.
    let alone = recording(&drive(1, 1, 0..10, |t| (t, 1.)));
    let traffic = Traffic::new(&alone, Course::Ring { circumference: 50. }).unwrap();
    assert_eq!(traffic.following(0, 0), Err(Unpaired::NoLeader));
}

#[test]
fn a_leader_that_only_a_row_names_is_one() {
    // 24.8 m from front to front of a car of 4.8 m: 20 m, which close by 5 m/s from the second row on.
    let rows = drive(1, 1, 0..10, |t| (25. * t, 25.));
    let named = |i: u32| NamedLeader { vehicle: 77, headway: 24.8 - 0.5 * i as f32 };
    let recording = with_leaders(&rows, Some((0..10).map(named).collect()));
    let traffic = Traffic::new(&recording, Course::Open).unwrap();
    for row in 0..10 {
        let following = traffic.following(0, row).unwrap();
        let gap = 20. - 0.5 * row as f64;
        assert_eq!(following.leader, 77);
        near(following.gap, gap, 1e-4);
        near(following.leader_speed.unwrap(), 20., 1e-3);
        near(following.ttc().unwrap(), gap / 5., 1e-3);
    }
}

#[test]
fn boxes_that_overlap_are_contacts_once() {
    // 5 m by 2 m: overlap by 1 m lengthwise and wholly across from frame 10 to 14, and again, for one frame, in frame 20.
    let overlaps = |t: f64| (0.95..1.45).contains(&t) || (1.95..2.05).contains(&t);
    let leader = drive(1, 1, 0..30, |t| (20. * t, 20.));
    let follower = drive(2, 1, 0..30, |t| (20. * t - if overlaps(t) { 4. } else { 6. }, 20.));
    // Beside them and clear of both, though its lane's number is the same.
    let beside = drive(3, 1, 0..30, |t| (20. * t, 20.))
        .into_iter()
        .map(|(vehicle, frame, x, _, v, lane)| (vehicle, frame, x, -4., v, lane));
    // On the other carriageway, in the same place.
    let other = drive(1003, 1, 0..30, |t| (20. * t, 20.));
    let rows: Vec<Row> = leader.into_iter().chain(follower).chain(beside).chain(other).collect();
    let found = safety(&rows, Course::Open).contacts;
    let told: Vec<_> = found.iter().map(|contact| (contact.vehicles, contact.frames)).collect();
    assert_eq!(told, [([2, 1], 5), ([2, 1], 1)]);
    near(found[0].depth, 1., 1e-4);
    near(found[0].t[1] - found[0].t[0], 0.4, 1e-9);

    // Over the seam of a ring.
    let rows: Vec<Row> = [drive(1, 1, 0..2, |_| (99., 0.)), drive(2, 1, 0..2, |_| (2., 0.))].concat();
    assert!(safety(&rows, Course::Open).contacts.is_empty());
    let ring = safety(&rows, Course::Ring { circumference: 100. });
    assert_eq!((ring.contacts.len(), ring.contacts[0].vehicles), (1, [1, 2]));
    near(ring.contacts[0].depth, 2., 1e-4);
    assert!(ring.overlapping_s > 0.);
}

#[test]
fn thresholds_must_be_positive() {
    let recording = recording(&near_miss());
    let traffic = Traffic::new(&recording, Course::Open).unwrap();
    let settings = SafetySettings { ttc: vec![0.], ..SafetySettings::default() };
    assert!(traffic.safety(&settings).is_err());
}
