//! What a textbook driver would do behind the leader, as a hint to the goal network.

use gnp_baselines::{Idm, Leader};
use gnp_data::Slot;

use crate::seen::Seen;

/// Numbers in the hint: one a second, 1 to 5 s ahead.
pub(crate) const SECONDS: usize = 5;

/// Time of a step, s. The hint is smooth: finer steps change it by centimetres.
const STEP: f64 = 0.2;

/// How far ahead of constant velocity the Intelligent Driver Model would be after 1 to 5 s, m, with
/// the leader going straight on; speeds are fitted over `window_s` seconds of the past. Zeros where
/// nobody is ahead: that the road is empty there is not known.
///
/// Following a leader is most of what happens on a full motorway. Given as five numbers it is
/// learned from few windows, where from the bare tracks of both it takes many.
pub(crate) fn hint(seen: &Seen<'_>, window_s: f64) -> [f32; SECONDS] {
    let Some(ahead) = seen.neighbour(Slot::Preceding as usize) else { return [0.; SECONDS] };
    let idm = Idm::default();
    let own = f64::from(seen.velocity(window_s)[0]);
    let now = ahead.now(window_s);
    let bodies = (ahead.size()[0] + seen.observation().size()[0]) / 2.;
    let mut leader = Leader { speed: f64::from(now.vx).max(0.), gap: f64::from(now.x - bodies) };
    let (mut speed, mut travelled) = (own.max(0.), 0.);
    let steps = (1. / STEP).round() as usize;
    std::array::from_fn(|second| {
        for _ in 0..steps {
            let next = (speed + idm.acceleration(speed, Some(leader)) * STEP).max(0.);
            let moved = (speed + next) / 2. * STEP;
            leader.gap += leader.speed * STEP - moved;
            travelled += moved;
            speed = next;
        }
        (travelled - own * (second + 1) as f64) as f32
    })
}
