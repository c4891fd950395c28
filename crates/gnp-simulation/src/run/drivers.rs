//! Who drives: vehicles drawn from the kinds of a scene.
use crate::{
    error::SimulationError,
    scene::{DriverSpec, Scene},
};
use gnp_force::{Drive, Extent, Idm, Limits, MotorwayRule, Newell, Rule, State, Vehicle};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Longer vehicles have the limits of a lorry, m.
const LORRY_M: f64 = 7.5;
/// Least desired speed that a draw gives, m/s.
const SLOWEST: f64 = 0.5;

/// The kinds of drivers of a scene, and the seed from which they are drawn.
pub(super) struct Cast<'a> {
    kinds: &'a [DriverSpec],
    seed: u64,
}

impl<'a> Cast<'a> {
    pub(super) fn of(scene: &'a Scene, seed: u64) -> Result<Self, SimulationError> {
        Ok(Self { kinds: &scene.drivers, seed })
    }

    /// The vehicle of that number in a lane; the same ones always give the same.
    pub(super) fn vehicle(&self, lane: usize, number: u64, state: State<f64>) -> Vehicle<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(lane as u64);
        // Every vehicle has a stretch of the stream of its own.
        rng.set_word_pos(u128::from(number) * 64);
        let kind = self.kind(lane, rng.random());
        let speed = (kind.desired_speed_mps.mean + kind.desired_speed_mps.sd * normal(&mut rng)).clamp(SLOWEST, 70.0);
        let factors = [normal(&mut rng), normal(&mut rng)].map(|draw| (kind.spread * draw).exp());
        let drive = Drive::Cruise { speed, y: state.position.y };
        let car = Vehicle::car(state, drive);
        Vehicle {
            extent: Extent { length: kind.length_m, width: kind.width_m },
            limits: if kind.length_m > LORRY_M { Limits::truck() } else { Limits::car() },
            rule: spread(kind.rule, factors),
            noise: kind.noise,
            lane_change: kind.lane_change,
            ..car
        }
    }

    /// The kind at `share` of all that enter a lane.
    fn kind(&self, lane: usize, share: f64) -> &'a DriverSpec {
        let enters = |kind: &&DriverSpec| kind.lanes.as_ref().is_none_or(|lanes| lanes.contains(&lane));
        let total: f64 = self.kinds.iter().filter(enters).map(|kind| kind.share).sum();
        let mut left = share * total;
        for kind in self.kinds.iter().filter(enters) {
            left -= kind.share;
            if left < 0.0 {
                return kind;
            }
        }
        // Where no kind enters a lane, all do.
        self.kinds.iter().rfind(enters).unwrap_or(&self.kinds[0])
    }
}

/// A rule with another time gap and acceleration.
fn spread(rule: Rule<f64>, [time, acceleration]: [f64; 2]) -> Rule<f64> {
    match rule {
        Rule::Idm(idm) => {
            Idm { time_gap: idm.time_gap * time, acceleration: idm.acceleration * acceleration, ..idm }.into()
        }
        Rule::Motorway(rule) => {
            MotorwayRule { headway: rule.headway * time, acceleration: rule.acceleration * acceleration, ..rule }.into()
        }
        Rule::Newell(rule) => Newell { wave_time: rule.wave_time * time, ..rule }.into(),
        Rule::Published(_) => rule,
    }
}

/// A standard normal number, cut at two (Box and Muller).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (first, second): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
    ((-2.0 * first.ln()).sqrt() * (std::f64::consts::TAU * second).cos()).clamp(-2.0, 2.0)
}
