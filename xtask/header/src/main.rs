//! Prints the C header of gnp-c, made from the source file that has everything C sees.

use std::path::Path;
use std::process::ExitCode;

use cbindgen::{Builder, Config, EnumConfig, FunctionConfig, Language, Layout, RenameRule, Style};

const HEAD: &str = "\
/* GNP: forecasts of vehicles on motorways, frame by frame. SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * Generated from crates/gnp-c/src/border.rs by `cargo xtask c --write`; change that file. */";

fn main() -> ExitCode {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/gnp-c/src/border.rs");
    let config = Config {
        language: Language::C,
        header: Some(HEAD.to_owned()),
        include_guard: Some("GNP_H".to_owned()),
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
            header.write(std::io::stdout());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: no header: {error}");
            ExitCode::FAILURE
        }
    }
}
