//! Prediction files (Parquet): any bytes, made-up forecasts by the project's writer, and damaged files of both kinds.

use arbitrary::{Arbitrary, Unstructured};
use gnp_data::{Dataset, Forecast, Mode, Predictor as _, WindowKey, WindowSet};
use gnp_eval::{Bootstrap, Detail, EvalConfig, EvaluatedModel, PredictionWriter, Predictions, Protocol, Provenance};
use gnp_eval::{evaluate, read_predictions};

use crate::finding::promise;
use crate::made::{Number, Rarely, kind, road, windows};
use crate::{Finding, Scratch, Target, checks, model};

pub(super) const TARGET: Target = Target {
    name: "predictions",
    about: "prediction files, to forecasts and scores",
    run,
    seeds,
    words: &["PAR1", "probability", "mode_order", "prediction_first", "scene", "\u{15}\u{4}"],
};

/// Forecasts, and what becomes of their file.
#[derive(Arbitrary, Debug)]
struct Made {
    windows: Vec<MadeWindow>,
    damage: Rarely<Vec<(u16, u8)>>,
}

#[derive(Arbitrary, Debug)]
struct MadeWindow {
    elsewhere: Rarely<bool>,
    vehicle: u8,
    t0: u8,
    segment: Rarely<u16>,
    steps: Rarely<u8>,
    modes: [MadeMode; 3],
    probability: Rarely<[f32; 3]>,
}

#[derive(Arbitrary, Debug)]
struct MadeMode {
    speed: Number,
    odd: Rarely<(u8, f32)>,
}

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    if kind == b'a' {
        return read(scratch, rest);
    }
    let mut bytes = Unstructured::new(rest);
    if kind.is_multiple_of(2) {
        let Ok(damage) = bytes.arbitrary::<Vec<(u16, u8)>>() else { return Ok(()) };
        return read(scratch, &damaged(explained(scratch)?, &damage));
    }
    let Ok(made) = Made::arbitrary(&mut bytes) else { return Ok(()) };
    let file = scratch.made("made.parquet");
    let mut writer = PredictionWriter::create(&file, &provenance()).map_err(Finding::case)?;
    for window in &made.windows {
        writer.write(&window.key(), [1., 2.], &window.forecast()).map_err(Finding::case)?;
    }
    writer.finish().map_err(Finding::case)?;
    read(scratch, &damaged(std::fs::read(file)?, &made.damage.0.unwrap_or_default()))
}

fn provenance() -> Provenance {
    Provenance { model: "made up".into(), dataset: Dataset::NGSIM, rate_hz: 10., simulated: false, uses_future: false }
}

/// Bytes replaced, counted round.
fn damaged(mut file: Vec<u8>, damage: &[(u16, u8)]) -> Vec<u8> {
    for (at, byte) in damage {
        let at = usize::from(*at) % file.len().max(1);
        if let Some(place) = file.get_mut(at) {
            *place = *byte;
        }
    }
    file
}

impl MadeWindow {
    fn key(&self) -> WindowKey {
        let recording = if self.elsewhere.or(false) { "elsewhere" } else { "case" };
        let vehicle = [1, 2, 5, 9][usize::from(self.vehicle % 4)];
        WindowKey { recording: recording.into(), vehicle, segment: self.segment.or(0), t0: 2 + u32::from(self.t0 % 2) }
    }

    fn forecast(&self) -> Forecast {
        let steps = self.steps.or(10) % 24;
        let probabilities = self.probability.or([0.5, 0.25, 0.25]);
        let mode = |(mode, probability): (&MadeMode, f32)| {
            let point = |step: u8| {
                let odd = mode.odd.0.filter(|(at, _)| at % 24 == step).map(|(_, value)| value);
                [odd.unwrap_or(mode.speed.0 * 0.1 * f32::from(step + 1)), 0.]
            };
            Mode { probability, path: (0..steps).map(point).collect(), explanation: None }
        };
        Forecast { modes: self.modes.iter().zip(probabilities).map(mode).collect() }
    }
}

/// A file with what moved the vehicles, by a tiny model.
fn explained(scratch: &Scratch) -> Result<Vec<u8>, Finding> {
    let file = scratch.made("explained.parquet");
    if !file.exists() {
        let folder = model::saved(scratch)?;
        let folder = folder[0].parent().ok_or_else(|| Finding::Case("no folder".to_owned()))?;
        let model = model::load(folder).map_err(Finding::case)?.explaining(true);
        let recordings = [road("case")?];
        let seen = model::seen(&recordings)?;
        let forecasts = model.predict(&seen, 2).map_err(Finding::case)?;
        let mut writer = PredictionWriter::create(&file, &provenance()).map_err(Finding::case)?;
        for (seen, forecast) in seen.iter().zip(&forecasts) {
            writer.write(&seen.key(), seen.origin(), forecast).map_err(Finding::case)?;
        }
        writer.finish().map_err(Finding::case)?;
    }
    Ok(std::fs::read(file)?)
}

fn read(scratch: &Scratch, bytes: &[u8]) -> Result<(), Finding> {
    let file = scratch.only("case.parquet", bytes)?;
    let paths = match read_predictions(&file, Detail::Paths) {
        Ok(predictions) => Some(predictions),
        Err(error) => {
            checks::refusal(&error, "case.parquet")?;
            None
        }
    };
    match read_predictions(&file, Detail::Explanations) {
        Ok(predictions) => sound(&predictions)?,
        Err(error) => checks::refusal(&error, "case.parquet")?,
    }
    let Some(predictions) = paths else { return Ok(()) };
    sound(&predictions)?;
    score(&predictions)
}

fn sound(predictions: &Predictions) -> Result<(), Finding> {
    promise(!predictions.is_empty(), || "a prediction file without a prediction".to_owned())?;
    predictions.iter().try_for_each(|prediction| {
        promise(!prediction.forecast.modes.is_empty(), || "a prediction without a future".to_owned())?;
        checks::forecast(&prediction.forecast, "the file", None)
    })
}

/// What scores come out must be finite.
fn score(predictions: &Predictions) -> Result<(), Finding> {
    let recordings = [road("case")?];
    let (set, _) = WindowSet::cut(&recordings, &windows()).map_err(Finding::case)?;
    let ids: Vec<_> = set
        .ids()
        .iter()
        .copied()
        .filter(|id| set.get(*id).is_some_and(|it| predictions.get(&it.key()).is_some()))
        .collect();
    let config = EvalConfig {
        subset: gnp_data::Subset::Test,
        protocols: vec![Protocol::Literature],
        batch: 8,
        bootstrap: Bootstrap { resamples: 2, seed: 1 },
    };
    match evaluate(&set, &ids, &[EvaluatedModel::Predictor(predictions)], &config, &mut |_| Ok(())) {
        Ok(evaluation) => {
            let scores = serde_json::to_string(&evaluation.scores(&config.bootstrap)).map_err(Finding::case)?;
            promise(!scores.contains("\"value\":null"), || format!("a score that is not finite: {scores}"))
        }
        Err(error) => checks::refusal(&error, ""),
    }
}

/// One of each made-up kind: the smallest file of the writer is longer than an input may be.
fn seeds(_: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    Ok(vec![vec![0], vec![1; 64], vec![3; 200]])
}
