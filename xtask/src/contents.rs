//! What a folder that the program wrote contains, the times in it set aside, so that two folders can be compared byte for byte.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use serde_json::Value;

/// What is set aside, for the reader of a report. Everything else is compared byte for byte.
pub(crate) const SET_ASIDE: &str = "Set aside: in run.json the seconds of each stage; in ingest.json `seconds`, `rows_per_second` and \
     `peak_memory_bytes`; in jobs/*.json `seconds`; in report.html the time of all stages; the files in events/, which have wall times; \
     the checksums of these files; what is in lock files; in eval.json where the run lies.";

/// Keys of JSON whose values are times, or sizes of the process.
const TIMES: [&str; 3] = ["seconds", "rows_per_second", "peak_memory_bytes"];

/// What stands before the time in a report.
const TIME_IN_REPORT: &str = "time of all stages</dt><dd>";

/// Files by their path below a folder, with `/` between names; empty folders with a `/` behind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Contents(BTreeMap<String, Vec<u8>>);

impl Contents {
    /// Reads every file below `folder`, and notes empty folders.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let (paths, empty) = list(folder)?;
        let mut files: BTreeMap<String, Vec<u8>> =
            empty.into_iter().map(|path| (format!("{path}/"), Vec::new())).collect();
        for path in paths {
            if in_events(&path) {
                continue;
            }
            let place = folder.join(&path);
            let bytes = fs::read(&place).with_context(|| format!("cannot read {}", place.display()))?;
            let bytes = without_times(&path, bytes);
            files.insert(path, bytes);
        }
        Ok(Self(files))
    }

    /// Each file that is not the same in `other`, with what is different; a file that only `other` has is *left over*.
    pub(crate) fn differences(&self, other: &Self) -> Vec<String> {
        let mine = self.0.iter().filter_map(|(path, bytes)| match other.0.get(path) {
            None => Some(format!("{path} is missing")),
            Some(others) if others != bytes => Some(format!("{path} differs")),
            Some(_) => None,
        });
        let others = other.0.keys().filter(|path| !self.0.contains_key(*path));
        mine.chain(others.map(|path| format!("{path} is left over"))).collect()
    }

    /// The same but some files.
    pub(crate) fn without(&self, aside: &[&str]) -> Self {
        let kept = self.0.iter().filter(|(path, _)| !aside.contains(&path.as_str()));
        Self(kept.map(|(path, bytes)| (path.clone(), bytes.clone())).collect())
    }

    /// The files.
    pub(crate) fn files(&self) -> &BTreeMap<String, Vec<u8>> {
        &self.0
    }
}

/// Paths of all files below `folder`, from it, in order. A file that vanishes meanwhile is left out.
///
/// # Errors
/// When a folder cannot be listed.
pub(crate) fn paths(folder: &Path) -> Result<Vec<String>> {
    list(folder).map(|(files, _)| files)
}

/// As [`paths`], and the folders below `folder` in which there is nothing.
///
/// # Errors
/// When a folder cannot be listed.
pub(crate) fn list(folder: &Path) -> Result<(Vec<String>, Vec<String>)> {
    let (mut files, mut empty) = (Vec::new(), Vec::new());
    let mut folders = vec![String::new()];
    while let Some(below) = folders.pop() {
        let place = folder.join(&below);
        let mut entries = fs::read_dir(&place).with_context(|| format!("cannot list {}", place.display()))?.peekable();
        if entries.peek().is_none() && !below.is_empty() {
            empty.push(below.clone());
        }
        for entry in entries {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let path = if below.is_empty() { name } else { format!("{below}/{name}") };
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(path),
                Ok(_) => files.push(path),
                Err(_) => {}
            }
        }
    }
    files.sort();
    Ok((files, empty))
}

/// Whether it is a file of curves, which has wall times, and of which a resumed training makes one more.
pub(crate) fn in_events(path: &str) -> bool {
    path.split('/').rev().nth(1) == Some("events")
}

fn without_times(path: &str, bytes: Vec<u8>) -> Vec<u8> {
    if path.ends_with(".lock") {
        return Vec::new();
    }
    if !has_times(path) {
        return bytes;
    }
    if path.ends_with(".html") {
        return match String::from_utf8(bytes) {
            Ok(text) => without_time_of_stages(&text).into_bytes(),
            Err(damaged) => damaged.into_bytes(),
        };
    }
    let Ok(mut value) = serde_json::from_slice::<Value>(&bytes) else { return bytes };
    remove_times(&mut value);
    if let Value::Object(map) = &mut value {
        // Of the whole object, times and all.
        map.remove("sha256");
        if path.ends_with("eval.json") {
            map.remove("run");
        }
        if let Some(Value::Object(stages)) = map.get_mut("finished") {
            stages.values_mut().for_each(|seconds| *seconds = Value::Null);
        }
        if let Some(Value::Object(files)) = map.get_mut("files") {
            files.retain(|name, _| !in_events(name));
            files.iter_mut().filter(|(name, _)| has_times(name)).for_each(|(_, seal)| *seal = Value::Null);
        }
    }
    value.to_string().into_bytes()
}

/// Whether there are times in it.
fn has_times(path: &str) -> bool {
    let mut names = path.rsplit('/');
    let name = names.next().unwrap_or(path);
    let in_jobs = names.next() == Some("jobs") && name.ends_with(".json");
    in_jobs || ["run.json", "ingest.json", "eval.json", "report.html"].contains(&name)
}

fn remove_times(value: &mut Value) {
    match value {
        Value::Object(map) => {
            map.retain(|key, _| !TIMES.contains(&key.as_str()));
            map.values_mut().for_each(remove_times);
        }
        Value::Array(items) => items.iter_mut().for_each(remove_times),
        _ => {}
    }
}

fn without_time_of_stages(text: &str) -> String {
    match text.split_once(TIME_IN_REPORT) {
        Some((before, after)) => {
            let after = after.find('<').map_or(after, |end| &after[end..]);
            format!("{before}{TIME_IN_REPORT}{after}")
        }
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contents(files: &[(&str, &str)]) -> Contents {
        let folder = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let place = folder.path().join(path);
            fs::create_dir_all(place.parent().unwrap()).unwrap();
            fs::write(place, text).unwrap();
        }
        Contents::read(folder.path()).unwrap()
    }

    #[test]
    fn what_differs_is_missing_or_left_over_is_named() {
        let a = contents(&[("metrics.json", "[1]"), ("figures/a.svg", "a"), ("split.json", "x")]);
        let b = contents(&[("metrics.json", "[2]"), ("split.json", "x"), (".tmp1", "")]);
        assert_eq!(a.differences(&b), ["figures/a.svg is missing", "metrics.json differs", ".tmp1 is left over"]);
        assert!(a.differences(&a.clone()).is_empty());
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("a/b")).unwrap();
        let nothing = contents(&[]);
        assert_eq!(nothing.differences(&Contents::read(folder.path()).unwrap()), ["a/b/ is left over"]);
    }

    #[test]
    fn times_are_set_aside_and_nothing_else() {
        let run = |seconds: &str, seed: &str| {
            let files = format!(r#"{{"events/{seconds}": 0, "ingest.json": {seconds}, "split.json": {seed}}}"#);
            format!(r#"{{"sha256": "{seconds}", "seed": 0, "finished": {{"goal": {seconds}}}, "files": {files}}}"#)
        };
        let report = |time: &str, rmse: &str| format!("<dt>time of all stages</dt><dd>{time} s</dd><b>{rmse}</b>");
        let all = |seconds: &str, seed: &str, rmse: &str| {
            contents(&[
                ("gnp/run.json", &run(seconds, seed)),
                ("report.html", &report(seconds, rmse)),
                ("jobs/a.json", &format!(r#"{{"state": "{rmse}", "seconds": {seconds}}}"#)),
                ("jobs/a.lock", seconds),
                ("gnp/events/events.out.tfevents.1.gnp.0", seconds),
                ("ingest.json", &format!(r#"{{"rows": {seed}, "rows_per_second": {seconds}}}"#)),
            ])
        };
        let first = all("1", "3", "x");
        assert!(first.differences(&all("2", "3", "x")).is_empty());
        assert_eq!(first.differences(&all("1", "4", "x")), ["gnp/run.json differs", "ingest.json differs"]);
        assert_eq!(first.differences(&all("1", "3", "y")), ["jobs/a.json differs", "report.html differs"]);
        let other = contents(&[("metrics.json", r#"{"seconds": 1}"#)]);
        assert_eq!(other.differences(&contents(&[("metrics.json", r#"{"seconds": 2}"#)])), ["metrics.json differs"]);
    }
}
