//! Who is near whom: vehicles sorted along each lane.
use crate::{road::Road, simulator::drive::Vehicle};
use nalgebra::RealField;
use std::cmp::Ordering;

/// Vehicles by lane and position, rebuilt once a step in time proportional to their number.
///
/// The order by x hardly changes from step to step, so insertion moves few vehicles; a walk along it then lists every
/// lane and notes for each vehicle how many are behind it in its own lane and in the two beside.
#[derive(Clone, Debug, Default)]
pub(crate) struct LaneOrder {
    current: bool,
    by_x: Vec<usize>,
    lanes: Vec<Vec<usize>>,
    places: Vec<Place>,
}

/// Where a vehicle stands among the others.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    lane: usize,
    /// Vehicles behind in the lane to the right, in the own one, and in the one to the left.
    behind: [usize; 3],
}

impl LaneOrder {
    /// Forgets the order: vehicles were added, removed or moved from outside.
    pub(crate) fn reset(&mut self) {
        self.current = false;
    }

    /// Whether nothing was touched since the order was rebuilt.
    pub(crate) fn is_current(&self) -> bool {
        self.current
    }

    /// Sorts anew, after a step or a reset.
    pub(crate) fn rebuild<T: RealField + Copy>(&mut self, vehicles: &[Vehicle<T>], road: &Road<T>) {
        let before = |a: usize, b: usize| -> Ordering {
            let (xa, xb) = (vehicles[a].state.position.x, vehicles[b].state.position.x);
            xa.partial_cmp(&xb).unwrap_or(Ordering::Equal).then(a.cmp(&b))
        };
        if self.current {
            for end in 1..self.by_x.len() {
                let mut i = end;
                while i > 0 && before(self.by_x[i - 1], self.by_x[i]) == Ordering::Greater {
                    self.by_x.swap(i - 1, i);
                    i -= 1;
                }
            }
        } else {
            self.by_x.clear();
            self.by_x.extend(0..vehicles.len());
            self.by_x.sort_by(|a, b| before(*a, *b));
        }
        self.current = true;
        self.lanes.iter_mut().for_each(Vec::clear);
        self.lanes.resize_with(road.lanes(), Vec::new);
        self.places.resize(vehicles.len(), Place::default());
        for &vehicle in &self.by_x {
            let lane = road.lane_at(vehicles[vehicle].state.position.y);
            let count = |lane: usize| self.lanes.get(lane).map_or(0, Vec::len);
            let behind = [lane.checked_sub(1).map_or(0, count), count(lane), count(lane + 1)];
            self.places[vehicle] = Place { lane, behind };
            self.lanes[lane].push(vehicle);
        }
    }

    /// In the lane `beside` lanes to the left (-1, 0, 1), the vehicles ahead, nearest first.
    pub(crate) fn ahead(&self, vehicle: usize, beside: isize) -> impl Iterator<Item = usize> {
        let (list, behind) = self.split(vehicle, beside);
        let own = usize::from(beside == 0);
        list.get(behind + own..).unwrap_or_default().iter().copied()
    }

    /// In the lane `beside` lanes to the left (-1, 0, 1), the vehicles behind, nearest first.
    pub(crate) fn behind(&self, vehicle: usize, beside: isize) -> impl Iterator<Item = usize> {
        let (list, behind) = self.split(vehicle, beside);
        list[..behind].iter().rev().copied()
    }

    /// The lane's list and how many of it are behind the vehicle.
    fn split(&self, vehicle: usize, beside: isize) -> (&[usize], usize) {
        let place = &self.places[vehicle];
        let list = place.lane.checked_add_signed(beside).and_then(|lane| self.lanes.get(lane));
        list.map_or((&[], 0), |list| (list, place.behind[(beside + 1) as usize]))
    }
}
