//! Gradients of the rules against finite differences, input by input, in random places.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its rule has failed")]
use gnp_force::{
    DifferentiableRule, Ego, EgoGradient, Extent, Idm, Limits, MotorwayRule, Newell, Other, PairRule, Place, Published,
    PushGradient, Rule, State, na::Vector2,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STEP: f64 = 2e-5;

/// The two vehicles of a push, from ten numbers: position, velocity, wish and tau of the one, position and velocity of the
/// other.
fn pair(x: &[f64], lengths: [Extent<f64>; 2], place: Place) -> (Ego<f64>, Other<f64>) {
    let me = Ego {
        state: State::new(x[0], x[1], x[2], x[3]),
        extent: lengths[0],
        wish: x[4],
        tau: x[5],
        limits: Limits::car(),
    };
    (me, Other { state: State::new(x[6], x[7], x[8], x[9]), extent: lengths[1], place })
}

fn of_ego(gradient: &EgoGradient<f64>) -> [f64; 6] {
    let (p, v) = (gradient.state.position, gradient.state.velocity);
    [p.x, p.y, v.x, v.y, gradient.wish, gradient.tau]
}

fn of_pair(gradient: &PushGradient<f64>) -> [f64; 10] {
    let [a, b, c, d, e, f] = of_ego(&gradient.me);
    let (p, v) = (gradient.other.position, gradient.other.velocity);
    [a, b, c, d, e, f, p.x, p.y, v.x, v.y]
}

/// Compares `gradient` with differences of `value`; returns how many entries lie at a kink and prove nothing.
fn kinks(value: impl Fn(&[f64]) -> f64, at: &[f64], gradient: &[f64], what: &str) -> usize {
    assert_eq!(at.len(), gradient.len());
    let mut kinks = 0;
    for i in 0..at.len() {
        let moved = |by: f64| {
            let mut x = at.to_vec();
            x[i] += by * STEP;
            value(&x)
        };
        let here = value(at);
        let (near, far) = ((moved(1.0) - moved(-1.0)) / 2.0, (moved(2.0) - moved(-2.0)) / 4.0);
        let expected = (4.0 * near - far) / (3.0 * STEP);
        let bent = [moved(1.0), moved(-1.0)].map(|v| (v - here).abs());
        if (near - far).abs() > 1e-6 * STEP || (bent[0] == 0.0) != (bent[1] == 0.0) {
            kinks += 1;
            continue;
        }
        let error = (gradient[i] - expected).abs();
        assert!(error < 1e-7 * expected.abs().max(1.0), "{what} at {at:?}, input {i}: {} {expected}", gradient[i]);
    }
    kinks
}

/// Rules of every kind with parameters drawn around the standard ones.
fn rules(rng: &mut ChaCha8Rng) -> [Rule<f64>; 4] {
    let idm = Idm { time_gap: 1.2, standstill_gap: 2.0, acceleration: 1.5, braking: 2.0 };
    let standard: [Rule<f64>; 4] =
        [Published::standard().into(), MotorwayRule::standard().into(), idm.into(), Newell::standard().into()];
    standard.map(|rule| {
        let drawn: Vec<f64> = rule.parameters().iter().map(|value| value * rng.random_range(0.6..1.6)).collect();
        rule.with_parameters(&drawn).unwrap()
    })
}

#[test]
fn of_every_rule_with_respect_to_both_vehicles_and_every_parameter() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut checked, mut skipped, mut acts) = (0, 0, [0; 4]);
    for case in 0..1500 {
        let sizes = [Extent::car(), if case % 3 == 0 { Extent::truck() } else { Extent::car() }];
        let near = if case % 2 == 0 { 60.0 } else { 12.0 };
        let other_x = rng.random_range(-0.3 * near..near);
        let lane = [0, 1, -1][case % 3];
        let other_y = f64::from(lane) * 3.0 + rng.random_range(-1.2..1.2);
        let place = Place { ahead: other_x > 0.0, lane, rank: 0, merging: case % 7 == 0 };
        let v = rng.random_range(0.5..35.0);
        let other_v = v + rng.random_range(-8.0..5.0);
        let mut draw = |low: f64, high: f64| rng.random_range(low..high);
        let inputs = vec![0.0, 0.1, v, draw(-1.0, 1.0), v + draw(-5.0, 6.0), draw(0.6, 2.0)]
            .into_iter()
            .chain([other_x, other_y, other_v, draw(-1.0, 1.0)])
            .collect::<Vec<_>>();
        let cotangent = Vector2::new(draw(-1.0, 1.0), draw(-1.0, 1.0));
        for (kind, rule) in rules(&mut rng).into_iter().enumerate() {
            let parameters = rule.parameters();
            let at = [inputs.clone(), parameters.clone()].concat();
            let name = format!("{rule:?}");

            let (me, other) = pair(&inputs, sizes, place);
            let mut d = vec![0.0; parameters.len()];
            let vjp = rule.push_vjp(&me, &other, cotangent, &mut d);
            let push = |x: &[f64]| {
                let (me, other) = pair(x, sizes, place);
                rule.with_parameters(&x[10..]).unwrap().push(&me, &other).dot(&cotangent)
            };
            let gradient = [of_pair(&vjp).to_vec(), d].concat();
            acts[kind] += usize::from(push(&at) != 0.0);
            skipped += kinks(push, &at, &gradient, &name);

            let mut d = vec![0.0; parameters.len()];
            let vjp = rule.free_vjp(&me, cotangent.x, &mut d);
            let free = |x: &[f64]| {
                let (me, _) = pair(x, sizes, place);
                rule.with_parameters(&x[10..]).unwrap().free(&me) * cotangent.x
            };
            let gradient = [of_ego(&vjp).to_vec(), vec![0.0; 4], d].concat();
            skipped += kinks(free, &at, &gradient, &name);
            checked += 2 * at.len();
        }
    }
    assert!(skipped * 500 < checked, "{skipped} of {checked} entries lie at a kink");
    assert!(acts.iter().all(|acts| *acts > 400), "every rule pushes in enough places: {acts:?}");
}

#[test]
fn are_added_to_what_is_there() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let pairs = [26.0, 40.0, 70.0].map(|x| {
        let x = [0.0, 0.0, 22.0, 0.3, 26.0, 1.0, x, 0.4, 19.0, 0.0];
        pair(&x, [Extent::car(); 2], Place::LEADER)
    });
    for rule in rules(&mut rng) {
        let count = rule.names().len();
        let mut acts = false;
        for (me, other) in pairs {
            let (mut once, mut twice) = (vec![0.0; count], vec![1.0; count]);
            let cotangent = Vector2::new(0.7, 0.2);
            let first = rule.push_vjp(&me, &other, cotangent, &mut once);
            assert_eq!(first, rule.push_vjp(&me, &other, cotangent, &mut twice));
            for (once, twice) in once.iter().zip(&twice) {
                assert!((twice - once - 1.0).abs() < 1e-12);
            }
            acts |= once.iter().any(|value| *value != 0.0);
        }
        assert!(acts, "{rule:?}");
    }
}

#[test]
fn are_zero_where_a_limit_holds_and_finite_where_vehicles_coincide() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    // 30 m/s, bumper to bumper with one that stands: nobody brakes harder than he can.
    let x = [0.0, 0.0, 30.0, 0.0, 30.0, 1.0, 5.0, 0.0, 0.0, 0.0];
    let (me, other) = pair(&x, [Extent::car(); 2], Place::LEADER);
    let mut d = [0.0; 8];
    let held = MotorwayRule::standard().push_vjp(&me, &other, Vector2::new(1.0, 0.0), &mut d);
    assert_eq!((held, d), (PushGradient::between(Vector2::zeros()), [0.0; 8]));
    for place in [Place::LEADER, Place { ahead: false, lane: 1, rank: 0, merging: false }] {
        let (me, other) = pair(&[0.0; 10], [Extent::car(); 2], place);
        let me = Ego { tau: 1.0, ..me };
        for rule in rules(&mut rng) {
            let mut d = vec![0.0; rule.names().len()];
            let vjp = rule.push_vjp(&me, &other, Vector2::new(1.0, 1.0), &mut d);
            assert!(of_pair(&vjp).iter().chain(&d).all(|value| value.is_finite()), "{rule:?}: {vjp:?}");
        }
    }
}

#[test]
fn parameters_that_the_rule_refuses_are_an_error() {
    let rule: Rule<f64> = MotorwayRule::standard().into();
    let mut parameters = rule.parameters();
    assert_eq!(rule.with_parameters(&parameters), Ok(rule));
    parameters[2] = -1.0;
    let refused = rule.with_parameters(&parameters).unwrap_err();
    assert!(refused.to_string().contains("motorway.acceleration"), "{refused}");
    assert!(rule.with_parameters(&[1.0]).is_err() && rule.with_parameters(&[1.0; 9]).is_err());
}
