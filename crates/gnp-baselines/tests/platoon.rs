//! The platoon rule: traffic it finds, drivers it recovers, what it predicts.

// clippy.toml allows it inside test functions alone; scenes are built outside.
#![allow(clippy::unwrap_used)]

use gnp_baselines::{ActingTerms, Drivers, PlatoonRule, RULES, Traffic};
use gnp_data::{
    EditedScene, LaneMarking, LiveScene, Predictor, Recording, Sample, SceneEdit, Slot, VehicleClass, Window,
    WindowShape,
};
use gnp_force::{Driver, Follower, Platoon};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const RATE_HZ: f64 = 10.;

fn shape() -> WindowShape {
    WindowShape::new(31, 50, 1, RATE_HZ).unwrap()
}

/// Vehicles of one lane as they drove: positions along the road by vehicle and frame, nearest to the front last.
fn scene(positions: &[Vec<f64>]) -> LiveScene {
    let lines = [-1.8, 1.8].map(|y| LaneMarking::new(y, true)).to_vec();
    let mut scene = LiveScene::new(RATE_HZ, lines).unwrap();
    for (vehicle, xs) in positions.iter().enumerate() {
        let sample = |(frame, x): (usize, &f64)| Sample::new(frame as f64 / RATE_HZ, [*x as f32, 0.]);
        let samples: Vec<Sample> = xs.iter().enumerate().map(sample).collect();
        scene.push(vehicle as u32, [5., 1.8], VehicleClass::Car, &samples).unwrap();
    }
    scene
}

fn window(recording: &Recording, vehicle: u32, row: usize) -> Window<'_> {
    let track = recording.tracks().iter().position(|track| track.vehicle == vehicle).unwrap();
    Window::new(recording, shape(), track, recording.tracks()[track].rows.start + row).unwrap()
}

/// A lane of `count` IDM drivers whose foremost slows down and speeds up again.
fn lane(count: usize, driver: Driver<f64>, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let frames = 81;
    let dt = 1. / RATE_HZ;
    let (mut x, mut v): (Vec<f64>, Vec<f64>) =
        (0..count).map(|i| (i as f64 * (18. + 10. * rng.random::<f64>()), 10. + 3. * rng.random::<f64>())).unzip();
    x.sort_by(f64::total_cmp);
    let wave = (0.5 + rng.random::<f64>(), 6. * rng.random::<f64>());
    let mut all = vec![Vec::new(); count];
    for frame in 0..frames {
        for (i, xs) in all.iter_mut().enumerate() {
            xs.push(x[i]);
        }
        let acceleration: Vec<f64> = (0..count)
            .map(|i| match i + 1 < count {
                true => gnp_force::following_acceleration(x[i + 1] - x[i], 5., v[i], v[i + 1], &driver),
                false => wave.0 * (frame as f64 * dt * 0.9 + wave.1).sin(),
            })
            .collect();
        for i in 0..count {
            let next = (v[i] + acceleration[i] * dt).max(0.);
            x[i] += (v[i] + next) / 2. * dt;
            v[i] = next;
        }
    }
    all
}

#[test]
fn the_column_ahead_is_found_nearest_first_with_speeds_and_accelerations() {
    let at = |x0: f64, v: f64, a: f64| -> Vec<f64> {
        (0..81).map(|f| f as f64 / RATE_HZ).map(|t| x0 + v * t + a * t * t / 2.).collect()
    };
    let scene = scene(&[at(0., 12., 0.), at(30., 11., 0.5), at(70., 10., -0.3)]);
    let window = window(scene.recording().unwrap(), 0, 30);
    let rule = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    let traffic = rule.traffic(&window.observation());
    let column: Vec<u32> = traffic.column().map(|it| it.vehicle).collect();
    assert_eq!(column, [1, 2]);
    for (it, a) in traffic.vehicles().iter().zip([0., 0.5, -0.3]) {
        let it = it.motion;
        assert!((it.acceleration - a).abs() < 0.02 && (it.slow_acceleration - a).abs() < 0.005, "{it:?}");
        assert!(it.variance < 1e-2 && (it.since - 0.6).abs() < 1e-9, "{it:?}");
    }
    // From the middle of its span the speed is led to the last observed frame.
    let motion = rule.roll_out("live", &traffic, &shape()).unwrap();
    assert!((motion.speed(1, 0) - 12.5).abs() < 0.1, "{}", motion.speed(1, 0));
    assert!((motion.position(Traffic::TARGET, 0)).abs() < 1e-6);
}

#[test]
fn nobody_ahead_and_no_habit_is_constant_velocity() {
    let steady: Vec<f64> = (0..81).map(|f| 15. * f as f64 / RATE_HZ).collect();
    let scene = scene(&[steady]);
    let window = window(scene.recording().unwrap(), 0, 30);
    let rule = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    let forecast = rule.predict(&[window.observation()], 6).unwrap().remove(0);
    assert_eq!(forecast.modes.len(), 1);
    for (j, point) in forecast.modes[0].path.iter().enumerate() {
        assert!((point[0] - 1.5 * (j + 1) as f32).abs() < 1e-2 && point[1].abs() < 1e-5, "{point:?}");
    }
}

/// Without noise and habits the rule is gnp-force's platoon with the measured state.
#[test]
fn a_prediction_is_the_roll_out_of_the_column() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let scene = scene(&lane(5, Driver::motorway(), &mut rng));
    let window = window(scene.recording().unwrap(), 0, 30);
    let drivers = Drivers { own_gap: 0., habit: 1e-9, slow_habit: 0., ..Drivers::TYPICAL };
    let rule = PlatoonRule::of_drivers(drivers).unwrap();
    let traffic = rule.traffic(&window.observation());
    let followers: Vec<Follower<f64>> = traffic
        .vehicles()
        .iter()
        .map(|it| Follower {
            position: it.position,
            speed: it.motion.speed,
            length: it.length,
            leader: it.leader,
            driver: Driver {
                desired_speed: drivers.desired_speed,
                time_gap: drivers.time_gap,
                standstill_gap: drivers.standstill_gap,
                acceleration: drivers.acceleration,
                braking: drivers.braking,
            },
            habit: 0.,
        })
        .collect();
    let expected = Platoon::roll_out(&followers, 0.1, 50, 0.).unwrap();
    let found = rule.roll_out("live", &traffic, &shape()).unwrap();
    for step in 1..=50 {
        assert!((found.position(0, step) - expected.positions()[step - 1]).abs() < 1e-6);
    }
}

/// Without car following nobody is ahead; without the free road or the habit that part of the acceleration is 0; without
/// any the speed stays. The vehicles ahead drive as they would.
#[test]
fn terms_of_the_target_can_be_switched_off() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let scene = scene(&lane(5, Driver::motorway(), &mut rng));
    let window = window(scene.recording().unwrap(), 1, 30);
    let rule = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    let traffic = rule.traffic(&window.observation());
    let whole = rule.roll_out("live", &traffic, &shape()).unwrap();
    assert!((0..3).all(|part| whole.acceleration(3)[part].abs() > 1e-3), "{:?}", whole.acceleration(3));
    let names = PlatoonRule::terms().map(|term| term.name.to_string());
    for mask in 0..8usize {
        let off = |part: usize| mask & (1 << part) != 0;
        let acting = (0..3)
            .filter(|part| off(*part))
            .fold(ActingTerms::ALL, |acting, part| acting.without(&names[part]).unwrap());
        let motion = rule.roll_out_with("live", &traffic, &shape(), acting).unwrap();
        for step in 0..50 {
            let parts = motion.acceleration(step);
            // The free road acts behind a leader alone.
            let silent = [off(0) || off(1), off(1), off(2)];
            assert!(parts.iter().zip(silent).all(|(part, silent)| (*part == 0.) == silent), "{parts:?} {silent:?}");
            let faster = (motion.speed(0, step + 1) - motion.speed(0, step)) * RATE_HZ;
            assert!((parts.iter().sum::<f64>() - faster).abs() < 1e-9, "{parts:?} {faster}");
            // Whoever is ahead drives as he would; only who follows the target may notice.
            let mut ahead = traffic.vehicles().iter().enumerate().filter(|(_, it)| it.vehicle > 1);
            assert!(ahead.all(|(it, _)| motion.position(it, step) == whole.position(it, step)));
        }
        if off(1) && !off(2) {
            let alone = rule.roll_out("live", &traffic.without_nearest(9), &shape()).unwrap();
            assert_eq!(motion.position(0, 50), alone.position(0, 50));
        }
        if mask == 7 {
            assert_eq!(motion.speed(0, 50), motion.speed(0, 0));
        }
    }
    assert_eq!(ActingTerms::ALL.without("goal"), None);
}

/// Who drives on steadily, nearer to his leader than the rule likes, brakes when that one is nearer still, goes on as he does
/// when he is gone, and gets farther when he is farther.
#[test]
fn a_driver_stays_who_he_is_when_his_leader_is_changed() {
    let steady = |x0: f64| -> Vec<f64> { (0..81).map(|f| x0 + 15. * f as f64 / RATE_HZ).collect() };
    let scene = scene(&[steady(0.), steady(12.), steady(60.)]);
    let window = window(scene.recording().unwrap(), 0, 30);
    let seen = window.observation();
    let rule = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    let traffic = rule.traffic(&seen);
    let as_it_is = rule.roll_out("live", &traffic, &shape()).unwrap();
    let [free, following, habit] = as_it_is.acceleration(0);
    assert!(habit > 0.5 && free + following < -0.5, "{:?}", as_it_is.acceleration(0));
    let alone = rule.roll_out("live", &traffic.without_nearest(9), &shape()).unwrap();
    assert!(alone.acceleration(0)[2].abs() < 1e-2, "{:?}", alone.acceleration(0));
    assert!((alone.position(0, 50) - 75.).abs() < 0.1, "{}", alone.position(0, 50));

    let moved = |forward: f32| {
        let edit = SceneEdit::Move { vehicle: 1, by: [forward, 0.] };
        let edited = EditedScene::of(&seen).with(&edit).unwrap();
        let traffic = rule.traffic(&edited.observation(0).unwrap());
        rule.roll_out("live", &traffic, &shape()).unwrap()
    };
    let (same, near, far) = (moved(0.), moved(-3.), moved(20.));
    assert_eq!(same.position(0, 50), as_it_is.position(0, 50));
    // He is not taken for one who likes it so near.
    assert!((near.acceleration(0)[2] - habit).abs() < 1e-3, "{:?} {habit}", near.acceleration(0));
    assert!(near.position(0, 50) < same.position(0, 50) - 1., "{} {}", near.position(0, 50), same.position(0, 50));
    assert!(same.position(0, 50) < far.position(0, 50), "{} {}", same.position(0, 50), far.position(0, 50));
    // A speed of its own is another driver.
    let slow = EditedScene::of(&seen).with(&SceneEdit::Speed { vehicle: 0, speed_mps: 5. }).unwrap();
    assert!(slow.observation(0).unwrap().before_changes(0).is_none());
    assert!(seen.before_changes(1).is_none());
}

/// Traffic of known drivers: the fit predicts them better than what it set out from, states an interval in which they
/// are, and gives the same drivers for the same windows.
#[test]
fn drivers_are_recovered_from_traffic() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let driver = Driver { time_gap: 1.4, acceleration: 1.2, braking: 2., desired_speed: 30., ..Driver::motorway() };
    let scenes: Vec<LiveScene> = (0..30).map(|_| scene(&lane(4, driver, &mut rng))).collect();
    let recordings: Vec<&Recording> = scenes.iter().map(|scene| scene.recording().unwrap()).collect();
    let windows: Vec<Window<'_>> =
        recordings.iter().flat_map(|it| (0..3).map(move |vehicle| window(it, vehicle, 30))).collect();
    let fitted = PlatoonRule::fit(&windows).unwrap();
    let error = |rule: &PlatoonRule| -> f64 {
        let squares = windows.iter().map(|window| {
            let forecast = rule.predict(&[window.observation()], 1).unwrap().remove(0);
            f64::from(forecast.modes[0].path[49][0] - window.truth().goal()[0]).powi(2)
        });
        (squares.sum::<f64>() / windows.len() as f64).sqrt()
    };
    let typical = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    let (before, after) = (error(&typical), error(&fitted));
    assert!(after < 0.8 * before, "{before} {after}");
    let found = &fitted.parameters().pooled;
    let [low, high] = found.intervals["acceleration"];
    assert!(low <= driver.acceleration && driver.acceleration <= high, "{found:?}");
    assert!(low <= found.drivers.acceleration && found.drivers.acceleration <= high, "{found:?}");
    assert_eq!(fitted, PlatoonRule::fit(&windows).unwrap());
    assert!(PlatoonRule::fit(&[]).is_err());
}

/// A file may name vehicles that follow one another: nobody leads there, and nothing fails. Nor does it where a track jumps.
#[test]
fn circles_and_jumps_of_a_file_stop_nothing() {
    let at = |x0: f64, jump: f64| -> Vec<f64> {
        (0..81).map(|f| x0 + 1.2 * f64::from(f) + if f > 28 { jump } else { 0. }).collect()
    };
    let scene = scene(&[at(0., 0.), at(30., 0.), at(60., 900.)]);
    let there = scene.recording().unwrap();
    let mut columns = there.columns().clone();
    let ahead_of = |track: usize| there.tracks()[track].rows.clone();
    ahead_of(1).for_each(|row| columns.neighbours[row][Slot::Preceding.index()] = 0);
    let (roads, tracks) = (there.roads().to_vec(), there.tracks().to_vec());
    let circle = Recording::from_parts(there.meta().clone(), roads, tracks, columns).unwrap();
    let rule = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    for recording in [there, &circle] {
        for vehicle in 0..3 {
            let forecast = rule.predict(&[window(recording, vehicle, 30).observation()], 1).unwrap().remove(0);
            assert!(forecast.modes[0].path.iter().flatten().all(|value| value.is_finite()));
        }
    }
}

/// Where no vehicle follows another nothing is learned of how they follow, and that is said.
#[test]
fn what_the_windows_do_not_tell_has_its_whole_range() {
    let alone = |speed: f64| scene(&[(0..81).map(|f| speed * f64::from(f) / RATE_HZ).collect()]);
    let scenes: Vec<LiveScene> = (10..30).map(|speed| alone(f64::from(speed))).collect();
    let windows: Vec<Window<'_>> = scenes.iter().map(|it| window(it.recording().unwrap(), 0, 30)).collect();
    let fitted = PlatoonRule::fit(&windows).unwrap();
    let [low, high] = fitted.parameters().pooled.intervals["braking"];
    assert!((low - 1.).abs() < 1e-6 && (high - 4.).abs() < 1e-6, "{low} {high}");
}

#[test]
fn its_parameters_survive_a_file_and_bad_ones_are_refused() {
    let rule = RULES.iter().find(|rule| rule.name() == PlatoonRule::NAME).unwrap();
    let mut drivers = serde_json::to_value(PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap().parameters()).unwrap();
    assert_eq!(rule.load(&drivers).unwrap().name(), "platoon");
    drivers["pooled"]["drivers"]["braking"] = (-1.).into();
    assert!(rule.load(&drivers).err().unwrap().to_string().contains("braking"));
    drivers["pooled"]["drivers"]["braking"] = 2.into();
    drivers["pooled"]["drivers"]["own_gap"] = 1.5.into();
    assert!(rule.load(&drivers).err().unwrap().to_string().contains("own_gap"));
}
