//! Every vector-Jacobian product against central differences, input by input.
use gnp_force::{
    Attraction, Extent, ForceField, Line, MarkingKind, Neighbour, Side, State, box_force, box_force_vjp, goal_force,
    goal_force_vjp, line_force, line_force_vjp,
    na::{Point2, Vector2},
    vehicle_force, vehicle_force_vjp,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STEP: f64 = 1e-5;

/// Checks `gradient` of `value` at `inputs` against central differences.
fn check<const N: usize>(value: impl Fn([f64; N]) -> f64, inputs: [f64; N], gradient: [f64; N]) {
    for i in 0..N {
        let (mut up, mut down) = (inputs, inputs);
        up[i] += STEP;
        down[i] -= STEP;
        let expected = (value(up) - value(down)) / (2.0 * STEP);
        let error = (gradient[i] - expected).abs();
        assert!(error < 1e-6 * expected.abs().max(1.0), "input {i} of {inputs:?}: {} is not {expected}", gradient[i]);
    }
}

fn draw<const N: usize>(rng: &mut ChaCha8Rng, ranges: [(f64, f64); N]) -> [f64; N] {
    ranges.map(|(low, high)| rng.random_range(low..high))
}

#[test]
fn of_the_attraction() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..100 {
        let far = (-40.0, 40.0);
        let inputs = draw(&mut rng, [far, far, far, far, far, far, (0.5, 6.0), (0.3, 2.0)]);
        let cotangent = Vector2::from(draw(&mut rng, [(-1.0, 1.0), (-1.0, 1.0)]));
        let [px, py, vx, vy, gx, gy, time_left, tau] = inputs;
        let vjp =
            goal_force_vjp(Point2::new(px, py), Vector2::new(vx, vy), Point2::new(gx, gy), time_left, tau, cotangent);
        let gradient = [
            vjp.position.x,
            vjp.position.y,
            vjp.velocity.x,
            vjp.velocity.y,
            vjp.goal.x,
            vjp.goal.y,
            vjp.time_left,
            vjp.tau,
        ];
        let value = |[px, py, vx, vy, gx, gy, time_left, tau]: [f64; 8]| {
            goal_force(Point2::new(px, py), Vector2::new(vx, vy), Point2::new(gx, gy), time_left, tau).dot(&cotangent)
        };
        check(value, inputs, gradient);
    }
}

#[test]
fn of_the_attraction_with_no_time_left() {
    let (p, v, goal) = (Point2::new(1.0, 2.0), Vector2::new(3.0, 4.0), Point2::new(5.0, 7.0));
    let vjp = goal_force_vjp(p, v, goal, 0.0, 0.0, Vector2::new(1.0, -1.0));
    assert_eq!((vjp.time_left, vjp.tau), (0.0, 0.0), "both times are held");
    assert!(vjp.position.iter().chain(vjp.velocity.iter()).all(|value: &f64| value.is_finite()));
}

#[test]
fn of_the_vehicle_repulsion() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for case in 0..200 {
        let size = if case % 2 == 0 { 3.0 } else { 40.0 };
        let inputs = draw(&mut rng, [(-size, size), (-size, size), (0.1, 20.0), (3.0, 40.0)]);
        let cotangent = Vector2::from(draw(&mut rng, [(-1.0, 1.0), (-1.0, 1.0)]));
        let [x, y, k, r_col] = inputs;
        let vjp = vehicle_force_vjp(Vector2::new(x, y), k, r_col, cotangent);
        let value = |[x, y, k, r_col]: [f64; 4]| vehicle_force(Vector2::new(x, y), k, r_col).dot(&cotangent);
        check(value, inputs, [vjp.r.x, vjp.r.y, vjp.k, vjp.r_col]);
    }
}

#[test]
fn of_the_vehicle_repulsion_where_two_vehicles_coincide() {
    let vjp = vehicle_force_vjp(Vector2::zeros(), 2.0_f32, 26.0, Vector2::new(1.0, 0.5));
    assert!(vjp.r.iter().all(|value| value.is_finite()));
    assert_eq!((vjp.k, vjp.r_col), (0.0, 0.0));
}

#[test]
fn of_the_box_repulsion() {
    let cotangent = Vector2::new(0.7, -0.4);
    let (car, truck) = (Extent::car(), Extent::truck());
    for (x, y) in [(-30.0, 0.4), (3.0, 3.7), (12.0, 4.0), (-11.5, -2.7), (10.0, 0.3), (2.0, -1.8)] {
        let vjp = box_force_vjp(Vector2::new(x, y), car, truck, 4.0, 8.0, cotangent);
        let value = |[x, y, k, r_col]: [f64; 4]| box_force(Vector2::new(x, y), car, truck, k, r_col).dot(&cotangent);
        check(value, [x, y, 4.0, 8.0], [vjp.r.x, vjp.r.y, vjp.k, vjp.r_col]);
    }
}

#[test]
fn of_the_lines() {
    for (kind, road) in [
        (MarkingKind::LaneDivider, Side::Left),
        (MarkingKind::Boundary, Side::Left),
        (MarkingKind::Boundary, Side::Right),
    ] {
        for i in -60..60 {
            let d = f64::from(i) * 0.1 + 0.03;
            let vjp = line_force_vjp(kind, d, 0.7, road, -1.3);
            check(|[d, k]| -1.3 * line_force(kind, d, k, road), [d, 0.7], [vjp.d, vjp.k]);
        }
    }
}

#[test]
fn of_the_whole_field() {
    let cotangent = Vector2::new(0.3, -1.1);
    let value = |[px, py, vx, vy, gx, nx, ny, k, line]: [f64; 9]| {
        let field = ForceField {
            goal: Some(Attraction { goal: Point2::new(gx, 3.0), time_left: 4.0, tau: 0.8 }),
            neighbours: &[
                Neighbour { position: Point2::new(nx, ny), k, r_col: 26.0 },
                Neighbour { position: Point2::new(-9.0, 3.5), k: 1.7, r_col: 12.0 },
            ],
            lines: &[
                Line { kind: MarkingKind::LaneDivider, y: line, road: Side::Left, k: 0.4 },
                Line { kind: MarkingKind::Boundary, y: -2.0, road: Side::Left, k: 0.6 },
            ],
        };
        let state = State::new(px, py, vx, vy);
        (field.total(&state).dot(&cotangent), field.total_vjp(&state, cotangent))
    };
    let inputs = [0.5, 0.2, 28.0, -0.4, 120.0, 15.0, 0.9, 6.0, 1.8];
    let (_, vjp) = value(inputs);
    let goal = vjp.goal.expect("there is a goal");
    let gradient = [
        vjp.position.x,
        vjp.position.y,
        vjp.velocity.x,
        vjp.velocity.y,
        goal.goal.x,
        -vjp.neighbours[0].r.x,
        -vjp.neighbours[0].r.y,
        vjp.neighbours[0].k,
        -vjp.lines[0].d,
    ];
    check(|inputs| value(inputs).0, inputs, gradient);
}
