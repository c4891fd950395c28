//! `simulate` and `measure`: traffic driven by a scene file, and what traffic engineers measure of that or of recordings.

mod drive_on;
mod figures;
mod page;

pub use self::drive_on::{DriveOn, ReplayDrivers, simulate_from};

use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use gnp_data::{Dataset, Recording, TrackOptions, TrackTable, write_fcd, write_fcd_types};
use gnp_measures::{Course, Settings, Summary, Traffic, cell_rows, detector_rows, event_rows};
use gnp_plot::Source;
use gnp_simulation::{Counts, Scene, Simulated, SimulationError, write_parquet};
use serde_json::Value;

use crate::data::source::read_all;
use crate::error::{Context as _, Error, Result, bail};
use crate::inside::inside;
use crate::machine::Machine;
use crate::needs;
use crate::run::draft::sweep;
use crate::run::folder::{write, write_json};

/// Time steps of a cell are at least this, s, and cells at least this long, m: smaller ones hold single vehicles.
const LEAST_CELL: [f64; 2] = [5., 20.];
/// Four times the speed of waves, m/s.
const WAVE_SPEED: f64 = 20.;
/// How many cells of a section there are along the road and over time, at least.
const CELLS: f64 = 40.;

/// What to simulate, and what to write.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// The scene.
    pub scene: Scene,
    /// From which chance comes, one simulation each; those of the scene where there is none here.
    pub seeds: Vec<u64>,
    /// The folder; with several seeds, one in it for each.
    pub out: PathBuf,
    /// Whether to write SUMO's floating car data, which is large.
    pub fcd: bool,
}

/// Which recordings to measure.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Kind of recordings.
    pub dataset: Dataset,
    /// A folder (or file) of them; without it, those that come with the project.
    pub data: Option<PathBuf>,
    /// What is known of the road, for formats whose tracks lie in any plane; the recordings have any rate where none is named.
    pub tracks: TrackOptions,
    /// The folder to write, in which each recording has one of its own.
    pub out: PathBuf,
}

/// What was measured of one recording.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Measured {
    /// The folder.
    pub out: PathBuf,
    /// Everything.
    pub summary: Summary,
    /// A few lines of it.
    pub text: String,
}

/// A scene by the name of an embedded one, or in a file.
///
/// # Errors
/// When the file cannot be read or is no scene; line and column are named.
pub fn scene(of: &str) -> Result<Scene> {
    if let Some((_, text)) = Scene::EMBEDDED.iter().find(|(name, _)| *name == of) {
        return Ok(Scene::parse(text)?);
    }
    let names: Vec<&str> = Scene::EMBEDDED.iter().map(|(name, _)| *name).collect();
    let text = fs::read_to_string(of)
        .with_context(|| format!("{of} is neither a file that can be read nor one of {}", names.join(", ")))?;
    Scene::parse(&text).with_context(|| format!("{of} is no scene"))
}

/// Drives a scene once for each seed, measures and draws what happened, and writes it to a folder.
///
/// # Errors
/// When the scene is refused, the folder cannot be written, or the work is stopped; what is finished by then stays.
pub fn simulate(simulation: &Simulation, machine: &Machine) -> Result<Vec<Measured>> {
    let Simulation { scene, out, .. } = simulation;
    needs::check_scene(scene)?;
    let seeds = if simulation.seeds.is_empty() { &scene.seeds } else { &simulation.seeds };
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    sweep(std::slice::from_ref(out), machine);
    let driven = Scene { seeds: seeds.clone(), ..scene.clone() };
    write(&out.join("scene.toml"), toml::to_string(&driven)?.as_bytes())?;
    let mut all = Vec::new();
    for &seed in seeds {
        let place = if seeds.len() > 1 { out.join(format!("seed-{seed}")) } else { out.clone() };
        let simulated = drive(scene, seed, machine)?;
        all.push(keep(simulation, &simulated, &place, machine)?);
    }
    Ok(all)
}

fn drive(scene: &Scene, seed: u64, machine: &Machine) -> Result<Simulated> {
    let total = scene.warm_up_s + scene.duration_s;
    let work = machine.work(&format!("simulate {}, seed {seed}", scene.name), total as usize, "s");
    let mut progress = |seconds: f64| {
        work.at(seconds as u64, "");
        if machine.stop.is_requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    scene.run(seed, &mut progress).map_err(|error| match error {
        SimulationError::Stopped { .. } => Error::Stopped { kept: None },
        other => other.into(),
    })
}

/// Writes everything of one simulation.
fn keep(simulation: &Simulation, simulated: &Simulated, out: &Path, machine: &Machine) -> Result<Measured> {
    let Simulation { scene, fcd, .. } = simulation;
    let road = &scene.road;
    let course = if road.ring { Course::Ring { circumference: road.length_m } } else { Course::Open };
    let settings =
        Settings { detectors: scene.detectors_m.clone(), interval_s: scene.detector_interval_s, ..Settings::default() };
    let source = Source { words: format!("scene {}, seed {}", scene.name, simulated.seed), simulated: true };
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let recording = &simulated.recording;
    keep_tracks(recording, out, *fcd)?;
    let mut happenings = String::from("time_s,kind,vehicle,other,from_lane,to_lane\n");
    for it in &simulated.happenings {
        let [from, to] = it.lanes.map_or([String::new(), String::new()], |lanes| lanes.map(|lane| lane.to_string()));
        let other = it.other.map_or_else(String::new, |other| other.to_string());
        happenings += &format!("{:.2},{},{},{other},{from},{to}\n", it.time_s, it.kind, it.vehicle);
    }
    write(&out.join("happenings.csv"), happenings.as_bytes())?;
    let counts = &simulated.counts;
    let since = if scene.warm_up_s > 0. { "; from the start of the warm-up" } else { "" };
    let ends = match counts.lane_ends {
        0 => String::new(),
        some => format!(", {some} vehicles ran into the end of their lane"),
    };
    let words = format!(
        "{} vehicles entered, {} left, {} are on the road, {} wait to enter; {} lane changes, {} contacts{ends}{since}",
        counts.started + counts.entered,
        counts.left,
        counts.remain,
        counts.waiting,
        counts.lane_changes,
        counts.contacts
    );
    let traffic = Traffic::over(recording, course, [0, simulated.frames.saturating_sub(1)])?;
    measure_one(&traffic, settings, &source, out, &words, Some(counts), machine)
}

/// Takes away what an earlier simulation or measurement wrote: not all of it is written each time.
fn clear(out: &Path) -> Result<()> {
    let figures = figures::NAMES.iter().flat_map(|name| ["svg", "png"].map(|kind| format!("figures/{name}.{kind}")));
    for name in figures.chain(["fcd.xml", "fcd.add.xml"].map(str::to_owned)) {
        let path = out.join(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(error).with_context(|| format!("cannot remove {}", path.display()));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Writes where everybody was, for other programs.
fn keep_tracks(recording: &Recording, out: &Path, fcd: bool) -> Result<()> {
    clear(out)?;
    to_file(&out.join("tracks.parquet"), |file| Ok(write_parquet(recording, file)?))?;
    if fcd {
        let table = TrackTable::of(recording);
        to_file(&out.join("fcd.xml"), |file| Ok(write_fcd(&table, file)?))?;
        to_file(&out.join("fcd.add.xml"), |file| Ok(write_fcd_types(&table, file)?))?;
    }
    Ok(())
}

/// Measures recordings, real or simulated, as [`simulate`] measures what it drove: each into a folder of its own.
///
/// # Errors
/// When there are no recordings, or they cannot be read, or the folder not written.
pub fn measure(of: &Measurement, machine: &Machine) -> Result<Vec<Measured>> {
    let recordings = read_all(of.dataset, of.data.as_deref(), &of.tracks, machine)?;
    if recordings.is_empty() {
        bail!(Recordings, "there are no recordings to measure");
    }
    let work = machine.work("measure", recordings.len(), "recordings");
    let mut all = Vec::new();
    for (done, recording) in recordings.iter().enumerate() {
        machine.stop.check()?;
        let meta = recording.meta();
        work.at(done as u64, &meta.name);
        let source = Source { words: format!("{}, {}", meta.name, meta.site), simulated: meta.simulated };
        let folder = inside(&of.out, &meta.name)?;
        clear(&folder)?;
        let traffic = Traffic::new(recording, Course::Open)?;
        all.push(measure_one(&traffic, Settings::default(), &source, &folder, "", None, machine)?);
    }
    Ok(all)
}

/// Measures a recording and writes tables, figures and a page.
fn measure_one(
    traffic: &Traffic<'_>,
    mut settings: Settings,
    source: &Source,
    out: &Path,
    words: &str,
    counts: Option<&Counts>,
    machine: &Machine,
) -> Result<Measured> {
    machine.stop.check()?;
    let recording = traffic.recording();
    let longest = (0..recording.roads().len() as u16).filter_map(|road| traffic.extent(road));
    let length = longest.map(|[from, to]| to - from).fold(0., f64::max);
    // A wave that runs once around a small ring must not vanish in a cell.
    let pass = length / WAVE_SPEED;
    settings.cells.t = settings.cells.t.min(traffic.duration_s() / CELLS).min(pass).max(LEAST_CELL[0]);
    settings.cells.x = settings.cells.x.min(length / CELLS).max(LEAST_CELL[1]);
    let summary = Summary::of(traffic, &settings)?;
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    sweep(&[out.to_owned(), out.join("figures")], machine);
    table(&out.join("detectors.csv"), detector_rows(&summary))?;
    table(&out.join("cells.csv"), cell_rows(&summary))?;
    table(&out.join("conflicts.csv"), event_rows(&summary))?;
    write_json(&out.join("summary.json"), &without_rows(&summary, counts)?)?;
    let figures = figures::all(recording, traffic, &summary, source)?;
    crate::figures::save(&figures, &out.join("figures"))?;
    let page = page::page(recording, &summary, figures, source, words)?;
    write(&out.join("report.html"), page.html()?.as_bytes())?;
    let text = page::text(&summary, words);
    Ok(Measured { out: out.to_owned(), summary, text })
}

/// What stands in `summary.json`: everything but what the tables have row by row.
fn without_rows(summary: &Summary, counts: Option<&Counts>) -> Result<Value> {
    let mut value = serde_json::to_value(summary)?;
    if let Some(object) = value.as_object_mut() {
        for rows in ["cells", "detectors"] {
            object.remove(rows);
        }
        if let Some(counts) = counts {
            object.insert("counts".to_owned(), serde_json::to_value(counts)?);
        }
    }
    let mut remove = |path: &str, key: &str| {
        if let Some(object) = value.pointer_mut(path).and_then(Value::as_object_mut) {
            object.remove(key);
        }
    };
    ["conflicts", "contacts"].into_iter().for_each(|rows| remove("/safety", rows));
    remove("/lane_changes", "changes");
    if let Some(diagrams) = value.get_mut("diagrams").and_then(Value::as_array_mut) {
        diagrams.iter_mut().filter_map(Value::as_object_mut).for_each(|diagram| drop(diagram.remove("points")));
    }
    Ok(value)
}

fn table(path: &Path, rows: impl Iterator<Item = String>) -> Result<()> {
    let text: String = rows.map(|row| row + "\n").collect();
    write(path, text.as_bytes())
}

/// Writes a large file beside its place, and puts it there once it is whole.
fn to_file(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> Result<()>) -> Result<()> {
    let what = || format!("cannot write {}", path.display());
    let mut file = gnp_file::beside(path).with_context(what)?;
    let mut writer = BufWriter::new(file.as_file_mut());
    fill(&mut writer)?;
    writer.flush().with_context(what)?;
    drop(writer);
    file.persist(path).with_context(what)
}
