//! The Intelligent Driver Model against its equations.

use gnp_baselines::{Idm, IdmParameters, Leader};
use gnp_data::{LaneMarking, LiveScene, Predictor, Sample, VehicleClass, Window, WindowShape};

use crate::road::{Car, SHAPE, path, road};

const LONG: WindowShape = WindowShape { t_obs: 16, t_pred: 300, step: 1, rate_hz: 10. };

/// Speeds between predicted frames, m/s, the last observed centre included.
fn speeds(path: &[[f32; 2]], dt: f64) -> Vec<f64> {
    let mut x = 0.;
    path.iter()
        .map(|position| (f64::from(position[0]) - std::mem::replace(&mut x, f64::from(position[0]))) / dt)
        .collect()
}

#[test]
fn accelerations_are_those_worked_out_by_hand() {
    let idm = Idm::default();
    let p = IdmParameters::MOTORWAY;
    assert!((idm.acceleration(0., None) - 1.).abs() < 1e-12);
    assert!(idm.acceleration(p.desired_speed, None).abs() < 1e-12);
    // 20 m/s behind 15 m/s at 30 m: the wanted gap is 2 + 20 + 20 * 5 / (2 sqrt(1.5)) = 62.825 m.
    let closing = idm.acceleration(20., Some(Leader { speed: 15., gap: 30. }));
    assert!((closing - (1. - 0.1296 - (62.824_829 / 30f64).powi(2))).abs() < 1e-6, "{closing}");
    // A leader that leaves quickly asks for no more than the gap of stationary vehicles: (2 / 30)^2.
    let leaving = idm.acceleration(20., Some(Leader { speed: 40., gap: 30. }));
    assert!((leaving - (1. - 0.1296 - 4. / 900.)).abs() < 1e-12, "{leaving}");
    assert_eq!(idm.acceleration(20., Some(Leader { speed: 0., gap: -3. })), -9.);
}

#[test]
fn the_gap_of_equilibrium_is_kept() {
    // (2 + 15 T) / sqrt(1 - (15 / v0)^4) between bumpers, and 4 m of vehicles.
    for parameters in [IdmParameters::MOTORWAY, IdmParameters::PROPOSED] {
        let gap = (2. + 15. * parameters.headway) / (1. - (15. / parameters.desired_speed).powi(4)).sqrt();
        let (target, leader) = (|t: f64| [15. * t, 0.], move |t: f64| [gap + 4. + 15. * t, 0.]);
        let recording = road(SHAPE, 0, &[Car { from: 0, at: &target }, Car { from: 0, at: &leader }]);
        for (j, position) in path(&Idm::new(parameters).unwrap(), SHAPE, &recording).iter().enumerate() {
            assert!((f64::from(position[0]) - 1.5 * (j + 1) as f64).abs() < 1e-3, "{j}: {position:?}");
        }
    }
}

#[test]
fn a_standing_leader_is_never_reached() {
    for (speed, distance) in [(10., 40.), (20., 60.), (30., 90.), (2., 7.)] {
        let (target, leader) = (|t: f64| [speed * t, 0.], |_: f64| [distance, 0.]);
        let recording = road(LONG, 0, &[Car { from: 0, at: &target }, Car { from: 0, at: &leader }]);
        let path = path(&Idm::default(), LONG, &recording);
        assert!(speeds(&path, 0.1).iter().all(|speed| *speed >= 0.), "{speed} m/s");
        let gap = distance - 4. - f64::from(path[299][0]);
        assert!(gap > 0.5 && gap < 3.5, "{speed} m/s: stands {gap} m behind");
    }
}

#[test]
fn too_late_to_brake_is_still_not_backwards() {
    let (target, leader) = (|t: f64| [30. * t, 0.], |_: f64| [5., 0.]);
    let recording = road(LONG, 0, &[Car { from: 0, at: &target }, Car { from: 0, at: &leader }]);
    let path = path(&Idm::default(), LONG, &recording);
    assert!(speeds(&path, 0.1).iter().all(|speed| *speed >= 0.));
    // 30 m/s and -9 m/s²: 50 m.
    assert!((path[299][0] - 50.).abs() < 1e-2, "{:?}", path[299]);
}

#[test]
fn a_driver_who_sees_no_leader_keeps_its_speed() {
    for speed in [0., 25., 40.] {
        let target = |t: f64| [speed * t, 0.];
        let recording = road(LONG, 0, &[Car { from: 0, at: &target }]);
        let speeds = speeds(&path(&Idm::default(), LONG, &recording), 0.1);
        assert!(speeds.iter().all(|found| (found - speed).abs() < 0.02), "{speed} m/s: {speeds:?}");
    }
}

#[test]
fn a_fit_finds_the_drivers_that_made_the_windows() {
    // Followers at many gaps and speeds behind a leader that keeps its speed, driven by these parameters.
    let made = IdmParameters { headway: 1.8, acceleration: 0.6, desired_speed: 25., ..IdmParameters::MOTORWAY };
    let recordings: Vec<_> = (0..60)
        .map(|i| {
            let (own, ahead) = (8. + 0.2 * f64::from(i), 6. + f64::from(i * 7 % 12));
            let gap = 12. + f64::from(i * 5 % 31);
            let start = road(
                SHAPE,
                0,
                &[Car { from: 0, at: &|t| [own * t, 0.] }, Car { from: 0, at: &|t| [gap + 4. + ahead * t, 0.] }],
            );
            let driven = path(&Idm::new(made).unwrap(), SHAPE, &start);
            let at = move |t: f64| match (t * 10.).round() as usize {
                0 => [own * t, 0.],
                _ if t <= 0. => [own * t, 0.],
                step => driven.get(step - 1).map_or([0., 0.], |x| [f64::from(x[0]), 0.]),
            };
            road(SHAPE, SHAPE.t_pred, &[Car { from: 0, at: &at }, Car { from: 0, at: &|t| [gap + 4. + ahead * t, 0.] }])
        })
        .collect();
    let windows: Vec<_> =
        recordings.iter().map(|recording| Window::new(recording, SHAPE, 0, SHAPE.t_obs - 1).unwrap()).collect();
    let error = |idm: &Idm| -> f64 {
        let of = |window: &Window<'_>| {
            let forecast = idm.predict(&[window.observation()], 1).unwrap();
            let [x, _] = forecast[0].modes[0].path[SHAPE.t_pred - 1];
            f64::from(x - window.truth().goal()[0]).powi(2)
        };
        windows.iter().map(of).sum::<f64>() / windows.len() as f64
    };
    let (fitted, default) = (Idm::fit(&windows).unwrap(), Idm::default());
    assert!(error(&fitted).sqrt() < 0.2 * error(&default).sqrt(), "{} {} {fitted:?}", error(&fitted), error(&default));
    assert!((fitted.parameters().headway - 1.8).abs() < 0.4, "{fitted:?}");
    // Without a leader there is nothing to fit.
    let alone = road(SHAPE, SHAPE.t_pred, &[Car { from: 0, at: &|t| [20. * t, 0.] }]);
    let found = Idm::fit(&[Window::new(&alone, SHAPE, 0, SHAPE.t_obs - 1).unwrap()]).unwrap().parameters();
    assert_eq!(IdmParameters { span_s: 0.8, ..found }, IdmParameters::MOTORWAY);
    assert!(Idm::fit(&[]).is_err());
}

#[test]
fn a_leader_without_a_past_goes_as_fast_as_its_follower() {
    let target = |t: f64| [15. * t, 0.];
    let gap = 17. / (1. - (15. / IdmParameters::MOTORWAY.desired_speed).powi(4)).sqrt();
    let leader = |t: f64| [gap + 4. + 8. * t, 0.];
    let at = |from: usize| {
        let recording = road(SHAPE, 0, &[Car { from: 0, at: &target }, Car { from, at: &leader }]);
        path(&Idm::default(), SHAPE, &recording)[29][0]
    };
    assert!((at(SHAPE.t_obs - 1) - 45.).abs() < 1e-2);
    // Two frames are enough to see that it is slower.
    assert!((at(SHAPE.t_obs - 2) - at(0)).abs() < 1e-2 && at(0) < 40.);
}

#[test]
fn a_speed_sideways_dies_away() {
    let target = |t: f64| [20. * t, -0.5 * t];
    let recording = road(LONG, 0, &[Car { from: 0, at: &target }]);
    let idm = Idm::new(IdmParameters { settling: 2., ..IdmParameters::MOTORWAY }).unwrap();
    let path = path(&idm, LONG, &recording);
    for j in [0usize, 9, 19, 299] {
        let wanted = -0.5 * 2. * (1. - (-0.1 * (j + 1) as f64 / 2.).exp());
        assert!((f64::from(path[j][1]) - wanted).abs() < 1e-4, "{j}: {} instead of {wanted}", path[j][1]);
    }
}

#[test]
fn parameters_must_be_positive() {
    let bad = IdmParameters { headway: 0., ..IdmParameters::PROPOSED };
    let message = Idm::new(bad).unwrap_err().to_string();
    assert!(message.contains("headway") && message.contains("positive"), "{message}");
    assert!(Idm::new(IdmParameters { braking: f64::NAN, ..IdmParameters::PROPOSED }).is_err());
}

#[test]
fn a_leader_seen_once_has_the_speed_that_was_measured() {
    let end = |since: i32| {
        let mut scene = LiveScene::new(10., [0., 3.7].map(|y| LaneMarking::new(y, true)).to_vec()).unwrap();
        for (vehicle, x, speed, since) in [(1, 0., 30., -15), (2, 60., 12., since)] {
            let at =
                |i: i32| Sample::new(f64::from(i) / 10., [x + speed * i as f32 / 10., 1.8]).with_velocity([speed, 0.]);
            scene.push(vehicle, [4., 1.8], VehicleClass::Car, &(since..=0).map(at).collect::<Vec<_>>()).unwrap();
        }
        let forecasts = Idm::default().predict(&[scene.observe(1, SHAPE).unwrap()], 1).unwrap();
        forecasts[0].modes[0].path[SHAPE.t_pred - 1][0]
    };
    let (throughout, once) = (end(-15), end(0));
    assert!((throughout - once).abs() < 1e-2, "{throughout} m and {once} m");
    assert!(throughout < 75., "it brakes behind the slow leader: {throughout} m");
}
