//! Why a call failed, as C is told: a status, and a sentence that the thread can ask for.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString};
use std::panic::{AssertUnwindSafe, catch_unwind};

use gnp_model::ModelError;
use gnp_online::OnlineError;

use crate::border::GnpStatus;

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// A pointer that must not be null is.
    #[error("`{0}` is NULL")]
    Null(&'static str),
    /// A path that is not text.
    #[error("`{0}` is not UTF-8")]
    NotText(&'static str),
    /// A number that means nothing.
    #[error("`{name}` is {value}; {expected}")]
    Value {
        /// Which field.
        name: &'static str,
        /// What it is.
        value: String,
        /// What it may be.
        expected: &'static str,
    },
    /// The model cannot be used.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The stream or a frame is refused.
    #[error(transparent)]
    Online(#[from] OnlineError),
    /// A defect of the library.
    #[error("a defect of GNP, please report it: {0}")]
    Panic(String),
    /// The stream was left by a panic.
    #[error("the stream met a defect before, and its state is not known: free it and make another one")]
    Broken,
}

impl Failure {
    fn status(&self) -> GnpStatus {
        match self {
            Self::Null(_) => GnpStatus::NullPointer,
            Self::NotText(_) | Self::Value { .. } => GnpStatus::InvalidArgument,
            Self::Model(_) => GnpStatus::Model,
            Self::Online(error) => online(error),
            Self::Panic(_) | Self::Broken => GnpStatus::Defect,
        }
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// What the last failed call of this thread said; empty before the first. Valid until the next one that fails.
pub(crate) fn with_last<T>(read: impl FnOnce(&CStr) -> T) -> T {
    LAST.with_borrow(|last| read(last))
}

/// Does `work`; what goes wrong, a panic as well, becomes a status and this thread's last error.
pub(crate) fn guard(work: impl FnOnce() -> Result<(), Failure>) -> GnpStatus {
    // What a panic may leave half done is a stream, which is then refused (`Failure::Broken`).
    let done = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|cause| Err(Failure::Panic(said(&*cause))));
    let Err(failure) = done else { return GnpStatus::Ok };
    // A sentence has no zero in it unless a name of a file has: what is after it is not told.
    let text = chain(&failure).split('\0').next().unwrap_or_default().to_owned();
    LAST.set(CString::new(text).unwrap_or_default());
    failure.status()
}

/// The error and what it stems from, in one line.
fn chain(failure: &Failure) -> String {
    let mut text = failure.to_string();
    let mut cause = std::error::Error::source(failure);
    while let Some(error) = cause {
        text.push_str(": ");
        text.push_str(&error.to_string());
        cause = error.source();
    }
    text
}

fn said(cause: &(dyn Any + Send)) -> String {
    let text = cause.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| cause.downcast_ref::<String>().cloned()).unwrap_or_else(|| "it does not say what".to_owned())
}

fn online(error: &OnlineError) -> GnpStatus {
    match error {
        _ => GnpStatus::Frame,
    }
}
