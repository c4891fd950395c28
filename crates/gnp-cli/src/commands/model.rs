//! Commands that use a trained model: `predict`, `explain`, `export`, `info`.

use std::io::{self, Write as _};
use std::path::PathBuf;

use anyhow::{Result, bail};
use gnp::{At, ExportRequest, NamedChange, PredictRequest, Question, Run, TracksQuestion, WhatIf};
use gnp_data::TrackOptions;

use crate::arguments::{ExplainArgs, ExportArgs, InfoArgs, PredictArgs, RoadArgs};
use crate::names::Place;
use crate::program::Program;

pub(super) fn predict(args: &PredictArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let PredictArgs { input, output, model, format, k, precision, .. } = args.clone();
    let at = args.every.map_or_else(|| args.at.clone(), At::Every);
    let (k, jobs) = (k.map(usize::from), args.jobs.map(usize::from));
    let tracks = tracks(&args.road)?;
    let request = PredictRequest { input, output, model, format, tracks, at, k, jobs, precision };
    let done = gnp::predict(&request, &machine)?;
    if done.finished_before > 0 {
        machine.progress.note(&format!("{} files were predicted before", done.finished_before));
    }
    machine.progress.result(&format!("{}: {}", done.counts.sentence(), done.output.display()));
    Ok(())
}

/// The command that goes on with an interrupted prediction: the same one.
pub(super) fn again(args: &PredictArgs) -> String {
    let mut line = format!("gnp predict --input {} --output {}", args.input.display(), args.output.display());
    let mut add = |flag: &str, value: Option<String>| {
        line += &value.map_or_else(String::new, |value| format!(" --{flag} {value}"));
    };
    add("model", args.model.as_ref().map(|model| model.display().to_string()));
    add("format", args.format.map(|format| format.to_string()));
    match (&args.every, &args.at) {
        (Some(seconds), _) => add("every", Some(seconds.to_string())),
        (None, At::Last) => {}
        (None, At::Every(_)) => add("at", Some("every".to_owned())),
        (None, At::Times(times)) => {
            add("at", Some(times.iter().map(f64::to_string).collect::<Vec<_>>().join(",")));
        }
    }
    add("k", args.k.map(|k| k.to_string()));
    add("precision", args.precision.map(|precision| precision.to_string()));
    line + &args.road.words()
}

pub(super) fn explain(args: &ExplainArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let what_if = what_if(args);
    let (explained, place) = match (&args.run, &args.input) {
        (Some(_), _) if args.road.any() => bail!("--road and --lines are for tracks (--input)"),
        (Some(folder), _) => {
            let run = Run::open(folder, &machine)?;
            let (recording, vehicle) = (args.recording.clone(), args.vehicle.clone());
            let frame = args.at.map(whole).transpose()?;
            let explained = gnp::explain(&run, &Question { recording, vehicle, frame, what_if })?;
            let place = explained.folder(&run)?;
            (explained, place)
        }
        (None, Some(input)) => {
            let ExplainArgs { model, format, recording, vehicle, at, .. } = args.clone();
            let (input, tracks) = (input.clone(), tracks(&args.road)?);
            let question = TracksQuestion { input, model, format, tracks, recording, vehicle, at_s: at, what_if };
            (gnp::explain_tracks(&question, &machine)?, PathBuf::from("explain"))
        }
        (None, None) => bail!("give a run (--run DIR) or tracks (--input PATH)"),
    };
    if args.json {
        // Not through the terminal, which breaks long lines; a closed pipe is no reason to fail.
        let _ = writeln!(io::stdout().lock(), "{:#}", explained.json());
    } else {
        machine.progress.result(&explained.text());
    }
    let out = args.out.clone().unwrap_or(place);
    explained.save_figures(&out)?;
    machine.progress.note(&format!("figures, as SVG and PNG: {}", out.display()));
    Ok(())
}

/// What is changed: vehicles of the scene in the order of the options, then terms.
fn what_if(args: &ExplainArgs) -> WhatIf {
    let removed = args.without.iter().cloned().map(|vehicle| NamedChange::Remove { vehicle });
    let moved = args.moved.iter().cloned().map(|(vehicle, by)| NamedChange::Move { vehicle, by });
    let speeds = args.speed.iter().cloned().map(|(vehicle, speed_mps)| NamedChange::Speed { vehicle, speed_mps });
    let terms = args.without_term.iter().cloned().map(NamedChange::WithoutTerm);
    let changes = removed.chain(moved).chain(speeds).chain(terms).collect();
    let (added, watch) = (args.add.clone(), args.watch.clone());
    WhatIf { changes, added, goal: args.goal.map(|Place(goal)| goal), watch }
}

/// What readers are told of the road.
pub(super) fn tracks(args: &RoadArgs) -> Result<TrackOptions> {
    let (road, lines) = args.parts()?;
    Ok(gnp::road_options(road.as_deref(), lines.as_deref())?)
}

/// `--at` of a run.
fn whole(at: f64) -> Result<u32> {
    if at.fract() != 0. || !(0. ..=f64::from(u32::MAX)).contains(&at) {
        bail!("--at {at}: give the number of a frame of the run; times are for tracks (--input)");
    }
    Ok(at as u32)
}

pub(super) fn export(args: &ExportArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let ExportArgs { run, out, name, card, .. } = args.clone();
    let request = ExportRequest { run, out, name, card };
    gnp::export(&request, &machine)?;
    machine.progress.result(&format!("model: {0}; its card: {0}/README.md", request.out.display()));
    Ok(())
}

pub(super) fn info(args: &InfoArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let card = gnp::model_card(args.model.as_deref(), &machine)?;
    let text = if args.json { serde_json::to_string_pretty(&card)? + "\n" } else { card.text() };
    // Not through the terminal, which breaks long lines; a closed pipe is no reason to fail.
    let _ = io::stdout().lock().write_all(text.as_bytes());
    Ok(())
}
