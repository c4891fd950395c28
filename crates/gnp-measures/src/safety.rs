//! Surrogate measures of safety: how often and how long vehicles are too near, or close in too fast.

use serde::{Deserialize, Serialize};

use crate::contacts::{Contact, contacts};
use crate::error::MeasureError;
use crate::following::{Following, Unpaired};
use crate::traffic::Traffic;

/// A surrogate measure of a vehicle and its leader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// Time to collision, s; small is dangerous. See [`ttc`](crate::ttc).
    Ttc,
    /// Deceleration to avoid a crash, m/s²; large is dangerous. See [`drac`](crate::drac).
    Drac,
    /// Time gap, s; small is dangerous. See [`time_gap`](crate::time_gap).
    TimeGap,
}

impl Measure {
    /// Its name, as it is written in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ttc => "ttc",
            Self::Drac => "drac",
            Self::TimeGap => "time_gap",
        }
    }

    fn of(self, following: &Following) -> Option<f64> {
        match self {
            Self::Ttc => following.ttc(),
            Self::Drac => following.drac(),
            Self::TimeGap => following.time_gap(),
        }
    }

    /// Whether `value` is more dangerous than `than`.
    fn worse(self, value: f64, than: f64) -> bool {
        if self == Self::Drac { value > than } else { value < than }
    }
}

/// Thresholds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SafetySettings {
    /// Times to collision, s: below counts.
    pub ttc: Vec<f64>,
    /// Decelerations to avoid a crash, m/s²: above counts.
    pub drac: Vec<f64>,
    /// Time gaps, s: below counts.
    pub time_gap: Vec<f64>,
    /// An event that pauses for at most this long goes on, s.
    pub pause_s: f64,
}

impl Default for SafetySettings {
    fn default() -> Self {
        Self { ttc: vec![1., 1.5, 2., 3.], drac: vec![3., 5.], time_gap: vec![0.5, 1.], pause_s: 0.5 }
    }
}

impl SafetySettings {
    /// Every measure with its thresholds.
    fn thresholds(&self) -> Result<Vec<(Measure, f64)>, MeasureError> {
        if !(self.pause_s.is_finite() && self.pause_s >= 0.) {
            return Err(MeasureError::Setting { setting: "safety.pause_s", value: self.pause_s, must: "0 or more" });
        }
        let of = |measure: Measure, values: &[f64]| values.iter().map(|value| (measure, *value)).collect::<Vec<_>>();
        let all =
            [of(Measure::Ttc, &self.ttc), of(Measure::Drac, &self.drac), of(Measure::TimeGap, &self.time_gap)].concat();
        all.iter().try_for_each(|(_, value)| MeasureError::positive("safety threshold", *value).map(|_| ()))?;
        Ok(all)
    }
}

/// How long vehicles are beyond a threshold.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exposure {
    /// The measure.
    pub measure: Measure,
    /// The threshold, s or m/s².
    pub threshold: f64,
    /// Vehicle-seconds beyond it.
    pub vehicle_s: f64,
    /// Share of all vehicle-time, with a leader or without.
    pub share: f64,
    /// Distinct events: a vehicle beyond the threshold behind one leader, from its first frame to its last.
    pub events: usize,
    /// Events an hour of vehicle-time.
    pub events_per_vehicle_h: f64,
    /// Events for every 1000 km driven; `None` where nobody drove.
    pub events_per_1000_km: Option<f64>,
}

/// One event beyond a threshold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Conflict {
    /// The measure.
    pub measure: Measure,
    /// The threshold, s or m/s².
    pub threshold: f64,
    /// The vehicle behind.
    pub vehicle: u32,
    /// The vehicle ahead.
    pub leader: u32,
    /// Index of the carriageway.
    pub road: u16,
    /// Place of the vehicle behind when it is worst, m.
    pub x: f64,
    /// First and last frame, s.
    pub t: [f64; 2],
    /// The worst value: the least time, or the greatest deceleration.
    pub worst: f64,
}

/// Surrogate safety of a recording.
///
/// Counts of conflicts below a time to collision are those of FHWA's Surrogate Safety Assessment Model (Gettman et al. 2008,
/// FHWA-HRT-08-051), whose usual threshold is 1.5 s. They are not crashes, and depend on how noisy speeds are.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Safety {
    /// Time that vehicles have rows, s.
    pub vehicle_s: f64,
    /// Of it, with a leader, s.
    pub following_s: f64,
    /// Of that, with a leader whose speed is known, s: only then are there time to collision and deceleration.
    pub leader_speed_s: f64,
    /// Of the time with a leader, overlapping it lengthwise, s: there is neither time gap nor time to collision then.
    pub overlapping_s: f64,
    /// Without a leader because the lane is not known, s.
    pub no_lane_s: f64,
    /// Without a leader because nobody is ahead in the lane, s.
    pub no_leader_s: f64,
    /// By measure and threshold.
    pub exposures: Vec<Exposure>,
    /// All events, by measure and threshold, vehicle and time.
    pub conflicts: Vec<Conflict>,
    /// Vehicles whose boxes overlap, by time.
    pub contacts: Vec<Contact>,
}

impl Traffic<'_> {
    /// Surrogate safety.
    ///
    /// # Errors
    /// [`MeasureError::Setting`] for a threshold that is not positive.
    pub fn safety(&self, settings: &SafetySettings) -> Result<Safety, MeasureError> {
        let thresholds = settings.thresholds()?;
        let pause = (settings.pause_s / self.frame_s()).floor();
        let mut safety = Safety {
            vehicle_s: 0.,
            following_s: 0.,
            leader_speed_s: 0.,
            overlapping_s: 0.,
            no_lane_s: 0.,
            no_leader_s: 0.,
            exposures: Vec::new(),
            conflicts: Vec::new(),
            contacts: contacts(self),
        };
        let mut frames = vec![0u64; thresholds.len()];
        // Event of each threshold that goes on, and the frame it was last seen in.
        let mut open: Vec<Option<(Conflict, u32)>> = vec![None; thresholds.len()];
        for (index, track) in self.recording().tracks().iter().enumerate() {
            for row in track.rows.clone() {
                safety.vehicle_s += self.frame_s();
                let following = match self.following(index, row) {
                    Ok(following) => following,
                    Err(Unpaired::NoLane) => {
                        safety.no_lane_s += self.frame_s();
                        continue;
                    }
                    Err(Unpaired::NoLeader) => {
                        safety.no_leader_s += self.frame_s();
                        continue;
                    }
                };
                safety.following_s += self.frame_s();
                safety.leader_speed_s += if following.leader_speed.is_some() { self.frame_s() } else { 0. };
                safety.overlapping_s += if following.gap <= 0. { self.frame_s() } else { 0. };
                let frame = self.frame(track, row);
                for (i, (measure, threshold)) in thresholds.iter().enumerate() {
                    let Some(value) = measure.of(&following).filter(|value| measure.worse(*value, *threshold)) else {
                        continue;
                    };
                    frames[i] += 1;
                    let (time, x) = (self.time_s(frame), self.place(self.x(row)));
                    match &mut open[i] {
                        Some((event, last))
                            if event.leader == following.leader && f64::from(frame - *last - 1) <= pause =>
                        {
                            event.t[1] = time;
                            *last = frame;
                            if measure.worse(value, event.worst) {
                                (event.worst, event.x) = (value, x);
                            }
                        }
                        other => {
                            let (measure, threshold) = (*measure, *threshold);
                            let Following { vehicle, leader, .. } = following;
                            let t = [time, time];
                            let event =
                                Conflict { measure, threshold, vehicle, leader, road: track.road, x, t, worst: value };
                            safety.conflicts.extend(other.replace((event, frame)).map(|(event, _)| event));
                        }
                    }
                }
            }
            safety.conflicts.extend(open.iter_mut().filter_map(Option::take).map(|(event, _)| event));
        }
        safety.conflicts.sort_by(|a, b| {
            let by_threshold = a.measure.cmp(&b.measure).then(a.threshold.total_cmp(&b.threshold));
            by_threshold.then(a.vehicle.cmp(&b.vehicle)).then(a.t[0].total_cmp(&b.t[0]))
        });
        let metres = self.distance_m();
        let exposure = |((measure, threshold), frames): (&(Measure, f64), &u64)| {
            let same = |conflict: &&Conflict| conflict.measure == *measure && conflict.threshold == *threshold;
            let events = safety.conflicts.iter().filter(same).count();
            let vehicle_s = *frames as f64 * self.frame_s();
            Exposure {
                measure: *measure,
                threshold: *threshold,
                vehicle_s,
                share: vehicle_s / safety.vehicle_s,
                events,
                events_per_vehicle_h: events as f64 / (safety.vehicle_s / 3600.),
                events_per_1000_km: (metres > 0.).then(|| events as f64 / (metres / 1e6)),
            }
        };
        safety.exposures = thresholds.iter().zip(&frames).map(exposure).collect();
        Ok(safety)
    }

    /// Distance that all vehicles drove, m.
    #[must_use]
    pub fn distance_m(&self) -> f64 {
        let drove = |rows: &std::ops::Range<usize>| self.x(rows.end - 1) - self.x(rows.start);
        self.recording().tracks().iter().map(|track| drove(&track.rows)).sum()
    }
}
