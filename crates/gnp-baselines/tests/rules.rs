//! The registry of rules, and a rule that is defined outside.

#![allow(clippy::unwrap_used)] // also outside the test functions

#[path = "drivers/road.rs"]
mod road;

use gnp_baselines::{BaselineError, Parameters, RULES, Rule};
use gnp_data::{Forecast, Mode, Observation, PredictError, Predictor, Recording, Window};

use crate::road::{Car, SHAPE, path, road};

/// Ends `ahead` m from the origin, whatever is observed.
struct Teleport {
    ahead: f32,
}

impl Predictor for Teleport {
    fn name(&self) -> &str {
        TELEPORT.name()
    }

    fn predict(&self, observations: &[Observation<'_>], _k: usize) -> Result<Vec<Forecast>, PredictError> {
        let path = |o: &Observation<'_>| vec![[self.ahead, 0.]; o.shape().t_pred];
        let mode = |o| Mode { probability: 1., path: path(o), explanation: None };
        Ok(observations.iter().map(|o| Forecast { modes: vec![mode(o)] }).collect())
    }
}

/// Fitted: the mean of the true ends.
const TELEPORT: Rule = Rule::new(
    "teleport",
    "Every vehicle is at the mean of the training windows' ends at once.",
    |training| {
        let sum: f32 = training.iter().map(|window| window.truth().goal()[0]).sum();
        Ok((sum / training.len().max(1) as f32).into())
    },
    |parameters| {
        let ahead = parameters.as_f64().ok_or_else(|| BaselineError::Rule {
            rule: "teleport".to_owned(),
            source: format!("{parameters} is no distance").into(),
        })?;
        Ok(Box::new(Teleport { ahead: ahead as f32 }))
    },
);

fn recording(speed: f64) -> Recording {
    road(SHAPE, SHAPE.t_pred, &[Car { from: 0, at: &move |t| [speed * t, 0.] }])
}

fn window(recording: &Recording) -> Window<'_> {
    Window::new(recording, SHAPE, 0, SHAPE.t_obs - 1).unwrap()
}

#[test]
fn every_rule_is_loaded_from_what_it_fitted_even_through_text() {
    let recordings = [recording(12.), recording(20.)];
    let training = recordings.each_ref().map(window);
    for rule in RULES.iter().chain([&TELEPORT]) {
        let fitted = rule.fit(&training).unwrap();
        let read: Parameters = serde_json::from_str(&fitted.to_string()).unwrap();
        let (direct, read) = (rule.load(&fitted).unwrap(), rule.load(&read).unwrap());
        assert_eq!(direct.name(), rule.name());
        assert!(rule.description().ends_with('.'), "{}", rule.description());
        let paths = [direct, read].map(|predictor| path(predictor.as_ref(), SHAPE, &recordings[0]));
        assert_eq!(paths[0], paths[1], "{}", rule.name());
    }
}

#[test]
fn names_are_unique_and_those_of_the_tables() {
    let names: Vec<&str> = RULES.iter().map(Rule::name).collect();
    assert_eq!(names, ["constant velocity", "constant acceleration", "Kalman filter", "IDM", "platoon"]);
}

#[test]
fn the_kalman_filter_of_the_registry_is_a_fitted_one() {
    let recordings = [recording(12.), recording(20.)];
    let training = recordings.each_ref().map(window);
    let kalman = RULES.iter().find(|rule| rule.name() == "Kalman filter").unwrap();
    let fitted = gnp_baselines::Kalman::fit(&training).unwrap();
    assert_eq!(kalman.fit(&training).unwrap(), serde_json::to_value(fitted).unwrap());
    assert_ne!(fitted.noise(), gnp_baselines::Kalman::NOISE);
    assert!(kalman.fit(&[]).unwrap_err().to_string().contains("training windows"));
}

#[test]
fn a_rule_of_another_crate_predicts_what_it_learnt() {
    let recordings = [recording(10.), recording(20.)];
    let training = recordings.each_ref().map(window);
    let predictor = TELEPORT.load(&TELEPORT.fit(&training).unwrap()).unwrap();
    let end = path(predictor.as_ref(), SHAPE, &recordings[0])[29][0];
    assert!((end - 45.).abs() < 1e-3, "{end}");
}

#[test]
fn foreign_parameters_are_refused_with_the_name_of_the_rule() {
    for rule in RULES {
        for parameters in [serde_json::json!({ "speed": 3 }), serde_json::json!(7), Parameters::Null] {
            let error = rule.load(&parameters).err().unwrap().to_string();
            assert!(error.contains(rule.name()), "{error}");
        }
    }
    let backwards = serde_json::json!({ "span_s": -1. });
    assert!(RULES[0].load(&backwards).err().unwrap().to_string().contains("positive"));
}
