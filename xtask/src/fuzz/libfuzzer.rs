//! libFuzzer: the program that has it, built with counters in the workspace's own crates alone, and what it says.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};

use anyhow::{Context as _, Result, bail};
use gnp::Progress as _;
use gnp_cli::Terminal;
use gnp_fuzz::{FOLDER_VARIABLE, LONGEST_INPUT, Scratch, TARGET_VARIABLE, Target};

use super::{Found, Job, KEPT, LONGEST_S, MOST_MB, Report, SECONDS};
use crate::cli::FuzzArgs;
use crate::project;
use crate::workspace::{self, cargo};

/// Name of the program, and of the feature of gnp-fuzz that it needs.
const PROGRAM: &str = "coverage";

/// What libFuzzer wrote, in the folder of a job.
const LOG: &str = "log";

/// Last lines of it that are shown of a failure.
const LINES: usize = 12;

/// Builds the program. Who depends on whom stays as in any other build: xtask is chosen too, so that features agree.
///
/// # Errors
/// When cargo fails.
pub(super) fn build(terminal: &Terminal) -> Result<PathBuf> {
    let root = project::root();
    terminal.note("fuzz: building the crates of the workspace with counters");
    let status = cargo()
        .args(["build", "--package", "xtask", "--package", "gnp-fuzz", "--bin", PROGRAM])
        .args(["--features", &format!("gnp-fuzz/{PROGRAM}")])
        .env("RUSTC_WORKSPACE_WRAPPER", root.join("xtask/fuzz/instrument"))
        .env_remove("RUSTC_BOOTSTRAP")
        .current_dir(&root)
        .status()
        .context("cannot start cargo")?;
    if !status.success() {
        bail!("the program for libFuzzer was not built ({status}); without --coverage none is needed");
    }
    Ok(workspace::read(&root)?.target_directory.join("debug").join(PROGRAM))
}

/// The program on a target; its corpus begins with the seeds.
///
/// # Errors
/// When the folder of the corpus cannot be filled.
pub(super) fn command(program: &Path, target: &Target, folder: &Path, args: &FuzzArgs) -> Result<Command> {
    let kept = project::root().join(KEPT);
    let corpus = kept.join("corpus").join(target.name);
    std::fs::create_dir_all(&corpus)?;
    for (number, seed) in (target.seeds)(&Scratch::within(folder)?)?.into_iter().enumerate() {
        std::fs::write(corpus.join(format!("seed-{number}")), seed)?;
    }
    let words: String = target.words.iter().map(|word| format!("\"{}\"\n", escaped(word))).collect();
    let dictionary = folder.join("words");
    std::fs::write(&dictionary, words)?;
    let mut command = Command::new(program);
    command.arg(&corpus);
    if target.folder().is_dir() {
        command.arg(target.folder());
    }
    match args.executions {
        Some(executions) => command.arg(format!("-runs={executions}")),
        None => command.arg(format!("-max_total_time={}", args.seconds.unwrap_or(SECONDS))),
    };
    command
        .arg(format!("-seed={}", args.seed + 1)) // 0 would be drawn anew
        .arg(format!("-max_len={LONGEST_INPUT}"))
        .arg(format!("-timeout={LONGEST_S}"))
        .arg(format!("-rss_limit_mb={MOST_MB}"))
        .arg(format!("-dict={}", dictionary.display()))
        .arg(format!("-artifact_prefix={}/", folder.display()))
        .args(["-print_final_stats=1", "-reload=0", "-use_value_profile=1"])
        .env(TARGET_VARIABLE, target.name)
        .env(FOLDER_VARIABLE, folder)
        .stderr(File::create(folder.join(LOG))?);
    Ok(command)
}

/// A word as libFuzzer's dictionaries have it.
fn escaped(word: &str) -> String {
    let byte = |byte: u8| match byte {
        b'"' | b'\\' => format!("\\{}", char::from(byte)),
        b' '..=b'~' => char::from(byte).to_string(),
        _ => format!("\\x{byte:02X}"),
    };
    word.bytes().map(byte).collect()
}

fn log(job: &Job) -> String {
    std::fs::read(job.folder.path().join(LOG))
        .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
        .unwrap_or_default()
}

/// Executions as libFuzzer last said: `#123 NEW ...`.
pub(super) fn executions(job: &Job) -> u64 {
    counted(&log(job))
}

fn counted(log: &str) -> u64 {
    let number = |line: &str| line.strip_prefix('#')?.split_whitespace().next()?.parse().ok();
    log.lines().rev().find_map(number).unwrap_or(0)
}

/// What an ended process has left.
///
/// # Errors
/// When it left an input that cannot be read.
pub(super) fn report(job: &Job, status: ExitStatus) -> Result<Report> {
    let log = log(job);
    let total = |line: &str| line.strip_prefix("stat::number_of_executed_units:")?.trim().parse().ok();
    let executions = log.lines().find_map(total).unwrap_or_else(|| counted(&log));
    if status.success() {
        return Ok(Report { executions, failures: Vec::new() });
    }
    let lines: Vec<&str> = log.lines().collect();
    let what = lines[lines.len().saturating_sub(LINES)..].join("\n");
    let kept = ["crash-", "timeout-", "oom-", "leak-", "slow-unit-"];
    let mut input = None;
    for entry in std::fs::read_dir(job.folder.path())? {
        let path = entry?.path();
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        if kept.iter().any(|prefix| name.starts_with(prefix)) {
            input = Some(std::fs::read(path)?);
        }
    }
    Ok(Report { executions, failures: vec![Found { what, input }] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_libfuzzer_says_is_understood() {
        let log = "INFO: Seed: 1\n#2\tINITED cov: 4\n#512\tpulse  cov: 20 ft: 3\nlast words\n";
        assert_eq!(counted(log), 512);
        assert_eq!(counted(""), 0);
        assert_eq!(escaped("a\"b\\\u{feff}\n"), "a\\\"b\\\\\\xEF\\xBB\\xBF\\x0A");
    }
}
