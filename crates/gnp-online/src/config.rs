//! How a stream works.

use gnp_road::ReferenceLine;

use crate::error::OnlineError;

/// How a [`Stream`](crate::Stream) works.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamConfig {
    /// Paths for each vehicle, K; a model gives as many as it has modes at most.
    pub k: usize,
    /// The road's line, where the road curves or x of the plane is not along it.
    pub road: Option<ReferenceLine>,
    /// Site whose drivers the traffic ahead is rolled out with; one that the model does not know, as `live`, gets the drivers
    /// of all its sites.
    pub site: String,
    /// How long a vehicle that is missing is taken to go on at its velocity, s; 0: not at all.
    pub coast_s: f64,
    /// Longest time between two samples of a vehicle that is interpolated, s. A vehicle missing for longer is forgotten.
    pub bridge_s: f64,
    /// Vehicles that are remembered at once, those missing among them.
    pub max_vehicles: usize,
    /// Samples of a vehicle kept in a second; of more, those between are left out. Bounds the memory.
    pub max_rate_hz: f64,
}

impl Default for StreamConfig {
    /// Six paths, a straight road along x, 0.5 s of going on, 1 s of bridging, 512 vehicles, 100 Hz.
    fn default() -> Self {
        Self {
            k: 6,
            road: None,
            site: "live".to_owned(),
            coast_s: 0.5,
            bridge_s: 1.,
            max_vehicles: 512,
            max_rate_hz: 100.,
        }
    }
}

impl StreamConfig {
    /// Every number: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 5] = [
        ("k", 1., 1000., "paths"),
        ("coast_s", 0., 10., "s"),
        ("bridge_s", 0., 10., "s"),
        ("max_vehicles", 1., 100_000., "vehicles"),
        ("max_rate_hz", 1., 1000., "Hz"),
    ];

    /// Refuses numbers out of [`StreamConfig::RANGES`].
    ///
    /// # Errors
    /// [`OnlineError::Config`].
    pub fn check(&self) -> Result<(), OnlineError> {
        let values = [self.k as f64, self.coast_s, self.bridge_s, self.max_vehicles as f64, self.max_rate_hz];
        for ((key, least, most, unit), value) in Self::RANGES.into_iter().zip(values) {
            if !(least..=most).contains(&value) {
                return Err(OnlineError::Config { key, value, least, most, unit });
            }
        }
        Ok(())
    }
}
