//! Who touches whom.
use super::{Event, Obstacle, Simulator, Vehicle, VehicleId};
use crate::{boxes::separation, road::Closure, rule::PairRule, scalar::lit};
use nalgebra::{RealField, Vector2};

/// The contacts of now, sorted, so that only their beginning is an event.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
pub(super) struct Contacts {
    pairs: Vec<(VehicleId, Obstacle)>,
}

impl Contacts {
    /// The same pairs in their order, each once: what was read may have another.
    #[cfg(feature = "serde")]
    pub(super) fn in_order(mut self) -> Self {
        self.pairs.sort_unstable();
        self.pairs.dedup();
        self
    }

    /// Forgets a vehicle that left.
    pub(super) fn forget(&mut self, id: VehicleId) {
        self.pairs.retain(|pair| pair.0 != id && pair.1 != Obstacle::Vehicle(id));
    }
}

impl<T: RealField + Copy, R: PairRule<T>> Simulator<T, R> {
    /// Everybody who touches another vehicle, or the place where a lane is closed, as of the last step: the vehicle, of
    /// two that of the lower number, and what it touches.
    pub fn contacts(&self) -> impl ExactSizeIterator<Item = (VehicleId, Obstacle)> + '_ {
        self.contacts.pairs.iter().copied()
    }

    /// Finds the contacts of now; those that are new are events.
    pub(super) fn find_contacts(&mut self) {
        let mut pairs = Vec::new();
        let longest = self.vehicles.iter().fold(T::zero(), |longest, vehicle| longest.max(vehicle.extent.length));
        let ring = self.road.circumference().is_some();
        for lane in 0..self.road.lanes() {
            for (rank, &index) in self.order.in_lane(lane).iter().enumerate() {
                let vehicle = &self.vehicles[index];
                let reach = (vehicle.extent.length + longest) * lit(0.5);
                let mut touch = |other: usize, lap: i8| {
                    let r = self.way_to(index, other, lap);
                    if r.x.abs() > reach {
                        return false;
                    }
                    if overlap(r, vehicle, &self.vehicles[other]) {
                        let (a, b) = (self.ids[index].min(self.ids[other]), self.ids[index].max(self.ids[other]));
                        pairs.push((a, Obstacle::Vehicle(b)));
                    }
                    true
                };
                for (other, lap) in self.order.ahead(lane, rank, 1, ring) {
                    if other == index || !touch(other, lap) {
                        break;
                    }
                }
                if lane + 1 < self.road.lanes() {
                    let behind = self.order.behind_in(index, lane + 1, &self.vehicles);
                    for (other, lap) in self.order.ahead(lane + 1, behind, 0, ring) {
                        if !touch(other, lap) {
                            break;
                        }
                    }
                    for (other, lap) in self.order.behind(lane + 1, behind, 0, ring) {
                        if !touch(other, lap) {
                            break;
                        }
                    }
                }
            }
        }
        for (number, closure) in self.road.closures().iter().enumerate() {
            for &index in self.order.in_lane(closure.lane) {
                if self.is_beside(&self.vehicles[index], closure, T::zero()) {
                    pairs.push((self.ids[index], Obstacle::Closure(number)));
                }
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let new = pairs.iter().filter(|pair| self.contacts.pairs.binary_search(pair).is_err());
        self.events.extend(new.map(|(id, with)| Event::Contact { id: *id, with: *with }));
        self.contacts.pairs = pairs;
    }

    /// Whether any part of a vehicle, and `margin` m before and behind it, is along the stretch of a closure.
    pub(super) fn is_beside(&self, vehicle: &Vehicle<T, R>, closure: &Closure<T>, margin: T) -> bool {
        let half = vehicle.extent.length * lit(0.5) + margin;
        let front = self.road.distance(closure.from, vehicle.state.position.x + half);
        front > T::zero() && front < closure.to - closure.from + half + half
    }

    /// From one vehicle to another `lap` times around the ring, in m.
    fn way_to(&self, index: usize, other: usize, lap: i8) -> Vector2<T> {
        let mut r = self.vehicles[other].state.position - self.vehicles[index].state.position;
        if let Some(circumference) = self.road.circumference() {
            r.x += circumference * lit(f64::from(lap));
        }
        r
    }

    /// A vehicle of the scene that one which is not in it would touch.
    pub(super) fn touching(&self, vehicle: &Vehicle<T, R>) -> Option<VehicleId> {
        let x = self.road.wrapped(vehicle.state.position.x);
        self.vehicles().find_map(|(id, other)| {
            let way = self.road.distance(x, other.state.position.x);
            // Around a ring the shorter way counts.
            let back = self.road.circumference().map_or(way, |circumference| way - circumference);
            let along = if back.abs() < way.abs() { back } else { way };
            let across = other.state.position.y - vehicle.state.position.y;
            overlap(Vector2::new(along, across), vehicle, other).then_some(id)
        })
    }
}

/// Whether the boxes overlap; `r` from the first to the second.
fn overlap<T: RealField + Copy, R>(r: Vector2<T>, vehicle: &Vehicle<T, R>, other: &Vehicle<T, R>) -> bool {
    let gap = separation(r, other.extent, vehicle.extent);
    gap.ahead < T::zero() && gap.beside < T::zero()
}
