//! Keys of a configuration: which exist, which are missing, and setting one from the command line.
//!
//! A reference table (an embedded configuration, which writes every key) says what exists. Checking
//! against it, before anything is deserialised, names the whole path of a wrong key and its neighbours.

use crate::error::{Context as _, Error, Result, bail};
use gnp_file::excerpt;
use toml::{Table, Value};

/// Characters that a message quotes of what somebody wrote.
pub(super) const QUOTED: usize = 80;

/// Keys that take a number or a word.
const OF_TWO_TYPES: [&str; 1] = ["predict.trust"];

/// Tables that are checked as one value: their keys name things of the data, or differ by kind.
const WHOLE: [&str; 5] =
    ["windows.site_stride_s", "split.sites", "goal.schedule", "attraction.schedule", "repulsion.schedule"];

/// Keys that need not be there: without them the data says it all, or the run was made before there was the key.
const OPTIONAL: [&str; 3] = ["data.road", "data.lane_lines", "predict.precision"];

/// What keys were called before, by their last part, and what they are called now.
const RENAMED: [(&str, &str); 7] = [
    ("nobody", "null_token"),
    ("slot_code", "slot_embedding"),
    ("stretch", "longitudinal_scale"),
    ("following_hint", "car_following_features"),
    ("site_balance", "site_sampling_exponent"),
    ("code", "latent_dim"),
    ("part", "subset"),
];

/// One `key=value` of `--set`.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Dotted path, such as `goal.epochs`.
    pub key: String,
    /// What stands after the `=`, as typed.
    pub text: String,
}

impl std::str::FromStr for Setting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (key, value) = text.split_once('=').ok_or_else(|| format!("`{text}` has no `=`; write KEY=VALUE"))?;
        let (key, value) = (key.trim(), value.trim());
        if key.is_empty() || value.is_empty() {
            return Err(format!("`{text}`: key and value must not be empty; write KEY=VALUE"));
        }
        Ok(Self { key: key.to_owned(), text: value.to_owned() })
    }
}

/// Every dotted path of `table` that holds a value, in the order of the table.
pub(crate) fn paths(table: &Table) -> Vec<String> {
    let mut found = Vec::new();
    walk(table, "", &mut |path, _| found.push(path.to_owned()));
    found
}

/// Calls `visit` with every dotted path that holds a value; a whole table counts as a value.
fn walk(table: &Table, prefix: &str, visit: &mut impl FnMut(&str, &Value)) {
    for (key, value) in table {
        let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            Value::Table(inner) if !WHOLE.contains(&path.as_str()) => walk(inner, &path, visit),
            value => visit(&path, value),
        }
    }
}

/// The value at a dotted path.
pub(crate) fn get<'a>(table: &'a Table, path: &str) -> Option<&'a Value> {
    let mut parts = path.split('.');
    let mut value = table.get(parts.next()?)?;
    for part in parts {
        value = value.as_table()?.get(part)?;
    }
    Some(value)
}

/// Checks that `table` has exactly the keys of `reference`.
///
/// # Errors
/// When a key of `table` is not known, with the keys that come near it; when one is missing.
pub(crate) fn check(table: &Table, reference: &Table) -> Result<()> {
    let known = paths(reference);
    for path in paths(table) {
        if !known.contains(&path) && !OPTIONAL.contains(&path.as_str()) {
            return Err(unknown(&path, &known));
        }
    }
    let needed = |path: &&String| !OPTIONAL.contains(&path.as_str()) && get(table, path).is_none();
    if let Some(path) = known.iter().find(needed) {
        let example = get(reference, path).map(ToString::to_string).unwrap_or_default();
        bail!(
            Config,
            "key `{path}` is missing; every key is written in a configuration, for example `{path} = {example}`"
        );
    }
    Ok(())
}

/// Sets one key of `table`, typed as the value it replaces.
///
/// # Errors
/// When the key does not exist, with the keys that come near it; when the value has another type.
pub(crate) fn set(table: &mut Table, setting: &Setting) -> Result<()> {
    let Setting { key, text } = setting;
    if let Some((name, whole)) = WHOLE.iter().find_map(|path| Some((key.strip_prefix(path)?.strip_prefix('.')?, path)))
    {
        let inner = whole.split('.').try_fold(&mut *table, |at, part| at.get_mut(part)?.as_table_mut());
        inner
            .ok_or_else(|| Error::Config(format!("the configuration has no table `{whole}`")))?
            .insert(name.to_owned(), parse(text));
        return Ok(());
    }
    if let Some((inner, name)) = key.rsplit_once('.').filter(|_| OPTIONAL.contains(&key.as_str()))
        && let Some(inner) = table.get_mut(inner).and_then(Value::as_table_mut)
    {
        inner.insert(name.to_owned(), parse(text));
        return Ok(());
    }
    let known = paths(table);
    if !known.contains(key) {
        return Err(unknown(key, &known)).context(format!("--set {}", excerpt(&format!("{key}={text}"), QUOTED)));
    }
    let mut parts: Vec<&str> = key.split('.').collect();
    let last = parts.pop().unwrap_or_default();
    let inner = parts.into_iter().try_fold(table, |at, part| at.get_mut(part)?.as_table_mut());
    let slot = inner.and_then(|inner| inner.get_mut(last)).ok_or_else(|| Error::Config(format!("no key `{key}`")))?;
    *slot = match (&*slot, parse(text)) {
        (Value::Float(_), Value::Integer(whole)) => Value::Float(whole as f64),
        (old, new) if old.same_type(&new) || OF_TWO_TYPES.contains(&key.as_str()) => new,
        (old, new) => bail!(
            Config,
            "--set {key}={}: `{key}` takes a value of type {}, as in `{key} = {old}`; this is of type {}",
            excerpt(text, QUOTED),
            old.type_str(),
            new.type_str()
        ),
    };
    Ok(())
}

/// A TOML value; text that is none, such as `recording`, is a string.
fn parse(text: &str) -> Value {
    let parsed = format!("value = {text}").parse::<Table>();
    parsed.ok().and_then(|mut table| table.remove("value")).unwrap_or_else(|| Value::String(text.to_owned()))
}

/// The error for a key that does not exist.
fn unknown(path: &str, known: &[String]) -> Error {
    let quoted = excerpt(path, QUOTED);
    if let Some(now) = renamed(path, known) {
        return Error::Config(format!("key `{path}` is now called `{now}`"));
    }
    let below = format!("{path}.");
    let members: Vec<&str> = known.iter().filter_map(|key| key.strip_prefix(&below)).collect();
    if let Some(first) = members.first() {
        let keys = members.join(", ");
        return Error::Config(format!(
            "`{path}` is a table: set one of its keys, as in `{below}{first}`; it has {keys}"
        ));
    }
    let near = near(path, known);
    if near.is_empty() {
        Error::Config(format!("unknown key `{quoted}`; configs/ngsim.toml has every key with a comment"))
    } else {
        Error::Config(format!("unknown key `{quoted}`; near it: `{}`", near.join("`, `")))
    }
}

/// What the key at `path` is called now, if it was renamed.
fn renamed(path: &str, known: &[String]) -> Option<String> {
    let (table, last) = path.rsplit_once('.')?;
    let (_, now) = RENAMED.iter().find(|(before, _)| *before == last)?;
    Some(format!("{table}.{now}")).filter(|now| known.contains(now))
}

/// Known keys that are likely meant: few edits away, or with the same last part.
fn near<'a>(path: &str, known: &'a [String]) -> Vec<&'a str> {
    let last = |path: &str| path.rsplit('.').next().unwrap_or_default().to_owned();
    let mut ranked: Vec<(usize, &str)> = known
        .iter()
        .filter_map(|candidate| {
            let whole = strsim::levenshtein(path, candidate);
            let end = strsim::levenshtein(&last(path), &last(candidate));
            let distance = whole.min(end + 1);
            (distance <= 1 + path.len() / 5).then_some((distance, candidate.as_str()))
        })
        .collect();
    ranked.sort_unstable();
    ranked.into_iter().take(4).map(|(_, candidate)| candidate).collect()
}

/// The first key, in the order of `old`, whose value differs, with both values.
pub(crate) fn first_difference(old: &Table, new: &Table) -> Option<(String, String, String)> {
    let text = |value: Option<&Value>| value.map_or_else(|| "absent".to_owned(), ToString::to_string);
    paths(old)
        .into_iter()
        .chain(paths(new))
        .find(|path| get(old, path) != get(new, path))
        .map(|path| (path.clone(), text(get(old, &path)), text(get(new, &path))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        "seed = 1\n[goal]\nepochs = 15\nrate = 1e-3\nhead = 'decoder'\nhalve_at = [1, 2]\n[split]\nkind = 'vehicle'\n[split.sites]\nus-101 = 'recording'\n"
            .parse()
            .unwrap()
    }

    fn set_text(text: &str) -> Result<Table> {
        let mut table = table();
        set(&mut table, &text.parse().map_err(Error::Config)?)?;
        Ok(table)
    }

    #[test]
    fn sets_a_value_of_the_same_type() -> Result<()> {
        assert_eq!(get(&set_text("goal.epochs=3")?, "goal.epochs"), Some(&Value::Integer(3)));
        assert_eq!(get(&set_text("goal.rate = 1")?, "goal.rate"), Some(&Value::Float(1.)));
        assert_eq!(get(&set_text("goal.head=encoder")?, "goal.head"), Some(&Value::String("encoder".into())));
        assert_eq!(get(&set_text("goal.halve_at=[5]")?, "goal.halve_at"), Some(&Value::Array(vec![5.into()])));
        assert_eq!(get(&set_text("seed=7")?, "seed"), Some(&Value::Integer(7)));
        Ok(())
    }

    #[test]
    fn a_site_may_be_added() -> Result<()> {
        let table = set_text("split.sites.i-80=vehicle")?;
        assert_eq!(get(&table, "split.sites.i-80"), Some(&Value::String("vehicle".into())));
        assert_eq!(get(&table, "split.sites.us-101"), Some(&Value::String("recording".into())));
        Ok(())
    }

    #[test]
    fn an_unknown_key_names_its_neighbours() {
        let message = set_text("goal.epoch=3").unwrap_err().chain();
        assert!(message.contains("`goal.epoch`") && message.contains("`goal.epochs`"), "{message}");
        let message = set_text("epochs=3").unwrap_err().chain();
        assert!(message.contains("`goal.epochs`"), "{message}");
    }

    #[test]
    fn a_value_of_another_type_is_refused() {
        for text in ["goal.epochs=many", "goal.epochs=1.5", "goal.head=3", "goal.rate=true"] {
            let message = set_text(text).unwrap_err().chain();
            assert!(message.contains("of type"), "{message}");
        }
    }

    #[test]
    fn a_key_without_end_is_quoted_in_part() {
        let setting: Setting = format!("{}=1", "k".repeat(3000)).parse().unwrap();
        let outer = set(&mut table(), &setting).unwrap_err().to_string();
        let inner = unknown(&setting.key, &paths(&table())).to_string();
        assert!(outer.contains("--set kkk") && inner.contains("unknown key `kkk"), "{outer}: {inner}");
        assert!(outer.len() + inner.len() < 500, "{outer}: {inner}");
    }

    #[test]
    fn a_setting_needs_key_and_value() {
        for text in ["goal.epochs", "=3", "goal.epochs="] {
            assert!(text.parse::<Setting>().is_err(), "{text}");
        }
    }

    #[test]
    fn check_finds_keys_too_many_and_too_few() {
        let mut wrong = table();
        wrong.insert("goals".into(), Value::Integer(3));
        let message = check(&wrong, &table()).unwrap_err().to_string();
        assert!(message.contains("unknown key `goals`"), "{message}");
        let mut short = table();
        short.remove("seed");
        let message = check(&short, &table()).unwrap_err().to_string();
        assert!(message.contains("`seed` is missing"), "{message}");
        let mut other_sites = table();
        let split = other_sites.get_mut("split").and_then(Value::as_table_mut).unwrap();
        split.insert("sites".into(), Value::Table(Table::new()));
        assert!(check(&other_sites, &table()).is_ok());
    }

    #[test]
    fn finds_the_first_difference() {
        let mut new = table();
        assert_eq!(first_difference(&table(), &new), None);
        new.insert("seed".into(), Value::Integer(2));
        assert_eq!(first_difference(&table(), &new), Some(("seed".into(), "1".into(), "2".into())));
    }
}
