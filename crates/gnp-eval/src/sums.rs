//! Sums of contributions by vehicle: all that a value and its interval need.

use std::collections::{BTreeMap, BTreeSet};

use crate::clusters::{Cluster, Draw};
use crate::metric::MetricKind;

/// A vehicle among recordings. Its gap-free stretches count as one vehicle.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VehicleId {
    /// Name of the recording.
    pub recording: String,
    /// Vehicle of the file.
    pub vehicle: u32,
}

/// What one vehicle's windows add to one metric.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Cell {
    /// Sum of contributions.
    pub(crate) sum: f64,
    /// Windows that contributed.
    pub(crate) windows: u32,
}

/// Sums of each metric's contributions by vehicle, `[vehicles, metrics]`, vehicles in order.
///
/// Memory grows with vehicles, not with windows.
#[derive(Clone, Debug, PartialEq)]
pub struct MetricSums {
    vehicles: Vec<VehicleId>,
    /// Driver and event of each vehicle.
    clusters: Vec<Cluster>,
    cells: Vec<Cell>,
    width: usize,
}

/// What entered a metric.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) windows: u64,
    pub(crate) drivers: usize,
    pub(crate) events: usize,
}

/// One vehicle's row while it is put together.
type Row = (Cluster, Vec<Cell>);

impl MetricSums {
    /// The vehicles, in order of recording and number.
    #[must_use]
    pub fn vehicles(&self) -> &[VehicleId] {
        &self.vehicles
    }

    /// One row a vehicle, one cell a metric.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &[Cell]> {
        self.cells.chunks_exact(self.width.max(1))
    }

    /// What contributed to the metric at `index`.
    #[must_use]
    pub(crate) fn counts(&self, index: usize) -> Counts {
        let there = || self.clusters.iter().zip(self.rows()).filter(|(_, row)| row[index].windows > 0);
        let of = |draw| there().map(|(cluster, _)| cluster.of(draw)).collect::<BTreeSet<_>>().len();
        Counts {
            windows: there().map(|(_, row)| u64::from(row[index].windows)).sum(),
            drivers: of(Draw::Drivers),
            events: of(Draw::Events),
        }
    }

    /// These and the sums of other windows as one; a vehicle with windows in both is one vehicle. `None` where it
    /// has not the same driver and event in both.
    #[must_use]
    pub(crate) fn merged(&self, other: &Self) -> Option<Self> {
        let mut rows: BTreeMap<VehicleId, Row> = BTreeMap::new();
        for (vehicle, (cluster, row)) in [self, other].into_iter().flat_map(Self::whole_rows) {
            let empty = || (cluster.clone(), vec![Cell::default(); row.len()]);
            let (known, cells) = rows.entry(vehicle.clone()).or_insert_with(empty);
            if known != cluster {
                return None;
            }
            for (cell, more) in cells.iter_mut().zip(row) {
                cell.sum += more.sum;
                cell.windows += more.windows;
            }
        }
        Some(Self::of_rows(rows, self.width))
    }

    /// The sums of several sites as one.
    #[must_use]
    pub(crate) fn concatenated<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut rows: BTreeMap<VehicleId, Row> = BTreeMap::new();
        let mut width = 0;
        for part in parts {
            width = part.width;
            let owned = |(vehicle, (cluster, row)): (&VehicleId, (&Cluster, &[Cell]))| {
                (vehicle.clone(), (cluster.clone(), row.to_vec()))
            };
            rows.extend(part.whole_rows().map(owned));
        }
        Self::of_rows(rows, width)
    }

    fn whole_rows(&self) -> impl Iterator<Item = (&VehicleId, (&Cluster, &[Cell]))> {
        self.vehicles.iter().zip(self.clusters.iter().zip(self.rows()))
    }

    fn of_rows(rows: BTreeMap<VehicleId, Row>, width: usize) -> Self {
        let mut sums = Self { vehicles: Vec::new(), clusters: Vec::new(), cells: Vec::new(), width };
        for (vehicle, (cluster, row)) in rows {
            sums.vehicles.push(vehicle);
            sums.clusters.push(cluster);
            sums.cells.extend(row);
        }
        sums
    }
}

/// One system's sums on some windows: one [`MetricSums`] for each seed with which it was trained, all of
/// the same vehicles. What a window adds is the mean over the seeds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Members(Vec<MetricSums>);

impl Members {
    /// Of a system with one seed.
    pub(crate) fn one(sums: MetricSums) -> Self {
        Self(vec![sums])
    }

    /// These and those of further seeds; `None` where they are not of the same vehicles, drivers and
    /// events.
    #[must_use]
    pub(crate) fn with(mut self, more: Self) -> Option<Self> {
        let same = self.same_clusters(&more);
        self.0.extend(more.0);
        same.then_some(self)
    }

    /// Whether both are of the same vehicles, drivers and events.
    #[must_use]
    pub(crate) fn same_clusters(&self, other: &Self) -> bool {
        let Some(own) = self.0.first() else { return other.0.is_empty() };
        other.0.iter().all(|sums| sums.vehicles == own.vehicles && sums.clusters == own.clusters)
    }

    /// Number of seeds.
    #[must_use]
    pub(crate) fn seeds(&self) -> usize {
        self.0.len()
    }

    /// What each cluster of a draw, in order, adds over all seeds to the metric at each of `indices`:
    /// `[clusters][indices]`.
    #[must_use]
    pub(crate) fn pools(&self, draw: Draw, metrics: &[(usize, MetricKind)]) -> Vec<Vec<Pool>> {
        let mut clusters: BTreeMap<&VehicleId, Vec<Pool>> = BTreeMap::new();
        for (cluster, row) in self.0.iter().flat_map(|sums| sums.clusters.iter().zip(sums.rows())) {
            let pools = clusters.entry(cluster.of(draw)).or_insert_with(|| vec![Pool::default(); metrics.len()]);
            for (pool, (index, kind)) in pools.iter_mut().zip(metrics) {
                pool.add(&row[*index], *kind);
            }
        }
        clusters.into_values().collect()
    }

    /// Windows by vehicle that contributed to the metric at `index`.
    pub(crate) fn windows(&self, index: usize) -> impl Iterator<Item = u32> {
        self.0.first().into_iter().flat_map(move |sums| sums.rows().map(move |row| row[index].windows))
    }

    /// What contributed to the metric at `index`.
    #[must_use]
    pub(crate) fn counts(&self, index: usize) -> Counts {
        self.0.first().map_or_else(Counts::default, |sums| sums.counts(index))
    }

    /// The metric at `index` over all vehicles and seeds; `None` where no window contributed.
    #[must_use]
    pub(crate) fn value(&self, index: usize, kind: MetricKind) -> Option<f64> {
        let mut pool = Pool::default();
        for row in self.0.iter().flat_map(MetricSums::rows) {
            pool.add(&row[index], kind);
        }
        pool.value(kind)
    }

    /// The metric at `index` of each seed over all vehicles.
    #[must_use]
    pub(crate) fn by_seed(&self, index: usize, kind: MetricKind) -> Vec<f64> {
        let of_seed = |sums: &MetricSums| {
            let mut pool = Pool::default();
            sums.rows().for_each(|row| pool.add(&row[index], kind));
            pool.value(kind)
        };
        self.0.iter().filter_map(of_seed).collect()
    }

    /// These and those of other windows as one, seed by seed; both must have as many. `None` where a vehicle of
    /// both has not the same driver and event.
    #[must_use]
    pub(crate) fn merged(&self, other: &Self) -> Option<Self> {
        self.0.iter().zip(&other.0).map(|(own, more)| own.merged(more)).collect::<Option<_>>().map(Self)
    }
}

/// Numerator and denominator of a mean.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pool {
    sum: f64,
    weight: f64,
}

impl Pool {
    /// Adds one vehicle's cell.
    fn add(&mut self, cell: &Cell, kind: MetricKind) {
        let windows = f64::from(cell.windows);
        if cell.windows == 0 {
            return;
        }
        let (sum, weight) = if kind.by_vehicle() { (cell.sum / windows, 1.) } else { (cell.sum, windows) };
        self.sum += sum;
        self.weight += weight;
    }

    /// Adds another `times` over.
    pub(crate) fn add_times(&mut self, other: Self, times: f64) {
        self.sum += times * other.sum;
        self.weight += times * other.weight;
    }

    /// The metric's value; `None` where nothing was added.
    pub(crate) fn value(self, kind: MetricKind) -> Option<f64> {
        (self.weight > 0.).then(|| kind.value(self.sum / self.weight))
    }
}

/// Gathers [`MetricSums`] window by window, in the order of the windows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gatherer {
    rows: BTreeMap<VehicleId, Row>,
    width: usize,
}

impl Gatherer {
    /// Nothing yet, for `width` metrics.
    pub(crate) fn new(width: usize) -> Self {
        Self { rows: BTreeMap::new(), width }
    }

    /// Adds one window's contributions, one a metric.
    pub(crate) fn add(&mut self, vehicle: &VehicleId, cluster: &Cluster, contributions: &[Option<f64>]) {
        if !self.rows.contains_key(vehicle) {
            self.rows.insert(vehicle.clone(), (cluster.clone(), vec![Cell::default(); self.width]));
        }
        let Some((_, row)) = self.rows.get_mut(vehicle) else { return };
        for (cell, contribution) in row.iter_mut().zip(contributions) {
            if let Some(value) = contribution {
                cell.sum += value;
                cell.windows += 1;
            }
        }
    }

    /// The sums.
    pub(crate) fn finish(self) -> MetricSums {
        MetricSums::of_rows(self.rows, self.width)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Gatherer {
        /// A window of a vehicle that is a driver and an event of its own.
        pub(crate) fn add_alone(&mut self, recording: &str, vehicle: u32, contributions: &[Option<f64>]) {
            self.add_of(recording, vehicle, [(recording, vehicle); 2], contributions);
        }

        /// A window of a vehicle whose driver and event are named.
        pub(crate) fn add_of(
            &mut self,
            recording: &str,
            vehicle: u32,
            cluster: [(&str, u32); 2],
            contributions: &[Option<f64>],
        ) {
            let id = |(recording, vehicle): (&str, u32)| VehicleId { recording: recording.to_owned(), vehicle };
            let [driver, event] = cluster.map(|name| std::sync::Arc::new(id(name)));
            self.add(&id((recording, vehicle)), &Cluster::new(driver, event), contributions);
        }
    }

    fn counts(windows: u64, drivers: usize, events: usize) -> Counts {
        Counts { windows, drivers, events }
    }

    impl MetricSums {
        fn value(&self, index: usize, kind: MetricKind) -> Option<f64> {
            Members::one(self.clone()).value(index, kind)
        }
    }

    fn two_vehicles() -> MetricSums {
        let mut gatherer = Gatherer::new(2);
        gatherer.add_alone("b", 7, &[Some(1.), None]);
        gatherer.add_alone("a", 9, &[Some(4.), Some(3.)]);
        gatherer.add_alone("b", 7, &[Some(3.), None]);
        gatherer.finish()
    }

    #[test]
    fn windows_pool_by_window_or_by_vehicle() {
        let sums = two_vehicles();
        // Three windows with squared errors 1, 3 (vehicle 7) and 4 (vehicle 9).
        assert!((sums.value(0, MetricKind::RmseAt).unwrap() - (8f64 / 3.).sqrt()).abs() < 1e-12);
        assert!((sums.value(0, MetricKind::RmseAtByVehicle).unwrap() - 3f64.sqrt()).abs() < 1e-12);
        assert!((sums.value(0, MetricKind::MinFde).unwrap() - 8. / 3.).abs() < 1e-12);
        assert_eq!(sums.counts(0), counts(3, 2, 2));
    }

    #[test]
    fn a_metric_that_does_not_apply_is_counted_out() {
        let sums = two_vehicles();
        assert_eq!(sums.counts(1), counts(1, 1, 1));
        assert_eq!(sums.value(1, MetricKind::OffRoad), Some(3.));
        let mut none = Gatherer::new(1);
        none.add_alone("a", 1, &[None]);
        assert_eq!(none.finish().value(0, MetricKind::OffRoad), None);
    }

    /// A window's contribution is the mean over seeds, also below a root.
    #[test]
    fn seeds_are_averaged_window_by_window() {
        let of = |values: [f64; 2]| {
            let mut gatherer = Gatherer::new(1);
            gatherer.add_alone("a", 1, &[Some(values[0])]);
            gatherer.add_alone("a", 2, &[Some(values[1])]);
            Members::one(gatherer.finish())
        };
        let both = of([1., 4.]).with(of([9., 2.])).unwrap();
        assert_eq!((both.seeds(), both.counts(0)), (2, counts(2, 2, 2)));
        assert!((both.value(0, MetricKind::RmseAt).unwrap() - 2.).abs() < 1e-12, "squared errors 5 and 3");
        assert_eq!(both.clone().with(Members::one(two_vehicles())), None, "other vehicles");
        let folds = both.merged(&both).unwrap();
        assert_eq!((folds.seeds(), folds.counts(0)), (2, counts(4, 2, 2)));
        assert_eq!(folds.value(0, MetricKind::RmseAt), both.value(0, MetricKind::RmseAt));
    }

    /// A vehicle that is one driver here and another there was named from other recordings.
    #[test]
    fn drivers_and_events_must_be_the_same() {
        let of = |cluster: [(&str, u32); 2]| {
            let mut gatherer = Gatherer::new(1);
            gatherer.add_of("a", 1, cluster, &[Some(1.)]);
            Members::one(gatherer.finish())
        };
        let own = of([("a", 1); 2]);
        assert!(own.clone().with(own.clone()).is_some() && own.merged(&own).is_some());
        for other in [of([("a", 2), ("a", 1)]), of([("a", 1), ("b", 1)])] {
            assert!(own.clone().with(other.clone()).is_none() && own.merged(&other).is_none());
            assert!(!own.same_clusters(&other) && own.same_clusters(&own));
        }
    }

    #[test]
    fn vehicles_come_in_order_also_after_joining_sites() {
        let id = |recording: &str, vehicle| VehicleId { recording: recording.to_owned(), vehicle };
        let one = two_vehicles();
        assert_eq!(one.vehicles(), [id("a", 9), id("b", 7)]);
        let mut other = Gatherer::new(2);
        other.add_alone("aa", 1, &[Some(2.), Some(2.)]);
        let all = MetricSums::concatenated([&one, &other.finish()]);
        assert_eq!(all.vehicles(), [id("a", 9), id("aa", 1), id("b", 7)]);
        assert_eq!(all.counts(0), counts(4, 3, 3));
        assert_eq!(all.value(0, MetricKind::Ade), Some(2.5));
    }

    /// Forty windows of one driver, in two recordings and under two numbers, are one driver; the two recordings are two
    /// events.
    #[test]
    fn a_driver_of_two_recordings_is_one() {
        let driver = ("a", 1);
        let mut gatherer = Gatherer::new(1);
        for _ in 0..20 {
            gatherer.add_of("a", 1, [driver, ("a", 1)], &[Some(1.)]);
            gatherer.add_of("b", 8, [driver, ("b", 2)], &[Some(3.)]);
        }
        let sums = Members::one(gatherer.finish());
        assert_eq!(sums.counts(0), counts(40, 1, 2));
        let pooled = |draw| {
            let pools = sums.pools(draw, &[(0, MetricKind::Ade)]);
            pools.iter().map(|it| it[0].value(MetricKind::Ade)).collect::<Vec<_>>()
        };
        assert_eq!(pooled(Draw::Drivers), [Some(2.)]);
        assert_eq!(pooled(Draw::Events), [Some(1.), Some(3.)]);
    }
}
