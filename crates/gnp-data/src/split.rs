//! Training, validation and test parts: seeded, checked, and named by a hash.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::error::DataError;
use crate::overlap::{Drivers, Overlap, groups};
use crate::window::WindowId;
use crate::windows::WindowSet;

mod assign;
mod check;
mod saved;

use assign::Dealing;

/// What is kept in one part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SplitKind {
    /// Whole recordings: nothing of the traffic seen in training comes again. Recordings that show
    /// the same vehicles stay together, and a driver who is in others, too, is left out there.
    Recording,
    /// Whole vehicles, within each recording: the convention of the NGSIM literature. A vehicle of
    /// the test part may be a neighbour in training. A driver of several recordings is one vehicle.
    Vehicle,
    /// The first stretch of each recording trains, the next validates, the last tests. Windows that
    /// reach from one stretch into the next are dropped and counted.
    Time,
    /// Single windows. It **leaks**: windows a stride apart land on both sides. Published code does
    /// this; it is here to reproduce that.
    Window,
}

impl SplitKind {
    /// Name in files, tables and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Vehicle => "vehicle",
            Self::Time => "time",
            Self::Window => "window",
        }
    }
}

/// A part of a split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Subset {
    /// What is learned from, and the only source of statistics.
    Train,
    /// What decides when training stops.
    Validation,
    /// What is scored.
    Test,
}

impl Subset {
    /// All parts, in order.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];

    /// Name in files, tables and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }
}

/// How windows are parted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitConfig {
    /// What is kept in one part, at sites that `sites` does not name.
    pub kind: SplitKind,
    /// The same for single sites, such as `us-101`.
    pub sites: BTreeMap<String, SplitKind>,
    /// Share of the training part; the three shares sum to 1.
    pub train: f64,
    /// Share of the validation part.
    pub validation: f64,
    /// Share of the test part; 0 leaves nothing to test, for a model that is trained on all there is.
    pub test: f64,
    /// Seed of every draw.
    pub seed: u64,
    /// Number of folds of a cross-validation; 1 parts the windows once, by the shares. With more,
    /// what is kept in one part is dealt into so many folds of like size, of which one is the test
    /// part; training and validation divide the others in the proportion of their shares. Over all
    /// folds each window that is in a part is tested once.
    pub folds: usize,
    /// Which fold is the test part, from 1.
    pub fold: usize,
}

impl SplitConfig {
    /// Every number: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 6] = [
        ("train", 1e-6, 1. - 1e-6, "of the windows"),
        ("validation", 1e-6, 1. - 1e-6, "of the windows"),
        ("test", 0., 1. - 1e-6, "of the windows (0: nothing is tested)"),
        ("folds", 1., 1000., "folds (1: a single split)"),
        ("fold", 1., 1000., ""),
        // The largest number of TOML.
        ("seed", 0., i64::MAX as f64, ""),
    ];

    /// Checks shares and folds.
    ///
    /// # Errors
    /// When a share of training or validation is not above 0, or the three do not sum to 1; when the fold is not one of the
    /// folds, there are several and nothing is to be tested, or several of a kind that cannot be dealt into folds (`time`).
    pub fn check(&self) -> Result<(), DataError> {
        let values = [self.train, self.validation, self.test, self.folds as f64];
        for ((key, least, most, unit), value) in Self::RANGES.into_iter().zip(values) {
            if !(least..=most).contains(&value) {
                let problem = format!("give a number from {least} to {most} {unit}");
                return Err(DataError::BadValue { key, value: value.to_string(), problem });
            }
        }
        let sum = self.train + self.validation + self.test;
        if (sum - 1.).abs() > 1e-6 {
            let problem = format!("train, validation and test sum to {sum}; make them sum to 1");
            return Err(DataError::BadValue { key: "train", value: self.train.to_string(), problem });
        }
        if !(1..=self.folds).contains(&self.fold) {
            let problem = format!("is none of the {} folds, which are counted from 1", self.folds);
            return Err(DataError::BadValue { key: "fold", value: self.fold.to_string(), problem });
        }
        if self.folds > 1 && self.test == 0. {
            let problem = "is 0, but each fold is tested; give a share, or split.folds = 1".to_owned();
            return Err(DataError::BadValue { key: "test", value: self.test.to_string(), problem });
        }
        let mut kinds = self.sites.values().chain([&self.kind]);
        if self.folds > 1 && kinds.any(|kind| *kind == SplitKind::Time) {
            let problem = "cannot be with a split by time; give 1, or another kind of split".to_owned();
            return Err(DataError::BadValue { key: "folds", value: self.folds.to_string(), problem });
        }
        Ok(())
    }

    /// Kind at a site.
    fn kind_at(&self, site: &str) -> SplitKind {
        self.sites.get(site).copied().unwrap_or(self.kind)
    }

    /// How things are dealt out.
    fn dealing(&self) -> Dealing {
        if self.folds <= 1 {
            return Dealing { shares: [self.train, self.validation, self.test], folds: 1, fold: 0 };
        }
        let test = 1. / self.folds as f64;
        let scale = (1. - test) / (self.train + self.validation);
        let shares = [self.train * scale, self.validation * scale, test];
        Dealing { shares, folds: self.folds, fold: self.fold - 1 }
    }
}

/// The three parts of a [`WindowSet`].
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    /// Ids by part, each sorted.
    parts: [Vec<WindowId>; 3],
    kinds: BTreeMap<String, SplitKind>,
    seed: u64,
    dropped_at_boundary: BTreeMap<String, usize>,
    dropped_drivers: BTreeMap<String, usize>,
    overlaps: Vec<Overlap>,
    hash: String,
}

/// What a split is besides its parts.
#[derive(Default)]
struct Origin {
    kinds: BTreeMap<String, SplitKind>,
    seed: u64,
    dropped_at_boundary: BTreeMap<String, usize>,
    dropped_drivers: BTreeMap<String, usize>,
    overlaps: Vec<Overlap>,
}

impl Split {
    /// Parts the windows of `set`. The same windows, configuration and seed give the same split,
    /// whatever the order of the recordings.
    ///
    /// Recordings of all sites with the same kind are parted together, so that each part comes near
    /// its share of their vehicles (kind `recording`; `vehicle`, in each recording),
    /// frames (`time`, in each recording) or windows (`window`). `overlaps` are what
    /// [`overlaps`](crate::overlaps) found in the recordings. By `recording` those that overlap stay
    /// together; parted by time they do not, and the split [leaks](Split::leaks).
    ///
    /// No driver ([`Drivers`]) is in two parts by `recording` and `vehicle`, nor tested in two folds. By `recording` a driver
    /// of recordings that do not stay together keeps the windows where it has most of them (of several places the first by
    /// name); the others are in no part and [counted](Split::dropped_drivers). By `vehicle` drivers are drawn, in the
    /// recording where they have most windows, and their windows elsewhere go with them.
    ///
    /// # Errors
    /// When the configuration is wrong, a part of one kind is left without windows, or the result
    /// does not pass [`Split::check`].
    pub fn new(set: &WindowSet<'_>, config: &SplitConfig, overlaps: &[Overlap]) -> Result<Self, DataError> {
        config.check()?;
        let mut kinds = BTreeMap::new();
        for recording in set.recordings() {
            let site = &recording.meta().site;
            kinds.insert(site.clone(), config.kind_at(site));
        }
        for site in config.sites.keys().filter(|site| !kinds.contains_key(*site)) {
            tracing::warn!("the split names site {site}, of which there is no recording");
        }
        let groups = groups(set.recordings(), overlaps);
        let drivers = Drivers::of(set.recordings(), overlaps);
        let mut parts = <[Vec<WindowId>; 3]>::default();
        let (mut dropped_at_boundary, mut dropped_drivers) = (BTreeMap::new(), BTreeMap::new());
        for kind in BTreeSet::from_iter(kinds.values().copied()) {
            let ids = set.ids().iter().copied().filter(|id| kind_of(set, *id, &kinds) == Some(kind)).collect();
            let assigned = assign::assign(set, ids, kind, &groups, &drivers, config.dealing(), config.seed);
            dropped_at_boundary.extend(assigned.dropped_at_boundary);
            dropped_drivers.extend(assigned.dropped_drivers);
            for (part, ids) in Subset::ALL.into_iter().zip(assigned.parts) {
                if ids.is_empty() && !(part == Subset::Test && config.test == 0.) {
                    let sites = kinds.iter().filter(|(_, k)| **k == kind).map(|(site, _)| site.clone()).collect();
                    return Err(DataError::EmptyPart {
                        part: part.name(),
                        kind: kind.name(),
                        sites,
                        instead: if kind == SplitKind::Recording { "vehicle" } else { "recording" },
                    });
                }
                parts[part as usize].extend(ids);
            }
        }
        for ids in &mut parts {
            ids.sort_unstable();
        }
        let (seed, overlaps) = (config.seed, overlaps.to_vec());
        let origin = Origin { kinds, seed, dropped_at_boundary, dropped_drivers, overlaps };
        let split = Self::with_hash(set, parts, origin);
        split.check(set)?;
        Ok(split)
    }

    /// Every window in the test part: for scoring a finished run on other recordings.
    #[must_use]
    pub fn all_test(set: &WindowSet<'_>) -> Self {
        let mut ids = set.ids().to_vec();
        ids.sort_unstable();
        Self::with_hash(set, [Vec::new(), Vec::new(), ids], Origin::default())
    }

    fn with_hash(set: &WindowSet<'_>, parts: [Vec<WindowId>; 3], origin: Origin) -> Self {
        let hash = saved::hash(set, &parts);
        let Origin { kinds, seed, dropped_at_boundary, dropped_drivers, overlaps } = origin;
        Self { parts, kinds, seed, dropped_at_boundary, dropped_drivers, overlaps, hash }
    }

    /// Windows of a part, by recording, track and row.
    #[must_use]
    pub fn subset(&self, part: Subset) -> &[WindowId] {
        &self.parts[part as usize]
    }

    /// Windows to learn from.
    #[must_use]
    pub fn train(&self) -> &[WindowId] {
        self.subset(Subset::Train)
    }

    /// Windows that decide when training stops.
    #[must_use]
    pub fn validation(&self) -> &[WindowId] {
        self.subset(Subset::Validation)
    }

    /// Windows that are scored.
    #[must_use]
    pub fn test(&self) -> &[WindowId] {
        self.subset(Subset::Test)
    }

    /// Kind by site; empty where every window is a test window.
    #[must_use]
    pub fn kinds(&self) -> &BTreeMap<String, SplitKind> {
        &self.kinds
    }

    /// Seed it was drawn with.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Windows in no part, by recording: those that reach from one stretch of time into the next.
    #[must_use]
    pub fn dropped_at_boundary(&self) -> &BTreeMap<String, usize> {
        &self.dropped_at_boundary
    }

    /// Windows in no part, whichever fold is tested, by recording: those of drivers who are kept with other recordings.
    #[must_use]
    pub fn dropped_drivers(&self) -> &BTreeMap<String, usize> {
        &self.dropped_drivers
    }

    /// SHA-256, in hex, of a text that lists the windows' shape and every part's windows by name.
    #[must_use]
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// Recordings that show the same vehicles, as known when the split was made.
    #[must_use]
    pub fn overlaps(&self) -> &[Overlap] {
        &self.overlaps
    }

    /// Whether the test part may be known from training: windows a stride apart stand in different
    /// parts (kind `window`), or recordings that show the same vehicles are parted by time. By `recording` they stay
    /// together, by `vehicle` their drivers do. To be said wherever a number from the split appears.
    #[must_use]
    pub fn leaks(&self) -> bool {
        let whole = [SplitKind::Recording, SplitKind::Vehicle];
        let apart = |overlap: &Overlap| self.kinds.get(&overlap.site).is_none_or(|kind| !whole.contains(kind));
        self.kinds.values().any(|kind| *kind == SplitKind::Window) || self.overlaps.iter().any(apart)
    }
}

fn kind_of(set: &WindowSet<'_>, id: WindowId, kinds: &BTreeMap<String, SplitKind>) -> Option<SplitKind> {
    kinds.get(&set.recording(id)?.meta().site).copied()
}

/// Frame numbers of the first observed and the last predicted frame.
fn frames_of(set: &WindowSet<'_>, id: WindowId) -> Option<(u32, u32)> {
    let observation = set.get(id)?.observation();
    let shape = observation.shape();
    let t0 = observation.frame();
    Some((t0 - ((shape.t_obs - 1) * shape.step) as u32, t0 + (shape.t_pred * shape.step) as u32))
}
