//! Why something could not be scored, written or read.

use std::path::PathBuf;

use gnp_data::{PredictError, WindowId, WindowKey};

/// Why an evaluation, a score file or a prediction file failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvalError {
    /// Nothing to score.
    #[error("there is no window to score; check the split and the recordings")]
    NoWindows,
    /// A window that the set does not hold.
    #[error("no window {id:?} in this set; split the same recordings that are scored")]
    UnknownWindow {
        /// What was asked for.
        id: WindowId,
    },
    /// A metric was asked for at a time at which the windows have no frame.
    #[error(
        "no predicted frame at {horizon_s} s: windows have {t_pred} frames at {rate_hz} Hz; \
         take a rate with whole frames a second and a horizon of at least 1 s"
    )]
    Horizon {
        /// The time asked for, s.
        horizon_s: f64,
        /// Rate of the windows, Hz.
        rate_hz: f64,
        /// Predicted frames of the windows.
        t_pred: usize,
    },
    /// A key of the configuration has a value that cannot be used.
    #[error("evaluation: `{key}` {problem}")]
    Config {
        /// The key.
        key: &'static str,
        /// What is wrong and what to write instead.
        problem: String,
    },
    /// A model that is handed recorded futures was entered where that is not allowed.
    #[error("{model} is handed recorded futures, and protocol `{protocol}` allows none; score it apart")]
    FutureInput {
        /// Name of the model.
        model: String,
        /// Name of the protocol.
        protocol: &'static str,
    },
    /// Two models of one name would share a row.
    #[error("two models are called {model}; give each a name of its own")]
    SameName {
        /// The name.
        model: String,
    },
    /// Two evaluations that are not folds of one.
    #[error("the folds differ in {what}; evaluate the same models under the same protocols in each")]
    NotPooled {
        /// What differs.
        what: &'static str,
    },
    /// A force that a prediction file has no columns for.
    #[error(
        "cannot write {}: its columns are settled, and a later forecast is explained by another force term, `{term}`; \
         write forecasts of one model to one file",
        .path.display()
    )]
    Term {
        /// The file.
        path: PathBuf,
        /// Name of the term.
        term: String,
    },
    /// A model failed.
    #[error("windows from recording {}, vehicle {}, frame {} on", .first.recording, .first.vehicle, .first.t0)]
    Predict {
        /// First window of the batch.
        first: WindowKey,
        /// What the model said.
        #[source]
        source: PredictError,
    },
    /// A model gave more or fewer forecasts than it was given windows.
    #[error("{model} gave {found} forecasts for {windows} windows")]
    Count {
        /// Name of the model.
        model: String,
        /// Windows it was given.
        windows: usize,
        /// Forecasts it gave.
        found: usize,
    },
    /// A forecast that cannot be scored.
    #[error("{model}, recording {}, vehicle {}, frame {}: {problem}", .window.recording, .window.vehicle, .window.t0)]
    Forecast {
        /// Name of the model.
        model: String,
        /// The window.
        window: WindowKey,
        /// What is wrong with the forecast.
        problem: ForecastProblem,
    },
    /// The comparison of two models needs both on the same windows.
    #[error("{a} and {b} cannot be compared by {metric} on {site}: {problem}")]
    Unpaired {
        /// First model.
        a: String,
        /// Second model.
        b: String,
        /// Name of the metric.
        metric: String,
        /// The site.
        site: String,
        /// What is missing or differs.
        problem: &'static str,
    },
    /// Two evaluations of different windows cannot become one.
    #[error("evaluations of {first} and of {second} windows, or of other data, cannot be joined; score the same")]
    OtherWindows {
        /// Windows of the first.
        first: usize,
        /// Windows of the second.
        second: usize,
    },
    /// A comparison was asked for with a model that was not scored.
    #[error("{model} was not scored; scored are {scored}")]
    NotScored {
        /// The model asked for.
        model: String,
        /// Those that were scored.
        scored: String,
    },
    /// The caller's watcher ended the evaluation.
    #[error("the evaluation was stopped; no score was kept")]
    Stopped,
    /// A file could not be read or written.
    #[error("{}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
    /// A score file is not what it should be.
    #[error("{}: not a list of scores", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Line, column and reason.
        #[source]
        source: serde_json::Error,
    },
    /// A file could not be written as Parquet; where the file system refused it, that is [`EvalError::Io`].
    #[error("cannot write {} as Parquet", path.display())]
    WriteParquet {
        /// The file.
        path: PathBuf,
        /// What the Parquet library said.
        #[source]
        source: parquet::errors::ParquetError,
    },
    /// Nothing to join.
    #[error("{}: there are no forecasts to write", path.display())]
    NoParts {
        /// The file that was to be made.
        path: PathBuf,
    },
    /// Parts of a file that do not go together.
    #[error(
        "{} has other columns than {}: they are of different models or versions; predict both anew", path.display(),
        first.display()
    )]
    OtherColumns {
        /// The part.
        path: PathBuf,
        /// The first part.
        first: PathBuf,
    },
    /// A prediction file is not readable Parquet.
    #[error("{}: cannot be read as Parquet{}", path.display(), codec(source))]
    Parquet {
        /// The file.
        path: PathBuf,
        /// What the Parquet library said.
        #[source]
        source: parquet::errors::ParquetError,
    },
    /// A prediction file whose content cannot be used.
    #[error("{}: {problem}", path.display())]
    Predictions {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: PredictionProblem,
    },
}

/// What to do about a codec that this program does not read.
fn codec(source: &parquet::errors::ParquetError) -> &'static str {
    let text = source.to_string();
    if text.contains("isabled feature") || text.contains("compression") {
        "; write it uncompressed or with snappy"
    } else {
        ""
    }
}

/// What is wrong with one forecast.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ForecastProblem {
    /// A forecast needs at least one future.
    #[error("the forecast has no mode")]
    NoModes,
    /// More futures than asked for would make best-of-k too good.
    #[error("{found} modes where at most {asked} were asked for")]
    TooMany {
        /// Modes asked for.
        asked: usize,
        /// Modes given.
        found: usize,
    },
    /// A path of the wrong length.
    #[error("mode {mode} has {found} frames, the window has {needs} to predict")]
    Frames {
        /// Index of the mode.
        mode: usize,
        /// Predicted frames of the window.
        needs: usize,
        /// Frames of the path.
        found: usize,
    },
    /// A position that is no number.
    #[error("mode {mode}, step {step}: position is not finite")]
    NotFinite {
        /// Index of the mode.
        mode: usize,
        /// Step, from 1.
        step: usize,
    },
    /// A probability outside 0 to 1.
    #[error("mode {mode} has probability {probability}, not within 0 to 1")]
    Probability {
        /// Index of the mode.
        mode: usize,
        /// The value.
        probability: f32,
    },
    /// Probabilities that do not sum to 1.
    #[error("probabilities sum to {sum}, not to 1")]
    Sum {
        /// Their sum.
        sum: f64,
    },
    /// Modes out of order.
    #[error(
        "mode {mode} is likelier than the one before it; the prediction comes first, the others by falling probability"
    )]
    Order {
        /// Index of the mode.
        mode: usize,
    },
}

/// What is wrong with a prediction file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PredictionProblem {
    /// Parquet whose parts do not fit each other.
    #[error("is damaged; copy it again, or write it anew")]
    Damaged,
    /// A required column is not there.
    #[error(
        "column `{column}` is missing; needed are scene (or recording), vehicle, t0, mode, probability, step, x, y"
    )]
    MissingColumn {
        /// The column.
        column: &'static str,
    },
    /// A column of the wrong type, or nested.
    #[error("column `{column}` holds {found}, needed is {needs}")]
    ColumnType {
        /// The column.
        column: String,
        /// What it must hold.
        needs: &'static str,
        /// What it holds.
        found: String,
    },
    /// A cell without a usable value.
    #[error("row {row}, column `{column}`: {problem}")]
    Cell {
        /// Row of the file, from 0.
        row: u64,
        /// The column.
        column: String,
        /// What is wrong and what is needed.
        problem: String,
    },
    /// Rows of one mode that do not make a path.
    #[error(
        "recording {}, vehicle {}, frame {}, mode {mode}, row {row}: {problem}",
        .window.recording, .window.vehicle, .window.t0
    )]
    Rows {
        /// The window.
        window: WindowKey,
        /// The mode.
        mode: i64,
        /// Row of the file, from 0.
        row: u64,
        /// What is wrong.
        problem: String,
    },
    /// No row at all.
    #[error("the file holds no prediction")]
    Empty,
}
