//! What the program is called: `gnp`, or `cargo xtask` in the project's own folder.

use std::borrow::Cow;
use std::path::PathBuf;

/// The one place that knows the program's name. Messages and help texts are written with `gnp`.
#[derive(Clone, Debug)]
pub struct Program {
    name: &'static str,
    package: &'static str,
    /// Folder that runs go to unless the command line says otherwise.
    runs: PathBuf,
}

impl Default for Program {
    /// The program `gnp`, whose runs go to `runs` in the current folder.
    fn default() -> Self {
        Self::new("gnp", "gnp-cli", "runs")
    }
}

impl Program {
    /// A program that is called by `name`, built from the cargo package `package`, whose runs go to `runs`.
    #[must_use]
    pub fn new(name: &'static str, package: &'static str, runs: impl Into<PathBuf>) -> Self {
        Self { name, package, runs: runs.into() }
    }

    /// Its name, as typed.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Where a run of that name goes.
    pub(crate) fn run_folder(&self, name: &str) -> PathBuf {
        self.runs.join(name)
    }

    /// The command that starts it built with a feature.
    pub(crate) fn with_feature(&self, feature: &str) -> String {
        format!("cargo run --package {} --features {feature} --", self.package)
    }

    /// A message with the commands in it, which stand in backticks, under the program's name; the model `gnp` keeps its own.
    /// As [`printable`].
    pub(crate) fn named(&self, text: &str) -> String {
        printable(text).replace("`gnp ", &format!("`{} ", self.name))
    }

    /// A help text under the program's name: its examples begin a line.
    fn named_help(&self, text: &str) -> String {
        let text = self.named(text);
        let line = |line: &str| match line.trim_start().strip_prefix("gnp ") {
            Some(rest) => format!("{}{} {rest}", &line[..line.len() - line.trim_start().len()], self.name),
            None => line.to_owned(),
        };
        text.split('\n').map(line).collect::<Vec<_>>().join("\n")
    }

    /// A command line under the program's name.
    #[must_use]
    pub fn commands(&self, command: clap::Command) -> clap::Command {
        self.texts(command.name(self.name).bin_name(self.name))
    }

    fn texts(&self, mut command: clap::Command) -> clap::Command {
        if let Some(text) = command.get_after_help().map(ToString::to_string) {
            command = command.after_help(self.named_help(&text));
        }
        let named = |arg: clap::Arg| match arg.get_help().map(ToString::to_string) {
            Some(text) => arg.help(self.named(&text)),
            None => arg,
        };
        command.mut_args(named).mut_subcommands(|inner| self.texts(inner))
    }
}

/// A text without control characters other than line breaks and tabs. Names of files and cells of tables stand in messages,
/// and a terminal would take `ESC` in them for an order.
pub(crate) fn printable(text: &str) -> Cow<'_, str> {
    let harmful = |c: char| c.is_control() && c != '\n' && c != '\t';
    if !text.contains(harmful) {
        return text.into();
    }
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        if harmful(c) { shown.extend(c.escape_default()) } else { shown.push(c) }
    }
    shown.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_take_the_name_of_the_program() {
        let text = "run `gnp train --run a` first\n  gnp ingest --out a\nthe gnp model stays";
        assert_eq!(Program::default().named_help(text), text);
        let xtask = Program::new("cargo xtask", "xtask", "runs");
        let help = "run `cargo xtask train --run a` first\n  cargo xtask ingest --out a\nthe gnp model stays";
        assert_eq!(xtask.named_help(text), help);
        // A row of a table begins with the name of the model, which once became that of the program.
        let row = "gnp     0.31   0.78\nrun `gnp train --run a`";
        assert_eq!(xtask.named(row), "gnp     0.31   0.78\nrun `cargo xtask train --run a`");
    }

    #[test]
    fn what_a_file_is_called_gives_the_terminal_no_orders() {
        let name = "a\u{1b}]0;title\u{7}\r\u{9b}2J.csv";
        let shown = Program::default().named(&format!("no rows in {name}\n\tor é"));
        assert_eq!(shown, "no rows in a\\u{1b}]0;title\\u{7}\\r\\u{9b}2J.csv\n\tor é");
    }
}
