//! From a clip to records.

use std::collections::BTreeMap;

use gnp_data::{Explanation, LaneMarking, MarkingKind, Mode, SLOTS};
use gnp_force::{Arity, TermDescriptor, TermParameter};
use gnp_plot::{Clip, ClipVehicle, class_name};

use crate::colour::Colour;
use crate::record::{Drawing, Record, Row};

/// Length of an arrow for an acceleration of 1 m/s², m.
pub const ARROW_M: f32 = 4.;
/// Radius of the ring around the picked vehicle, m.
pub const RING_M: f32 = 30.;

/// Corners of the ring.
const CORNERS: usize = 72;
/// How far lane lines reach beyond the vehicles, m.
const BEYOND_M: f32 = 20.;
/// Names of the neighbour slots, in the order of [`gnp_data::Slot::ALL`].
const SLOT_NAMES: [&str; SLOTS] =
    ["ahead", "behind", "left ahead", "left beside", "left behind", "right ahead", "right beside", "right behind"];

/// What each entity shows, ordered by path. The crate's page lists the entities. Around the vehicle `picked` is a ring,
/// and the text says how to see another one.
#[must_use]
pub fn records(clip: &Clip, picked: Option<u32>) -> Vec<Record> {
    let mut entities = Entities::default();
    entities.add("/about", None, Drawing::Text(about(clip, picked)));
    road(clip, &mut entities);
    for vehicle in &clip.vehicles {
        boxes(clip, vehicle, picked == Some(vehicle.id), &mut entities);
        forecasts(clip, vehicle, &mut entities);
    }
    entities.finish()
}

/// Rows by entity.
#[derive(Default)]
struct Entities(BTreeMap<String, Vec<Row>>);

impl Entities {
    fn add(&mut self, entity: impl Into<String>, frame: Option<u32>, drawing: Drawing) {
        self.0.entry(entity.into()).or_default().push(Row { frame, drawing });
    }

    /// Names the series of an entity, once.
    fn name(&mut self, entity: &str, names: impl FnOnce() -> Vec<String>) {
        if !self.0.contains_key(entity) {
            self.add(entity, None, Drawing::Series(names()));
        }
    }

    fn finish(self) -> Vec<Record> {
        let sorted = |mut rows: Vec<Row>| {
            rows.sort_by_key(|row| row.frame);
            rows
        };
        self.0.into_iter().map(|(entity, rows)| Record { entity, rows: sorted(rows) }).collect()
    }
}

fn road(clip: &Clip, entities: &mut Entities) {
    let xs = clip.vehicles.iter().flat_map(|vehicle| &vehicle.states).map(|state| state.centre[0]);
    let (low, high) = xs.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    if low > high {
        return;
    }
    let ends = [low - BEYOND_M, high + BEYOND_M];
    for (entity, kind, colour, radius) in [
        ("/road/boundaries", MarkingKind::Boundary, Colour::BOUNDARY, 1.5),
        ("/road/centre_lines", MarkingKind::LaneDivider, Colour::CENTRE_LINE, 0.75),
    ] {
        let lines: Vec<&LaneMarking> = clip.lines.iter().filter(|line| line.kind == kind).collect();
        let strips = lines.iter().map(|line| ends.map(|x| [x, line.y]).to_vec()).collect();
        let colours = vec![colour; lines.len()];
        entities.add(entity, None, Drawing::Strips { strips, colours, radius, labels: Vec::new() });
    }
}

fn boxes(clip: &Clip, vehicle: &ClipVehicle, picked: bool, entities: &mut Entities) {
    let id = vehicle.id;
    let colour = match (picked, vehicle.evaluated) {
        (true, _) => Colour::PICKED,
        (false, true) => Colour::EVALUATED,
        (false, false) => Colour::VEHICLE,
    };
    let kind = class_name(vehicle.class);
    let (entity, speed) = (format!("/vehicles/{id}"), format!("/scalars/{id}/speed"));
    entities.name(&speed, || vec!["speed, m/s".to_owned()]);
    for state in &vehicle.states {
        let label = format!("{kind} {id}");
        let drawing = Drawing::Box { centre: state.centre, size: vehicle.size, colour, label };
        entities.add(&entity, Some(state.frame), drawing);
        let [vx, vy] = state.velocity;
        entities.add(&speed, Some(state.frame), Drawing::Scalars(vec![vx.hypot(vy)]));
        if picked {
            entities.add("/picked", Some(state.frame), ring(state.centre));
        }
    }
    // Without a word the viewer keeps what it was last told; in the last frame that is as it should be.
    let after = vehicle.states.last().map(|state| state.frame + clip.frame_step);
    if let Some(after) = after.filter(|after| *after <= clip.last_frame()) {
        let ring = picked.then(|| "/picked".to_owned());
        for entity in [entity, format!("/forecasts/{id}")].into_iter().chain(ring) {
            entities.add(entity, Some(after), Drawing::Gone);
        }
    }
}

/// Tells how far it is, and gives the eye something of a size to follow.
fn ring([x, y]: [f32; 2]) -> Drawing {
    let corner = |i: usize| {
        let (sin, cos) = (i as f32 / CORNERS as f32 * std::f32::consts::TAU).sin_cos();
        [x + RING_M * cos, y + RING_M * sin]
    };
    Drawing::Strips {
        strips: vec![(0..=CORNERS).map(corner).collect()],
        colours: vec![Colour::RING],
        radius: 0.5,
        labels: Vec::new(),
    }
}

fn forecasts(clip: &Clip, vehicle: &ClipVehicle, entities: &mut Entities) {
    let every = clip.points_every();
    let last_seen = vehicle.states.last().map_or(0, |state| state.frame);
    for (i, forecast) in vehicle.forecasts.iter().enumerate() {
        let (Some(origin), Some(likeliest)) = (forecast.history.last(), forecast.modes.first()) else { continue };
        let (id, frame) = (vehicle.id, Some(forecast.frame));
        let history = Drawing::Strips {
            strips: vec![forecast.history.clone()],
            colours: vec![Colour::HISTORY],
            radius: 1.5,
            labels: Vec::new(),
        };
        entities.add(format!("/forecasts/{id}/history"), frame, history);
        entities.add(format!("/forecasts/{id}/futures"), frame, futures(*origin, &forecast.modes, every));
        let probability = format!("/scalars/{id}/probability");
        entities.name(&probability, || (1..=forecast.modes.len()).map(|i| format!("path {i}")).collect());
        let probabilities = forecast.modes.iter().map(|mode| mode.probability).collect();
        entities.add(probability, frame, Drawing::Scalars(probabilities));

        let Some(explanation) = &likeliest.explanation else { continue };
        forces(id, frame, *origin, likeliest, explanation, every, entities);
        // Each forecast speaks until the next one does, or the vehicle is gone.
        let next = vehicle.forecasts.get(i + 1).map_or(last_seen + 1, |next| next.frame);
        let frames = (forecast.frame..next).step_by(clip.forecast_step.max(1) as usize);
        for (frame, step) in frames.zip(0..explanation.steps()) {
            parameters(id, frame, explanation, step, entities);
        }
    }
}

fn futures(origin: [f32; 2], modes: &[Mode], every: usize) -> Drawing {
    let colour = |i| if i == 0 { Colour::BEST } else { Colour::OTHERS };
    Drawing::Strips {
        strips: modes.iter().map(|mode| points(origin, mode, every)).collect(),
        colours: (0..modes.len()).map(colour).collect(),
        radius: 1.5,
        labels: modes.iter().map(|mode| format!("{:.0} %", 100. * mode.probability)).collect(),
    }
}

/// The origin, then every n-th predicted point.
fn points([x, y]: [f32; 2], mode: &Mode, every: usize) -> Vec<[f32; 2]> {
    let path = mode.path.iter().skip(every - 1).step_by(every);
    std::iter::once([x, y]).chain(path.map(|[dx, dy]| [x + dx, y + dy])).collect()
}

/// A force acts from the point where the vehicle is before the step.
fn forces(
    id: u32,
    frame: Option<u32>,
    origin: [f32; 2],
    mode: &Mode,
    explanation: &Explanation,
    every: usize,
    entities: &mut Entities,
) {
    let shown: Vec<usize> = (0..explanation.steps()).step_by(every).collect();
    let origins: Vec<[f32; 2]> = points(origin, mode, every).into_iter().take(shown.len()).collect();
    for forces in &explanation.terms {
        let vectors = shown.iter().map(|step| forces.total(*step).map(|a| a * ARROW_M)).collect();
        let colour = Colour::parse(&forces.term().colour);
        let drawing = Drawing::Arrows { origins: origins.clone(), vectors, colour };
        entities.add(format!("/forecasts/{id}/forces/{}", forces.term().name), frame, drawing);
    }
}

/// Every parameter of a step that varies, by source.
fn parameters(id: u32, frame: u32, explanation: &Explanation, step: usize, entities: &mut Entities) {
    for forces in &explanation.terms {
        let term = forces.term();
        for (i, parameter) in term.varying().enumerate() {
            let values = forces.parameter(i, step);
            if values.is_empty() {
                continue;
            }
            let entity = format!("/scalars/{id}/{}", scalar(&term.name, &parameter.name));
            entities.name(&entity, || series(term.arity, parameter, values.len()));
            entities.add(entity, Some(frame), Drawing::Scalars(values.to_vec()));
        }
    }
}

/// Where the scalars of a parameter stand below those of a vehicle.
pub(crate) fn scalar(term: &str, parameter: &str) -> String {
    format!("{term}/{parameter}")
}

/// Names of the values of a parameter by source.
fn series(arity: Arity, parameter: &TermParameter, sources: usize) -> Vec<String> {
    match arity {
        Arity::One => vec![format!("{}, {}", parameter.name, parameter.unit)],
        Arity::PerNeighbour => SLOT_NAMES.iter().take(sources).map(|name| (*name).to_owned()).collect(),
        Arity::PerLine => (1..=sources).map(|i| format!("line {i} from the right")).collect(),
    }
}

fn about(clip: &Clip, picked: Option<u32>) -> String {
    let simulated = if clip.simulated { "Made from *simulated* data.\n\n" } else { "" };
    let picked = picked.map_or_else(String::new, |id| {
        format!(
            "Vehicle {id} is picked: its box is orange, with a ring of {RING_M} m around it, its forecasts are in the view of \
             the road, and its scalars beside that. To see another one, put its number for {id} in the contents of the view of \
             the road, and in the origins of the others.\n\n"
        )
    });
    let described = |term: &TermDescriptor| format!("{} ({})", term.meaning, term.colour);
    let forces = clip.terms().into_iter().map(described).collect::<Vec<_>>().join(", ");
    format!(
        "# {}\n\n{simulated}Forward is x, left is y, in m; `time` is the frame number divided by {} Hz.\n\n{picked}\
         A forecast is made each second, from the history in dark grey. The prediction is dark red, the other paths are \
         green; pointing at one tells its probability. Arrows stand along the prediction where its vehicle then is: \
         {forces}; {ARROW_M} m of arrow are 1 m/s². \
         Scalars are those of the latest forecast's prediction.\n\n\
         Grey boxes of vehicles of the {} subset are darker.\n",
        clip.title, clip.rate_hz, clip.subset
    )
}
