//! Traffic that starts from a recorded scene: rules or a trained run drive on.

use std::path::PathBuf;

use gnp_data::{Dataset, Recording, TrackOptions};
use gnp_force::Driver;
use gnp_measures::{Course, Settings, Traffic};
use gnp_plot::Source;
use gnp_simulation::drivers::{DriverKey, FitConfig, FittedDriver, fit_drivers, fit_lane_changes};
use gnp_simulation::replay::{ClosedLoop, DrivenBy, Drivers, Learned, Replay, ReplaySettings, RuleDrivers};

use super::{Measured, keep_tracks, measure_one};
use crate::data::source::read_all;
use crate::error::{Context as _, Result, bail};
use crate::machine::Machine;
use crate::run::Run;

/// Observed time before the start, s.
const PAST_S: f64 = 3.;

/// From which scene to drive on, and who drives.
#[derive(Clone, Debug)]
pub struct DriveOn {
    /// Kind of recordings.
    pub dataset: Dataset,
    /// The recordings; without it, those that come with the project.
    pub data: Option<PathBuf>,
    /// What is known of the road, for formats whose tracks lie in any plane; the recordings have any rate where none is named.
    pub tracks: TrackOptions,
    /// Name of the recording; without it, the one with most rows.
    pub recording: Option<String>,
    /// When to start, in s after the first frame that has 3 s of past.
    pub at_s: f64,
    /// How long to drive at most, in s.
    pub seconds: f64,
    /// Who drives.
    pub drivers: ReplayDrivers,
    /// From which chance comes, one simulation each.
    pub seeds: Vec<u64>,
    /// The folder; with several seeds, one in it for each.
    pub out: PathBuf,
    /// Whether to write SUMO's floating car data.
    pub fcd: bool,
}

/// Who drives on from a recorded scene.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ReplayDrivers {
    /// Everybody as the standard driver of the intelligent driver model.
    Standard,
    /// Drivers fitted to the other vehicles of the site, those more often who explain the observed seconds; they change
    /// lanes as fitted.
    Fitted,
    /// A trained run, which predicts anew every half second and draws among its futures. It may have been trained on these
    /// very vehicles: what is shown then is no test of it.
    Run(PathBuf),
}

/// Drives on from a recorded scene, once for each seed, and measures and draws what happens as [`simulate`](super::simulate)
/// does. What a system is given of the recording ends with the start, but for the motion of the foremost vehicles and the
/// first states of those who enter later.
///
/// # Errors
/// When there is no such recording or moment, the run cannot be used, or the folder not be written.
pub fn simulate_from(of: &DriveOn, machine: &Machine) -> Result<Vec<Measured>> {
    let recordings = read_all(of.dataset, of.data.as_deref(), &of.tracks, machine)?;
    let recording = chosen(of, &recordings)?;
    let meta = recording.meta();
    let settings = ReplaySettings { past_s: PAST_S, duration_s: of.seconds, every_s: of.seconds };
    let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
    let start = (PAST_S + of.at_s) * meta.rate_hz;
    if !(of.at_s >= 0. && of.seconds > 0.) {
        bail!(Recordings, "cannot start at {} s and drive for {} s", of.at_s, of.seconds);
    }
    let last = recording.tracks().iter().map(|track| track.last_frame()).max().unwrap_or(first);
    let after = f64::from(last - first) / meta.rate_hz - PAST_S;
    if of.at_s >= after {
        bail!(Recordings, "{} has {after:.1} s after 3 s of past: it cannot start at {} s", meta.name, of.at_s);
    }
    let driven = |road: &usize| recording.tracks().iter().filter(|track| usize::from(track.road) == *road).count();
    let road = (0..recording.roads().len()).max_by_key(driven).unwrap_or(0);
    let replay = Replay::of(recording, road, first + start.round() as u32, &settings)?;
    let scene = replay.scene();
    let run = match &of.drivers {
        ReplayDrivers::Run(folder) => Some(Run::open_model(folder, machine)?),
        _ => None,
    };
    if let Some(run) = run.as_ref().filter(|run| run.config().dataset != of.dataset) {
        bail!(Folder, "{} was trained on {}, not on {}", run.path().display(), run.config().dataset, of.dataset);
    }
    let model = run.as_ref().map(Run::model).transpose()?;
    let standard = DrivenBy::from(Driver::motorway());
    let system: Box<dyn ClosedLoop + '_> = match (&of.drivers, &run, &model) {
        (ReplayDrivers::Run(_), Some(run), Some(model)) => {
            let shape = run.config().windows.shape_for(meta.rate_hz)?;
            Box::new(Learned::new("trained run", model, shape, true, standard))
        }
        (ReplayDrivers::Fitted, ..) => Box::new(fitted(of.dataset, &meta.site, &recordings)?),
        _ => Box::new(RuleDrivers::new("standard drivers", Drivers::Same(standard))),
    };
    let mut all = Vec::new();
    for &seed in &of.seeds {
        machine.stop.check()?;
        let out = if of.seeds.len() > 1 { of.out.join(format!("seed-{seed}")) } else { of.out.clone() };
        let trace = system.drive(scene, seed)?;
        let name = format!("{} driven on", meta.name);
        let recording = trace.recording(scene, &name)?;
        std::fs::create_dir_all(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;
        keep_tracks(&recording, &out, of.fcd)?;
        let driven = scene.actors.iter().filter(|actor| actor.is_driven()).count();
        let words = format!(
            "{driven} of {} vehicles driven by {} for {:.1} s from {}; {} came late, {} never",
            scene.actors.len(),
            system.name(),
            scene.frames as f64 / scene.rate_hz,
            scene.name,
            trace.late,
            trace.never
        );
        let source = Source { words: format!("{name}, {}, seed {seed}", system.name()), simulated: true };
        let traffic = Traffic::over(&recording, Course::Open, [0, scene.frames as u32])?;
        all.push(measure_one(&traffic, Settings::default(), &source, &out, &words, None, machine)?);
    }
    Ok(all)
}

/// Drivers fitted to a site; none of a vehicle that is in the scene is drawn for it.
fn fitted(dataset: Dataset, site: &str, recordings: &[Recording]) -> Result<RuleDrivers> {
    let of_site: Vec<Recording> = recordings.iter().filter(|it| it.meta().site == site).cloned().collect();
    let shared_vehicles = of_site.len() > 1 && dataset == Dataset::NGSIM;
    let traffic = fit_drivers(&of_site, &FitConfig { shared_vehicles, ..FitConfig::default() })?;
    let (noise, mobil) = (traffic.noise(), fit_lane_changes(&of_site, &traffic)?.mobil);
    let driver =
        |(key, it): (&DriverKey, &FittedDriver)| (key.vehicle, DrivenBy { noise, ..DrivenBy::from(it.driver) });
    let drivers = Drivers::Matched(traffic.drivers().iter().map(driver).collect());
    Ok(RuleDrivers::new(format!("drivers fitted to others of {site}"), drivers).changing_lanes(mobil))
}

/// The recording that is asked for, or the one with most rows.
fn chosen<'a>(of: &DriveOn, recordings: &'a [Recording]) -> Result<&'a Recording> {
    let found = match &of.recording {
        Some(name) => recordings.iter().find(|recording| recording.meta().name == *name),
        None => recordings.iter().max_by_key(|recording| recording.len()),
    };
    let Some(recording) = found else {
        let names: Vec<&str> = recordings.iter().map(|recording| recording.meta().name.as_str()).collect();
        let asked = of.recording.as_deref().unwrap_or_default();
        bail!(Recordings, "there is no recording {asked}; there are {}", names.join(", "));
    };
    Ok(recording)
}
