//! The vehicles that a stream remembers.

use gnp_data::VehicleClass;

use crate::samples::{Keeping, Samples};

/// A vehicle in one of the places of [`Vehicles`].
#[derive(Debug)]
pub(crate) struct Remembered {
    pub(crate) id: u64,
    pub(crate) samples: Samples,
    pub(crate) class: VehicleClass,
    /// Length and width as last given, m.
    pub(crate) size: Option<[f32; 2]>,
    /// Number of the last frame that it was in; 0 in none.
    pub(crate) seen_in: u64,
    /// Its place in the output of this frame.
    pub(crate) entry: usize,
}

/// Vehicles in places that they keep while they are remembered.
#[derive(Debug, Default)]
pub(crate) struct Vehicles {
    places: Vec<Remembered>,
    /// Ids with their places, by id: the order of the output is not that of a hash.
    by_id: Vec<(u64, usize)>,
    free: Vec<usize>,
}

impl Vehicles {
    /// Place of a vehicle, which is taken for it if it is new; `None` where as many are remembered as may be.
    pub(crate) fn place(&mut self, id: u64, most: usize, keeping: &Keeping) -> Option<usize> {
        let at = match self.by_id.binary_search_by_key(&id, |known| known.0) {
            Ok(i) => return Some(self.by_id[i].1),
            Err(at) => at,
        };
        let place = match self.free.pop() {
            Some(place) => place,
            None if self.places.len() < most => {
                let mut samples = Samples::default();
                samples.reserve(keeping);
                let class = VehicleClass::Car;
                self.places.push(Remembered { id, samples, class, size: None, seen_in: 0, entry: 0 });
                // Whatever leaves finds room.
                self.free.reserve(self.places.len());
                self.places.len() - 1
            }
            None => return None,
        };
        self.by_id.insert(at, (id, place));
        let vehicle = &mut self.places[place];
        vehicle.samples.clear();
        (vehicle.id, vehicle.size, vehicle.seen_in) = (id, None, 0);
        Some(place)
    }

    /// Forgets vehicles without a sample after `time_s`.
    pub(crate) fn forget(&mut self, time_s: f64) {
        let Self { places, by_id, free } = self;
        by_id.retain(|(_, place)| {
            let stays = places[*place].samples.last().is_some_and(|last| last.time_s >= time_s);
            if !stays {
                places[*place].samples.clear();
                free.push(*place);
            }
            stays
        });
    }

    pub(crate) fn get_mut(&mut self, place: usize) -> &mut Remembered {
        &mut self.places[place]
    }

    pub(crate) fn get(&self, place: usize) -> &Remembered {
        &self.places[place]
    }

    /// Places in use, by the ids of their vehicles.
    pub(crate) fn by_id(&self) -> impl Iterator<Item = usize> + use<'_> {
        self.by_id.iter().map(|(_, place)| *place)
    }

    /// Number of places, in use or not.
    pub(crate) fn len(&self) -> usize {
        self.places.len()
    }

    pub(crate) fn clear(&mut self) {
        self.forget(f64::INFINITY);
    }
}
