//! Scenes for Eclipse SUMO, and what it made of them: the files of `xtask/peer/sumo_replay.py`.
use super::{Actor, ClosedLoop, Path, RuleDrivers, Scene, Trace};
use crate::error::SimulationError;
use gnp_force::{Rule, State};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A scene as `sumo_replay.py` reads it; its `--help` says what stands there. Vehicles go by their place in
/// [`Scene::actors`]. Drivers of the intelligent driver model are handed over number by number; with another rule, and
/// without drivers, SUMO takes its own. Drawn drivers are those of seed 0.
///
/// # Errors
/// When every driver is in the scene himself.
pub fn export_sumo(
    scene: &Scene,
    drivers: Option<&RuleDrivers>,
    seeds: &[u64],
    speed_limit: f64,
) -> Result<Value, SimulationError> {
    let chosen = drivers.map(|drivers| drivers.chosen(scene, 0)).transpose()?;
    let round = |value: f64| (value * 1e6).round() / 1e6;
    let (mut vehicles, mut replayed) = (Vec::new(), Vec::new());
    for (index, actor) in scene.actors.iter().enumerate() {
        let Actor { size: [length, width], start, .. } = actor;
        let enter = round(actor.enters as f64 * scene.dt());
        match &actor.motion {
            Some(motion) => {
                let state =
                    |state: &State<f64>| [state.position.x, state.position.y, state.velocity.x.max(0.0)].map(round);
                let states: Vec<_> = motion.iter().map(state).collect();
                replayed.push(json!({
                    "id": index, "length": length, "width": width, "enter": enter, "states": states,
                }));
            }
            None => {
                let driver = chosen.as_ref().map(|chosen| &chosen.by_actor[index]);
                let idm = driver.and_then(|driver| match driver.rule {
                    Rule::Idm(idm) => Some(json!({
                        "accel": idm.acceleration, "decel": idm.braking, "tau": idm.time_gap,
                        "minGap": idm.standstill_gap,
                    })),
                    _ => None,
                });
                vehicles.push(json!({
                    "id": index, "length": length, "width": width, "enter": enter,
                    "lane": scene.lane_at(scene.aim(actor)),
                    "x": round(start.position.x), "y": round(start.position.y),
                    "speed": round(start.velocity.x.max(0.0)),
                    "desired_speed": driver.map(|driver| driver.desired_speed), "idm": idm,
                }));
            }
        }
    }
    Ok(json!({
        "name": scene.name, "step": round(scene.dt()), "duration": round(scene.frames as f64 * scene.dt()),
        "road": {
            "lines": scene.lines.iter().map(|line| line.y).collect::<Vec<_>>(),
            "from": scene.section[0], "to": scene.section[1], "speed_limit": speed_limit,
        },
        "vehicles": vehicles, "replayed": replayed, "seeds": seeds,
    }))
}

/// The courses in the positions that `sumo_replay.py` wrote of a scene, by seed. Lateral positions are those of the file, so
/// the script is to be called with `--keep-offset`. Who has left the section goes on at his last speed, as in every other
/// system.
///
/// # Errors
/// [`SimulationError::Positions`] for the first line that is not as it must be.
pub fn import_sumo(scene: &Scene, csv: &str) -> Result<Vec<Trace>, SimulationError> {
    let fail = |line: usize, reason: &str| SimulationError::Positions { line: line + 1, reason: reason.to_owned() };
    let mut lines = csv.lines().enumerate();
    let head: Vec<&str> = lines.next().map_or_else(Vec::new, |(_, head)| head.split(',').collect());
    let column = |name: &str| {
        head.iter().position(|column| *column == name).ok_or_else(|| fail(0, &format!("there is no column {name}")))
    };
    let [seed, step, id, x, y, speed] = ["seed", "step", "id", "x", "y", "speed"].map(column);
    let columns = [seed?, step?, id?, x?, y?, speed?];
    let mut traces: BTreeMap<u64, Vec<Path>> = BTreeMap::new();
    for (line, text) in lines {
        let cells: Vec<&str> = text.split(',').collect();
        let number = |column: usize| {
            let cell = cells.get(columns[column]).and_then(|cell| cell.parse::<f64>().ok());
            cell.filter(|value| value.is_finite()).ok_or_else(|| fail(line, &format!("no number in column {column}")))
        };
        let (seed, step, id) = (number(0)?, number(1)?, number(2)?);
        let paths = traces.entry(seed as u64).or_insert_with(|| vec![Path::default(); scene.actors.len()]);
        let path = paths.get_mut(id as usize).ok_or_else(|| fail(line, "there is no such vehicle in the scene"))?;
        if path.states.is_empty() {
            path.first = step as usize;
        }
        if path.end() != step as usize {
            return Err(fail(line, "a step of this vehicle is missing before this one"));
        }
        path.states.push(State::new(number(3)?, number(4)?, number(5)?, 0.0));
    }
    Ok(traces.into_values().map(|paths| finished(scene, paths)).collect())
}

fn finished(scene: &Scene, mut paths: Vec<Path>) -> Trace {
    let mut trace = Trace::default();
    for (actor, path) in scene.actors.iter().zip(&mut paths).filter(|(actor, _)| actor.is_driven()) {
        let due = actor.enters <= scene.frames;
        match path.states.last().copied() {
            None if due => {
                trace.never += 1;
                trace.waited_s += (scene.frames - actor.enters) as f64 * scene.dt();
            }
            None => {}
            Some(last) => {
                trace.late += usize::from(path.first > actor.enters);
                trace.waited_s += path.first.saturating_sub(actor.enters) as f64 * scene.dt();
                let missing = (scene.frames + 1).saturating_sub(path.end());
                path.states.extend((1..=missing).map(|frame| {
                    let way = last.velocity.x * scene.dt() * frame as f64;
                    State::new(last.position.x + way, last.position.y, last.velocity.x, 0.0)
                }));
            }
        }
    }
    Trace { paths, ..trace }
}

/// Courses that another simulator drove, by scene.
#[derive(Clone, Debug, Default)]
pub struct Imported {
    /// Its name in tables.
    pub name: String,
    /// Whether its drivers were fitted to the scored vehicles themselves.
    pub uses_future: bool,
    /// The courses by name of the scene, one a seed.
    pub courses: BTreeMap<String, Vec<Trace>>,
}

impl ClosedLoop for Imported {
    fn name(&self) -> &str {
        &self.name
    }

    fn draws(&self) -> bool {
        self.courses.values().any(|courses| courses.len() > 1)
    }

    fn uses_future(&self) -> bool {
        self.uses_future
    }

    fn drive(&self, scene: &Scene, seed: u64) -> Result<Trace, SimulationError> {
        let courses = self.courses.get(&scene.name).filter(|courses| !courses.is_empty());
        let missing = || SimulationError::NoDrivers { system: self.name.clone(), scene: scene.name.clone() };
        let courses = courses.ok_or_else(missing)?;
        Ok(courses[seed as usize % courses.len()].clone())
    }
}
