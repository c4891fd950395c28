//! How a server is set up.

use std::net::{IpAddr, Ipv4Addr};
use std::thread::available_parallelism;

/// Where a server listens, whom it answers, and how much it does.
///
/// ```
/// let mut config = gnp_server::ServerConfig::default();
/// config.port = 0; // any that is free
/// assert!(config.listen.is_loopback());
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ServerConfig {
    /// The address; the loopback one unless said otherwise.
    pub listen: IpAddr,
    /// The port; 0 for any that is free.
    pub port: u16,
    /// Names, with or without a port, that the `Host` header may have beside those of the loopback address.
    pub allowed_hosts: Vec<String>,
    /// Origins, such as `https://example.org`, whose pages may ask.
    pub allowed_origins: Vec<String>,
    /// Most vehicles of a scene.
    pub max_vehicles: usize,
    /// Largest body of a request, bytes.
    pub max_body_bytes: usize,
    /// Requests a second that one client (an address) may make; as many may come at once.
    pub requests_per_s: u32,
    /// Forecasts that are worked on at once.
    pub jobs: usize,
    /// Requests that may wait for their turn.
    pub waiting: usize,
}

impl Default for ServerConfig {
    fn default() -> Self {
        let jobs = available_parallelism().map_or(1, usize::from);
        Self {
            listen: IpAddr::V4(Ipv4Addr::LOCALHOST),
            port: 8017,
            allowed_hosts: Vec::new(),
            allowed_origins: Vec::new(),
            max_vehicles: 200,
            max_body_bytes: 1024 * 1024,
            requests_per_s: 5000,
            jobs,
            waiting: 256,
        }
    }
}
