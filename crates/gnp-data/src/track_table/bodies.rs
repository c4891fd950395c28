//! What vehicles are: classes by their words, sizes that are given or assumed, numbers by names.

use std::collections::{BTreeMap, HashMap};

use super::{RowPlaces, TrackTable};
use crate::recording::VehicleClass;

/// [`VehicleClass::default_size`] of all classes.
pub const DEFAULT_SIZES: [(VehicleClass, [f32; 2]); 3] = [
    (VehicleClass::Motorcycle, VehicleClass::Motorcycle.default_size()),
    (VehicleClass::Car, VehicleClass::Car.default_size()),
    (VehicleClass::Truck, VehicleClass::Truck.default_size()),
];

/// A vehicle of unknown class is a motorcycle up to the first length, m, and a truck from the second on.
const CLASS_LENGTHS: [f32; 2] = [2.6, 7.5];

/// Words for motorcycles, cars and trucks, in lower case.
const CLASSES: [(VehicleClass, &[&str]); 3] = [
    (VehicleClass::Motorcycle, &["motorcycle", "motorcyclist", "motorbike", "moped"]),
    (
        VehicleClass::Car,
        &["car", "passenger", "vehicle", "van", "taxi", "suv", "pickup", "medium vehicle", "ego", "av"],
    ),
    (
        VehicleClass::Truck,
        &["truck", "bus", "lorry", "coach", "trailer", "truck_bus", "heavy vehicle", "large_vehicle"],
    ),
];

/// Words for what does not drive on a motorway.
const OTHERS: [&str; 13] = [
    "pedestrian",
    "person",
    "animal",
    "bicycle",
    "cyclist",
    "riderless_bicycle",
    "static",
    "background",
    "construction",
    "train",
    "rail",
    "tram",
    "pedestrian/bicycle",
];

/// What a word says of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VehicleWord {
    /// A motor vehicle of this class.
    Class(VehicleClass),
    /// No motor vehicle.
    Other,
    /// Not a word that is known.
    Unknown,
}

impl VehicleWord {
    /// What `word` says, in upper or lower case: `car`, `Truck`, `bus`, `motorcyclist`, `pedestrian`.
    #[must_use]
    pub fn of(word: &str) -> Self {
        let word = word.trim().to_ascii_lowercase();
        match CLASSES.iter().find(|(_, words)| words.contains(&word.as_str())) {
            Some((class, _)) => Self::Class(*class),
            None if OTHERS.contains(&word.as_str()) => Self::Other,
            None => Self::Unknown,
        }
    }
}

/// Length and width of a class, m.
pub(super) fn default_size(class: VehicleClass) -> [f32; 2] {
    class.default_size()
}

/// The class of a vehicle of which only the length, m, is known.
pub(super) fn class_of(length: Option<f32>) -> VehicleClass {
    match length {
        Some(length) if length < CLASS_LENGTHS[0] => VehicleClass::Motorcycle,
        Some(length) if length >= CLASS_LENGTHS[1] => VehicleClass::Truck,
        _ => VehicleClass::Car,
    }
}

impl TrackTable {
    /// Sets what vehicles are from columns by row: length and width in m, NaN or 0 where unknown, and words for classes. Of
    /// a vehicle the first row that says something counts. What is no motor vehicle is to be left out; words that are not
    /// known are named in a note.
    pub fn set_bodies(&mut self, length: Option<&[f64]>, width: Option<&[f64]>, class: Option<&[&str]>) {
        let at = |column: Option<&[f64]>, row: usize| {
            let value = column.and_then(|column| column.get(row)).filter(|value| value.is_finite() && **value != 0.);
            value.map(|value| *value as f32)
        };
        let mut seen: BTreeMap<&str, VehicleWord> = BTreeMap::new();
        for (row, index) in self.vehicle.iter().enumerate() {
            let Some(vehicle) = self.vehicles.get_mut(*index as usize) else { continue };
            vehicle.length = vehicle.length.or_else(|| at(length, row));
            vehicle.width = vehicle.width.or_else(|| at(width, row));
            let Some(word) = class.and_then(|class| class.get(row)).filter(|word| !word.trim().is_empty()) else {
                continue;
            };
            match seen.entry(word).or_insert_with(|| VehicleWord::of(word)) {
                VehicleWord::Class(class) => vehicle.class = vehicle.class.or(Some(*class)),
                VehicleWord::Other if vehicle.left_out.is_none() => {
                    vehicle.left_out = Some(format!("are no motor vehicles but of class {}", word.trim()));
                }
                _ => {}
            }
        }
        let unknown: Vec<String> = seen
            .into_iter()
            .filter(|(_, word)| *word == VehicleWord::Unknown)
            .map(|(word, _)| gnp_file::excerpt(word.trim(), 30))
            .collect();
        if !unknown.is_empty() {
            let listed = unknown.iter().take(5).cloned().collect::<Vec<_>>().join(", ");
            let more = if unknown.len() > 5 { ", ..." } else { "" };
            self.notes.push(format!("classes that are not known ({listed}{more}): taken by length"));
        }
    }

    /// Adds the rows of `other`, whose vehicles of the same names are the same; both have the same columns. The rows of
    /// `other` follow those of this table where they come from.
    pub fn append(&mut self, other: Self) {
        let known: HashMap<&str, u32> = self.vehicles.iter().zip(0..).map(|(it, i)| (it.name.as_str(), i)).collect();
        let mut next = self.vehicles.len() as u32;
        let place = |name: &str| {
            known.get(name).copied().unwrap_or_else(|| {
                next += 1;
                next - 1
            })
        };
        let mut place = place;
        let places: Vec<u32> = other.vehicles.iter().map(|vehicle| place(&vehicle.name)).collect();
        for (vehicle, at) in other.vehicles.into_iter().zip(&places) {
            match self.vehicles.get_mut(*at as usize) {
                Some(have) => {
                    have.class = have.class.or(vehicle.class);
                    have.length = have.length.or(vehicle.length);
                    have.width = have.width.or(vehicle.width);
                    have.left_out = have.left_out.take().or(vehicle.left_out);
                }
                None => self.vehicles.push(vehicle),
            }
        }
        self.vehicle.extend(other.vehicle.into_iter().filter_map(|vehicle| places.get(vehicle as usize)));
        self.time_s.extend(other.time_s);
        self.x.extend(other.x);
        self.y.extend(other.y);
        if let (Some(all), Some(more)) = (&mut self.velocity, other.velocity) {
            all.iter_mut().zip(more).for_each(|(all, more)| all.extend(more));
        }
        for (all, more) in [(&mut self.speed, other.speed), (&mut self.heading, other.heading)] {
            if let (Some(all), Some(more)) = (all, more) {
                all.extend(more);
            }
        }
        if let (Some(all), Some(more)) = (&mut self.lane, other.lane) {
            all.extend(more);
        }
        if let (RowPlaces::Numbers { numbers, .. }, RowPlaces::Numbers { numbers: more, .. }) =
            (&mut self.places, other.places)
        {
            numbers.extend(more);
        }
        for (reason, rows) in other.skipped_rows {
            *self.skipped_rows.entry(reason).or_insert(0) += rows;
        }
        for note in other.notes {
            if !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
    }
}

/// Numbers of vehicles: their names where all are whole numbers of 32 bits, else the order of appearance from 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Numbering {
    Names,
    Order(HashMap<String, u32>),
}

impl Numbering {
    pub(super) fn of(table: &TrackTable) -> Self {
        if table.vehicles.iter().all(|vehicle| number(&vehicle.name).is_some()) {
            return Self::Names;
        }
        Self::Order(table.vehicles.iter().map(|vehicle| vehicle.name.clone()).zip(1..).collect())
    }

    /// Number of a vehicle; `None` for one that has none.
    pub(super) fn number(&self, name: &str) -> Option<u32> {
        match self {
            Self::Names => number(name),
            Self::Order(numbers) => numbers.get(name).copied(),
        }
    }

    pub(super) fn is_by_order(&self) -> bool {
        matches!(self, Self::Order(_))
    }
}

/// A number as it is written back.
fn number(name: &str) -> Option<u32> {
    let plain = name == "0" || !name.starts_with(['0', '+']);
    name.parse().ok().filter(|_| plain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;

    fn table(names: &[&str]) -> TrackTable {
        let mut table = TrackTable::new(Dataset::TRACKS, "s", "n");
        table.set_names(names.iter().copied());
        table
    }

    #[test]
    fn numbers_are_kept_and_names_counted() {
        let numbers = |names: &[&str]| {
            let table = table(names);
            let numbering = Numbering::of(&table);
            table.vehicles.iter().map(|it| numbering.number(&it.name)).collect::<Vec<_>>()
        };
        assert_eq!(numbers(&["7", "0", "7", "4294967295"]), [Some(7), Some(0), Some(u32::MAX)]);
        for odd in ["07", "+7", "7.0", "-7", "4294967296", "AV", ""] {
            assert_eq!(numbers(&["9", odd, "9"]), [Some(1), Some(2)], "{odd}");
        }
    }

    #[test]
    fn the_first_row_that_says_something_counts() {
        let mut table = table(&["a", "b", "a", "b", "c"]);
        let lengths = [f64::NAN, 12.5, 4.4, 99., 0.];
        table.set_bodies(Some(&lengths), None, Some(&["", "Truck", "CAR", "car", "pedestrian"]));
        let told: Vec<_> = table.vehicles.iter().map(|it| (it.length, it.class, it.left_out.is_some())).collect();
        let (car, truck) = (Some(VehicleClass::Car), Some(VehicleClass::Truck));
        assert_eq!(told, [(Some(4.4), car, false), (Some(12.5), truck, false), (None, None, true)]);
        table.set_bodies(None, None, Some(&["hovercraft"; 5]));
        assert!(table.notes[0].contains("hovercraft"), "{:?}", table.notes);
    }

    #[test]
    fn appended_rows_belong_to_the_vehicles_of_their_names() {
        let (mut first, mut second) = (table(&["a", "b"]), table(&["c", "a", "c"]));
        (first.speed, second.speed) = (Some(vec![1., 2.]), Some(vec![3., 4., 5.]));
        second.vehicles[1].length = Some(4.);
        first.append(second);
        assert_eq!(first.vehicle, [0, 1, 2, 0, 2]);
        assert_eq!(first.vehicles.iter().map(|it| it.name.as_str()).collect::<Vec<_>>(), ["a", "b", "c"]);
        assert_eq!((first.speed.unwrap().len(), first.vehicles[0].length), (5, Some(4.)));
    }
}
