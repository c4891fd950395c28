//! `POST /v1/explain`: what is behind the forecast of a vehicle, and what a changed scene does to it.

use gnp::ExplainedForecast;
use gnp_force::Arity;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::app::App;
use crate::object::Object;
use crate::predict::{EVERY_S, Mode, failed, not_there, short, unknown};
use crate::problem::{Problem, ProblemKind};
use crate::scene::{ChangeRequest, Changes, Scene, SceneRequest};

/// The body of a request.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ExplainRequest {
    scene: Object<SceneRequest>,
    vehicle: String,
    changes: Option<Vec<Object<ChangeRequest>>>,
    k: Option<usize>,
}

impl ExplainRequest {
    /// The answer: what `gnp explain --json` says, with places, futures and forces. Work for a thread that may be busy.
    ///
    /// # Errors
    /// A problem with its field.
    pub(crate) fn answer(&self, app: &App) -> Result<Value, Problem> {
        let k = app.model.futures(self.k)?;
        let scene = self.scene.resolve(app)?;
        let changes = Changes::of(self.changes.as_deref().unwrap_or_default(), &scene)?;
        let number = changes.names.number(&self.vehicle).map_err(|error| unknown("vehicle", &error))?;
        let road = match scene.moment.snapshot().vehicle(number) {
            Some(present) if present.observation().is_none() => {
                let detail = format!("vehicle {} was seen in one frame alone, which tells no velocity", self.vehicle);
                return Err(Problem::at(ProblemKind::UnknownVehicle, "vehicle", detail));
            }
            Some(present) => present.track().road,
            None => changes.road_of_added(number).ok_or_else(|| not_there("vehicle", &self.vehicle))?,
        };
        let explained = app.model.predictor.explain(&scene.moment, number, &changes.all, k).map_err(failed)?;
        let sides = [("as_it_is", explained.as_it_is.as_ref()), ("changed", explained.changed.as_ref())];
        app.metrics.vehicles.inc_by(sides.iter().filter(|(_, forecast)| forecast.is_some()).count() as u64);
        let every = app.model.points_every(EVERY_S, "every_s")?;
        let mut answer = explained.json();
        for (name, forecast) in sides {
            let Some(forecast) = forecast else { continue };
            add(&mut answer[name], forecast, &scene, road, every);
        }
        answer["model"] = json!(app.model.name());
        answer["time_s"] = json!(scene.moment.time_s());
        if scene.recording.is_none() {
            answer["recording"] = Value::Null;
        }
        round(&mut answer);
        Ok(answer)
    }
}

/// Adds places, futures, forces and parameters of a forecast to its account.
fn add(account: &mut Value, forecast: &ExplainedForecast, scene: &Scene, road: u16, every: usize) {
    let modes: Vec<Mode> = forecast
        .forecast
        .modes
        .iter()
        .map(|mode| {
            let goal = mode.explanation.as_ref().map_or_else(Default::default, |explanation| explanation.goal);
            Mode::from_parts(mode.probability, goal, &mode.path, scene, (road, forecast.at), every)
        })
        .collect();
    account["at"] = json!(scene.place(road, forecast.at).map(short));
    account["modes"] = json!(modes);
    let explanation = forecast.forecast.modes.first().and_then(|mode| mode.explanation.as_ref());
    let (mut forces, mut parameters) = (Vec::new(), Vec::new());
    for acting in explanation.into_iter().flat_map(|explanation| &explanation.terms) {
        let (term, totals) = (acting.term(), acting.totals());
        forces.push(json!({
            "term": term.name,
            "label": term.label,
            "colour": term.colour,
            "unit": term.unit,
            "values": totals,
        }));
        // Those of lane lines differ in number from road to road.
        if term.arity == Arity::PerLine {
            continue;
        }
        let slots = term.arity == Arity::PerNeighbour;
        for (i, parameter) in term.varying().enumerate() {
            let values = (0..totals.len()).map(|step| match acting.parameter(i, step) {
                values if slots => json!(values),
                values => json!(values.first()),
            });
            parameters.push(json!({
                "term": term.name,
                "name": parameter.name,
                "title": parameter.meaning,
                "unit": parameter.unit,
                "slots": slots,
                "values": values.collect::<Vec<_>>(),
            }));
        }
    }
    account["forces"] = Value::Array(forces);
    account["parameters"] = Value::Array(parameters);
}

/// Numbers to 0.1 mm: more is noise.
fn round(value: &mut Value) {
    match value {
        Value::Array(values) => values.iter_mut().for_each(round),
        Value::Object(fields) => fields.values_mut().for_each(round),
        Value::Number(number) if number.is_f64() => {
            if let Some(rounded) = number.as_f64().map(|it| (it * 1e4).round() / 1e4) {
                *value = json!(rounded);
            }
        }
        _ => {}
    }
}
