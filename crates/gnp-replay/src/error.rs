//! What can go wrong.

/// Why there is no `.rrd` file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// The crate was built without Rerun.
    #[error("this build cannot write Rerun files; build with the feature `rerun`")]
    WithoutRerun,
    /// Rerun refuses what it is given.
    #[error("Rerun cannot encode {entity}: {source}")]
    Entity {
        /// Path of the entity.
        entity: String,
        /// What Rerun says.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Rerun fails at the file as a whole.
    #[error("Rerun cannot encode the file: {0}")]
    File(#[source] Box<dyn std::error::Error + Send + Sync>),
}
