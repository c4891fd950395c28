//! Which drivers explain what a vehicle did before the start.
use super::{Actor, DrivenBy, Scene};
use gnp_force::{Ego, Extent, Limits, Other, PairRule, Place, State};

/// How far a driver's own last seconds may be from what a rule makes of them: in m/s at their end, and in m.
const SPREAD: [f64; 2] = [0.7, 1.0];
/// Less of a past tells nothing, in s.
const LEAST_S: f64 = 1.0;
/// A leader farther away is none, in m.
const FARTHEST_M: f64 = 150.0;

/// A weight for each driver: how well he, rolled out behind the recorded leader from the first observed moment on, comes to
/// where the vehicle is at the start, and to its speed; all alike where too little is observed.
pub(super) fn weights(scene: &Scene, index: usize, drivers: &[&DrivenBy]) -> Vec<f64> {
    let actor = &scene.actors[index];
    let steps = actor.past.len().saturating_sub(1);
    if actor.enters > 0 || (steps as f64) < LEAST_S * scene.rate_hz {
        return vec![1.0; drivers.len()];
    }
    let leaders: Vec<Option<Other<f64>>> = (0..steps).map(|step| leader(scene, index, steps - step)).collect();
    let found: Vec<f64> = drivers
        .iter()
        .map(|driver| {
            let end = rolled(actor, driver, &leaders, scene.dt());
            let off = [
                (end.velocity.x - actor.start.velocity.x) / SPREAD[0],
                (end.position.x - actor.start.position.x) / SPREAD[1],
            ];
            -0.5 * (off[0] * off[0] + off[1] * off[1])
        })
        .collect();
    // Where nobody explains it, the nearest do.
    let best = found.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    found.into_iter().map(|log| (log - best).exp()).collect()
}

fn extent(actor: &Actor) -> Extent<f64> {
    Extent { length: f64::from(actor.size[0]), width: f64::from(actor.size[1]) }
}

/// Who was ahead in the lane so many frames before the start.
fn leader(scene: &Scene, index: usize, back: usize) -> Option<Other<f64>> {
    let then = |actor: &Actor| {
        let place = actor.past.len().checked_sub(1 + back).filter(|_| actor.enters == 0)?;
        actor.past.get(place).copied()
    };
    let me = then(&scene.actors[index])?;
    let lane = scene.lane_at(me.position.y);
    let ahead = scene.actors.iter().enumerate().filter(|(other, _)| *other != index).filter_map(|(_, other)| {
        let state = then(other)?;
        let way = state.position.x - me.position.x;
        let is_ahead = way > 0.0 && way < FARTHEST_M && scene.lane_at(state.position.y) == lane;
        is_ahead.then(|| Other { state, extent: extent(other), place: Place::LEADER })
    });
    ahead.min_by(|a, b| a.state.position.x.total_cmp(&b.state.position.x))
}

/// The state at the start of a driver who is where the vehicle was first observed.
fn rolled(actor: &Actor, driver: &DrivenBy, leaders: &[Option<Other<f64>>], dt: f64) -> State<f64> {
    let mut state = actor.past.first().copied().unwrap_or(actor.start);
    for leader in leaders {
        let me = Ego { state, extent: extent(actor), wish: driver.desired_speed, tau: 1.0, limits: Limits::car() };
        let acceleration = driver.rule.behind(&me, leader.as_ref());
        let speed = (state.velocity.x + acceleration * dt).max(0.0);
        state = State::new(state.position.x + speed * dt, state.position.y, speed, 0.0);
    }
    state
}
