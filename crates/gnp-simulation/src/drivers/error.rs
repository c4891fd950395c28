//! What can be wrong with a fit of drivers or a distribution of them.
use gnp_force::ForceError;

/// Why there are no drivers.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DriverError {
    /// Nobody follows anybody for long enough.
    #[error(
        "no driver can be fitted: none of {vehicles} vehicles is recorded behind a leader for {least_s} s; record longer, \
         or a longer section"
    )]
    NoFollowers {
        /// Vehicles there are.
        vehicles: usize,
        /// The least time that a fit takes, s.
        least_s: f64,
    },
    /// The search failed.
    #[error("the search for a driver's parameters failed: {0}")]
    Search(String),
    /// A number of the fit's configuration or of a distribution that cannot be.
    #[error("{what} is {value}, must be {must}")]
    Value {
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// The physics refuses a driver.
    #[error(transparent)]
    Force(#[from] ForceError),
    /// A text is no distribution of drivers.
    #[error("no distribution of drivers: {0}")]
    Toml(#[from] toml::de::Error),
    /// A distribution could not be written.
    #[error("the distribution could not be written: {0}")]
    Written(#[from] toml::ser::Error),
    /// No distribution of that name comes with the crate.
    #[error("no drivers of {site:?} come with the crate; there are those of {known}")]
    UnknownSite {
        /// The name asked for.
        site: String,
        /// The names there are.
        known: String,
    },
}

/// Refuses a number unless it `holds`.
pub(super) fn require(holds: bool, what: &'static str, value: f64, must: &'static str) -> Result<(), DriverError> {
    if holds { Ok(()) } else { Err(DriverError::Value { what, value, must }) }
}
