//! Trained models: a model folder, a run, or one that comes with the program.

mod export;

use std::collections::BTreeMap;
use std::path::Path;

use gnp_eval::{Protocol, load_scores};
use gnp_model::{
    CardScore, CardScores, CardWindows, Gnp, ModelCard, ModelError, ModelFolder, NeighbourInput, Precision,
    PredictSettings, TrainingData, TrainingRecord,
};

pub use self::export::{ExportRequest, export};
use crate::config::RunConfig;
use crate::data::IngestSummary;
use crate::error::Result;
use crate::evaluation::fold;
use crate::machine::Machine;
use crate::run::Run;
use crate::run::folder::{RunFolder, Stage};

/// A trained model and what is known of it.
#[derive(Clone, Debug)]
pub struct Model {
    gnp: Gnp,
    card: ModelCard,
}

impl Model {
    /// Opens a model folder, a run folder whose trainings are finished, or, by its name or where nothing is given, a model
    /// that comes with the program ([`gnp_pretrained`]).
    ///
    /// # Errors
    /// [`ModelError::NoModel`](gnp_model::ModelError) in [`Error::Model`](crate::Error) where there is neither;
    /// when a file is missing or differs from what was written, or a training is not finished.
    pub fn open(from: Option<&Path>, machine: &Machine) -> Result<Self> {
        match Place::of(from)? {
            Place::Folder(folder) => Ok(Self { gnp: folder.model(&machine.device)?, card: folder.card().clone() }),
            Place::Run(path) => {
                let run = Run::open_model(path, machine)?;
                Ok(Self { gnp: run.model()?, card: run.card(None)? })
            }
        }
    }

    /// The same model with the products of its force's networks in another precision: [`Gnp::with_precision`].
    ///
    /// # Errors
    /// As there.
    pub fn with_precision(self, precision: Precision) -> Result<Self> {
        Ok(Self { gnp: self.gnp.with_precision(precision)?, ..self })
    }

    /// The predictor.
    #[must_use]
    pub fn gnp(&self) -> &Gnp {
        &self.gnp
    }

    /// What it is.
    #[must_use]
    pub fn card(&self) -> &ModelCard {
        &self.card
    }
}

/// The card of a model, without its networks: as [`Model::open`].
///
/// # Errors
/// As [`Model::open`].
pub fn model_card(from: Option<&Path>, machine: &Machine) -> Result<ModelCard> {
    match Place::of(from)? {
        Place::Folder(folder) => Ok(folder.card().clone()),
        Place::Run(path) => Run::open_model(path, machine)?.card(None),
    }
}

/// Where a model is.
enum Place<'a> {
    Folder(Box<ModelFolder>),
    Run(&'a Path),
}

impl<'a> Place<'a> {
    fn of(from: Option<&'a Path>) -> Result<Self> {
        let name = from.map_or(Some(gnp_pretrained::DEFAULT), |path| path.to_str().filter(|_| !path.exists()));
        if let Some(name) = name
            && let Some(folder) = gnp_pretrained::folder(name)?
        {
            return Ok(Self::Folder(Box::new(folder)));
        }
        let path = from.unwrap_or(Path::new(gnp_pretrained::DEFAULT));
        if !ModelFolder::is_at(path) && RunFolder::is_at(path) {
            return Ok(Self::Run(path));
        }
        // It says what a model is where there is none.
        match ModelFolder::open(path) {
            Err(ModelError::NoModel { path, seen }) => {
                let known = gnp_pretrained::NAMES.join(", ");
                let seen = format!("{seen}, and it is no name of a model that comes with the program ({known})");
                Err(ModelError::NoModel { path, seen }.into())
            }
            opened => Ok(Self::Folder(Box::new(opened?))),
        }
    }
}

impl Run {
    /// What is known of the run's model, as its card; `name` instead of that of its folder. Without recordings, or
    /// before the run was scored, it says less.
    ///
    /// # Errors
    /// When a training is not finished, or a file that is there cannot be used.
    pub fn card(&self, name: Option<&str>) -> Result<ModelCard> {
        let gnp = self.model()?;
        let (state, config) = (&self.folder.state, RunConfig::read(&self.folder.path("config.toml"), &[])?);
        let of_folder = || self.path().file_name().map_or_else(|| "run".into(), |name| name.to_string_lossy());
        let name = name.map_or_else(of_folder, Into::into);
        let data = TrainingData {
            dataset: config.dataset,
            description: state.data.description.clone(),
            simulated: state.data.simulated,
            sites: self.windows_by_site()?,
        };
        let windows = &config.windows;
        let windows =
            CardWindows { rate_hz: windows.rate_hz, observed_s: windows.observed_s, predicted_s: windows.predicted_s };
        let predict = PredictSettings {
            neighbours: match config.predict.neighbours {
                NeighbourInput::Oracle => NeighbourInput::ConstantVelocity,
                blind => blind,
            },
            selection: config.predict.selection,
            trust: gnp.trust(),
            k: config.predict.k,
        };
        let training = TrainingRecord {
            split: split_in_words(&config),
            split_hash: state.split_hash.clone(),
            seed: config.seed,
            configuration: config.to_toml()?,
        };
        let version = &gnp.header().code_version;
        let mut card = ModelCard::new(&name, version, data, windows, predict, training);
        card.scores = self.card_scores(&gnp)?;
        let weights = |name: &&str| Some(((*name).to_owned(), state.files.get(*name)?.seal.clone()));
        card.files = ModelFolder::FILES.iter().filter_map(weights).collect();
        Ok(card)
    }

    /// Windows by site; nothing where the notes of ingest did not travel with the model.
    fn windows_by_site(&self) -> Result<BTreeMap<String, u64>> {
        let mut sites = BTreeMap::new();
        if self.folder.path(INGEST).exists() {
            let ingest: IngestSummary = self.folder.read_json(INGEST)?;
            for report in ingest.recordings {
                *sites.entry(report.quality.site).or_default() += report.windows.windows as u64;
            }
        }
        Ok(sites)
    }

    /// The main scores of the run's own evaluation.
    fn card_scores(&self, gnp: &Gnp) -> Result<CardScores> {
        use gnp_data::Predictor as _;

        const METRICS: [(&str, Option<usize>, &str); 2] =
            [("rmse_at", Some(1), "RMSE"), ("min_fde", Some(6), "minFDE_6")];
        if !self.folder.has(Stage::Evaluate) || !self.folder.path(SCORES).exists() {
            return Ok(CardScores::default());
        }
        let mut rows = Vec::new();
        let scores = load_scores(&self.folder.usable(SCORES)?)?;
        let horizon_s = self.config.windows.predicted_s;
        for score in scores.into_iter().filter(|score| score.protocol == Protocol::Clean && score.manoeuvre.is_none()) {
            let known = METRICS.iter().find(|(metric, k, _)| *metric == score.metric && *k == score.k);
            let Some((.., label)) = known.filter(|_| score.model == gnp.name() && score.horizon_s == horizon_s) else {
                continue;
            };
            rows.push(CardScore {
                site: score.site,
                system: score.model,
                metric: format!("{label} at {horizon_s} s"),
                value: score.value,
                low: score.ci_low,
                high: score.ci_high,
                windows: score.windows,
            });
        }
        let part = self.config.evaluate.subset.name();
        Ok(CardScores { of: format!("Of these weights on the {part} part of the split, protocol `clean`."), rows })
    }
}

const INGEST: &str = "ingest.json";
const SCORES: &str = "metrics.json";

/// How the windows of a run are parted.
fn split_in_words(config: &RunConfig) -> String {
    let split = &config.split;
    let sites: String = split.sites.iter().map(|(site, kind)| format!(", {site} by {}", kind.name())).collect();
    let shares = if split.folds > 1 {
        format!("training and validation share the rest as {} to {}", split.train, split.validation)
    } else {
        let test =
            if split.test > 0. { format!("{} tests", split.test) } else { "nothing is held out to test".to_owned() };
        format!("{} trains, {} chooses the epoch and the trust, {test}", split.train, split.validation)
    };
    format!("by {}{sites}{}: {shares}", split.kind.name(), fold(split))
}
