//! JSON objects whose first member is a SHA-256 of the others.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{FileError, save, sha256};

/// Before and after the digits, which stand first in the object.
const BEFORE: &str = "{\n  \"sha256\": \"";
const AFTER: &str = "\",";
const DIGITS: usize = 64;

/// Writes an object with at least one member to `path`, whole or not at all, under its checksum.
///
/// # Errors
/// When it is no JSON object or the file cannot be written.
pub fn save_json(path: &Path, value: &impl Serialize) -> Result<(), FileError> {
    let fail = |error: &dyn std::fmt::Display| FileError::new(path, format!("cannot be written: {error}"));
    let text = serde_json::to_string_pretty(value).map_err(|error| fail(&error))?;
    let members = text.strip_prefix('{').ok_or_else(|| fail(&"it is no JSON object"))?;
    let sum = sha256([members.as_bytes()]);
    save(path, format!("{BEFORE}{sum}{AFTER}{members}\n").as_bytes()).map_err(|error| fail(&error))
}

/// Reads what [`save_json`] wrote. `remedy` ends the message about a file that was changed or is of another version, as in
/// "*start a new run*".
///
/// # Errors
/// For a file that is missing, was changed since it was written, or is of something else.
pub fn load_json<T: DeserializeOwned>(path: &Path, remedy: &str) -> Result<T, FileError> {
    let fail = |problem: String| FileError::new(path, problem);
    let bytes = std::fs::read(path).map_err(|error| fail(format!("cannot be read: {error}; {remedy}")))?;
    let changed = || fail(format!("differs from what was written; {remedy}"));
    let members = String::from_utf8(bytes).ok().and_then(|text| {
        let text = text.strip_prefix(BEFORE)?.strip_suffix('\n')?;
        let (sum, rest) = text.split_at_checked(DIGITS)?;
        let members = rest.strip_prefix(AFTER)?;
        (sha256([members.as_bytes()]) == sum).then(|| members.to_owned())
    });
    let text = format!("{{{}", members.ok_or_else(changed)?);
    serde_json::from_str(&text).map_err(|error| fail(format!("cannot be read by this version: {error}; {remedy}")))
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
            assert!(message.ends_with("a.json: differs from what was written; start anew"), "{at}: {message}");
            std::fs::write(&path, &bytes[..at]).unwrap();
            assert!(load().is_err(), "{at}");
        }
        std::fs::remove_file(&path).unwrap();
        assert!(load().unwrap_err().to_string().contains("cannot be read"));
        assert!(save_json(&path, &[1]).is_err());
    }
}
