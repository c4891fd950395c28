//! What a run needs in memory, estimated before it starts and compared with what there is.
//!
//! Without this a network that is too large for the computer is found out by the system, which ends the program
//! after minutes of work. The estimate follows what each stage holds at its largest. Peaks of resident memory on one
//! thread, beside what is estimated, MB:
//!
//! | run | stage | measured | estimated |
//! |---|---|---|---|
//! | `smoke` | evaluation | 118 | 124 |
//! | `ngsim` | evaluation | 176 | 239 |
//! | `smoke`, batches of 512, 100 modes, width 64 | goal | 118 | 111 |
//! | `ngsim`, hidden 256, decoder 512, 256, 512 | social force | 165 | 195 |

use gnp_data::WindowShape;
use gnp_eval::Protocol;
use gnp_goal::{GoalConfig, GoalShape};
use gnp_simulation::Scene;

use crate::config::RunConfig;
use crate::data::{IngestSummary, RecordingReport};
use crate::error::{Result, bail};
use crate::machine::Machine;
use crate::memory;
use crate::run::Run;
use crate::run::folder::Stage;

/// What is estimated to need this many times what there is, is refused; below, what was measured may still fit.
const TOO_MUCH: f64 = 1.5;

/// Bytes of a number of the networks.
const F32: f64 = 4.;
/// The program itself, with what a small run needs, bytes.
const PROGRAM: f64 = 40e6;
/// A row of a recording in columns, with its place among the rows of its frame, bytes.
const ROW: f64 = 72.;
/// A row of a simulated recording, with what is measured of it, bytes.
const SIMULATED_ROW: f64 = 200.;
/// A window's name, in the split and in its file, bytes.
const WINDOW: f64 = 300.;
/// Most vehicles that the goal network sees.
const SLOTS: usize = 11;
/// Neighbours that are mostly there.
const OCCUPIED: f64 = 5.;
/// Lane lines that push.
const LINES: f64 = 6.;
/// Values of a tape that the roll-out keeps for its gradient at most.
const TAPE: f64 = (1u64 << 28) as f64;
/// Values that the goal network keeps for its gradient at most.
const GOAL_TAPE: f64 = (1u64 << 26) as f64;
/// Values of its weights' gradients that groups of windows make side by side, as far as every thread has a group.
const SHARED: f64 = (1u64 << 24) as f64;
/// Copies of the weights in a training: themselves, gradients, Adam's moments, the checkpoint being written.
const COPIES: f64 = 11.;
/// Parts of a batch at most, and groups of windows at most in the goal network's share of a part: each has gradients of
/// its own, so that they add up in the same order on any number of threads.
const GROUPS: f64 = 16.;
/// Windows of a part at least, and of a group of the goal network.
const PART: f64 = 16.;
const GROUP: f64 = 4.;

/// A part of what is needed.
#[derive(Clone, Debug, PartialEq)]
struct Part {
    /// What it is for.
    what: &'static str,
    bytes: f64,
    /// Keys that make it smaller.
    keys: &'static str,
}

/// Recordings and windows, once they are counted.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Counts {
    rows: f64,
    windows: f64,
    vehicles: f64,
}

/// Refuses a run that does not fit into memory by its configuration alone, of which every value is checked, too.
///
/// # Errors
/// [`Error::Config`](crate::Error::Config) for a value that cannot be used;
/// [`Error::Unavailable`](crate::Error::Unavailable) with the largest parts, what there is, and the keys to lower.
pub(crate) fn check_before(config: &RunConfig, machine: &Machine) -> Result<()> {
    config.check()?;
    tell(compare(config, None, Stage::Ingest, allowed(machine))?, machine);
    Ok(())
}

/// The same of a run that is about to do a stage and those after it: its recordings are counted.
///
/// # Errors
/// As [`check_before`]; when the run does not say what was read.
pub(crate) fn check_from(stage: Stage, run: &Run) -> Result<()> {
    check_with(stage, &run.config, &run.folder.read_json("ingest.json")?, &run.machine)
}

/// The same with recordings that were read.
///
/// # Errors
/// As [`check_before`].
pub(crate) fn check_with(stage: Stage, config: &RunConfig, ingested: &IngestSummary, machine: &Machine) -> Result<()> {
    let sum = |of: fn(&RecordingReport) -> f64| ingested.recordings.iter().map(of).sum();
    let counts = Counts {
        rows: sum(|report| report.quality.rows_read as f64),
        windows: sum(|report| report.windows.windows as f64),
        vehicles: sum(|report| report.windows.vehicles as f64),
    };
    tell(compare(config, Some(counts), stage, allowed(machine))?, machine);
    Ok(())
}

/// Refuses a scene whose recording does not fit into memory.
///
/// # Errors
/// [`Error::Unavailable`](crate::Error::Unavailable) with what it needs, what there is, and the keys to lower.
pub(crate) fn check_scene(scene: &Scene) -> Result<()> {
    refuse_scene(scene, memory::allowed())
}

fn refuse_scene(scene: &Scene, allowed: Option<u64>) -> Result<()> {
    let (rows, needed) = (scene.expected_rows(), PROGRAM + scene.expected_rows() * SIMULATED_ROW);
    let Some(allowed) = allowed.map(|bytes| bytes as f64).filter(|allowed| needed > *allowed) else { return Ok(()) };
    bail!(
        Unavailable,
        "{}: about {rows:.0} recorded rows need {:.1} GB of memory, and there are {:.1} GB; lower duration_s, record_hz, \
         road.length_m or the number of vehicles",
        scene.name,
        needed / 1e9,
        allowed / 1e9
    )
}

/// What there is, where the networks run in this memory.
fn allowed(machine: &Machine) -> Option<u64> {
    memory::allowed().filter(|_| machine.device.is_cpu())
}

fn tell(doubt: Option<String>, machine: &Machine) {
    if let Some(doubt) = doubt {
        machine.progress.note(&doubt);
    }
}

/// Compares what the stages from `first` on need with what there is: refused, or doubted, with what is to be told.
fn compare(config: &RunConfig, counts: Option<Counts>, first: Stage, allowed: Option<u64>) -> Result<Option<String>> {
    let Some(allowed) = allowed else { return Ok(None) };
    let (stage, mut parts) = largest(config, counts, first)?;
    let needed = total(&parts);
    if needed <= allowed as f64 {
        return Ok(None);
    }
    parts.sort_by(|a, b| b.bytes.total_cmp(&a.bytes));
    let gigabytes = |bytes: f64| format!("{:.1} GB", bytes / 1e9);
    let largest: Vec<String> = parts
        .iter()
        .take(3)
        .filter(|part| part.bytes > 0.05 * needed)
        .map(|part| format!("{} {} ({})", gigabytes(part.bytes), part.what, part.keys))
        .collect();
    let what = format!(
        "{stage} would need about {} of memory, and there are {}: {}",
        gigabytes(needed),
        gigabytes(allowed as f64),
        largest.join(", ")
    );
    if needed > TOO_MUCH * allowed as f64 {
        bail!(Unavailable, "{what}; lower these keys, or take a larger computer");
    }
    Ok(Some(format!("memory may be short: {what}")))
}

fn total(parts: &[Part]) -> f64 {
    parts.iter().map(|part| part.bytes).sum()
}

/// The stage from `first` on that needs most, with its parts.
fn largest(config: &RunConfig, counts: Option<Counts>, first: Stage) -> Result<(&'static str, Vec<Part>)> {
    let shape = config.windows.shape_for(config.data.rate_hz)?;
    let stages = [
        (Stage::Modes, "the search for modes", modes(config, shape, counts)),
        (Stage::Goal, "the training of the goal network", goal(config, shape, counts)),
        // Of two that need as much the later one stands for both.
        (Stage::Repulsion, "the training of the social force", force(config, shape, counts)),
        (Stage::Evaluate, "the evaluation", evaluation(config, shape, counts)),
    ];
    let shared = shared(config, shape, counts);
    let to_come = stages.into_iter().filter(|(stage, ..)| *stage >= first).map(|(_, name, parts)| (name, parts));
    let largest = to_come.max_by(|a, b| total(&a.1).total_cmp(&total(&b.1)));
    let (stage, parts) = largest.unwrap_or(("the report", Vec::new()));
    Ok((stage, shared.into_iter().chain(parts).collect()))
}

/// What every stage holds.
fn shared(config: &RunConfig, shape: WindowShape, counts: Option<Counts>) -> Vec<Part> {
    let Counts { rows, windows, .. } = counts.unwrap_or(Counts { rows: 0., windows: 0., vehicles: 0. });
    // Features of the target and of the neighbours that are there, from which their means are taken.
    let history = goal_shape(config, shape);
    let learned_from = windows * config.split.train;
    let features = learned_from * F32 * (history.observed as f64 + OCCUPIED * history.neighbour as f64);
    vec![
        Part { what: "the program", bytes: PROGRAM, keys: "nothing" },
        Part { what: "recordings", bytes: rows * ROW, keys: "data.max_recordings" },
        Part { what: "windows", bytes: windows * WINDOW + features, keys: "windows.stride_s, data.max_recordings" },
    ]
}

fn goal_shape(config: &RunConfig, shape: WindowShape) -> GoalShape {
    let frames = if config.features.history_block_s > 0. {
        (shape.t_obs as f64 / (config.features.history_block_s * shape.rate_hz).max(1.)).ceil() as usize
    } else {
        shape.t_obs
    };
    GoalShape { observed: 4 * frames + 14, neighbour: 4 * frames + 8, slots: SLOTS, t_pred: shape.t_pred }
}

/// Windows of a batch: no more than there are.
fn in_batch(batch: usize, counts: Option<Counts>) -> f64 {
    counts.map_or(batch as f64, |counts| counts.windows.min(batch as f64))
}

/// A mini-batch in training: its parts, and how many windows of it are worked on at a time.
fn in_parts(batch: f64) -> (f64, f64, f64) {
    let each = (batch / GROUPS).ceil().max(PART).min(batch);
    let parts = (batch / each).ceil();
    (parts, each, parts.min(rayon::current_num_threads() as f64))
}

fn modes(config: &RunConfig, shape: WindowShape, counts: Option<Counts>) -> Vec<Part> {
    let path = 2. * shape.t_pred as f64;
    let centres = 8. * config.modes.modes as f64 * path * 4.;
    let futures = counts.map_or(0., |counts| 2. * counts.windows * path * F32 * 1.5);
    vec![
        Part { what: "mode centres", bytes: centres, keys: "modes.modes, windows.predicted_s" },
        Part { what: "futures", bytes: futures, keys: "windows.stride_s, windows.predicted_s" },
    ]
}

fn goal(config: &RunConfig, shape: WindowShape, counts: Option<Counts>) -> Vec<Part> {
    let net = &config.goal.net;
    let batch = in_batch(config.goal.train.batch, counts);
    let weights = net.weights(&goal_shape(config, shape)) as f64;
    let (parts, each, at_a_time) = in_parts(batch);
    let groups =
        (SHARED / weights).max(rayon::current_num_threads() as f64).min((each / GROUP).ceil().min(GROUPS)) + 3.;
    let batch = at_a_time * each;
    let (modes, path) = (config.modes.modes as f64, 2. * shape.t_pred as f64);
    // What each layer works out stays for the gradient, and the futures of all modes where the loss sees all.
    let kept = (net.layers + 1) as f64 * modes * ((6 + net.feed_forward) * net.width + 2 * net.heads) as f64;
    let tokens = at_a_time * (each * kept).min(GOAL_TAPE) + batch * modes * net.width as f64 * 8.;
    let decoded = if config.goal.loss.mean_weight > 0. { modes } else { 1. };
    let futures = batch * (decoded * 9. + modes) * path;
    vec![
        Part {
            what: "weights of the goal network, with gradients and moments",
            bytes: F32 * weights * (COPIES + parts + at_a_time * groups),
            keys: "goal.width, goal.layers, goal.feed_forward",
        },
        Part {
            what: "a batch of the goal network",
            bytes: F32 * (tokens + futures) + work(net, modes),
            keys: "goal.batch, modes.modes, goal.width, goal.layers",
        },
    ]
}

/// What the threads of the goal network work in, bytes.
fn work(net: &GoalConfig, modes: f64) -> f64 {
    let threads = rayon::current_num_threads() as f64;
    let (width, hidden) = (net.width as f64, (net.width * net.feed_forward) as f64);
    threads * F32 * modes * (15. * width + 2. * hidden + 64.)
}

fn force(config: &RunConfig, shape: WindowShape, counts: Option<Counts>) -> Vec<Part> {
    let traj = &config.traj;
    let batch = in_batch(config.attraction.train.batch.max(config.repulsion.train.batch), counts);
    let weights = traj.weights() as f64;
    let (parts, each, at_a_time) = in_parts(batch);
    // What one window leaves for the gradient of the network that is trained: its memory of the past and of the future,
    // and what its head worked out for each source.
    let period = traj.network_period as f64;
    let (seen, runs) = ((shape.t_obs as f64 / period).ceil(), (shape.t_pred as f64 / period).ceil());
    let memory = (2 * traj.embedding + 6 * traj.hidden) as f64;
    let lines = if traj.lines { LINES } else { 0. };
    let head = (traj.decoder.iter().skip(1).sum::<usize>() + 2 * traj.latent_dim) as f64;
    let window = (seen + runs) * memory + runs * (OCCUPIED + lines) * head;
    let tape = at_a_time * ((each * window).min(TAPE) + 16. * window);
    // Where everybody is in every step.
    let scene = at_a_time * each * shape.t_pred as f64 * SLOTS as f64 * 4. * 4.;
    vec![
        Part {
            what: "weights of the social force, with gradients and moments",
            bytes: F32 * weights * (COPIES + parts + at_a_time * 4.),
            keys: "traj.hidden, traj.encoder, traj.decoder",
        },
        Part {
            what: "a batch of the roll-out",
            bytes: F32 * (tape + scene),
            keys: "attraction.batch, repulsion.batch, traj.hidden, traj.decoder, windows.predicted_s",
        },
    ]
}

fn evaluation(config: &RunConfig, shape: WindowShape, counts: Option<Counts>) -> Vec<Part> {
    let (net, steps) = (&config.goal.net, shape.t_pred as f64);
    // A batch ends with the vehicles of an instant complete.
    let batch = in_batch(config.evaluate.batch + 64, counts);
    let modes = config.modes.modes as f64;
    let weights = 3. * (net.weights(&goal_shape(config, shape)) + 2 * config.traj.weights()) as f64;
    let goals = batch * modes * (4. * net.width as f64 + 6. * 2. * steps);
    let asked = |protocol: &Protocol| protocol.asks().iter().sum::<usize>() as f64;
    let futures: f64 = config.evaluate.protocols.iter().map(asked).sum();
    // A path with its copies, and the forces of every step of those that are explained.
    let paths = batch * steps * (futures * 8. + config.predict.k as f64 * 180.);
    let sums = counts.map_or(0., |counts| counts.vehicles * 20e3);
    let draws = config.evaluate.bootstrap.resamples as f64 * 16. * 100.;
    vec![
        Part {
            what: "weights of both networks",
            bytes: F32 * weights,
            keys: "goal.width, goal.layers, traj.hidden, traj.decoder",
        },
        Part {
            what: "a batch of forecasts",
            bytes: F32 * (goals + paths) + work(net, modes),
            keys: "evaluate.batch, modes.modes, predict.k",
        },
        Part { what: "scores", bytes: 30e6 + sums, keys: "data.max_recordings" },
        Part { what: "draws of the intervals", bytes: draws, keys: "evaluate.bootstrap.resamples" },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(name: &str, set: &[&str]) -> RunConfig {
        let set: Vec<_> = set.iter().map(|text| text.parse().unwrap()).collect();
        RunConfig::embedded(name, &set).unwrap()
    }

    /// In the ranges, and far beyond any computer: refused by the configuration alone, with keys.
    #[test]
    fn what_does_not_fit_is_refused_with_the_keys_to_lower() {
        for (set, key) in [
            (&["goal.width=8192", "goal.layers=16"][..], "goal.width"),
            (&["traj.hidden=8192", "traj.encoder=[8192, 8192]"], "traj.hidden"),
            (&["goal.batch=65536", "modes.modes=10000"], "modes.modes"),
            (&["evaluate.batch=65536", "modes.modes=10000"], "modes.modes"),
        ] {
            let error = compare(&config("ngsim", set), None, Stage::Ingest, Some(16_000_000_000)).unwrap_err();
            assert!(matches!(error, crate::Error::Unavailable(_)), "{error}");
            let message = error.to_string();
            assert!(message.contains(key) && message.contains("there are 16.0 GB"), "{message}");
        }
    }

    #[test]
    fn what_comes_with_the_project_fits_a_small_computer() {
        for name in ["smoke", "ngsim", "highd", "paper/ngsim", "paper/highd"] {
            let fits = compare(&config(name, &[]), None, Stage::Ingest, Some(4_000_000_000));
            assert!(matches!(fits, Ok(None)), "{name}: {fits:?}");
        }
    }

    #[test]
    fn recordings_count_and_an_unknown_size_of_memory_refuses_nothing() {
        let counts = Counts { rows: 1e9, windows: 1e7, vehicles: 1e5 };
        let compared = |allowed| compare(&config("smoke", &[]), Some(counts), Stage::Modes, allowed);
        let message = compared(Some(16_000_000_000)).unwrap_err().to_string();
        assert!(message.contains("recordings (data.max_recordings)"), "{message}");
        assert!(matches!(compared(None), Ok(None)));
        // What the estimate may have too high is doubted, not refused.
        let needed = total(&largest(&config("smoke", &[]), Some(counts), Stage::Modes).unwrap().1);
        let doubt = compared(Some((needed / 1.2) as u64)).unwrap().unwrap();
        assert!(doubt.starts_with("memory may be short: "), "{doubt}");
    }

    #[test]
    fn a_stage_that_is_done_is_asked_for_no_memory() {
        let wide = config("smoke", &["goal.width=2048", "goal.layers=8"]);
        let from = |stage| compare(&wide, None, stage, Some(8_000_000_000));
        assert!(from(Stage::Goal).is_err() && from(Stage::Attraction).is_ok() && from(Stage::Report).is_ok());
    }

    #[test]
    fn a_scene_that_nobody_could_keep_is_refused_and_those_that_come_with_the_project_are_not() {
        for (name, text) in Scene::EMBEDDED {
            let scene = Scene::parse(text).unwrap();
            assert!(refuse_scene(&scene, Some(1_000_000_000)).is_ok(), "{name}: {} rows", scene.expected_rows());
            let long = Scene { duration_s: 86_400., record_hz: 100., step_s: 0.01, ..scene };
            let long = Scene { road: gnp_simulation::RoadSpec { length_m: 1e6, ..long.road.clone() }, ..long };
            let wide = long.start.map(|start| gnp_simulation::StartSpec { vehicles: 100_000, ..start });
            let message = refuse_scene(&Scene { start: wide, ..long }, Some(64_000_000_000)).unwrap_err().to_string();
            assert!(message.contains("duration_s") && message.contains("there are 64.0 GB"), "{message}");
        }
    }

    /// Peaks measured on one thread, by the stage that needs most: resident bytes as the system counts them.
    #[test]
    fn estimates_are_within_a_factor_of_two_of_what_was_measured() {
        let tall = ["goal.batch=512", "goal.width=64", "modes.modes=100"];
        let force = ["traj.hidden=256", "traj.embedding=64", "traj.decoder=[512, 256, 512]", "traj.encoder=[64, 256]"];
        type Parts = fn(&RunConfig, WindowShape, Option<Counts>) -> Vec<Part>;
        type Case<'a> = (&'a str, &'a [&'a str], [f64; 3], Parts, f64);
        let cases: [Case<'_>; 4] = [
            ("smoke", &[], [50_295., 4008., 144.], evaluation, 118e6),
            ("ngsim", &[], [88_578., 5956., 725.], evaluation, 176e6),
            ("smoke", &tall, [50_295., 4008., 144.], goal, 118e6),
            ("ngsim", &force, [88_578., 5956., 725.], super::force, 165e6),
        ];
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        for (name, set, [rows, windows, vehicles], stage, measured) in cases {
            let (config, counts) = (config(name, set), Some(Counts { rows, windows, vehicles }));
            let shape = config.windows.shape_for(config.data.rate_hz).unwrap();
            let parts = one.install(|| stage(&config, shape, counts));
            let ratio = (total(&shared(&config, shape, counts)) + total(&parts)) / measured;
            assert!((0.5..2.).contains(&ratio), "{name} {set:?}: {ratio:.2} times {measured:e} bytes");
        }
    }
}
