//! What can be wrong with a simulation.
use gnp_data::DataError;
use gnp_force::ForceError;

/// Why traffic was not simulated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// The text of a scene is no TOML, or lacks a key, or has one that is not known.
    #[error(transparent)]
    Syntax(#[from] toml::de::Error),
    /// A scene says something that cannot be.
    #[error("`{key}` is {value}, but must be {must}")]
    Scene {
        /// The key, as in the file.
        key: String,
        /// What it says.
        value: String,
        /// What it must be.
        must: String,
    },
    /// The physics refuses a number, a place or a road.
    #[error(transparent)]
    Force(#[from] ForceError),
    /// What happened is no recording, or a recording cannot be used.
    #[error(transparent)]
    Data(#[from] DataError),
    /// More vehicles or steps than a recording can number.
    #[error("{what} is {value}, but at most {most} can be recorded: shorten the simulation or record fewer frames")]
    TooLarge {
        /// What is too large.
        what: &'static str,
        /// How large.
        value: u64,
        /// The most.
        most: u64,
    },
    /// A recording cannot be driven on from.
    #[error("recording {recording}: {reason}")]
    Replay {
        /// The recording.
        recording: String,
        /// Why.
        reason: String,
    },
    /// Nobody is there at a start of a replay who is not moved as recorded, or nothing is recorded after it.
    #[error("recording {recording}: nobody is there to be driven from frame {start} on")]
    NobodyToDrive {
        /// The recording.
        recording: String,
        /// The frame.
        start: u32,
    },
    /// Every fitted driver is in the scene himself.
    #[error("{system}: all of its drivers are in the scene {scene} themselves; fit some on other vehicles")]
    NoDrivers {
        /// The system.
        system: String,
        /// The scene.
        scene: String,
    },
    /// A predictor that drives failed.
    #[error(transparent)]
    Predict(#[from] gnp_data::PredictError),
    /// Positions of another simulator cannot be read.
    #[error("positions, line {line}: {reason}")]
    Positions {
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
    },
    /// Fitted drivers cannot be used.
    #[error(transparent)]
    Drivers(#[from] crate::drivers::DriverError),
    /// Nobody was ever on the road.
    #[error("nobody was on the road in {seconds} s: give more inflow, or vehicles at the start")]
    Nobody {
        /// How long, s.
        seconds: f64,
    },
    /// A file could not be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The work was stopped from outside.
    #[error("stopped after {seconds:.0} s of simulated time")]
    Stopped {
        /// How far it came, s.
        seconds: f64,
    },
}
