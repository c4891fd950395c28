//! Several runs as one predictor: every vehicle is predicted by one that was not trained on it.
use crate::error::Result;
use crate::run::Run;
use gnp_data::{Forecast, Observation, PredictError, Predictor};
use gnp_model::Gnp;
use std::collections::BTreeSet;

/// Runs with the drivers, by site and number, that each was trained or chosen on.
pub(super) struct Folds {
    models: Vec<(Gnp, BTreeSet<(String, u32)>)>,
}

impl Folds {
    /// The models of runs.
    ///
    /// # Errors
    /// When a run cannot be used.
    pub(super) fn new(runs: &[Run]) -> Result<Self> {
        let mut models = Vec::new();
        for run in runs {
            let set = run.windows()?;
            let split = run.split(&set)?;
            let windows = split.train().iter().chain(split.validation()).filter_map(|id| set.get(*id));
            let seen = windows.map(|window| {
                let observation = window.observation();
                (observation.site().to_owned(), observation.vehicle())
            });
            models.push((run.model()?, seen.collect()));
        }
        Ok(Self { models })
    }
}

impl Predictor for Folds {
    fn name(&self) -> &'static str {
        "gnp"
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let mut forecasts = vec![Forecast::default(); observations.len()];
        let mut by_model: Vec<Vec<usize>> = vec![Vec::new(); self.models.len()];
        for (place, observation) in observations.iter().enumerate() {
            let key = (observation.site().to_owned(), observation.vehicle());
            let Some(model) = self.models.iter().position(|(_, seen)| !seen.contains(&key)) else {
                let problem =
                    format!("every run was trained on vehicle {} of {}; give runs of other folds", key.1, key.0);
                return Err(PredictError::Model { model: self.name().to_owned(), source: problem.into() });
            };
            by_model[model].push(place);
        }
        for ((model, _), places) in self.models.iter().zip(by_model) {
            if places.is_empty() {
                continue;
            }
            let seen: Vec<Observation<'_>> = places.iter().map(|place| observations[*place]).collect();
            for (place, forecast) in places.into_iter().zip(model.predict(&seen, k)?) {
                forecasts[place] = forecast;
            }
        }
        Ok(forecasts)
    }
}
