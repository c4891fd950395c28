//! Gradients of scenes against finite differences.
#![allow(dead_code, reason = "every test takes what it needs")]
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    DifferentiableRule, Drive, Road, SceneGradient, Simulator, SimulatorParams, Vehicle, VehicleGradient, VehicleId,
};

pub(crate) type Vehicles = Vec<Vehicle<f64>>;

/// A scene with these vehicles, numbered in their order, wherever they are.
pub(crate) fn scene(params: SimulatorParams<f64>, road: &Road<f64>, vehicles: &[Vehicle<f64>]) -> Simulator<f64> {
    let mut scene = Simulator::new(params, road.clone()).unwrap();
    for vehicle in vehicles {
        scene.place(vehicle.clone()).unwrap();
    }
    scene
}

/// Everything that a gradient is about: state, wish, tau, parameters of the rule.
pub(crate) fn numbers(vehicle: &VehicleGradient<f64>) -> Vec<f64> {
    let (p, v) = (vehicle.state.position, vehicle.state.velocity);
    [vec![p.x, p.y, v.x, v.y, vehicle.wish.x, vehicle.wish.y, vehicle.tau], vehicle.rule.clone()].concat()
}

/// The vehicle with one of those numbers moved; none where there is nothing to move.
pub(crate) fn moved(vehicle: &Vehicle<f64>, number: usize, by: f64) -> Option<Vehicle<f64>> {
    let mut vehicle = vehicle.clone();
    match number {
        0 | 1 => vehicle.state.position[number] += by,
        2 | 3 => vehicle.state.velocity[number - 2] += by,
        4 | 5 => match &mut vehicle.drive {
            Drive::Goal { goal, .. } => goal[number - 4] += by,
            Drive::Cruise { speed, y } => *[speed, y][number - 4] += by,
            Drive::Accelerate(along) if number == 4 => *along += by,
            _ => return None,
        },
        6 => vehicle.tau += by,
        _ => {
            let mut parameters = vehicle.rule.parameters();
            *parameters.get_mut(number - 7)? += by;
            vehicle.rule = vehicle.rule.with_parameters(&parameters).unwrap();
        }
    }
    Some(vehicle)
}

/// How many numbers were compared, and how many of them were not zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Compared {
    pub(crate) numbers: usize,
    pub(crate) nonzero: usize,
}

/// Compares the gradient of `loss` in everything of every vehicle, numbered in their order, with differences.
pub(crate) fn compare(
    vehicles: &Vehicles,
    gradient: &SceneGradient<f64>,
    loss: impl Fn(&[Vehicle<f64>]) -> f64,
    (step, tolerance): (f64, f64),
) -> Compared {
    let mut compared = Compared::default();
    for (index, vehicle) in vehicles.iter().enumerate() {
        let found = numbers(gradient.get(VehicleId(index as u64)).unwrap());
        assert_eq!(found.len(), 7 + vehicle.rule.names().len());
        for (number, found) in found.iter().enumerate() {
            let at = |by: f64| {
                let mut vehicles = vehicles.clone();
                vehicles[index] = moved(vehicle, number, by)?;
                Some(loss(&vehicles))
            };
            let difference = at(step).zip(at(-step)).zip(at(2.0 * step).zip(at(-2.0 * step)));
            let Some(((up, down), (up2, down2))) = difference else {
                assert_eq!(*found, 0.0, "vehicle {index} has no number {number}");
                continue;
            };
            let expected = (8.0 * (up - down) - (up2 - down2)) / (12.0 * step);
            let error = (found - expected).abs();
            assert!(
                error < tolerance * expected.abs().max(1.0),
                "vehicle {index}, number {number}: {found} {expected}, {vehicle:?}"
            );
            compared.numbers += 1;
            compared.nonzero += usize::from(expected.abs() > 1e-9);
        }
    }
    compared
}
