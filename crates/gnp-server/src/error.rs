//! Why a server cannot start or go on.

use std::io;
use std::net::SocketAddr;

/// Why a server cannot start or go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServerError {
    /// Another program listens there.
    #[error(
        "{address}: another program listens on this port; take another one with --port, or any that is free with --port 0"
    )]
    PortTaken {
        /// The address.
        address: SocketAddr,
    },
    /// The system does not let it listen.
    #[error(
        "cannot listen on {address}; give an address of this computer with --listen and a port above 1023 with --port"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// A setting that cannot be.
    #[error("{0}")]
    Config(String),
    /// Two recordings of one name, by which they are asked for.
    #[error("two recordings are called {name}; serve one of them at a time")]
    SameName {
        /// The name.
        name: String,
    },
    /// Recordings of which the model predicts none.
    #[error(
        "{recording} has {found_hz} frames per second; the model predicts at {model_hz}, and from recordings of whole multiples of that"
    )]
    Rate {
        /// The recording.
        recording: String,
        /// Its rate, Hz.
        found_hz: f64,
        /// The model's, Hz.
        model_hz: f64,
    },
    /// The network, once it runs.
    #[error("the server cannot go on")]
    Io(#[from] io::Error),
    /// An answer that has no JSON form.
    #[error("an answer has no JSON form")]
    Answer(#[source] serde_json::Error),
    /// A model whose card cannot be said.
    #[error("the model's card has no JSON form; export the model again")]
    Card(#[from] serde_json::Error),
}
