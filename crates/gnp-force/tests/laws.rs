//! Every force is minus the gradient of its potential, in f64 to 1e-6, and finite where the formula is not.
use gnp_force::{
    Extent, MarkingKind, Side, box_force, box_potential, goal_dissipation, goal_force, goal_potential, line_force,
    line_potential,
    na::{Point2, Vector2},
    vehicle_force, vehicle_potential,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STEP: f64 = 1e-5;
const TOLERANCE: f64 = 1e-6;

/// Minus the central difference of `potential` at `at`.
fn downhill(potential: impl Fn(Vector2<f64>) -> f64, at: Vector2<f64>) -> Vector2<f64> {
    let slope = |step: Vector2<f64>| (potential(at - step) - potential(at + step)) / (2.0 * STEP);
    Vector2::new(slope(Vector2::new(STEP, 0.0)), slope(Vector2::new(0.0, STEP)))
}

fn assert_close(force: Vector2<f64>, expected: Vector2<f64>, case: &str) {
    assert!((force - expected).norm() < TOLERANCE * expected.norm().max(1.0), "{case}: {force:?} is not {expected:?}");
}

fn vector(rng: &mut ChaCha8Rng, size: f64) -> Vector2<f64> {
    Vector2::new(rng.random_range(-size..size), rng.random_range(-size..size))
}

#[test]
fn attraction_is_downhill_in_position_and_dissipative_in_velocity() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for case in 0..200 {
        let (p, goal, v) =
            (Point2::from(vector(&mut rng, 50.0)), Point2::from(vector(&mut rng, 150.0)), vector(&mut rng, 40.0));
        let (time_left, tau) = (rng.random_range(0.5..6.0), rng.random_range(0.2..2.0));
        let potential = downhill(|at| goal_potential(Point2::from(at), goal, time_left, tau), p.coords);
        let friction = downhill(|at| goal_dissipation(at, tau), v);
        assert_close(goal_force(p, v, goal, time_left, tau), potential + friction, &format!("case {case}"));
    }
}

#[test]
fn vehicle_repulsion_is_downhill() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for case in 0..400 {
        let r = vector(&mut rng, if case % 2 == 0 { 2.0 } else { 60.0 });
        let (k, r_col) = (rng.random_range(0.1..20.0), rng.random_range(3.0..40.0));
        assert_close(vehicle_force(r, k, r_col), downhill(|at| vehicle_potential(at, k, r_col), r), &format!("{r:?}"));
    }
}

#[test]
fn vehicle_repulsion_is_downhill_inside_the_softening() {
    // Within a tenth of a millimetre the force turns so quickly that the difference needs a smaller step.
    let (k, r_col, step): (f64, f64, f64) = (5.0, 26.0, 1e-7);
    for x in [0.0, 2e-5, -7e-5, 3e-4] {
        let slope = vehicle_potential(Vector2::new(x - step, 0.0), k, r_col)
            - vehicle_potential(Vector2::new(x + step, 0.0), k, r_col);
        let force = vehicle_force(Vector2::new(x, 0.0), k, r_col);
        assert!((force.x - slope / (2.0 * step)).abs() < 1e-5, "x = {x}: {} is not {}", force.x, slope / (2.0 * step));
        assert_eq!(force.y, 0.0);
    }
}

#[test]
fn vehicle_repulsion_has_the_published_value() {
    let force = vehicle_force(Vector2::new(3.0, -4.0), 7.0, 26.0);
    let size = 7.0 * (-5.0_f64 / 26.0).exp();
    assert_close(force, Vector2::new(0.6 * size, -0.8 * size), "3-4-5 triangle");
    let back = vehicle_force(Vector2::new(-3.0, 4.0), 7.0, 26.0);
    assert_eq!(back, -force, "the law is symmetric");
}

#[test]
fn box_repulsion_is_downhill_beside_ahead_at_corners_and_inside() {
    let (car, truck, k, r_col) = (Extent::car(), Extent::truck(), 4.0, 8.0);
    // Half sums: 10.55 m and 2.2 m.
    for (x, y) in
        [(-30.0, 0.4), (14.0, -2.0), (3.0, 3.7), (-5.0, -2.9), (12.0, 4.0), (-11.5, -2.7), (10.0, 0.3), (2.0, -1.8)]
    {
        let r = Vector2::new(x, y);
        let expected = downhill(|at| box_potential(at, car, truck, k, r_col), r);
        assert_close(box_force(r, car, truck, k, r_col), expected, &format!("{x}, {y}"));
        assert!(expected.norm() > 0.1, "the case must push");
    }
}

#[test]
fn boxes_without_size_push_as_points_do() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..100 {
        let r = vector(&mut rng, 30.0);
        let point = vehicle_force(r, 3.0, 26.0);
        assert!((box_force(r, Extent::point(), Extent::point(), 3.0, 26.0) - point).norm() < 1e-6);
    }
}

#[test]
fn lines_push_downhill() {
    for (kind, road) in [
        (MarkingKind::LaneDivider, Side::Left),
        (MarkingKind::Boundary, Side::Left),
        (MarkingKind::Boundary, Side::Right),
    ] {
        for i in -600..600 {
            let d = f64::from(i) * 0.01 + 0.003;
            let k = 0.7;
            let expected =
                (line_potential(kind, d - STEP, k, road) - line_potential(kind, d + STEP, k, road)) / (2.0 * STEP);
            let force = line_force(kind, d, k, road);
            assert!((force - expected).abs() < TOLERANCE, "{kind:?} {road:?} at {d} m: {force} is not {expected}");
        }
    }
}

#[test]
fn line_potentials_have_no_step() {
    for (kind, at) in [(MarkingKind::LaneDivider, 4.0), (MarkingKind::LaneDivider, -4.0), (MarkingKind::Boundary, 0.5)]
    {
        let jump: f64 =
            line_potential(kind, at + 1e-9, 1.0, Side::Left) - line_potential(kind, at - 1e-9, 1.0, Side::Left);
        assert!(jump.abs() < 1e-6, "{kind:?} at {at}: {jump}");
    }
}

#[test]
fn a_boundary_always_points_to_the_road() {
    for i in -2000..2000 {
        let d = f64::from(i) * 0.01;
        assert!(line_force(MarkingKind::Boundary, d, 0.3, Side::Left) > 0.0, "at {d} m");
        assert!(line_force(MarkingKind::Boundary, d, 0.3, Side::Right) < 0.0, "at {d} m");
        assert!(line_force(MarkingKind::Boundary, d, 0.3, Side::Left) <= 8.0 * 0.3, "at {d} m");
    }
    assert!((line_force(MarkingKind::Boundary, 2.0_f64, 0.4, Side::Left) - 0.05).abs() < 1e-12, "k / d³");
}

#[test]
fn a_centre_line_pushes_to_both_sides_and_not_beyond_its_cut_off() {
    let push = |d: f64| line_force(MarkingKind::LaneDivider, d, 0.5, Side::Left);
    assert!((push(1.0) - (-1.0_f64).exp()).abs() < 1e-12, "2 k d exp(-d²)");
    assert_eq!(push(-1.0), -push(1.0));
    assert_eq!((push(0.0), push(4.0), push(-5.0)), (0.0, 0.0, 0.0));
    assert!(push(3.999) > 0.0 && push(3.999) < 1e-6);
}

#[test]
fn singular_places_are_finite_in_both_precisions() {
    fn all<T: gnp_force::na::RealField + Copy>() {
        let zero = Vector2::<T>::zeros();
        let (one, none) = (T::one(), T::zero());
        assert_eq!(vehicle_force(zero, one, one), zero);
        assert_eq!(box_force(zero, Extent::car(), Extent::car(), one, one), zero);
        assert_eq!(goal_force(Point2::origin(), zero, Point2::origin(), none, none), zero);
        let late = goal_force(Point2::origin(), zero, Point2::new(one, none), none, none);
        assert!(late.x > none && late.x.is_finite(), "no time left");
        for kind in [MarkingKind::LaneDivider, MarkingKind::Boundary] {
            assert!(line_force(kind, none, one, Side::Left).is_finite());
            assert!(line_potential(kind, none, one, Side::Right).is_finite());
        }
    }
    all::<f32>();
    all::<f64>();
}
