//! `figures`: pictures of a finished run, as SVG and PNG.

mod curves;
mod scenes;
pub(crate) mod scores;
pub(crate) mod traffic;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, anyhow};
use gnp_data::{Forecast, Predictor as _, Recording, Split, Window, WindowId, WindowSet};
use gnp_model::Gnp;
use gnp_plot::{Figure, Painter, Source};

use crate::cli::FigureArgs;
use crate::ingest;
use crate::run_folder::write;
use crate::session::Session;
use crate::source;
use crate::stop;

/// Most windows that are forecast for the figures; of more, every n-th is taken.
const MOST: usize = 4000;

/// What figures are made of.
struct Material<'a> {
    session: &'a Session,
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

/// Draws every figure of a run into `--out`.
///
/// # Errors
/// When the run is not finished, other recordings are not of its kind, or a file cannot be written.
pub(crate) fn run(args: &FigureArgs) -> Result<()> {
    let session = Session::finished(&args.run, &args.machine)?;
    let out = args.out.clone().unwrap_or_else(|| session.folder.path("figures"));
    let figures = draw(&session, args.data_dir.as_ref())?;
    save(&figures, &out)?;
    for figure in &figures {
        session.terminal().result(&format!("{}: {}", figure.name, figure.caption));
    }
    session.terminal().note(&format!("{} figures, each as SVG and PNG: {}", figures.len(), out.display()));
    Ok(())
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
pub(crate) fn draw(session: &Session, data_dir: Option<&PathBuf>) -> Result<Vec<Figure>> {
    let config = &session.config;
    let own = &session.folder.state.data;
    // Kept in a folder of their own, which goes when the figures are drawn.
    let other = match data_dir {
        Some(dir) => {
            let place = tempfile::tempdir().context("cannot make a temporary folder")?;
            let report = ingest::run(source::find(config, Some(dir))?, config, place.path(), session.terminal())?;
            Some((report.load(place.path(), session.terminal())?, report.data))
        }
        None => None,
    };
    let (recordings, data) = match &other {
        Some((recordings, data)) => (recordings.as_slice(), data),
        None => (session.recordings()?, own),
    };
    let (set, _) = WindowSet::cut(recordings, &config.windows)?;
    let split =
        if other.is_some() { Split::all_test(&set) } else { Split::load(&set, &session.folder.path("split.json"))? };
    let every = split.test().len().div_ceil(MOST).max(1);
    let ids: Vec<WindowId> = split.test().iter().step_by(every).copied().collect();
    let windows: Vec<Window<'_>> = ids.iter().filter_map(|id| set.get(*id)).collect();
    let neighbours = config.predict.neighbours.without_future();
    let gnp =
        Gnp::load(session.folder.root(), neighbours, &session.machine.device)?.selecting(config.predict.selection);
    let forecasts = forecasts(session, &gnp, &windows)?;
    let gnp = gnp.explaining(true);
    let part = if other.is_some() { "" } else { ", test part" };
    let thinned = if every > 1 { format!(", one window of {every}") } else { String::new() };
    let source = Source { words: format!("{}{part}{thinned}", data.words), simulated: data.simulated };
    let material = Material {
        session,
        gnp: &gnp,
        recordings,
        set: &set,
        ids: &ids,
        windows: &windows,
        forecasts: &forecasts,
        source,
    };
    let mut figures = scenes::figures(&material)?;
    figures.push(curves::modes(&material));
    figures.push(curves::error_by_horizon(session)?);
    figures.push(curves::reliability(&material));
    figures.push(curves::learning(session)?);
    figures.extend(traffic::time_space(&material)?);
    Ok(figures)
}

/// Forecasts of all windows, a batch at a time.
fn forecasts(session: &Session, gnp: &Gnp, windows: &[Window<'_>]) -> Result<Vec<Forecast>> {
    let work = session.terminal().work("forecasts", windows.len() as u64, "windows");
    let mut all = Vec::with_capacity(windows.len());
    for batch in windows.chunks(session.config.evaluate.batch) {
        stop::check()?;
        let seen: Vec<_> = batch.iter().map(Window::observation).collect();
        all.extend(gnp.predict(&seen, session.config.predict.k).map_err(|error| anyhow!(error))?);
        work.at(all.len() as u64, "");
    }
    Ok(all)
}
