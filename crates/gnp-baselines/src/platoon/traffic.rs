//! The vehicles of a window that matter to each other along the road: the column ahead of the target and of each neighbour.

use gnp_data::{Leader, Neighbour, Observation, SLOTS, Slot, TrackState, WindowShape};

use crate::motion::slope;

/// Leaders looked up ahead of a vehicle; more bring nothing that can be measured in 5 s. Where a vehicle stands in the
/// column of another one as well, more than these may be known, and are followed.
const DEPTH: usize = 4;

/// Places (m) and speeds (m/s) that differ by less are the same: they are sums of single precision.
const SAME: f64 = 1e-3;

/// What an observation shows of the traffic that a target and its neighbours follow.
///
/// Positions and speeds are along the road, in the target's window frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traffic {
    /// The target first.
    pub(crate) vehicles: Vec<SeenVehicle>,
    /// Vehicle in each neighbour slot.
    pub(crate) slots: [Option<usize>; SLOTS],
    /// Whom the target would follow were its leader gone, where that one has no rows of its own and so no known leader.
    pub(crate) beyond: Option<usize>,
}

/// A vehicle as it was seen at the last observed frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenVehicle {
    /// Number of the vehicle in its file.
    pub vehicle: u32,
    /// Centre along the road, m.
    pub position: f64,
    /// How it moved.
    pub motion: SeenMotion,
    /// Length, m.
    pub length: f64,
    /// Vehicle that it follows, by its place in the list.
    pub leader: Option<usize>,
    /// Behind whom that motion was seen, which says what kind of driver it has.
    pub behind: SeenBehind,
}

/// How a vehicle moved up to the last observed frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenMotion {
    /// Speed forward, m/s, as the slope of a straight line: that of the middle of its span, where the vehicle accelerates.
    pub speed: f64,
    /// From the middle of that span until the last observed frame, s.
    pub since: f64,
    /// Acceleration forward over a short time, m/s².
    pub acceleration: f64,
    /// Its variance as an estimate, m²/s⁴; infinite where too little was seen.
    pub variance: f64,
    /// Acceleration forward over a long time, m/s²: late, but told better from noise.
    pub slow_acceleration: f64,
}

/// Behind whom a vehicle was seen to drive. A driver is who he is whatever is changed around him: his gap and his habit are
/// those of the recorded scene, also where he then follows somebody else.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SeenBehind {
    /// Whom it follows now, where that one is now.
    #[default]
    Leader,
    /// Nobody.
    Nobody,
    /// Somebody else, or who is now elsewhere.
    Other {
        /// From centre to centre, m.
        distance: f64,
        /// How that one moved.
        motion: SeenMotion,
        /// Its length, m.
        length: f64,
    },
}

/// Over how many frame periods of the past motion is estimated, at most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spans {
    pub(crate) speed: usize,
    pub(crate) acceleration: usize,
    pub(crate) slow_acceleration: usize,
}

impl Traffic {
    /// Place of the target.
    pub const TARGET: usize = 0;

    /// Most vehicles of any traffic.
    pub(crate) const MOST: usize = (1 + SLOTS) * (1 + DEPTH);

    /// The target's column and those of its neighbours.
    pub(crate) fn of(observation: &Observation<'_>, spans: Spans) -> Self {
        let mut traffic = Self::default();
        traffic.gather(observation, spans, &mut GatherRoom::default());
        traffic
    }

    /// Makes room for any traffic.
    pub(crate) fn reserve(&mut self) {
        self.vehicles.reserve(Self::MOST.saturating_sub(self.vehicles.len()));
    }

    /// [`Traffic::of`] in the memory of this one.
    pub(crate) fn gather(&mut self, observation: &Observation<'_>, spans: Spans, room: &mut GatherRoom) {
        self.vehicles.clear();
        room.followed.clear();
        room.followed.reserve(Self::MOST);
        let mut gathering = Gathering { observation, spans, vehicles: &mut self.vehicles, room };
        let shape = observation.shape();
        let own = |i| Some(observation.target(i));
        let length = f64::from(observation.size()[0]);
        let target = seen(u32::MAX, own, shape.t_obs, shape.dt(), length, spans, &mut gathering.room.x);
        let target = gathering.add(SeenVehicle { vehicle: observation.vehicle(), ..target });
        gathering.follow(target, observation.leader());
        let slots = Slot::ALL.map(|slot| {
            let neighbour = observation.neighbour(slot)?;
            let place = gathering.place(neighbour.vehicle()).unwrap_or_else(|| {
                let state = |i| neighbour.state(i);
                let size = f64::from(neighbour.size()[0]);
                let x = &mut gathering.room.x;
                let it = seen(neighbour.vehicle(), state, shape.t_obs, shape.dt(), size, spans, x);
                gathering.add(it)
            });
            gathering.follow(place, neighbour.leader());
            Some(place)
        });
        // A vehicle ahead in the lane that is not the leader is beyond one that only the target's rows name.
        self.beyond = slots[Slot::Preceding.index()].filter(|place| self.vehicles[target].leader != Some(*place));
        self.slots = slots;
        // At the end of a column, whom the last one follows is not looked up, and was not before.
        for place in (0..self.vehicles.len()).filter(|place| room.followed[*place]) {
            if let Some(before) = observation.before_changes(self.vehicles[place].vehicle) {
                let before = behind_before(&before, shape, spans, &mut room.x);
                // Whom no change reaches is the same to the last bit.
                if !before.is_as(&self.behind(place)) {
                    self.vehicles[place].behind = before;
                }
            }
        }
    }

    /// The vehicles, the target first.
    #[must_use]
    pub fn vehicles(&self) -> &[SeenVehicle] {
        &self.vehicles
    }

    /// The vehicles ahead of the target in its lane, nearest first: whom it follows, then whom it would follow were the
    /// nearer ones gone.
    pub fn column(&self) -> impl Iterator<Item = &SeenVehicle> {
        self.places_ahead().map(|place| &self.vehicles[place])
    }

    fn places_ahead(&self) -> impl Iterator<Item = usize> {
        let hidden = self.vehicles[Self::TARGET].leader.zip(self.beyond);
        let known = self.ahead_of(hidden.map_or(Self::TARGET, |(_, beyond)| beyond));
        hidden.into_iter().flat_map(|(named, beyond)| [named, beyond]).chain(known)
    }

    /// Places of the vehicles ahead of the one at `place`, nearest first. Nobody follows in a circle.
    fn ahead_of(&self, place: usize) -> impl Iterator<Item = usize> {
        let leader = |place: usize| self.vehicles.get(place).and_then(|it| it.leader);
        std::iter::successors(leader(place), move |place| leader(*place))
    }

    /// Place of the vehicle in a neighbour slot.
    #[must_use]
    pub fn place(&self, slot: Slot) -> Option<usize> {
        self.slots[slot.index()]
    }

    /// The same traffic with everything along the road but the bodies multiplied by `factor`.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.scale(factor);
        self
    }

    /// As [`Traffic::scaled`], in place.
    pub fn scale(&mut self, factor: f64) {
        for it in &mut self.vehicles {
            it.position *= factor;
            it.motion.scale(factor);
            if let SeenBehind::Other { distance, motion, .. } = &mut it.behind {
                *distance *= factor;
                motion.scale(factor);
            }
        }
    }

    /// The target and its column alone.
    pub(crate) fn target_alone(self) -> Self {
        let places: Vec<usize> =
            std::iter::once(Self::TARGET).chain(self.ahead_of(Self::TARGET)).take(1 + DEPTH).collect();
        let moved = |place: usize| places.iter().position(|it| *it == place);
        let vehicles = places
            .iter()
            .map(|place| self.vehicles[*place])
            .map(|it| SeenVehicle { leader: it.leader.and_then(moved), ..it });
        Self { vehicles: vehicles.collect(), slots: [None; SLOTS], beyond: None }
    }

    /// Behind whom the vehicle at `place` was seen, by itself.
    fn behind(&self, place: usize) -> SeenBehind {
        let it = &self.vehicles[place];
        match (it.behind, it.leader.and_then(|leader| self.vehicles.get(leader))) {
            (SeenBehind::Leader, Some(SeenVehicle { position, motion, length, .. })) => {
                SeenBehind::Other { distance: position - it.position, motion: *motion, length: *length }
            }
            (SeenBehind::Leader, None) => SeenBehind::Nobody,
            (behind, _) => behind,
        }
    }

    /// The same traffic as if the `count` nearest vehicles ahead of the target were not there: it follows the next one.
    #[must_use]
    pub fn without_nearest(&self, count: usize) -> Self {
        let mut changed = self.clone();
        if count > 0 {
            let target = &mut changed.vehicles[Self::TARGET];
            target.leader = self.places_ahead().nth(count);
            target.behind = self.behind(Self::TARGET);
            changed.beyond = None;
        }
        changed
    }
}

impl SeenMotion {
    fn scale(&mut self, factor: f64) {
        self.speed *= factor;
        self.acceleration *= factor;
        self.variance *= factor * factor;
        self.slow_acceleration *= factor;
    }
}

impl SeenBehind {
    /// Whether both say the same but for rounding.
    fn is_as(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Other { distance, motion, .. }, Self::Other { distance: as_far, motion: as_fast, .. }) => {
                (distance - as_far).abs() < SAME && (motion.speed - as_fast.speed).abs() < SAME
            }
            _ => self == other,
        }
    }
}

/// Room to gather traffic in.
#[derive(Clone, Debug, Default)]
pub(crate) struct GatherRoom {
    /// Whether it is known whom a vehicle follows.
    followed: Vec<bool>,
    /// Latest positions of one vehicle, m.
    x: Vec<f64>,
}

/// Traffic being gathered.
struct Gathering<'a, 'b> {
    observation: &'b Observation<'a>,
    spans: Spans,
    vehicles: &'b mut Vec<SeenVehicle>,
    room: &'b mut GatherRoom,
}

impl<'a> Gathering<'a, '_> {
    fn add(&mut self, it: SeenVehicle) -> usize {
        self.vehicles.push(it);
        self.room.followed.push(false);
        self.vehicles.len() - 1
    }

    fn place(&self, vehicle: u32) -> Option<usize> {
        self.vehicles.iter().position(|it| it.vehicle == vehicle)
    }

    /// Whether the one at `place` is `whom` or follows it, over others or not.
    fn follows(&self, place: usize, whom: usize) -> bool {
        let leader = |place: &usize| self.vehicles[*place].leader;
        std::iter::successors(Some(place), leader).any(|place| place == whom)
    }

    /// Adds the column from `leader` on, ahead of the vehicle at `place`.
    fn follow(&mut self, mut place: usize, mut leader: Option<Leader<'a>>) {
        let shape = self.observation.shape();
        for _ in 0..DEPTH {
            if !self.room.followed[place] {
                self.room.followed[place] = true;
                let next = leader.as_ref().map(|leader| {
                    self.place(leader.vehicle()).unwrap_or_else(|| {
                        let (state, size) = (|i| leader.state(i), f64::from(leader.size()[0]));
                        let x = &mut self.room.x;
                        let it = seen(leader.vehicle(), state, shape.t_obs, shape.dt(), size, self.spans, x);
                        self.add(it)
                    })
                });
                // A file may name vehicles that follow one another in a circle: nobody leads there.
                self.vehicles[place].leader = next.filter(|next| !self.follows(*next, place));
            }
            let (Some(next), Some(ahead)) = (self.vehicles[place].leader, leader) else { return };
            (place, leader) = (next, ahead.leader());
        }
    }
}

/// A vehicle from its states by observed frame; over fewer frames where it was not there in all.
///
/// The speed is that of a straight line, the acceleration that of a parabola, by least squares; `x` is room to work in.
fn seen(
    vehicle: u32,
    state: impl Fn(usize) -> Option<TrackState>,
    t_obs: usize,
    dt: f64,
    length: f64,
    spans: Spans,
    x: &mut Vec<f64>,
) -> SeenVehicle {
    let most = spans.speed.max(spans.acceleration).max(spans.slow_acceleration);
    // Latest first.
    let back = (0..=most).map_while(|back| state(t_obs.checked_sub(1 + back)?));
    x.clear();
    x.reserve(most + 1);
    x.extend(back.map(|state| f64::from(state.x)));
    let now = state(t_obs.saturating_sub(1)).unwrap_or_default();
    let over = |periods: usize| x[..x.len().min(periods + 1)].iter().rev().copied();
    let (speed, since) = match over(spans.speed).len() {
        0 | 1 => (f64::from(now.vx), 0.),
        seen => (slope(over(spans.speed)) / dt, (seen - 1) as f64 * dt / 2.),
    };
    let fitted = |periods: usize| match over(periods).len() {
        0..LEAST => (0., f64::INFINITY),
        _ => curvature(over(periods), dt),
    };
    let ((acceleration, variance), (slow_acceleration, _)) =
        (fitted(spans.acceleration), fitted(spans.slow_acceleration));
    let position = f64::from(now.x);
    let motion = SeenMotion { speed, since, acceleration, variance, slow_acceleration };
    SeenVehicle { vehicle, position, motion, length, leader: None, behind: SeenBehind::default() }
}

/// Behind whom a vehicle was before its scene was changed.
fn behind_before(before: &Neighbour<'_>, shape: WindowShape, spans: Spans, x: &mut Vec<f64>) -> SeenBehind {
    let Some(leader) = before.leader() else { return SeenBehind::Nobody };
    let (state, length) = (|i| leader.state(i), f64::from(leader.size()[0]));
    let it = seen(leader.vehicle(), state, shape.t_obs, shape.dt(), length, spans, x);
    SeenBehind::Other { distance: it.position - f64::from(before.now().x), motion: it.motion, length }
}

/// Positions without which no acceleration is told from noise.
const LEAST: usize = 4;

/// Second derivative of the parabola through values `dt` apart, and its variance as the residuals tell it.
fn curvature(values: impl ExactSizeIterator<Item = f64> + Clone, dt: f64) -> (f64, f64) {
    let count = values.len() as f64;
    let time = |i: usize| i as f64 - (count - 1.) / 2.;
    // Around the middle of the stretch 1, t and t² less its mean are orthogonal: three sums, no system.
    let mean_square = (count * count - 1.) / 12.;
    let (mut sum, mut linear, mut quadratic, mut squares, mut fourths) = (0., 0., 0., 0., 0.);
    for (i, value) in values.clone().enumerate() {
        let q = time(i).powi(2) - mean_square;
        sum += value;
        linear += time(i) * value;
        quadratic += q * value;
        squares += time(i).powi(2);
        fourths += q * q;
    }
    let (mean, slope, bend) = (sum / count, linear / squares, quadratic / fourths);
    let off = |(i, value): (usize, f64)| value - mean - slope * time(i) - bend * (time(i).powi(2) - mean_square);
    let residual: f64 = values.enumerate().map(|it| off(it).powi(2)).sum::<f64>() / (count - 3.).max(1.);
    (2. * bend / (dt * dt), 4. * residual / fourths / dt.powi(4))
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Vehicles 20 m apart, each 5 m long.
    fn vehicle(vehicle: u32, leader: Option<usize>) -> SeenVehicle {
        SeenVehicle {
            vehicle,
            position: f64::from(vehicle) * 20.,
            motion: SeenMotion { speed: 10., since: 0.4, acceleration: 0., variance: 0., slow_acceleration: 0. },
            length: 5.,
            leader,
            behind: SeenBehind::Leader,
        }
    }

    #[test]
    fn a_parabola_has_its_own_curvature_without_any_doubt() {
        let values: Vec<f64> = (0..9).map(|i| 3. + 2. * f64::from(i) - 0.25 * f64::from(i * i)).collect();
        let (acceleration, variance) = curvature(values.iter().copied(), 0.5);
        assert!((acceleration + 2.).abs() < 1e-12 && variance < 1e-20, "{acceleration} {variance}");
    }

    /// Of many noisy parabolas, the spread of the estimates is what each of them states.
    #[test]
    fn the_variance_is_the_spread_of_estimates() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let noisy = |rng: &mut ChaCha8Rng| -> Vec<f64> {
            (0..11).map(|i| 0.01 * f64::from(i * i) + 0.1 * (rng.random::<f64>() - 0.5)).collect()
        };
        let found: Vec<(f64, f64)> = (0..4000).map(|_| curvature(noisy(&mut rng).into_iter(), 0.1)).collect();
        let mean = found.iter().map(|it| it.0).sum::<f64>() / 4000.;
        let spread = found.iter().map(|it| (it.0 - mean).powi(2)).sum::<f64>() / 4000.;
        let stated = found.iter().map(|it| it.1).sum::<f64>() / 4000.;
        assert!((mean - 2.).abs() < 0.05 && (stated / spread - 1.).abs() < 0.1, "{mean} {spread} {stated}");
    }

    #[test]
    fn a_column_is_fitted_alone_and_no_deeper_than_that_of_a_target() {
        let vehicles = (0..7).map(|i| vehicle(i, (i < 6).then_some(i as usize + 1))).collect();
        let traffic = Traffic { vehicles, slots: [None; SLOTS], beyond: None };
        assert_eq!(traffic.column().count(), 6);
        let alone = traffic.target_alone();
        assert_eq!((alone.vehicles.len(), alone.vehicles[DEPTH].leader), (1 + DEPTH, None));
    }

    #[test]
    fn without_the_nearest_the_next_is_followed() {
        let vehicles = vec![vehicle(0, Some(1)), vehicle(1, Some(2)), vehicle(2, None)];
        let traffic = Traffic { vehicles, slots: [None; SLOTS], beyond: None };
        let column = |traffic: &Traffic| traffic.column().map(|it| it.vehicle).collect::<Vec<_>>();
        assert_eq!(column(&traffic), [1, 2]);
        assert_eq!(column(&traffic.without_nearest(0)), [1, 2]);
        assert_eq!(column(&traffic.without_nearest(1)), [2]);
        assert!(column(&traffic.without_nearest(2)).is_empty());
        // Where the nearest has no known leader, it hides the one beyond.
        let mut hidden = traffic.clone();
        hidden.vehicles.push(SeenVehicle { vehicle: 9, leader: None, ..hidden.vehicles[1] });
        (hidden.vehicles[0].leader, hidden.beyond) = (Some(3), Some(1));
        assert_eq!(column(&hidden), [9, 1, 2]);
        assert_eq!(column(&hidden.without_nearest(1)), [1, 2]);
        let scaled = traffic.scaled(2.);
        assert_eq!((scaled.vehicles[2].position, scaled.vehicles[2].length), (80., 5.));
    }
}
