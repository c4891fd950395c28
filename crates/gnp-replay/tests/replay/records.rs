//! Records need nothing of Rerun.

use gnp_plot::Clip;
use gnp_replay::{ARROW_M, Colour, Drawing, RING_M, Record, Row, records};

use crate::clip::{PICKED, clip};

fn rows_of(clip: &Clip, entity: &str) -> Vec<Row> {
    picked_rows_of(clip, PICKED, entity)
}

fn picked_rows_of(clip: &Clip, picked: Option<u32>, entity: &str) -> Vec<Row> {
    let found: Vec<Record> = records(clip, picked).into_iter().filter(|record| record.entity == entity).collect();
    assert_eq!(found.len(), 1, "{entity} should be there once");
    found.into_iter().next().unwrap().rows
}

fn scalars(rows: &[Row]) -> Vec<(u32, Vec<f32>)> {
    let value = |row: &Row| match &row.drawing {
        Drawing::Scalars(values) => Some((row.frame.unwrap(), values.clone())),
        _ => None,
    };
    rows.iter().filter_map(value).collect()
}

#[test]
fn every_part_of_the_clip_has_its_entity() {
    let entities: Vec<String> = records(&clip(), PICKED).into_iter().map(|record| record.entity).collect();
    let mut expected = vec!["/about".to_owned(), "/road/boundaries".to_owned(), "/road/centre_lines".to_owned()];
    for id in [7, 31] {
        expected.push(format!("/vehicles/{id}"));
        for part in ["forces/goal", "forces/lines", "forces/neighbours", "futures", "history"] {
            expected.push(format!("/forecasts/{id}/{part}"));
        }
        for part in ["goal/tau", "lines/k", "neighbours/k", "probability", "speed"] {
            expected.push(format!("/scalars/{id}/{part}"));
        }
    }
    expected.push("/picked".to_owned());
    expected.push("/forecasts/31".to_owned()); // says that the truck is gone
    expected.sort();
    assert_eq!(entities, expected);
}

#[test]
fn lines_reach_past_the_vehicles_and_the_edges_are_darker() {
    let clip = clip();
    let strips = |entity| match &rows_of(&clip, entity)[..] {
        [Row { frame: None, drawing: Drawing::Strips { strips, colours, .. } }] => (strips.clone(), colours.clone()),
        other => panic!("{other:?}"),
    };
    let (edges, dark) = strips("/road/boundaries");
    // The truck is in front, at 40 m and 3 frames of 1.2 m later.
    assert_eq!(edges.iter().map(|edge| edge[0]).collect::<Vec<_>>(), [[-10., -1.75], [-10., 5.25]]);
    assert!((edges[0][1][0] - 63.6).abs() < 1e-4 && edges[0][1][1] == -1.75, "{edges:?}");
    let (centres, grey) = strips("/road/centre_lines");
    assert_eq!(centres.len(), 1);
    let light = |colours: &[Colour]| u32::from(colours[0].0[0]);
    assert!(light(&dark) < light(&grey));
}

#[test]
fn boxes_move_and_vanish_when_the_vehicle_is_gone() {
    let clip = clip();
    let truck = rows_of(&clip, "/vehicles/31");
    let frames: Vec<Option<u32>> = truck.iter().map(|row| row.frame).collect();
    assert_eq!(frames, [100, 105, 110, 115, 120].map(Some));
    let Drawing::Box { centre, size, label, .. } = &truck[2].drawing else { panic!("{:?}", truck[2]) };
    assert!((centre[0] - 42.4).abs() < 1e-4 && centre[1] == 3.5, "{centre:?}");
    assert_eq!((*size, label.as_str()), ([12., 2.5], "truck 31"));
    assert_eq!(truck[4].drawing, Drawing::Gone);
    assert_eq!(rows_of(&clip, "/forecasts/31"), [Row { frame: Some(120), drawing: Drawing::Gone }]);

    // The car stays to the end, so nothing is said after it.
    let car = rows_of(&clip, "/vehicles/7");
    assert_eq!(car.last().unwrap().frame, Some(130));
    assert!(car.iter().all(|row| matches!(row.drawing, Drawing::Box { .. })));
    let colour = |rows: &[Row]| match rows[0].drawing {
        Drawing::Box { colour, .. } => colour,
        _ => panic!("no box"),
    };
    assert_ne!(colour(&car), colour(&truck));
}

#[test]
fn the_ring_is_around_the_picked_vehicle_alone() {
    let clip = clip();
    let rows = rows_of(&clip, "/picked");
    assert_eq!(rows.len(), 7);
    let Drawing::Strips { strips, .. } = &rows[6].drawing else { panic!("{:?}", rows[6]) };
    let [x, y] = clip.vehicles[0].states[6].centre;
    assert!(strips[0].iter().all(|p| ((p[0] - x).hypot(p[1] - y) - RING_M).abs() < 1e-3), "{strips:?}");
    assert_eq!(strips[0].first().map(|p| p[1]), Some(y));

    // The truck leaves.
    let rows = picked_rows_of(&clip, Some(31), "/picked");
    assert_eq!((rows.len(), &rows[4].drawing), (5, &Drawing::Gone));
    assert!(records(&clip, None).iter().all(|record| record.entity != "/picked"));
}

#[test]
fn two_stretches_of_a_vehicle_are_one_entity_in_order() {
    let mut clip = clip();
    let mut earlier = clip.vehicles[1].clone();
    earlier.states.truncate(1);
    earlier.forecasts.clear();
    clip.vehicles[1].states.remove(0);
    clip.vehicles[1].states.remove(0);
    clip.vehicles.push(earlier); // at 100, gone at 105, back at 110
    let rows = rows_of(&clip, "/vehicles/31");
    let gone: Vec<(u32, bool)> = rows.iter().map(|row| (row.frame.unwrap(), row.drawing == Drawing::Gone)).collect();
    assert_eq!(gone, [(100, false), (105, true), (110, false), (115, false), (120, true)]);
}

#[test]
fn paths_start_at_the_vehicle_and_say_their_probability() {
    let rows = rows_of(&clip(), "/forecasts/7/futures");
    assert_eq!(rows.iter().map(|row| row.frame).collect::<Vec<_>>(), [Some(100), Some(120)]);
    let Drawing::Strips { strips, colours, labels, .. } = &rows[1].drawing else { panic!("{:?}", rows[1]) };
    // A point is 0.2 s from the next, so every third one is the nearest to half a second.
    let expected = [[16.4, 0.6], [19.4, 0.9], [22.4, 1.2]];
    assert_eq!((strips.len(), strips[0].len()), (3, 3));
    for (point, expected) in strips[0].iter().zip(expected) {
        assert!((point[0] - expected[0]).abs() < 1e-5 && (point[1] - expected[1]).abs() < 1e-5, "{:?}", strips[0]);
    }
    assert!((strips[2][1][1] - 1.5).abs() < 1e-5, "{:?}", strips[2]);
    assert_eq!(labels, &["50 %", "30 %", "20 %"]);
    assert!(colours[0] != colours[1] && colours[1] == colours[2]);
    assert_eq!(scalars(&rows_of(&clip(), "/scalars/31/probability")), [(110, vec![0.5, 0.3])]);

    let history = rows_of(&clip(), "/forecasts/7/history");
    let Drawing::Strips { strips: seen, .. } = &history[1].drawing else { panic!("{:?}", history[1]) };
    assert_eq!((seen[0].len(), seen[0][3]), (4, strips[0][0]));
}

#[test]
fn a_force_starts_where_the_vehicle_is_before_its_step() {
    for (part, vectors) in [
        ("goal", [[1., 0.25], [4., 0.25], [7., 0.25]]),
        ("neighbours", [[-0.5, 0.], [-0.5, 0.375], [-0.5, 0.75]]),
        ("lines", [[0., -0.75]; 3]),
    ] {
        let rows = rows_of(&clip(), &format!("/forecasts/7/forces/{part}"));
        let Drawing::Arrows { origins, vectors: found, .. } = &rows[0].drawing else { panic!("{:?}", rows[0]) };
        assert_eq!(*found, vectors.map(|v| v.map(|a: f32| a * ARROW_M)), "{part}");
        // Steps 0, 3 and 6: from the origin, and from the points after 3 and 6 steps.
        let expected = [[10., 0.2], [13., 0.5], [16., 0.8]];
        assert_eq!(origins.len(), 3);
        for (origin, expected) in origins.iter().zip(expected) {
            assert!((origin[0] - expected[0]).abs() < 1e-5 && (origin[1] - expected[1]).abs() < 1e-5, "{origins:?}");
        }
    }
}

#[test]
fn scalars_are_those_of_the_latest_forecast() {
    let tau = scalars(&rows_of(&clip(), "/scalars/7/goal/tau"));
    // Four steps of the forecast at 100, then three of that at 120, until the car is last seen.
    assert_eq!(tau.iter().map(|(frame, _)| *frame).collect::<Vec<_>>(), [100, 105, 110, 115, 120, 125, 130]);
    for ((_, values), expected) in tau.iter().zip([0.5, 0.6, 0.7, 0.8, 0.5, 0.6, 0.7]) {
        assert!(values.len() == 1 && (values[0] - expected).abs() < 1e-6, "{tau:?}");
    }
    let k = rows_of(&clip(), "/scalars/7/neighbours/k");
    let Row { frame: None, drawing: Drawing::Series(names) } = &k[0] else { panic!("{:?}", k[0]) };
    assert_eq!((names.len(), names[0].as_str(), names[5].as_str()), (8, "ahead", "right ahead"));
    assert_eq!(scalars(&k)[1], (105, vec![1., 11., 21., 31., 41., 51., 61., 71.]));
    assert_eq!(scalars(&rows_of(&clip(), "/scalars/31/lines/k"))[0], (110, vec![3., 4., 5.]));
    let speed = scalars(&rows_of(&clip(), "/scalars/7/speed"));
    assert_eq!(speed.len(), 7);
    assert!((speed[3].1[0] - 8f32.hypot(0.5)).abs() < 1e-6);
}

#[test]
fn simulated_data_is_called_so() {
    let about = |clip: &Clip| match &rows_of(clip, "/about")[0].drawing {
        Drawing::Text(text) => text.clone(),
        other => panic!("{other:?}"),
    };
    let real = about(&clip());
    assert!(real.contains("us101-13") && real.contains("Vehicle 7") && !real.contains("simulated"), "{real}");
    assert!(real.contains("attraction of the goal (#f5c400), repulsion of all neighbours"), "{real}");
    let mut made_up = clip();
    made_up.simulated = true;
    assert!(about(&made_up).contains("*simulated*"));
}

#[test]
fn the_liveliest_is_evaluated_and_moves_sideways() {
    let mut clip = clip();
    assert_eq!(clip.liveliest(), Some(7));
    // The truck moves more, but the model may have seen it in training.
    for (i, state) in clip.vehicles[1].states.iter_mut().enumerate() {
        state.centre[1] += i as f32;
    }
    assert_eq!(clip.liveliest(), Some(7));
    clip.vehicles[1].evaluated = true;
    assert_eq!(clip.liveliest(), Some(31));
    // Before it is forecast it may move as it likes.
    clip.vehicles[1].forecasts[0].frame = 115;
    assert_eq!(clip.liveliest(), Some(7));
    assert_eq!(Clip::default().liveliest(), None);
}

#[test]
fn an_empty_clip_has_no_road() {
    let entities: Vec<String> = records(&Clip::default(), None).into_iter().map(|record| record.entity).collect();
    assert_eq!(entities, ["/about"]);
}
