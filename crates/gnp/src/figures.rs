//! `figures`: pictures of a finished run, as SVG and PNG.

mod curves;
mod scenes;
pub(crate) mod scores;
pub(crate) mod traffic;

use std::fs;
use std::path::Path;

use crate::error::{Context as _, Result};
use gnp_data::{Forecast, Predictor as _, Recording, Split, Window, WindowId, WindowSet};
use gnp_model::Gnp;
use gnp_plot::{Figure, Painter, Source};

use crate::data::ingest;
use crate::data::source;
use crate::run::Run;
use crate::run::folder::write;

/// Most windows that are forecast for the figures; of more, every n-th is taken.
const MOST: usize = 4000;

/// What figures are made of.
struct Material<'a> {
    run: &'a Run,
    gnp: &'a Gnp,
    recordings: &'a [Recording],
    set: &'a WindowSet<'a>,
    /// Test windows, thinned to at most [`MOST`].
    ids: &'a [WindowId],
    windows: &'a [Window<'a>],
    /// One a window, without forces.
    forecasts: &'a [Forecast],
    source: Source,
}

/// Draws every figure of a run, on its own recordings or on those of `data`, and writes each as SVG and PNG to `out`.
///
/// # Errors
/// When a file of the run or the recordings cannot be used, or a figure cannot be written.
pub fn draw_figures(run: &Run, data: Option<&Path>, out: &Path) -> Result<Vec<Figure>> {
    let figures = draw(run, data)?;
    save(&figures, out)?;
    Ok(figures)
}

/// Writes each figure to a folder, as SVG and as PNG.
///
/// # Errors
/// When one cannot be painted or written.
pub(crate) fn save(figures: &[Figure], out: &Path) -> Result<()> {
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let painter = Painter::new();
    for figure in figures {
        write(&out.join(format!("{}.svg", figure.name)), figure.svg.as_bytes())?;
        write(&out.join(format!("{}.png", figure.name)), &painter.png(figure)?)?;
    }
    Ok(())
}

/// All figures of a run, on its own recordings or on those of `data_dir`.
///
/// # Errors
/// When a file of the run or the recordings cannot be used.
pub(crate) fn draw(run: &Run, data_dir: Option<&Path>) -> Result<Vec<Figure>> {
    let config = &run.config;
    let own = &run.folder.state.data;
    // Kept in a folder of their own, which goes when the figures are drawn.
    let other = match data_dir {
        Some(dir) => {
            let place = tempfile::tempdir().context("cannot make a temporary folder")?;
            let report = ingest::run(source::find(config, Some(dir))?, config, place.path(), &run.machine)?;
            Some((report.load(place.path(), &run.machine)?, report.data))
        }
        None => None,
    };
    let (recordings, data) = match &other {
        Some((recordings, data)) => (recordings.as_slice(), data),
        None => (run.recordings()?, own),
    };
    let (set, _) = WindowSet::cut(recordings, &config.windows)?;
    let split = if other.is_some() { Split::all_test(&set) } else { run.split(&set)? };
    let every = split.test().len().div_ceil(MOST).max(1);
    let ids: Vec<WindowId> = split.test().iter().step_by(every).copied().collect();
    let windows: Vec<Window<'_>> = ids.iter().filter_map(|id| set.get(*id)).collect();
    let gnp = run.model()?;
    let forecasts = forecasts(run, &gnp, &windows)?;
    let gnp = gnp.explaining(true);
    let part = if other.is_some() { "" } else { ", test part" };
    let thinned = if every > 1 { format!(", one window of {every}") } else { String::new() };
    let source = Source { words: format!("{}{part}{thinned}", data.description), simulated: data.simulated };
    let material =
        Material { run, gnp: &gnp, recordings, set: &set, ids: &ids, windows: &windows, forecasts: &forecasts, source };
    let mut figures = scenes::figures(&material)?;
    figures.push(curves::modes(&material));
    figures.push(curves::error_by_horizon(run)?);
    figures.push(curves::reliability(&material));
    figures.push(curves::learning(run)?);
    figures.extend(traffic::time_space(&material)?);
    Ok(figures)
}

/// Forecasts of all windows, a batch at a time.
fn forecasts(run: &Run, gnp: &Gnp, windows: &[Window<'_>]) -> Result<Vec<Forecast>> {
    let work = run.machine.work("forecasts", windows.len(), "windows");
    let mut all = Vec::with_capacity(windows.len());
    for batch in windows.chunks(run.config.evaluate.batch) {
        run.machine.stop.check()?;
        let seen: Vec<_> = batch.iter().map(Window::observation).collect();
        all.extend(gnp.predict(&seen, run.config.predict.k)?);
        work.at(all.len() as u64, "");
    }
    Ok(all)
}
