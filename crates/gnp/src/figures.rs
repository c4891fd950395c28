//! `figures`: pictures of a finished run, as SVG and PNG.

mod causes;
mod curves;
mod scenes;
pub(crate) mod scores;
pub(crate) mod traffic;

use std::fs;
use std::path::Path;

use crate::error::{Context as _, Result};
use gnp_data::{Forecast, Observation, Predictor as _, Recording, Split, Window, WindowId, WindowSet};
use gnp_model::Gnp;
use gnp_plot::{Figure, Painter, Source};

use crate::data::ingest;
use crate::data::source;
use crate::report::renew;
use crate::run::Run;
use crate::run::folder::{DataState, Stage, write};

/// Folder of the figures in a run folder.
pub(crate) const FIGURES: &str = "figures";

/// Most windows that are forecast for the figures; of more, every n-th is taken.
const MOST: usize = 4000;

/// What figures are made of.
struct Material<'a> {
    run: &'a Run,
    gnp: &'a Gnp,
    recordings: &'a [Recording],
    set: &'a WindowSet<'a>,
    /// Evaluated windows, thinned to at most [`MOST`].
    ids: &'a [WindowId],
    windows: &'a [Window<'a>],
    /// One a window, without forces.
    forecasts: &'a [Forecast],
    source: Source,
}

/// Draws every figure of a run, on its own recordings or on those of `data`, and writes each as SVG and PNG to `out`. Where
/// those are the run's own figures, it is written down what they should be, and a report that is not there is written, too.
///
/// # Errors
/// When a file of the run or the recordings cannot be used, or a figure cannot be written.
pub fn draw_figures(run: &mut Run, data: Option<&Path>, out: &Path) -> Result<Vec<Figure>> {
    let figures = draw(run, data)?;
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let place = |path: &Path| fs::canonicalize(path).ok();
    if place(out) == place(&run.folder.path(FIGURES)) {
        if data.is_some() {
            run.rewriting(Stage::Report, |run| Ok(((), save_own(run, &figures)?)))?;
        } else {
            renew(run, &figures, |run| save_own(run, &figures))?;
        }
    } else {
        save(&figures, out)?;
    }
    Ok(figures)
}

/// Writes figures to the folder of a run; returns their names from there.
pub(crate) fn save_own(run: &Run, figures: &[Figure]) -> Result<Vec<String>> {
    save(figures, &run.folder.path(FIGURES))?;
    let files = |figure: &Figure| ["svg", "png"].map(|kind| format!("{FIGURES}/{}.{kind}", figure.name));
    Ok(figures.iter().flat_map(files).collect())
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
    let subset = config.evaluate.subset;
    let (all, mut source) = if other.is_some() {
        let source = Source { words: data.description.clone(), simulated: data.simulated };
        (Split::all_test(&set).test().to_vec(), source)
    } else {
        (run.split(&set)?.subset(subset).to_vec(), source_of(data, subset.name()))
    };
    let every = all.len().div_ceil(MOST).max(1);
    let ids: Vec<WindowId> = all.iter().step_by(every).copied().collect();
    let windows: Vec<Window<'_>> = ids.iter().filter_map(|id| set.get(*id)).collect();
    let gnp = run.model()?;
    let seen: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
    let forecasts = forecasts(run, &gnp, &seen, "forecasts", |_| {})?;
    let gnp = gnp.explaining(true);
    if every > 1 {
        source.words += &format!(", one window of {every}");
    }
    let material =
        Material { run, gnp: &gnp, recordings, set: &set, ids: &ids, windows: &windows, forecasts: &forecasts, source };
    let mut figures = scenes::figures(&material)?;
    figures.extend(causes::figures(&material)?);
    figures.push(curves::modes(&material));
    figures.push(curves::error_by_horizon(run)?);
    figures.push(curves::reliability(&material));
    figures.push(curves::learning(run)?);
    figures.extend(traffic::time_space(&material)?);
    Ok(figures)
}

/// Forecasts of all observations, a batch at a time; `trim` drops from each what need not be kept.
pub(crate) fn forecasts(
    run: &Run,
    gnp: &Gnp,
    seen: &[Observation<'_>],
    what: &str,
    trim: impl Fn(&mut Forecast),
) -> Result<Vec<Forecast>> {
    let work = run.machine.work(what, seen.len(), "forecasts");
    let mut all = Vec::with_capacity(seen.len());
    for batch in seen.chunks(run.config.evaluate.batch) {
        run.machine.stop.check()?;
        let mut found = gnp.predict(batch, run.config.predict.k)?;
        found.iter_mut().for_each(&trim);
        all.extend(found);
        work.at(all.len() as u64, "");
    }
    Ok(all)
}

/// The data of a figure with the subset of the split that it shows.
pub(crate) fn source_of(data: &DataState, subset: &str) -> Source {
    Source { words: format!("{}, {subset} subset", data.description), simulated: data.simulated }
}
