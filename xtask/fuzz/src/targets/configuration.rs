//! Configurations of runs: any text, changed ones, and settings of the command line.

use arbitrary::{Arbitrary, Unstructured};
use gnp::{RunConfig, Setting};
use serde_json::Value;

use crate::finding::promise;
use crate::made::kind;
use crate::patch::{self, Patch};
use crate::{Finding, Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "configuration",
    about: "configuration files and --set",
    run,
    seeds,
    words: &[
        "goal.epochs=",
        "traj.encoder=[",
        "split.sites={",
        "[windows]",
        "rate_hz = ",
        "= \"fitted\"",
        "= nan",
        "= -1",
        "= 1e300",
        "= 9223372036854775807",
    ],
};

/// Embedded configurations.
const NAMES: [&str; 3] = ["smoke", "ngsim", "paper/highd"];

/// What a setting may say.
const VALUES: [&str; 18] = [
    "0",
    "1",
    "-1",
    "2",
    "3",
    "0.0",
    "0.5",
    "1e9",
    "1e300",
    "nan",
    "inf",
    "9223372036854775807",
    "[]",
    "[0]",
    "{}",
    "true",
    "platoon",
    "\"\"",
];

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    match kind {
        b'a' => from_file(scratch, rest, &[]),
        b's' => {
            let text = String::from_utf8_lossy(rest);
            let settings: Vec<&str> = text.lines().collect();
            set(scratch, &settings)
        }
        _ => made(scratch, kind, rest),
    }
}

/// A changed configuration, or settings of keys that there are.
fn made(scratch: &Scratch, kind: u8, bytes: &[u8]) -> Result<(), Finding> {
    let config = RunConfig::embedded(NAMES[usize::from(kind) % NAMES.len()], &[]).map_err(Finding::case)?;
    let mut value: Value = serde_json::to_value(&config).map_err(Finding::case)?;
    let mut bytes = Unstructured::new(bytes);
    if kind < 128 {
        let Ok(patches) = Vec::<Patch>::arbitrary(&mut bytes) else { return Ok(()) };
        patch::apply(&mut value, &patches);
        // What has no form in TOML, such as null, is no text to read.
        let Ok(text) = toml::to_string(&value) else { return Ok(()) };
        return from_file(scratch, text.as_bytes(), &[]);
    }
    let mut keys = Vec::new();
    leaves(&value, "", &mut keys);
    let Ok(chosen) = Vec::<(u16, u8)>::arbitrary(&mut bytes) else { return Ok(()) };
    let setting = |(key, value): (u16, u8)| {
        format!("{}={}", keys[usize::from(key) % keys.len()], VALUES[usize::from(value) % VALUES.len()])
    };
    let settings: Vec<String> = chosen.into_iter().map(setting).collect();
    set(scratch, &settings.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Dotted paths of all leaves.
fn leaves(value: &Value, path: &str, found: &mut Vec<String>) {
    match value {
        Value::Object(entries) if !entries.is_empty() => {
            for (key, value) in entries {
                leaves(value, &if path.is_empty() { key.clone() } else { format!("{path}.{key}") }, found);
            }
        }
        _ => found.push(path.to_owned()),
    }
}

fn set(scratch: &Scratch, texts: &[&str]) -> Result<(), Finding> {
    let mut settings: Vec<Setting> = Vec::new();
    for text in texts {
        match text.parse() {
            Ok(setting) => settings.push(setting),
            Err(message) => {
                let message: String = message;
                return checks::refusal_text(&message, "=");
            }
        }
    }
    match RunConfig::embedded("smoke", &settings) {
        Ok(config) => reads_back(scratch, &config),
        Err(error) => checks::refusal_text(&error.chain(), ""),
    }
}

fn from_file(scratch: &Scratch, text: &[u8], settings: &[Setting]) -> Result<(), Finding> {
    let file = scratch.only("case.toml", text)?;
    match RunConfig::read(&file, settings) {
        Ok(config) => reads_back(scratch, &config),
        Err(error) => checks::refusal_text(&error.chain(), "case.toml"),
    }
}

/// The run folder keeps the configuration as text: it must come back.
fn reads_back(scratch: &Scratch, config: &RunConfig) -> Result<(), Finding> {
    let text = config.to_toml().map_err(|error| Finding::Believed(error.chain()))?;
    let file = scratch.made("config.toml");
    std::fs::write(&file, &text)?;
    let again = RunConfig::read(&file, &[])
        .map_err(|error| Finding::Believed(format!("does not read back: {}", error.chain())))?;
    promise(again == *config, || format!("a configuration that reads back as another: {text}"))
}

/// A configuration without its comments, settings, and one of each made-up kind.
fn seeds(_: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let smoke = RunConfig::embedded("smoke", &[]).map_err(Finding::case)?;
    let text = smoke.to_toml().map_err(Finding::case)?;
    let settings = "sgoal.epochs=3\ntraj.hidden=12\nsplit.kind=time\nwindows.site_stride_s={\"i-80\"=2.0}";
    Ok(vec![[b"a", text.as_bytes()].concat(), settings.into(), vec![0], vec![200]])
}
