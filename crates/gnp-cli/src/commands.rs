//! What each command does.

mod model;
mod play;

use std::io::{self, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, bail};
use gnp::text::duration;
use gnp::{
    CompareRequest, Conversion, DriveOn, Machine, Measured, Measurement, Plan, PredictionsOn, PreparedTable,
    Progress as _, RealismPlan, Recipes, ReplayDrivers, Run, RunConfig, Scene, Scores, Silent, Simulation, Stage,
    memory, score_predictions, score_recordings,
};
use gnp_data::{Dataset, FORMATS};
use gnp_eval::Protocol;

use crate::arguments::{
    Command, CompareArgs, ConvertArgs, EvaluateArgs, FigureArgs, IngestArgs, MeasureArgs, PipelineArgs, RealismArgs,
    ReplayArgs, ReportArgs, RunArgs, SimulateArgs, StageArgs, TableArgs, TrainArgs,
};
use crate::planned::{plan, resolve};
use crate::processes;
use crate::program::Program;
use crate::terminal::Terminal;

pub(crate) fn dispatch(command: &Command, program: &Program) -> Result<()> {
    match command {
        Command::Pipeline(args) => pipeline(args, program),
        Command::Ingest(args) if args.describe => describe(args, program),
        Command::Ingest(args) => ingest(args, program),
        Command::Train(TrainArgs { stage, from, on }) => train(on, stage.map(Stage::from), from.as_deref(), program),
        Command::Modes(on) => train(on, Some(Stage::Modes), None, program),
        Command::Goal(on) => train(on, Some(Stage::Goal), None, program),
        Command::Attraction(on) => train(on, Some(Stage::Attraction), None, program),
        Command::Repulsion(on) => train(on, Some(Stage::Repulsion), None, program),
        Command::Evaluate(args) => evaluate(args, program),
        Command::Compare(args) => compare(args, program),
        Command::Ablate(args) => {
            Ok(gnp::ablate(&table(args, "table2", program)?.0, &crate::machine(&args.machine, program)?)?)
        }
        Command::Figures(args) => figures(args, program),
        Command::Predict(args) => model::predict(args, program),
        Command::Export(args) => model::export(args, program),
        Command::Info(args) => model::info(args, program),
        Command::Explain(args) => model::explain(args, program),
        Command::Play(args) => play::play(args, program),
        Command::Simulate(args) => simulate(args, program),
        Command::Measure(args) => measure(args, program),
        Command::Realism(args) => realism(args, program),
        Command::Convert(args) => convert(args, program),
        Command::Report(args) => report(args, program),
        Command::Replay(args) => replay(args, program),
    }
}

/// The command that goes on with what an interrupted one left in `folder`.
pub(crate) fn to_go_on(command: &Command, folder: &Path) -> Option<String> {
    let folder = folder.display();
    // Resumed with the same words: its folder does not hold the configuration of all of its models.
    let ablate = |args: &TableArgs| {
        let run = &args.run;
        let mut line = "gnp ablate".to_owned();
        let mut add = |flag: &str, value: String| line += &format!(" --{flag} {value}");
        run.dataset.iter().for_each(|dataset| add("dataset", dataset.to_string()));
        run.config.iter().for_each(|file| add("config", file.display().to_string()));
        run.data_dir.iter().for_each(|dir| add("data-dir", dir.display().to_string()));
        run.set.iter().for_each(|setting| add("set", format!("{}={}", setting.key, setting.text)));
        Some(format!("{line}{} --resume --out {folder}", run.road.words()))
    };
    match command {
        // The folder says what it was prepared for.
        Command::Compare(CompareArgs { job: Some(id), .. }) => Some(format!("gnp compare --job {id} --out {folder}")),
        Command::Compare(args) if args.plan || args.gather => None,
        Command::Compare(_) => Some(format!("gnp compare --resume --out {folder}")),
        Command::Ablate(args) => ablate(args),
        // Done again from the start, which takes seconds.
        Command::Simulate(_) | Command::Measure(_) | Command::Realism(_) | Command::Convert(_) => None,
        Command::Predict(args) => Some(model::again(args)),
        Command::Explain(_) | Command::Play(_) => None,
        _ => Some(format!("gnp pipeline --resume --out {folder}")),
    }
}

fn pipeline(args: &PipelineArgs, program: &Program) -> Result<()> {
    let started = Instant::now();
    let machine = crate::machine(&args.machine, program)?;
    let mut run = plan(&args.run, args.from.as_deref(), program)?.begin(&machine)?;
    run.complete()?;
    show(&run.scores()?, args.tables, &machine);
    let root = run.path().display();
    machine.progress.result(&format!("\nAll scores: {root}/metrics.md\nReport:     {root}/report.html"));
    machine.progress.note(&format!(
        "done in {}, peak memory {}; curves: tensorboard --logdir {root}/events",
        duration(started.elapsed()),
        memory::peak_text()
    ));
    Ok(())
}

fn ingest(args: &IngestArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let run = plan(&args.run, None, program)?.ingest(&machine)?;
    let root = run.path().display();
    machine.progress.note(&format!("{root} is ready; next: `gnp train --run {root}`"));
    Ok(())
}

fn describe(args: &IngestArgs, program: &Program) -> Result<()> {
    let terminal = Terminal::start(args.machine.quiet, args.machine.verbose, program);
    let run = &args.run;
    let datasets = match (run.dataset, &run.config) {
        (None, None) => FORMATS.iter().map(|format| format.dataset()).collect(),
        // Of a dataset without a configuration of its own there are files all the same.
        (Some(dataset), None) => vec![dataset],
        _ => vec![resolve(run, None)?.0.dataset],
    };
    if let (Some(dir), true) = (&run.data_dir, datasets.len() > 1) {
        bail!("give --dataset to see what is in {}", dir.display());
    }
    for dataset in datasets {
        terminal.result(&gnp::describe(dataset, run.data_dir.as_deref())?);
    }
    Ok(())
}

fn train(args: &StageArgs, stage: Option<Stage>, from: Option<&Path>, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let mut run = Run::resume(&args.run, &machine)?;
    run.say_data();
    if args.again {
        run.forget(stage.unwrap_or(Stage::Modes))?;
    }
    if let Some(from) = from {
        run.start_from(from)?;
    }
    match stage {
        Some(stage) => run.perform(stage)?,
        None => run.train()?,
    }
    Ok(())
}

fn evaluate(args: &EvaluateArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    match (&args.predictions, &args.run, &args.data_dir) {
        (Some(file), ..) => evaluate_predictions(args, file, &machine),
        (None, Some(folder), None) => {
            if args.out.is_some() {
                bail!("--out is for other recordings (--data-dir); scores on a run's own windows stay in its folder");
            }
            if args.road.any() {
                bail!("--road and --lines are for other recordings (--data-dir); a run's own were read with theirs");
            }
            let mut run = Run::resume(folder, &machine)?;
            run.say_data();
            if args.again {
                run.forget(Stage::Evaluate)?;
            }
            run.perform(Stage::Evaluate)?;
            show(&run.scores()?, args.tables, &machine);
            machine.progress.result(&format!("\nAll scores: {}", run.path().join("metrics.md").display()));
            Ok(())
        }
        (None, Some(folder), Some(data)) => {
            let Some(out) = &args.out else { bail!("give a folder for the scores on other recordings: --out DIR") };
            let mut run = Run::open_model(folder, &machine)?;
            let (road, lane_lines) = args.road.parts()?;
            run.set_road(road, lane_lines);
            let (scores, place) = score_recordings(&run, data, out)?;
            show(&scores, args.tables, &machine);
            machine.progress.result(&format!("\nAll scores: {}", place.join("metrics.md").display()));
            Ok(())
        }
        (None, None, _) => bail!("give a run to score (--run DIR), or predictions (--predictions FILE)"),
    }
}

fn evaluate_predictions(args: &EvaluateArgs, file: &Path, machine: &Machine) -> Result<()> {
    let on = match &args.run {
        Some(folder) if args.data_dir.is_some() => {
            bail!("--data-dir and --run {}: give the run, for its own windows, or other recordings", folder.display())
        }
        Some(folder) => {
            let dataset = Run::open(folder, machine)?.config().dataset;
            if let Some(asked) = args.dataset
                && asked != dataset
            {
                bail!("--dataset {} but {} is of other data", asked.as_str(), folder.display());
            }
            PredictionsOn::Run(folder.clone())
        }
        None => {
            let run = RunArgs {
                dataset: args.dataset,
                data_dir: None,
                config: args.config.clone(),
                out: None,
                resume: false,
                set: args.set.clone(),
                road: args.road.clone(),
            };
            let (config, _) = resolve(&run, None)?;
            PredictionsOn::Recordings { config: Box::new(config), data: args.data_dir.clone() }
        }
    };
    let protocols: Vec<Protocol> = args.protocol.iter().map(|name| (*name).into()).collect();
    let scores = score_predictions(file, &on, &protocols, args.out.as_deref(), machine)?;
    scores.show(machine.progress.as_ref());
    Ok(())
}

/// The short table, and all of them if asked for.
fn show(scores: &Scores, tables: bool, machine: &Machine) {
    let summary = scores.summary();
    if tables || summary.is_none() {
        scores.show(machine.progress.as_ref());
    }
    if let Some(summary) = summary {
        machine.progress.result(&format!("\n{}", summary.terminal()));
    }
}

/// The plan of a table, and the configuration of its full model.
fn table(args: &TableArgs, stem: &str, program: &Program) -> Result<(Plan, RunConfig)> {
    let (config, name) = resolve(&args.run, None)?;
    let out = args.run.out.clone().unwrap_or_else(|| program.run_folder(&format!("{stem}-{name}")));
    let mut plan = Plan::new(config.clone(), args.run.data_dir.clone(), out);
    plan.resume = args.run.resume;
    Ok((plan, config))
}

#[expect(clippy::result_large_err, reason = "the library's error, which it asks for")]
fn compare(args: &CompareArgs, program: &Program) -> Result<()> {
    let on = || crate::machine(&args.table.machine, program);
    // Both are of a prepared folder, which the command line names.
    match (&args.table.run.out, &args.job) {
        (Some(folder), Some(id)) => return Ok(PreparedTable::open(folder)?.perform(id, &on()?)?),
        (Some(folder), None) if args.gather => {
            return Ok(PreparedTable::open(folder)?.gather(args.allow_missing, &on()?)?);
        }
        _ => {}
    }
    let asked = comparison(args, program)?;
    let mut machine = on()?;
    if args.plan {
        if args.json || CompareRequest::is_in(&asked.plan.out) {
            // What is printed is the list alone.
            machine.progress = Arc::new(Silent);
        }
        return show_plan(&PreparedTable::prepare(&asked, &machine)?, args.json);
    }
    let threads = if machine.device.is_cpu() { rayon::current_num_threads() } else { 1 };
    let workers = args.workers.map_or(threads, usize::from);
    let table = PreparedTable::prepare(&asked, &machine)?;
    let device = args.table.machine.device;
    table.perform_all(workers, &machine, |id| processes::perform(table.folder(), id, device, &machine.stop))?;
    Ok(table.gather(false, &machine)?)
}

/// What the command line asks for; of a folder that is prepared, what is not said again stays.
fn comparison(args: &CompareArgs, program: &Program) -> Result<CompareRequest> {
    let run = &args.table.run;
    if let (Some(folder), None, None) = (&run.out, run.dataset, &run.config)
        && (run.resume || args.plan)
        && CompareRequest::is_in(folder)
    {
        if !run.set.is_empty() {
            bail!(
                "{} has its settings; leave --set out, or say which data first: --dataset or --config",
                folder.display()
            );
        }
        return asked_for(args, CompareRequest::read(folder)?);
    }
    let (mut plan, config) = table(&args.table, "table1", program)?;
    // A list may be looked at again.
    plan.resume |= args.plan;
    let earlier = if plan.resume && CompareRequest::is_in(&plan.out) {
        let CompareRequest { plan: earlier, recipes, seeds, published, .. } = CompareRequest::read(&plan.out)?;
        plan.data = plan.data.or(earlier.data);
        let mut asked = CompareRequest::new(plan, recipes);
        (asked.seeds, asked.published) = (seeds, published);
        asked
    } else {
        CompareRequest::new(plan, Recipes::embedded(&config)?)
    };
    asked_for(args, earlier)
}

/// `earlier` with what the command line says.
fn asked_for(args: &CompareArgs, earlier: CompareRequest) -> Result<CompareRequest> {
    let mut asked = earlier;
    if let Some(dir) = &args.table.run.data_dir {
        asked.plan.data = Some(dir.clone());
    }
    if let Some(seeds) = args.seeds {
        asked.seeds = usize::from(seeds);
    }
    let Some(config) = asked.plan.config.clone() else { return Ok(asked) };
    if let Some(path) = &args.recipes {
        asked.recipes = Recipes::read(path, &config)?;
    }
    match &args.published {
        None => {}
        Some(Some(path)) => asked.published = Some(RunConfig::named(path, &[])?),
        Some(None) => asked.published = Some(RunConfig::embedded(&format!("paper/{}", config.dataset), &[])?),
    }
    Ok(asked)
}

/// One line a job, or all as JSON. Not through the terminal, which breaks long lines; a closed pipe is no reason to
/// fail.
fn show_plan(table: &PreparedTable, json: bool) -> Result<()> {
    let text = if json {
        format!("{:#}\n", table.json()?)
    } else {
        table.jobs()?.iter().map(|job| format!("{:<6} {}\n", job.state.name(), job.id)).collect()
    };
    let _ = io::stdout().lock().write_all(text.as_bytes());
    Ok(())
}

fn figures(args: &FigureArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let mut run = match (&args.data_dir, &args.out) {
        (Some(_), _) => Run::open_model(&args.run, &machine)?,
        // They are made again where they are damaged.
        (None, None) => Run::resume(&args.run, &machine)?,
        (None, Some(_)) => Run::open(&args.run, &machine)?,
    }
    .with_scores()?;
    let out = args.out.clone().unwrap_or_else(|| run.path().join("figures"));
    let figures = gnp::draw_figures(&mut run, args.data_dir.as_deref(), &out)?;
    for figure in &figures {
        machine.progress.result(&format!("{}: {}", figure.name, figure.caption));
    }
    machine.progress.note(&format!("{} figures, each as SVG and PNG: {}", figures.len(), out.display()));
    Ok(())
}

fn simulate(args: &SimulateArgs, program: &Program) -> Result<()> {
    if let Some(dataset) = args.dataset {
        return simulate_from(args, dataset, program);
    }
    if args.road.any() {
        bail!("--road and --lines are for recordings (--dataset); the file of a scene has its own");
    }
    if let Some(name) = &args.print {
        let Some((_, text)) = Scene::EMBEDDED.iter().find(|(known, _)| known == name) else {
            let names: Vec<&str> = Scene::EMBEDDED.iter().map(|(known, _)| *known).collect();
            bail!("there is no scene {name}; there are {}", names.join(", "));
        };
        // A closed pipe is no reason to fail.
        let _ = io::stdout().lock().write_all(text.as_bytes());
        return Ok(());
    }
    let machine = crate::machine(&args.machine, program)?;
    let Some(of) = &args.scene else { bail!("name a scene, such as `gnp simulate ring`") };
    let scene = gnp::scene(of)?;
    let out = args.out.clone().unwrap_or_else(|| Path::new("runs").join(&scene.name));
    let simulation = Simulation { scene, seeds: args.seed.clone(), out, fcd: args.fcd };
    tell(&gnp::simulate(&simulation, &machine)?, &machine);
    Ok(())
}

fn simulate_from(args: &SimulateArgs, dataset: Dataset, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let drivers = match &args.run {
        Some(run) => ReplayDrivers::Run(run.clone()),
        None if args.fitted => ReplayDrivers::Fitted,
        None => ReplayDrivers::Standard,
    };
    let of = DriveOn {
        dataset,
        data: args.data_dir.clone(),
        tracks: model::tracks(&args.road)?,
        recording: args.recording.clone(),
        at_s: args.at,
        seconds: args.seconds,
        drivers,
        seeds: if args.seed.is_empty() { vec![0] } else { args.seed.clone() },
        out: args.out.clone().unwrap_or_else(|| Path::new("runs").join(format!("simulated-{dataset}"))),
        fcd: args.fcd,
    };
    tell(&gnp::simulate_from(&of, &machine)?, &machine);
    Ok(())
}

fn realism(args: &RealismArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let mut plan = RealismPlan::embedded(args.dataset);
    plan.data = args.data_dir.clone();
    plan.runs = args.run.clone();
    plan.sumo = args.sumo.clone();
    plan.settings.roll_outs = args.roll_outs.into();
    let table = gnp::realism(&plan, &machine)?;
    let out = args.out.clone().unwrap_or_else(|| Path::new("runs").join(format!("realism-{}", args.dataset)));
    gnp::save_realism(&table, &out)?;
    // Not through the terminal, which breaks long lines; a closed pipe is no reason to fail.
    let _ = io::stdout().lock().write_all(program.named(&gnp::realism_text(&table)).as_bytes());
    machine.progress.note(&format!("all columns, with intervals, in realism.md, .csv and .json: {}", out.display()));
    Ok(())
}

fn measure(args: &MeasureArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let out = args.out.clone().unwrap_or_else(|| Path::new("runs").join(format!("measured-{}", args.dataset)));
    let (dataset, data, tracks) = (args.dataset, args.data_dir.clone(), model::tracks(&args.road)?);
    tell(&gnp::measure(&Measurement { dataset, data, tracks, out }, &machine)?, &machine);
    Ok(())
}

fn convert(args: &ConvertArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let mut conversion = Conversion::new(&args.input, args.to, &args.output);
    conversion.from = args.from;
    let (road, lines) = args.road.parts()?;
    conversion.options = gnp::road_options(road.as_deref(), lines.as_deref())?;
    let converted = gnp::convert(&conversion, &machine)?;
    machine.progress.result(&converted.text());
    let files = &converted.written.files;
    let more = files.len().saturating_sub(3);
    let named = files.iter().take(3).map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ");
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    machine.progress.note(&format!("written: {named}{more}"));
    Ok(())
}

fn tell(measured: &[Measured], machine: &Machine) {
    for one in measured {
        machine.progress.result(&one.text);
        machine.progress.note(&format!("tables, figures and report.html: {}", one.out.display()));
    }
}

fn report(args: &ReportArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    let (page, _) = gnp::write_report(&mut Run::resume(&args.run, &machine)?.with_scores()?)?;
    machine.progress.result(&format!("report: {}", page.display()));
    Ok(())
}

fn replay(args: &ReplayArgs, program: &Program) -> Result<()> {
    let (run, rrd) = (args.run.display(), args.rrd.display());
    if let Err(error) = gnp::can_replay() {
        let command = program.with_feature("rerun");
        bail!("{error}; run `{command} replay --run {run} --rrd {rrd}`, which compiles Rerun first");
    }
    let machine = crate::machine(&args.machine, program)?;
    let replayed = gnp::write_replay(&Run::finished(&args.run, &machine)?, &args.rrd, args.vehicle)?;
    machine.progress.result(&format!(
        "replay: {rrd}, {}, {} vehicles, {} forecasts; opens with `rerun {rrd}` of version {}",
        replayed.heading, replayed.vehicles, replayed.forecasts, replayed.viewer
    ));
    Ok(())
}
