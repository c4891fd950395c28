//! Traffic that starts from a recorded scene: rules or a trained run drive on.

use std::path::PathBuf;

use gnp_data::{Dataset, Expectation, Recording, discover, read};
use gnp_force::Driver;
use gnp_measures::{Course, Settings};
use gnp_plot::Source;
use gnp_simulation::drivers::DriverDistribution;
use gnp_simulation::replay::{ClosedLoop, DrivenBy, Drivers, Learned, Replay, ReplaySettings, RuleDrivers};

use super::{Measured, keep_tracks, measure_one};
use crate::data::embedded_folder;
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
    /// Drivers fitted to a site, those more often who explain the observed seconds; they change lanes as fitted.
    Fitted(String),
    /// A trained run, which predicts anew every half second and draws among its futures.
    Run(PathBuf),
}

/// Drives on from a recorded scene, once for each seed, and measures and draws what happens as [`simulate`](super::simulate)
/// does. What a system is given of the recording ends with the start, but for the motion of the foremost vehicles and the
/// first states of those who enter later.
///
/// # Errors
/// When there is no such recording or moment, the run cannot be used, or the folder not be written.
pub fn simulate_from(of: &DriveOn, machine: &Machine) -> Result<Vec<Measured>> {
    let recording = find(of, machine)?;
    let meta = recording.meta();
    let settings = ReplaySettings { past_s: PAST_S, duration_s: of.seconds, every_s: of.seconds };
    let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
    let start = (PAST_S + of.at_s) * meta.rate_hz;
    if !(start.is_finite() && of.at_s >= 0. && of.seconds > 0. && start < f64::from(u32::MAX - first)) {
        bail!(Recordings, "cannot start at {} s and drive for {} s", of.at_s, of.seconds);
    }
    let driven = |road: &usize| recording.tracks().iter().filter(|track| usize::from(track.road) == *road).count();
    let road = (0..recording.roads().len()).max_by_key(driven).unwrap_or(0);
    let replay = Replay::of(&recording, road, first + start.round() as u32, &settings)?;
    let scene = replay.scene();
    let run = match &of.drivers {
        ReplayDrivers::Run(folder) => Some(Run::open(folder, machine)?),
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
        (ReplayDrivers::Fitted(site), ..) => {
            let fitted = DriverDistribution::embedded(site)?;
            let noise = fitted.noise();
            let driver = |(number, driver): (usize, &gnp_simulation::drivers::FittedDriver)| {
                // Numbers beyond those of files: a distribution does not say whose drivers they are.
                (u32::MAX - number as u32, DrivenBy { noise, ..DrivenBy::from(driver.driver) })
            };
            let drivers = Drivers::Matched(fitted.drivers().iter().enumerate().map(driver).collect());
            let mobil = fitted.lane_changes().mobil;
            Box::new(RuleDrivers::new(format!("drivers of {site}"), drivers).changing_lanes(mobil))
        }
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
        let course = Course::Open;
        all.push(measure_one(&recording, course, Settings::default(), &source, &out, &words, None, machine)?);
    }
    Ok(all)
}

/// The recording that is asked for.
fn find(of: &DriveOn, machine: &Machine) -> Result<Recording> {
    let folder = of.data.clone().map_or_else(|| embedded_folder(of.dataset), Ok)?;
    let expect = Expectation { dataset: of.dataset, rate_hz: None };
    let (mut best, mut names): (Option<Recording>, Vec<String>) = (None, Vec::new());
    for source in discover(&folder, of.dataset)? {
        machine.stop.check()?;
        for (recording, _) in read(&source, &expect)? {
            let name = recording.meta().name.clone();
            if of.recording.as_ref() == Some(&name) {
                return Ok(recording);
            }
            names.push(name);
            if best.as_ref().is_none_or(|best| best.len() < recording.len()) {
                best = Some(recording);
            }
        }
    }
    match (&of.recording, best) {
        (None, Some(recording)) => Ok(recording),
        (Some(name), _) => bail!(Recordings, "there is no recording {name}; there are {}", names.join(", ")),
        (None, None) => bail!(Recordings, "there are no recordings of {} in {}", of.dataset, folder.display()),
    }
}
