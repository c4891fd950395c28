//! The order of each integrator, and what the attraction promises about arriving.
use gnp_force::{
    Attraction, ForceField, Integrator, Neighbour, State, Workspace, goal_force,
    na::{Point2, Vector2},
    semi_implicit_euler,
};

/// A vehicle that passes a neighbour on its way to a goal due after the end of the run.
fn acceleration(state: &State<f64>, time: f64) -> Vector2<f64> {
    ForceField {
        goal: Some(Attraction { goal: Point2::new(100.0, 2.0), time_left: 6.0 - time, tau: 0.9 }),
        neighbours: &[Neighbour { position: Point2::new(30.0 + 8.0 * time, -1.0), k: 6.0, r_col: 11.0 }],
        lines: &[],
    }
    .total(state)
}

/// Where 4 s in `steps` steps lead.
fn run(integrator: Integrator, steps: u32) -> State<f64> {
    let dt = 4.0 / f64::from(steps);
    let start = State::new(0.0, 0.0, 21.0, 0.5);
    (0..steps).fold(start, |state, step| {
        let time = dt * f64::from(step);
        integrator.step(&state, dt, |state, elapsed| acceleration(state, time + elapsed))
    })
}

fn order(integrator: Integrator, steps: u32) -> f64 {
    let truth = run(Integrator::RungeKutta4, 6400);
    let error = |steps| {
        let end = run(integrator, steps);
        ((end.position - truth.position).norm_squared() + (end.velocity - truth.velocity).norm_squared()).sqrt()
    };
    (error(steps) / error(2 * steps)).log2()
}

#[test]
fn errors_shrink_with_the_order_of_the_integrator() {
    for (integrator, steps, expected) in [
        (Integrator::ExplicitEuler, 800, 1.0),
        (Integrator::SemiImplicitEuler, 800, 1.0),
        (Integrator::RungeKutta4, 50, 4.0),
    ] {
        let order = order(integrator, steps);
        assert!((order - expected).abs() < 0.15, "{integrator:?}: order {order}");
    }
}

#[test]
fn relaxation_follows_its_exact_solution() {
    // dv/dt = (v0 - v) / tau from rest: v = v0 (1 - exp(-t / tau)).
    let (v0, tau, dt) = (25.0, 0.7, 0.01);
    let end = (0..300).fold(State::new(0.0, 0.0, 0.0, 0.0), |state, _| {
        Integrator::RungeKutta4.step(&state, dt, |state, _| {
            let goal = state.position + Vector2::new(v0, 0.0);
            goal_force(state.position, state.velocity, goal, 1.0, tau)
        })
    });
    let time = 3.0_f64;
    assert!((end.velocity.x - v0 * (1.0 - (-time / tau).exp())).abs() < 1e-6);
    assert!((end.position.x - v0 * (time - tau * (1.0 - (-time / tau).exp()))).abs() < 1e-6);
}

#[test]
fn all_vehicles_together_step_as_one_by_one() {
    for integrator in [Integrator::ExplicitEuler, Integrator::SemiImplicitEuler, Integrator::RungeKutta4] {
        let mut together = [State::new(0.0, 0.0, 21.0, 0.5), State::new(3.0, -4.0, 19.0, 0.0)];
        let mut apart = together;
        let mut workspace = Workspace::new();
        for _ in 0..7 {
            integrator.step_all(&mut together, 0.05, &mut workspace, |states, time, out| {
                states.iter().zip(out).for_each(|(state, a)| *a = acceleration(state, time));
            });
            apart = apart.map(|state| integrator.step(&state, 0.05, acceleration));
        }
        assert_eq!(together, apart, "{integrator:?}");
    }
}

#[test]
fn the_last_step_with_tau_of_one_step_ends_on_the_goal() {
    let (dt, steps) = (0.1, 50);
    let goal = Point2::new(131.0, -3.4);
    let mut state = State::new(0.0, 0.0, 30.0, 1.0);
    for step in 0..steps {
        let time_left = dt * f64::from(steps - step);
        let tau = if step + 1 == steps { dt } else { 0.8 };
        let pull = goal_force(state.position, state.velocity, goal, time_left, tau);
        state = semi_implicit_euler(&state, pull, dt);
    }
    assert!((state.position - goal).norm() < 1e-12, "{:?}", state.position);
}

#[test]
fn single_precision_follows_double() {
    let mut single = State::new(0.0_f32, 0.0, 28.0, 0.0);
    let mut double = State::new(0.0_f64, 0.0, 28.0, 0.0);
    for step in 0..125 {
        let left = f64::from(125 - step) * 0.04;
        let pull = goal_force(double.position, double.velocity, Point2::new(150.0, 3.0), left, 0.5);
        double = semi_implicit_euler(&double, pull, 0.04);
        let pull = goal_force(single.position, single.velocity, Point2::new(150.0, 3.0), left as f32, 0.5);
        single = semi_implicit_euler(&single, pull, 0.04);
    }
    assert!((single.position.cast::<f64>() - double.position).norm() < 1e-3);
}
