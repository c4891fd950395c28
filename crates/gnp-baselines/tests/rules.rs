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
    let of_one_site = serde_json::json!({ "pooled": fitted, "sites": {} });
    assert_eq!(kalman.fit(&training).unwrap(), of_one_site);
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
    // Files from before parameters were fitted by site are refused as well.
    assert!(RULES[0].load(&serde_json::json!({ "span_s": 0.8 })).is_err());
    let backwards = serde_json::json!({ "pooled": { "span_s": -1. }, "sites": {} });
    assert!(RULES[0].load(&backwards).err().unwrap().to_string().contains("positive"));
}

/// A vehicle of 20 m/s whose observed frames are off by `noise` m, now ahead, now behind, and whose speed grows by `gain` m/s².
fn driven(site: &str, name: &str, noise: f64, gain: f64) -> Recording {
    let at = |t: f64| {
        let frame = (t * 10.).round();
        let sign = if (frame as i64).rem_euclid(2) == 0 { 1. } else { -1. };
        // The last observed frame is the origin, and true.
        [20. * t + gain * t * t / 2. + if frame < 0. { noise * sign } else { 0. }, 0.]
    };
    let made = road(SHAPE, SHAPE.t_pred, &[Car { from: 0, at: &at }]);
    let meta = gnp_data::RecordingMeta::new(made.meta().dataset, site, name, SHAPE.rate_hz);
    Recording::from_parts(meta, made.roads().to_vec(), made.tracks().to_vec(), made.columns().clone()).unwrap()
}

#[test]
fn each_site_has_the_span_that_suits_it_and_small_sites_what_suits_all() {
    let name = |site: &str, i: usize| format!("{site}-{i}");
    let of = |site: &'static str, count, noise, gain| {
        (0..count).map(move |i| driven(site, &name(site, i), noise, gain)).collect::<Vec<_>>()
    };
    let mut recordings = of("noisy", 20, 0.3, 0.);
    recordings.extend(of("smooth", 20, 0., 1.));
    recordings.extend(of("small", 19, 0., 1.));
    let training: Vec<Window<'_>> = recordings.iter().map(window).collect();
    let velocity = RULES.iter().find(|rule| rule.name() == "constant velocity").unwrap();
    let fitted = velocity.fit(&training).unwrap();
    let span = |value: &Parameters| value["span_s"].as_f64().unwrap();
    // What speeds up is best told from the last frame, what is noisy from many.
    assert_eq!(span(&fitted["sites"]["smooth"]), 0.1);
    assert!(span(&fitted["sites"]["noisy"]) > 1., "{fitted}");
    assert_eq!(fitted["sites"].as_object().unwrap().len(), 2, "19 vehicles are too few: {fitted}");
    // The predictor takes the site's own.
    let predictor = velocity.load(&fitted).unwrap();
    let alone = velocity.load(&velocity.fit(&training[20..40]).unwrap()).unwrap();
    assert_eq!(path(predictor.as_ref(), SHAPE, &recordings[25]), path(alone.as_ref(), SHAPE, &recordings[25]));
    assert!(velocity.fit(&[]).unwrap_err().to_string().contains("training windows"));
}
