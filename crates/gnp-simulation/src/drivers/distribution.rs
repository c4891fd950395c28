//! The drivers of a site, to draw from.
use super::{
    FittedDriver,
    error::{DriverError, require},
    fit::{FitConfig, FittedTraffic, fit_drivers},
    free::FreeSpeed,
    lane_changes::{LaneChangeFit, fit_lane_changes},
    median,
    rate::{Mean, threshold_for},
    table::Table,
};
use crate::chance::mix;
use gnp_data::{Recording, VehicleClass};
use gnp_force::{Drive, Noise, Rule, State, Vehicle};

/// What comes with the crate, by site.
const EMBEDDED: [(&str, &str); 3] = [
    ("us-101", include_str!("../../drivers/us-101.toml")),
    ("i-80", include_str!("../../drivers/i-80.toml")),
    ("highd-simulated", include_str!("../../drivers/highd-simulated.toml")),
];

/// The drivers of a site: whole recorded drivers to draw from, so that their numbers hang together as recorded.
///
/// ```
/// use gnp_force::State;
/// use gnp_simulation::drivers::DriverDistribution;
///
/// let drivers = DriverDistribution::embedded("i-80")?;
/// let vehicle = drivers.vehicle(1, 0, State::new(0., 1.8, 10., 0.));
/// assert_eq!(drivers.draw(1, 0).rule(), drivers.draw(1, 0).rule());
/// assert!(vehicle.extent.length > 2.);
/// let text = drivers.to_toml()?;
/// assert_eq!(DriverDistribution::from_toml(&text)?, drivers);
/// # Ok::<(), gnp_simulation::drivers::DriverError>(())
/// ```
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "Table", into = "Table")]
pub struct DriverDistribution {
    pub(super) site: String,
    pub(super) simulated: bool,
    pub(super) recordings: usize,
    pub(super) drivers: Vec<FittedDriver>,
    pub(super) free: Vec<FreeSpeed>,
    pub(super) noise: Option<Noise<f64>>,
    pub(super) lane_changes: LaneChangeFit,
}

/// A log-normal distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Half are below.
    pub median: f64,
    /// Standard deviation of the natural logarithm; about the standard deviation in parts of the median.
    pub spread: f64,
}

/// The numbers of drivers as log-normal distributions, each by itself. They are narrower than drivers are as far as the
/// prior of the fit drew these together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spreads {
    /// Drivers.
    pub drivers: usize,
    /// m/s.
    pub desired_speed: Spread,
    /// s.
    pub time_gap: Spread,
    /// m.
    pub standstill_gap: Spread,
    /// m/s².
    pub acceleration: Spread,
    /// m/s².
    pub braking: Spread,
}

impl DriverDistribution {
    /// The drivers of recordings of one site, with how they change lanes.
    ///
    /// The threshold for a change of lanes is that at which drivers drawn from here, on a ring with as many lanes and as
    /// dense as recorded on the mean, change lanes as often in a kilometre as they were recorded to; where no threshold
    /// from 0 to 3 m/s² does, the nearer end.
    ///
    /// # Errors
    /// Those of [`fit_drivers`] and [`fit_lane_changes`]; [`DriverError::Force`].
    pub fn fit(site: &str, recordings: &[Recording], config: &FitConfig) -> Result<Self, DriverError> {
        let traffic = fit_drivers(recordings, config)?;
        let lane_changes = fit_lane_changes(recordings, &traffic)?;
        let mut it = Self::new(site, &traffic, lane_changes)?;
        if lane_changes.likelihood.is_some()
            && let Some(mean) = Mean::of(recordings)
        {
            let (threshold, rate) = threshold_for(&it, lane_changes.per_vehicle_km(), &mean)?;
            it.lane_changes.mobil.threshold = threshold;
            it.lane_changes.simulated_per_vehicle_km = Some(rate);
        }
        Ok(it)
    }

    /// The drivers of a fit.
    ///
    /// # Errors
    /// [`DriverError::Value`] when a number is none that a driver or a vehicle can have.
    pub fn new(site: &str, traffic: &FittedTraffic, lane_changes: LaneChangeFit) -> Result<Self, DriverError> {
        let it = Self {
            site: site.to_owned(),
            simulated: traffic.simulated,
            recordings: traffic.recordings,
            drivers: traffic.drivers().values().copied().collect(),
            free: traffic.free().to_vec(),
            noise: traffic.noise(),
            lane_changes,
        };
        it.check().map(|()| it)
    }

    /// The drivers of a site that come with this crate: `us-101`, `i-80`, both real, and `highd-simulated`.
    ///
    /// # Errors
    /// [`DriverError::UnknownSite`].
    pub fn embedded(site: &str) -> Result<Self, DriverError> {
        let found = EMBEDDED.iter().find(|(name, _)| *name == site);
        let known = || EMBEDDED.map(|(name, _)| name).join(", ");
        let (_, text) = found.ok_or_else(|| DriverError::UnknownSite { site: site.to_owned(), known: known() })?;
        Self::from_toml(text)
    }

    /// Reads what [`DriverDistribution::to_toml`] wrote.
    ///
    /// # Errors
    /// [`DriverError::Toml`] with the place and the reason.
    pub fn from_toml(text: &str) -> Result<Self, DriverError> {
        Ok(toml::from_str(text)?)
    }

    /// The distribution as a text, one line for each number of all drivers.
    ///
    /// # Errors
    /// [`DriverError::Written`].
    pub fn to_toml(&self) -> Result<String, DriverError> {
        Ok(toml::to_string(self)?)
    }

    /// Where they drive.
    #[must_use]
    pub fn site(&self) -> &str {
        &self.site
    }

    /// Whether the recordings were made by a simulator.
    #[must_use]
    pub fn simulated(&self) -> bool {
        self.simulated
    }

    /// Recordings that the drivers are from.
    #[must_use]
    pub fn recordings(&self) -> usize {
        self.recordings
    }

    /// The drivers, at least one.
    #[must_use]
    pub fn drivers(&self) -> &[FittedDriver] {
        &self.drivers
    }

    /// Speeds of those who drove freely.
    #[must_use]
    pub fn free(&self) -> &[FreeSpeed] {
        &self.free
    }

    /// How unsteady drivers are; none where too little is recorded.
    #[must_use]
    pub fn noise(&self) -> Option<Noise<f64>> {
        self.noise
    }

    /// How they change lanes.
    #[must_use]
    pub fn lane_changes(&self) -> &LaneChangeFit {
        &self.lane_changes
    }

    /// Driver number `n` of a seed: any of the recorded ones, each with the same probability, whatever was drawn before.
    #[must_use]
    pub fn draw(&self, seed: u64, n: u64) -> &FittedDriver {
        // The high half of the product of a random number of 64 bits and the count is uniform below the count.
        let at = (u128::from(mix(seed ^ mix(n))) * self.drivers.len() as u128) >> 64;
        &self.drivers[at as usize]
    }

    /// The vehicle of driver number `n` of a seed: size, rule, limits, desired speed, unsteadiness and lane changes, in
    /// `state`, whose lateral position he keeps to. His relaxation time is 1 s.
    #[must_use]
    pub fn vehicle(&self, seed: u64, n: u64, state: State<f64>) -> Vehicle<f64> {
        let drawn = self.draw(seed, n);
        let drive = Drive::Cruise { speed: drawn.driver.desired_speed, y: state.position.y };
        Vehicle {
            state,
            extent: drawn.extent,
            drive,
            tau: 1.,
            rule: Rule::Idm(drawn.rule()),
            limits: drawn.limits(),
            noise: self.noise,
            lane_change: Some(self.lane_changes.mobil),
        }
    }

    /// Medians and spreads of the drivers of a class, or of all; none where there are none.
    #[must_use]
    pub fn spreads(&self, class: Option<VehicleClass>) -> Option<Spreads> {
        let of: Vec<&FittedDriver> =
            self.drivers.iter().filter(|it| class.is_none_or(|class| it.class == class)).collect();
        let spread = |get: fn(&FittedDriver) -> f64| {
            let logs: Vec<f64> = of.iter().map(|it| get(it).max(1e-9).ln()).collect();
            let mean = logs.iter().sum::<f64>() / logs.len() as f64;
            let variance = logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>() / logs.len() as f64;
            Spread { median: median(of.iter().map(|it| get(it)).collect()), spread: variance.sqrt() }
        };
        (!of.is_empty()).then(|| Spreads {
            drivers: of.len(),
            desired_speed: spread(|it| it.driver.desired_speed),
            time_gap: spread(|it| it.driver.time_gap),
            standstill_gap: spread(|it| it.driver.standstill_gap),
            acceleration: spread(|it| it.driver.acceleration),
            braking: spread(|it| it.driver.braking),
        })
    }

    pub(super) fn check(&self) -> Result<(), DriverError> {
        require(!self.drivers.is_empty(), "the number of drivers", 0., "at least 1")?;
        for it in &self.drivers {
            it.driver.check()?;
            let positive = |value: f64| value > 0. && value.is_finite();
            require(positive(it.extent.length), "length", it.extent.length, "positive and finite, in m")?;
            require(positive(it.extent.width), "width", it.extent.width, "positive and finite, in m")?;
        }
        if let Some(Noise { sigma, correlation }) = self.noise {
            require(sigma >= 0. && sigma.is_finite(), "noise.sigma", sigma, "0 or more, in m/s²")?;
            let lasts = correlation > 0. && correlation.is_finite();
            require(lasts, "noise.correlation", correlation, "positive and finite, in s")?;
        }
        let mobil = &self.lane_changes.mobil;
        for (what, value) in [
            ("lane_changes.mobil.politeness", mobil.politeness),
            ("lane_changes.mobil.threshold", mobil.threshold),
            ("lane_changes.mobil.pause", mobil.pause),
            ("lane_changes.mobil.safe_braking", mobil.safe_braking),
        ] {
            require(value >= 0. && value.is_finite(), what, value, "0 or more")?;
        }
        let keep_right = mobil.keep_right;
        require(keep_right.is_finite(), "lane_changes.mobil.keep_right", keep_right, "finite, in m/s²")
    }
}
