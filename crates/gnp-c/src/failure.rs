//! Why a call failed, as C is told: a status, and a sentence that the thread can ask for.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString};
use std::panic::{AssertUnwindSafe, catch_unwind};

use gnp_model::ModelError;
use gnp_online::OnlineError;
use gnp_road::LineError;

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
    #[error("{name} is {value}; it must be {expected}")]
    Value {
        /// Which field.
        name: String,
        /// What it is.
        value: u64,
        /// What it may be.
        expected: &'static str,
    },
    /// The line of a road cannot be one.
    #[error("config.road: {0}")]
    Road(#[from] LineError),
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
    /// A number that means nothing.
    pub(crate) fn value(name: &str, value: impl Into<u64>, expected: &'static str) -> Self {
        Self::Value { name: name.to_owned(), value: value.into(), expected }
    }

    /// A number that means nothing, of a track.
    pub(crate) fn of_track(row: usize, field: &str, value: u32, expected: &'static str) -> Self {
        Self::value(&format!("tracks[{row}].{field}"), value, expected)
    }

    fn status(&self) -> GnpStatus {
        match self {
            Self::Null(_) => GnpStatus::NullPointer,
            Self::NotText(_) | Self::Value { .. } | Self::Road(_) => GnpStatus::InvalidArgument,
            Self::Model(_) => GnpStatus::Model,
            Self::Online(OnlineError::Time { .. }) => GnpStatus::Time,
            Self::Online(OnlineError::Predict(_)) => GnpStatus::Prediction,
            // Lane lines, lane widths and numbers of the configuration.
            Self::Online(_) => GnpStatus::InvalidArgument,
            Self::Panic(_) | Self::Broken => GnpStatus::Defect,
        }
    }
}

/// A [`GnpReason`] in words; they agree with those of `gnp_online::Reason`, which C cannot keep.
pub(crate) fn reason_text(reason: u32) -> &'static CStr {
    const TEXTS: [&CStr; 10] = [
        c"there is none",
        c"its position is not finite, or too far from the origin; the track was left out",
        c"its position has no place on the road's line; the track was left out",
        c"its id was there already in the frame; the first track counts",
        c"there are max_vehicles vehicles already; the track was left out",
        c"its velocity is not finite, or none of a vehicle; differences of positions were used",
        c"it is longer, shorter, wider or narrower than any vehicle; the size before it was used. Check the unit",
        c"its velocity is not known yet",
        c"the model gave no finite forecast for it",
        c"a reason that this interface has no name for",
    ];
    TEXTS.get(reason as usize).copied().unwrap_or(c"no GnpReason")
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
