//! A clip: one carriageway of a recording over some time, with forecasts of its vehicles. The report's
//! scene player and the Rerun viewer play it.

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{Forecast, LaneMarking, MarkingKind, Mode, Observation, Recording, SLOTS, VehicleClass, WindowShape};
use gnp_force::TermDescriptor;

/// Frames shown a second, at most.
const SHOWN_HZ: f64 = 10.;
/// Time between forecasts of a vehicle, s.
const FORECASTS_APART_S: f64 = 1.;
/// Time between the points of a path, and between the arrows along it, s; or the next whole number of frames.
const POINTS_APART_S: f64 = 0.5;

/// One carriageway of a recording over some time, with forecasts. Positions in m, road frame.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Clip {
    /// The recording and where it is from, in words.
    pub title: String,
    /// Made by a simulator.
    pub simulated: bool,
    /// Frames of the recording a second.
    pub rate_hz: f64,
    /// Recorded frame of the first frame shown.
    pub first_frame: u32,
    /// Recorded frames from one frame shown to the next.
    pub frame_step: u32,
    /// Number of frames shown.
    pub frames: usize,
    /// Name of the subset of a split that is evaluated, such as `test`.
    pub subset: String,
    /// Observed time before a forecast, s.
    pub observed_s: f64,
    /// Time that a forecast spans, s.
    pub predicted_s: f64,
    /// Recorded frames from one predicted point to the next.
    pub forecast_step: u32,
    /// Lane lines, from right to left.
    pub lines: Vec<LaneMarking>,
    /// Vehicles that are there in two shown frames or more; two with the same number are two
    /// stretches of one vehicle.
    pub vehicles: Vec<ClipVehicle>,
}

/// A vehicle of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipVehicle {
    /// Vehicle of the file.
    pub id: u32,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Whether it is in the evaluated subset.
    pub evaluated: bool,
    /// Length and width, m.
    pub size: [f32; 2],
    /// Where it is, in consecutive shown frames.
    pub states: Vec<TimedState>,
    /// Its forecasts, by frame.
    pub forecasts: Vec<ClipForecast>,
}

/// Where a vehicle is in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimedState {
    /// Frame of the recording.
    pub frame: u32,
    /// Centre, m.
    pub centre: [f32; 2],
    /// Velocity, m/s.
    pub velocity: [f32; 2],
}

/// A forecast of a vehicle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClipForecast {
    /// Last observed frame of the recording.
    pub frame: u32,
    /// Observed centres, the last one being the origin of the paths, m.
    pub history: Vec<[f32; 2]>,
    /// Who is in each neighbour slot.
    pub neighbours: [ClipNeighbour; SLOTS],
    /// Futures, the prediction first; their paths and goals start at the origin. Of the first one forces
    /// are shown, where it is explained.
    pub modes: Vec<Mode>,
}

/// Who is in a neighbour slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ClipNeighbour {
    /// No vehicle.
    #[default]
    Empty,
    /// A vehicle that is not among those of the clip.
    Outside,
    /// The vehicle of this index in [`Clip::vehicles`].
    Vehicle(usize),
}

/// A stretch of time on a carriageway.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipSpan {
    /// Index of the carriageway in the recording.
    pub road: u16,
    /// First frame of the recording.
    pub first_frame: u32,
    /// Duration, s.
    pub seconds: f64,
}

/// Which vehicles are evaluated.
#[derive(Clone, Copy, Debug)]
pub struct Evaluated<'a> {
    /// Name of the subset.
    pub subset: &'a str,
    /// Indices of its tracks in the recording.
    pub tracks: &'a BTreeSet<usize>,
}

impl Clip {
    /// A clip with nothing in it yet, of a recording at a rate.
    #[must_use]
    pub fn new(title: impl Into<String>, rate_hz: f64) -> Self {
        Self { title: title.into(), rate_hz, frame_step: 1, forecast_step: 1, ..Self::default() }
    }

    /// Every term of the force that explains a prediction, once.
    #[must_use]
    pub fn terms(&self) -> Vec<&TermDescriptor> {
        let forecasts = self.vehicles.iter().flat_map(|vehicle| &vehicle.forecasts);
        let explanations = forecasts.filter_map(|forecast| forecast.modes.first()?.explanation.as_ref());
        let mut terms: Vec<&TermDescriptor> = Vec::new();
        for forces in explanations.flat_map(|explanation| &explanation.terms) {
            if terms.iter().all(|known| known.name != forces.term().name) {
                terms.push(forces.term());
            }
        }
        terms
    }

    /// Cuts a span out of a recording and has every vehicle forecast each second, from windows of
    /// `shape`. `forecast` gives one forecast an observation.
    ///
    /// # Errors
    /// Those of `forecast`. A road that the recording does not have gives an empty clip.
    pub fn cut<'a, E>(
        recording: &'a Recording,
        shape: WindowShape,
        span: ClipSpan,
        evaluated: Evaluated<'_>,
        forecast: impl FnOnce(&[Observation<'a>]) -> Result<Vec<Forecast>, E>,
    ) -> Result<Self, E> {
        let meta = recording.meta();
        let Some(road) = recording.roads().get(usize::from(span.road)) else { return Ok(Self::default()) };
        let frame_step = (meta.rate_hz / SHOWN_HZ).ceil().max(1.) as u32;
        let shown_hz = meta.rate_hz / f64::from(frame_step);
        let title = format!("{}, {}, driving direction {}", meta.name, meta.site, road.driving_direction);
        let mut clip = Self {
            simulated: meta.simulated,
            first_frame: span.first_frame,
            frame_step,
            frames: (span.seconds * shown_hz) as usize,
            subset: evaluated.subset.to_owned(),
            observed_s: shape.t_obs.saturating_sub(1) as f64 * shape.dt(),
            predicted_s: shape.t_pred as f64 * shape.dt(),
            forecast_step: shape.step as u32,
            lines: road.lines.clone(),
            ..Self::new(title, meta.rate_hz)
        };
        let apart = (FORECASTS_APART_S * shown_hz).round().max(1.) as usize;
        // Every vehicle is forecast, whether its windows were trained on or not; what shows it says which.
        let mut asked: Vec<(usize, Observation<'a>)> = Vec::new();
        let mut index_of = BTreeMap::new();
        for (i, track) in recording.tracks().iter().enumerate().filter(|(_, track)| track.road == span.road) {
            let row = |shown: usize| Some((shown, track.row_at(clip.recorded(shown))?));
            let rows: Vec<(usize, usize)> = (0..clip.frames).filter_map(row).collect();
            if rows.len() < 2 {
                continue;
            }
            let index = clip.vehicles.len();
            index_of.insert(i, index);
            let due = rows.iter().filter(|(shown, _)| shown.is_multiple_of(apart));
            asked.extend(due.filter_map(|(_, row)| Some((index, Observation::new(recording, shape, i, *row).ok()?))));
            let state = |(shown, row): &(usize, usize)| {
                let state = recording.state(*row);
                TimedState { frame: clip.recorded(*shown), centre: [state.x, state.y], velocity: [state.vx, state.vy] }
            };
            let states = rows.iter().map(state).collect();
            clip.vehicles.push(ClipVehicle {
                id: track.vehicle,
                class: track.class,
                evaluated: evaluated.tracks.contains(&i),
                size: [track.length, track.width],
                states,
                forecasts: Vec::new(),
            });
        }
        let observations: Vec<Observation<'a>> = asked.iter().map(|(_, observation)| *observation).collect();
        for ((index, seen), forecast) in asked.iter().zip(forecast(&observations)?) {
            clip.vehicles[*index].forecasts.push(ClipForecast::of(seen, forecast, &index_of));
        }
        Ok(clip)
    }

    /// The title, and *simulated* where the recording is.
    #[must_use]
    pub fn heading(&self) -> String {
        format!("{}{}", self.title, if self.simulated { " (simulated)" } else { "" })
    }

    /// The last recorded frame in which a vehicle is there, 0 in an empty clip.
    #[must_use]
    pub fn last_frame(&self) -> u32 {
        let last = self.vehicles.iter().filter_map(|vehicle| vehicle.states.last());
        last.map(|state| state.frame).max().unwrap_or(0)
    }

    /// Predicted points from one that is shown to the next.
    #[must_use]
    pub fn points_every(&self) -> usize {
        (POINTS_APART_S * self.rate_hz / f64::from(self.forecast_step.max(1))).round().max(1.) as usize
    }

    /// The vehicle that moves sideways most while it is forecast; of equals the lowest number, those
    /// that are evaluated before others. `None` where no vehicle is forecast.
    #[must_use]
    pub fn liveliest(&self) -> Option<u32> {
        let sideways = |vehicle: &ClipVehicle| {
            let first = vehicle.forecasts.first()?.frame;
            let ys = vehicle.states.iter().filter(|state| state.frame >= first).map(|state| state.centre[1]);
            let (low, high) = ys.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
            (high - low).is_finite().then_some(high - low)
        };
        let forecast = self.vehicles.iter().filter_map(|vehicle| Some((vehicle, sideways(vehicle)?)));
        let best = forecast.max_by(|(a, a_moves), (b, b_moves)| {
            a.evaluated.cmp(&b.evaluated).then(a_moves.total_cmp(b_moves)).then(b.id.cmp(&a.id))
        });
        best.map(|(vehicle, _)| vehicle.id)
    }

    /// Numbers of the vehicles that are forecast, in order.
    #[must_use]
    pub fn forecast_ids(&self) -> Vec<u32> {
        let mut ids: Vec<u32> = self.vehicles.iter().filter(|v| !v.forecasts.is_empty()).map(|v| v.id).collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    /// Recorded frame of a shown one.
    fn recorded(&self, shown: usize) -> u32 {
        self.first_frame + shown as u32 * self.frame_step
    }

    /// Shown frame of a recorded one.
    pub(crate) fn shown(&self, recorded: u32) -> usize {
        (recorded.saturating_sub(self.first_frame) / self.frame_step.max(1)) as usize
    }
}

impl ClipForecast {
    fn of(seen: &Observation<'_>, forecast: Forecast, index_of: &BTreeMap<usize, usize>) -> Self {
        let [x0, y0] = seen.origin();
        let point = |i| {
            let state = seen.target(i);
            [x0 + state.x, y0 + state.y]
        };
        Self {
            frame: seen.frame(),
            history: (0..seen.shape().t_obs).map(point).collect(),
            neighbours: seen
                .neighbours()
                .map(|slot| match slot.map(|other| index_of.get(&other.track_index())) {
                    None => ClipNeighbour::Empty,
                    Some(None) => ClipNeighbour::Outside,
                    Some(Some(vehicle)) => ClipNeighbour::Vehicle(*vehicle),
                })
                .0,
            modes: forecast.modes,
        }
    }
}

/// What a kind of vehicle is called.
#[must_use]
pub fn class_name(class: VehicleClass) -> &'static str {
    match class {
        VehicleClass::Motorcycle => "motorcycle",
        VehicleClass::Car => "car",
        VehicleClass::Truck => "truck",
    }
}

/// Whether a line is an edge of the carriageway.
pub(crate) fn is_boundary(line: &LaneMarking) -> bool {
    line.kind == MarkingKind::Boundary
}
