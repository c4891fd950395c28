//! Vehicles that follow each other: what a column of traffic does, and what is refused.
use gnp_force::{
    CarFollowing, Driver, Follower, ForceError, ForceTerm, FreeRoad, HARDEST_BRAKING, Platoon, Source, State,
    following_acceleration, free_acceleration, na::Point2, na::RealField, na::convert,
};

const LENGTH: f64 = 4.6;

fn car(position: f64, speed: f64, leader: Option<usize>) -> Follower<f64> {
    Follower { position, speed, length: LENGTH, leader, driver: Driver::motorway(), habit: 0. }
}

/// A column that drives steadily, the foremost first.
fn column(vehicles: usize, speed: f64) -> Vec<Follower<f64>> {
    let pitch = (2. + speed) / (1. - (speed * 3.6 / 120.).powi(4)).sqrt() + LENGTH;
    (0..vehicles).map(|i| car(-pitch * i as f64, speed, i.checked_sub(1))).collect()
}

/// A column in single precision or double.
fn rolled<T: RealField + Copy>(
    column: &[Follower<f64>],
    dt: f64,
    steps: usize,
    decay: f64,
) -> Result<Vec<f64>, ForceError> {
    let cast = |value: f64| convert::<f64, T>(value);
    let column: Vec<Follower<T>> = column
        .iter()
        .map(|one| Follower {
            position: cast(one.position),
            speed: cast(one.speed),
            length: cast(one.length),
            leader: one.leader,
            driver: Driver {
                desired_speed: cast(one.driver.desired_speed),
                time_gap: cast(one.driver.time_gap),
                standstill_gap: cast(one.driver.standstill_gap),
                acceleration: cast(one.driver.acceleration),
                braking: cast(one.driver.braking),
            },
            habit: cast(one.habit),
        })
        .collect();
    let platoon = Platoon::roll_out(&column, cast(dt), steps, cast(decay))?;
    let results = [platoon.positions(), platoon.speeds(), platoon.free(), platoon.interaction(), platoon.habit()];
    Ok(results.into_iter().flatten().map(|value| value.to_subset_unchecked()).collect())
}

#[test]
fn at_the_equilibrium_gap_the_speed_is_kept() {
    for speed in [0., 10., 25.] {
        let start = column(6, speed);
        let platoon = Platoon::roll_out(&start, 0.2, 300, 0.).unwrap();
        assert_eq!((platoon.vehicles(), platoon.steps()), (6, 300));
        for (i, one) in start.iter().enumerate() {
            let last = i * 300 + 299;
            assert!((platoon.speeds()[last] - speed).abs() < 1e-9);
            assert!((platoon.positions()[last] - one.position - 60. * speed).abs() < 1e-6);
        }
    }
}

#[test]
fn nobody_drives_through_a_leader_that_stops() {
    for (dt, steps) in [(0.04, 1500), (0.1, 600), (0.2, 300)] {
        for own in [0., 5., 10., 20., 30., 40.] {
            for ahead in [0., 5., 10., 20., 30., 40.] {
                for stop in [2., 4., 6., 8., 9.] {
                    for spare in [0., 0.5, 5., 30.] {
                        // Room to stop with 6 m/s² behind the place where the leader stands, and the gap at standstill.
                        let room = (own * own / 12. - ahead * ahead / (2. * stop)).max(0.);
                        let gap: f64 = 2. + own * 0.5 + room + spare;
                        let leader = Follower { habit: -stop, ..car(0., ahead, None) };
                        let start = [leader, car(-gap - LENGTH, own, Some(0))];
                        // A decay this long is a braking that goes on.
                        let platoon = Platoon::roll_out(&start, dt, steps, 1e9).unwrap();
                        let (leading, following) = platoon.positions().split_at(steps);
                        for (leading, following) in leading.iter().zip(following) {
                            let gap = leading - following - LENGTH;
                            assert!(gap > 0., "{gap} m: own {own}, leader {ahead} braking with {stop}, spare {spare}");
                        }
                        assert!(platoon.speeds()[2 * steps - 1] < 0.2, "all stand in the end");
                        let stood = ahead * ahead / (2. * stop);
                        assert!((leading[steps - 1] - stood).abs() < 1e-4 * stood.max(1.), "to the exact place");
                    }
                }
            }
        }
    }
}

#[test]
fn nobody_drives_backwards_and_parts_add_up_to_what_was_integrated() {
    let (dt, steps) = (0.2, 150);
    let mut start = column(8, 25.);
    start[0].habit = -9.5;
    start[3].habit = 1.5;
    start[5].position += 20.;
    let platoon = Platoon::roll_out(&start, dt, steps, 4.).unwrap();
    let (mut limited, mut stopped) = (0, 0);
    for (vehicle, one) in start.iter().enumerate() {
        let mut before = [one.position, one.speed];
        for at in vehicle * steps..(vehicle + 1) * steps {
            let [x, v] = [platoon.positions()[at], platoon.speeds()[at]];
            let parts = platoon.free()[at] + platoon.interaction()[at] + platoon.habit()[at];
            assert!(v >= 0. && x >= before[0]);
            assert!((before[1] + parts * dt - v).abs() < 1e-9);
            assert!(parts.abs() <= HARDEST_BRAKING + 1e-9);
            let way = if v > 0. { (before[1] + v) * 0.5 * dt } else { before[1] * dt * 0.5 };
            assert!(if v > 0. { (x - before[0] - way).abs() < 1e-9 } else { x - before[0] <= way + 1e-9 });
            limited += usize::from((parts + HARDEST_BRAKING).abs() < 1e-9);
            stopped += usize::from(v == 0. && before[1] > 0.);
            before = [x, v];
        }
    }
    assert!(limited > 0 && stopped > 1, "the limit acted and vehicles stopped: {limited}, {stopped}");
}

#[test]
fn a_braking_wave_travels_upstream() {
    let (dt, steps) = (0.1, 900);
    let mut start = column(8, 12.);
    start[0].habit = -2.;
    let platoon = Platoon::roll_out(&start, dt, steps, 4.).unwrap();
    let slowest: Vec<(usize, f64)> = (0..8)
        .map(|vehicle| {
            let speeds = &platoon.speeds()[vehicle * steps..(vehicle + 1) * steps];
            let braking: Vec<f64> = speeds.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let when = (0..braking.len()).min_by(|a, b| braking[*a].total_cmp(&braking[*b])).unwrap();
            (when, platoon.positions()[vehicle * steps + when])
        })
        .collect();
    for pair in slowest.windows(2) {
        assert!(pair[1].0 > pair[0].0, "later, vehicle by vehicle: {slowest:?}");
    }
    // The foremost brakes at once, while it is still where it set out.
    for pair in slowest[1..].windows(2) {
        assert!(pair[1].1 < pair[0].1, "and against the traffic: {slowest:?}");
    }
}

#[test]
fn a_roll_out_composes_the_terms_of_the_force() {
    let (dt, steps, decay) = (0.1, 80, 3.);
    let mut start = column(5, 20.);
    start[0].habit = -6.;
    start[2] = Follower { length: 16.5, habit: 0.7, position: start[2].position + 5., ..start[2] };
    start[4].leader = Some(2);
    start[4].driver.time_gap = 1.4;
    let platoon = Platoon::roll_out(&start, dt, steps, decay).unwrap();
    let mut states: Vec<State<f64>> = start.iter().map(|one| State::new(one.position, 0., one.speed, 0.)).collect();
    for step in 0..steps {
        let before = states.clone();
        for (i, one) in start.iter().enumerate() {
            let Driver { desired_speed, time_gap, standstill_gap, acceleration, braking } = one.driver;
            let mut sum = one.habit * (-(step as f64 + 0.5) * dt / decay).exp();
            if let Some(leader) = one.leader {
                let body = 0.5 * (one.length + start[leader].length);
                let nowhere = Source::Goal { goal: Point2::origin(), time_left: 1. };
                let ahead = Source::Vehicle { slot: 0, state: before[leader] };
                let free = FreeRoad.force(&before[i], &nowhere, &[desired_speed, acceleration]).x;
                let parameters = [acceleration, braking, time_gap, standstill_gap, body];
                sum += (free + CarFollowing.force(&before[i], &ahead, &parameters).x).max(-HARDEST_BRAKING);
            }
            let (v, a) = (before[i].velocity.x, sum.clamp(-HARDEST_BRAKING, HARDEST_BRAKING));
            let faster = v + a * dt;
            let (way, speed) = if faster > 0. { (0.5 * (v + faster) * dt, faster) } else { (-0.5 * v * v / a, 0.) };
            states[i] = State::new(before[i].position.x + way, 0., speed, 0.);
            let at = i * steps + step;
            assert!((platoon.positions()[at] - states[i].position.x).abs() < 1e-9, "vehicle {i}, step {step}");
            assert!((platoon.speeds()[at] - speed).abs() < 1e-9, "vehicle {i}, step {step}");
        }
    }
}

#[test]
fn without_a_leader_a_vehicle_keeps_its_speed_and_its_acceleration_dies_away() {
    let (dt, steps) = (0.01, 1000);
    let alone = Follower { habit: 1.2, ..car(5., 20., None) };
    let kept = Platoon::roll_out(&[alone], dt, steps, 0.).unwrap();
    assert!(kept.speeds().iter().all(|speed| *speed == 20.) && kept.habit().iter().all(|habit| *habit == 0.));
    assert!((kept.positions()[steps - 1] - 205.).abs() < 1e-9);
    let faded = Platoon::roll_out(&[alone], dt, steps, 2.).unwrap();
    // v = 20 + 1.2 * 2 (1 - exp(-t / 2)), but for the second order in the step.
    let wanted = 20. + 2.4 * (1. - (-5_f64).exp());
    assert!((faded.speeds()[steps - 1] - wanted).abs() < 1e-5);
    assert!((faded.habit()[100] - 1.2 * (-0.5025_f64).exp()).abs() < 1e-9);
    assert!(faded.free().iter().chain(faded.interaction()).all(|part| *part == 0.));
    // Behind a leader that is out of reach, the road is free and the same habit is added.
    let far = car(1e9, 20., None);
    let followed = Platoon::roll_out(&[far, Follower { leader: Some(0), ..alone }], dt, 1, 2.).unwrap();
    let wanted = 20. + dt * (1.2 * (-0.0025_f64).exp() + free_acceleration(20., &Driver::motorway()));
    assert!((followed.speeds()[1] - wanted).abs() < 1e-9);
}

#[test]
fn a_habit_makes_up_for_what_the_rule_misses_of_a_measured_acceleration() {
    let measured = -1.3;
    // Also where the rule alone would brake as hard as it can.
    for gap in [4., 15., 60.] {
        let (leader, mut follower) = (car(0., 14., None), car(-gap - LENGTH, 20., Some(0)));
        follower.habit = measured - following_acceleration(gap + LENGTH, LENGTH, 20., 14., &follower.driver);
        let platoon = Platoon::roll_out(&[leader, follower], 0.1, 1, 1e9).unwrap();
        assert!((platoon.speeds()[1] - 20. - measured * 0.1).abs() < 1e-6, "{gap} m");
        let parts = platoon.habit()[1] + platoon.free()[1] + platoon.interaction()[1];
        assert!((parts - measured).abs() < 1e-6 && platoon.free()[1] > 0.);
    }
    // No habit pulls harder than the brakes.
    let pulled = Platoon::roll_out(&[Follower { habit: 50., ..car(0., 20., None) }], 0.1, 1, 1e9).unwrap();
    assert!((pulled.speeds()[0] - 20.9).abs() < 1e-9 && (pulled.habit()[0] - 9.).abs() < 1e-9);
}

#[test]
fn single_and_double_precision_agree_and_the_order_of_the_list_does_not_matter() {
    let (dt, steps, decay) = (0.1, 100, 3.);
    let mut start = column(6, 22.);
    start[0].habit = -5.;
    start[4].habit = 0.6;
    let double = rolled::<f64>(&start, dt, steps, decay).unwrap();
    let single = rolled::<f32>(&start, dt, steps, decay).unwrap();
    for (one, other) in double.iter().zip(&single) {
        assert!((one - other).abs() < 1e-4 * one.abs().max(10.), "{one}, {other}");
    }
    assert_eq!(double, rolled::<f64>(&start, dt, steps, decay).unwrap(), "the same bits again");
    let backwards: Vec<Follower<f64>> =
        start.iter().rev().map(|one| Follower { leader: one.leader.map(|leader| 5 - leader), ..*one }).collect();
    let turned = Platoon::roll_out(&backwards, dt, steps, decay).unwrap();
    let straight = Platoon::roll_out(&start, dt, steps, decay).unwrap();
    for vehicle in 0..6 {
        let rows = [vehicle, 5 - vehicle].map(|row| row * steps..(row + 1) * steps);
        assert_eq!(straight.positions()[rows[0].clone()], turned.positions()[rows[1].clone()]);
    }
}

#[test]
fn memory_is_reused_and_leaves_no_trace() {
    let mut platoon = Platoon::roll_out(&column(9, 15.), 0.1, 70, 0.).unwrap();
    let room = platoon.positions().as_ptr();
    let start = column(4, 30.);
    platoon.roll_out_into(&start, 0.2, 50, 1.).unwrap();
    assert_eq!(platoon.positions().as_ptr(), room);
    let fresh = Platoon::roll_out(&start, 0.2, 50, 1.).unwrap();
    assert_eq!((platoon.positions(), platoon.free()), (fresh.positions(), fresh.free()));
    assert!(platoon.roll_out_into(&start, -1., 50, 1.).is_err());
    assert_eq!(platoon.positions(), fresh.positions(), "what was refused changed nothing");
    platoon.roll_out_into(&[], 0.2, 50, 1.).unwrap();
    assert!(platoon.positions().is_empty() && platoon.vehicles() == 0);
}

#[test]
fn what_makes_no_platoon_is_refused() {
    let good = column(3, 20.);
    let with = |i: usize, change: fn(&mut Follower<f64>)| {
        let mut start = good.clone();
        change(&mut start[i]);
        Platoon::roll_out(&start, 0.1, 10, 1.).unwrap_err()
    };
    assert_eq!(with(1, |one| one.leader = Some(3)), ForceError::Leader { vehicle: 1, leader: 3, vehicles: 3 });
    assert_eq!(with(1, |one| one.leader = Some(1)), ForceError::Leader { vehicle: 1, leader: 1, vehicles: 3 });
    assert!(matches!(with(0, |one| one.leader = Some(2)), ForceError::Circle { .. }));
    for (error, key) in [
        (with(0, |one| one.position = f64::NAN), "follower.position"),
        (with(0, |one| one.speed = -1.), "follower.speed"),
        (with(0, |one| one.length = -1.), "follower.length"),
        (with(0, |one| one.habit = f64::INFINITY), "follower.habit"),
        (with(2, |one| one.driver.braking = 0.), "driver.braking"),
        (Platoon::roll_out(&good, 0., 10, 1.).unwrap_err(), "dt"),
        (Platoon::roll_out(&good, f64::NAN, 10, 1.).unwrap_err(), "dt"),
        (Platoon::roll_out(&good, 0.1, usize::MAX, 1.).unwrap_err(), "steps"),
        (Platoon::roll_out(&good, 0.1, 10, -1.).unwrap_err(), "decay"),
    ] {
        let error = error.to_string();
        assert!(error.starts_with(&format!("`{key}` is ")), "{error}");
    }
    // Two vehicles behind one leader, and two columns, are no circle.
    let start = [car(0., 9., None), car(-20., 9., Some(0)), car(-30., 9., Some(0)), car(9., 9., None)];
    assert!(Platoon::roll_out(&start, 0.1, 10, 0.).is_ok());
}

#[test]
fn absurd_vehicles_stay_finite() {
    let odd = [0., 1., -1e9, 1e9, f64::from(f32::MAX), f64::from(f32::MIN)];
    let ends = Driver { desired_speed: 0.1, time_gap: 1000., standstill_gap: 0., acceleration: 1000., braking: 0.001 };
    for position in odd {
        for speed in [0., 1e-30, 1000.] {
            for habit in [-1000., 0., 1000.] {
                for driver in [ends, Driver::motorway()] {
                    let leader = Follower { position: 0., habit: -habit, ..car(0., 1000. - speed, None) };
                    let start = [leader, Follower { position, habit, driver, ..car(0., speed, Some(0)) }];
                    for (dt, decay) in [(10., 1e30), (1e-6, 1e-30)] {
                        assert!(rolled::<f32>(&start, dt, 60, decay).unwrap().iter().all(|value| value.is_finite()));
                    }
                }
            }
        }
    }
}

/// Without the free road a vehicle is braked by its leader as the interaction says, and stops for him.
#[test]
fn who_coasts_only_brakes() {
    let start = [car(60., 0., None), car(0., 12., Some(0)), car(-40., 12., Some(1))];
    let mut coasting = Platoon::default();
    coasting.roll_out_coasting_into(&start, Some(1), 0.1, 300, 0.).unwrap();
    let driving = Platoon::roll_out(&start, 0.1, 300, 0.).unwrap();
    let of = |values: &[f64], vehicle: usize| values[vehicle * 300..(vehicle + 1) * 300].to_vec();
    assert!(of(coasting.free(), 1).iter().all(|free| *free == 0.) && of(driving.free(), 1)[0] > 0.);
    assert!(of(coasting.free(), 2)[0] > 0., "the others drive on");
    assert_eq!(coasting.interaction()[300], driving.interaction()[300]);
    let (x, v) = (of(coasting.positions(), 1), of(coasting.speeds(), 1));
    assert!(v.is_sorted_by(|a, b| a >= b) && v[299] < 0.1 && x.is_sorted(), "{} {}", v[0], v[299]);
    assert!(x[299] < of(driving.positions(), 1)[299], "{} {}", x[299], of(driving.positions(), 1)[299]);
    let mut nobody = Platoon::default();
    nobody.roll_out_coasting_into(&start, Some(3), 0.1, 300, 0.).unwrap();
    assert_eq!(nobody, driving);
}
