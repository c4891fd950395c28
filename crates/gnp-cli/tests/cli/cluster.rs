//! A table made on a local Ray cluster that loses a worker, where there is Ray.

use std::process::{Command, Stdio};

use crate::program::root;

/// `GNP_PYTHON` names a Python that has Ray, unless it is `python3`. In full: `python xtask/cluster/check.py --full`.
#[test]
fn a_cluster_that_loses_a_worker_makes_the_table_of_one_machine() {
    let python = std::env::var("GNP_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let mut asked = Command::new(&python);
    let asked = asked.args(["-c", "import ray, tomllib"]).stdout(Stdio::null()).stderr(Stdio::null());
    if !asked.status().is_ok_and(|status| status.success()) {
        eprintln!("no Ray for {python}: SKIPPED");
        return;
    }
    let check = root().join("xtask/cluster/check.py");
    let output =
        Command::new(&python).arg("-B").arg(check).args(["--gnp", env!("CARGO_BIN_EXE_gnp")]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("killed worker") && text.contains("are those of one machine"), "{text}");
}
