//! A distribution as it is written: one column a number, rounded to what was measured.
use super::{
    FittedDriver,
    distribution::DriverDistribution,
    error::{DriverError, require},
    free::FreeSpeed,
    lane_changes::LaneChangeFit,
};
use gnp_data::VehicleClass;
use gnp_force::{Driver, Extent, Noise};
use serde::{Deserialize, Serialize};

/// What a distribution is read from and written as.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Table {
    site: String,
    simulated: bool,
    recordings: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    noise: Option<Noise<f64>>,
    lane_changes: LaneChangeFit,
    drivers: Drivers,
    free: Free,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Drivers {
    class: Vec<VehicleClass>,
    length_m: Vec<f64>,
    width_m: Vec<f64>,
    desired_speed_mps: Vec<f64>,
    time_gap_s: Vec<f64>,
    standstill_gap_m: Vec<f64>,
    acceleration_mps2: Vec<f64>,
    braking_mps2: Vec<f64>,
    error_m: Vec<f64>,
    error: Vec<f64>,
    seconds: Vec<f64>,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Free {
    class: Vec<VehicleClass>,
    speed_mps: Vec<f64>,
}

fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Refuses columns of different lengths.
fn same(what: &'static str, expected: usize, lengths: &[usize]) -> Result<(), DriverError> {
    let other = lengths.iter().find(|length| **length != expected);
    require(other.is_none(), what, *other.unwrap_or(&0) as f64, "as many values as `class` has")
}

impl TryFrom<Table> for DriverDistribution {
    type Error = DriverError;

    fn try_from(table: Table) -> Result<Self, DriverError> {
        let Table { site, simulated, recordings, noise, lane_changes, drivers: of, free } = table;
        let lengths = [
            &of.length_m,
            &of.width_m,
            &of.desired_speed_mps,
            &of.time_gap_s,
            &of.standstill_gap_m,
            &of.acceleration_mps2,
            &of.braking_mps2,
            &of.error_m,
            &of.error,
            &of.seconds,
        ];
        same("a column of `drivers`", of.class.len(), &lengths.map(Vec::len))?;
        same("a column of `free`", free.class.len(), &[free.speed_mps.len()])?;
        let driver = |i: usize| FittedDriver {
            class: of.class[i],
            extent: Extent { length: of.length_m[i], width: of.width_m[i] },
            driver: Driver {
                desired_speed: of.desired_speed_mps[i],
                time_gap: of.time_gap_s[i],
                standstill_gap: of.standstill_gap_m[i],
                acceleration: of.acceleration_mps2[i],
                braking: of.braking_mps2[i],
            },
            error_m: of.error_m[i],
            error: of.error[i],
            seconds: of.seconds[i],
        };
        let drivers = (0..of.class.len()).map(driver).collect();
        let free = free.class.into_iter().zip(free.speed_mps).map(|(class, speed)| FreeSpeed { class, speed });
        let it = Self { site, simulated, recordings, drivers, free: free.collect(), noise, lane_changes };
        it.check().map(|()| it)
    }
}

impl From<DriverDistribution> for Table {
    fn from(it: DriverDistribution) -> Self {
        let mut of = Drivers::default();
        for driver in &it.drivers {
            of.class.push(driver.class);
            for (column, value) in [
                (&mut of.length_m, driver.extent.length),
                (&mut of.width_m, driver.extent.width),
                (&mut of.desired_speed_mps, driver.driver.desired_speed),
                (&mut of.time_gap_s, driver.driver.time_gap),
                (&mut of.standstill_gap_m, driver.driver.standstill_gap),
                (&mut of.acceleration_mps2, driver.driver.acceleration),
                (&mut of.braking_mps2, driver.driver.braking),
                (&mut of.error_m, driver.error_m),
                (&mut of.error, driver.error),
                (&mut of.seconds, driver.seconds),
            ] {
                column.push(rounded(value));
            }
        }
        let free = Free {
            class: it.free.iter().map(|free| free.class).collect(),
            speed_mps: it.free.iter().map(|free| rounded(free.speed)).collect(),
        };
        let DriverDistribution { site, simulated, recordings, noise, lane_changes, .. } = it;
        let noise = noise.map(|it| Noise { sigma: rounded(it.sigma), correlation: rounded(it.correlation) });
        Self { site, simulated, recordings, noise, lane_changes, drivers: of, free }
    }
}
