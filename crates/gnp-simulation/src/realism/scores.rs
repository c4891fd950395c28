//! Scores of systems on replays.
use super::{
    Feature, RealismSettings, Table,
    bootstrap::estimate,
    likelihood::{score, whole},
    measured::Measured,
};
use crate::{
    error::SimulationError,
    replay::{ClosedLoop, Path, Replay, Trace},
};
use gnp_measures::{Sample, Samples};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

/// The row of what happened.
const RECORDED: &str = "what happened";

/// A mean and its interval of 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// Displacement up to a horizon, in m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Horizon {
    /// The horizon, in s.
    pub horizon_s: f64,
    /// Vehicles that are recorded so long, in all scenes.
    pub vehicles: usize,
    /// Mean over time, vehicles and roll-outs.
    pub ade: Estimate,
    /// That of the best roll-out of each scene, one for all vehicles in it.
    pub min_ade: Estimate,
    /// At the horizon along the road, without sign.
    pub along: f64,
    /// At the horizon along the road: positive for who is too far ahead.
    pub bias: f64,
    /// At the horizon across the road, without sign.
    pub across: f64,
}

/// What a system makes of the scenes of a site.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Row {
    /// The site.
    pub site: String,
    /// Whether its recordings were made by a simulator.
    pub simulated: bool,
    /// The system.
    pub system: String,
    /// Whether it was made from what the scored vehicles did after the start.
    pub uses_future: bool,
    /// Scenes.
    pub scenes: usize,
    /// Roll-outs of each.
    pub roll_outs: usize,
    /// Vehicles scored, in all scenes.
    pub vehicles: usize,
    /// Displacements, by horizon.
    pub horizons: Vec<Horizon>,
    /// Realism as a whole, 0 to 1.
    pub realism: Option<Estimate>,
    /// Realism by feature; the mean of the scenes.
    pub features: BTreeMap<Feature, f64>,
    /// First Wasserstein distance of speed, in m/s.
    pub speed_distance: Option<f64>,
    /// That of acceleration, in m/s².
    pub acceleration_distance: Option<f64>,
    /// That of the gap, in m.
    pub gap_distance: Option<f64>,
    /// That of time to collision where it is at most 60 s, in s.
    pub ttc_distance: Option<f64>,
    /// Changes of lane a vehicle-kilometre.
    pub lane_changes_per_vehicle_km: Option<f64>,
    /// Contacts a vehicle-hour.
    pub contacts_per_vehicle_h: Option<f64>,
    /// Vehicles that came in late, and that did not come in, a roll-out of all scenes.
    pub late_and_never: [f64; 2],
    /// Share of the driven vehicle-frames in which the system could not decide.
    pub stood_in: f64,
}

/// Lets systems drive replays and scores them, what happened first; rows by site, then in the order of the systems.
///
/// # Errors
/// What a system fails with.
pub fn compare(
    replays: &[Replay],
    systems: &[&dyn ClosedLoop],
    settings: &RealismSettings,
) -> Result<Table, SimulationError> {
    let mut sites: BTreeMap<(String, bool), Vec<&Replay>> = BTreeMap::new();
    for replay in replays {
        sites.entry((replay.scene().site.clone(), replay.scene().simulated)).or_default().push(replay);
    }
    let mut rows = Vec::new();
    for ((site, simulated), replays) in sites {
        let truths: Vec<Measured> =
            replays.par_iter().map(|replay| Measured::of(replay.scene(), replay.truth())).collect();
        let happened: Vec<Scored> = replays
            .iter()
            .zip(&truths)
            .map(|(replay, truth)| Scored::of(replay, truth, vec![replay.truth().clone()], settings))
            .collect();
        let first = Head { site: &site, simulated, system: RECORDED, uses_future: true };
        rows.push(row(first, &replays, &truths, &happened, settings));
        for system in systems {
            let seeds = if system.draws() { settings.roll_outs.max(1) as u64 } else { 1 };
            let scored: Vec<Scored> = replays
                .par_iter()
                .zip(&truths)
                .map(|(replay, truth)| {
                    let roll_outs: Result<Vec<Trace>, SimulationError> =
                        (0..seeds).map(|seed| system.drive(replay.scene(), seed)).collect();
                    Ok(Scored::of(replay, truth, roll_outs?, settings))
                })
                .collect::<Result<_, SimulationError>>()?;
            let head = Head { site: &site, simulated, system: system.name(), uses_future: system.uses_future() };
            rows.push(row(head, &replays, &truths, &scored, settings));
        }
    }
    Ok(Table { rows })
}

/// What a scene contributes.
struct Scored {
    roll_outs: Vec<Measured>,
    late_and_never: [usize; 2],
    stood_in: usize,
    driven_frames: usize,
    /// By horizon.
    displacements: Vec<Displacement>,
    features: Vec<Option<f64>>,
}

/// Sums over the vehicles that are recorded up to a horizon; means over roll-outs.
#[derive(Clone, Copy, Default)]
struct Displacement {
    vehicles: usize,
    ade: f64,
    min_ade: f64,
    along: f64,
    bias: f64,
    across: f64,
}

impl Scored {
    fn of(replay: &Replay, truth: &Measured, traces: Vec<Trace>, settings: &RealismSettings) -> Self {
        let scene = replay.scene();
        let roll_outs: Vec<Measured> = traces.iter().map(|trace| Measured::of(scene, trace)).collect();
        let features = Feature::ALL.map(|feature| score(feature, scene, truth, &roll_outs));
        let driven = |trace: &Trace| -> usize {
            let paths = trace.paths.iter().zip(&scene.actors).filter(|(_, actor)| actor.is_driven());
            paths.map(|(path, _)| path.states.len()).sum()
        };
        Self {
            late_and_never: [traces.iter().map(|trace| trace.late).sum(), traces.iter().map(|trace| trace.never).sum()],
            stood_in: traces.iter().map(|trace| trace.stood_in).sum(),
            driven_frames: traces.iter().map(driven).sum(),
            displacements: settings.horizons_s.iter().map(|horizon| displacement(replay, &traces, *horizon)).collect(),
            features: features.to_vec(),
            roll_outs,
        }
    }
}

fn displacement(replay: &Replay, traces: &[Trace], horizon_s: f64) -> Displacement {
    let scene = replay.scene();
    let last = (horizon_s * scene.rate_hz).round() as usize;
    let long_enough = |index: &usize| replay.truth().paths[*index].end() > last && scene.actors[*index].is_scored();
    let who: Vec<usize> = (0..scene.actors.len()).filter(long_enough).collect();
    let mut sum = Displacement { vehicles: who.len(), min_ade: f64::INFINITY, ..Displacement::default() };
    if who.is_empty() || last == 0 {
        return Displacement::default();
    }
    let share = 1.0 / traces.len().max(1) as f64;
    for trace in traces {
        let mut ade = 0.0;
        for &index in &who {
            let (truth, path) = (&replay.truth().paths[index], &trace.paths[index]);
            let apart = |frame: usize| Some(place(path, frame, scene.dt())? - truth.at(frame)?.position.coords);
            ade += (1..=last).filter_map(apart).map(|apart| apart.norm()).sum::<f64>() / last as f64;
            if let Some(end) = apart(last) {
                sum.along += end.x.abs() * share;
                sum.bias += end.x * share;
                sum.across += end.y.abs() * share;
            }
        }
        sum.ade += ade * share;
        sum.min_ade = sum.min_ade.min(ade);
    }
    sum
}

/// Where a vehicle is; beyond the end of its path, on at its last speed.
fn place(path: &Path, frame: usize, dt: f64) -> Option<gnp_force::na::Vector2<f64>> {
    if let Some(state) = path.at(frame) {
        return Some(state.position.coords);
    }
    let last = path.states.last()?;
    let missing = (frame + 1).saturating_sub(path.end()) as f64;
    let way = gnp_force::na::Vector2::new(last.velocity.x * dt * missing, 0.0);
    Some(last.position.coords + way)
}

struct Head<'a> {
    site: &'a str,
    simulated: bool,
    system: &'a str,
    uses_future: bool,
}

fn row(head: Head<'_>, replays: &[&Replay], truths: &[Measured], scored: &[Scored], settings: &RealismSettings) -> Row {
    let horizons = settings.horizons_s.iter().enumerate().filter_map(|(place, horizon_s)| {
        let found: Vec<&Displacement> = scored.iter().map(|scene| &scene.displacements[place]).collect();
        let vehicles: usize = found.iter().map(|scene| scene.vehicles).sum();
        let by_scene = |of: fn(&Displacement) -> f64| {
            let pairs: Vec<(f64, f64)> = found.iter().map(|scene| (of(scene), scene.vehicles as f64)).collect();
            estimate(&pairs)
        };
        let mean = |of: fn(&Displacement) -> f64| found.iter().map(|scene| of(scene)).sum::<f64>() / vehicles as f64;
        Some(Horizon {
            horizon_s: *horizon_s,
            vehicles,
            ade: by_scene(|scene| scene.ade)?,
            min_ade: by_scene(|scene| scene.min_ade)?,
            along: mean(|scene| scene.along),
            bias: mean(|scene| scene.bias),
            across: mean(|scene| scene.across),
        })
    });
    let wholes: Vec<(f64, f64)> =
        scored.iter().filter_map(|scene| whole(&scene.features)).map(|score| (score, 1.0)).collect();
    let features = Feature::ALL.iter().enumerate().filter_map(|(place, feature)| {
        let scores: Vec<f64> = scored.iter().filter_map(|scene| scene.features[place]).collect();
        (!scores.is_empty()).then(|| (*feature, scores.iter().sum::<f64>() / scores.len() as f64))
    });
    let (theirs, ours) = (pooled(truths.iter()), pooled(scored.iter().flat_map(|scene| &scene.roll_outs)));
    let all = || scored.iter().flat_map(|scene| &scene.roll_outs);
    let roll_outs = scored.first().map_or(0, |scene| scene.roll_outs.len());
    let share = |count: usize, of: f64| (of > 0.0).then(|| count as f64 / of);
    let lane_changes = all().flat_map(|measured| &measured.lane_changes).sum();
    let contacts = all().map(|measured| measured.touches.len()).sum();
    let driven: usize = scored.iter().map(|scene| scene.driven_frames).sum();
    let is_scored = |replay: &&Replay| replay.scene().actors.iter().filter(|actor| actor.is_scored()).count();
    Row {
        site: head.site.to_owned(),
        simulated: head.simulated,
        system: head.system.to_owned(),
        uses_future: head.uses_future,
        scenes: replays.len(),
        roll_outs,
        vehicles: replays.iter().map(is_scored).sum(),
        horizons: horizons.collect(),
        realism: estimate(&wholes),
        features: features.collect(),
        speed_distance: ours.speed.wasserstein(&theirs.speed),
        acceleration_distance: ours.acceleration.wasserstein(&theirs.acceleration),
        gap_distance: ours.gap.wasserstein(&theirs.gap),
        ttc_distance: ours.ttc.wasserstein(&theirs.ttc),
        lane_changes_per_vehicle_km: share(lane_changes, all().map(|measured| measured.vehicle_km).sum()),
        contacts_per_vehicle_h: share(contacts, all().map(|measured| measured.vehicle_h).sum()),
        late_and_never: [0, 1].map(|which| {
            let count: usize = scored.iter().map(|scene| scene.late_and_never[which]).sum();
            count as f64 / roll_outs.max(1) as f64
        }),
        stood_in: scored.iter().map(|scene| scene.stood_in).sum::<usize>() as f64 / driven.max(1) as f64,
    }
}

/// The values of all driven vehicles and moments.
fn pooled<'a>(measured: impl Iterator<Item = &'a Measured> + Clone) -> Samples {
    let moments = || measured.clone().flat_map(|measured| measured.moments.iter().flatten());
    let mut samples = Samples::default();
    samples.speed = Sample::new(moments().map(|moment| moment.speed));
    samples.acceleration = Sample::new(moments().filter_map(|moment| moment.acceleration));
    samples.gap = Sample::new(moments().filter_map(|moment| moment.gap));
    let closing = moments().filter_map(|moment| moment.ttc).filter(|ttc| *ttc <= Samples::LONGEST_TTC);
    samples.ttc = Sample::new(closing);
    samples
}
