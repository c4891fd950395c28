//! What vehicles are called: the one place where a name becomes a vehicle.

use std::collections::BTreeMap;

use gnp_data::{Recording, SceneEdit};

use super::change::{Change, NamedChange};
use super::moment::Moment;
use crate::explain::listed;

/// Names longer than this are cut in messages, and likened to no other.
const LONGEST: usize = 64;
/// Most names that are given as alike.
const ALIKE: usize = 4;

/// The vehicles of a moment by what the data calls them, and those that are added.
///
/// A vehicle is called as in the files; one that only the rows of its follower tell has a number alone. Where the data has
/// names, numbers of vehicles that have one mean nothing.
#[derive(Clone, Debug)]
pub struct Names<'a> {
    moment: &'a Moment,
    added: Vec<(String, u32)>,
}

/// Nobody is called so.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no vehicle {name} at this moment; there are {there}")]
#[non_exhaustive]
pub struct UnknownVehicle {
    /// The name that was asked for; of a long one its beginning.
    pub name: String,
    /// The names that are most like it, or else all that there are, in words.
    pub there: String,
}

impl<'a> Names<'a> {
    /// Those of a moment before it is changed.
    #[must_use]
    pub fn of(moment: &'a Moment) -> Self {
        Self { moment, added: Vec::new() }
    }

    /// The number of the vehicle of that name, whether or not a change has removed it.
    ///
    /// # Errors
    /// When nobody is called so, with the names that are most like it.
    pub fn number(&self, name: &str) -> Result<u32, UnknownVehicle> {
        let added = self.added.iter().find(|(known, _)| known == name).map(|(_, number)| *number);
        let numbered = || {
            let number = name.trim().parse().ok()?;
            let there = self.moment.scene().numbers().any(|it| it == number);
            (there && self.moment.name(number) == name.trim()).then_some(number)
        };
        added.or_else(|| self.moment.vehicle_named(name)).or_else(numbered).ok_or_else(|| self.unknown(name))
    }

    /// Whether a vehicle of the moment, or one that was added, is called so.
    #[must_use]
    pub fn is_taken(&self, name: &str) -> bool {
        self.number(name).is_ok()
    }

    /// A number for a vehicle that is added under a name that [is not taken](Names::is_taken); `None` where the last number is.
    pub fn add(&mut self, name: String) -> Option<u32> {
        let taken: Vec<u32> = self.added.iter().map(|(_, number)| *number).collect();
        let number = self.moment.free_number(&taken)?;
        self.added.push((name, number));
        Some(number)
    }

    /// A change by the numbers of the vehicles.
    ///
    /// # Errors
    /// When nobody is called so.
    pub fn change(&self, change: &NamedChange) -> Result<Change, UnknownVehicle> {
        Ok(match change {
            NamedChange::Remove { vehicle } => SceneEdit::Remove { vehicle: self.number(vehicle)? }.into(),
            NamedChange::Move { vehicle, by } => SceneEdit::Move { vehicle: self.number(vehicle)?, by: *by }.into(),
            NamedChange::Speed { vehicle, speed_mps } => {
                SceneEdit::Speed { vehicle: self.number(vehicle)?, speed_mps: *speed_mps }.into()
            }
            NamedChange::Goal { vehicle, at } => Change::Goal { vehicle: self.number(vehicle)?, at: *at },
            NamedChange::WithoutTerm(term) => Change::WithoutTerm(term.clone()),
        })
    }

    fn unknown(&self, name: &str) -> UnknownVehicle {
        let added = self.added.iter().map(|(name, number)| (*number, name.clone()));
        let there = self.moment.scene().numbers().map(|number| (number, self.moment.name(number)));
        UnknownVehicle { name: cut(name), there: alike_or_all(name, there.chain(added)) }
    }
}

/// The vehicles of a recording, as [`alike_or_all`] takes them.
pub(crate) fn of_recording(recording: &Recording) -> impl Iterator<Item = (u32, String)> {
    recording.tracks().iter().map(|track| (track.vehicle, recording.vehicle_name(track.vehicle).into_owned()))
}

/// A name as messages have it: of a long one its beginning.
pub(crate) fn cut(name: &str) -> String {
    let mut letters = name.chars();
    let begin: String = letters.by_ref().take(LONGEST).collect();
    if letters.next().is_some() { begin + "..." } else { begin }
}

/// Of vehicles, number and name, those whose names are most like `name`, such as `b7 (most like it, of 20)`; where none is,
/// all of them, such as `1, 2, 3 and 17 more`.
pub(crate) fn alike_or_all(name: &str, vehicles: impl Iterator<Item = (u32, String)>) -> String {
    let vehicles: BTreeMap<u32, String> = vehicles.collect();
    let alike = alike(name, vehicles.values().map(String::as_str));
    if alike.is_empty() {
        let called = |number: u32| vehicles.get(&number).map_or_else(String::new, |name| cut(name));
        listed(vehicles.keys().copied(), called)
    } else {
        format!("{} (most like it, of {})", alike.join(", "), vehicles.len())
    }
}

/// The names that are few letters away from `name`, the nearest first; upper and lower case are the same.
fn alike<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let short = |name: &str| name.chars().count() <= LONGEST;
    let name = name.trim().to_lowercase();
    if !short(&name) {
        return Vec::new();
    }
    let distance = |other: &str| strsim::levenshtein(&name, &other.to_lowercase());
    let length = name.chars().count();
    let most = (length / 3).min(1 + length / 5);
    let mut near: Vec<(usize, &str)> = names
        .filter(|other| short(other))
        .map(|other| (distance(other), other))
        .filter(|(far, _)| *far <= most)
        .collect();
    near.sort_unstable();
    near.dedup();
    near.into_iter().take(ALIKE).map(|(_, other)| other).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(name: &str, names: &[&str]) -> String {
        alike_or_all(name, (1..).zip(names.iter().map(|name| (*name).to_owned())))
    }

    #[test]
    fn who_is_called_nearly_so_is_named_first() {
        let names = ["flow.12", "flow.13", "bus", "Flow.7", "truck_1"];
        assert_eq!(told("flow.1", &names), "Flow.7, flow.12, flow.13 (most like it, of 5)");
        assert_eq!(told("FLOW.7", &names), "Flow.7, flow.12, flow.13 (most like it, of 5)");
        assert_eq!(told("buss", &names), "bus (most like it, of 5)");
        assert_eq!(told("tram", &names), "flow.12, flow.13, bus, Flow.7, truck_1");
        assert_eq!(told("tram", &[]), "none");
    }

    #[test]
    fn long_names_are_neither_likened_nor_repeated() {
        let long = "x".repeat(1000);
        assert_eq!(told(&long, &["bus"]), "bus");
        assert_eq!(told("bus", &[&long]), format!("{}...", "x".repeat(LONGEST)));
        assert_eq!(cut(&long).len(), LONGEST + 3);
    }
}
