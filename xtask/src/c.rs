//! The C library: its header is current, and programs in C that use it run clean under AddressSanitizer.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use anyhow::{Context as _, Result, bail};
use clap::Args;
use gnp::Progress as _;
use gnp_cli::Terminal;

use crate::ci::supply::installed;
use crate::workspace::{self, cargo};

/// The crate, and what it is linked as.
const CRATE: &str = "crates/gnp-c";
const LIBRARY: &str = "gnp_c";

/// Compilers, the first that is there.
const COMPILERS: [&str; 3] = ["cc", "gcc", "clang"];

/// How every C file is compiled: as strictly as a user may, and so that what is read or written wrongly, or never freed, ends
/// the program.
const FLAGS: [&str; 10] = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Werror",
    "-g",
    "-O1",
    "-fno-omit-frame-pointer",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=undefined",
];

/// What to do.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct CArgs {
    /// Write include/gnp.h anew instead of holding it against the source.
    #[arg(long)]
    pub(crate) write: bool,
    /// Build the library and put it below this folder, with the header and what CMake and pkg-config read.
    #[arg(long, value_name = "DIR", conflicts_with = "write")]
    pub(crate) install: Option<PathBuf>,
}

/// Holds the header against the source (or writes it), builds the library, and compiles and runs every C file of `examples` and
/// `tests` under the sanitizers; once more through CMake and pkg-config as a user's project would.
///
/// # Errors
/// When the header is old, or something does not compile, fails or leaks.
pub(crate) fn run(root: &Path, arguments: &CArgs, terminal: &Terminal) -> Result<()> {
    let path = root.join(CRATE).join("include/gnp.h");
    let header = header(root)?;
    if arguments.write {
        gnp_file::save(&path, header.as_bytes()).with_context(|| format!("cannot write {}", path.display()))?;
        terminal.note(&format!("c: wrote {}", path.display()));
        return Ok(());
    }
    if fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))? != header {
        bail!("c: {} is not what its source says: `cargo xtask c --write`, then commit it", path.display());
    }
    if let Some(prefix) = &arguments.install {
        install(root, &build(root)?, prefix)?;
        terminal.note(&format!("c: installed below {}", prefix.display()));
        return Ok(());
    }
    let Some(compiler) = COMPILERS.into_iter().find_map(installed) else {
        terminal.note("c: SKIPPED: there is no C compiler (cc, gcc or clang)");
        return Ok(());
    };
    let libraries = build(root)?;
    let work = tempfile::tempdir()?;
    for source in sources(root)? {
        let name = source.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let program = work.path().join(&name);
        let mut command = Command::new(&compiler);
        command.args(FLAGS).arg("-I").arg(root.join(CRATE).join("include")).arg(&source).arg("-o").arg(&program);
        command.arg("-L").arg(&libraries).arg(format!("-l{LIBRARY}")).arg("-lm").arg("-lpthread");
        checked(&mut command)?;
        checked(Command::new(&program).env("LD_LIBRARY_PATH", &libraries))?;
        terminal.note(&format!("c: {name} runs clean under AddressSanitizer"));
    }
    projects(root, &compiler, &libraries, work.path(), terminal)
}

/// The header that the source makes.
fn header(root: &Path) -> Result<String> {
    let mut command = cargo();
    command.args(["run", "--quiet", "--package", "gnp-header", "--features", "cbindgen"]).current_dir(root);
    Ok(String::from_utf8(checked(&mut command)?.stdout)?)
}

/// Builds the library; the folder in which it lies. Together with this program, so that both agree on features of what they
/// share and nothing is compiled twice.
fn build(root: &Path) -> Result<PathBuf> {
    let mut command = cargo();
    command.args(["build", "--quiet", "--package", "gnp-c", "--package", "xtask"]).current_dir(root);
    checked(&mut command)?;
    Ok(workspace::read(root)?.target_directory.join("debug"))
}

/// The C files of the crate.
fn sources(root: &Path) -> Result<Vec<PathBuf>> {
    let mut sources = Vec::new();
    for folder in ["examples", "tests"] {
        let folder = root.join(CRATE).join(folder);
        for entry in fs::read_dir(&folder).with_context(|| format!("cannot list {}", folder.display()))? {
            sources.push(entry?.path());
        }
    }
    sources.retain(|path| path.extension() == Some(OsStr::new("c")));
    sources.sort();
    Ok(sources)
}

/// The example as projects of their own find the library where it was installed: by CMake and by pkg-config, where these are.
fn projects(root: &Path, compiler: &Path, libraries: &Path, work: &Path, terminal: &Terminal) -> Result<()> {
    let prefix = work.join("installed");
    install(root, libraries, &prefix)?;
    let examples = root.join(CRATE).join("examples");
    match installed("cmake") {
        Some(cmake) => {
            let made = work.join("cmake");
            let found = format!("-DCMAKE_PREFIX_PATH={}", prefix.display());
            checked(Command::new(&cmake).arg("-S").arg(&examples).arg("-B").arg(&made).arg(found))?;
            checked(Command::new(&cmake).arg("--build").arg(&made))?;
            checked(&mut Command::new(made.join("stream")))?;
            terminal.note("c: a CMake project finds the library and runs");
        }
        None => terminal.note("c: CMake SKIPPED: there is no cmake"),
    }
    match installed("pkg-config") {
        Some(pkg_config) => {
            let mut asked = Command::new(pkg_config);
            asked.args(["--cflags", "--libs", "gnp"]).env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"));
            let flags = String::from_utf8(checked(&mut asked)?.stdout)?;
            let program = work.join("by-pkg-config");
            let mut command = Command::new(compiler);
            command.arg(examples.join("stream.c")).args(flags.split_whitespace()).arg("-lm").arg("-o").arg(&program);
            checked(&mut command)?;
            checked(Command::new(&program).env("LD_LIBRARY_PATH", prefix.join("lib")))?;
            terminal.note("c: pkg-config finds the library and it runs");
        }
        None => terminal.note("c: pkg-config SKIPPED: there is no pkg-config"),
    }
    Ok(())
}

/// Puts header, library and what CMake and pkg-config read below `prefix`.
fn install(root: &Path, libraries: &Path, prefix: &Path) -> Result<()> {
    let source = root.join(CRATE);
    let file = format!("{DLL_PREFIX}{LIBRARY}{DLL_SUFFIX}");
    let plain =
        [(source.join("include/gnp.h"), "include/gnp.h".to_owned()), (libraries.join(&file), format!("lib/{file}"))];
    for (from, to) in plain {
        let to = beneath(prefix, &to)?;
        fs::copy(&from, &to).with_context(|| format!("cannot copy {} to {}", from.display(), to.display()))?;
    }
    for (from, to) in [
        ("gnp.pc.in", "lib/pkgconfig/gnp.pc"),
        ("gnp-config.cmake.in", "lib/cmake/gnp/gnp-config.cmake"),
        ("gnp-config-version.cmake.in", "lib/cmake/gnp/gnp-config-version.cmake"),
    ] {
        let from = source.join("packaging").join(from);
        let text = fs::read_to_string(&from).with_context(|| format!("cannot read {}", from.display()))?;
        let text = text.replace("@VERSION@", env!("CARGO_PKG_VERSION")).replace("@LIBRARY@", &file);
        let to = beneath(prefix, to)?;
        gnp_file::save(&to, text.as_bytes()).with_context(|| format!("cannot write {}", to.display()))?;
    }
    Ok(())
}

/// A file below `prefix`, in a folder that is there.
fn beneath(prefix: &Path, file: &str) -> Result<PathBuf> {
    let path = prefix.join(file);
    let folder = path.parent().unwrap_or(prefix);
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    Ok(path)
}

/// Runs it to its end, which must be a good one.
fn checked(command: &mut Command) -> Result<Output> {
    let output = command.stdin(Stdio::null()).output().with_context(|| format!("cannot start {command:?}"))?;
    if !output.status.success() {
        let said = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).trim().to_owned());
        bail!("c: {command:?} failed ({}):\n{}\n{}", output.status, said[0], said[1]);
    }
    Ok(output)
}
