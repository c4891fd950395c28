//! Tracks that a program has, instead of files: for prediction while vehicles drive.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use crate::assemble::{Rows, VehicleBody};
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::lanes::lane_at;
use crate::limits::{self, MAX_LINES, MAX_POSITION, MAX_RATE_HZ, MAX_SPEED, MIN_RATE_HZ};
use crate::recording::{LaneMarking, Recording, RecordingMeta, Road, VehicleClass};
use crate::window::Observation;
use crate::window_shape::{WindowError, WindowShape};

/// Samples may be this far from the times that the rate gives, s.
const TIME_TOLERANCE: f64 = 1e-3;

/// A vehicle at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Sample {
    /// Time, s; from any start, the same for all vehicles.
    pub time_s: f64,
    /// Centre of the box in the road frame, m: forward along the road, to the left.
    pub position: [f32; 2],
    /// Velocity forward and to the left, m/s, from measurements up to this time; `None` where it is
    /// not measured.
    pub velocity: Option<[f32; 2]>,
}

impl Sample {
    /// A position without a velocity.
    #[must_use]
    pub fn new(time_s: f64, position: [f32; 2]) -> Self {
        Self { time_s, position, velocity: None }
    }

    /// The same with a measured velocity.
    #[must_use]
    pub fn with_velocity(self, velocity: [f32; 2]) -> Self {
        Self { velocity: Some(velocity), ..self }
    }
}

/// The vehicles of one carriageway up to now, and what a predictor may see of them.
///
/// One prediction of a scene whose samples lie at regular times; frames of tracks that go on and on, at any times, are
/// the business of a `Stream` of gnp-online.
///
/// Positions are in a road frame of your own: x forward along the road, y to the left, m, within the bounds of
/// [`limits`]. Lanes follow from the lane lines, neighbours from lanes and positions ([`find_neighbours`](crate::find_neighbours)).
/// Velocities are given with all samples or with none; where they are given, each vehicle's own is
/// used from its first sample on, otherwise they are differences of positions.
///
/// ```
/// use gnp_data::{LaneMarking, LiveScene, Sample, Slot, VehicleClass, WindowShape};
///
/// let lines = [-3.7, 0., 3.7].map(|y| LaneMarking::new(y, y.abs() > 1.));
/// let mut scene = LiveScene::new(10., lines.to_vec())?;
/// for (vehicle, x0, speed) in [(7, 0., 30.), (8, 40., 25.)] {
///     let at = |i: u8| Sample::new(0.1 * f64::from(i), [x0 + speed * 0.1 * f32::from(i), 1.8]);
///     let samples: Vec<Sample> = (0..31).map(at).collect();
///     scene.push(vehicle, [4.5, 1.8], VehicleClass::Car, &samples)?;
/// }
/// let shape = WindowShape::new(31, 50, 1, 10.)?; // 3 s observed, 5 s predicted
/// let observation = scene.observe(7, shape)?;
/// let ahead = observation.neighbour(Slot::Preceding).unwrap();
/// assert_eq!(ahead.vehicle(), 8);
/// assert!((ahead.now().x - 25.).abs() < 1e-3); // from the target's centre
/// // A predictor takes it: predictor.predict(&[observation], 6)
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct LiveScene {
    rate_hz: f64,
    lines: Vec<LaneMarking>,
    /// Time of frame 0, s: that of the first sample.
    start_s: Option<f64>,
    vehicles: BTreeMap<u32, Vehicle>,
    recording: OnceLock<Recording>,
}

#[derive(Clone, Debug)]
struct Vehicle {
    body: VehicleBody,
    /// Frame, which may be before that of the first sample pushed, with its sample.
    samples: Vec<(i64, Sample)>,
}

/// Why a scene does not take samples, or holds no observation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// A rate that is none.
    #[error("a rate of {rate_hz} Hz is not one from {MIN_RATE_HZ} to {MAX_RATE_HZ} Hz")]
    Rate {
        /// The rate, Hz.
        rate_hz: f64,
    },
    /// Lane lines that make no lane.
    #[error(
        "lane lines must be 2 to {MAX_LINES}, from right to left, growing in y and within {MAX_POSITION} m of the origin"
    )]
    Lines,
    /// A size, position or velocity that cannot be.
    #[error("vehicle {vehicle}: {what}; check where it comes from and its unit")]
    Value {
        /// The vehicle.
        vehicle: u32,
        /// Which value, and what it may be.
        what: String,
    },
    /// A sample between two frames.
    #[error(
        "vehicle {vehicle}: the sample at {time_s} s is {off_ms:.1} ms off the times that {rate_hz} Hz gives; \
         interpolate samples to a uniform rate first"
    )]
    Time {
        /// The vehicle.
        vehicle: u32,
        /// Time of the sample, s.
        time_s: f64,
        /// Distance to the nearest frame, ms.
        off_ms: f64,
        /// Rate of the scene, Hz.
        rate_hz: f64,
    },
    /// A sample that is not after the one before.
    #[error(
        "vehicle {vehicle}: the sample at {time_s} s is not after the one before; give samples in order of time, one a frame"
    )]
    Order {
        /// The vehicle.
        vehicle: u32,
        /// Time of the sample, s.
        time_s: f64,
    },
    /// Velocities with some samples and not with others.
    #[error("vehicle {vehicle}: velocities must be given with all samples of a scene or with none")]
    Velocity {
        /// A vehicle whose samples differ from those before.
        vehicle: u32,
    },
    /// A vehicle out of order.
    #[error("vehicle {vehicle} comes after vehicle {last}; add the vehicles of a moment by growing number, each once")]
    Number {
        /// The vehicle.
        vehicle: u32,
        /// The one before.
        last: u32,
    },
    /// A vehicle that is not there at the last time.
    #[error("vehicle {vehicle} has no sample at the last time of the scene")]
    Absent {
        /// The vehicle.
        vehicle: u32,
    },
    /// The vehicle's samples do not make the window.
    #[error(transparent)]
    Window(#[from] WindowError),
    /// Samples that make no recording.
    #[error(transparent)]
    Data(#[from] DataError),
}

impl LiveScene {
    /// An empty scene of `rate_hz` frames per second between `lines`, from right to left.
    ///
    /// # Errors
    /// [`LiveError::Rate`], [`LiveError::Lines`].
    pub fn new(rate_hz: f64, lines: Vec<LaneMarking>) -> Result<Self, LiveError> {
        if !limits::is_rate(rate_hz) {
            return Err(LiveError::Rate { rate_hz });
        }
        check_lines(&lines)?;
        Ok(Self { rate_hz, lines, start_s: None, vehicles: BTreeMap::new(), recording: OnceLock::new() })
    }

    /// Adds samples of a vehicle, later than those it has. Where a sample is missing between two,
    /// the vehicle has a gap, and is observed from after it.
    ///
    /// `size` is length and width, m; size and class of the first call count.
    ///
    /// # Errors
    /// [`LiveError::Value`] for what is beyond [`limits`], [`LiveError::Time`] for a sample more than 1 ms off the rate,
    /// [`LiveError::Order`], [`LiveError::Velocity`]. Then nothing is added.
    pub fn push(
        &mut self,
        vehicle: u32,
        size: [f32; 2],
        class: VehicleClass,
        samples: &[Sample],
    ) -> Result<(), LiveError> {
        let value = |what| LiveError::Value { vehicle, what };
        if !limits::is_size(size) {
            return Err(value(format!("{} m by {} m is no size: vehicles are {}", size[0], size[1], limits::sizes())));
        }
        let start_s = self.start_s.or(samples.first().map(|sample| sample.time_s)).unwrap_or_default();
        let measured = self.first_sample().or(samples.first()).is_some_and(|sample| sample.velocity.is_some());
        let mut last = self.vehicles.get(&vehicle).and_then(|it| it.samples.last()).map(|(frame, _)| *frame);
        let mut framed = Vec::with_capacity(samples.len());
        for sample in samples {
            let time_s = sample.time_s;
            if !time_s.is_finite() {
                return Err(value(format!("a time of {time_s} s")));
            }
            if !limits::is_position(sample.position) {
                let [x, y] = sample.position;
                return Err(value(format!(
                    "at {time_s} s the position ({x}, {y}) m is not within {MAX_POSITION} m of the origin"
                )));
            }
            if let Some([vx, vy]) = sample.velocity.filter(|velocity| !limits::is_velocity(*velocity)) {
                return Err(value(format!(
                    "at {time_s} s the velocity ({vx}, {vy}) m/s is not within {MAX_SPEED} m/s"
                )));
            }
            if sample.velocity.is_some() != measured {
                return Err(LiveError::Velocity { vehicle });
            }
            let exact = (time_s - start_s) * self.rate_hz;
            let off_s = (exact - exact.round()).abs() / self.rate_hz;
            if off_s > TIME_TOLERANCE {
                return Err(LiveError::Time { vehicle, time_s, off_ms: 1e3 * off_s, rate_hz: self.rate_hz });
            }
            let frame = exact.round() as i64;
            if last.is_some_and(|last| frame <= last) {
                return Err(LiveError::Order { vehicle, time_s });
            }
            last = Some(frame);
            framed.push((frame, *sample));
        }
        if framed.is_empty() {
            return Ok(());
        }
        let body = VehicleBody { class, length: size[0], width: size[1], road: 0 };
        self.vehicles.entry(vehicle).or_insert(Vehicle { body, samples: Vec::new() }).samples.extend(framed);
        self.start_s = Some(start_s);
        self.recording = OnceLock::new();
        Ok(())
    }

    /// What a predictor may see of `vehicle` at the last time of the scene.
    ///
    /// # Errors
    /// [`LiveError::Absent`] when the vehicle has no sample at that time; [`LiveError::Window`] when
    /// its past is too short, has a gap, or `shape` does not have the rate of the scene.
    pub fn observe(&self, vehicle: u32, shape: WindowShape) -> Result<Observation<'_>, LiveError> {
        let recording = self.recording()?;
        let last = recording.tracks().iter().map(|track| track.last_frame()).max().unwrap_or(0);
        let tracks = recording.tracks().iter().enumerate().filter(|(_, track)| track.vehicle == vehicle);
        let found = tracks.filter_map(|(index, track)| Some((index, track.row_at(last)?))).next();
        let (track, row) = found.ok_or(LiveError::Absent { vehicle })?;
        Ok(Observation::new(recording, shape, track, row)?)
    }

    /// The scene as a recording: dataset [`Dataset::LIVE`], site and name `live`.
    ///
    /// # Errors
    /// [`LiveError::Data`] when samples are more than a day apart.
    pub fn recording(&self) -> Result<&Recording, LiveError> {
        if let Some(made) = self.recording.get() {
            return Ok(made);
        }
        let made = self.make()?;
        Ok(self.recording.get_or_init(|| made))
    }

    fn first_sample(&self) -> Option<&Sample> {
        self.vehicles.values().next()?.samples.first().map(|(_, sample)| sample)
    }

    fn make(&self) -> Result<Recording, DataError> {
        let all =
            || self.vehicles.iter().flat_map(|(id, it)| it.samples.iter().map(move |(f, s)| (*id, *f, s, it.body)));
        let first = all().map(|(_, frame, ..)| frame).min().unwrap_or(0);
        // A span that a recording cannot have is refused there.
        let frame = |frame: i64| u32::try_from(frame.saturating_sub(first)).unwrap_or(u32::MAX - 1);
        let column = |axis: usize| all().map(|(_, _, sample, _)| sample.position[axis]).collect();
        let (vehicle, frames): (Vec<u32>, Vec<u32>) = all().map(|(id, at, ..)| (id, frame(at))).unzip();
        let lane = all().map(|(_, _, sample, _)| lane_at(&self.lines, sample.position[1])).collect();
        let velocities: Option<Vec<[f32; 2]>> = all().map(|(_, _, sample, _)| sample.velocity).collect();
        let velocity = velocities.map(|v| [0, 1].map(|axis| v.iter().map(|v| v[axis]).collect()));
        let bodies: Vec<VehicleBody> = all().map(|(.., body)| body).collect();
        let rows = Rows { velocity, lane, ..Rows::new(vehicle, frames, column(0), column(1)) };
        let meta = RecordingMeta::new(Dataset::LIVE, "live", "live", self.rate_hz);
        let road = Road { driving_direction: 2, lines: self.lines.clone(), fitted: false, axis: None };
        Recording::without_report(meta, vec![road], rows, |row| bodies[row])
    }
}

/// Refuses lines that make no lane.
pub(crate) fn check_lines(lines: &[LaneMarking]) -> Result<(), LiveError> {
    let grow = lines.windows(2).all(|pair| pair[0].y < pair[1].y);
    let near = lines.iter().all(|line| limits::is_position([0., line.y]));
    if (2..=MAX_LINES).contains(&lines.len()) && grow && near { Ok(()) } else { Err(LiveError::Lines) }
}
