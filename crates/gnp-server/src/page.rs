//! The page: files that are part of the program. Nothing is looked up on the disk.

use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};

use crate::problem::{Problem, ProblemKind};

/// The files below `/page/`: name, media type, content.
const FILES: &[(&str, &str, &str)] = &[
    ("theme.css", CSS, gnp_plot::SCENE_STYLE),
    ("scene.js", JS, gnp_plot::SCENE_SCRIPT),
    ("play.css", CSS, include_str!("../page/play.css")),
    ("main.js", JS, include_str!("../page/main.js")),
    ("answers.js", JS, include_str!("../page/answers.js")),
    ("api.js", JS, include_str!("../page/api.js")),
    ("changes.js", JS, include_str!("../page/changes.js")),
    ("draw.js", JS, include_str!("../page/draw.js")),
    ("hands.js", JS, include_str!("../page/hands.js")),
    ("keys.js", JS, include_str!("../page/keys.js")),
    ("link.js", JS, include_str!("../page/link.js")),
    ("panel.js", JS, include_str!("../page/panel.js")),
    ("state.js", JS, include_str!("../page/state.js")),
    ("traffic.js", JS, include_str!("../page/traffic.js")),
];
const CSS: &str = "text/css; charset=utf-8";
const JS: &str = "text/javascript; charset=utf-8";

const INDEX: &str = include_str!("../page/index.html");
/// The description of the API, `openapi.json`.
pub const OPENAPI: &str = include_str!("../openapi.json");

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

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// The names between `before` and a quotation mark.
    fn named<'a>(text: &'a str, before: &'a str) -> impl Iterator<Item = &'a str> {
        text.split(before).skip(1).filter_map(|rest| rest.split('"').next())
    }

    #[test]
    fn the_page_asks_for_the_files_there_are() {
        let of_index = named(INDEX, "\"/page/");
        let imported = FILES.iter().flat_map(|(.., content)| named(content, " from \"./"));
        let asked: BTreeSet<&str> = of_index.chain(imported).collect();
        let there: BTreeSet<&str> = FILES.iter().map(|(name, ..)| *name).collect();
        assert_eq!(asked, there);
    }

    /// What the content security policy forbids would fail in the browser only.
    #[test]
    fn the_page_has_no_inline_script_or_style_and_no_foreign_address() {
        let lower = INDEX.to_ascii_lowercase();
        for sign in ["<style", "style=", "<script>", "javascript:", " onclick", " onload", " oninput"] {
            assert!(!lower.contains(sign), "{sign}");
        }
        for (name, content) in FILES.iter().map(|(name, _, content)| (*name, *content)).chain([("index.html", INDEX)]) {
            for sign in ["http:", "https:", "//cdn", "@import", "url(", "innerHTML", "eval("] {
                assert!(!content.contains(sign), "{name} has {sign}");
            }
        }
    }
}
