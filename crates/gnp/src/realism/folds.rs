//! Several runs as one predictor: every vehicle is predicted by one that was not trained on it.
use crate::error::Result;
use crate::run::Run;
use gnp_data::{Forecast, Observation, PredictError, Predictor};
use gnp_model::Gnp;
use std::collections::{BTreeMap, BTreeSet};

/// Runs, each with the drivers, by site and number, that it was trained or chosen on, and the recordings in which it was.
pub(super) struct Folds {
    models: Vec<(Gnp, Seen)>,
}

type Seen = BTreeMap<(String, u32), BTreeSet<String>>;

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
            let mut seen = Seen::new();
            for window in split.train().iter().chain(split.validation()).filter_map(|id| set.get(*id)) {
                let observation = window.observation();
                let driver = (observation.site().to_owned(), observation.vehicle());
                seen.entry(driver).or_default().insert(observation.recording_name().to_owned());
            }
            models.push((run.model()?, seen));
        }
        Ok(Self { models })
    }

    /// A run that was not trained on the driver; of one who is in scenes of all folds, one that was not trained on this scene.
    fn model(&self, observation: &Observation<'_>) -> Option<usize> {
        let driver = (observation.site().to_owned(), observation.vehicle());
        let scene = observation.recording_name();
        let recording = scene.rsplitn(3, ':').last().unwrap_or(scene);
        let unseen = self.models.iter().position(|(_, seen)| !seen.contains_key(&driver));
        let elsewhere = |(_, seen): &(Gnp, Seen)| seen.get(&driver).is_some_and(|scenes| !scenes.contains(recording));
        unseen.or_else(|| self.models.iter().position(elsewhere))
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
            let Some(model) = self.model(observation) else {
                let (vehicle, scene) = (observation.vehicle(), observation.recording_name());
                let problem =
                    format!("every run was trained on vehicle {vehicle} of {scene}; give runs of other folds");
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
