//! The report counts what is there.

use gnp_data::{Dataset, IngestReport};

use super::ngsim::{csv, rows};
use super::{put, read_all};

fn quality(change: impl Fn(&mut Vec<super::ngsim::Row>)) -> IngestReport {
    let folder = tempfile::tempdir().unwrap();
    let mut rows = rows(&[(1, 1, 0.), (2, 2, 300.), (3, 3, 600.)], 0..60);
    change(&mut rows);
    let file = put(folder.path(), "us101.csv", &csv(&rows));
    read_all(&file, Dataset::NGSIM).unwrap().remove(0).1
}

#[test]
fn clean_rows_count_nothing() {
    let q = quality(|_| {});
    assert_eq!((q.rows_read, q.rows, q.vehicles, q.tracks, q.frames), (180, 180, 3, 3, [0, 59]));
    assert_eq!((q.duplicates, q.conflicts, q.out_of_order, q.gaps), (0, 0, 0, 0));
    assert_eq!((q.jumps, q.overlaps, q.lane_flips), (0, 0, 0));
}

#[test]
fn repeated_and_missing_rows_are_counted() {
    let q = quality(|rows| {
        let mut again = rows[70].clone();
        rows.insert(71, again.clone());
        again.x += 1.;
        rows.insert(72, again);
        rows.remove(30);
    });
    assert_eq!((q.duplicates, q.conflicts, q.gaps), (1, 1, 1));
    let said = q.repeated_rows();
    assert!(said.len() == 2 && said[0].contains("again") && said[1].starts_with("1 row tells"), "{said:?}");
    assert_eq!((q.rows_read, q.rows, q.tracks), (181, 179, 4));
}

#[test]
fn a_jump_there_and_back_is_seen_and_a_firm_brake_is_not() {
    // 40 ft off for one frame: 122 m/s there and back, and a kink half a second to both sides.
    let jumps = quality(|rows| rows[30].y += 40.).jumps;
    assert_eq!(jumps, 4);
    // 7 m/s2 for a second is hard braking, not an error of the data.
    let brake = quality(|rows| {
        let start = rows[60].y;
        for (i, row) in rows[60..120].iter_mut().enumerate() {
            let t = i as f64 / 10.;
            let (during, after) = ((t - 2.).clamp(0., 1.), (t - 3.).max(0.));
            row.y = start + 50. * t - 0.5 * 23. * during * during - 23. * after;
        }
    });
    assert_eq!(brake.jumps, 0);
}

#[test]
fn overlapping_boxes_are_counted_by_frame() {
    // Vehicle 2 drives with its front 10 ft behind that of vehicle 1, which is 20 ft long and, as
    // all, 6.6 ft wide; for seven frames it comes so near.
    let near = |feet: f64| {
        quality(|rows| {
            for i in 0..60 {
                rows[60 + i].y = rows[i].y - 10.;
            }
            for i in 20..27 {
                rows[60 + i].x = rows[i].x + feet;
            }
        })
    };
    assert_eq!(near(6.).overlaps, 7);
    assert_eq!(near(7.).overlaps, 0);
}

#[test]
fn a_lane_taken_up_again_within_a_second_is_a_flip() {
    let change = |frames: std::ops::Range<usize>| {
        quality(move |rows| rows[frames.clone()].iter_mut().for_each(|r| (r.lane, r.x) = (2, 13.)))
    };
    assert_eq!(change(20..30).lane_flips, 1, "1.0 s");
    assert_eq!(change(20..31).lane_flips, 0, "1.1 s");
    assert_eq!(change(40..60).lane_flips, 0, "a change for good");
}

#[test]
fn it_is_written_and_read_as_json() {
    let q = quality(|_| {});
    let text = serde_json::to_string(&q).unwrap();
    assert_eq!(serde_json::from_str::<IngestReport>(&text).unwrap(), q);
    assert!(text.contains("\"lanes\":\"fitted\""), "{text}");
}
