//! Drivers as recorded: parameters of car following and of lane changes fitted to recordings, and distributions to draw
//! from.
//!
//! [`fit_drivers`] fits the five numbers of the intelligent driver model to every recorded follower,
//! [`fit_lane_changes`] those of MOBIL to all of them together, and a [`DriverDistribution`] holds both for a site: to be
//! written, read and drawn from. Three come with the crate: [`DriverDistribution::embedded`].
mod distribution;
mod error;
mod fit;
mod free;
mod lane_changes;
mod noise;
mod rate;
mod situations;
mod stretches;
mod table;

pub use self::{
    distribution::{DriverDistribution, Spread, Spreads},
    error::DriverError,
    fit::{DriverKey, FitConfig, FittedTraffic, FollowingErrors, LeftOut, fit_drivers},
    free::FreeSpeed,
    lane_changes::{LaneChangeFit, LaneChangeLikelihood, fit_lane_changes},
};
use gnp_data::VehicleClass;
use gnp_force::{Driver, Extent, Idm, Limits};

/// A recorded driver and his vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedDriver {
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Size of the vehicle, m.
    pub extent: Extent<f64>,
    /// How he follows.
    pub driver: Driver<f64>,
    /// Root mean square of the difference between rolled out and recorded gap, m.
    pub error_m: f64,
    /// The mixed error measure of the fit: about the difference in parts of the gap.
    pub error: f64,
    /// Seconds of following behind it.
    pub seconds: f64,
}

impl FittedDriver {
    /// The rule for a simulator; the desired speed belongs into [`Drive::Cruise`](gnp_force::Drive::Cruise).
    #[must_use]
    pub fn rule(&self) -> Idm<f64> {
        Idm::of(&self.driver)
    }

    /// What such a vehicle can do: [`Limits::truck`] of trucks, [`Limits::car`] of others.
    #[must_use]
    pub fn limits(&self) -> Limits<f64> {
        if self.class == VehicleClass::Truck { Limits::truck() } else { Limits::car() }
    }
}

/// Middle value; of an even number the mean of both, of none 0.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.,
        n => (values[(n - 1) / 2] + values[n / 2]) / 2.,
    }
}
