//! Names of data families.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Longest name of a dataset, in bytes.
const LONGEST: usize = 24;

/// The data family that a recording belongs to, by name: `ngsim`, `highd`, `live`, or any other.
///
/// A name is also a part of file names: 1 to 24 lower-case ASCII letters, digits, `-` and `_`, the
/// first of them a letter. What a dataset's files look like says its [`Format`](crate::Format).
///
/// ```
/// let dataset: gnp_data::Dataset = "exid".parse()?;
/// assert_eq!(dataset.as_str(), "exid");
/// assert!("../exid".parse::<gnp_data::Dataset>().is_err());
/// # Ok::<(), gnp_data::DatasetNameError>(())
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Dataset {
    /// The name, padded with zeros.
    name: [u8; LONGEST],
}

/// A text that is no name of a dataset.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name:?} is no name of a dataset; take up to 24 lower-case letters, digits, `-` and `_`, a letter first")]
#[non_exhaustive]
pub struct DatasetNameError {
    /// The text.
    pub name: String,
}

impl Dataset {
    /// US-101 and I-80, feet, 10 Hz (United States Department of Transportation).
    pub const NGSIM: Self = Self::known("ngsim");
    /// German motorways from a drone, metres, 25 Hz (and anything in its file layout).
    pub const HIGHD: Self = Self::known("highd");
    /// Plain tracks: any table of id, time and position.
    pub const TRACKS: Self = Self::known("tracks");
    /// Argoverse 2 motion forecasting: scenarios of 11 s from American streets, metres, 10 Hz.
    pub const AV2: Self = Self::known("av2");
    /// Floating car data of the simulator SUMO, metres, at the rate of the simulation.
    pub const SUMO: Self = Self::known("sumo");
    /// Tracks that a program has, instead of files: see [`LiveScene`](crate::LiveScene).
    pub const LIVE: Self = Self::known("live");

    /// A name that is known to be one.
    const fn known(text: &str) -> Self {
        let (mut name, text) = ([0; LONGEST], text.as_bytes());
        let mut i = 0;
        while i < text.len() {
            name[i] = text[i];
            i += 1;
        }
        Self { name }
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self.name.iter().position(|byte| *byte == 0).unwrap_or(LONGEST);
        // All bytes are ASCII.
        std::str::from_utf8(&self.name[..end]).unwrap_or_default()
    }
}

impl FromStr for Dataset {
    type Err = DatasetNameError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let allowed = |byte: &u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_');
        let begins = text.as_bytes().first().is_some_and(u8::is_ascii_lowercase);
        if begins && text.len() <= LONGEST && text.as_bytes().iter().all(allowed) {
            return Ok(Self::known(text));
        }
        Err(DatasetNameError { name: text.to_owned() })
    }
}

impl TryFrom<String> for Dataset {
    type Error = DatasetNameError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<Dataset> for String {
    fn from(dataset: Dataset) -> Self {
        dataset.as_str().to_owned()
    }
}

impl fmt::Display for Dataset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl fmt::Debug for Dataset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Dataset({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_written_as_its_name_and_read_back() {
        for (dataset, text) in [(Dataset::NGSIM, "\"ngsim\""), (Dataset::HIGHD, "\"highd\"")] {
            assert_eq!(serde_json::to_string(&dataset).unwrap(), text);
            assert_eq!(serde_json::from_str::<Dataset>(text).unwrap(), dataset);
        }
        let long = "a23456789-123456789_1234";
        assert_eq!(long.parse::<Dataset>().unwrap().to_string(), long);
    }

    #[test]
    fn what_could_not_be_a_file_name_is_refused() {
        for text in ["", "highD", "1st", "a b", "a/b", "..", "ä", "a2345678901234567890123456"] {
            let error = text.parse::<Dataset>().unwrap_err();
            assert_eq!(error.name, text);
            assert!(serde_json::from_str::<Dataset>(&format!("{text:?}")).is_err());
        }
    }
}
