//! Made-up and damaged input for what of GNP reads files from strangers, a target for each.
//!
//! A [`Target`] takes any bytes and makes a case of them: a table, a checkpoint, a configuration. The first byte says how:
//! as it stands, or with its checksum put right around it, or as the numbers of a made-up case ([`arbitrary`]). The code
//! under test must not panic, hang or take memory without bound, and must either refuse with a message that names the file
//! and is no flood, or give a value that keeps what is promised of it.
//!
//! Two engines drive one list, [`TARGETS`]: [`run`] mutates at random, anywhere and on stable Rust; the program `coverage`
//! is libFuzzer. `cargo xtask fuzz` starts both.

mod checks;
mod engine;
mod finding;
mod made;
mod model;
mod mutate;
mod patch;
mod scratch;
mod table;
mod targets;

pub use crate::engine::{Failure, Limits, Outcome, catch_panics, execute, run};
pub use crate::finding::Finding;
pub use crate::mutate::LONGEST_INPUT;
pub use crate::scratch::Scratch;
pub use crate::targets::TARGETS;

use std::path::{Path, PathBuf};

/// Environment variable that tells the program `coverage` its target.
pub const TARGET_VARIABLE: &str = "GNP_FUZZ_TARGET";

/// Environment variable that tells it where to make files.
pub const FOLDER_VARIABLE: &str = "GNP_FUZZ_FOLDER";

/// Something that reads, and what is checked of it.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Name on the command line and of its corpus.
    pub name: &'static str,
    /// What reads what, in a line.
    pub about: &'static str,
    /// Tries one input; files are made in the scratch folders.
    pub run: fn(&Scratch, &[u8]) -> Result<(), Finding>,
    /// Inputs to begin with, made by the project's own writers and so never of an old layout.
    pub seeds: fn(&Scratch) -> Result<Vec<Vec<u8>>, Finding>,
    /// Words that mean something in these inputs.
    pub words: &'static [&'static str],
}

impl Target {
    /// The target of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        TARGETS.iter().find(|target| target.name == name)
    }

    /// Folder of its committed inputs.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(self.name)
    }

    /// Every input to begin with.
    ///
    /// # Errors
    /// When a seed cannot be made or a committed input cannot be read.
    pub fn corpus(&self, scratch: &Scratch) -> Result<Corpus, Finding> {
        let mut corpus = Corpus { seeds: (self.seeds)(scratch)?, committed: Vec::new() };
        let folder = self.folder();
        if folder.is_dir() {
            let mut files: Vec<PathBuf> =
                std::fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
            files.sort();
            corpus.committed = files.into_iter().map(std::fs::read).collect::<Result<_, _>>()?;
        }
        Ok(corpus)
    }
}

/// Inputs to begin with.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Corpus {
    /// Made by the project's own writers; most are accepted.
    pub seeds: Vec<Vec<u8>>,
    /// Committed ones by name, of which most are refused.
    pub committed: Vec<Vec<u8>>,
}

impl Corpus {
    /// All of them, the seeds first.
    pub fn iter(&self) -> impl Iterator<Item = &Vec<u8>> {
        self.seeds.iter().chain(&self.committed)
    }
}
