//! What a model folder says of its model.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use gnp_data::Dataset;
use gnp_file::Seal;
use serde::{Deserialize, Serialize};

use crate::scene::NeighbourInput;
use crate::select::Selection;

/// What a model is, what it was trained on, how well it does, and what it must not be used for: `card.json` of a model
/// folder, and as text its `README.md`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ModelCard {
    /// Version of the card's layout: [`ModelCard::FORMAT`].
    pub format: u32,
    /// Short name, such as `ngsim`; stands in files of predictions.
    pub name: String,
    /// Version of the program that trained it.
    pub version: String,
    /// What it is, in a line.
    pub title: String,
    /// What it was trained on.
    pub data: TrainingData,
    /// The windows that it predicts from and into.
    pub windows: CardWindows,
    /// How it is used.
    pub predict: PredictSettings,
    /// How it was made.
    pub training: TrainingRecord,
    /// How well it does.
    pub scores: CardScores,
    /// What it was not made for, and what is known to go wrong; a sentence each.
    pub limits: Vec<String>,
    /// Under which terms it may be used.
    pub licence: String,
    /// Size and SHA-256 of each file of weights, by name.
    pub files: BTreeMap<String, Seal>,
}

/// The recordings behind a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingData {
    /// The data family.
    pub dataset: Dataset,
    /// What the recordings are.
    pub description: String,
    /// Whether any of them was made by a simulator.
    pub simulated: bool,
    /// Windows by site, of all parts of the split; empty where it is not known.
    pub sites: BTreeMap<String, u64>,
}

/// Lengths and rate of windows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CardWindows {
    /// Frames per second, Hz.
    pub rate_hz: f64,
    /// Time from the first observed frame to the last one, s.
    pub observed_s: f64,
    /// Time from there to the last predicted frame, s.
    pub predicted_s: f64,
}

/// `[predict]` of the configuration, as it is used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictSettings {
    /// Where neighbours are in the future.
    pub neighbours: NeighbourInput,
    /// Which goals are given when fewer are asked for than there are modes.
    pub selection: Selection,
    /// Share of what the network expects on average beyond the reference path that is believed, 0 to 1.
    pub trust: f32,
    /// Futures a vehicle, unless another number is asked for.
    pub k: usize,
}

/// How a model was made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingRecord {
    /// How the windows were parted, and how many are in each part.
    pub split: String,
    /// SHA-256 of the split.
    pub split_hash: String,
    /// Seed of the run.
    pub seed: u64,
    /// The whole configuration, TOML.
    pub configuration: String,
}

/// Scores, and of what.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CardScores {
    /// On which windows, by which protocol, of which weights: of these, or of others made in the same way.
    pub of: String,
    /// The numbers; none where nothing was scored.
    #[serde(default)]
    pub rows: Vec<CardScore>,
}

/// A score.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CardScore {
    /// The site.
    pub site: String,
    /// The system: the model, or what it is set beside.
    pub system: String,
    /// What was measured, such as `RMSE at 5 s`.
    pub metric: String,
    /// The value, m.
    pub value: f64,
    /// Lower end of its 95 % interval by driver, m.
    #[serde(default)]
    pub low: Option<f64>,
    /// Upper end, m.
    #[serde(default)]
    pub high: Option<f64>,
    /// Windows that entered.
    pub windows: u64,
}

/// What the makers of a model say of it: the part of its card that a program cannot know.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CardWords {
    /// What it is, in a line.
    pub title: String,
    /// Under which terms it may be used.
    pub licence: String,
    /// What it was not made for; a sentence each.
    pub limits: Vec<String>,
    /// How well it does, where that is not measured on the run itself.
    pub scores: Option<CardScores>,
}

impl ModelCard {
    /// Version of the layout that this program writes and reads.
    pub const FORMAT: u32 = 1;

    /// A card without limits and scores, of a model without files yet.
    #[must_use]
    pub fn new(
        name: &str,
        version: &str,
        data: TrainingData,
        windows: CardWindows,
        predict: PredictSettings,
        training: TrainingRecord,
    ) -> Self {
        Self {
            format: Self::FORMAT,
            name: name.to_owned(),
            version: version.to_owned(),
            title: format!("GNP, trained on {}", data.description),
            data,
            windows,
            predict,
            training,
            scores: CardScores::default(),
            limits: Vec::new(),
            licence: "not stated".to_owned(),
            files: BTreeMap::new(),
        }
    }

    /// The same with what its makers say; their scores in place of those it has, where they give some.
    #[must_use]
    pub fn with_words(self, words: CardWords) -> Self {
        let CardWords { title, licence, limits, scores } = words;
        Self { title, licence, limits, scores: scores.unwrap_or(self.scores), ..self }
    }

    /// The card as text, Markdown.
    #[must_use]
    pub fn text(&self) -> String {
        let Self { name, version, title, data, windows, predict, training, scores, limits, licence, files, .. } = self;
        let CardWindows { rate_hz, observed_s, predicted_s } = windows;
        let mut text = format!("# {name}\n\n{title}.\n\n");
        // Formatting into a text cannot fail.
        let mut item = |what: &str, says: &str| {
            let _ = writeln!(text, "- **{what}**: {says}");
        };
        item(
            "Predicts",
            &format!(
                "{predicted_s} s from {observed_s} s observed, at {rate_hz} Hz; {} futures a vehicle unless told otherwise",
                predict.k
            ),
        );
        let sites: Vec<String> = data.sites.iter().map(|(site, windows)| format!("{site} {windows}")).collect();
        let sites = if sites.is_empty() { String::new() } else { format!("; windows by site: {}", sites.join(", ")) };
        item("Data", &format!("{}{sites}", data.description));
        item("Split", &training.split);
        let PredictSettings { neighbours, selection, trust, .. } = predict;
        item(
            "Settings",
            &format!(
                "neighbours `{}`, selection `{}`, trust {trust:.3}; seed {}",
                neighbours.name(),
                selection.name(),
                training.seed
            ),
        );
        item("Trained by", &format!("version {version} of this program; split {}", training.split_hash));
        item("Licence", licence);
        if !limits.is_empty() {
            text += "\n## Limits\n\n";
            limits.iter().for_each(|limit| text += &format!("- {limit}\n"));
        }
        if !scores.rows.is_empty() {
            let _ = write!(text, "\n## Scores\n\n{}\n\n", scores.of);
            text += "| site | system | metric | value, m | 95 % by driver | windows |\n|---|---|---|---:|---:|---:|\n";
            for CardScore { site, system, metric, value, low, high, windows } in &scores.rows {
                let interval = match (low, high) {
                    (Some(low), Some(high)) => format!("{low:.2} to {high:.2}"),
                    _ => String::new(),
                };
                let _ = writeln!(text, "| {site} | {system} | {metric} | {value:.2} | {interval} | {windows} |");
            }
        }
        if !files.is_empty() {
            text += "\n## Files\n\n| file | bytes | SHA-256 |\n|---|---:|---|\n";
            for (name, Seal { bytes, sha256 }) in files {
                let _ = writeln!(text, "| `{name}` | {bytes} | `{sha256}` |");
            }
        }
        text
    }
}
