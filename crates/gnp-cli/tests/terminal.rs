//! The program as others run it: into files and pipes, told to be quiet, without colours.

#![allow(clippy::unwrap_used)] // helpers of tests

use std::fs;
use std::path::Path;
use std::process::Command;

/// Widest line of a result or a note.
const COLUMNS: usize = 80;

/// What a command prints: stdout and stderr. Fails where it fails, prints control characters or lines that are too
/// long.
fn printed(arguments: &[&str], environment: &[(&str, &str)]) -> (String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_gnp")).args(arguments).envs(environment.iter().copied()).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert!(output.status.success(), "{arguments:?}: {err}");
    for line in out.split('\n').chain(err.split('\n')) {
        let control = line.chars().find(|c| c.is_control());
        assert_eq!(control, None, "{arguments:?}: {line:?}");
        // Where a file lies is said in one piece.
        let words =
            line.split(' ').filter(|word| !word.contains('/')).map(|word| word.chars().count() + 1).sum::<usize>();
        assert!(
            line.chars().count() <= COLUMNS || words < COLUMNS / 2,
            "{arguments:?}: {} columns: {line}",
            line.chars().count()
        );
    }
    (out, err)
}

fn shown(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn output_is_plain_and_fits_where_nobody_looks() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let smoke = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke.toml");
    let arguments = ["pipeline", "--config", smoke, "--out", shown(&run), "--tables"];
    let (out, err) = printed(&arguments, &[("TERM", "xterm-256color")]);
    assert!(out.contains("constant velocity") && err.contains("goal: epoch 2/2"), "{err}");
    assert!(out.contains("protocol literature") && out.contains("protocol clean"), "{out}");
    let (out, _) = printed(&["explain", "--run", shown(&run)], &[("NO_COLOR", "1")]);
    assert!(out.contains("sum of the causes"), "{out}");

    // Figures are there in both forms, and every one is told of.
    let (out, _) = printed(&["figures", "--run", shown(&run)], &[("NO_COLOR", "1")]);
    let mut names: Vec<String> =
        fs::read_dir(run.join("figures")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let svg: Vec<&str> = names.iter().filter_map(|name| name.strip_suffix(".svg")).collect();
    let png: Vec<&str> = names.iter().filter_map(|name| name.strip_suffix(".png")).collect();
    assert_eq!(svg, png);
    assert!(svg.len() >= 7 && svg.iter().all(|name| out.contains(&format!("{name}: "))), "{svg:?}");

    let (out, err) = printed(&["report", "--run", shown(&run), "--quiet"], &[]);
    assert!(out.starts_with("report: ") && err.is_empty(), "{err}");
    assert!(run.join("report.html").exists());
}

#[test]
fn quiet_leaves_the_results() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let arguments = ["ingest", "--dataset", "highd", "--out", shown(&run), "--quiet"];
    let (out, err) = printed(&arguments, &[("NO_COLOR", "1")]);
    assert!(out.contains("recording") && out.contains("windows"), "{out}");
    assert_eq!(err, "");
}

#[test]
fn descriptions_fit() {
    for dataset in ["ngsim", "highd"] {
        let (out, _) = printed(&["ingest", "--dataset", dataset, "--describe"], &[("TERM", "dumb")]);
        assert!(out.contains("Columns read") || out.contains("columns"), "{out}");
    }
}
