//! The streaming predictor.

use std::time::Instant;

use gnp_data::limits::{self, MAX_LANE_WIDTH, MAX_POSITION};
use gnp_data::{LaneMarking, Observation, Past, PredictError, Snapshot, VehicleBody, WindowShape};
use gnp_model::{Forecasts, Gnp, ModelError, Workspace};
use gnp_road::ReferenceLine;

use crate::config::StreamConfig;
use crate::error::{OnlineError, Reason};
use crate::frame::{Entry, Frame, Output, Problem, Validity};
use crate::samples::{Grid, Keeping, Sample};
use crate::tracked::Tracked;
use crate::vehicles::Vehicles;

/// A past has a gap where two samples are this many frames of the model apart.
const GAP: f64 = 1.5;

/// The vehicles of one carriageway, predicted frame by frame. What it does is said in the [crate's](crate) documentation.
///
/// It allocates while more vehicles come than it ever had, and then no more, as far as its model does not
/// ([`Gnp::predict_into`]). It works on the thread that calls it.
#[derive(Debug)]
pub struct Stream {
    gnp: Gnp,
    config: StreamConfig,
    keeping: Keeping,
    /// Time of the last frame, s.
    last_s: f64,
    /// Frames so far.
    frames: u64,
    vehicles: Vehicles,
    snapshot: Snapshot,
    output: Output,
    room: Room,
}

/// Memory that is used again, without anything in it between frames.
#[derive(Debug, Default)]
struct Room {
    grid: Grid,
    observations: Vec<Observation<'static>>,
    workspace: Workspace,
}

impl Stream {
    /// A stream of the carriageway between `lines`, from right to left, m, predicted by `gnp`, which it shares.
    ///
    /// # Errors
    /// [`OnlineError::Config`], [`OnlineError::LaneWidth`], [`OnlineError::Scene`] for lines that make no lane or a
    /// model whose windows cannot be.
    pub fn new(gnp: &Gnp, lines: Vec<LaneMarking>, config: StreamConfig) -> Result<Self, OnlineError> {
        config.check()?;
        check_lanes(&lines)?;
        let shape = gnp.shape();
        let snapshot = Snapshot::live(&config.site, lines, shape)?;
        let span_s = (snapshot.frames() - 1) as f64 * period_s(shape);
        let keeping = Keeping { span_s, spacing_s: 1. / config.max_rate_hz };
        Ok(Self {
            gnp: gnp.clone(),
            config,
            keeping,
            last_s: f64::NEG_INFINITY,
            frames: 0,
            vehicles: Vehicles::default(),
            snapshot,
            output: Output::default(),
            room: Room::default(),
        })
    }

    /// Moves the lane lines, from right to left, m, from the next frame on.
    ///
    /// # Errors
    /// [`OnlineError::LaneWidth`], [`OnlineError::Scene`]. Then the old ones stay.
    pub fn set_lines(&mut self, lines: Vec<LaneMarking>) -> Result<(), OnlineError> {
        check_lanes(&lines)?;
        Ok(self.snapshot.set_lines(lines)?)
    }

    /// Forgets all vehicles and the time.
    pub fn reset(&mut self) {
        self.vehicles.clear();
        self.last_s = f64::NEG_INFINITY;
        self.output.clear();
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Gnp {
        &self.gnp
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &StreamConfig {
        &self.config
    }

    /// Takes the vehicles that were detected at `time_s`, s, and predicts them and those that are missing for a while.
    ///
    /// # Errors
    /// [`OnlineError::Time`] for a time that is not after the last one; then the stream is as it was.
    /// [`OnlineError::Predict`] where the model fails for all; the tracks are remembered then.
    pub fn push(&mut self, time_s: f64, tracks: &[Tracked]) -> Result<Frame<'_>, OnlineError> {
        if !time_s.is_finite() || time_s <= self.last_s {
            return Err(OnlineError::Time { time_s, last_s: self.last_s });
        }
        self.last_s = time_s;
        self.frames += 1;
        self.output.clear();
        self.output.time_s = time_s;
        self.vehicles.forget(time_s - self.config.bridge_s - crate::samples::rounding(time_s));
        for (row, track) in tracks.iter().enumerate() {
            if let Err(reason) = self.take(time_s, row, track) {
                self.output.problems.push(Problem { id: track.id, row, reason });
            }
        }
        self.add_missing(time_s);
        self.fill_snapshot(time_s);
        self.predict()?;
        Ok(self.frame())
    }

    /// The last frame once more; an empty one before the first.
    #[must_use]
    pub fn frame(&self) -> Frame<'_> {
        Frame { output: &self.output }
    }

    /// Remembers a track, or says why not.
    fn take(&mut self, time_s: f64, row: usize, track: &Tracked) -> Result<(), Reason> {
        if track.position.iter().any(|value| !value.is_finite()) {
            return Err(Reason::Position);
        }
        let known = |velocity: &[f32; 2]| limits::is_velocity(*velocity);
        let bad_velocity = track.velocity.is_some_and(|velocity| !known(&velocity));
        let mut velocity = track.velocity.filter(known);
        let mut position = track.position;
        if let Some(road) = &self.config.road {
            let place = road.locate(position).map_err(Reason::OffRoad)?;
            position = [place.s, place.d];
            velocity = velocity.map(|v| place.velocity_to_road(v.map(f64::from)).map(|value| value as f32));
        }
        if position.iter().any(|value| value.abs() > f64::from(MAX_POSITION)) {
            return Err(Reason::Position);
        }
        let most = self.config.max_vehicles;
        let place = self.vehicles.place(track.id, most, &self.keeping).ok_or(Reason::Capacity(most))?;
        let vehicle = self.vehicles.get_mut(place);
        if vehicle.seen_in == self.frames {
            return Err(Reason::Duplicate);
        }
        vehicle.seen_in = self.frames;
        vehicle.class = track.class;
        let size = track.size.filter(|size| limits::is_size(*size));
        vehicle.size = size.or(vehicle.size);
        // On the inner side of a bend a velocity along the line may become more than one can be.
        let velocity = velocity.filter(known);
        vehicle.samples.add(Sample { time_s, position, velocity }, &self.keeping);
        vehicle.entry = self.output.entries.len();
        self.output.entries.push(Entry {
            id: track.id,
            place,
            road: position,
            position: track.position,
            age_s: 0.,
            gap_s: 0.,
            validity: Validity::Full,
            window: None,
        });
        let mut ignored = |reason| self.output.problems.push(Problem { id: track.id, row, reason });
        if bad_velocity {
            ignored(Reason::Velocity);
        }
        if size.is_none() && track.size.is_some() {
            ignored(Reason::Size);
        }
        Ok(())
    }

    /// Adds the vehicles that are not in this frame and go on.
    fn add_missing(&mut self, time_s: f64) {
        let Self { vehicles, output, config, .. } = self;
        for place in vehicles.by_id() {
            let vehicle = vehicles.get(place);
            let Some(last) = vehicle.samples.last() else { continue };
            let age_s = time_s - last.time_s;
            if vehicle.seen_in == self.frames || age_s > config.coast_s {
                continue;
            }
            let Some(now) = vehicle.samples.at(time_s) else { continue };
            let [s, d] = now.position;
            output.entries.push(Entry {
                id: vehicle.id,
                place,
                road: now.position,
                position: config.road.as_ref().map_or(now.position, |road| road.to_world(s, d)),
                age_s,
                gap_s: age_s,
                validity: Validity::Full,
                window: None,
            });
        }
        for (entry, it) in output.entries.iter().enumerate() {
            vehicles.get_mut(it.place).entry = entry;
        }
    }

    /// Puts the pasts of the vehicles of the output into the snapshot.
    fn fill_snapshot(&mut self, time_s: f64) {
        let Self { vehicles, snapshot, output, room, .. } = self;
        let (period_s, frames) = (period_s(snapshot.shape()), snapshot.frames());
        snapshot.begin();
        // By growing number.
        for place in 0..vehicles.len() {
            let vehicle = vehicles.get(place);
            let Some(entry) = output.entries.get_mut(vehicle.entry).filter(|entry| entry.place == place) else {
                continue;
            };
            let Some(now) = vehicle.samples.at(time_s) else { continue };
            let now = Sample { time_s, ..now };
            entry.gap_s = entry.gap_s.max(vehicle.samples.onto(&mut room.grid, now, period_s, frames));
            let [length, width] = vehicle.size.unwrap_or(vehicle.class.default_size());
            let body = VehicleBody { class: vehicle.class, length, width, road: 0 };
            let pushed = snapshot.push(place as u32, body, &room.grid.positions, &room.grid.velocities);
            if pushed.is_err() {
                // Where it goes on to is beyond what the model knows.
                entry.validity = Validity::Not(Reason::Position);
            }
        }
        snapshot.finish();
    }

    /// Predicts the snapshot, and says of each vehicle what that rests on.
    fn predict(&mut self) -> Result<(), OnlineError> {
        let Self { gnp, config, vehicles, snapshot, output, room, .. } = self;
        let Output { entries, forecasts, paths, model_s, .. } = output;
        let gap_s = GAP / snapshot.shape().rate_hz;
        let mut observations = emptied(std::mem::take(&mut room.observations));
        for present in snapshot.vehicles() {
            let entry = &mut entries[vehicles.get(present.vehicle() as usize).entry];
            entry.validity = match present.past() {
                Past::Filled { observed_s } => Validity::Filled { observed_s },
                Past::Full if entry.gap_s > gap_s => Validity::Interpolated { gap_s: entry.gap_s },
                Past::Full => Validity::Full,
                _ => Validity::Not(Reason::NoVelocity),
            };
            observations.extend(present.observation());
        }
        let before = Instant::now();
        let result = forecast(gnp, config.k, &mut observations, &mut room.workspace, forecasts, |left_out| {
            entries[vehicles.get(left_out.vehicle() as usize).entry].validity = Validity::Not(Reason::NotFinite);
        });
        *model_s = before.elapsed().as_secs_f64();
        for (window, observation) in observations.iter().enumerate().filter(|_| result.is_ok()) {
            let entry = &mut entries[vehicles.get(observation.vehicle() as usize).entry];
            entry.window = Some(window);
            for mode in 0..forecasts.modes() {
                let path = forecasts.path(window, mode).iter();
                paths.extend(path.map(|step| to_world(config.road.as_ref(), entry.road, *step)));
            }
        }
        room.observations = emptied(observations);
        result.map_err(|error| {
            *forecasts = Forecasts::default();
            error.into()
        })
    }
}

impl Output {
    fn clear(&mut self) {
        self.entries.clear();
        self.problems.clear();
        self.paths.clear();
    }
}

/// Forecasts of all observations; those of which there is no finite one are taken out of the list and told.
fn forecast(
    gnp: &Gnp,
    k: usize,
    observations: &mut Vec<Observation<'_>>,
    workspace: &mut Workspace,
    forecasts: &mut Forecasts,
    mut leave_out: impl FnMut(&Observation<'_>),
) -> Result<(), PredictError> {
    match gnp.predict_into(observations, k, workspace, forecasts) {
        Err(PredictError::Model { source, .. }) if is_of_a_window(&*source) => {}
        result => return result,
    }
    // One bad window is no reason to leave all unpredicted.
    observations.retain(|observation| {
        let stays = gnp.predict_into(&[*observation], k, workspace, forecasts).is_ok();
        if !stays {
            leave_out(observation);
        }
        stays
    });
    gnp.predict_into(observations, k, workspace, forecasts)
}

fn is_of_a_window(source: &(dyn std::error::Error + Send + Sync + 'static)) -> bool {
    matches!(source.downcast_ref(), Some(ModelError::NotFinite { .. } | ModelError::Traffic(_)))
}

/// A place `step` m along and across from `from` in the road frame, in the caller's coordinates.
fn to_world(road: Option<&ReferenceLine>, from: [f64; 2], step: [f32; 2]) -> [f64; 2] {
    let at = [from[0] + f64::from(step[0]), from[1] + f64::from(step[1])];
    road.map_or(at, |road| road.to_world(at[0], at[1]))
}

/// Time between two frames of the snapshot, s.
fn period_s(shape: WindowShape) -> f64 {
    shape.dt() / shape.step as f64
}

/// The memory of a list, for what is borrowed from elsewhere: collecting in place keeps the allocation.
fn emptied<'a>(mut list: Vec<Observation<'_>>) -> Vec<Observation<'a>> {
    list.clear();
    list.into_iter().map_while(|_| None).collect()
}

fn check_lanes(lines: &[LaneMarking]) -> Result<(), OnlineError> {
    let wide = lines.windows(2).find(|pair| pair[1].y - pair[0].y > MAX_LANE_WIDTH);
    wide.map_or(Ok(()), |pair| Err(OnlineError::LaneWidth { right: pair[0].y, left: pair[1].y }))
}
