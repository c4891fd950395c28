//! Large scenes drive the same way, to the bit, on any number of threads.
#![cfg(feature = "parallel")]
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    Drive, Driver, Idm, Mobil, MotorwayRule, Noise, Road, Rule, Simulator, SimulatorParams, State, Vehicle,
    na::{RealField, convert},
};

/// 3,000 vehicles on three lanes of a ring, unsteady, some in the way of others: their states after ten seconds.
fn states<T: RealField + Copy>(threads: usize) -> Vec<State<T>> {
    let lit = convert::<f64, T>;
    let road = Road::motorway(3, lit(3.75)).unwrap().ring(lit(30_000.0)).unwrap();
    let mut scene = Simulator::new(SimulatorParams { seed: 9, ..SimulatorParams::motorway(lit(0.1)) }, road).unwrap();
    let idm = Idm::of(&Driver::motorway());
    for i in 0..3000 {
        let (lane, x) = (i % 3, 30.0 * (i / 3) as f64);
        let y = scene.road().lane_centre(lane).unwrap();
        let speed = lit(22.0 + 3.0 * lane as f64 + (i % 11) as f64);
        let rule: Rule<T> = if i % 2 == 0 { idm.into() } else { MotorwayRule::standard().into() };
        let car = Vehicle::car(State::new(lit(x), y, lit(25.0), T::zero()), Drive::Cruise { speed, y }).with_rule(rule);
        let noise = Some(Noise { sigma: lit(0.3), correlation: lit(3.0) });
        scene.add(Vehicle { noise, lane_change: Some(Mobil::standard()), ..car }).unwrap();
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        for _ in 0..100 {
            scene.step();
        }
    });
    scene.vehicles().map(|(_, vehicle)| vehicle.state).collect()
}

fn on_any_number_of_threads<T: RealField + Copy>() {
    let one = states::<T>(1);
    for threads in [2, 4] {
        assert!(states::<T>(threads) == one, "{threads} threads");
    }
    assert!(one.iter().any(|state| state.velocity.y != T::zero()), "somebody changes lanes");
}

#[test]
fn the_same_bits_in_double_precision() {
    on_any_number_of_threads::<f64>();
}

#[test]
fn the_same_bits_in_single_precision() {
    on_any_number_of_threads::<f32>();
}
