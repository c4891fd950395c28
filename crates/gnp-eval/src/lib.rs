//! Metrics, protocols, bootstrap intervals, score tables and prediction files.
//!
//! [`evaluate`] asks models for forecasts window by window and holds them against what happened;
//! the [`Evaluation`] it gives knows the sums of every [`Metric`] by vehicle, from which come values
//! with intervals ([`Score`], `metrics.json`), comparisons ([`Evaluation::comparisons`],
//! `differences.json`) and [`Table`]s, by site and, under `clean`, by [`Manoeuvre`]; the [`Summary`] is
//! one sentence and one small table. Intervals are by driver and, wider, by event. [`Spreads`] make
//! densities of forecasts. Which metrics, and how many futures a model is asked for, is a [`Protocol`].
//! Forecasts go to and come from Parquet by [`PredictionWriter`] and [`read_predictions`]; what was
//! read is a predictor in its turn, so anyone's forecasts can be scored.
//!
//! Lengths in m, times in s, positions in the window's frame (x forward, y to the left, the
//! target's last observed centre is the origin). Every result is the same on any number of threads.

mod bootstrap;
mod case;
mod clusters;
mod comparison;
mod error;
mod evaluate;
mod evaluation;
mod manoeuvre;
mod metric;
mod predictions;
mod protocol;
mod score;
mod spreads;
mod summary;
mod sums;
mod table;

pub use crate::bootstrap::{Bootstrap, Difference, Interval};
pub use crate::case::{Reference, ScoredWindow};
pub use crate::clusters::Clusters;
pub use crate::comparison::{Comparison, Verdict, load_comparisons, save_comparisons};
pub use crate::error::{EvalError, ForecastProblem, PredictionProblem};
pub use crate::evaluate::{Batch, EvalConfig, EvaluatedModel, evaluate};
pub use crate::evaluation::{Evaluation, Setting};
pub use crate::manoeuvre::{BARE_CHANGE_M, BRAKE_MPS2, CHANGE_M, Manoeuvre};
pub use crate::metric::{BEGUN_M, BEGUN_S, Direction, MISS_M, Metric, MetricKind, Unit};
pub use crate::predictions::{
    ColumnInfo, Coverage, Detail, FARTHEST_M, ForecastOf, ForecastWriter, Prediction, PredictionWriter, Predictions,
    Provenance, forecast_columns, join_forecasts, prediction_columns, read_predictions,
};
pub use crate::protocol::Protocol;
pub use crate::score::{ALL_SITES, Score, load_scores, save_scores};
pub use crate::spreads::{Spread, Spreads};
pub use crate::summary::{SiteSummary, Summary, SummaryModels, SummaryRow, SummaryValue};
pub use crate::sums::{MetricSums, VehicleId};
pub use crate::table::{Table, TableCell, TableHead, comparison_tables, csv, tables};
