//! What windows share: a driver, and an event. Neither stops at the end of a recording.
//!
//! Windows of one driver overlap, and windows of one event share its traffic: whether a wave runs through it, how dense
//! it is, how it was measured. A driver who is recorded twice, under the same number or another, is one driver; scenes
//! of the same minutes are one event.

use std::collections::BTreeMap;
use std::sync::Arc;

use gnp_data::{Drivers, WindowSet, overlaps};

use crate::sums::VehicleId;

/// What bootstrap draws with replacement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Draw {
    /// Drivers, each with all windows in which he is the target.
    Drivers,
    /// Events, each with all windows in it.
    Events,
}

impl Draw {
    /// Fewest clusters that give an interval. Two events are no sample of events.
    pub(crate) fn least(self) -> usize {
        match self {
            Self::Drivers => 2,
            Self::Events => 3,
        }
    }
}

/// Driver and event of a vehicle, each named by the first vehicle of it: names depend on all recordings at hand and not
/// on which windows of them are scored, so that folds agree on them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Cluster {
    driver: Arc<VehicleId>,
    event: Arc<VehicleId>,
}

impl Cluster {
    pub(crate) fn new(driver: Arc<VehicleId>, event: Arc<VehicleId>) -> Self {
        Self { driver, event }
    }

    /// The cluster that a draw takes as one.
    pub(crate) fn of(&self, draw: Draw) -> &VehicleId {
        match draw {
            Draw::Drivers => &self.driver,
            Draw::Events => &self.event,
        }
    }
}

/// Driver and event of each vehicle of some recordings.
#[derive(Clone, Debug)]
pub struct Clusters(BTreeMap<VehicleId, Cluster>);

impl Clusters {
    /// Of all vehicles of the recordings of a set. A vehicle with several tracks has the event of its first.
    #[must_use]
    pub fn of(set: &WindowSet<'_>) -> Self {
        let recordings = set.recordings();
        let drivers = Drivers::of(recordings, &overlaps(recordings));
        let mut numbers: BTreeMap<VehicleId, [Option<usize>; 2]> = BTreeMap::new();
        for (index, recording) in recordings.iter().enumerate() {
            for (track, it) in recording.tracks().iter().enumerate() {
                let vehicle = VehicleId { recording: recording.meta().name.clone(), vehicle: it.vehicle };
                numbers.entry(vehicle).or_insert_with(|| [drivers.driver(index, track), drivers.event(index, track)]);
            }
        }
        let mut names: [BTreeMap<usize, Arc<VehicleId>>; 2] = Default::default();
        let mut clusters = BTreeMap::new();
        for (vehicle, [driver, event]) in numbers {
            let own = Arc::new(vehicle.clone());
            let mut named = |kind: usize, number: Option<usize>| {
                number.map_or_else(|| own.clone(), |it| names[kind].entry(it).or_insert_with(|| own.clone()).clone())
            };
            let cluster = Cluster::new(named(0, driver), named(1, event));
            clusters.insert(vehicle, cluster);
        }
        Self(clusters)
    }

    /// The driver of a vehicle, named by the first of the vehicles that he is; a vehicle that is not of the recordings
    /// is a driver of its own.
    #[must_use]
    pub fn driver(&self, vehicle: &VehicleId) -> VehicleId {
        self.get(vehicle).of(Draw::Drivers).clone()
    }

    /// Driver and event of a vehicle; one that is not of the recordings is alone.
    pub(crate) fn get(&self, vehicle: &VehicleId) -> Cluster {
        let alone = || {
            let own = Arc::new(vehicle.clone());
            Cluster::new(own.clone(), own)
        };
        self.0.get(vehicle).cloned().unwrap_or_else(alone)
    }
}
