//! The intelligent driver model: known answers, gradients, and finiteness at every limit.
use gnp_force::na::Vector2;
use gnp_force::{
    CarFollowing, Driver, ForceTerm, FreeRoad, HARDEST_BRAKING, LEAST_GAP, Source, State, free_acceleration,
    free_acceleration_vjp, interaction, interaction_vjp, na::Point2, standstill_potential,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STEP: f64 = 1e-5;

/// The driver with the numbers of `all`, in the order of the fields.
fn driver(all: [f64; 5]) -> Driver<f64> {
    let [desired_speed, time_gap, standstill_gap, acceleration, braking] = all;
    Driver { desired_speed, time_gap, standstill_gap, acceleration, braking }
}

fn numbers<T: Copy>(driver: &Driver<T>) -> [T; 5] {
    [driver.desired_speed, driver.time_gap, driver.standstill_gap, driver.acceleration, driver.braking]
}

fn slope<const N: usize>(value: impl Fn([f64; N]) -> f64, inputs: [f64; N], i: usize) -> f64 {
    let (mut up, mut down) = (inputs, inputs);
    up[i] += STEP;
    down[i] -= STEP;
    (value(up) - value(down)) / (2. * STEP)
}

#[test]
fn the_laws_are_those_of_the_paper() {
    let rule = driver([30., 1.5, 2., 1.2, 1.7]);
    assert!((free_acceleration(20., &rule) - 1.2 * (1. - (20_f64 / 30.).powi(4))).abs() < 1e-12);
    assert_eq!(free_acceleration(-3., &rule), 1.2, "a vehicle that rolls back accelerates as one that stands");
    // Closing in with 5 m/s from 60 m: s* = 2 + 25 * 1.5 + 25 * 5 / (2 sqrt(1.2 * 1.7)).
    let wanted = 2. + 37.5 + 125. / (2. * (1.2_f64 * 1.7).sqrt());
    let found = interaction(64.6, 4.6, 25., 20., &rule);
    assert!((found + 1.2 * (wanted / 60.).powi(2)).abs() < 1e-12, "{found}");
    // Behind one that draws away fast, only the standstill part is left.
    assert!((interaction(24.6, 4.6, 10., 60., &rule) + 1.2 * 0.01).abs() < 1e-12);
    assert_eq!(interaction(-1., 4.6, 25., 0., &rule), 0., "a vehicle that was passed does not act");
    assert_eq!(interaction(4., 4.6, 0., 0., &rule), interaction(4.6 + LEAST_GAP, 4.6, 0., 0., &rule), "overlap");
}

#[test]
fn the_equilibrium_gap_leaves_no_acceleration() {
    let rule = Driver::<f64>::motorway();
    for speed in [0., 5., 20., 33.] {
        let gap = rule.equilibrium_gap(speed).unwrap();
        let rest = free_acceleration(speed, &rule) + interaction(gap + 4.6, 4.6, speed, speed, &rule);
        assert!(rest.abs() < 1e-12, "{rest} at {speed} m/s");
    }
    assert_eq!(rule.equilibrium_gap(120. / 3.6), None);
    assert_eq!(rule.equilibrium_gap(50.), None);
}

#[test]
fn gradients_are_those_of_the_laws() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let (mut braking, mut held) = (0, 0);
    for _ in 0..500 {
        let mut between = |low: f64, high: f64| rng.random_range(low..high);
        let rule = [between(15., 40.), between(0.5, 2.), between(1., 4.), between(0.5, 2.), between(0.8, 3.)];
        let cotangent = between(-2., 2.);
        let inputs: [f64; 9] = {
            let [a, b, c, d, e] = rule;
            [between(7., 90.), between(4., 6.), between(0.5, 40.), between(-1., 40.), a, b, c, d, e]
        };
        let value = |[x, body, v, leader, a, b, c, d, e]: [f64; 9]| {
            cotangent * interaction(x, body, v, leader, &driver([a, b, c, d, e]))
        };
        let [x, body, v, leader, ..] = inputs;
        let vjp = interaction_vjp(x, body, v, leader, &driver(rule), cotangent);
        let mut gradient = vec![vjp.distance, vjp.body, vjp.speed, vjp.leader_speed];
        gradient.extend(numbers(&vjp.driver));
        for (i, found) in gradient.into_iter().enumerate() {
            let wanted = slope(value, inputs, i);
            assert!((found - wanted).abs() < 1e-5 * wanted.abs().max(1.), "input {i} of {inputs:?}: {found}, {wanted}");
        }
        let (force, limit) = (interaction(x, body, v, leader, &driver(rule)), HARDEST_BRAKING + rule[3]);
        held += usize::from(force == -limit);
        braking += usize::from(force > -limit);

        let value = |[v, a, b, c, d, e]: [f64; 6]| cotangent * free_acceleration(v, &driver([a, b, c, d, e]));
        let vjp = free_acceleration_vjp(v, &driver(rule), cotangent);
        let [a, b, c, d, e] = rule;
        for (i, found) in [vjp.speed].into_iter().chain(numbers(&vjp.driver)).enumerate() {
            let wanted = slope(value, [v, a, b, c, d, e], i);
            assert!((found - wanted).abs() < 1e-6 * wanted.abs().max(1.), "input {i}: {found}, {wanted}");
        }
    }
    assert!(braking > 50 && held > 50, "both sides of the limit were met: {braking}, {held}");
}

#[test]
fn gradients_at_kinks_are_those_of_the_stated_side() {
    let rule = Driver::motorway();
    let zero = [0.; 5];
    // Standing, at the least gap, at the limit, passed.
    let standing = interaction_vjp(20., 4.6, 0., 5., &rule, 1.);
    assert_eq!((standing.speed, standing.leader_speed, standing.driver.time_gap), (0., 0., 0.));
    assert!(standing.distance > 0. && standing.driver.standstill_gap < 0.);
    let soft = Driver { standstill_gap: 0.2, ..rule };
    let touching = interaction_vjp(4.6 + 0.05, 4.6, 0., 0., &soft, 1.);
    assert_eq!((touching.distance, touching.body), (0., 0.));
    assert!(touching.driver.standstill_gap < 0.);
    let held = interaction_vjp(10., 4.6, 30., 0., &rule, 1.);
    assert_eq!(numbers(&held.driver), [0., 0., 0., -1., 0.]);
    assert_eq!((held.distance, held.speed, held.leader_speed), (0., 0., 0.));
    let passed = interaction_vjp(0., 4.6, 30., 0., &rule, 1.);
    assert_eq!((passed.distance, passed.speed, numbers(&passed.driver)), (0., 0., zero));
    let fast = free_acceleration_vjp(100., &rule, 1.);
    assert_eq!((fast.speed, numbers(&fast.driver)), (0., zero));
    assert_eq!(free_acceleration_vjp(0., &rule, 1.).speed, 0.);
    // A number out of its range counts as the end of it, and has no gradient.
    let odd = Driver { time_gap: -1., braking: 0., ..rule };
    let end = Driver { time_gap: 0., braking: 0.001, ..rule };
    assert_eq!(interaction(60., 4.6, 20., 19.9, &odd), interaction(60., 4.6, 20., 19.9, &end));
    let vjp = interaction_vjp(60., 4.6, 20., 19.9, &odd, 1.);
    assert_eq!((vjp.driver.time_gap, vjp.driver.braking), (0., 0.));
    assert!(vjp.driver.acceleration != 0. && interaction_vjp(60., 4.6, 20., 19.9, &end, 1.).driver.time_gap != 0.);
}

#[test]
fn at_standstill_the_force_is_minus_the_gradient_of_the_potential() {
    for rule in [Driver::motorway(), Driver { standstill_gap: 0.2, ..Driver::motorway() }] {
        for i in 0..400 {
            let gap = -1.003 + 0.05 * f64::from(i);
            // Forwards the gap shrinks: minus the gradient in the position is the one in the gap.
            let wanted = slope(|[gap]: [f64; 1]| standstill_potential(gap, &rule), [gap], 0);
            let found = interaction(gap + 4.6, 4.6, 0., 0., &rule);
            assert!((found - wanted).abs() < 1e-5, "gap {gap}: {found}, {wanted}");
        }
    }
}

#[test]
fn the_speeds_only_dissipate() {
    let rule = Driver::motorway();
    for i in 0..20 {
        for j in 0..20 {
            let (v, leader) = (2. * f64::from(i), 2. * f64::from(j));
            assert!(interaction(30., 4.6, v, leader, &rule) <= interaction(30., 4.6, 0., 0., &rule));
        }
    }
}

#[test]
fn limits_of_the_parts_do_not_change_the_limited_sum() {
    let rule = Driver::<f64>::motorway();
    let limit = |sum: f64| sum.max(-HARDEST_BRAKING);
    for i in 0..60 {
        for j in 0..60 {
            let (v, gap): (f64, f64) = (f64::from(i) * 1.5, 0.2 + f64::from(j));
            let free = 1. - (v / rule.desired_speed).powi(4);
            let wish = 2. + (v + v * (v - 10.) / (2. * 1.5_f64.sqrt())).max(0.);
            let found = limit(free_acceleration(v, &rule) + interaction(gap + 4.6, 4.6, v, 10., &rule));
            assert!((found - limit(free - (wish / gap).powi(2))).abs() < 1e-9, "{v} m/s, {gap} m");
        }
    }
}

#[test]
fn terms_are_finite_for_every_finite_input() {
    let odd = [0., -0., 1., -1., 1e-30, -1e-30, 1e-45, 30., 1e20, -1e20, f32::MAX, f32::MIN];
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    for _ in 0..40_000 {
        let mut one = || odd[rng.random_range(0..odd.len())];
        let state = State::new(one(), one(), one(), one());
        let leader = State::new(one(), one(), one(), one());
        let parameters = [one(), one(), one(), one(), one()];
        let ahead = Source::Vehicle { slot: 0, state: leader };
        let goal = Source::Goal { goal: Point2::new(one(), one()), time_left: one() };
        let laws: [(&dyn ForceTerm<f32>, _, _); 2] =
            [(&CarFollowing, ahead, &parameters[..]), (&FreeRoad, goal, &parameters[..2])];
        for (law, source, parameters) in laws {
            let force = law.force(&state, &source, parameters);
            let mut d = vec![f32::NAN; parameters.len()];
            let vjp = law.vjp(&state, &source, parameters, Vector2::new(1., -1.), &mut d);
            d.extend(force.iter());
            for part in [vjp.position, vjp.velocity, vjp.source_position, vjp.source_velocity] {
                d.extend(part.iter());
            }
            assert!(d.iter().all(|value| value.is_finite()), "{state:?} {source:?} {parameters:?}: {d:?}");
        }
    }
}

#[test]
fn only_the_vehicle_ahead_acts_and_only_along_the_road() {
    let (me, leader) = (State::new(0., 0., 20., 1.), State::new(15., 3., 10., -1.));
    let parameters = [1., 1.5, 1., 2., 4.6];
    let of = |slot, state| CarFollowing.force(&me, &Source::Vehicle { slot, state }, &parameters);
    let expected = interaction(15., 4.6, 20., 10., &Driver::motorway());
    assert_eq!(of(0, leader), Vector2::new(expected, 0.));
    let mut d = [f64::NAN; 5];
    let beside = Source::Vehicle { slot: 3, state: leader };
    let vjp = CarFollowing.vjp(&me, &beside, &parameters, Vector2::new(1., 1.), &mut d);
    assert_eq!((of(3, leader), d, vjp.velocity), (Vector2::zeros(), [0.; 5], Vector2::zeros()));
    assert_eq!(of(0, State::new(-5., 0., 0., 0.)), Vector2::zeros(), "passed");
}

#[test]
fn drivers_outside_of_the_model_are_refused_by_name() {
    let good = Driver::<f64>::motorway();
    assert_eq!(good.check(), Ok(()));
    for (bad, key) in [
        (Driver { desired_speed: 0., ..good }, "driver.desired_speed"),
        (Driver { time_gap: -0.1, ..good }, "driver.time_gap"),
        (Driver { standstill_gap: f64::INFINITY, ..good }, "driver.standstill_gap"),
        (Driver { acceleration: f64::NAN, ..good }, "driver.acceleration"),
        (Driver { braking: 0., ..good }, "driver.braking"),
    ] {
        let error = bad.check().unwrap_err().to_string();
        assert!(error.starts_with(&format!("`{key}` is ")), "{error}");
    }
    let text = serde_json::to_string(&good).unwrap();
    assert_eq!(serde_json::from_str::<Driver<f64>>(&text).unwrap(), good);
}
