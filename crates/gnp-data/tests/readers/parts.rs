//! Files that are read by stretches of time say the same of every vehicle and frame as when they are read whole.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;

use gnp_data::{DataError, Dataset, PartSize, Slot, TrackOptions, discover, format_of};
use tempfile::tempdir;

use crate::put;

/// What a forecast of a vehicle at a frame is made from.
#[derive(Clone, Debug, PartialEq)]
struct Seen {
    name: String,
    past: Vec<[f32; 4]>,
    velocity: Option<[f32; 2]>,
    lane: i16,
    neighbours: Vec<Option<u32>>,
    road: u16,
    size: [f32; 2],
}

/// By vehicle and frame, with the number of parts and the lines of the carriageways.
type All = BTreeMap<(u32, u32), Seen>;

/// Time that is looked back on, s.
const PAST_S: f64 = 2.;

fn read(place: &Path, dataset: Dataset, max_rows: usize) -> (All, usize, Vec<f32>) {
    let (format, source) = (format_of(dataset).unwrap(), discover(place, dataset).unwrap().remove(0));
    let (mut all, mut parts, mut lines) = (All::new(), 0, None);
    let size = PartSize::new(max_rows, PAST_S);
    let read = format.read_parts(&source, &TrackOptions::default(), &size, &mut |part| {
        parts += 1;
        let recording = &part.recording;
        let of_part: Vec<f32> =
            recording.roads().iter().flat_map(|road| road.lines.iter().map(|line| line.y)).collect();
        assert_eq!(lines.get_or_insert_with(|| of_part.clone()), &of_part, "all parts have one road");
        for (index, track) in recording.tracks().iter().enumerate() {
            for frame in track.first_frame..=track.last_frame() {
                if !part.asked.contains(&frame) {
                    continue;
                }
                let row = track.row_at(frame).unwrap();
                let frames = (PAST_S * recording.meta().rate_hz) as u32;
                let before = (0..=frames).rev().filter_map(|back| track.row_at(frame.checked_sub(back)?));
                let c = recording.columns();
                // Of the velocity at the frame itself the next row would tell.
                let past = before
                    .map(|i| if i == row { [c.x[i], c.y[i], 0., 0.] } else { [c.x[i], c.y[i], c.vx[i], c.vy[i]] });
                let neighbours =
                    Slot::ALL.map(|slot| Some(recording.tracks()[recording.neighbour(row, slot)?].vehicle));
                let seen = Seen {
                    name: recording.vehicle_name(track.vehicle).into_owned(),
                    past: past.collect(),
                    velocity: recording.velocity_one_sided(index, row),
                    lane: c.lane[row],
                    neighbours: neighbours.to_vec(),
                    road: track.road,
                    size: [track.length, track.width],
                };
                assert!(all.insert((track.vehicle, frame), seen).is_none(), "{} is asked twice", track.vehicle);
            }
        }
        ControlFlow::Continue(())
    });
    read.unwrap();
    (all, parts, lines.unwrap())
}

/// 60 vehicles on three lanes and one lane of the other direction, that enter one after another in 60 s at 10 Hz; every
/// seventh with a gap.
fn rows() -> Vec<(String, f64, f64, f64, u32)> {
    let mut rows = Vec::new();
    for number in 0..60u32 {
        let (lane, forward) = (number % 4, number % 4 != 3);
        let speed = 20. + 2. * f64::from(lane) + 0.1 * f64::from(number % 9);
        for step in 0..120u32 {
            let frame = 9 * number + step;
            if number % 7 == 0 && (50..70).contains(&step) || frame >= 600 {
                continue;
            }
            let way = speed * 0.1 * f64::from(step) + 0.3 * (0.05 * f64::from(step)).sin();
            let (x, y) = if forward { (way, -3.5 * f64::from(lane)) } else { (400. - way, 14.) };
            let y = y + 0.2 * (0.1 * f64::from(step + number)).sin();
            rows.push((format!("car-{number}"), 7. + 0.1 * f64::from(frame), x, y, if forward { lane + 1 } else { 1 }));
        }
    }
    rows
}

fn csv(rows: &[(String, f64, f64, f64, u32)]) -> String {
    let line = |(id, t, x, y, lane): &(String, f64, f64, f64, u32)| format!("{id},{t:.1},{x:.3},{y:.3},{lane}\n");
    "id,time,x,y,lane\n".to_owned() + &rows.iter().map(line).collect::<String>()
}

fn by_time() -> Vec<(String, f64, f64, f64, u32)> {
    let mut rows = rows();
    rows.sort_by(|a, b| a.1.total_cmp(&b.1));
    rows
}

fn xml() -> String {
    let rows = by_time();
    let mut text = String::from("<fcd-export>\n");
    for step in rows.chunk_by(|a, b| a.1 == b.1) {
        text += &format!("<timestep time=\"{:.2}\">\n", step[0].1);
        for (id, _, x, y, _) in step {
            let angle = if *y > 10. { 270 } else { 90 };
            text += &format!("<vehicle id=\"{id}\" x=\"{x:.3}\" y=\"{y:.3}\" angle=\"{angle}\" type=\"car\"/>\n");
        }
        text += "</timestep>\n";
    }
    text + "</fcd-export>\n"
}

#[test]
fn every_vehicle_and_frame_is_asked_once_and_looks_the_same_for_any_size() {
    let folder = tempdir().unwrap();
    for (name, text, dataset) in [
        ("by-vehicle.csv", csv(&rows()), Dataset::TRACKS),
        ("by-time.csv", csv(&by_time()), Dataset::TRACKS),
        ("fcd.xml", xml(), Dataset::SUMO),
    ] {
        let place = put(folder.path(), name, &text);
        let (whole, one, lines) = read(&place, dataset, usize::MAX);
        assert_eq!((one, whole.len()), (1, rows().len()), "{name}");
        for (max_rows, least) in [(3000, 2), (1500, 4), (1, 8)] {
            let (cut, parts, lines_cut) = read(&place, dataset, max_rows);
            assert!(parts >= least, "{name}: {parts} parts of {max_rows} rows");
            assert_eq!(lines_cut, lines, "{name}");
            assert_eq!(cut.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>(), "{name}, {max_rows} rows");
            for (key, seen) in &cut {
                assert_eq!(seen, &whole[key], "{name}, {max_rows} rows: {key:?}");
            }
        }
    }
}

#[test]
fn reading_ends_where_the_caller_says() {
    let folder = tempdir().unwrap();
    for (name, text) in [("by-vehicle.csv", csv(&rows())), ("by-time.csv", csv(&by_time()))] {
        let place = put(folder.path(), name, &text);
        let (format, source) =
            (format_of(Dataset::TRACKS).unwrap(), discover(&place, Dataset::TRACKS).unwrap().remove(0));
        let mut parts = 0;
        let read = format.read_parts(&source, &TrackOptions::default(), &PartSize::new(1500, PAST_S), &mut |_| {
            parts += 1;
            if parts == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        read.unwrap();
        assert_eq!(parts, 2, "{name}");
        let mut nowhere = PartSize::new(1500, PAST_S);
        nowhere.spool = Some(folder.path().join("nowhere"));
        let spooled =
            format.read_parts(&source, &TrackOptions::default(), &nowhere, &mut |_| ControlFlow::Continue(()));
        assert_eq!(matches!(spooled, Err(DataError::Io { .. })), name == "by-vehicle.csv", "{name}");
    }
    let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|it| it.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "nothing is left: {names:?}");
}

#[test]
fn recordings_along_a_road_are_one_part() {
    let place = crate::fixtures("ngsim/us101-13_1.csv.gz");
    let (all, parts, _) = read(&place, Dataset::NGSIM, 10);
    assert!(parts == 1 && all.len() > 1000);
}
