//! A stretch of a recording with forecasts in it.

use gnp_data::{LaneMarking, Mode, VehicleClass};
use gnp_force::TermDescriptor;

/// One carriageway of a recording over some time. Positions are in the road frame, m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The recording and where it is from, in words.
    pub title: String,
    /// Made by a simulator.
    pub simulated: bool,
    /// Frames of the recording a second.
    pub rate_hz: f64,
    /// Frames of the recording from one moment of a vehicle to the next.
    pub frame_step: u32,
    /// Lane lines.
    pub lines: Vec<LaneMarking>,
    /// Vehicles; two with the same number are two stretches of one vehicle.
    pub vehicles: Vec<Vehicle>,
    /// Vehicle whose forecasts and scalars are shown when the file is opened.
    pub picked: Option<u32>,
}

/// A vehicle over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Vehicle {
    /// Vehicle of the file.
    pub id: u32,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Whether it is in the test part of the run that forecasts it.
    pub test: bool,
    /// Length and width, m.
    pub size: [f32; 2],
    /// Where it is, by frame.
    pub moments: Vec<TimedState>,
    /// Its forecasts, by frame.
    pub forecasts: Vec<SceneForecast>,
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
pub struct SceneForecast {
    /// Last observed frame.
    pub frame: u32,
    /// Frames of the recording from one predicted point to the next.
    pub frame_step: u32,
    /// Observed centres, the last one being the origin of the paths, m.
    pub history: Vec<[f32; 2]>,
    /// Futures, likeliest first; their paths and goals start at the origin.
    pub modes: Vec<Mode>,
}

impl Scene {
    /// The title, and *simulated* where the recording is.
    #[must_use]
    pub fn heading(&self) -> String {
        format!("{}{}", self.title, if self.simulated { " (simulated)" } else { "" })
    }

    /// Every term of the force that explains a forecast, once.
    pub(crate) fn terms(&self) -> Vec<&TermDescriptor> {
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

    /// The last frame in which anybody is there, 0 in an empty scene.
    pub(crate) fn last_frame(&self) -> u32 {
        let last = self.vehicles.iter().filter_map(|vehicle| vehicle.moments.last());
        last.map(|moment| moment.frame).max().unwrap_or(0)
    }

    /// The vehicle that moves sideways most while it is forecast; of equals the lowest number, those of the test part
    /// before others. `None` where nobody is forecast.
    #[must_use]
    pub fn liveliest(&self) -> Option<u32> {
        let sideways = |vehicle: &Vehicle| {
            let first = vehicle.forecasts.first()?.frame;
            let ys = vehicle.moments.iter().filter(|moment| moment.frame >= first).map(|moment| moment.centre[1]);
            let (low, high) = ys.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
            (high - low).is_finite().then_some(high - low)
        };
        let forecast = self.vehicles.iter().filter_map(|vehicle| Some((vehicle, sideways(vehicle)?)));
        let best = forecast.max_by(|(a, a_moves), (b, b_moves)| {
            a.test.cmp(&b.test).then(a_moves.total_cmp(b_moves)).then(b.id.cmp(&a.id))
        });
        best.map(|(vehicle, _)| vehicle.id)
    }
}
