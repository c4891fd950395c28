//! libFuzzer on one target, which the environment names; `cargo xtask fuzz --coverage` builds and starts it.

#![no_main]

use std::path::PathBuf;

use gnp_fuzz::{Scratch, Target};

thread_local! {
    /// The target and its folders; libFuzzer has one thread.
    static CHOSEN: Option<(&'static Target, Scratch)> = chosen();
}

/// As the environment says; none where it says nothing that can be used.
fn chosen() -> Option<(&'static Target, Scratch)> {
    let name = std::env::var(gnp_fuzz::TARGET_VARIABLE).ok()?;
    let folder = PathBuf::from(std::env::var_os(gnp_fuzz::FOLDER_VARIABLE)?);
    Some((Target::named(&name)?, Scratch::within(&folder).ok()?))
}

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    CHOSEN.with(|chosen| {
        let Some((target, scratch)) = chosen else {
            eprintln!(
                "{} and {} do not name a target and a folder",
                gnp_fuzz::TARGET_VARIABLE,
                gnp_fuzz::FOLDER_VARIABLE
            );
            std::process::abort();
        };
        // A panic ends the process by itself.
        if let Err(finding) = (target.run)(scratch, input) {
            eprintln!("{}: {finding}", target.name);
            std::process::abort();
        }
    });
});
