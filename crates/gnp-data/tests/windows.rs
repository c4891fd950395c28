//! Which windows a recording gives, and what is said about the rest.

mod scene;

use gnp_data::{DataError, Observation, Window, WindowConfig, WindowError, WindowId, WindowSet, WindowShape};
use scene::{recording, short_windows};

#[test]
fn starts_in_the_first_row_and_then_every_stride() {
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 20)])];
    let (set, drops) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let t0: Vec<u32> = set.iter().map(|window| window.key().t0).collect();
    // Four observed frames: the first window sees 100..=103 and predicts 104..=108.
    assert_eq!(t0, [103, 105, 107, 109, 111, 113], "the last one ends in frame 118; one more would end in 120");
    let total = drops.total();
    assert_eq!((total.candidates, total.windows, total.past_track_end), (10, 6, 4));
    let shape = set.shape();
    assert_eq!((shape.t_obs, shape.t_pred, shape.step), (4, 5, 1));
}

#[test]
fn a_window_sees_its_target_from_the_last_observed_centre() {
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 20)])];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let window = set.iter().nth(1).unwrap();
    let (observation, truth) = (window.observation(), window.truth());
    for i in 0..4u8 {
        let state = observation.target(i.into());
        assert!((state.x - (f32::from(i) - 3.) * 0.7).abs() < 1e-4, "frame {i}: {state:?}");
        assert!((state.vx - 7.).abs() < 1e-3 && state.y == 0. && state.vy == 0., "frame {i}: {state:?}");
    }
    for j in 0..5u8 {
        let state = truth.target(j.into());
        assert!((state.x - (f32::from(j) + 1.) * 0.7).abs() < 1e-4, "frame {j}: {state:?}");
    }
    assert!((truth.goal()[0] - 3.5).abs() < 1e-4);
    let lines: Vec<f32> = observation.lines().map(|line| line.y).collect();
    assert_eq!(lines, [-30., -26.25, -22.5], "lines move with the origin, 28 m to the left");
}

#[test]
fn drops_are_counted_by_reason_and_add_up() {
    let recordings = [
        // Vehicle 1 is interrupted in frame 12 for one frame, vehicle 2 is too short, vehicle 3 just fits.
        recording("a", "s", 10., &[(1, 0, 0, 12), (1, 1, 13, 11), (2, 0, 0, 8), (3, 0, 0, 9)]),
        recording("b", "s", 10., &[(1, 0, 0, 5)]),
    ];
    let (set, drops) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let [a, b] = &drops.recordings[..] else { panic!("two recordings") };
    assert_eq!((a.recording.as_str(), b.recording.as_str()), ("a", "b"));
    // Starts 0, 2 of the first stretch; 0, 2 of the second; 0 of vehicle 3.
    assert_eq!((a.windows, a.gap, a.track_too_short, a.past_track_end), (5, 4, 4, 4 + 4));
    assert_eq!((b.windows, b.gap, b.track_too_short, b.past_track_end), (0, 0, 3, 0));
    assert_eq!((a.vehicles, a.vehicles_without_window, b.vehicles_without_window), (3, 1, 1));
    for (recording, counted) in recordings.iter().zip(&drops.recordings) {
        assert_eq!(short_windows().count(recording).unwrap(), *counted);
    }
    let total = drops.total();
    assert_eq!(total.candidates, total.windows + total.gap + total.track_too_short + total.past_track_end);
    assert_eq!(total.windows, set.len());
}

#[test]
fn no_window_spans_a_gap() {
    let recordings = [recording("a", "s", 10., &[(1, 0, 0, 12), (1, 1, 13, 11)])];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    for window in set.iter() {
        let key = window.key();
        let frames = key.t0 - 3..=key.t0 + 5;
        assert!(!frames.contains(&12), "{key:?}");
        assert_eq!(key.segment, u16::from(*frames.start() > 12));
    }
}

#[test]
fn resampling_takes_every_nth_row() {
    let fast = [recording("fast", "s", 20., &[(7, 0, 200, 40)])];
    let slow = [recording("slow", "s", 10., &[(7, 0, 100, 20)])];
    let (fast, _) = WindowSet::cut(&fast, &short_windows()).unwrap();
    let (slow, _) = WindowSet::cut(&slow, &short_windows()).unwrap();
    assert_eq!((fast.shape().step, slow.shape().step), (2, 1));
    assert!(fast.shape().fits(&slow.shape()));
    assert_eq!(fast.len(), slow.len());
    for (fast, slow) in fast.iter().zip(slow.iter()) {
        assert_eq!(fast.key().t0, 2 * slow.key().t0);
        for i in 0..4 {
            let (a, b) = (fast.observation().target(i), slow.observation().target(i));
            assert!((a.x - b.x).abs() < 1e-4 && (a.vx - b.vx).abs() < 1e-2, "{a:?} {b:?}");
        }
        assert!((fast.truth().goal()[0] - slow.truth().goal()[0]).abs() < 1e-4);
    }
}

#[test]
fn the_published_lengths_are_31_and_76_observed_frames() {
    let config = |rate_hz, stride_s| WindowConfig {
        observed_s: 3.,
        predicted_s: 5.,
        rate_hz,
        stride_s,
        site_stride_s: Default::default(),
    };
    let ngsim = config(10., 1.).shape_for(10.).unwrap();
    let highd = config(25., 1.).shape_for(25.).unwrap();
    let thinned = config(5., 1.).shape_for(25.).unwrap();
    assert_eq!((ngsim.t_obs, ngsim.t_pred, ngsim.step, ngsim.span()), (31, 50, 1, 81));
    assert_eq!((highd.t_obs, highd.t_pred, highd.step, highd.span()), (76, 125, 1, 201));
    assert_eq!((thinned.t_obs, thinned.t_pred, thinned.step, thinned.span()), (16, 25, 5, 201));
}

#[test]
fn a_site_may_have_a_stride_of_its_own() {
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 28)]), recording("b", "t", 10., &[(7, 0, 100, 28)])];
    let config = WindowConfig { site_stride_s: [("t".to_owned(), 0.5)].into(), ..short_windows() };
    let count = |site: &str| {
        let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
        set.iter().filter(|window| window.observation().site() == site).count()
    };
    // 9 of 28 frames a window leave 20 starts: every second, and every fifth.
    assert_eq!((count("s"), count("t")), (10, 4));
    let wrong = WindowConfig { site_stride_s: [("t".to_owned(), 0.25)].into(), ..short_windows() };
    let error = WindowSet::cut(&recordings, &wrong).unwrap_err().to_string();
    assert!(error.contains("site_stride_s"), "{error}");
}

#[test]
fn a_rate_that_leaving_out_frames_cannot_give_is_refused() {
    let recordings = [recording("a", "s", 25., &[(7, 0, 100, 60)])];
    let error = WindowSet::cut(&recordings, &short_windows()).unwrap_err();
    assert!(matches!(error, DataError::WindowRate { recording_hz: 25., window_hz: 10. }), "{error}");
    let faster = WindowConfig { rate_hz: 50., ..short_windows() };
    assert!(matches!(WindowSet::cut(&recordings, &faster), Err(DataError::WindowRate { .. })));
}

#[test]
fn wrong_configurations_name_the_key_and_the_remedy() {
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 60)])];
    let message = |config: WindowConfig| WindowSet::cut(&recordings, &config).unwrap_err().to_string();
    let good = short_windows();
    let stride = message(WindowConfig { stride_s: 0.25, ..good.clone() });
    assert!(stride.contains("stride_s") && stride.contains("0.2000 or 0.3000"), "{stride}");
    let t_obs = message(WindowConfig { observed_s: 0.33, ..good.clone() });
    assert!(t_obs.contains("observed_s"), "{t_obs}");
    let rate = message(WindowConfig { rate_hz: f64::NAN, ..good.clone() });
    assert!(rate.contains("rate_hz") && rate.contains("0.01 to 1000 Hz"), "{rate}");
    let t_pred = message(WindowConfig { predicted_s: 1e300, ..good.clone() });
    assert!(t_pred.contains("predicted_s"), "{t_pred}");
    let long = message(WindowConfig { predicted_s: 30., ..good });
    assert!(long.contains("30.3 s") && long.contains("5.9 s"), "{long}");
}

#[test]
fn two_recordings_of_one_name_are_refused() {
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 20)]), recording("a", "t", 10., &[(7, 0, 100, 20)])];
    let error = WindowSet::cut(&recordings, &short_windows()).unwrap_err();
    assert!(matches!(error, DataError::DuplicateRecording { .. }), "{error}");
    assert!(matches!(WindowSet::cut(&[], &short_windows()), Err(DataError::NoWindow { .. })));
}

#[test]
fn an_id_takes_twelve_bytes_and_a_foreign_one_gives_no_window() {
    assert_eq!(size_of::<WindowId>(), 12);
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 20), (8, 0, 100, 20)])];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let id = set.ids()[0];
    assert!(set.get(id).is_some());
    for foreign in [
        WindowId { recording: 1, ..id },
        WindowId { track: 2, ..id },
        WindowId { track: 1, ..id }, // a row of track 0
        WindowId { row: 2, ..id },   // not enough past
        WindowId { row: 15, ..id },  // not enough future
        WindowId { row: u32::MAX, ..id },
    ] {
        assert!(set.get(foreign).is_none(), "{foreign:?}");
    }
}

#[test]
fn out_of_range_frames_give_nothing() {
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 20), (8, 0, 100, 20)])];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let window = set.iter().next().unwrap();
    assert_eq!(window.observation().target(4), gnp_data::TrackState::default());
    assert_eq!(window.truth().target(5), gnp_data::TrackState::default());
    assert_eq!(window.truth().lane(5), 0);
    assert_eq!(window.truth().others(5).count(), 0);
}

#[test]
fn a_shape_without_frames_has_no_windows() {
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 20)])];
    let shape = WindowShape { t_obs: 4, t_pred: 5, step: 1, rate_hz: 10. };
    let view = |shape| Window::new(&recordings[0], shape, 0, 5);
    assert!(view(shape).is_ok());
    for bad in [
        WindowShape { t_obs: 0, ..shape },
        WindowShape { t_pred: 0, ..shape },
        WindowShape { step: 0, ..shape },
        WindowShape { rate_hz: f64::NAN, ..shape },
        WindowShape { rate_hz: -10., ..shape },
    ] {
        assert!(matches!(view(bad), Err(WindowError::Shape { .. })), "{bad}");
        assert!(WindowShape::new(bad.t_obs, bad.t_pred, bad.step, bad.rate_hz).is_err());
    }
}

#[test]
fn a_window_of_another_rate_than_the_recordings_is_refused() {
    // Three seconds at 25 Hz, taken for ten times as many at 10 Hz, would be a vehicle at 40 % of its speed.
    let recordings = [recording("a", "s", 25., &[(7, 0, 100, 60)])];
    let observe = |step, rate_hz| {
        let shape = WindowShape::new(4, 5, step, rate_hz).unwrap();
        Observation::new(&recordings[0], shape, 0, 30).map(|_| ())
    };
    let error = observe(1, 10.).unwrap_err();
    assert!(matches!(error, WindowError::Rate { recording_hz: 25., .. }), "{error}");
    assert!(error.to_string().contains("25 Hz") && error.to_string().contains("10 Hz"), "{error}");
    assert!(observe(2, 25.).is_err());
    assert_eq!((observe(1, 25.), observe(2, 12.5), observe(5, 5.)), (Ok(()), Ok(()), Ok(())));
}

#[test]
fn what_is_missing_for_a_window_is_said() {
    let recording = recording("a", "s", 10., &[(7, 0, 0, 12), (7, 1, 13, 20), (8, 0, 0, 9)]);
    let shape = WindowShape::new(4, 5, 1, 10.).unwrap();
    let observe = |track, row| Observation::new(&recording, shape, track, row).map(|_| ());
    assert_eq!(observe(3, 0), Err(WindowError::NoTrack { track: 3, tracks: 3 }));
    assert_eq!(observe(0, 12), Err(WindowError::NoRow { row: 12, vehicle: 7, rows: 0..12 }));
    assert_eq!(observe(0, 2), Err(WindowError::TooShort { vehicle: 7, found: 3, needed: 4 }));
    assert_eq!(observe(1, 12 + 1), Err(WindowError::Gap { vehicle: 7, found: 2, needed: 4 }));
    assert_eq!((observe(0, 3), observe(1, 15)), (Ok(()), Ok(())));
    let window = |row| Window::new(&recording, shape, 2, row).map(|_| ());
    assert_eq!(window(32 + 3), Ok(()));
    assert_eq!(window(32 + 4), Err(WindowError::NoFuture { vehicle: 8, found: 4, needed: 5 }));
    // A single frame is enough where a row before it tells the velocity.
    let single = WindowShape::new(1, 5, 1, 10.).unwrap();
    assert_eq!(Observation::new(&recording, single, 2, 32).err(), Some(WindowError::NoVelocity { vehicle: 8 }));
    assert!(Observation::new(&recording, single, 2, 33).is_ok());
}

#[test]
fn shapes_survive_json() {
    let shape = WindowShape { t_obs: 31, t_pred: 50, step: 2, rate_hz: 12.5 };
    let text = serde_json::to_string(&shape).unwrap();
    assert_eq!(serde_json::from_str::<WindowShape>(&text).unwrap(), shape);
    assert!(serde_json::from_str::<WindowShape>(r#"{"t_obs":1,"t_pred":1,"step":1,"rate_hz":1,"x":0}"#).is_err());
    assert!(!shape.fits(&WindowShape { rate_hz: 10., ..shape }));
    assert!(shape.fits(&WindowShape { step: 1, ..shape }));
}
