//! Virtual loops: who passes a place, and how long it is occupied.

use serde::Serialize;

use crate::bins::Bins;
use crate::error::MeasureError;
use crate::traffic::Traffic;

/// Slowest speed that a passing vehicle is given, m/s: a harmonic mean needs one.
const CRAWL: f64 = 0.1;

/// A vehicle's passage over a loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Passage {
    /// Vehicle of the file.
    pub vehicle: u32,
    /// Lane number of the file; 0 unknown.
    pub lane: i16,
    /// When the front reaches the loop, s; `None` where the vehicle stood over it when first seen, which counts for
    /// occupancy alone.
    pub front_s: Option<f64>,
    /// Start and end of the time over the loop, s, as far as it was seen.
    pub over_s: [f64; 2],
    /// Speed when the front reaches it, m/s.
    pub speed: f64,
}

/// A loop across all lanes of a carriageway.
#[derive(Clone, Debug, PartialEq)]
pub struct Station {
    /// Index of the carriageway.
    pub road: u16,
    /// Where the loop begins, m.
    pub x: f64,
    /// Length of the loop, m.
    pub loop_length: f64,
    /// Lane numbers, from left to right.
    pub lanes: Vec<i16>,
    /// Passages in order of time.
    pub passages: Vec<Passage>,
    duration_s: f64,
}

/// What a loop reports of an interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DetectorInterval {
    /// Index of the carriageway.
    pub road: u16,
    /// Place of the loop, m.
    pub x: f64,
    /// Lane number of the file; `None` for all lanes together.
    pub lane: Option<i16>,
    /// Start and end, s.
    pub t: [f64; 2],
    /// Vehicles whose front reached the loop.
    pub count: u64,
    /// Flow, vehicles an hour.
    pub flow_veh_h: f64,
    /// Arithmetic mean of the spot speeds (time-mean speed), m/s; `None` without a vehicle.
    pub speed: Option<f64>,
    /// Harmonic mean of the spot speeds, m/s, which estimates the space-mean speed.
    pub harmonic_speed: Option<f64>,
    /// Share of the time that a vehicle is over the loop; for all lanes the mean over lanes.
    pub occupancy: f64,
}

impl Traffic<'_> {
    /// A loop at `x` across a carriageway, `loop_length` m long (0: a line). A vehicle counts when its front reaches `x` for
    /// the first time (on a ring, in each round); jitter of a standing vehicle counts once. Lane and speed are those of
    /// the frame before, the speed interpolated.
    ///
    /// # Errors
    /// [`MeasureError::Setting`] for a length that is negative or a place that is not finite.
    pub fn station(&self, road: u16, x: f64, loop_length: f64) -> Result<Station, MeasureError> {
        if !x.is_finite() {
            return Err(MeasureError::Setting { setting: "detector place, m", value: x, must: "finite" });
        }
        if !(loop_length.is_finite() && loop_length >= 0.) {
            let setting = "detector length, m";
            return Err(MeasureError::Setting { setting, value: loop_length, must: "0 or more" });
        }
        let x = self.place(x);
        let mut passages = Vec::new();
        for track in 0..self.recording().tracks().len() {
            if self.recording().tracks()[track].road == road {
                self.pass(track, x, loop_length, &mut passages);
            }
        }
        passages.sort_by(|a, b| a.over_s[0].total_cmp(&b.over_s[0]).then(a.vehicle.cmp(&b.vehicle)));
        let lanes = self.lanes_of(road).map(|lane| lane.number).collect();
        Ok(Station { road, x, loop_length, lanes, passages, duration_s: self.duration_s() })
    }

    /// Passages of one track.
    fn pass(&self, track: usize, at: f64, loop_length: f64, passages: &mut Vec<Passage>) {
        let track = &self.recording().tracks()[track];
        let columns = self.recording().columns();
        let half = f64::from(track.length) / 2.;
        let rows = track.rows.clone();
        let number = |row: usize| self.lane(row).map_or(0, |lane| lane.number);
        let around = self.circumference();
        // The loop as the vehicle meets it next: in its present round, or ahead of where its rear is.
        let mut front = self.x(rows.start) + half;
        let mut rear = front - 2. * half;
        let mut place = around.map_or(at, |around| at + around * (((rear - loop_length - at) / around).floor() + 1.));
        let starts = self.time_s(track.first_frame);
        let mut open = (front >= place && rear < place + loop_length).then(|| {
            let speed = f64::from(columns.vx[rows.start]).max(0.);
            Passage { vehicle: track.vehicle, lane: number(rows.start), front_s: None, over_s: [starts; 2], speed }
        });
        if front >= place && open.is_none() && around.is_none() {
            return;
        }
        for step in self.steps(track) {
            let reach = step.x[1] + half;
            let by = step.x[1] - step.x[0];
            let when = |edge: f64, centre: f64| {
                let share = if by > 0. { ((edge - (step.x[0] + centre)) / by).clamp(0., 1.) } else { 1. };
                (share, step.t[0] + share * (step.t[1] - step.t[0]))
            };
            // Twice where the rear leaves and, on a short ring, the front arrives again within one step.
            loop {
                if open.is_none() && front < place && reach >= place {
                    let (share, time) = when(place, half);
                    let [v0, v1] = [step.row, step.row + 1].map(|row| f64::from(columns.vx[row]));
                    let spot = v0 + share * (v1 - v0);
                    let mean = by / (step.t[1] - step.t[0]);
                    let speed = if spot > CRAWL { spot } else { mean.max(CRAWL) };
                    let over_s = [time, time];
                    open = Some(Passage {
                        vehicle: track.vehicle,
                        lane: number(step.row),
                        front_s: Some(time),
                        over_s,
                        speed,
                    });
                }
                let behind = place + loop_length;
                if open.is_some() && reach - 2. * half >= behind && rear < behind {
                    let (_, time) = when(behind, -half);
                    passages.extend(open.take().map(|it| Passage { over_s: [it.over_s[0], time], ..it }));
                    let Some(around) = around else { return };
                    place += around;
                    continue;
                }
                break;
            }
            // Only new ground counts.
            front = front.max(reach);
            rear = rear.max(reach - 2. * half);
        }
        let ends = self.time_s(track.last_frame());
        passages.extend(open.map(|it| Passage { over_s: [it.over_s[0], ends], ..it }));
    }
}

impl Station {
    /// What the loop reports, in intervals of `seconds` (the last takes what is left): by lane from left to right, all lanes
    /// last; then by time.
    ///
    /// # Errors
    /// [`MeasureError::Setting`] for an interval that is not positive; [`MeasureError::TooFine`] beyond a million of them.
    pub fn intervals(&self, seconds: f64) -> Result<Vec<DetectorInterval>, MeasureError> {
        const MOST: usize = 1_000_000;
        let bins = Bins::covering(0., self.duration_s, MeasureError::positive("detector interval, s", seconds)?);
        if bins.count > MOST {
            return Err(MeasureError::TooFine { x: self.loop_length, t: seconds, cells: bins.count, most: MOST });
        }
        let lanes = self.lanes.iter().copied().map(Some).chain([None]);
        Ok(lanes.flat_map(|lane| self.of_lane(lane, &bins)).collect())
    }

    /// Passages without a lane; they count in all lanes together.
    #[must_use]
    pub fn without_lane(&self) -> usize {
        self.passages.iter().filter(|passage| passage.lane <= 0).count()
    }

    fn of_lane(&self, lane: Option<i16>, bins: &Bins) -> Vec<DetectorInterval> {
        // Count, sum of speeds, sum of their inverses, time occupied.
        let mut sums = vec![(0u64, 0., 0., 0.); bins.count];
        for passage in self.passages.iter().filter(|passage| lane.is_none_or(|lane| lane == passage.lane)) {
            if let Some(i) = passage.front_s.and_then(|time| bins.index(time)) {
                sums[i].0 += 1;
                sums[i].1 += passage.speed;
                sums[i].2 += 1. / passage.speed;
            }
            let [from, to] = passage.over_s;
            let (Some(first), Some(last)) = (bins.index(from), bins.index(to)) else { continue };
            for (i, sum) in sums.iter_mut().enumerate().take(last + 1).skip(first) {
                sum.3 += (bins.edge(i + 1).min(to) - bins.edge(i).max(from)).max(0.);
            }
        }
        let shared = if lane.is_some() { 1. } else { self.lanes.len().max(1) as f64 };
        let interval = |(i, (count, speeds, inverses, over)): (usize, (u64, f64, f64, f64))| DetectorInterval {
            road: self.road,
            x: self.x,
            lane,
            t: bins.range(i),
            count,
            flow_veh_h: count as f64 / bins.width(i) * 3600.,
            speed: (count > 0).then(|| speeds / count as f64),
            harmonic_speed: (count > 0).then(|| count as f64 / inverses),
            occupancy: over / bins.width(i) / shared,
        };
        sums.into_iter().enumerate().map(interval).collect()
    }
}
