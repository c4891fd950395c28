//! Scene files of the simulator: any text, changed embedded scenes, and small ones driven.

use std::ops::ControlFlow;

use arbitrary::{Arbitrary, Unstructured};
use gnp::{Scene, scene};
use serde_json::Value;

use crate::finding::promise;
use crate::made::kind;
use crate::patch::{self, Patch};
use crate::{Finding, Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "scene",
    about: "scene files, and small scenes driven",
    run,
    seeds,
    words: &[
        "duration_s = ",
        "lanes = ",
        "length_m = ",
        "ring = true",
        "[[drivers]]",
        "idm = {",
        "[start]",
        "closures = [{",
        "nan",
        "1e9",
    ],
};

/// A scene that is driven has at most so many seconds, vehicles and lanes.
const SMALL: (f64, usize, usize) = (5., 12, 4);

/// A ring that is driven in no time.
const RING: &str = r#"
name = "ring"
duration_s = 2
[road]
lanes = 2
length_m = 200
ring = true
[start]
vehicles = 6
speed_mps = 6
[[drivers]]
name = "car"
rule = { idm = { time_gap = 1.0, standstill_gap = 2.0, acceleration = 0.5, braking = 1.5 } }
desired_speed_mps = { mean = 15, sd = 1 }
lane_change = { politeness = 0.2, threshold = 0.1, keep_right = 0.0, safe_braking = 3.0, pause = 3.0 }
"#;

/// A road into which vehicles drive, with all that may be said.
const ROAD: &str = r#"
name = "road"
duration_s = 3
warm_up_s = 1
step_s = 0.1
record_hz = 5
seeds = [1, 2]
detectors_m = [50, 150]
detector_interval_s = 1
[road]
lanes = 2
lane_width_m = 3.5
length_m = 250
closures = [{ lane = 1, from_m = 180, to_m = 251 }]
[inflow]
flow = [[0, 1800], [2, 900]]
[[drivers]]
name = "car"
share = 2
spread = 0.1
desired_speed_mps = { mean = 30, sd = 2 }
[[drivers]]
name = "truck"
lanes = [0]
length_m = 12
width_m = 2.5
rule = { idm = { time_gap = 1.5, standstill_gap = 3.0, acceleration = 0.8, braking = 2.0 } }
[[speed_limits]]
from_m = 100
to_m = 200
from_s = 1
to_s = 2
speed_mps = 20
"#;

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    if kind == b'a' {
        return try_text(scratch, rest);
    }
    let Ok(patches) = Vec::<Patch>::arbitrary(&mut Unstructured::new(rest)) else { return Ok(()) };
    let text = if kind.is_multiple_of(2) { RING } else { ROAD };
    let mut value: Value = toml::from_str(text).map_err(Finding::case)?;
    patch::apply(&mut value, &patches);
    // What has no form in TOML, such as null, is no text to read.
    let Ok(text) = toml::to_string(&value) else { return Ok(()) };
    try_text(scratch, text.as_bytes())
}

fn try_text(scratch: &Scratch, text: &[u8]) -> Result<(), Finding> {
    let file = scratch.only("case.toml", text)?;
    let of = file.display().to_string();
    let read = match scene(&of) {
        Ok(scene) => scene,
        Err(error) => return checks::refusal_text(&error.chain(), "case.toml"),
    };
    let written = toml::to_string(&read).map_err(|error| Finding::Believed(format!("no TOML form: {error}")))?;
    let again = Scene::parse(&written).map_err(|error| Finding::Believed(format!("does not read back: {error}")))?;
    promise(again == read, || format!("a scene that reads back as another: {written}"))?;
    if is_small(&read) { drive(scratch, &read) } else { Ok(()) }
}

fn is_small(scene: &Scene) -> bool {
    let (seconds, vehicles, lanes) = SMALL;
    let short = scene.warm_up_s + scene.duration_s <= seconds && scene.step_s >= 0.05;
    let few = scene.start.is_none_or(|start| start.vehicles <= vehicles) && scene.road.lanes <= lanes;
    // A name of fitted drivers may be that of any file.
    short && few && scene.drivers.len() <= 4 && scene.drivers.iter().all(|kind| kind.fitted.is_none())
}

fn drive(scratch: &Scratch, scene: &Scene) -> Result<(), Finding> {
    match scene.run(1, &mut |_| ControlFlow::Continue(())) {
        Ok(simulated) => checks::recording(scratch, &simulated.recording),
        Err(error) => checks::refusal(&error, ""),
    }
}

fn seeds(_: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let embedded = Scene::EMBEDDED.iter().map(|(_, text)| *text);
    let texts = embedded.chain([RING, ROAD]).map(|text| [b"a", text.as_bytes()].concat());
    Ok(texts.chain([vec![0], vec![1]]).collect())
}
