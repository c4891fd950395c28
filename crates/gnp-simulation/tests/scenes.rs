//! Scenes: what is refused, what is the same again, and what must be conserved.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_simulation::{Counts, Kind, Scene, Simulated};
use std::ops::ControlFlow;

const SECTION: &str = r#"
name = "section"
duration_s = 240
warm_up_s = 60
detectors_m = [500]
[road]
lanes = 2
length_m = 1000
[inflow]
flow = [[0, 1200], [150, 600]]
[[drivers]]
name = "car"
share = 4
spread = 0.2
desired_speed_mps = { mean = 32, sd = 3 }
noise = { sigma = 0.1, correlation = 4.0 }
lane_change = { politeness = 0.2, threshold = 0.1, keep_right = 0.2, safe_braking = 3.0, pause = 3.0 }
[[drivers]]
name = "lorry"
lanes = [0]
length_m = 16.5
width_m = 2.5
desired_speed_mps = { mean = 23 }
"#;

fn run(text: &str, seed: u64) -> Simulated {
    Scene::parse(text).unwrap().run(seed, &mut |_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn what_cannot_be_is_refused_with_its_key() {
    let flow = "flow = [[0, 1200], [150, 600]]";
    let newell = "rule = { newell = { wave_time = 0.0, standstill_gap = 2.0 } }";
    for (from, to, said) in [
        ("duration_s = 240", "duration_s = -1", "`duration_s` is -1"),
        ("lanes = 2", "lanes = 0", "`road.lanes` is 0"),
        ("lanes = 2", "lanes = 17", "`road.lanes` is 17"),
        ("length_m = 1000", "length_m = 200000", "`road.length_m` is 200000"),
        (flow, "flow = [[0, 1200], [0, 600]]", "`inflow.flow` is not in the order of time"),
        (flow, "flow = [[0, 1e9]]", "`inflow.flow` is 1000000000"),
        ("length_m = 1000", "length_m = 1000\nring = true", "absent on a ring"),
        ("lanes = [0]", "lanes = [2]", "drivers.lanes (lorry)"),
        ("share = 4", "share = 4\nlanes = [0]", "without a kind that enters lane 1"),
        ("share = 4", "fitted = \"nowhere\"", "nowhere"),
        ("length_m = 1000", "length_m = 1000\nclosures = [{ lane = 1, from_m = 50, to_m = 200 }]", "from 100 to 1000"),
        ("sigma = 0.1", "sigma = -0.1", "sigma"),
        ("detectors_m = [500]", "detectors_m = [5000]", "`detectors_m` is 5000"),
        ("warm_up_s = 60", "warm_up = 60", "line 4, column 1"),
        ("name = \"section\"", "name = \"../section\"", "`name` is ../section"),
        ("duration_s = 240", "duration_s = 240\nrecord_hz = 7", "`record_hz` is 7"),
        ("share = 4", newell, "newell.wave_time"),
    ] {
        let text = SECTION.replacen(from, to, 1);
        assert_ne!(text, SECTION, "{from} is in the scene");
        let refused = Scene::parse(&text).map_err(|error| error.to_string()).and_then(|scene| {
            scene.run(0, &mut |_| ControlFlow::Continue(())).map(|_| ()).map_err(|error| error.to_string())
        });
        let error = refused.expect_err(to);
        assert!(error.contains(said), "{to}: {error}");
    }
    let nobody = SECTION.replace(&format!("[inflow]\n{flow}\n"), "");
    assert!(Scene::parse(&nobody).unwrap_err().to_string().contains("nobody ever drives"));
}

/// Not only when the first such driver enters.
#[test]
fn every_number_of_a_driver_is_checked_when_the_scene_is_read() {
    for (from, to, said) in
        [("keep_right = 0.2", "keep_right = nan", "keep_right"), ("sigma = 0.1", "sigma = nan", "sigma")]
    {
        let error = Scene::parse(&SECTION.replacen(from, to, 1)).expect_err(to).to_string();
        assert!(error.contains(said), "{to}: {error}");
    }
}

#[test]
fn the_scenes_that_come_with_the_crate_are_scenes() {
    for (name, text) in Scene::EMBEDDED {
        let scene = Scene::parse(text).unwrap();
        assert_eq!(scene.name, *name);
        assert_eq!(Scene::parse(&toml::to_string(&scene).unwrap()).unwrap(), scene, "what is written is read again");
    }
}

#[test]
fn one_seed_is_one_recording_and_another_seed_another() {
    let bits = |simulated: &Simulated| {
        let columns = simulated.recording.columns();
        let numbers = columns.x.iter().chain(&columns.y).chain(&columns.vx).map(|value| value.to_bits());
        numbers.collect::<Vec<_>>()
    };
    for text in [SECTION.to_owned(), SECTION.replacen("share = 4", "share = 4\nfitted = \"us-101\"", 1)] {
        let [one, again, other] = [run(&text, 1), run(&text, 1), run(&text, 2)];
        assert_eq!(bits(&one), bits(&again));
        assert_eq!(one.happenings, again.happenings);
        assert_ne!(bits(&one), bits(&other));
        assert!(one.recording.meta().simulated);
    }
}

#[test]
fn vehicles_are_conserved_and_do_not_touch() {
    let simulated = run(SECTION, 3);
    let Counts { started, entered, left, remain, contacts, lane_changes, .. } = simulated.counts;
    assert_eq!((started + entered, contacts), (left + remain, 0));
    // 1,200 an hour and lane for 150 s, 600 for another 150 s, on two lanes.
    assert!(entered.abs_diff(150) < 45 && lane_changes > 5, "{:?}", simulated.counts);
    let in_order = simulated.happenings.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s);
    assert!(in_order && simulated.happenings.iter().all(|it| (0.0..=240.0).contains(&it.time_s)));
    // The recording agrees: lanes from the left, in the frame of that time in the new lane.
    let recording = &simulated.recording;
    let changes: Vec<_> = simulated.happenings.iter().filter(|it| it.kind == Kind::LaneChange).collect();
    assert!(!changes.is_empty() && changes.len() as u64 <= lane_changes);
    for change in changes.into_iter().filter(|it| it.time_s > 0.1 && it.time_s < 239.0) {
        let track = recording.tracks().iter().find(|track| u64::from(track.vehicle) == change.vehicle).unwrap();
        let lane = |frame: u32| track.row_at(frame).map(|row| recording.columns().lane[row] as usize);
        let frame = (change.time_s * 10.0).round() as u32;
        assert_eq!([lane(frame - 1), lane(frame)], change.lanes.unwrap().map(Some), "{change:?}");
    }
}

#[test]
fn lorries_enter_on_the_right_and_a_speed_limit_is_kept() {
    let limit = "[[speed_limits]]\nfrom_m = 300\nto_m = 1000\nfrom_s = 0\nto_s = 400\nspeed_mps = 15\n";
    let [free, limited] = [SECTION.to_owned(), SECTION.to_owned() + limit].map(|text| run(&text, 4).recording);
    let mean = |recording: &gnp_data::Recording| {
        let columns = recording.columns();
        let beyond = columns.x.iter().zip(&columns.vx).filter(|(x, _)| **x > 600.).map(|(_, v)| f64::from(*v));
        let (sum, count) = beyond.fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
        sum / f64::from(count)
    };
    assert!(mean(&free) > 24.0 && mean(&limited) < 15.5, "{} and {} m/s", mean(&free), mean(&limited));
    for track in free.tracks().iter().filter(|track| track.length > 10.) {
        assert!(track.rows.clone().all(|row| free.columns().lane[row] == 2), "a lorry left the right lane");
    }
}

#[test]
fn a_ring_keeps_its_vehicles_on_it() {
    let ring = Scene::EMBEDDED.iter().find(|(name, _)| *name == "ring").unwrap().1;
    let simulated = run(&ring.replace("duration_s = 900", "duration_s = 60"), 0);
    assert_eq!((simulated.counts.remain, simulated.counts.contacts), (22, 0));
    assert!(simulated.recording.columns().x.iter().all(|x| (0. ..230.).contains(x)));
    assert_eq!(simulated.recording.len(), 22 * 600);
}

#[test]
fn a_simulation_is_stopped_when_asked() {
    let mut calls = 0;
    let stopped = Scene::parse(SECTION).unwrap().run(0, &mut |_| {
        calls += 1;
        if calls > 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(stopped.unwrap_err().to_string().starts_with("stopped after 20 s"));
}
