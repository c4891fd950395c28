//! Everything a request can be refused for, as problem details (RFC 9457).

use std::borrow::Cow;

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

/// Longest field and detail of a problem, characters: what they repeat of a request may be as long as its body.
const LONGEST: [usize; 2] = [200, 1000];

/// What kind of problem it is: the name in `urn:gnp:problem:NAME`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ProblemKind {
    /// The body is not JSON.
    NotJson,
    /// A field is missing, unknown, of another type, or has a value that cannot be.
    InvalidRequest,
    /// Tracks that make no scene.
    InvalidTracks,
    /// A change that the scene does not take.
    InvalidChange,
    /// More vehicles than the server takes.
    TooManyVehicles,
    /// A vehicle that is not in the scene, or of which no forecast can be made.
    UnknownVehicle,
    /// A term of the force that the model does not have.
    UnknownTerm,
    /// A recording that is not served.
    UnknownRecording,
    /// A time outside of the recording, or when nobody is there.
    OutsideRecording,
    /// No such page.
    NotFound,
    /// A page that does not take this method.
    MethodNotAllowed,
    /// The body did not come in time.
    SlowRequest,
    /// A larger body than the server takes.
    BodyTooLarge,
    /// Not `application/json`.
    UnsupportedMediaType,
    /// The `Host` header names another place.
    WrongHost,
    /// A page of another origin asks, which is not listed.
    OriginNotAllowed,
    /// More requests than a client may make.
    TooManyRequests,
    /// Too many requests wait.
    Busy,
    /// The server is at fault.
    Internal,
}

impl ProblemKind {
    /// All of them.
    pub const ALL: [Self; 19] = [
        Self::NotJson,
        Self::InvalidRequest,
        Self::InvalidTracks,
        Self::InvalidChange,
        Self::TooManyVehicles,
        Self::UnknownVehicle,
        Self::UnknownTerm,
        Self::UnknownRecording,
        Self::OutsideRecording,
        Self::NotFound,
        Self::MethodNotAllowed,
        Self::SlowRequest,
        Self::BodyTooLarge,
        Self::UnsupportedMediaType,
        Self::WrongHost,
        Self::OriginNotAllowed,
        Self::TooManyRequests,
        Self::Busy,
        Self::Internal,
    ];

    /// Its name, status and title.
    const fn words(self) -> (&'static str, StatusCode, &'static str) {
        match self {
            Self::NotJson => ("not-json", StatusCode::BAD_REQUEST, "The body is not JSON"),
            Self::InvalidRequest => {
                ("invalid-request", StatusCode::UNPROCESSABLE_ENTITY, "A field of the request cannot be used")
            }
            Self::InvalidTracks => ("invalid-tracks", StatusCode::UNPROCESSABLE_ENTITY, "The tracks make no scene"),
            Self::InvalidChange => {
                ("invalid-change", StatusCode::UNPROCESSABLE_ENTITY, "The scene does not take this change")
            }
            Self::TooManyVehicles => ("too-many-vehicles", StatusCode::UNPROCESSABLE_ENTITY, "Too many vehicles"),
            Self::UnknownVehicle => ("unknown-vehicle", StatusCode::UNPROCESSABLE_ENTITY, "Unknown vehicle"),
            Self::UnknownTerm => ("unknown-term", StatusCode::UNPROCESSABLE_ENTITY, "Unknown term of the force"),
            Self::UnknownRecording => ("unknown-recording", StatusCode::NOT_FOUND, "Unknown recording"),
            Self::OutsideRecording => {
                ("outside-recording", StatusCode::UNPROCESSABLE_ENTITY, "Nothing is recorded at this time and place")
            }
            Self::NotFound => ("not-found", StatusCode::NOT_FOUND, "Nothing is here"),
            Self::MethodNotAllowed => ("method-not-allowed", StatusCode::METHOD_NOT_ALLOWED, "Method not allowed"),
            Self::SlowRequest => ("slow-request", StatusCode::REQUEST_TIMEOUT, "The body did not come in time"),
            Self::BodyTooLarge => ("body-too-large", StatusCode::PAYLOAD_TOO_LARGE, "The body is too large"),
            Self::UnsupportedMediaType => {
                ("unsupported-media-type", StatusCode::UNSUPPORTED_MEDIA_TYPE, "The body is not declared as JSON")
            }
            Self::WrongHost => {
                ("wrong-host", StatusCode::MISDIRECTED_REQUEST, "The Host header does not name this server")
            }
            Self::OriginNotAllowed => ("origin-not-allowed", StatusCode::FORBIDDEN, "The origin is not allowed"),
            Self::TooManyRequests => ("too-many-requests", StatusCode::TOO_MANY_REQUESTS, "Too many requests"),
            Self::Busy => ("busy", StatusCode::SERVICE_UNAVAILABLE, "Too many requests wait"),
            Self::Internal => ("internal", StatusCode::INTERNAL_SERVER_ERROR, "The server is at fault"),
        }
    }

    /// Its name, as in `urn:gnp:problem:NAME`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.words().0
    }

    /// The status of its answer.
    #[must_use]
    pub const fn status(self) -> u16 {
        self.words().1.as_u16()
    }
}

/// Why a request was refused.
#[derive(Clone, Debug)]
pub(crate) struct Problem {
    kind: ProblemKind,
    detail: Cow<'static, str>,
    errors: Vec<FieldError>,
    /// After how many seconds to try again.
    retry_after_s: Option<u64>,
}

/// What is wrong with one field.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct FieldError {
    /// Such as `scene.vehicles[3].track[12]`.
    field: String,
    /// Of a track.
    #[serde(skip_serializing_if = "Option::is_none")]
    row: Option<usize>,
    detail: String,
}

/// Its form in an answer.
#[derive(Serialize)]
pub(crate) struct Details<'a> {
    r#type: String,
    title: &'static str,
    status: u16,
    detail: &'a str,
    #[serde(skip_serializing_if = "<[FieldError]>::is_empty")]
    errors: &'a [FieldError],
}

impl Problem {
    pub(crate) fn new(kind: ProblemKind, detail: impl Into<Cow<'static, str>>) -> Self {
        Self { kind, detail: detail.into(), errors: Vec::new(), retry_after_s: None }
    }

    /// One of a field of the request, such as `changes[2].vehicle`.
    pub(crate) fn at(kind: ProblemKind, field: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::new(kind, String::new()).and(field, None, detail)
    }

    /// The same with what is wrong with a field, and with a row of a track in it.
    pub(crate) fn and(mut self, field: impl Into<String>, row: Option<usize>, detail: impl Into<String>) -> Self {
        let (field, detail) = (cut(field.into(), LONGEST[0]), cut(detail.into(), LONGEST[1]));
        if self.detail.is_empty() {
            self.detail = detail.clone().into();
        }
        self.errors.push(FieldError { field, row, detail });
        self
    }

    pub(crate) fn kind(&self) -> ProblemKind {
        self.kind
    }

    /// Its body.
    pub(crate) fn details(&self) -> Details<'_> {
        let (name, status, title) = self.kind.words();
        Details {
            r#type: format!("urn:gnp:problem:{name}"),
            title,
            status: status.as_u16(),
            detail: &self.detail,
            errors: &self.errors,
        }
    }

    pub(crate) fn retry_after(self, seconds: u64) -> Self {
        Self { retry_after_s: Some(seconds), ..self }
    }
}

/// The beginning of a text that is longer than `most` characters.
fn cut(text: String, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

/// Which problem an answer is, for counting.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Refused(pub(crate) ProblemKind);

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let (_, status, _) = self.kind.words();
        let mut response = (status, Json(self.details())).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if let Some(seconds) = self.retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response.extensions_mut().insert(Refused(self.kind));
        response
    }
}
