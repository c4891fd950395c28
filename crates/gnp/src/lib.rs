//! Goal-based neural physics for motorway traffic, from recordings to scored forecasts.
//!
//! A [`Run`] is a folder with everything that was made from some recordings by one [`RunConfig`]: windows and their
//! split, intention modes, weights, forecasts with their forces, scores, figures and a report. [`Plan`] starts one or
//! goes on with one; a [`Machine`] says on which device, who sees the progress ([`Progress`]) and how the work is
//! stopped ([`Stop`]). Nothing here prints or reads a command line; the program `gnp` does.
//!
//! Train on the scenes that come with the project, load the model, predict, evaluate:
//!
//! ```
//! use gnp::{Machine, Plan, Run, RunConfig, Stage};
//! use gnp_data::Predictor as _;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let out = folder.path().join("run");
//! let config = RunConfig::embedded("smoke", &["data.max_recordings=3".parse()?])?;
//! Plan::new(config, None, &out).begin(&Machine::default())?.train()?;
//!
//! let mut run = Run::open(&out, &Machine::default())?;
//! let (model, set) = (run.model()?, run.windows()?);
//! let windows: Vec<_> = run.split(&set)?.test().iter().filter_map(|id| set.get(*id)).collect();
//! let seen: Vec<_> = windows.iter().map(|window| window.observation()).collect();
//! let forecasts = model.predict(&seen, 6)?; // the prediction first, in m from where each vehicle is
//! # assert_eq!(forecasts.len(), windows.len());
//! # drop(windows);
//! # drop(set);
//!
//! run.perform(Stage::Evaluate)?;
//! println!("{}", run.scores()?.summary().ok_or("no scores")?.sentence());
//! # Ok(())
//! # }
//! ```

mod config;
mod convert;
mod data;
mod error;
mod evaluation;
mod explain;
mod figures;
mod inside;
mod machine;
pub mod memory;
mod model;
mod needs;
mod predict;
mod progress;
mod realism;
mod report;
mod run;
mod stages;
mod tables;
pub mod text;
mod traffic;
mod what_if;

pub use crate::config::{DataConfig, GoalSection, PathSection, PredictConfig, RunConfig, Setting};
pub use crate::convert::{Conversion, Converted, convert};
pub use crate::data::{
    IngestSummary, RecordingReport, RecordingsRequest, describe, embedded_folder, recordings, road_options,
};
pub use crate::error::{Error, Result};
pub use crate::evaluation::faithfulness::{Estimate, Faithfulness, faithfulness};
pub use crate::evaluation::{PredictionsOn, Scores, score_predictions, score_recordings};
pub use crate::explain::{AddedCar, Explained, Question, TracksQuestion, WhatIf, explain, explain_tracks};
pub use crate::figures::draw_figures;
pub use crate::machine::Machine;
pub use crate::model::{ExportRequest, Model, export, model_card};
pub use crate::predict::{
    Asked, At, AtError, Counts, Forecasted, PredictRequest, Predicted, Unpredicted, forecasts, predict,
};
pub use crate::progress::{Progress, Silent, Stop, Work};
pub use crate::realism::{RealismPlan, realism, realism_text, save_realism};
pub use crate::report::{Replayed, can_replay, write_replay, write_report};
pub use crate::run::Run;
pub use crate::run::folder::{DataState, RunState, Stage};
pub use crate::run::manifest::RunFile;
pub use crate::stages::Plan;
pub use crate::tables::{CompareRequest, JobReport, JobState, PreparedTable, Recipes, ablate};
pub use crate::traffic::{
    DriveOn, Measured, Measurement, ReplayDrivers, Simulation, measure, scene, simulate, simulate_from,
};
pub use crate::what_if::{
    Change, ChangeError, ChangeField, ChangeProblem, ChangedMoment, ExplainedForecast, Future, LeftOut, Moment,
    NamedChange, Names, SceneForecasts, ScenePredictor, UnknownVehicle, VehicleForecast,
};
pub use gnp_model::{ModelCard, Precision, PrecisionError, Workspace};
pub use gnp_online as online;
pub use gnp_simulation::Scene;

/// The programs of docs/extending.md are compiled and run with the documentation tests.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/extending.md")]
struct Extending;
