//! Scenes of requests: a moment of a recording, or tracks that the request brings; and what is changed in them.

mod changes;
mod tracks;

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use gnp::Moment;
use gnp_data::Road;
use serde::Deserialize;

pub(crate) use self::changes::{ChangeRequest, Changes, refused};
use self::tracks::{LineRequest, VehicleRequest};
use crate::app::App;
use crate::object::Object;
use crate::problem::{Problem, ProblemKind};
use crate::recordings::road_is_there;

/// Moments of recordings that are kept: those between which a page goes to and fro.
const KEPT: usize = 32;

/// A scene as a request has it: one of the two kinds.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SceneRequest {
    recording: Option<String>,
    road: Option<usize>,
    time_s: Option<f64>,
    lines: Option<Vec<Object<LineRequest>>>,
    vehicles: Option<Vec<Object<VehicleRequest>>>,
    axis: Option<Vec<[f64; 2]>>,
}

/// A scene that can be predicted.
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) moment: Arc<Moment>,
    /// Name of the recording.
    pub(crate) recording: Option<String>,
    /// The one carriageway that is meant; all of a request's own tracks.
    pub(crate) road: Option<u16>,
    /// Vehicles that the request brings and the moment does not have: name and why.
    pub(crate) missing: Vec<(String, String)>,
    pub(crate) simulated: bool,
}

impl SceneRequest {
    /// The scene. Work for a thread that may be busy.
    ///
    /// # Errors
    /// A problem with its field.
    pub(crate) fn resolve(&self, app: &App) -> Result<Scene, Problem> {
        match (&self.recording, &self.vehicles) {
            (Some(name), None) => self.of_recording(name, app),
            (None, Some(vehicles)) => self.of_tracks(vehicles, app),
            (Some(_), Some(_)) => Err(invalid("scene", "give a recording, or vehicles with their tracks, not both")),
            (None, None) => {
                Err(invalid("scene", "give a recording (recording, time_s), or vehicles with their tracks"))
            }
        }
    }

    fn of_recording(&self, name: &str, app: &App) -> Result<Scene, Problem> {
        for (there, field) in [(self.lines.is_some(), "scene.lines"), (self.axis.is_some(), "scene.axis")] {
            if there {
                return Err(invalid(field, "a recording has its own"));
            }
        }
        let (number, recording) = app.recordings.named(name, "scene.recording")?;
        let road = self.road.unwrap_or(0);
        road_is_there(recording, road, "scene.road")?;
        let Some(time_s) = self.time_s else {
            return Err(invalid("scene.time_s", "say when, s on the recording's clock"));
        };
        let meta = recording.meta();
        let frame = ((time_s - meta.start_s) * meta.rate_hz).round().clamp(0., f64::from(u32::MAX)) as u32;
        let key = (number, frame);
        let moment = match app.moments.get(key) {
            // A time outside of the recording has the frame of an end.
            Some(kept) if (kept.time_s() - time_s).abs() <= 0.51 / meta.rate_hz => kept,
            _ => {
                let made = Moment::at_time(recording, time_s, app.model.shape());
                let made =
                    made.map_err(|error| Problem::at(ProblemKind::OutsideRecording, "scene.time_s", error.chain()))?;
                app.moments.put(key, made)
            }
        };
        let road = u16::try_from(road).ok();
        let simulated = meta.simulated;
        Ok(Scene { moment, recording: Some(name.to_owned()), road, missing: Vec::new(), simulated })
    }

    fn of_tracks(&self, vehicles: &[Object<VehicleRequest>], app: &App) -> Result<Scene, Problem> {
        for (there, field) in [(self.road.is_some(), "scene.road"), (self.time_s.is_some(), "scene.time_s")] {
            if there {
                return Err(invalid(field, "the moment of a scene of tracks is their last time, on their road"));
            }
        }
        let most = app.config.max_vehicles;
        if vehicles.len() > most {
            let detail =
                format!("there are {}; at most {most} are taken, --max-vehicles says how many", vehicles.len());
            return Err(Problem::at(ProblemKind::TooManyVehicles, "scene.vehicles", detail));
        }
        let (recording, missing) = tracks::recording(vehicles, self.lines.as_deref(), self.axis.as_deref())?;
        let last = crate::recordings::ends(&recording)[1];
        let moment = Moment::at_frame(&recording, last, app.model.shape())
            .map_err(|error| Problem::at(ProblemKind::InvalidTracks, "scene.vehicles", error.chain()))?;
        Ok(Scene { moment: Arc::new(moment), recording: None, road: None, missing, simulated: false })
    }
}

impl Scene {
    /// A carriageway of the scene.
    pub(crate) fn road_of(&self, road: u16) -> Option<&Road> {
        self.moment.snapshot().recording().roads().get(usize::from(road))
    }

    /// Whether places are those of the plane of a request, into which a carriageway has to be put back.
    pub(crate) fn is_in_plane(&self) -> bool {
        self.recording.is_none()
    }

    /// A place along and across a carriageway, m, in the coordinates of the scene.
    pub(crate) fn place(&self, road: u16, [x, y]: [f32; 2]) -> [f64; 2] {
        let (x, y) = (f64::from(x), f64::from(y));
        let axis = self.road_of(road).and_then(|road| road.axis.as_ref()).filter(|_| self.is_in_plane());
        axis.map_or([x, y], |axis| axis.to_world(x, y))
    }

    /// The carriageway on which something new is at a place of the scene, and the place along and across it, m; `None` off the
    /// road.
    pub(crate) fn road_at(&self, at: [f64; 2]) -> Option<(u16, [f32; 2])> {
        if let (false, Some(road)) = (self.is_in_plane(), self.road) {
            return Some((road, at.map(|value| value as f32)));
        }
        // Of several carriageways the one on whose lanes it is, or the first.
        let roads = self.moment.snapshot().recording().roads();
        let place = |road: &Road| {
            let point = road.axis.as_ref()?.to_road(at)?;
            Some([point.s as f32, point.d as f32])
        };
        let within = |road: &Road, y: f32| {
            let ends = road.lines.first().zip(road.lines.last());
            ends.is_some_and(|(right, left)| (right.y..=left.y).contains(&y))
        };
        let places = || (0..).zip(roads).filter_map(|(index, road)| Some((index, road, place(road)?)));
        let on = places().find(|(_, road, [_, y])| within(road, *y)).or_else(|| places().next());
        on.map(|(index, _, at)| (index, at))
    }

    /// A velocity, m/s, as [`Scene::place`].
    pub(crate) fn velocity(&self, road: u16, [x, y]: [f32; 2], velocity: [f32; 2]) -> [f64; 2] {
        let velocity = velocity.map(f64::from);
        let axis = self.road_of(road).and_then(|road| road.axis.as_ref()).filter(|_| self.is_in_plane());
        axis.map_or(velocity, |axis| axis.at(f64::from(x), f64::from(y)).velocity_to_world(velocity))
    }
}

fn invalid(field: &str, detail: &str) -> Problem {
    Problem::at(ProblemKind::InvalidRequest, field, detail)
}

/// Moments of recordings that were asked for lately, the latest last.
#[derive(Debug, Default)]
pub(crate) struct Moments(Mutex<VecDeque<(MomentKey, Arc<Moment>)>>);

/// Number of the recording and frame.
type MomentKey = (usize, u32);

impl Moments {
    fn get(&self, key: MomentKey) -> Option<Arc<Moment>> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let place = kept.iter().position(|(known, _)| *known == key)?;
        let found = kept.remove(place)?;
        let moment = Arc::clone(&found.1);
        kept.push_back(found);
        Some(moment)
    }

    fn put(&self, key: MomentKey, moment: Moment) -> Arc<Moment> {
        let moment = Arc::new(moment);
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Two requests may have made the same one.
        kept.retain(|(known, _)| *known != key);
        if kept.len() >= KEPT {
            kept.pop_front();
        }
        kept.push_back((key, Arc::clone(&moment)));
        moment
    }
}
