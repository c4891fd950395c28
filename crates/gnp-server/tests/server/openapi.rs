//! The description of the API against the server.

use std::collections::BTreeSet;

use gnp_server::{ProblemKind, Route};
use jsonschema::Validator;
use serde_json::{Value, json};

use super::client::Running;

pub(crate) fn description() -> Value {
    Running::shared().get("/openapi.json").json()
}

/// What holds a value against a schema of the description.
pub(crate) fn schema(description: &Value, name: &str) -> Validator {
    let schema = json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$ref": format!("#/components/schemas/{name}"),
        "components": description["components"],
    });
    jsonschema::validator_for(&schema).unwrap()
}

pub(crate) fn assert_valid(schema: &Validator, value: &Value, what: &str) {
    let errors: Vec<String> =
        schema.iter_errors(value).map(|error| format!("{}: {error}", error.instance_path())).take(5).collect();
    assert!(errors.is_empty(), "{what}: {}", errors.join("\n"));
}

#[test]
fn every_route_is_described_and_every_description_is_a_route() {
    let description = description();
    let described: BTreeSet<(String, String)> = description["paths"]
        .as_object()
        .unwrap()
        .iter()
        .flat_map(|(path, methods)| {
            methods.as_object().unwrap().keys().map(|method| (path.clone(), method.to_uppercase()))
        })
        .collect();
    let routes: BTreeSet<(String, String)> =
        Route::ALL.iter().map(|route| (route.path().to_owned(), route.method().to_owned())).collect();
    assert_eq!(described, routes);
}

#[test]
fn every_problem_is_described_and_the_reverse() {
    let description = description();
    let described: BTreeSet<&str> = description["components"]["schemas"]["Problem"]["properties"]["type"]["enum"]
        .as_array()
        .unwrap()
        .iter()
        .map(|name| name.as_str().unwrap())
        .collect();
    let kinds: Vec<String> = ProblemKind::ALL.iter().map(|kind| format!("urn:gnp:problem:{}", kind.name())).collect();
    assert_eq!(described, kinds.iter().map(String::as_str).collect());
}

#[test]
fn every_example_is_answered_as_described() {
    let description = description();
    let request = schema(&description, "PredictRequest");
    assert!(
        !request.is_valid(&json!({"scene": {"recording": "a", "time_s": 1}, "other": 1})),
        "the schema refuses nothing"
    );
    let server = Running::shared();
    let mut answered = 0;
    for (path, methods) in description["paths"].as_object().unwrap() {
        for (method, operation) in methods.as_object().unwrap() {
            let content = operation["responses"]["200"]["content"].as_object().unwrap();
            let bodies = &operation["requestBody"]["content"]["application/json"];
            let answers = match bodies["examples"].as_object() {
                Some(examples) => {
                    let reference = bodies["schema"]["$ref"].as_str().unwrap();
                    let request = schema(&description, reference.rsplit('/').next().unwrap());
                    let answer = |(name, example): (&String, &Value)| {
                        assert_valid(&request, &example["value"], name);
                        (name.clone(), server.post(path, &example["value"]))
                    };
                    examples.iter().map(answer).collect()
                }
                None => vec![(path.clone(), server.get(&filled(path, &operation["parameters"])))],
            };
            assert!(bodies.is_null() == (method == "get") && !answers.is_empty(), "{path}: no example");
            for (name, answer) in answers {
                assert_eq!(answer.status, 200, "{path}, {name}: {answer:?}");
                let kind = answer.header("content-type").unwrap().split(';').next().unwrap();
                let schema_of = content.get(kind).unwrap_or_else(|| panic!("{path}: {kind} is not described"));
                if let Some(reference) = schema_of["schema"]["$ref"].as_str() {
                    let valid = schema(&description, reference.rsplit('/').next().unwrap());
                    assert_valid(&valid, &answer.json(), &format!("{path}, {name}"));
                }
                answered += 1;
            }
        }
    }
    assert!(answered >= 14, "{answered}");
}

/// A path with the examples of its parameters.
fn filled(path: &str, parameters: &Value) -> String {
    let (mut path, mut query) = (path.to_owned(), Vec::new());
    for parameter in parameters.as_array().into_iter().flatten() {
        let (name, example) = (parameter["name"].as_str().unwrap(), &parameter["example"]);
        let example = example.as_str().map_or_else(|| example.to_string(), str::to_owned);
        if parameter["in"] == "path" {
            path = path.replace(&format!("{{{name}}}"), &example);
        } else {
            query.push(format!("{name}={example}"));
        }
    }
    if query.is_empty() { path } else { format!("{path}?{}", query.join("&")) }
}
