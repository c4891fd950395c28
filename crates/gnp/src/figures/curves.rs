//! Figures of numbers: modes, errors, reliability, learning.

use crate::error::Result;
use gnp_eval::{ALL_SITES, Protocol, Score, load_scores};
use gnp_modes::ModeFrame;
use gnp_plot::{
    ChartPanel, Figure, GivenMode, Intentions, Scaling, Series, charts, intentions, reliability as diagram,
    reliability_bins,
};
use gnp_train::History;

use super::scenes::nearest;
use super::{Material, source_of};
use crate::run::Run;
use crate::run::folder::Stage;

/// Bins of the reliability diagram.
const BINS: usize = 10;

pub(super) fn modes(material: &Material<'_>) -> Figure {
    let modes = material.gnp.modes();
    let pairs = |centre: &[f32]| centre.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    let shape = material.gnp.shape();
    let drawn = Intentions {
        centres: (0..modes.len()).filter_map(|i| modes.centre(i).map(pairs)).collect(),
        sizes: modes.sizes.clone(),
        deviation_from: match modes.frame {
            ModeFrame::Position => None,
            ModeFrame::Deviation => Some("constant velocity".to_owned()),
            ModeFrame::PlatoonDeviation => Some("the platoon".to_owned()),
        },
        seconds: shape.t_pred as f64 * shape.dt(),
    };
    intentions(&drawn, &source_of(&material.run.folder.state.data, "training"))
}

/// Top-1 and best of 6 of every model under the clean protocol.
pub(super) fn error_by_horizon(run: &Run) -> Result<Figure> {
    let mut scores = load_scores(&run.folder.usable("metrics.json")?)?;
    scores.retain(|score| score.protocol == Protocol::Clean && score.manoeuvre.is_none());
    let site = if scores.iter().any(|score| score.site == ALL_SITES) {
        ALL_SITES.to_owned()
    } else {
        scores.first().map(|score| score.site.clone()).unwrap_or_default()
    };
    scores.retain(|score| score.site == site);
    let panels = [
        ("rmse_at", 1, "Root mean square error of the prediction", "RMSE, top-1 (m)"),
        (
            "min_fde",
            6,
            "Mean error of the nearest of 6 futures (baselines without a network have one)",
            "error, best of 6 (m)",
        ),
    ];
    let panels = panels.map(|(metric, k, title, y)| ChartPanel {
        title: title.to_owned(),
        x: "time ahead (s)".to_owned(),
        y: y.to_owned(),
        scaling: Scaling::FromZero,
        series: by_model(&scores, metric, k),
    });
    let sites = if site == ALL_SITES { "all sites".to_owned() } else { site };
    let caption = format!(
        "Error against horizon of every model on the same windows of {sites}, protocol clean; bands are 95 % \
         intervals from a bootstrap over drivers."
    );
    Ok(charts(
        "error-by-horizon",
        "Error against horizon",
        &caption,
        &panels,
        &source_of(&run.folder.state.data, run.config.evaluate.subset.name()),
    ))
}

/// Curves in the order in which models first appear.
fn by_model(scores: &[Score], metric: &str, k: usize) -> Vec<Series> {
    let mut curves: Vec<Series> = Vec::new();
    for score in scores.iter().filter(|score| score.metric == metric && score.k == Some(k)) {
        let at = curves.iter().position(|curve| curve.name == score.model).unwrap_or_else(|| {
            curves.push(Series { name: score.model.clone(), points: Vec::new(), band: Vec::new() });
            curves.len() - 1
        });
        curves[at].points.push([score.horizon_s, score.value]);
        curves[at].band.push(score.ci_low.zip(score.ci_high).map(|(low, high)| [low, high]));
    }
    curves
}

pub(super) fn reliability(material: &Material<'_>) -> Figure {
    let mut modes = Vec::new();
    for (window, forecast) in material.windows.iter().zip(material.forecasts) {
        let (right, _) = nearest(forecast, window);
        let key = window.key();
        modes.extend(forecast.modes.iter().enumerate().map(|(i, mode)| GivenMode {
            probability: f64::from(mode.probability),
            right: i == right,
            vehicle: (key.recording.clone(), key.vehicle),
        }));
    }
    let bootstrap = &material.run.config.evaluate.bootstrap;
    let interval = |counts: &[[u64; 2]]| bootstrap.share(counts).map(|interval| [interval.low, interval.high]);
    let k = material.run.config.predict.k;
    diagram(&reliability_bins(&modes, BINS, interval), k, material.windows.len(), &material.source)
}

/// Training loss and the validation score that chooses the epoch, of every stage.
pub(super) fn learning(run: &Run) -> Result<Figure> {
    let mut panels = Vec::new();
    for stage in [Stage::Goal, Stage::Attraction, Stage::Repulsion] {
        let history = History::load(&run.folder.usable(&format!("history-{}.json", stage.name()))?)?;
        let curve = |name: &str, points: Vec<[f64; 2]>| Series { name: name.to_owned(), points, band: Vec::new() };
        let train = history.epochs.iter().map(|e| [e.epoch as f64, f64::from(e.train_loss)]).collect();
        let chosen = |e: &gnp_train::EpochRecord| e.validation.first().map(|s| [e.epoch as f64, f64::from(s.value)]);
        let name = history.epochs.first().and_then(|e| e.validation.first()).map_or("loss", |s| s.name.as_str());
        let unit = if name == "mse" { "mean square (m\u{b2})" } else { "loss" };
        panels.push(ChartPanel {
            title: format!("{}: {name}", stage.name()),
            x: "epoch".to_owned(),
            y: unit.to_owned(),
            scaling: Scaling::Log,
            series: vec![
                curve("training", train),
                curve("validation", history.epochs.iter().filter_map(chosen).collect()),
            ],
        });
    }
    let caption = "Learning curves of the three trainings: loss over the training subset while it changes, and the \
                   validation score that chooses the best epoch.";
    Ok(charts(
        "learning",
        "Learning curves",
        caption,
        &panels,
        &source_of(&run.folder.state.data, "training and validation"),
    ))
}
