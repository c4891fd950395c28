//! What following the traffic ahead makes of the next seconds, as a hint to the goal network.

use gnp_baselines::{Idm, Leader, Traffic};
use gnp_data::Slot;

use crate::situation::Situation;

/// Numbers in the hint: one a second, 1 to 5 s ahead.
pub(crate) const SECONDS: usize = 5;

/// Steps of a second. The hint is smooth: finer steps change it by centimetres.
const STEPS: usize = 5;

/// How far ahead of constant velocity the platoon's path is, with all of its terms, after 1 to 5 s, m; without one, how far the Intelligent
/// Driver Model with textbook parameters would be behind one leader at constant velocity. Speeds of the latter are fitted
/// over `window_s` seconds of the past, and there are zeros where no vehicle is ahead: whether the road is empty there is
/// not known.
///
/// Following a leader is most of what happens on a full motorway. Given as five numbers it is
/// learned from few windows, where from the bare tracks of both it takes many.
pub(crate) fn hint(situation: &Situation<'_>, window_s: f64) -> [f32; SECONDS] {
    let seen = &situation.seen;
    if let Some(following) = &situation.platoon {
        let shape = seen.observation().shape();
        return std::array::from_fn(|second| {
            let step = (((second + 1) as f64 * shape.rate_hz).round() as usize).min(shape.t_pred);
            following.whole().position(Traffic::TARGET, step) as f32
                - situation.velocity[0] * (step as f64 * shape.dt()) as f32
        });
    }
    let Some(ahead) = seen.neighbour(Slot::Preceding) else { return [0.; SECONDS] };
    let now = ahead.now(window_s);
    let bodies = (ahead.size()[0] + seen.observation().size()[0]) / 2.;
    let leader = Leader { speed: f64::from(now.vx).max(0.), gap: f64::from(now.x - bodies) };
    behind(f64::from(situation.velocity[0]), leader).map(|ahead| ahead as f32)
}

/// How far a driver of speed `own` (m/s) gets ahead of that speed in 1 to 5 s, m, behind a leader
/// at constant velocity.
fn behind(own: f64, mut leader: Leader) -> [f64; SECONDS] {
    let idm = Idm::default();
    let dt = 1. / STEPS as f64;
    let (mut speed, mut travelled) = (own.max(0.), 0.);
    std::array::from_fn(|second| {
        for _ in 0..STEPS {
            let next = (speed + idm.acceleration(speed, Some(leader)) * dt).max(0.);
            let moved = (speed + next) / 2. * dt;
            leader.gap += leader.speed * dt - moved;
            travelled += moved;
            speed = next;
        }
        travelled - own * (second + 1) as f64
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_the_gap_of_equilibrium_nobody_gains() {
        let speed = 15f64;
        // The gap at which the model neither brakes nor accelerates behind an equal speed.
        let gap = (2. + speed) / (1. - (speed / (120. / 3.6)).powi(4)).sqrt();
        for ahead in behind(speed, Leader { speed, gap }) {
            assert!(ahead.abs() < 1e-9, "{ahead}");
        }
    }

    #[test]
    fn a_driver_falls_back_behind_a_slow_leader_and_gains_on_a_far_one() {
        let slow = behind(20., Leader { speed: 10., gap: 25. });
        assert!(slow.is_sorted_by(|a, b| a > b) && slow[4] < -20., "{slow:?}");
        // Nobody drives through the leader.
        assert!(20. * 5. + slow[4] < 25. + 10. * 5.);
        let far = behind(20., Leader { speed: 25., gap: 200. });
        assert!(far.is_sorted() && far[0] > 0. && far[4] < 12.5, "at most 1 m/s²: {far:?}");
    }

    #[test]
    fn behind_a_wall_a_driver_stops() {
        let wall = behind(10., Leader { speed: 0., gap: 30. });
        let travelled = 50. + wall[4];
        assert!((15. ..30.).contains(&travelled), "{travelled}");
    }
}
