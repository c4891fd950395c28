//! Bodies of requests to the server: any text, and scenes and changes that are damaged; answered or refused as described.

use std::sync::OnceLock;

use arbitrary::{Arbitrary, Unstructured};
use gnp::{Machine, Model};
use gnp_server::{Local, OPENAPI, ProblemKind, Route, ServerConfig};
use jsonschema::Validator;
use serde_json::{Value, json};

use crate::finding::promise;
use crate::made::{kind, road};
use crate::patch::{self, Patch};
use crate::{Finding, Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "request",
    about: "bodies of POST /v1/predict and /v1/explain, to answers or problems that name the field",
    run,
    seeds,
    words: &[
        "{\"scene\":{\"vehicles\":[",
        "\"recording\":\"case\"",
        "\"time_s\":",
        "\"road\":",
        "\"lines\":[{\"y\":0,\"kind\":\"boundary\"}]",
        "\"axis\":[[0,0],[100,0]]",
        "\"track\":[[0,0,2],[0.1,2,2]]",
        "\"changes\":[{\"kind\":\"remove\",\"vehicle\":\"a\"}]",
        "\"vehicle\":\"a\"",
        "\"vehicles\":[\"1\"]",
        "\"every_s\":",
        "null",
        "1e308",
        "-1",
    ],
};

fn run(_: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let served = served()?;
    let (kind, rest) = kind(input);
    match kind {
        b'p' => served.ask(Route::Predict, rest),
        b'e' => served.ask(Route::Explain, rest),
        _ => {
            let mut bases = bases();
            let (route, mut body) = bases.swap_remove(usize::from(kind) % bases.len());
            let Ok(patches) = Vec::<Patch>::arbitrary(&mut Unstructured::new(rest)) else { return Ok(()) };
            patch::apply(&mut body, &patches);
            served.ask(route, body.to_string().as_bytes())
        }
    }
}

/// The server of a recording and the model that comes with the program, and the description of what it answers.
struct Served {
    local: Local,
    forecasts: Validator,
    explanation: Validator,
    problem: Validator,
}

/// Made once: a request leaves nothing behind but counters and moments.
fn served() -> Result<&'static Served, Finding> {
    static SERVED: OnceLock<Served> = OnceLock::new();
    if let Some(served) = SERVED.get() {
        return Ok(served);
    }
    let model = Model::open(None, &Machine::default()).map_err(Finding::case)?;
    let local = Local::new(ServerConfig::default(), model, vec![road("case")?]).map_err(Finding::case)?;
    let description: Value = serde_json::from_str(OPENAPI).map_err(Finding::case)?;
    let schema = |name: &str| {
        let schema = json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "$ref": format!("#/components/schemas/{name}"),
            "components": description["components"],
        });
        jsonschema::validator_for(&schema).map_err(Finding::case)
    };
    let (forecasts, explanation, problem) = (schema("Forecasts")?, schema("Explanation")?, schema("Problem")?);
    Ok(SERVED.get_or_init(|| Served { local, forecasts, explanation, problem }))
}

impl Served {
    fn ask(&self, route: Route, body: &[u8]) -> Result<(), Finding> {
        let predict = route == Route::Predict;
        let answer = if predict { self.local.predict(body) } else { self.local.explain(body) };
        let answer = answer.map_err(|error| Finding::Believed(error.to_string()))?;
        let schema = match (answer.status, predict) {
            (200, true) => &self.forecasts,
            (200, false) => &self.explanation,
            _ => &self.problem,
        };
        // A number that is not finite stands as null, which no number may be.
        if let Some(error) = schema.iter_errors(&answer.body).next() {
            let place = error.instance_path().to_string();
            let what = format!("an answer of {} is not as described at {place}: {error}", answer.status);
            return Err(Finding::Believed(what.chars().take(500).collect()));
        }
        if answer.status == 200 { Ok(()) } else { refused(answer.status, &answer.body) }
    }
}

/// A refusal is the client's, fits on a page and names the field, unless there is none to be named.
fn refused(status: u16, problem: &Value) -> Result<(), Finding> {
    checks::refusal_text(problem["detail"].as_str().unwrap_or_default(), "")?;
    promise(problem["status"] == status && (400..500).contains(&status), || format!("{problem}"))?;
    let not_json = problem["type"] == format!("urn:gnp:problem:{}", ProblemKind::NotJson.name());
    let errors = problem["errors"].as_array().map(Vec::as_slice).unwrap_or_default();
    let named = errors.iter().all(|error| error["field"].as_str().is_some_and(|field| !field.is_empty()));
    promise(named && not_json == errors.is_empty(), || format!("a problem that names no field: {problem}"))
}

/// Requests that are answered, one of each kind.
fn bases() -> Vec<(Route, Value)> {
    let track = |x: f64, v: f64, rows: u32| -> Value {
        (0..rows).map(f64::from).map(|row| json!([row / 10., x + v * row / 10., 1.8])).collect()
    };
    let lines = json!([{"y": 0, "kind": "boundary"}, {"y": 3.7, "kind": "divider"}, {"y": 7.4, "kind": "boundary"}]);
    let scene = json!({
        "lines": lines,
        "vehicles": [
            {"id": "a", "class": "car", "size": [4.5, 1.8], "track": track(0., 22., 12)},
            {"id": "b", "class": "truck", "size": [12, 2.5], "track": track(40., 18., 12)},
        ],
    });
    let bare = json!({"vehicles": [{"id": "a", "track": track(0., 22., 4)}, {"id": "b", "track": track(30., 20., 3)}]});
    let curve: Vec<[f64; 2]> = (0..8).map(f64::from).map(|i| [20. * i - 20., 0.2 * i * i]).collect();
    let bent = json!({"axis": curve, "vehicles": [{"id": "a", "track": track(0., 22., 4)}]});
    let recording = json!({"recording": "case", "road": 0, "time_s": 1});
    let every_kind = |vehicle: &str, other: &str| {
        json!([
            {"kind": "move", "vehicle": other, "by": [-5, 0.5]},
            {"kind": "speed", "vehicle": vehicle, "mps": 8},
            {"kind": "add", "vehicle": "new 1", "at": [60, 1.8], "mps": 12, "class": "truck", "size": [12, 2.5]},
            {"kind": "goal", "vehicle": vehicle, "at": [60, -3.5]},
            {"kind": "without_term", "term": "neighbours"},
        ])
    };
    let removed = json!([{"kind": "remove", "vehicle": "2"}]);
    vec![
        (Route::Predict, json!({"scene": scene, "k": 2, "every_s": 0.5})),
        (Route::Predict, json!({"scene": scene, "changes": every_kind("a", "b"), "vehicles": ["a", "new 1"], "k": 1})),
        (Route::Predict, json!({"scene": bent})),
        (Route::Predict, json!({"scene": recording, "changes": every_kind("1", "2")})),
        (Route::Explain, json!({"scene": bare, "vehicle": "a", "k": 1})),
        (Route::Explain, json!({"scene": scene, "vehicle": "a", "changes": every_kind("a", "b"), "k": 1})),
        (Route::Explain, json!({"scene": scene, "vehicle": "new 1", "changes": every_kind("a", "b"), "k": 1})),
        (Route::Explain, json!({"scene": recording, "vehicle": "1", "changes": removed, "k": 1})),
    ]
}

/// Every base as it stands, and as what is to be damaged.
fn seeds(_: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let texts = bases().into_iter().map(|(route, body)| {
        let letter: &[u8] = if route == Route::Predict { b"p" } else { b"e" };
        [letter, body.to_string().as_bytes()].concat()
    });
    let kinds = (0..bases().len() as u8).map(|kind| vec![kind]);
    Ok(texts.chain(kinds).collect())
}
