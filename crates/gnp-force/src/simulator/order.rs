//! Who is near whom: vehicles sorted along each lane, and kept sorted.
use crate::{road::Road, simulator::vehicle::Vehicle};
use nalgebra::RealField;
use std::cmp::Ordering;

/// Vehicles by lane and position along it, always as they stand: adding, removing and moving one keeps the order.
///
/// From step to step the order hardly changes, so that insertion moves few vehicles, and the time is in proportion to
/// their number.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct LaneOrder {
    lanes: Vec<Vec<usize>>,
    spots: Vec<Spot>,
    /// Vehicles that are changing lanes, by the lane that they are heading for, along it.
    coming: Vec<Vec<usize>>,
    /// Whether `Spot::beside` is that of now: it is after a step, and not once a vehicle was touched.
    beside_is_current: bool,
}

/// Where a vehicle stands among the others.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Spot {
    lane: usize,
    /// The lane that it is heading for: its own, unless it is changing.
    aim: usize,
    /// Vehicles behind it in its lane.
    rank: usize,
    /// Vehicles behind it in the lane to the right and to the left.
    beside: [usize; 2],
}

/// A vehicle in the order, and how many times the seam of a ring lies between: 1 ahead, -1 behind.
pub(crate) type Seen = (usize, i8);

impl LaneOrder {
    /// Sorts from nothing.
    pub(crate) fn rebuild<T: RealField + Copy, R>(&mut self, vehicles: &[Vehicle<T, R>], road: &Road<T>) {
        self.lanes.iter_mut().for_each(Vec::clear);
        self.lanes.resize_with(road.lanes(), Vec::new);
        self.spots.clear();
        for (index, vehicle) in vehicles.iter().enumerate() {
            let spot = spot_of(vehicle, road);
            self.lanes[spot.lane].push(index);
            self.spots.push(spot);
        }
        self.lanes.iter_mut().for_each(|lane| lane.sort_by(|a, b| compare(vehicles, *a, *b)));
        self.settle(vehicles);
    }

    /// Sorts again after every vehicle has moved a little.
    pub(crate) fn after_step<T: RealField + Copy, R>(&mut self, vehicles: &[Vehicle<T, R>], road: &Road<T>) {
        let mut moved = Vec::new();
        for (lane, list) in self.lanes.iter_mut().enumerate() {
            let spots = &mut self.spots;
            list.retain(|&index| {
                let spot = spot_of(&vehicles[index], road);
                let stays = spot.lane == lane;
                spots[index] = spot;
                if !stays {
                    moved.push(index);
                }
                stays
            });
        }
        for index in moved {
            self.lanes[self.spots[index].lane].push(index);
        }
        for list in &mut self.lanes {
            for end in 1..list.len() {
                let mut i = end;
                while i > 0 && compare(vehicles, list[i - 1], list[i]) == Ordering::Greater {
                    list.swap(i - 1, i);
                    i -= 1;
                }
            }
        }
        self.settle(vehicles);
    }

    /// Notes ranks, the places in the lanes beside, and who is changing lanes.
    fn settle<T: RealField + Copy, R>(&mut self, vehicles: &[Vehicle<T, R>]) {
        for list in &self.lanes {
            for (rank, &index) in list.iter().enumerate() {
                self.spots[index].rank = rank;
            }
        }
        for right in 1..self.lanes.len() {
            // Both lists are walked once; who is behind is counted on the way.
            let [right, left] = [&self.lanes[right - 1], &self.lanes[right]];
            let (mut i, mut j) = (0, 0);
            while i < right.len() || j < left.len() {
                let right_first = match (right.get(i), left.get(j)) {
                    (Some(&a), Some(&b)) => compare(vehicles, a, b) == Ordering::Less,
                    (next, _) => next.is_some(),
                };
                if right_first {
                    self.spots[right[i]].beside[1] = j;
                    i += 1;
                } else {
                    self.spots[left[j]].beside[0] = i;
                    j += 1;
                }
            }
        }
        self.beside_is_current = true;
        self.note_coming(vehicles);
    }

    fn note_coming<T: RealField + Copy, R>(&mut self, vehicles: &[Vehicle<T, R>]) {
        self.coming.iter_mut().for_each(Vec::clear);
        self.coming.resize_with(self.lanes.len(), Vec::new);
        for (index, spot) in self.spots.iter().enumerate().filter(|(_, spot)| spot.aim != spot.lane) {
            self.coming[spot.aim].push(index);
        }
        self.coming.iter_mut().for_each(|list| list.sort_by(|a, b| compare(vehicles, *a, *b)));
    }

    /// Notes the places in the lanes beside, if a vehicle was touched since.
    pub(crate) fn refresh<T: RealField + Copy, R>(&mut self, vehicles: &[Vehicle<T, R>]) {
        if !self.beside_is_current {
            self.settle(vehicles);
        }
    }

    /// Takes in the vehicle that was added last.
    pub(crate) fn insert<T: RealField + Copy, R>(&mut self, vehicles: &[Vehicle<T, R>], road: &Road<T>) {
        let Some(index) = vehicles.len().checked_sub(1) else { return };
        self.spots.push(spot_of(&vehicles[index], road));
        self.put(index, vehicles);
        self.note_coming(vehicles);
    }

    /// Forgets the vehicle of that index; those after it have moved down by one.
    pub(crate) fn remove(&mut self, index: usize) {
        self.take(index);
        self.spots.remove(index);
        self.coming.iter_mut().for_each(|list| list.retain(|other| *other != index));
        for other in self.lanes.iter_mut().chain(&mut self.coming).flatten().filter(|other| **other > index) {
            *other -= 1;
        }
    }

    /// A vehicle has another wish.
    pub(crate) fn aimed<T: RealField + Copy, R>(&mut self, index: usize, vehicles: &[Vehicle<T, R>], road: &Road<T>) {
        let aim = spot_of(&vehicles[index], road).aim;
        if self.spots[index].aim != aim {
            self.spots[index].aim = aim;
            self.note_coming(vehicles);
        }
    }

    /// A vehicle was put elsewhere.
    pub(crate) fn touched<T: RealField + Copy, R>(&mut self, index: usize, vehicles: &[Vehicle<T, R>], road: &Road<T>) {
        let (was, is) = (self.spots[index], spot_of(&vehicles[index], road));
        let list = &self.lanes[was.lane];
        let behind = was.rank.checked_sub(1).and_then(|rank| list.get(rank));
        let in_order = is.lane == was.lane
            && behind.is_none_or(|other| compare(vehicles, *other, index) == Ordering::Less)
            && list.get(was.rank + 1).is_none_or(|other| compare(vehicles, index, *other) == Ordering::Less);
        self.spots[index].aim = is.aim;
        if !in_order {
            self.take(index);
            self.spots[index] = is;
            self.put(index, vehicles);
        }
        // Others may have come to lie differently to it, also while its own lane is still in order.
        self.beside_is_current = false;
        if was.aim != was.lane || is.aim != is.lane {
            self.note_coming(vehicles);
        }
    }

    fn take(&mut self, index: usize) {
        let Spot { lane, rank, .. } = self.spots[index];
        self.lanes[lane].remove(rank);
        for &other in &self.lanes[lane][rank..] {
            self.spots[other].rank -= 1;
        }
        self.beside_is_current = false;
    }

    fn put<T: RealField + Copy, R>(&mut self, index: usize, vehicles: &[Vehicle<T, R>]) {
        let lane = self.spots[index].lane;
        let list = &mut self.lanes[lane];
        let rank = list.partition_point(|other| compare(vehicles, *other, index) == Ordering::Less);
        list.insert(rank, index);
        self.spots[index].rank = rank;
        for &other in &list[rank + 1..] {
            self.spots[other].rank += 1;
        }
        self.beside_is_current = false;
    }

    /// The lane a vehicle is in.
    #[inline]
    pub(crate) fn lane(&self, vehicle: usize) -> usize {
        self.spots[vehicle].lane
    }

    /// The lane a vehicle is heading for.
    #[inline]
    pub(crate) fn aim(&self, vehicle: usize) -> usize {
        self.spots[vehicle].aim
    }

    /// Those that are changing into a lane and are ahead of a vehicle, or behind it, nearest first.
    #[inline]
    pub(crate) fn coming<T: RealField + Copy, R>(
        &self,
        vehicle: usize,
        lane: usize,
        ahead: bool,
        ring: bool,
        vehicles: &[Vehicle<T, R>],
    ) -> impl Iterator<Item = Seen> + '_ {
        let list = self.coming.get(lane).map_or(&[][..], Vec::as_slice);
        let at = list.partition_point(|other| compare(vehicles, *other, vehicle) == Ordering::Less);
        let (behind, before) = list.split_at(at);
        let (straight, around) = if ahead { (before, behind) } else { (behind, before) };
        let lap = if ahead { 1 } else { -1 };
        let turn = move |list: &'_ [usize], at: usize| if ahead { list[at] } else { list[list.len() - 1 - at] };
        let straight = (0..straight.len()).map(move |at| (turn(straight, at), 0));
        let around = if ring { around } else { &[] };
        straight.chain((0..around.len()).map(move |at| (turn(around, at), lap))).filter(move |seen| seen.0 != vehicle)
    }

    /// How many vehicles of its lane are nearer to another vehicle, which it is ahead of, than this one.
    pub(crate) fn nearer<T: RealField + Copy, R>(
        &self,
        (vehicle, lap): Seen,
        to: usize,
        vehicles: &[Vehicle<T, R>],
    ) -> usize {
        let Spot { lane, rank, .. } = self.spots[vehicle];
        let around = if lap > 0 { self.in_lane(lane).len() } else { 0 };
        (rank + around).saturating_sub(self.behind_in(to, lane, vehicles))
    }

    /// The vehicles of a lane in the order of their positions.
    #[inline]
    pub(crate) fn in_lane(&self, lane: usize) -> &[usize] {
        self.lanes.get(lane).map_or(&[], Vec::as_slice)
    }

    /// How many vehicles of a lane, the own one or one beside, are behind a vehicle.
    #[inline]
    pub(crate) fn behind_in<T: RealField + Copy, R>(
        &self,
        vehicle: usize,
        lane: usize,
        vehicles: &[Vehicle<T, R>],
    ) -> usize {
        let spot = &self.spots[vehicle];
        if lane == spot.lane {
            spot.rank
        } else if self.beside_is_current && lane.abs_diff(spot.lane) == 1 {
            spot.beside[usize::from(lane > spot.lane)]
        } else {
            self.in_lane(lane).partition_point(|other| compare(vehicles, *other, vehicle) == Ordering::Less)
        }
    }

    /// The vehicles of a lane ahead of the first `behind` ones, nearest first, `own` those to leave out at that place (1 in
    /// the vehicle's own lane); around a ring up to the vehicle itself.
    #[inline]
    pub(crate) fn ahead(&self, lane: usize, behind: usize, own: usize, ring: bool) -> impl Iterator<Item = Seen> + '_ {
        let list = self.in_lane(lane);
        let straight = list.get(behind + own..).unwrap_or_default().iter().map(|&other| (other, 0));
        let around = if ring { list.get(..behind).unwrap_or_default() } else { &[] };
        straight.chain(around.iter().map(|&other| (other, 1)))
    }

    /// The vehicles of a lane among the first `behind` ones, nearest first; around a ring up to the vehicle itself.
    #[inline]
    pub(crate) fn behind(&self, lane: usize, behind: usize, own: usize, ring: bool) -> impl Iterator<Item = Seen> + '_ {
        let list = self.in_lane(lane);
        let straight = list.get(..behind).unwrap_or_default().iter().rev().map(|&other| (other, 0));
        let around = if ring { list.get(behind + own..).unwrap_or_default() } else { &[] };
        straight.chain(around.iter().rev().map(|&other| (other, -1)))
    }
}

/// Lane and aim of a vehicle; rank and the places beside are found later.
#[inline]
fn spot_of<T: RealField + Copy, R>(vehicle: &Vehicle<T, R>, road: &Road<T>) -> Spot {
    let lane = road.lane_at(vehicle.state.position.y);
    Spot { lane, aim: vehicle.drive.lateral_aim().map_or(lane, |y| road.lane_at(y)), rank: 0, beside: [0; 2] }
}

/// Order along the road; vehicles at one place go by index.
#[inline]
fn compare<T: RealField + Copy, R>(vehicles: &[Vehicle<T, R>], a: usize, b: usize) -> Ordering {
    let (xa, xb) = (vehicles[a].state.position.x, vehicles[b].state.position.x);
    xa.partial_cmp(&xb).unwrap_or(Ordering::Equal).then(a.cmp(&b))
}
