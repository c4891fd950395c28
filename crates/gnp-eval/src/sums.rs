//! Sums of contributions by vehicle: all that a value and its interval need.

use std::collections::BTreeMap;

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
    cells: Vec<Cell>,
    width: usize,
}

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

    /// Windows and vehicles that contributed to the metric at `index`.
    #[must_use]
    pub(crate) fn counts(&self, index: usize) -> (u64, usize) {
        let cells = self.rows().map(|row| row[index]);
        cells.fold((0, 0), |(windows, vehicles), cell| {
            (windows + u64::from(cell.windows), vehicles + usize::from(cell.windows > 0))
        })
    }

    /// These and the sums of other windows as one; a vehicle with windows in both is one vehicle.
    #[must_use]
    pub(crate) fn merged(&self, other: &Self) -> Self {
        let mut rows: BTreeMap<&VehicleId, Vec<Cell>> = BTreeMap::new();
        for (vehicle, row) in [self, other].into_iter().flat_map(|sums| sums.vehicles.iter().zip(sums.rows())) {
            let cells = rows.entry(vehicle).or_insert_with(|| vec![Cell::default(); row.len()]);
            for (cell, more) in cells.iter_mut().zip(row) {
                cell.sum += more.sum;
                cell.windows += more.windows;
            }
        }
        let (vehicles, cells): (Vec<_>, Vec<_>) = rows.into_iter().map(|(vehicle, row)| (vehicle.clone(), row)).unzip();
        Self { vehicles, cells: cells.concat(), width: self.width }
    }

    /// The sums of several sites as one.
    #[must_use]
    pub(crate) fn concatenated<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut rows: Vec<(VehicleId, Vec<Cell>)> = Vec::new();
        let mut width = 0;
        for part in parts {
            width = part.width;
            rows.extend(part.vehicles.iter().cloned().zip(part.rows().map(<[Cell]>::to_vec)));
        }
        rows.sort_by(|a, b| a.0.cmp(&b.0));
        let (vehicles, cells): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
        Self { vehicles, cells: cells.concat(), width }
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

    /// These and those of further seeds; `None` where they are not of the same vehicles.
    #[must_use]
    pub(crate) fn with(mut self, more: Self) -> Option<Self> {
        let same = more.0.iter().all(|sums| sums.vehicles == self.vehicles());
        self.0.extend(more.0);
        same.then_some(self)
    }

    /// Number of seeds.
    #[must_use]
    pub(crate) fn seeds(&self) -> usize {
        self.0.len()
    }

    /// Sums by seed.
    pub(crate) fn each(&self) -> impl Iterator<Item = &MetricSums> {
        self.0.iter()
    }

    /// The vehicles, in order of recording and number.
    #[must_use]
    pub(crate) fn vehicles(&self) -> &[VehicleId] {
        self.0.first().map_or(&[], MetricSums::vehicles)
    }

    /// Windows by vehicle that contributed to the metric at `index`.
    pub(crate) fn windows(&self, index: usize) -> impl Iterator<Item = u32> {
        self.0.first().into_iter().flat_map(move |sums| sums.rows().map(move |row| row[index].windows))
    }

    /// Windows and vehicles that contributed to the metric at `index`.
    #[must_use]
    pub(crate) fn counts(&self, index: usize) -> (u64, usize) {
        self.0.first().map_or((0, 0), |sums| sums.counts(index))
    }

    /// The metric at `index` over all vehicles and seeds; `None` where no window contributed.
    #[must_use]
    pub(crate) fn value(&self, index: usize, kind: MetricKind) -> Option<f64> {
        let mut pool = Pool::default();
        for row in self.0.iter().flat_map(MetricSums::rows) {
            pool.add(&row[index], 1., kind);
        }
        pool.value(kind)
    }

    /// These and those of other windows as one, seed by seed; both must have as many.
    #[must_use]
    pub(crate) fn merged(&self, other: &Self) -> Self {
        Self(self.0.iter().zip(&other.0).map(|(own, more)| own.merged(more)).collect())
    }
}

/// Numerator and denominator of a mean.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pool {
    sum: f64,
    weight: f64,
}

impl Pool {
    /// Adds one vehicle's cell `times` over.
    pub(crate) fn add(&mut self, cell: &Cell, times: f64, kind: MetricKind) {
        let windows = f64::from(cell.windows);
        if cell.windows == 0 {
            return;
        }
        let (sum, weight) = if kind.by_vehicle() { (cell.sum / windows, 1.) } else { (cell.sum, windows) };
        self.sum += times * sum;
        self.weight += times * weight;
    }

    /// The metric's value; `None` where nothing was added.
    pub(crate) fn value(self, kind: MetricKind) -> Option<f64> {
        (self.weight > 0.).then(|| kind.value(self.sum / self.weight))
    }
}

/// Gathers [`MetricSums`] window by window, in the order of the windows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gatherer {
    rows: BTreeMap<String, BTreeMap<u32, Vec<Cell>>>,
    width: usize,
}

impl Gatherer {
    /// Nothing yet, for `width` metrics.
    pub(crate) fn new(width: usize) -> Self {
        Self { rows: BTreeMap::new(), width }
    }

    /// Adds one window's contributions, one a metric.
    pub(crate) fn add(&mut self, recording: &str, vehicle: u32, contributions: &[Option<f64>]) {
        if !self.rows.contains_key(recording) {
            self.rows.insert(recording.to_owned(), BTreeMap::new());
        }
        let Some(vehicles) = self.rows.get_mut(recording) else { return };
        let row = vehicles.entry(vehicle).or_insert_with(|| vec![Cell::default(); self.width]);
        for (cell, contribution) in row.iter_mut().zip(contributions) {
            if let Some(value) = contribution {
                cell.sum += value;
                cell.windows += 1;
            }
        }
    }

    /// The sums.
    pub(crate) fn finish(self) -> MetricSums {
        let width = self.width;
        let (mut vehicles, mut cells) = (Vec::new(), Vec::new());
        for (recording, rows) in self.rows {
            for (vehicle, row) in rows {
                vehicles.push(VehicleId { recording: recording.clone(), vehicle });
                cells.extend(row);
            }
        }
        MetricSums { vehicles, cells, width }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl MetricSums {
        fn value(&self, index: usize, kind: MetricKind) -> Option<f64> {
            Members::one(self.clone()).value(index, kind)
        }
    }

    fn two_vehicles() -> MetricSums {
        let mut gatherer = Gatherer::new(2);
        gatherer.add("b", 7, &[Some(1.), None]);
        gatherer.add("a", 9, &[Some(4.), Some(3.)]);
        gatherer.add("b", 7, &[Some(3.), None]);
        gatherer.finish()
    }

    #[test]
    fn windows_pool_by_window_or_by_vehicle() {
        let sums = two_vehicles();
        // Three windows with squared errors 1, 3 (vehicle 7) and 4 (vehicle 9).
        assert!((sums.value(0, MetricKind::RmseAt).unwrap() - (8f64 / 3.).sqrt()).abs() < 1e-12);
        assert!((sums.value(0, MetricKind::RmseAtByVehicle).unwrap() - 3f64.sqrt()).abs() < 1e-12);
        assert!((sums.value(0, MetricKind::MinFde).unwrap() - 8. / 3.).abs() < 1e-12);
        assert_eq!(sums.counts(0), (3, 2));
    }

    #[test]
    fn a_metric_that_does_not_apply_is_counted_out() {
        let sums = two_vehicles();
        assert_eq!(sums.counts(1), (1, 1));
        assert_eq!(sums.value(1, MetricKind::OffRoad), Some(3.));
        let mut none = Gatherer::new(1);
        none.add("a", 1, &[None]);
        assert_eq!(none.finish().value(0, MetricKind::OffRoad), None);
    }

    /// A window's contribution is the mean over seeds, also below a root.
    #[test]
    fn seeds_are_averaged_window_by_window() {
        let of = |values: [f64; 2]| {
            let mut gatherer = Gatherer::new(1);
            gatherer.add("a", 1, &[Some(values[0])]);
            gatherer.add("a", 2, &[Some(values[1])]);
            Members::one(gatherer.finish())
        };
        let both = of([1., 4.]).with(of([9., 2.])).unwrap();
        assert_eq!((both.seeds(), both.counts(0)), (2, (2, 2)));
        assert!((both.value(0, MetricKind::RmseAt).unwrap() - 2.).abs() < 1e-12, "squared errors 5 and 3");
        assert_eq!(both.clone().with(Members::one(two_vehicles())), None, "other vehicles");
        let folds = both.merged(&both);
        assert_eq!((folds.seeds(), folds.counts(0)), (2, (4, 2)));
        assert_eq!(folds.value(0, MetricKind::RmseAt), both.value(0, MetricKind::RmseAt));
    }

    #[test]
    fn vehicles_come_in_order_also_after_joining_sites() {
        let id = |recording: &str, vehicle| VehicleId { recording: recording.to_owned(), vehicle };
        let one = two_vehicles();
        assert_eq!(one.vehicles(), [id("a", 9), id("b", 7)]);
        let mut other = Gatherer::new(2);
        other.add("aa", 1, &[Some(2.), Some(2.)]);
        let all = MetricSums::concatenated([&one, &other.finish()]);
        assert_eq!(all.vehicles(), [id("a", 9), id("aa", 1), id("b", 7)]);
        assert_eq!(all.counts(0), (4, 3));
        assert_eq!(all.value(0, MetricKind::Ade), Some(2.5));
    }
}
