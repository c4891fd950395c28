//! The page: files that are part of the program. Nothing is looked up on the disk.

use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};

use crate::problem::{Problem, ProblemKind};

/// The files below `/page/`: name, media type, content.
const FILES: &[(&str, &str, &str)] = &[];

const INDEX: &str = include_str!("../page/index.html");
const OPENAPI: &str = include_str!("../openapi.json");

/// `GET /`
pub(crate) fn index() -> Response {
    file("text/html; charset=utf-8", INDEX)
}

/// `GET /openapi.json`
pub(crate) fn openapi() -> Response {
    file("application/json", OPENAPI)
}

/// `GET /page/NAME`
pub(crate) fn of_page(name: &str) -> Result<Response, Problem> {
    let known = FILES.iter().find(|(known, ..)| *known == name);
    let (_, kind, content) = known.ok_or_else(|| Problem::new(ProblemKind::NotFound, "the page has no such file"))?;
    Ok(file(kind, content))
}

fn file(kind: &'static str, content: &'static str) -> Response {
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
        // A new program brings a new page.
        (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
    ];
    (headers, content).into_response()
}
