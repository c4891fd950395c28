//! What scene players play: the busiest minute of the longest recording, with a forecast of every
//! vehicle each second.

use std::collections::{BTreeMap, BTreeSet};

use crate::error::Result;
use gnp_data::{
    Explanation, Forecast, Observation, Predictor as _, Recording, Split, Track, VehicleClass, WindowSet, WindowShape,
};

use crate::figures::traffic::{SHOWN_S, busiest_of};
use crate::run::Run;

/// Frames shown a second, at most.
const RATE_HZ: f64 = 10.;
/// Time between forecasts of a vehicle, s.
const APART_S: f64 = 1.;
/// Time between the points of a forecast that are shown, s.
const EVERY_S: f64 = 0.5;

/// One carriageway of a recording over some time, with forecasts.
pub(crate) struct Clip<'a> {
    /// The recording.
    pub(crate) recording: &'a Recording,
    /// Index of the carriageway.
    pub(crate) road: u16,
    /// Windows that forecasts are made from.
    pub(crate) shape: WindowShape,
    /// Recorded frames from one shown frame to the next.
    pub(crate) step: u32,
    /// Shown frames a second.
    pub(crate) rate: f64,
    /// Number of shown frames.
    pub(crate) frames: usize,
    /// Recorded frame of the first one.
    pub(crate) first_frame: u32,
    /// Vehicles that are there in two shown frames or more.
    pub(crate) vehicles: Vec<Shown<'a>>,
    /// In the order of the vehicles, then of time.
    pub(crate) forecasts: Vec<Made<'a>>,
}

/// A vehicle of a clip.
pub(crate) struct Shown<'a> {
    /// Its track.
    pub(crate) track: &'a Track,
    /// Whether the track is in the test part of the run.
    pub(crate) test: bool,
    /// Shown frames in which it is there, each with its row in the recording.
    pub(crate) rows: Vec<(usize, usize)>,
}

/// A forecast of a vehicle of a clip.
pub(crate) struct Made<'a> {
    /// Index of the vehicle.
    pub(crate) vehicle: usize,
    /// Shown frame of the last observation.
    pub(crate) frame: usize,
    /// What the model saw.
    pub(crate) seen: Observation<'a>,
    /// Index of the vehicle in each neighbour slot; -1 where it is not among the vehicles, -2 where nobody is.
    pub(crate) neighbours: Vec<i32>,
    /// What it said, with the forces of the likeliest future.
    pub(crate) forecast: Forecast,
}

impl Made<'_> {
    /// The forces behind the likeliest future.
    pub(crate) fn explanation(&self) -> Option<&Explanation> {
        self.forecast.modes.first()?.explanation.as_ref()
    }
}

impl<'a> Clip<'a> {
    /// The clip of a run; `None` without test windows or without lanes.
    ///
    /// # Errors
    /// When the recordings or the model cannot be used, or the user interrupts.
    pub(crate) fn of(run: &'a Run, set: &WindowSet<'a>, split: &Split) -> Result<Option<Self>> {
        let recordings = run.recordings()?;
        let tested: BTreeSet<(u32, u32)> = split.test().iter().map(|id| (id.recording, id.track)).collect();
        let Some((index, lane)) = busiest_of(recordings, |i| tested.iter().any(|(r, _)| *r as usize == i)) else {
            return Ok(None);
        };
        let recording = &recordings[index];
        let step = (recording.meta().rate_hz / RATE_HZ).ceil().max(1.) as u32;
        let rate = recording.meta().rate_hz / f64::from(step);
        let frames = (SHOWN_S * rate) as usize;
        let first_frame = lane.first_frame;
        let mut vehicles = Vec::new();
        let mut index_of = BTreeMap::new();
        for (i, track) in recording.tracks().iter().enumerate().filter(|(_, track)| track.road == lane.road) {
            let row = |frame: usize| Some((frame, track.row_at(first_frame + frame as u32 * step)?));
            let rows: Vec<(usize, usize)> = (0..frames).filter_map(row).collect();
            if rows.len() > 1 {
                index_of.insert(i, vehicles.len());
                vehicles.push(Shown { track, test: tested.contains(&(index as u32, i as u32)), rows });
            }
        }
        // Every vehicle is forecast, whether its windows were for training or for testing; what shows it says which.
        let apart = (APART_S * rate).round().max(1.) as usize;
        let mut seen: Vec<(usize, usize, Observation<'a>)> = Vec::new();
        for (track, vehicle) in &index_of {
            for (frame, row) in vehicles[*vehicle].rows.iter().filter(|(frame, _)| frame.is_multiple_of(apart)) {
                let observation = Observation::new(recording, set.shape(), *track, *row);
                seen.extend(observation.map(|observation| (*vehicle, *frame, observation)));
            }
        }
        let forecasts = forecasts(run, &seen, &index_of)?;
        let (road, shape) = (lane.road, set.shape());
        Ok(Some(Self { recording, road, shape, step, rate, frames, first_frame, vehicles, forecasts }))
    }

    /// Recorded frame of a shown one.
    pub(crate) fn recorded(&self, frame: usize) -> u32 {
        self.first_frame + frame as u32 * self.step
    }

    /// Frames of a window from one point of a forecast that is shown to the next.
    pub(crate) fn every(&self) -> usize {
        every(self.shape.dt())
    }
}

/// Word for a kind of vehicle.
pub(crate) fn class_word(class: VehicleClass) -> &'static str {
    match class {
        VehicleClass::Motorcycle => "motorcycle",
        VehicleClass::Car => "car",
        VehicleClass::Truck => "truck",
    }
}

fn every(dt: f64) -> usize {
    (EVERY_S / dt).round().max(1.) as usize
}

fn forecasts<'a>(
    run: &Run,
    seen: &[(usize, usize, Observation<'a>)],
    index_of: &BTreeMap<usize, usize>,
) -> Result<Vec<Made<'a>>> {
    let gnp = run.model()?.explaining(true);
    let work = run.machine.work("player", seen.len(), "forecasts");
    let mut made = Vec::with_capacity(seen.len());
    for batch in seen.chunks(run.config.evaluate.batch) {
        run.machine.stop.check()?;
        let observations: Vec<_> = batch.iter().map(|(_, _, observation)| *observation).collect();
        let found = gnp.predict(&observations, run.config.predict.k)?;
        made.extend(batch.iter().zip(found).map(|((vehicle, frame, seen), mut forecast)| {
            // The other futures' forces are shown nowhere, and are most of what would be kept.
            forecast.modes.iter_mut().skip(1).for_each(|mode| mode.explanation = None);
            let neighbours = seen.neighbours().map(|slot| {
                slot.map_or(-2, |other| index_of.get(&other.track_index()).map_or(-1, |vehicle| *vehicle as i32))
            });
            Made { vehicle: *vehicle, frame: *frame, seen: *seen, neighbours: neighbours.to_vec(), forecast }
        }));
        work.at(made.len() as u64, "");
    }
    Ok(made)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_second_is_a_whole_number_of_frames() {
        assert_eq!([0.1, 0.2, 0.04, 1.].map(every), [5, 3, 13, 1]);
    }
}
