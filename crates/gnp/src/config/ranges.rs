//! The range of every number of a configuration, as its components say it.
//!
//! Looked at before anything is deserialised, built or read: what is far too large would otherwise end, minutes later,
//! in an allocation that fails and takes the program with it.

use gnp_data::{SplitConfig, WindowConfig};
use gnp_eval::{Bootstrap, EvalConfig};
use gnp_goal::{GoalConfig, LabelConfig};
use gnp_model::FeatureConfig;
use gnp_modes::ModeParams;
use gnp_train::{GoalTraining, PathTraining, Schedule, TrainConfig};
use gnp_traj::TrajConfig;
use toml::{Table, Value};

use crate::error::{Result, bail};

/// Key below its table (`*` is any one), least, most, unit.
type Range = (&'static str, f64, f64, &'static str);

/// Numbers by table, in the order of the files.
const TABLES: [(&str, &[Range]); 23] = [
    // Whole numbers to here have a place of their own among floats.
    ("", &[("seed", 0., 9_007_199_254_740_992., "")]),
    ("data", &[("rate_hz", 1e-2, 1000., "Hz"), ("max_recordings", 0., 1e9, "files (0: all)")]),
    ("windows", &WindowConfig::RANGES),
    ("windows", &[("site_stride_s.*", OF_STRIDE.1, OF_STRIDE.2, OF_STRIDE.3)]),
    ("split", &SplitConfig::RANGES),
    ("modes", &ModeParams::RANGES),
    ("features", &FeatureConfig::RANGES),
    ("goal", &GoalConfig::RANGES),
    ("goal", &GoalTraining::RANGES),
    ("goal.labels", &LabelConfig::RANGES),
    ("goal", &TrainConfig::RANGES),
    ("goal", &Schedule::RANGES),
    ("traj", &TrajConfig::RANGES),
    ("traj", &[TrajConfig::TERM_PARAMETERS]),
    ("attraction", &PathTraining::RANGES),
    ("attraction", &TrainConfig::RANGES),
    ("attraction", &Schedule::RANGES),
    ("repulsion", &PathTraining::RANGES),
    ("repulsion", &TrainConfig::RANGES),
    ("repulsion", &Schedule::RANGES),
    ("predict", &[("trust", 0., 1., "(or \"fitted\")"), ("k", 1., ModeParams::RANGES[0].2, "futures")]),
    ("evaluate", &EvalConfig::RANGES),
    ("evaluate.bootstrap", &Bootstrap::RANGES),
];

/// That of `windows.stride_s`.
const OF_STRIDE: Range = WindowConfig::RANGES[3];

/// Refuses the first number of a configuration that is out of its range.
///
/// # Errors
/// Names the key, the number and the range.
pub(super) fn check(table: &Table) -> Result<()> {
    for (section, ranges) in TABLES {
        for (key, least, most, unit) in ranges {
            let path: Vec<&str> = section.split('.').filter(|part| !part.is_empty()).chain(key.split('.')).collect();
            let mut wrong = None;
            let mut see = |name: &str, number| {
                if wrong.is_none() && !(*least..=*most).contains(&number) {
                    wrong = Some((path.join(".").replace('*', name), number));
                }
            };
            if let Some(value) = path.first().and_then(|first| table.get(*first)) {
                numbers(value, &path[1..], "*", &mut see);
            }
            if let Some((key, number)) = wrong {
                let remedy = format!("give a number from {least} to {most} {unit}");
                bail!(Config, "{key} = {number}: {}", remedy.trim_end());
            }
        }
    }
    Ok(())
}

/// Calls `see` with every number at `path` below `value`, and with those of lists that stand on the way; with each comes
/// the key that `*` stood for, which is `name` so far.
fn numbers(value: &Value, path: &[&str], name: &str, see: &mut impl FnMut(&str, f64)) {
    match (value, path) {
        (Value::Array(values), _) => values.iter().for_each(|value| numbers(value, path, name, see)),
        (Value::Table(table), ["*", rest @ ..]) => {
            table.iter().for_each(|(name, value)| numbers(value, rest, name, see));
        }
        (Value::Table(table), [first, rest @ ..]) => {
            if let Some(value) = table.get(*first) {
                numbers(value, rest, name, see);
            }
        }
        (Value::Integer(number), []) => see(name, *number as f64),
        (Value::Float(number), []) => see(name, *number),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{EMBEDDED, RunConfig};

    /// Every number of `value` with its path; `at` is where it stands.
    fn leaves(value: &Value, at: &str, found: &mut Vec<String>) {
        match value {
            Value::Table(table) => {
                for (key, value) in table {
                    leaves(value, &format!("{at}.{key}"), found);
                }
            }
            Value::Array(values) => values.iter().for_each(|value| leaves(value, at, found)),
            Value::Integer(_) | Value::Float(_) => found.push(at.trim_start_matches('.').to_owned()),
            _ => {}
        }
    }

    fn embedded() -> Vec<(Table, Vec<String>)> {
        let with_numbers = |text: &str| {
            // No configuration that comes with the project has terms of its own.
            let term = "terms = [{ name = \"lines\", parameters = { k = 0.3 } }]";
            let table: Table = text.replacen("terms = []", term, 1).parse().unwrap();
            let mut found = Vec::new();
            leaves(&Value::Table(table.clone()), "", &mut found);
            (table, found)
        };
        EMBEDDED.iter().map(|(_, text)| with_numbers(text)).collect()
    }

    fn range_of(path: &str) -> Option<Range> {
        let ranges = TABLES.iter().flat_map(|(section, ranges)| ranges.iter().map(move |range| (section, range)));
        let fits = |(section, range): &(&&str, &Range)| {
            let known = format!("{section}.{}", range.0);
            let known: Vec<&str> = known.trim_start_matches('.').split('.').collect();
            let path: Vec<&str> = path.split('.').collect();
            known.len() == path.len() && known.iter().zip(&path).all(|(known, part)| *known == "*" || known == part)
        };
        ranges.filter(fits).map(|(_, range)| *range).next()
    }

    #[test]
    fn every_number_of_every_configuration_has_a_range() {
        for (_, found) in embedded() {
            assert!(found.len() > 80);
            for path in found {
                assert!(range_of(&path).is_some(), "{path} has no range: give it one where its component is");
            }
        }
    }

    /// Puts `value` in place of the numbers at `path`.
    fn put(into: &mut Value, path: &[&str], value: f64) {
        match (into, path) {
            (Value::Array(values), _) => values.iter_mut().for_each(|into| put(into, path, value)),
            (Value::Table(table), [first, rest @ ..]) => put(table.get_mut(*first).unwrap(), rest, value),
            (Value::Integer(into), []) if value.is_finite() => *into = value as i64,
            (into, []) => *into = Value::Float(value),
            _ => {}
        }
    }

    /// Of an integer `-1`, of a float `nan`, and so on: nothing of it may pass, and nothing may be built before it is refused.
    #[test]
    fn what_is_out_of_its_range_is_refused_by_name() {
        let (mut tried, mut refused) = (0, 0);
        for (table, mut found) in embedded() {
            found.dedup();
            for path in found {
                let (_, least, most, _) = range_of(&path).unwrap();
                let values = [-1., 0., least - 1., most * 1.01 + 1., 1e12, f64::NAN, f64::INFINITY];
                // TOML has no integer beyond the largest seed.
                for value in values.into_iter().filter(|value| !(9e18..1e30).contains(value)) {
                    let parts: Vec<&str> = path.split('.').collect();
                    let mut changed = Value::Table(table.clone());
                    put(&mut changed, &parts, value);
                    let text = toml::to_string(&changed).unwrap();
                    let inside = (least..=most).contains(&value);
                    tried += 1;
                    match RunConfig::parse(&text, &[]) {
                        Ok(_) => assert!(inside, "{path} = {value} passes"),
                        Err(error) if !inside => {
                            refused += 1;
                            assert!(error.chain().starts_with(&format!("{path} = ")), "{path} = {value}: {error}");
                        }
                        // Components know more, such as that heads divide the width.
                        Err(_) => {}
                    }
                }
            }
        }
        assert!(tried > 2000 && refused > tried / 2, "{refused} of {tried}");
    }

    /// Those that ended in an abort, some after minutes of work.
    #[test]
    fn numbers_that_no_memory_holds_are_refused() {
        for text in [
            "evaluate.bootstrap.resamples=1000000000000",
            "goal.width=4096000",
            "traj.hidden=1000000",
            "traj.encoder=[100000000000]",
            "goal.layers=100000000",
            "windows.predicted_s=1e9",
        ] {
            let message = RunConfig::embedded("smoke", &[text.parse().unwrap()]).unwrap_err().chain();
            let key = text.split('=').next().unwrap();
            assert!(message.contains(&format!("{key} = ")) && message.contains("give a number from"), "{message}");
        }
    }
}
