//! The project's checks, cheapest first; `.ci/run` and README call this.

pub(crate) mod aarch64;
mod dependant;
pub(crate) mod features;
pub(crate) mod supply;

use std::path::Path;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, Result, bail};

use crate::workspace::cargo;
use crate::{bench, browser, c, determinism, fuzz, load, python, tidy, torture};
use gnp::Progress as _;
use gnp::text::duration;
use gnp_cli::Terminal;

/// A cargo command with the environment it needs.
struct Step<'a> {
    name: &'a str,
    arguments: &'a [&'a str],
    environment: &'a [(&'a str, &'a str)],
}

const FORMAT: Step<'_> = Step { name: "format", arguments: &["fmt", "--all", "--", "--check"], environment: &[] };

const COMPILED: [Step<'_>; 2] = [
    Step {
        name: "clippy",
        arguments: &["clippy", "--workspace", "--all-targets", "--", "--deny", "warnings"],
        environment: &[],
    },
    Step {
        name: "doc",
        arguments: &["doc", "--workspace", "--no-deps"],
        environment: &[("RUSTDOCFLAGS", "--deny warnings")],
    },
];

/// Every crate as it would be published; compiling each from its package as well takes as long as all else.
const PACKAGE: Step<'_> = Step {
    name: "package",
    arguments: &[
        "package",
        "--workspace",
        "--exclude",
        "xtask",
        "--exclude",
        "gnp-fuzz",
        "--exclude",
        "gnp-header",
        "--no-verify",
        "--allow-dirty",
    ],
    environment: &[],
};

/// The feature `rerun`, which compiles some 250 packages more and the others once more with other features: when asked for.
const RERUN: [Step<'_>; 3] = [
    Step {
        name: "clippy with rerun",
        arguments: &[
            "clippy",
            "--package",
            "gnp-replay",
            "--package",
            "gnp-cli",
            "--features",
            "gnp-cli/rerun",
            "--all-targets",
            "--",
            "--deny",
            "warnings",
        ],
        environment: &[],
    },
    Step {
        name: "files for rerun",
        arguments: &[
            "test",
            "--package",
            "gnp-replay",
            "--package",
            "gnp-cli",
            "--features",
            "gnp-cli/rerun",
            "--test",
            "replay",
        ],
        environment: &[],
    },
    Step {
        name: "replay with rerun",
        arguments: &[
            "test",
            "--package",
            "gnp-replay",
            "--package",
            "gnp-cli",
            "--features",
            "gnp-cli/rerun",
            "--test",
            "cli",
            "replay",
        ],
        environment: &[],
    },
];

/// Last, and nothing is printed after it: the output ends with the test harness's own lines.
const TEST: Step<'_> = Step { name: "test", arguments: &["test", "--workspace"], environment: &[] };

/// Runs format, tidy, the supply chain, clippy, doc, crates alone with their features, a dependant on stable Rust, packages,
/// the tests of kernels and networks on emulated 64-bit ARM, the C library, the Python package, the page in a browser and the
/// server under load where their tools are there, the ratios of `bench --check --quick`, one run on several numbers of threads,
/// every trouble of the crash harness once, a while of each fuzzing target, with `rerun` what needs that feature, and test;
/// stops at the first that fails.
///
/// # Errors
/// Names the step that failed.
pub(crate) fn run(root: &Path, rerun: bool, terminal: &Terminal) -> Result<()> {
    step(root, terminal, &FORMAT)?;
    within(terminal, "tidy", "", || tidy::run(root))?;
    supply::run(root, terminal)?;
    COMPILED.iter().try_for_each(|one| step(root, terminal, one))?;
    features::run(root, features::Extent::Short, terminal)?;
    dependant::run(root, terminal)?;
    step(root, terminal, &PACKAGE)?;
    aarch64::short(root, terminal)?;
    within(terminal, "c", "", || c::run(root, &c::CArgs::default(), terminal))?;
    within(terminal, "python", "", || python::run(root, terminal))?;
    within(terminal, "browser", "", || browser::run(root, &browser::BrowserArgs::default(), terminal))?;
    within(terminal, "load", "--seconds 5", || load::run(load::LoadArgs { seconds: 5 }, terminal))?;
    within(terminal, "bench", "--check --quick", || bench::check(bench::Profile::Quick, terminal))?;
    within(terminal, "determinism", "--threads-only", || determinism::threads(terminal))?;
    within(terminal, "torture", "", || torture::once(terminal))?;
    // Other inputs each time; the line says how to repeat them.
    let seed = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    let options = format!("--seconds {} --jobs 2 --seed {seed}", fuzz::SECONDS_IN_CI);
    within(terminal, "fuzz", &options, || fuzz::short(seed, terminal))?;
    if rerun {
        RERUN.iter().try_for_each(|one| step(root, terminal, one))?;
    }
    step(root, terminal, &TEST)
}

/// Does in this process what `cargo xtask NAME OPTIONS` does.
fn within(terminal: &Terminal, name: &str, options: &str, check: impl FnOnce() -> Result<()>) -> Result<()> {
    let started = Instant::now();
    let line = [name, options].join(" ");
    terminal.note(&format!("ci: {name} (cargo xtask {})", line.trim_end()));
    check().with_context(|| format!("ci: {name} failed"))?;
    terminal.note(&format!("ci: {name} passed in {}", duration(started.elapsed())));
    Ok(())
}

/// Runs cargo in `folder`. Only in the workspace do its own settings reach the compiler.
fn step(folder: &Path, terminal: &Terminal, step: &Step<'_>) -> Result<()> {
    let started = Instant::now();
    let line = step.arguments.join(" ");
    terminal.note(&format!("ci: {} (cargo {line})", step.name));
    let status = cargo()
        .args(step.arguments)
        // Of the cargo that runs us; the workspace's configuration sets it again.
        .env_remove("RUSTC_BOOTSTRAP")
        .envs(step.environment.iter().copied())
        .current_dir(folder)
        .status()
        .with_context(|| format!("cannot start cargo for the step {}", step.name))?;
    if !status.success() {
        bail!("ci: {} failed ({status}); run `cargo {line}` to see it alone", step.name);
    }
    if step.name != "test" {
        terminal.note(&format!("ci: {} passed in {}", step.name, duration(started.elapsed())));
    }
    Ok(())
}
