//! What a scene file says: road, drivers, demand, time.
use crate::error::SimulationError;
use gnp_data::limits::{MAX_LINES, MAX_POSITION};
use gnp_force::{Headways, Mobil, MotorwayRule, Noise, PairRule, Rule};
use serde::{Deserialize, Serialize};

/// Longest simulated time, s: a day.
const MOST_SECONDS: f64 = 86_400.0;
/// Where vehicles enter, no lane may be closed for so many metres.
const ENTRY_M: f64 = 100.0;
/// Most vehicles that start, and most lanes: those of a recording.
const MOST: [usize; 2] = [100_000, MAX_LINES - 1];
/// Longest road, m: what is simulated is a recording, whose vehicles may go a little beyond the end.
const MOST_M: f64 = MAX_POSITION as f64 - 1_000.0;
/// Most seeds, detectors, closures, kinds of drivers and the like.
const MOST_ENTRIES: usize = 1000;
/// Length of a standing vehicle with its gap, m.
const JAM_M: f64 = 6.0;

/// A scene: everything that a simulation needs. Lanes count from the right, 0 the rightmost.
///
/// ```
/// let scene: gnp_simulation::Scene = gnp_simulation::Scene::parse(
///     r#"
///     name = "ring"
///     duration_s = 300
///     [road]
///     lanes = 1
///     length_m = 230
///     ring = true
///     [start]
///     vehicles = 22
///     speed_mps = 6
///     [[drivers]]
///     name = "car"
///     rule = { idm = { time_gap = 1.0, standstill_gap = 2.0, acceleration = 0.5, braking = 1.5 } }
///     desired_speed_mps = { mean = 15 }
///     "#,
/// )?;
/// assert_eq!(scene.seeds, [0]);
/// # Ok::<(), gnp_simulation::SimulationError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// What it is called: lower-case letters, digits, `-` and `_`.
    pub name: String,
    /// Recorded time, s.
    pub duration_s: f64,
    /// Simulated time before that, s.
    #[serde(default)]
    pub warm_up_s: f64,
    /// Length of a step, s.
    #[serde(default = "step_s")]
    pub step_s: f64,
    /// Recorded frames a second; a whole number of steps apart.
    #[serde(default = "record_hz")]
    pub record_hz: f64,
    /// From which all chance comes; one simulation each.
    #[serde(default = "seeds")]
    pub seeds: Vec<u64>,
    /// Where detectors are, m.
    #[serde(default)]
    pub detectors_m: Vec<f64>,
    /// Time over which detectors count, s.
    #[serde(default = "interval_s")]
    pub detector_interval_s: f64,
    /// The road.
    pub road: RoadSpec,
    /// Kinds of drivers.
    pub drivers: Vec<DriverSpec>,
    /// Who enters at the beginning of the road.
    #[serde(default)]
    pub inflow: Option<InflowSpec>,
    /// Who is there at the start.
    #[serde(default)]
    pub start: Option<StartSpec>,
    /// Where and when nobody wants to drive faster than so.
    #[serde(default)]
    pub speed_limits: Vec<SpeedLimit>,
}

fn step_s() -> f64 {
    0.1
}

fn record_hz() -> f64 {
    10.0
}

fn seeds() -> Vec<u64> {
    vec![0]
}

fn interval_s() -> f64 {
    60.0
}

/// A straight carriageway, or a ring.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoadSpec {
    /// Number of lanes.
    pub lanes: usize,
    /// Width of a lane, m.
    #[serde(default = "lane_width_m")]
    pub lane_width_m: f64,
    /// Length, or circumference of the ring, m; vehicles leave at the end.
    pub length_m: f64,
    /// Whether the end leads to the beginning.
    #[serde(default)]
    pub ring: bool,
    /// Where lanes end or are closed.
    #[serde(default)]
    pub closures: Vec<ClosureSpec>,
}

fn lane_width_m() -> f64 {
    3.75
}

/// A stretch on which a lane is closed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClosureSpec {
    /// The lane, 0 the rightmost.
    pub lane: usize,
    /// Beginning, m.
    pub from_m: f64,
    /// End, m.
    pub to_m: f64,
}

/// A kind of driver and vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriverSpec {
    /// What it is called.
    pub name: String,
    /// How many of those who enter a lane are of this kind, in proportion to the others that enter it.
    #[serde(default = "share")]
    pub share: f64,
    /// Lanes in which it enters; all without.
    #[serde(default)]
    pub lanes: Option<Vec<usize>>,
    /// Site whose fitted drivers are drawn, whole: `us-101`, `i-80`, `highd-simulated`, or a file of such drivers. Sizes,
    /// desired speeds, rules and unsteadiness are theirs; of what stands beside it only `share`, `lanes` and `lane_change`
    /// count.
    #[serde(default)]
    pub fitted: Option<String>,
    /// Length, m.
    #[serde(default = "length_m")]
    pub length_m: f64,
    /// Width, m.
    #[serde(default = "width_m")]
    pub width_m: f64,
    /// How the driver follows; the numbers of the median driver.
    #[serde(default = "rule")]
    pub rule: Rule<f64>,
    /// How much time gap and acceleration of the rule differ from driver to driver: standard deviation of their logarithms.
    #[serde(default)]
    pub spread: f64,
    /// Desired speed, m/s.
    #[serde(default)]
    pub desired_speed_mps: Spread,
    /// How unsteadily the driver drives.
    #[serde(default)]
    pub noise: Option<Noise<f64>>,
    /// How the driver decides to change lanes; without it he keeps his.
    #[serde(default)]
    pub lane_change: Option<Mobil<f64>>,
}

fn share() -> f64 {
    1.0
}

fn length_m() -> f64 {
    4.6
}

fn width_m() -> f64 {
    1.9
}

fn rule() -> Rule<f64> {
    MotorwayRule::standard().into()
}

/// A normal distribution, cut at two standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// Middle.
    pub mean: f64,
    /// Standard deviation.
    #[serde(default)]
    pub sd: f64,
}

impl Default for Spread {
    fn default() -> Self {
        Self { mean: 33.0, sd: 0.0 }
    }
}

/// Who enters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InflowSpec {
    /// Pairs of a time in s, from when on, and vehicles an hour and lane.
    pub flow: Vec<[f64; 2]>,
    /// How the times between vehicles are spread.
    #[serde(default)]
    pub headways: Headways,
}

/// Who is there at the start: vehicles with equal gaps, lane by lane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartSpec {
    /// How many.
    pub vehicles: usize,
    /// Their speed, m/s.
    pub speed_mps: f64,
    /// How far the first stands from its even place, m, at most half a gap: a disturbance.
    #[serde(default)]
    pub first_off_m: f64,
}

/// A limit on a stretch over some time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeedLimit {
    /// Beginning, m.
    pub from_m: f64,
    /// End, m.
    pub to_m: f64,
    /// From when, s of simulated time, warm-up included.
    pub from_s: f64,
    /// Until when, s.
    pub to_s: f64,
    /// The limit, m/s.
    pub speed_mps: f64,
}

impl Scene {
    /// The scene that a text in TOML says.
    ///
    /// # Errors
    /// [`SimulationError::Syntax`] with line and column, or [`SimulationError::Scene`] with the key and what it must be.
    pub fn parse(text: &str) -> Result<Self, SimulationError> {
        let scene: Self = toml::from_str(text)?;
        scene.check()?;
        Ok(scene)
    }

    /// The scenes that come with the crate, by name.
    pub const EMBEDDED: &'static [(&'static str, &'static str)] = &[
        ("motorway", include_str!("../scenes/motorway.toml")),
        ("lane-drop", include_str!("../scenes/lane-drop.toml")),
        ("ring", include_str!("../scenes/ring.toml")),
    ];

    /// Whether all numbers are in their ranges; those of the physics are checked there.
    ///
    /// # Errors
    /// [`SimulationError::Scene`] for the first that is not.
    pub fn check(&self) -> Result<(), SimulationError> {
        let name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_';
        let named = !self.name.is_empty() && self.name.len() <= 24 && self.name.chars().all(name);
        require(named, "name", &self.name, "1 to 24 lower-case letters, digits, `-` and `_`")?;
        let within = |key: &str, value: f64, least: f64, most: f64| {
            let good = value >= least && value <= most;
            require(good, key, value, &format!("from {least} to {most}"))
        };
        within("duration_s", self.duration_s, self.step_s, MOST_SECONDS)?;
        within("warm_up_s", self.warm_up_s, 0.0, MOST_SECONDS)?;
        within("step_s", self.step_s, 0.01, 0.5)?;
        within("record_hz", self.record_hz, 0.01, 100.0)?;
        within("detector_interval_s", self.detector_interval_s, self.step_s, MOST_SECONDS)?;
        let steps = 1.0 / (self.record_hz * self.step_s);
        let whole = steps >= 0.999 && (steps - steps.round()).abs() < 1e-6;
        require(whole, "record_hz", self.record_hz, "1 / (n step_s) for a whole number n of steps")?;
        require(!self.seeds.is_empty(), "seeds", "empty", "one number or more")?;
        let lists = [
            ("seeds", self.seeds.len()),
            ("detectors_m", self.detectors_m.len()),
            ("road.closures", self.road.closures.len()),
            ("drivers", self.drivers.len()),
            ("inflow.flow", self.inflow.as_ref().map_or(0, |inflow| inflow.flow.len())),
            ("speed_limits", self.speed_limits.len()),
        ];
        for (key, entries) in lists {
            let given = format!("of {entries} entries");
            require(entries <= MOST_ENTRIES, key, given, &format!("of at most {MOST_ENTRIES}"))?;
        }
        let road = &self.road;
        within("road.lanes", road.lanes as f64, 1.0, MOST[1] as f64)?;
        within("road.lane_width_m", road.lane_width_m, 2.0, 10.0)?;
        within("road.length_m", road.length_m, 20.0, MOST_M)?;
        let frames = self.duration_s * self.record_hz;
        require(frames >= 2.0, "duration_s", self.duration_s, "two recorded frames or more")?;
        for (number, closure) in road.closures.iter().enumerate() {
            let key = |part: &str| format!("road.closures.{part} (number {number})");
            let lane = closure.lane < road.lanes;
            require(lane, &key("lane"), closure.lane, &format!("below {}, 0 the rightmost", road.lanes))?;
            let entry = if self.inflow.is_some() { ENTRY_M } else { 0.0 };
            within(&key("from_m"), closure.from_m, entry, road.length_m)?;
            // One that goes on to the end of the road may do so by a little more.
            within(&key("to_m"), closure.to_m, closure.from_m, road.length_m + 100.0)?;
        }
        for x in &self.detectors_m {
            within("detectors_m", *x, 0.0, road.length_m)?;
        }
        require(!self.drivers.is_empty(), "drivers", "empty", "one kind of driver or more")?;
        self.drivers.iter().try_for_each(|drivers| self.check_drivers(drivers))?;
        for lane in 0..road.lanes {
            let enters =
                |kind: &DriverSpec| kind.share > 0.0 && kind.lanes.as_ref().is_none_or(|lanes| lanes.contains(&lane));
            let somebody = self.drivers.iter().any(enters);
            let lacks = format!("without a kind that enters lane {lane}");
            require(somebody, "drivers", lacks, "given for every lane")?;
        }
        if self.inflow.is_none() && self.start.is_none() {
            return require(false, "inflow", "absent, as is `start`", "there, or nobody ever drives");
        }
        if let Some(inflow) = &self.inflow {
            require(!road.ring, "inflow", "there", "absent on a ring: say who is there with `start`")?;
            require(
                !inflow.flow.is_empty(),
                "inflow.flow",
                "empty",
                "one pair [time_s, vehicles_an_hour_and_lane] or more",
            )?;
            for [time, flow] in &inflow.flow {
                within("inflow.flow", *time, 0.0, MOST_SECONDS)?;
                within("inflow.flow", *flow, 0.0, 5000.0)?;
            }
            let grows = inflow.flow.windows(2).all(|pair| pair[0][0] < pair[1][0]);
            require(grows, "inflow.flow", "not in the order of time", "pairs with growing times")?;
        }
        if let Some(start) = &self.start {
            let open = road.closures.is_empty();
            require(open, "start", "there", "absent where a lane is closed: let vehicles enter")?;
            within("start.vehicles", start.vehicles as f64, 0.0, MOST[0] as f64)?;
            within("start.speed_mps", start.speed_mps, 0.0, 70.0)?;
            within("start.first_off_m", start.first_off_m, -1000.0, 1000.0)?;
        }
        for limit in &self.speed_limits {
            within("speed_limits.speed_mps", limit.speed_mps, 0.0, 70.0)?;
            require(limit.from_m < limit.to_m, "speed_limits.to_m", limit.to_m, "beyond from_m")?;
            require(limit.from_s < limit.to_s, "speed_limits.to_s", limit.to_s, "later than from_s")?;
        }
        Ok(())
    }

    /// About how many rows a simulation will record: vehicles that are on the road at a time, by recorded frames.
    /// No more vehicles than stand there bumper to bumper.
    #[must_use]
    pub fn expected_rows(&self) -> f64 {
        let road = &self.road;
        let there = self.start.map_or(0., |start| start.vehicles as f64);
        let slowest = self.drivers.iter().map(|kind| kind.desired_speed_mps.mean).fold(f64::INFINITY, f64::min);
        // In dense traffic they drive half as fast as they wish to.
        let through_s = road.length_m / (0.5 * slowest).max(1.);
        let most = self.inflow.iter().flat_map(|inflow| &inflow.flow).map(|[_, flow]| *flow).fold(0., f64::max);
        let entering = road.lanes as f64 * most / 3600. * through_s;
        let room = road.lanes as f64 * road.length_m / JAM_M;
        (there + entering).min(room) * self.duration_s * self.record_hz
    }

    fn check_drivers(&self, drivers: &DriverSpec) -> Result<(), SimulationError> {
        let key = |part: &str| format!("drivers.{} ({})", part, drivers.name);
        let within = |part: &str, value: f64, least: f64, most: f64| {
            let good = value >= least && value <= most;
            require(good, &key(part), value, &format!("from {least} to {most}"))
        };
        within("share", drivers.share, 0.0, 1e6)?;
        within("length_m", drivers.length_m, 0.5, 40.0)?;
        within("width_m", drivers.width_m, 0.3, 5.0)?;
        within("spread", drivers.spread, 0.0, 1.0)?;
        within("desired_speed_mps.mean", drivers.desired_speed_mps.mean, 0.1, 70.0)?;
        within("desired_speed_mps.sd", drivers.desired_speed_mps.sd, 0.0, 30.0)?;
        PairRule::<f64>::check(&drivers.rule)?;
        drivers.noise.as_ref().map_or(Ok(()), Noise::check)?;
        drivers.lane_change.as_ref().map_or(Ok(()), Mobil::check)?;
        for lane in drivers.lanes.iter().flatten() {
            within("lanes", *lane as f64, 0.0, (self.road.lanes - 1) as f64)?;
        }
        Ok(())
    }
}

/// Refuses what a scene says under `key` unless `good`.
fn require(good: bool, key: &str, value: impl ToString, must: &str) -> Result<(), SimulationError> {
    if good {
        return Ok(());
    }
    Err(SimulationError::Scene { key: key.to_owned(), value: value.to_string(), must: must.to_owned() })
}
