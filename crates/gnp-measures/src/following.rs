//! A vehicle and the one directly ahead of it.

use serde::Serialize;

use crate::traffic::Traffic;

/// A slower vehicle has no time gap, m/s.
pub const MIN_SPEED: f64 = 1.;

/// A vehicle behind another in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Following {
    /// Vehicle of the file.
    pub vehicle: u32,
    /// The vehicle ahead of it.
    pub leader: u32,
    /// From front to rear, m; negative where the two overlap lengthwise.
    pub gap: f64,
    /// Speed of the one behind, m/s.
    pub speed: f64,
    /// Speed of the leader, m/s; `None` where no row tells it.
    pub leader_speed: Option<f64>,
}

/// Why a row has no leader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unpaired {
    /// Its lane is not known.
    NoLane,
    /// Nobody is ahead in its lane.
    NoLeader,
}

impl Following {
    /// Time gap, s: see [`time_gap`].
    #[must_use]
    pub fn time_gap(&self) -> Option<f64> {
        time_gap(self.gap, self.speed)
    }

    /// Time to collision, s: see [`ttc`].
    #[must_use]
    pub fn ttc(&self) -> Option<f64> {
        ttc(self.gap, self.speed, self.leader_speed?)
    }

    /// Deceleration to avoid a crash, m/s²: see [`drac`].
    #[must_use]
    pub fn drac(&self) -> Option<f64> {
        drac(self.gap, self.speed, self.leader_speed?)
    }
}

/// Time until the front is where the leader's rear is now, s, of a vehicle `gap` m behind at `speed` m/s. `None` below
/// [`MIN_SPEED`] and where the two overlap.
#[must_use]
pub fn time_gap(gap: f64, speed: f64) -> Option<f64> {
    (speed >= MIN_SPEED && gap > 0.).then(|| gap / speed)
}

/// Time to collision, s: the time until the two touch if both keep their speeds (Hayward 1972, *Near-miss determination
/// through use of a scale of danger*). `None` where the gap does not close, and where the two overlap already.
#[must_use]
pub fn ttc(gap: f64, speed: f64, leader_speed: f64) -> Option<f64> {
    (speed > leader_speed && gap > 0.).then(|| gap / (speed - leader_speed))
}

/// Deceleration rate to avoid a crash, m/s²: the constant braking with which the follower just comes down to the leader's
/// speed as it touches it, `(v - v_leader)² / (2 gap)` (Cooper and Ferguson 1976; Archer 2005). `None` as for [`ttc`].
#[must_use]
pub fn drac(gap: f64, speed: f64, leader_speed: f64) -> Option<f64> {
    (speed > leader_speed && gap > 0.).then(|| (speed - leader_speed).powi(2) / (2. * gap))
}

impl Traffic<'_> {
    /// Whom the vehicle of `row`, one of track `track`, follows.
    ///
    /// # Errors
    /// Says why nobody.
    pub fn following(&self, track: usize, row: usize) -> Result<Following, Unpaired> {
        let Some(ahead) = self.ahead(track, row) else {
            return Err(if self.lane(row).is_none() { Unpaired::NoLane } else { Unpaired::NoLeader });
        };
        Ok(Following {
            vehicle: self.recording().tracks()[track].vehicle,
            leader: ahead.vehicle,
            gap: ahead.gap,
            speed: f64::from(self.recording().columns().vx[row]),
            leader_speed: ahead.speed,
        })
    }
}
