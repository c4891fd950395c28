//! Parameters by site, as all rules are fitted.

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{Forecast, Observation, PredictError, Predictor, Window};
use serde::{Deserialize, Serialize};

use crate::motion::BaselineError;

/// Vehicles that a site must have for parameters of its own; one in two recordings counts twice.
pub(crate) const LEAST_VEHICLES: usize = 20;

/// Something for each site that has enough vehicles, and for all others together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BySite<T> {
    /// Of all sites together, for those that have none of their own.
    pub pooled: T,
    /// By site.
    pub sites: BTreeMap<String, T>,
}

impl<T> BySite<T> {
    /// What holds at `site`.
    #[must_use]
    pub fn at(&self, site: &str) -> &T {
        self.sites.get(site).unwrap_or(&self.pooled)
    }

    /// Fits to training windows: of each site, where there are several and it has at least 20 vehicles, and of all.
    pub(crate) fn fit<'w>(
        training: &[Window<'w>],
        fit: impl Fn(&[Window<'w>]) -> Result<T, BaselineError>,
    ) -> Result<Self, BaselineError> {
        check_shapes(training)?;
        let mut by_site: BTreeMap<String, Vec<Window<'w>>> = BTreeMap::new();
        for window in training {
            by_site.entry(window.observation().site().to_owned()).or_default().push(*window);
        }
        // One site alone is what all together are.
        let several = by_site.len() > 1;
        let vehicles = |windows: &[Window<'w>]| {
            let names = windows.iter().map(|window| window.key()).map(|key| (key.recording, key.vehicle));
            names.collect::<BTreeSet<_>>().len()
        };
        let own = by_site.into_iter().filter(|(_, windows)| several && vehicles(windows) >= LEAST_VEHICLES);
        let sites = own.map(|(site, windows)| Ok((site, fit(&windows)?))).collect::<Result<_, BaselineError>>()?;
        Ok(Self { pooled: fit(training)?, sites })
    }

    /// Turns each value into another.
    pub(crate) fn made<U>(self, make: impl Fn(T) -> Result<U, BaselineError>) -> Result<BySite<U>, BaselineError> {
        let sites = self.sites.into_iter().map(|(site, of)| Ok((site, make(of)?)));
        Ok(BySite { sites: sites.collect::<Result<_, BaselineError>>()?, pooled: make(self.pooled)? })
    }
}

impl<P: Predictor> Predictor for BySite<P> {
    fn name(&self) -> &str {
        self.pooled.name()
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let mut forecasts = Vec::with_capacity(observations.len());
        for of_site in observations.chunk_by(|a, b| a.site() == b.site()) {
            forecasts.extend(self.at(of_site[0].site()).predict(of_site, k)?);
        }
        Ok(forecasts)
    }
}

/// Checks that there are windows, all of one shape with two observed frames or more.
pub(crate) fn check_shapes(windows: &[Window<'_>]) -> Result<(), BaselineError> {
    let shape = windows.first().ok_or(BaselineError::NoWindows)?.observation().shape();
    let alike = shape.t_obs >= 2 && windows.iter().all(|window| window.observation().shape().fits(&shape));
    if alike { Ok(()) } else { Err(BaselineError::Shapes) }
}
