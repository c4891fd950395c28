//! A simulator as it is written and read.
use super::{Road, Simulator, SimulatorParams, Status, Vehicle, VehicleId, contacts::Contacts};
use crate::{error::ForceError, error::require, rule::PairRule};
use nalgebra::RealField;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;

/// What there is to keep; the rest follows from it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[serde(bound(
    serialize = "T: RealField + Copy + Serialize, R: Clone + Serialize",
    deserialize = "T: RealField + Copy + Deserialize<'de>, R: Clone + Deserialize<'de>"
))]
struct Saved<'a, T: RealField, R: Clone> {
    params: SimulatorParams<T>,
    road: Cow<'a, Road<T>>,
    steps: u64,
    next_id: u64,
    bounds: [T; 3],
    ids: Cow<'a, [VehicleId]>,
    vehicles: Cow<'a, [Vehicle<T, R>]>,
    statuses: Cow<'a, [Status<T>]>,
    contacts: Contacts,
}

impl<T, R> Serialize for Simulator<T, R>
where
    T: RealField + Copy + Serialize,
    R: PairRule<T> + Serialize,
{
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let saved = Saved {
            params: self.params,
            road: Cow::Borrowed(&self.road),
            steps: self.steps,
            next_id: self.next_id,
            bounds: [self.fastest, self.slowest_tau, self.most_push],
            ids: Cow::Borrowed(&self.ids),
            vehicles: Cow::Borrowed(&self.vehicles),
            statuses: Cow::Borrowed(&self.statuses),
            contacts: self.contacts.clone(),
        };
        saved.serialize(serializer)
    }
}

impl<'de, T, R> Deserialize<'de> for Simulator<T, R>
where
    T: RealField + Copy + Deserialize<'de>,
    R: PairRule<T> + Deserialize<'de>,
{
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Saved::deserialize(deserializer)?.restore().map_err(serde::de::Error::custom)
    }
}

impl<T: RealField + Copy, R: PairRule<T>> Saved<'_, T, R> {
    fn restore(self) -> Result<Simulator<T, R>, ForceError> {
        let mut scene = Simulator::for_rules(self.params, self.road.into_owned())?;
        let count = self.ids.len();
        let all = self.vehicles.len() == count && self.statuses.len() == count;
        require::<T>(all, "vehicles", lit_of(self.vehicles.len() as u64), "as many as numbers and statuses")?;
        let counts_up = self.ids.windows(2).all(|pair| pair[0] < pair[1])
            && self.ids.last().is_none_or(|last| last.0 < self.next_id);
        require::<T>(counts_up, "ids", lit_of(count as u64), "growing and below `next_id`")?;
        for bound in self.bounds {
            crate::error::require_not_negative("bounds", bound)?;
        }
        for (key, count) in [("steps", self.steps), ("next_id", self.next_id)] {
            require::<T>(count < u64::MAX / 4, key, lit_of(count), "a count that can grow")?;
        }
        scene.steps = self.steps;
        for (vehicle, status) in self.vehicles.iter().zip(self.statuses.iter()) {
            vehicle.check(&scene.params, scene.time())?;
            require(status.noise.is_finite(), "status.noise", status.noise, "finite")?;
            require(status.before.is_finite(), "status.before", status.before, "finite")?;
            require(status.after.is_finite(), "status.after", status.after, "finite")?;
            let changed = status.changed.unwrap_or(0);
            require::<T>(changed <= self.steps, "status.changed", lit_of(changed), "at most `steps`")?;
            scene.note_extremes(vehicle);
        }
        [scene.fastest, scene.slowest_tau, scene.most_push] = [
            scene.fastest.max(self.bounds[0]),
            scene.slowest_tau.max(self.bounds[1]),
            scene.most_push.max(self.bounds[2]),
        ];
        scene.next_id = self.next_id;
        scene.ids = self.ids.into_owned();
        scene.vehicles = self.vehicles.into_owned();
        for vehicle in &mut scene.vehicles {
            vehicle.state.position.x = scene.road.wrapped(vehicle.state.position.x);
        }
        scene.statuses = self.statuses.into_owned();
        scene.contacts = self.contacts.in_order();
        scene.order.rebuild(&scene.vehicles, &scene.road);
        Ok(scene)
    }
}

/// A count as a number for an error.
fn lit_of<T: RealField>(count: u64) -> T {
    nalgebra::convert(count as f64)
}
