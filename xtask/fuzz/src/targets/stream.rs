//! Frames of tracks that a program gives: pushed one after the other, predicted at once.

use std::sync::OnceLock;

use arbitrary::{Arbitrary, Unstructured};
use gnp::online::{Frame, OnlineError, Stream, StreamConfig, Tracked};
use gnp_data::LaneMarking;
use gnp_model::Gnp;

use crate::finding::{Finding, promise};
use crate::made::{Number, Rarely};
use crate::{Scratch, Target, checks, model};

pub(super) const TARGET: Target = Target {
    name: "stream",
    about: "frames of tracks of a program, to forecasts",
    run,
    seeds: |_| Ok(vec![vec![0; 256], vec![7; 512], (0..=255).cycle().take(2048).collect()]),
    words: &[],
};

/// A program that pushes frames.
#[derive(Arbitrary, Debug)]
struct Made {
    lines: Rarely<[Number; 3]>,
    coast_s: Rarely<f64>,
    bridge_s: Rarely<f64>,
    max_vehicles: Rarely<u8>,
    start_s: Rarely<f64>,
    frames: Vec<MadeFrame>,
}

#[derive(Arbitrary, Debug)]
struct MadeFrame {
    /// Steps of 10 ms after the frame before.
    after: u8,
    odd_time: Rarely<f64>,
    count: u8,
    tracks: [MadeTrack; 3],
}

#[derive(Arbitrary, Debug)]
struct MadeTrack {
    id: Rarely<u8>,
    position: Rarely<[f64; 2]>,
    aside: u8,
    velocity: Rarely<[Number; 2]>,
    size: Rarely<[f32; 2]>,
}

/// Frames of a case: more change nothing.
const FRAMES: usize = 24;

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let Ok(made) = Made::arbitrary(&mut Unstructured::new(input)) else { return Ok(()) };
    let lines = made.lines.0.map_or([0., 3.6, 7.2], |lines| lines.map(|y| y.0));
    let lines = lines.map(|y| LaneMarking::new(y, false)).to_vec();
    let default = StreamConfig::default();
    let config = StreamConfig {
        k: 2,
        coast_s: made.coast_s.or(default.coast_s),
        bridge_s: made.bridge_s.or(default.bridge_s),
        max_vehicles: made.max_vehicles.or(8).into(),
        ..default
    };
    let mut stream = match Stream::new(gnp(scratch)?, lines, config) {
        Ok(stream) => stream,
        Err(error) => return checks::refusal(&error, ""),
    };
    let mut time_s = made.start_s.or(0.);
    for frame in made.frames.iter().take(FRAMES) {
        time_s += f64::from(frame.after % 32) / 100.;
        let tracks = frame.tracks[..usize::from(frame.count % 4)].iter().enumerate();
        let tracks: Vec<Tracked> = tracks.map(|(i, track)| tracked(i as u8, track, time_s)).collect();
        match stream.push(frame.odd_time.or(time_s), &tracks) {
            Ok(frame) => check(frame, tracks.len())?,
            Err(error @ OnlineError::Time { .. }) => checks::refusal(&error, "")?,
            Err(error) => return Err(Finding::Believed(format!("another error of a frame: {error}"))),
        }
    }
    Ok(())
}

/// Made once: the same in every case.
fn gnp(scratch: &Scratch) -> Result<&'static Gnp, Finding> {
    static MODEL: OnceLock<Gnp> = OnceLock::new();
    if let Some(gnp) = MODEL.get() {
        return Ok(gnp);
    }
    let [modes, ..] = model::saved(scratch)?;
    let folder = modes.parent().ok_or_else(|| Finding::case("a file without a folder"))?;
    let gnp = model::load(folder).map_err(Finding::case)?.explaining(true);
    Ok(MODEL.get_or_init(|| gnp))
}

fn tracked(i: u8, made: &MadeTrack, time_s: f64) -> Tracked {
    let position = [30. * f64::from(i) + 20. * time_s, f64::from(made.aside) / 32.];
    let mut track = Tracked::new(made.id.or(i % 3).into(), made.position.or(position));
    track.velocity = made.velocity.0.map(|velocity| velocity.map(|value| value.0));
    track.size = made.size.0;
    track
}

fn check(frame: Frame<'_>, tracks: usize) -> Result<(), Finding> {
    promise(frame.problems().iter().all(|problem| problem.row < tracks), || "a problem of no track".to_owned())?;
    for problem in frame.problems() {
        checks::refusal(&problem.reason, "")?;
    }
    for vehicle in frame.vehicles() {
        let told = || format!("vehicle {}: not finite", vehicle.id());
        promise(vehicle.position().iter().all(|value| value.is_finite()), told)?;
        promise(vehicle.age_s().is_finite() && vehicle.gap_s().is_finite(), told)?;
        let predicted = vehicle.window().is_some();
        promise(predicted != vehicle.probabilities().is_empty(), || "a forecast without probabilities".to_owned())?;
        for mode in 0..frame.modes() {
            let path = vehicle.path(mode);
            promise(path.len() == if predicted { frame.steps() } else { 0 }, || "a path of another length".to_owned())?;
            promise(path.iter().flatten().all(|value| value.is_finite()), told)?;
            let forces = (0..frame.terms().len()).flat_map(|term| vehicle.force(term, mode)).flatten();
            promise(forces.into_iter().all(|value| value.is_finite()), told)?;
        }
        let sum: f32 = vehicle.probabilities().iter().sum();
        promise(!predicted || (sum - 1.).abs() < 1e-3, || format!("probabilities sum to {sum}"))?;
    }
    Ok(())
}
