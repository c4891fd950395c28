//! Score files: `metrics.json`.

use std::path::Path;

use gnp_data::Dataset;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::EvalError;
use crate::manoeuvre::Manoeuvre;
use crate::protocol::Protocol;

/// In place of a site: all sites together.
pub const ALL_SITES: &str = "all";

/// One number: a metric of one model on one site under one protocol.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Score {
    /// The data family.
    pub dataset: Dataset,
    /// The site, such as `us-101`, or [`ALL_SITES`].
    pub site: String,
    /// Which windows of the site; null for all of them.
    pub manoeuvre: Option<Manoeuvre>,
    /// Name of the model.
    pub model: String,
    /// Seeds with which it was trained: windows are averaged over them, and the intervals are wider by what trainings
    /// differ.
    #[serde(default = "one_seed")]
    pub seeds: usize,
    /// The protocol.
    pub protocol: Protocol,
    /// Name of the metric, such as `rmse_at`.
    pub metric: String,
    /// Modes chosen from; null where all modes enter.
    pub k: Option<usize>,
    /// Time at which, or up to which, it was measured, s.
    pub horizon_s: f64,
    /// The value.
    pub value: f64,
    /// Lower end of the 95 % interval by driver; null with fewer than two drivers.
    pub ci_low: Option<f64>,
    /// Upper end of the 95 % interval by driver; null with fewer than two drivers.
    pub ci_high: Option<f64>,
    /// Lower end of the 95 % interval by event; null with fewer than three events.
    #[serde(default)]
    pub event_ci_low: Option<f64>,
    /// Upper end of the 95 % interval by event; null with fewer than three events.
    #[serde(default)]
    pub event_ci_high: Option<f64>,
    /// Windows that entered.
    pub windows: u64,
    /// Drivers that entered: a vehicle that is in several recordings counts once.
    pub vehicles: usize,
    /// Events that entered; 0 in files that do not say.
    #[serde(default)]
    pub events: usize,
    /// Whether any recording that was scored is simulated.
    pub simulated: bool,
    /// Whether the model is handed recorded futures.
    pub uses_future: bool,
}

/// Seeds in files written before a system could have several.
fn one_seed() -> usize {
    1
}

/// Writes scores as a JSON array, one a line; the file appears whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn save_scores(path: &Path, scores: &[Score]) -> Result<(), EvalError> {
    save_lines(path, scores)
}

/// Writes a JSON array, one item a line.
pub(crate) fn save_lines<T: Serialize>(path: &Path, items: &[T]) -> Result<(), EvalError> {
    let mut text = String::from("[");
    for (i, item) in items.iter().enumerate() {
        let line = serde_json::to_string(item).map_err(|source| EvalError::Json { path: path.into(), source })?;
        text += if i == 0 { "\n" } else { ",\n" };
        text += &line;
    }
    text += "\n]\n";
    gnp_file::save(path, text.as_bytes()).map_err(|source| EvalError::Io { path: path.into(), source })
}

/// Reads what [`save_scores`] wrote.
///
/// # Errors
/// When the file cannot be read or is not a list of scores.
pub fn load_scores(path: &Path) -> Result<Vec<Score>, EvalError> {
    load_lines(path)
}

/// Reads what [`save_lines`] wrote.
pub(crate) fn load_lines<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, EvalError> {
    let text = std::fs::read_to_string(path).map_err(|source| EvalError::Io { path: path.into(), source })?;
    serde_json::from_str(&text).map_err(|source| EvalError::Json { path: path.into(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(k: Option<usize>, ci: Option<f64>) -> Score {
        Score {
            dataset: Dataset::HIGHD,
            site: "highd-2".to_owned(),
            manoeuvre: k.map(|_| Manoeuvre::Left),
            model: "gnp".to_owned(),
            seeds: k.unwrap_or(1),
            protocol: Protocol::Clean,
            metric: "min_fde".to_owned(),
            k,
            horizon_s: 5.,
            value: 0.1 + 0.2,
            ci_low: ci,
            ci_high: ci.map(|low| low + 1.),
            event_ci_low: ci.map(|low| low - 1.),
            event_ci_high: ci.map(|low| low + 2.),
            windows: 120,
            vehicles: 7,
            events: 3,
            simulated: true,
            uses_future: false,
        }
    }

    #[test]
    fn scores_come_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.json");
        let scores = [score(Some(6), Some(0.25)), score(None, None)];
        save_scores(&path, &scores).unwrap();
        assert_eq!(load_scores(&path).unwrap(), scores);
        let json: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let keys: Vec<&str> = json[1].as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(keys.len(), 19);
        assert_eq!((&json[0]["manoeuvre"], &json[1]["manoeuvre"]), (&"left".into(), &serde_json::Value::Null));
        assert_eq!(json[0]["dataset"], "highd");
        assert_eq!(json[0]["protocol"], "clean");
        assert!(json[1]["k"].is_null() && json[1]["ci_low"].is_null());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
    }

    #[test]
    fn older_files_are_of_one_seed_and_say_nothing_of_events() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.json");
        let score = Score { events: 0, ..score(None, None) };
        save_scores(&path, std::slice::from_ref(&score)).unwrap();
        let mut text = std::fs::read_to_string(&path).unwrap();
        for added in ["\"seeds\":1,", "\"event_ci_low\":null,", "\"event_ci_high\":null,", "\"events\":0,"] {
            assert!(text.contains(added), "{added}: {text}");
            text = text.replace(added, "");
        }
        std::fs::write(&path, text).unwrap();
        assert_eq!(load_scores(&path).unwrap(), [score]);
    }

    #[test]
    fn no_scores_are_an_empty_list() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.json");
        save_scores(&path, &[]).unwrap();
        assert_eq!(load_scores(&path).unwrap(), []);
    }

    #[test]
    fn a_foreign_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.json");
        std::fs::write(&path, "[{\"site\": \"us-101\"}]").unwrap();
        let error = load_scores(&path).unwrap_err();
        assert!(matches!(error, EvalError::Json { .. }) && error.to_string().contains("other.json"), "{error}");
        assert!(matches!(load_scores(&folder.path().join("none.json")), Err(EvalError::Io { .. })));
    }
}
