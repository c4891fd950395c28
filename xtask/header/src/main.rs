//! Prints the C header of gnp-c, made from the source file that has everything C sees.

use std::path::Path;
use std::process::ExitCode;

use cbindgen::{Builder, Config, EnumConfig, FunctionConfig, Language, Layout, RenameRule, Style};

const HEAD: &str = "\
/* GNP: forecasts of vehicles on motorways, frame by frame. SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * A model is loaded once; from it, streams are made, one for each carriageway. Each frame of tracks is pushed into its stream,
 * which answers with the forecasts of all vehicles in flat arrays. Lengths are in m, times in s. Functions that can fail return
 * a GnpStatus.
 *
 * Threads: a model may be used by any number of threads at a time; a stream, and the arrays of its last result, by one thread
 * at a time, which need not always be the same one. gnp_last_error is of the thread that calls it. A call computes on the
 * thread that makes it.
 *
 * Generated from crates/gnp-c/src/border.rs by `cargo xtask c --write`; change that file. */";

fn main() -> ExitCode {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/gnp-c/src/border.rs");
    let config = Config {
        language: Language::C,
        header: Some(HEAD.to_owned()),
        include_guard: Some("GNP_H".to_owned()),
        no_includes: true,
        sys_includes: ["stddef.h", "stdint.h"].map(str::to_owned).to_vec(),
        cpp_compat: true,
        documentation: true,
        style: Style::Both,
        usize_is_size_t: true,
        line_length: 120,
        tab_width: 4,
        enumeration: EnumConfig { rename_variants: RenameRule::QualifiedScreamingSnakeCase, ..EnumConfig::default() },
        function: FunctionConfig { args: Layout::Auto, ..FunctionConfig::default() },
        ..Config::default()
    };
    match Builder::new().with_config(config).with_src(source).generate() {
        Ok(header) => {
            let mut bytes = Vec::new();
            header.write(&mut bytes);
            // The heading that Rust has for what the caller must see to.
            print!("{}", String::from_utf8_lossy(&bytes).replace(" * # Safety\n", " * The caller sees to it that:\n"));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: no header: {error}");
            ExitCode::FAILURE
        }
    }
}
