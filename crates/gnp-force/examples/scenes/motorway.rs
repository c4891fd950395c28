//! Three lanes of 3 km with mixed traffic, which the example `hour` and a test drive.
use gnp_force::{
    Drive, Event, ForceError, Headways, Inflow, Mobil, Noise, Road, Rule, Simulator, SimulatorParams, State, Vehicle,
};

/// What happened.
#[derive(Debug, Default)]
pub(crate) struct Found {
    pub(crate) entered: u64,
    pub(crate) left: usize,
    pub(crate) lane_changes: usize,
    /// Time in s, number of the vehicle, what it touched.
    pub(crate) contacts: Vec<(f64, u64, String)>,
    /// Hardest braking, in m/s².
    pub(crate) hardest: f64,
    /// Mean speed of those who left, in m/s.
    pub(crate) speed: f64,
}

/// A driver of the `number`th vehicle that enters a lane: every fourth in the right lane is a lorry, and every tenth in the
/// middle one; cars wish 100 to 145 km/h.
fn driver(rule: Rule<f64>, lane: usize, y: f64, number: u64) -> Vehicle<f64> {
    // Spread without a random number: the golden ratio visits an interval evenly.
    let share = (number as f64 * 0.618_033_988_75).fract();
    let lorry = (lane == 0 && number.is_multiple_of(4)) || (lane == 1 && number.is_multiple_of(10));
    let speed = if lorry { 22.5 + 1.5 * share } else { 28.0 + 12.0 * share };
    let (state, drive) = (State::new(0.0, y, speed, 0.0), Drive::Cruise { speed, y });
    let vehicle = if lorry { Vehicle::truck(state, drive) } else { Vehicle::car(state, drive) };
    let noise = Some(Noise { sigma: 0.2, correlation: 5.0 });
    Vehicle { noise, lane_change: Some(Mobil::standard()), ..vehicle }.with_rule(rule)
}

/// Drives `duration` s at `flow` vehicles an hour and lane, in steps of 0.1 s.
pub(crate) fn drive(rule: Rule<f64>, flow: f64, duration: f64, seed: u64) -> Result<Found, ForceError> {
    let road = Road::motorway(3, 3.75)?.ending_at(3000.0)?;
    let mut scene = Simulator::new(SimulatorParams { seed, ..SimulatorParams::motorway(0.1) }, road)?;
    let mut inflows = Vec::new();
    for lane in 0..3_u64 {
        inflows.push(Inflow::new(flow, Headways::Random, 100 * seed + lane)?);
    }
    let mut found = Found::default();
    let mut before = Vec::new();
    while scene.time() < duration {
        for (lane, inflow) in inflows.iter_mut().enumerate() {
            let Some(y) = scene.road().lane_centre(lane) else { continue };
            scene.admit(inflow, |number| driver(rule, lane, y, number))?;
        }
        before.clear();
        before.extend(scene.vehicles().map(|(id, vehicle)| (id, vehicle.state.velocity.x)));
        for event in scene.step().to_vec() {
            match event {
                Event::Left { vehicle, .. } => {
                    found.left += 1;
                    found.speed += vehicle.state.velocity.x;
                }
                Event::LaneChange { .. } => found.lane_changes += 1,
                Event::Contact { id, with } => found.contacts.push((scene.time(), id.0, format!("{with:?}"))),
                Event::Arrived { .. } => {}
            }
        }
        for (id, speed) in &before {
            let now = scene.vehicle(*id).map_or(*speed, |vehicle| vehicle.state.velocity.x);
            found.hardest = found.hardest.max((speed - now) / 0.1);
        }
    }
    found.speed /= found.left.max(1) as f64;
    found.entered = inflows.iter().map(Inflow::entered).sum();
    Ok(found)
}
