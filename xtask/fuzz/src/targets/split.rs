//! Splits (`split.json`) of small recordings: any text, and changed ones whose hash is put right.

use arbitrary::{Arbitrary, Unstructured};
use gnp_data::{Recording, Split, SplitConfig, SplitKind, Subset, WindowSet};
use serde_json::{Map, Value};

use crate::finding::promise;
use crate::made::{kind, road, windows};
use crate::patch::{self, Patch};
use crate::{Finding, Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "split",
    about: "split.json of small recordings, its hash put right",
    run,
    seeds,
    words: &[
        "\"vehicle\":",
        "\"segment\":0",
        "\"t0\":[",
        "\"validation\":{",
        "\"leaks\":true",
        "\"kinds\":{}",
        "\"overlaps\":[]",
    ],
};

const KINDS: [SplitKind; 4] = [SplitKind::Vehicle, SplitKind::Time, SplitKind::Window, SplitKind::Recording];

/// What is split: a recording for each part.
fn roads() -> Result<[Recording; 3], Finding> {
    Ok([road("case")?, road("second")?, road("third")?])
}

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    let recordings = roads()?;
    let (set, _) = WindowSet::cut(&recordings, &windows()).map_err(Finding::case)?;
    if matches!(kind, b'a' | b'h') {
        return load(scratch, &set, rest, kind == b'h');
    }
    let mut bytes = Unstructured::new(rest);
    let Ok((config, patches)) = bytes.arbitrary::<(Config, Vec<Patch>)>() else { return Ok(()) };
    let text = match saved(scratch, &set, &config) {
        Ok(text) => text,
        Err(error) => return checks::refusal(&error, ""),
    };
    let mut file: Value = serde_json::from_slice(&text).map_err(Finding::case)?;
    patch::apply(&mut file, &patches);
    load(scratch, &set, file.to_string().as_bytes(), true)
}

/// How the windows are parted.
#[derive(Arbitrary, Clone, Copy, Debug, Default)]
struct Config {
    kind: u8,
    seed: u8,
    folds: u8,
    fold: u8,
}

fn saved(scratch: &Scratch, set: &WindowSet<'_>, config: &Config) -> Result<Vec<u8>, gnp_data::DataError> {
    let config = SplitConfig {
        kind: KINDS[usize::from(config.kind) % KINDS.len()],
        sites: Default::default(),
        train: 0.4,
        validation: 0.3,
        test: 0.3,
        seed: config.seed.into(),
        folds: usize::from(config.folds % 3) + 1,
        fold: usize::from(config.fold % 3) + 1,
    };
    let file = scratch.made("split.json");
    Split::new(set, &config, &[])?.save(set, &file)?;
    std::fs::read(&file).map_err(|source| gnp_data::DataError::Io { file, source })
}

/// Loads a split; with `mend` under a checksum that fits, and again with the hash that the refusal says its windows have.
fn load(scratch: &Scratch, set: &WindowSet<'_>, text: &[u8], mend: bool) -> Result<(), Finding> {
    let Some(mut file) = serde_json::from_slice::<Map<String, Value>>(text).ok().filter(|_| mend) else {
        return try_text(scratch, set, text, |_| None);
    };
    file.remove("sha256");
    // What stands in the corpus is not of an old version.
    let version = saved(scratch, set, &Config::default()).map_err(Finding::case)?;
    let version: Map<String, Value> = serde_json::from_slice(&version).map_err(Finding::case)?;
    file.insert("version".to_owned(), version.get("version").cloned().unwrap_or_default());
    let sealed = |file: &Map<String, Value>| gnp_file::json_line(file).map_err(Finding::case);
    try_text(scratch, set, sealed(&file)?.as_bytes(), |message| {
        let hash = message.split(|c: char| !c.is_ascii_hexdigit()).find(|word| word.len() == 64)?;
        file.insert("hash".to_owned(), hash.into());
        sealed(&file).ok()
    })
}

/// Loads a text, and where it is refused the one that `mended` makes of it and the message.
fn try_text(
    scratch: &Scratch,
    set: &WindowSet<'_>,
    text: &[u8],
    mended: impl FnOnce(&str) -> Option<String>,
) -> Result<(), Finding> {
    let file = scratch.only("case.json", text)?;
    let first = match Split::load(set, &file) {
        Ok(split) => return sound(scratch, set, &split),
        Err(error) => error,
    };
    checks::refusal(&first, "")?;
    let Some(text) = mended(&first.to_string()) else { return Ok(()) };
    scratch.only("case.json", text.as_bytes())?;
    match Split::load(set, &file) {
        Ok(split) => sound(scratch, set, &split),
        Err(error) => checks::refusal(&error, ""),
    }
}

/// Windows of the set, each in one part, and the same again from a file.
fn sound(scratch: &Scratch, set: &WindowSet<'_>, split: &Split) -> Result<(), Finding> {
    let mut ids: Vec<_> = Subset::ALL.iter().flat_map(|part| split.subset(*part)).copied().collect();
    promise(ids.iter().all(|id| set.get(*id).is_some()), || "a split with a window that is not there".to_owned())?;
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    promise(ids.len() == count, || "a split with a window in two parts".to_owned())?;
    let file = scratch.made("again.json");
    split.save(set, &file).map_err(Finding::case)?;
    let again = Split::load(set, &file).map_err(|error| Finding::Believed(format!("cannot be loaded: {error}")))?;
    let same =
        again.hash() == split.hash() && Subset::ALL.iter().all(|part| again.subset(*part) == split.subset(*part));
    promise(same, || "a split that comes back from its file as another".to_owned())
}

/// One of each kind.
fn seeds(scratch: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let recordings = roads()?;
    let (set, _) = WindowSet::cut(&recordings, &windows()).map_err(Finding::case)?;
    let mut seeds = Vec::new();
    for (kind, first) in [(0, b"a"), (0, b"h"), (2, b"h"), (3, b"h")] {
        let config = Config { kind, seed: 1, folds: 0, fold: 0 };
        seeds.push([first, &saved(scratch, &set, &config).map_err(Finding::case)?[..]].concat());
    }
    Ok(seeds)
}
