//! JSON objects whose first member is a SHA-256 of the others.

use std::io;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{FileError, save, sha256};

/// Before and after the digits, which stand first in the object.
const BEFORE: &str = "{\"sha256\":\"";
const AFTER: &str = "\",";
const DIGITS: usize = 64;

/// Writes an object with at least one member to `path`, a line a member, whole or not at all, under its checksum.
///
/// # Errors
/// When it is no JSON object or the file cannot be written.
pub fn save_json(path: &Path, value: &impl Serialize) -> Result<(), FileError> {
    sealed(serde_json::to_string_pretty(value))
        .and_then(|text| save(path, text.as_bytes()))
        .map_err(|error| FileError::new(path, format!("cannot be written: {error}")))
}

/// An object with at least one member as a line of JSON under its checksum: for files that are too long to look at.
///
/// # Errors
/// When it is no JSON object.
pub fn json_line(value: &impl Serialize) -> io::Result<String> {
    sealed(serde_json::to_string(value))
}

fn sealed(text: serde_json::Result<String>) -> io::Result<String> {
    let text = text?;
    let members = text.strip_prefix('{').ok_or_else(|| io::Error::other("it is no JSON object"))?;
    Ok(format!("{BEFORE}{}{AFTER}{members}\n", sha256([members.as_bytes()])))
}

/// Reads what [`save_json`] wrote. `remedy` ends the message about a file that was changed or is of another version, as in
/// "*start a new run*".
///
/// # Errors
/// For a file that is missing, was changed since it was written, or is of something else.
pub fn load_json<T: DeserializeOwned>(path: &Path, remedy: &str) -> Result<T, FileError> {
    let fail = |problem: String| FileError::new(path, problem);
    let bytes = std::fs::read(path).map_err(|error| fail(format!("cannot be read: {error}; {remedy}")))?;
    parse_json(&bytes).map_err(|problem| fail(format!("{problem}; {remedy}")))
}

/// What [`json_line`] or [`save_json`] made.
///
/// # Errors
/// A text that follows the name of the file, when it was changed since it was written or is of something else.
pub fn parse_json<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let Some(sealed) = bytes.strip_prefix(BEFORE.as_bytes()) else {
        return Err("has no checksum: it was changed, or is of an earlier version".to_owned());
    };
    let members = sealed.split_at_checked(DIGITS).and_then(|(sum, rest)| {
        let members = rest.strip_prefix(AFTER.as_bytes())?.strip_suffix(b"\n")?;
        (sha256([members]).as_bytes() == sum).then_some(members)
    });
    let members = members.ok_or("differs from what was written")?;
    let object = [b"{", members].concat();
    serde_json::from_slice(&object)
        .map_err(|error| format!("cannot be read by this version: {}", crate::excerpt(&error.to_string(), 300)))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn what_is_read_is_what_was_written_and_any_other_byte_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        // A float that JSON does not give back to the bit: the checksum is of the text.
        let value = BTreeMap::from([("a".to_owned(), 0.1 + 0.2), ("b".to_owned(), 1e-300)]);
        save_json(&path, &value).unwrap();
        let load = || load_json::<BTreeMap<String, f64>>(&path, "start anew");
        assert_eq!(load().unwrap().len(), 2);
        let bytes = std::fs::read(&path).unwrap();
        let plain: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        assert_eq!(plain["sha256"].as_str().unwrap().len(), DIGITS);
        for at in 0..bytes.len() {
            let mut broken = bytes.clone();
            broken[at] ^= 1;
            std::fs::write(&path, &broken).unwrap();
            let message = load().unwrap_err().to_string();
            let problem = if at < BEFORE.len() { "has no checksum" } else { "differs from what was written" };
            assert!(message.contains(problem) && message.ends_with("; start anew"), "{at}: {message}");
            std::fs::write(&path, &bytes[..at]).unwrap();
            assert!(load().is_err(), "{at}");
        }
        std::fs::remove_file(&path).unwrap();
        assert!(load().unwrap_err().to_string().contains("cannot be read"));
        assert!(save_json(&path, &[1]).is_err());
        let line = json_line(&value).unwrap();
        assert_eq!(parse_json::<BTreeMap<String, f64>>(line.as_bytes()).unwrap().len(), 2);
        assert_eq!(line.lines().count(), 1);
    }
}
