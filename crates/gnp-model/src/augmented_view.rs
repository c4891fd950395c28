//! An observation as the networks see it: as recorded, or mirrored and scaled along the road.

use gnp_data::{LaneMarking, Leader, Neighbour, Observation, Slot, TrackState, Truth, WindowShape};

/// An observation, possibly mirrored left-right together with lanes, neighbours and slots, and
/// possibly scaled along the road: augmentations for training, never used for prediction.
///
/// Traffic is not symmetric (slow lanes are on the right), but lane changes are physics. A longitudinal scale
/// multiplies every length and speed along the road, so that headways in seconds stay: the same
/// drivers in faster or slower traffic.
#[derive(Clone, Copy, Debug)]
pub struct AugmentedView<'a> {
    observation: Observation<'a>,
    mirrored: bool,
    longitudinal_scale: f32,
}

impl<'a> AugmentedView<'a> {
    /// The observation as recorded.
    #[must_use]
    pub fn recorded(observation: Observation<'a>) -> Self {
        Self { observation, mirrored: false, longitudinal_scale: 1. }
    }

    /// The observation with left and right exchanged.
    #[must_use]
    pub fn mirrored(observation: Observation<'a>) -> Self {
        Self { mirrored: true, ..Self::recorded(observation) }
    }

    /// The same with everything along the road, futures too, multiplied by `factor` once more. Sizes
    /// of vehicles and everything across the road stay.
    #[must_use]
    pub fn scaled_along_road(self, factor: f32) -> Self {
        Self { longitudinal_scale: self.longitudinal_scale * factor, ..self }
    }

    /// The recorded observation behind it.
    #[must_use]
    pub fn observation(&self) -> &Observation<'a> {
        &self.observation
    }

    /// By how much lengths along the road are multiplied.
    #[must_use]
    pub fn longitudinal_scale(&self) -> f32 {
        self.longitudinal_scale
    }

    fn turned(&self, state: TrackState) -> TrackState {
        let state =
            TrackState { x: state.x * self.longitudinal_scale, vx: state.vx * self.longitudinal_scale, ..state };
        if self.mirrored { TrackState { y: -state.y, vy: -state.vy, ..state } } else { state }
    }

    pub(crate) fn recorded_slot(&self, slot: Slot) -> Slot {
        if self.mirrored { slot.mirrored() } else { slot }
    }

    /// State of the target in observed frame `i`.
    #[must_use]
    pub fn target(&self, i: usize) -> TrackState {
        self.turned(self.observation.target(i))
    }

    /// Velocity of the target at the last observed frame, m/s: the slope of a straight line fitted
    /// to the positions of the last `window_s` seconds, at least one frame. Uses the past alone.
    #[must_use]
    pub fn velocity(&self, window_s: f64) -> [f32; 2] {
        let shape = self.observation.shape();
        slope(shape, window_s, |i| Some(self.target(i))).unwrap_or_else(|| {
            let now = self.target(shape.t_obs - 1);
            [now.vx, now.vy]
        })
    }

    /// States of the neighbour in `slot` by observed frame; `None` where it is absent. The outer
    /// `None` says that the slot is empty at the last observed frame.
    #[must_use]
    pub fn neighbour(&self, slot: Slot) -> Option<AugmentedNeighbour<'a>> {
        let neighbour = self.observation.neighbour(self.recorded_slot(slot))?;
        Some(AugmentedNeighbour { seen: *self, who: Who::Neighbour(neighbour) })
    }

    /// The vehicle directly ahead of the target, also one that has no rows of its own and is known from the target's
    /// alone.
    #[must_use]
    pub fn leader(&self) -> Option<AugmentedNeighbour<'a>> {
        Some(AugmentedNeighbour { seen: *self, who: Who::Leader(self.observation.leader()?) })
    }

    /// The vehicle directly ahead of the one in `slot`; ahead of that in [`Slot::Preceding`] it is the leader's leader.
    #[must_use]
    pub fn leader_of(&self, slot: Slot) -> Option<AugmentedNeighbour<'a>> {
        let leader = match slot {
            Slot::Preceding => self.observation.leader()?.leader()?,
            _ => self.observation.neighbour(self.recorded_slot(slot))?.leader()?,
        };
        Some(AugmentedNeighbour { seen: *self, who: Who::Leader(leader) })
    }

    /// Lane lines from right to left.
    pub fn lines(&self) -> impl Iterator<Item = LaneMarking> + use<'a> {
        let (observation, mirrored) = (self.observation, self.mirrored);
        let count = observation.lines().len();
        (0..count).filter_map(move |i| {
            if mirrored {
                observation.lines().nth(count - 1 - i).map(|line| LaneMarking { y: -line.y, ..line })
            } else {
                observation.lines().nth(i)
            }
        })
    }

    /// True state of the target in predicted frame `j`.
    #[must_use]
    pub fn true_target(&self, truth: &Truth<'_>, j: usize) -> TrackState {
        self.turned(truth.target(j))
    }

    /// Recorded state of the neighbour in `slot` in predicted frame `j`.
    #[must_use]
    pub fn true_neighbour(&self, truth: &Truth<'_>, slot: Slot, j: usize) -> Option<TrackState> {
        truth.neighbour(self.recorded_slot(slot), j).map(|state| self.turned(state))
    }
}

/// Another vehicle in an [`AugmentedView`], in its target's window frame.
#[derive(Clone, Copy, Debug)]
pub struct AugmentedNeighbour<'a> {
    seen: AugmentedView<'a>,
    who: Who<'a>,
}

#[derive(Clone, Copy, Debug)]
enum Who<'a> {
    Neighbour(Neighbour<'a>),
    Leader(Leader<'a>),
}

impl Who<'_> {
    fn state(&self, i: usize) -> Option<TrackState> {
        match self {
            Self::Neighbour(it) => it.state(i),
            Self::Leader(it) => it.state(i),
        }
    }

    fn now(&self) -> TrackState {
        match self {
            Self::Neighbour(it) => it.now(),
            Self::Leader(it) => it.now(),
        }
    }
}

impl AugmentedNeighbour<'_> {
    /// State in observed frame `i`; `None` where it is absent.
    #[must_use]
    pub fn state(&self, i: usize) -> Option<TrackState> {
        self.who.state(i).map(|state| self.seen.turned(state))
    }

    /// State at the last observed frame with the velocity fitted as in [`AugmentedView::velocity`] over the
    /// frames in which it is present.
    #[must_use]
    pub fn now(&self, window_s: f64) -> TrackState {
        let now = self.who.now();
        let fitted = slope(self.seen.observation.shape(), window_s, |i| self.who.state(i));
        let [vx, vy] = fitted.unwrap_or([now.vx, now.vy]);
        self.seen.turned(TrackState { vx, vy, ..now })
    }

    /// Number of the vehicle in its file.
    #[must_use]
    pub fn vehicle(&self) -> u32 {
        match self.who {
            Who::Neighbour(it) => it.vehicle(),
            Who::Leader(it) => it.vehicle(),
        }
    }

    /// Length and width, m.
    #[must_use]
    pub fn size(&self) -> [f32; 2] {
        match self.who {
            Who::Neighbour(it) => it.size(),
            Who::Leader(it) => it.size(),
        }
    }
}

/// Velocity of a neighbour at the last observed frame, fitted over the frames in which it is present.
pub(crate) fn velocity_of(neighbour: &Neighbour<'_>, shape: WindowShape, window_s: f64) -> [f32; 2] {
    slope(shape, window_s, |i| neighbour.state(i)).unwrap_or_else(|| {
        let now = neighbour.now();
        [now.vx, now.vy]
    })
}

/// Least-squares slope of the positions over the last `window_s` seconds, at least one frame, back
/// to the first absence, m/s; `None` with fewer than two positions.
fn slope(shape: WindowShape, window_s: f64, state: impl Fn(usize) -> Option<TrackState>) -> Option<[f32; 2]> {
    let frames = (((window_s * shape.rate_hz).round() as usize).saturating_add(1)).max(2);
    let last = shape.t_obs - 1;
    let seen = || (0..frames).map_while(|back| state(last.checked_sub(back)?));
    let n = seen().count();
    if n < 2 {
        return None;
    }
    let middle = (n - 1) as f64 / 2.;
    let (mut sx, mut sy, mut stt) = (0f64, 0f64, 0f64);
    for (back, state) in seen().enumerate() {
        let t = middle - back as f64;
        sx += t * f64::from(state.x);
        sy += t * f64::from(state.y);
        stt += t * t;
    }
    let scale = shape.rate_hz / stt;
    Some([(sx * scale) as f32, (sy * scale) as f32])
}
