//! What a target found wrong, apart from panics.

/// Something that must not be.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Finding {
    /// A value that was given out and breaks what is promised of it.
    #[error("believed: {0}")]
    Believed(String),
    /// A message that does not help its reader.
    #[error("message {why}: {message}")]
    Message {
        /// What is wrong with it.
        why: &'static str,
        /// The message.
        message: String,
    },
    /// Files of the case could not be written: nothing was tested.
    #[error("the files of a case cannot be written")]
    Scratch(#[from] std::io::Error),
    /// What a case is made from could not be made: nothing was tested.
    #[error("a case cannot be made: {0}")]
    Case(String),
}

impl Finding {
    /// A case that cannot be made, because of `error`.
    pub(crate) fn case(error: impl std::fmt::Display) -> Self {
        Self::Case(error.to_string())
    }
}

/// Nothing if `good`; else that what was given out breaks a promise.
pub(crate) fn promise(good: bool, what: impl FnOnce() -> String) -> Result<(), Finding> {
    if good { Ok(()) } else { Err(Finding::Believed(what())) }
}
