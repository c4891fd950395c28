//! `POST /v1/predict`: forecasts of the vehicles of a scene.

use gnp::{Future, UnknownVehicle, Unpredicted, VehicleForecast};
use gnp_data::Past;
use gnp_model::Workspace;
use gnp_plot::class_name;
use serde::{Deserialize, Serialize};

use crate::app::App;
use crate::object::Object;
use crate::problem::{Problem, ProblemKind};
use crate::recordings::centimetres;
use crate::scene::{ChangeRequest, Changes, Scene, SceneRequest, refused};

/// Time between the points of a path, s, unless another one is asked for.
pub(crate) const EVERY_S: f64 = 0.2;

/// The body of a request.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PredictRequest {
    scene: Object<SceneRequest>,
    changes: Option<Vec<Object<ChangeRequest>>>,
    k: Option<usize>,
    every_s: Option<f64>,
    vehicles: Option<Vec<String>>,
}

/// The answer.
#[derive(Debug, Serialize)]
pub(crate) struct Predicted {
    model: String,
    simulated: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    recording: Option<String>,
    time_s: f64,
    dt_s: f64,
    forecasts: Vec<Forecasted>,
    left_out: Vec<LeftOut>,
}

#[derive(Debug, Serialize)]
struct Forecasted {
    id: String,
    at: [f64; 2],
    velocity: [f64; 2],
    size: [f64; 2],
    class: &'static str,
    past: &'static str,
    observed_s: f64,
    leader: Option<String>,
    neighbours: Vec<Option<String>>,
    modes: Vec<Mode>,
}

/// A way on.
#[derive(Debug, Serialize)]
pub(crate) struct Mode {
    probability: f64,
    goal: [f64; 2],
    path: Vec<[f64; 2]>,
}

#[derive(Debug, Serialize)]
struct LeftOut {
    id: String,
    reason: String,
}

impl PredictRequest {
    /// The answer. Work for a thread that may be busy.
    ///
    /// # Errors
    /// A problem with its field.
    pub(crate) fn answer(&self, app: &App, workspace: &mut Workspace) -> Result<Predicted, Problem> {
        let predictor = &app.model.predictor;
        let k = app.model.futures(self.k)?;
        let every = app.model.points_every(self.every_s.unwrap_or(EVERY_S), "every_s")?;
        let scene = self.scene.resolve(app)?;
        let changes = Changes::of(self.changes.as_deref().unwrap_or_default(), &scene)?;
        let changed = scene.moment.changed(&changes.all).map_err(|error| refused(&error))?;
        let now = changed.now();
        let asked: Option<Vec<u32>> = match &self.vehicles {
            Some(names) => Some(
                names
                    .iter()
                    .enumerate()
                    .map(|(i, name)| {
                        let field = format!("vehicles[{i}]");
                        let number = changes.names.number(name).map_err(|error| unknown(&field, &error))?;
                        now.scene().present(number).map_err(|_| not_there(&field, name))?;
                        Ok(number)
                    })
                    .collect::<Result<_, _>>()?,
            ),
            None => None,
        };
        let on_road = |road: u16| scene.road.is_none_or(|asked| asked == road);
        let wanted: Vec<u32> = now
            .vehicles()
            .filter(|it| on_road(it.track().road))
            .map(|it| it.vehicle())
            .filter(|vehicle| asked.as_ref().is_none_or(|asked| asked.contains(vehicle)))
            .collect();
        if wanted.len() > app.config.max_vehicles {
            let detail = format!(
                "{} vehicles are to be predicted; at most {} are at once, name some of them",
                wanted.len(),
                app.config.max_vehicles
            );
            return Err(Problem::at(ProblemKind::TooManyVehicles, "vehicles", detail));
        }
        let found = predictor.forecasts(&changed, Some(&wanted), k, workspace).map_err(failed)?;
        app.metrics.vehicles.inc_by(found.forecasts.len() as u64);
        let name = |vehicle: u32| now.name(vehicle);
        let forecasts = found.forecasts.iter().map(|forecast| of_vehicle(forecast, &scene, every, &name));
        let reasons = found.left_out.iter().map(|out| LeftOut { id: name(out.vehicle), reason: reason(out.reason) });
        let missing = scene.missing.iter().map(|(id, reason)| LeftOut { id: id.clone(), reason: reason.clone() });
        Ok(Predicted {
            model: app.model.name().to_owned(),
            simulated: scene.simulated || app.model.is_simulated(),
            recording: scene.recording.clone(),
            time_s: now.time_s(),
            dt_s: every as f64 * app.model.shape().dt(),
            forecasts: forecasts.collect(),
            left_out: reasons.chain(missing).collect(),
        })
    }
}

fn of_vehicle(forecast: &VehicleForecast, scene: &Scene, every: usize, name: &dyn Fn(u32) -> String) -> Forecasted {
    let VehicleForecast { vehicle, class, size, road, at, velocity, past, observed_s, .. } = forecast;
    Forecasted {
        id: name(*vehicle),
        at: scene.place(*road, *at).map(short),
        velocity: scene.velocity(*road, *at, *velocity).map(short),
        size: size.map(centimetres),
        class: class_name(*class),
        past: if *past == Past::Full { "full" } else { "filled" },
        observed_s: short(*observed_s),
        leader: forecast.leader.map(name),
        neighbours: forecast.neighbours.iter().map(|other| other.map(name)).collect(),
        modes: forecast.modes.iter().map(|mode| Mode::of(mode, scene, *road, *at, every)).collect(),
    }
}

impl Mode {
    fn of(mode: &Future, scene: &Scene, road: u16, at: [f32; 2], every: usize) -> Self {
        Self::from_parts(mode.probability, mode.goal, &mode.path, scene, (road, at), every)
    }

    /// A way whose goal and path, m, count from `at` on a carriageway; of the path every so manieth point.
    pub(crate) fn from_parts(
        probability: f32,
        goal: [f32; 2],
        path: &[[f32; 2]],
        scene: &Scene,
        (road, [x, y]): (u16, [f32; 2]),
        every: usize,
    ) -> Self {
        let place = |by: &[f32; 2]| scene.place(road, [x + by[0], y + by[1]]).map(short);
        Self {
            probability: (f64::from(probability) * 1e4).round() / 1e4,
            goal: place(&goal),
            path: path.iter().skip(every.saturating_sub(1)).step_by(every.max(1)).map(place).collect(),
        }
    }
}

/// To two places.
pub(crate) fn short(value: f64) -> f64 {
    (value * 100.).round() / 100.
}

fn reason(why: Unpredicted) -> String {
    match why {
        Unpredicted::NoVelocity => "it was seen in one frame alone, which tells no velocity".to_owned(),
        Unpredicted::NotFinite => "the model gives no finite path for it".to_owned(),
        other => other.to_string(),
    }
}

/// Nobody is called so.
pub(crate) fn unknown(field: &str, error: &UnknownVehicle) -> Problem {
    Problem::at(ProblemKind::UnknownVehicle, field, error.to_string())
}

/// Somebody is called so who is gone, or whom only the rows of a follower tell.
pub(crate) fn not_there(field: &str, name: &str) -> Problem {
    let detail = format!("vehicle {name} is removed, or has no track of its own");
    Problem::at(ProblemKind::UnknownVehicle, field, detail)
}

/// What a prediction is refused for.
pub(crate) fn failed(error: gnp::Error) -> Problem {
    match error {
        gnp::Error::Change(error) => refused(&error),
        other => Problem::new(ProblemKind::Internal, other.chain()),
    }
}
