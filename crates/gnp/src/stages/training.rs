//! The three trainings: goal, attraction, repulsion.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::error::{Error, Result, bail};
use gnp_data::{Split, Window, WindowSet};
use gnp_goal::GoalNet;
use gnp_model::{Checkpoint, Component, Features, Gnp, Header, NeighbourFuture};
use gnp_modes::Modes;
use gnp_nn::Weights;
use gnp_train::{
    BatchReport, Checkpoints, End, EpochReport, EventWriter, GoalStage, History, Observer, PathStage, Plan, Stage,
    TrainConfig, TrainError, Trainer, Windows,
};
use gnp_traj::SocialForce;

use crate::machine::Machine;
use crate::progress::Work;
use crate::run::folder::Stage as RunStage;
use crate::run::{Run, origin};
use crate::text::duration;

/// Trains one part of the model: from its last checkpoint if there is one, else from the weights of the run that this one
/// starts from if there is one. The best weights are
/// left in `PART.safetensors`, the curves in `history-PART.json` and `events/`.
///
/// # Errors
/// When the training fails; [`Error::Stopped`].
pub(super) fn train(run: &Run, part: Component) -> Result<()> {
    let set = run.windows()?;
    let (split, features) = run.features(&set)?;
    let config = &run.config;
    let weights = Weights::seeded(config.seed, &run.machine.device);
    let parts = [Windows::new(&set, split.train()), Windows::new(&set, split.validation())];
    let header = header(run, part, &set, &split, &features);
    match part {
        Component::Goal => {
            let modes = Modes::load(&run.folder.path("modes.safetensors"))?;
            let net = GoalNet::new(&config.goal.net, features.goal_shape(), weights.builder())?;
            let stage = GoalStage::new(net, &weights, &features, &modes, parts, &config.goal.loss)?;
            let checkpoints = Checkpoints::new(run.folder.root(), header, &weights);
            fit(run, RunStage::Goal, &stage, &config.goal.train, checkpoints)?;
            fit_trust(run, &set, &split, modes)
        }
        Component::Attraction => {
            let force = SocialForce::new(&config.traj, weights.builder())?;
            let stage = PathStage::attraction(force, &weights, &features, parts, &config.attraction.loss)?;
            fit(
                run,
                RunStage::Attraction,
                &stage,
                &config.attraction.train,
                Checkpoints::new(run.folder.root(), header, &weights),
            )
        }
        Component::Repulsion => {
            let force = SocialForce::new(&config.traj, weights.builder())?;
            let attraction = Header { part: Component::Attraction, ..header.clone() };
            Checkpoints::new(run.folder.root(), attraction, &weights).restore_best()?;
            let neighbours = config.predict.neighbours;
            let stage = PathStage::repulsion(force, &weights, &features, parts, neighbours, &config.repulsion.loss)?;
            fit(
                run,
                RunStage::Repulsion,
                &stage,
                &config.repulsion.train,
                Checkpoints::new(run.folder.root(), header, &weights),
            )
        }
    }
}

/// What the weights are.
fn header(run: &Run, part: Component, set: &WindowSet<'_>, split: &Split, features: &Features) -> Header {
    let (state, config) = (&run.folder.state, &run.config);
    Header {
        part,
        dataset: config.dataset,
        simulated: state.data.simulated,
        shape: set.shape(),
        features: features.clone(),
        goal: (part == Component::Goal).then(|| config.goal.net.clone()),
        traj: (part != Component::Goal).then(|| config.traj.clone()),
        seed: config.seed,
        code_version: env!("CARGO_PKG_VERSION").to_owned(),
        split_hash: split.hash().to_owned(),
        origin: state.origin.clone(),
        trust: None,
        epoch: 0,
        scores: BTreeMap::new(),
        trainer: None,
    }
}

/// Keeps with the trained goal network how much of what it expects is believed, by the validation part; sites weigh as in
/// its validation score.
fn fit_trust(run: &Run, set: &WindowSet<'_>, split: &Split, modes: Modes) -> Result<()> {
    let path = run.folder.path("goal.safetensors");
    let checkpoint = Checkpoint::load(&path)?;
    let gnp = Gnp::new(modes, &checkpoint, None, NeighbourFuture::ConstantVelocity, &run.machine.device)?;
    let windows: Vec<Window<'_>> = split.validation().iter().filter_map(|id| set.get(*id)).collect();
    let mut counts = BTreeMap::<&str, f64>::new();
    windows.iter().for_each(|window| *counts.entry(window.observation().site()).or_default() += 1.);
    let weight = |window: &Window<'_>| {
        let count = counts.get(window.observation().site()).copied().unwrap_or(1.);
        count.powf(-run.config.goal.train.site_sampling_exponent)
    };
    let weighted: Vec<(Window<'_>, f64)> = windows.iter().map(|window| (*window, weight(window))).collect();
    run.machine.stop.check()?;
    let Some(trust) = gnp.fitted_trust(&weighted)? else { return Ok(()) };
    run.note(&format!("goal: {trust:.2} of the expected deviation is believed, by the validation part"));
    Checkpoint { header: Header { trust: Some(trust), ..checkpoint.header }, ..checkpoint }.save(&path)?;
    Ok(())
}

fn fit(run: &Run, part: RunStage, stage: &dyn Stage, config: &TrainConfig, mut checkpoints: Checkpoints) -> Result<()> {
    let name = stage.name();
    let last = checkpoints.last()?;
    if last.is_none()
        && let Some(path) = origin::file(&run.folder, part)
    {
        checkpoints.start_from(&path, &stage.trainable())?;
    }
    let events = EventWriter::create(&run.folder.path("events"))?;
    let watch = Watch::new(&run.machine, name, config.epochs);
    let mut trainer =
        Trainer { config, sink: &mut checkpoints, observer: (watch, events), stop: run.machine.stop.flag() };
    let started = Instant::now();
    let outcome = match &last {
        Some(state) => trainer.resume(stage, state)?,
        None => trainer.fit(stage)?,
    };
    drop(trainer);
    let history = History { stage: name.to_owned(), epochs: outcome.progress.history.clone() };
    history.save(&run.folder.path(format!("history-{name}.json")))?;
    if outcome.end == End::Interrupted {
        return Err(Error::Stopped { kept: None });
    }
    let Some(best) = outcome.progress.best else {
        bail!(Config, "{name}: no epoch was finished; set {name}.epochs above 0")
    };
    checkpoints.close(&outcome.progress)?;
    let early = if outcome.end == End::EarlyStopped { ", stopped early" } else { "" };
    run.note(&format!(
        "{name}: {} epochs in {}{early}; best validation score {:.4} in epoch {}",
        outcome.progress.epoch,
        duration(started.elapsed()),
        best.score,
        best.epoch
    ));
    Ok(())
}

/// Shows a training as it goes.
pub(crate) struct Watch<'a> {
    machine: &'a Machine,
    name: &'a str,
    epochs: usize,
    work: Option<Box<dyn Work>>,
    done: u64,
}

impl<'a> Watch<'a> {
    /// Watches the training called `name` of so many epochs.
    pub(crate) fn new(machine: &'a Machine, name: &'a str, epochs: usize) -> Self {
        Self { machine, name, epochs, work: None, done: 0 }
    }
}

impl Observer for Watch<'_> {
    fn on_start(&mut self, plan: &Plan) -> Result<(), TrainError> {
        self.done = plan.done;
        let total = (plan.epochs * plan.batches) as u64;
        let work = self.machine.progress.start(plan.stage, plan.done, total, "batches");
        self.work = Some(work);
        Ok(())
    }

    fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
        self.done += 1;
        if let Some(work) = &self.work {
            work.at(self.done, &format!("epoch {}, loss {:.4}", report.epoch, report.loss));
        }
        Ok(())
    }

    fn on_epoch(&mut self, report: &EpochReport<'_>) -> Result<(), TrainError> {
        let record = report.record;
        let scores = record.validation.iter().map(|score| format!("{} {:.4}", score.name, score.value));
        let scores = scores.collect::<Vec<_>>().join(", ");
        let best = if report.best { " *" } else { "" };
        self.machine.progress.note(&format!(
            "{}: epoch {}/{}, {}, loss {:.4}; validation {scores}{best}",
            self.name,
            record.epoch,
            self.epochs,
            duration(Duration::from_secs_f64(report.seconds)),
            record.train_loss
        ));
        Ok(())
    }
}
