//! Recordings: which are read, what is found in them, and how they are kept.

mod describe;
pub(crate) mod ingest;
mod recordings;
mod road;
pub(crate) mod source;

pub use self::describe::describe;
pub use self::ingest::{IngestSummary, RecordingReport};
pub use self::recordings::{RecordingsRequest, recordings};
pub use self::road::road_options;
pub use self::source::embedded_folder;
