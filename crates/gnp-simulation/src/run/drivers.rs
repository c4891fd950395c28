//! Who drives: vehicles drawn from the kinds of a scene.
use crate::{
    drivers::DriverDistribution,
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
    /// By kind, for those that are drawn from fitted drivers.
    fitted: Vec<Option<DriverDistribution>>,
    lanes: u64,
    seed: u64,
}

impl<'a> Cast<'a> {
    pub(super) fn of(scene: &'a Scene, seed: u64) -> Result<Self, SimulationError> {
        let fitted = scene.drivers.iter().map(|kind| kind.fitted.as_deref().map(distribution).transpose());
        Ok(Self {
            kinds: &scene.drivers,
            fitted: fitted.collect::<Result<_, _>>()?,
            lanes: scene.road.lanes as u64,
            seed,
        })
    }

    /// The vehicle of that number in a lane; the same ones always give the same.
    pub(super) fn vehicle(&self, lane: usize, number: u64, state: State<f64>) -> Vehicle<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(lane as u64);
        // Every vehicle has a stretch of the stream of its own.
        rng.set_word_pos(u128::from(number) * 64);
        let at = self.kind(lane, rng.random());
        let kind = &self.kinds[at];
        if let Some(fitted) = &self.fitted[at] {
            // No lane of one seed is a lane of another.
            let seed = self.seed.wrapping_mul(self.lanes).wrapping_add(lane as u64);
            let vehicle = fitted.vehicle(seed, number, state);
            return Vehicle { lane_change: kind.lane_change.or(vehicle.lane_change), ..vehicle };
        }
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
    fn kind(&self, lane: usize, share: f64) -> usize {
        let enters = |kind: &DriverSpec| kind.lanes.as_ref().is_none_or(|lanes| lanes.contains(&lane));
        let those = || self.kinds.iter().enumerate().filter(|(_, kind)| enters(kind));
        let mut left = share * those().map(|(_, kind)| kind.share).sum::<f64>();
        for (at, kind) in those() {
            left -= kind.share;
            if left < 0.0 {
                return at;
            }
        }
        those().next_back().map_or(0, |(at, _)| at)
    }
}

/// The fitted drivers of a site, or those in a file.
fn distribution(of: &str) -> Result<DriverDistribution, SimulationError> {
    let embedded = DriverDistribution::embedded(of);
    if embedded.is_err() && std::path::Path::new(of).is_file() {
        let text = std::fs::read_to_string(of).map_err(|source| SimulationError::Read { path: of.into(), source })?;
        return Ok(DriverDistribution::from_toml(&text)?);
    }
    Ok(embedded?)
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
