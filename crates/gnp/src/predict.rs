//! `predict`: forecasts for tracks whose future nobody knows.

pub(crate) mod input;
mod job;
mod moments;
mod output;
mod queue;

use std::collections::BTreeMap;
use std::path::PathBuf;

use gnp_data::{Dataset, TrackOptions};
use gnp_eval::Provenance;
use gnp_model::{Gnp, Precision};

pub(crate) use self::input::Input;
use self::job::Job;
pub use self::moments::{Asked, At, AtError, Forecasted, Unpredicted, forecasts};
pub(crate) use self::moments::{span_s, wrong_rate};
use self::output::Output;
use self::queue::Queue;
use crate::error::{Result, bail};
use crate::machine::Machine;
use crate::model::Model;

/// Which tracks, at which times, by which model, where to.
#[derive(Clone, Debug)]
pub struct PredictRequest {
    /// A file of tracks, or a folder of such files.
    pub input: PathBuf,
    /// A file `NAME.parquet`, or a folder that gets a file a recording.
    pub output: PathBuf,
    /// Model folder, run folder or name of a model that comes with the program; without it, the one that does.
    pub model: Option<PathBuf>,
    /// Format of the tracks; found out where it is not given.
    pub format: Option<Dataset>,
    /// What is known of the road, for formats whose tracks lie in any plane.
    pub tracks: TrackOptions,
    /// At which times.
    pub at: At,
    /// Futures a vehicle; as the model's card says where it is not given.
    pub k: Option<usize>,
    /// Pieces that are worked on at once, each on a thread of its own; as many as there are threads where it is not given.
    /// The output does not depend on it.
    pub jobs: Option<usize>,
    /// What the networks of the model's force multiply in; as the model is set where it is not given, which is f32 but for a run in bf16.
    pub precision: Option<Precision>,
}

impl PredictRequest {
    /// The last moment of each recording of `input`, by the model that comes with the program.
    #[must_use]
    pub fn new(input: impl Into<PathBuf>, output: impl Into<PathBuf>) -> Self {
        let (input, output) = (input.into(), output.into());
        let tracks = TrackOptions::default();
        Self { input, output, model: None, format: None, tracks, at: At::Last, k: None, jobs: None, precision: None }
    }
}

/// What was predicted.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Predicted {
    /// The file, or the folder of the files.
    pub output: PathBuf,
    /// What there is in it.
    pub counts: Counts,
    /// Files of tracks that an earlier, interrupted call had finished.
    pub finished_before: usize,
}

/// How many vehicles at a moment were predicted, and why others were not.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Counts {
    /// Recordings.
    pub recordings: u64,
    /// Forecasts: vehicles at a moment.
    pub forecasts: u64,
    /// Those of them whose past was filled.
    pub filled: u64,
    /// Vehicles at a moment that were not predicted, and moments without a vehicle, by reason.
    pub left_out: BTreeMap<String, u64>,
}

impl Counts {
    /// Adds others.
    pub(crate) fn add(&mut self, more: &Self) {
        self.recordings += more.recordings;
        self.forecasts += more.forecasts;
        self.filled += more.filled;
        for (reason, count) in &more.left_out {
            *self.left_out.entry(reason.clone()).or_default() += count;
        }
    }

    /// In a sentence or two.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Self { recordings, forecasts, filled, left_out } = self;
        let plural = |count: u64, what: &str| if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") };
        let filled =
            if *filled > 0 { format!(", {filled} of them from a past that was filled") } else { String::new() };
        let reasons: Vec<String> = left_out.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
        let left_out =
            if reasons.is_empty() { String::new() } else { format!("; not predicted: {}", reasons.join(", ")) };
        format!("{} of {}{filled}{left_out}", plural(*forecasts, "forecast"), plural(*recordings, "recording"))
    }
}

/// Predicts every vehicle of some tracks at the asked times, and writes Parquet ([`gnp_eval::forecast_columns`]). Only rows
/// up to the time of a forecast reach it. Output is written as it is made, into parts beside its place; it stands there when it
/// is whole. The same request again goes on with what an interrupted one left. The same input, model and request give the
/// same bytes on any number of threads.
///
/// # Errors
/// When there are no tracks, or they cannot be read; when a recording does not have the model's rate or a whole multiple of
/// it; when the model cannot be opened, or multiply in the precision asked for, or the output not be written; [`Error::Stopped`](crate::Error).
pub fn predict(request: &PredictRequest, machine: &Machine) -> Result<Predicted> {
    let model = Model::open(request.model.as_deref(), machine)?;
    let model = match request.precision {
        Some(precision) => model.with_precision(precision)?,
        None => model,
    };
    let card = model.card();
    if request.model.is_none() {
        let title = &card.title;
        machine.progress.note(&format!("model: {} ({title}); --model takes another one", card.name));
    }
    let k = request.k.unwrap_or(card.predict.k);
    let most = model.gnp().modes().len();
    if !(1..=most).contains(&k) {
        bail!(Config, "k = {k}: the model has {most} futures; ask for 1 to {most}");
    }
    request.at.check()?;
    let input = Input::find(&request.input, request.format)?;
    input.notes.iter().for_each(|note| machine.progress.note(note));
    let provenance = Provenance {
        model: card.name.clone(),
        dataset: input.dataset,
        rate_hz: card.windows.rate_hz,
        simulated: card.data.simulated || input.sources.iter().any(|source| source.simulated),
        uses_future: false,
    };
    let job = Job::new(&model, request, k, input.dataset)?;
    let output = Output::begin(&request.output, &job, &input, provenance, machine)?;
    let jobs = request.jobs.unwrap_or_else(rayon::current_num_threads).max(1);
    let queue = Queue { input: &input, output: &output, tracks: &request.tracks, at: &request.at, k, machine };
    let (counts, finished_before) = queue.work(model.gnp(), jobs)?;
    if counts.forecasts == 0 {
        bail!(Recordings, "{}: nothing could be predicted: {}", request.input.display(), counts.sentence());
    }
    output.finish(&input)?;
    Ok(Predicted { output: request.output.clone(), counts, finished_before })
}

/// The predictor of one worker: on a thread of its own, or, for a single worker, on all.
fn predictor(gnp: &Gnp, jobs: usize) -> Result<Gnp> {
    let gnp = gnp.clone().explaining(true);
    Ok(if jobs > 1 { gnp.with_threads(1)? } else { gnp })
}
