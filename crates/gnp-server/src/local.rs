//! What the server answers to a body, without a network.

use gnp::Model;
use gnp_data::Recording;
use serde::Serialize;
use serde_json::Value;

use crate::app::App;
use crate::config::ServerConfig;
use crate::error::ServerError;
use crate::explain::ExplainRequest;
use crate::limits::parse;
use crate::predict::PredictRequest;
use crate::problem::Problem;

/// What a [`Server`](crate::Server) answers to the bodies of requests, worked out on the caller's thread: for programs that try
/// what it makes of any bytes. Headers and limits of requests are not looked at.
#[derive(Debug)]
pub struct Local(App);

/// An answer, as `openapi.json` describes it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LocalAnswer {
    /// Its status.
    pub status: u16,
    /// Its body.
    pub body: Value,
}

impl Local {
    /// As [`Server::bind`](crate::Server::bind); address and port are not used.
    ///
    /// # Errors
    /// When a recording cannot be used, or the model has no card that can be said.
    pub fn new(config: ServerConfig, model: Model, recordings: Vec<Recording>) -> Result<Self, ServerError> {
        App::new(config, model, recordings).map(Self)
    }

    /// What `POST /v1/predict` answers to a body.
    ///
    /// # Errors
    /// [`ServerError::Answer`] for an answer that has no JSON form.
    pub fn predict(&self, body: &[u8]) -> Result<LocalAnswer, ServerError> {
        let asked = parse::<PredictRequest>(body);
        answered(asked.and_then(|asked| self.0.turns.here(|workspace| asked.answer(&self.0, workspace))))
    }

    /// What `POST /v1/explain` answers to a body.
    ///
    /// # Errors
    /// As [`Local::predict`].
    pub fn explain(&self, body: &[u8]) -> Result<LocalAnswer, ServerError> {
        answered(parse::<ExplainRequest>(body).and_then(|asked| asked.answer(&self.0)))
    }
}

fn answered<T: Serialize>(answer: Result<T, Problem>) -> Result<LocalAnswer, ServerError> {
    let (status, body) = match answer {
        Ok(answer) => (200, serde_json::to_value(answer)),
        Err(problem) => (problem.kind().status(), serde_json::to_value(problem.details())),
    };
    Ok(LocalAnswer { status, body: body.map_err(ServerError::Answer)? })
}

#[cfg(test)]
mod tests {
    use gnp::Machine;

    use super::*;

    #[test]
    fn a_body_is_answered_or_refused_as_described() {
        let model = Model::open(None, &Machine::default()).unwrap();
        let local = Local::new(ServerConfig::default(), model, Vec::new()).unwrap();
        let track = br#"{"scene":{"vehicles":[{"id":"a","track":[[0,0,2],[0.1,2,2],[0.2,4,2]]}]}}"#;
        let good = local.predict(track).unwrap();
        assert_eq!((good.status, good.body["forecasts"][0]["id"].as_str()), (200, Some("a")));
        let bad = local.explain(track).unwrap();
        assert_eq!((bad.status, bad.body["type"].as_str()), (422, Some("urn:gnp:problem:invalid-request")));
        // A name may be as long as a body; what is said of it is not.
        let long = format!(r#"{{"scene":{{"{}":1}}}}"#, "x".repeat(100_000));
        let long = local.predict(long.as_bytes()).unwrap();
        assert!(long.status == 422 && long.body.to_string().len() < 4000, "{}", long.body.to_string().len());
    }
}
