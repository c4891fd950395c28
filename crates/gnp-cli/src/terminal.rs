//! What the user sees: progress and logs on stderr, results on stdout.
//!
//! On a terminal progress is a bar with rate and time left; elsewhere, and where `NO_COLOR` or `TERM=dumb`
//! asks for plain text, it is a line now and then without control characters, so that a log file stays readable.
//! No line of text is longer than [`COLUMNS`](gnp::text::COLUMNS).

use std::fmt;
use std::io::{self, IsTerminal as _, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use gnp::text::fitted;
use gnp::{Progress, Work};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use tracing_subscriber::filter::LevelFilter;

use crate::program::{Program, printable};

/// Plain lines of one piece of work are at least this far apart.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Progress on a terminal or in a log file.
#[derive(Clone, Debug)]
pub struct Terminal {
    program: Program,
    bars: MultiProgress,
    quiet: bool,
    interactive: bool,
}

impl Terminal {
    /// Sets up progress and logs; call once.
    #[must_use]
    pub fn start(quiet: bool, verbose: bool, program: &Program) -> Self {
        let able = io::stderr().is_terminal() && !plain_text_wanted();
        let interactive = able && !quiet;
        let target = if interactive { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let terminal =
            Self { program: program.clone(), bars: MultiProgress::with_draw_target(target), quiet, interactive };
        let bars = terminal.bars.clone();
        // A second call (tests in one process) keeps the first subscriber.
        let _ = tracing_subscriber::fmt()
            .with_max_level(if verbose { LevelFilter::INFO } else { LevelFilter::WARN })
            .with_ansi(able)
            .with_target(false)
            .without_time()
            .with_writer(move || AboveBars(bars.clone()))
            .try_init();
        terminal
    }

    /// A line of a result that a program reads, on stdout as it is.
    pub fn for_programs(&self, text: &str) {
        self.bars.suspend(|| {
            // A closed pipe (`| head`) is no reason to fail.
            let _ = writeln!(io::stdout().lock(), "{text}");
        });
    }

    fn bar(&self, what: &str, done: u64, total: u64, unit: &'static str) -> Bar {
        let bar = self.bars.add(ProgressBar::new(total).with_position(done));
        bar.reset_eta();
        let template =
            format!("{{prefix:12}} {{bar:24.cyan/dim}} {{pos}}/{{len}} {unit}, {{rate}}, {{eta}} left {{wide_msg}}");
        let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style.with_key("rate", |state: &ProgressState, out: &mut dyn fmt::Write| {
            let _ = out.write_str(&rate(state.per_sec())); // into memory
        }));
        bar.set_prefix(what.to_owned());
        let plain = !self.interactive && !self.quiet;
        let now = Instant::now();
        Bar { bar, what: what.to_owned(), unit, plain, started: now, before: done, total, last: Mutex::new(now) }
    }
}

impl Progress for Terminal {
    /// On stdout; lines that are too long are broken between words.
    fn result(&self, text: &str) {
        self.for_programs(&fitted(self.program.named(text).trim_end_matches('\n')));
    }

    /// On stderr; nothing with `--quiet`.
    fn note(&self, text: &str) {
        if !self.quiet {
            self.bars.suspend(|| {
                let _ = writeln!(io::stderr().lock(), "{}", fitted(&self.program.named(text)));
            });
        }
    }

    fn start(&self, what: &str, done: u64, total: u64, unit: &'static str) -> Box<dyn Work> {
        Box::new(self.bar(what, done, total, unit))
    }
}

/// Progress of one piece of work.
#[derive(Debug)]
struct Bar {
    bar: ProgressBar,
    what: String,
    unit: &'static str,
    plain: bool,
    started: Instant,
    before: u64,
    total: u64,
    last: Mutex<Instant>,
}

impl Work for Bar {
    fn at(&self, done: u64, message: &str) {
        let message = &*printable(message);
        self.bar.set_message(message.to_owned());
        self.bar.set_position(done);
        if self.plain && self.due() {
            eprintln!("{}", fitted(&self.line(done, message)));
        }
    }
}

impl Bar {
    fn due(&self) -> bool {
        let Ok(mut last) = self.last.lock() else { return false };
        let due = last.elapsed() >= LINE_EVERY;
        if due {
            *last = Instant::now();
        }
        due
    }

    fn line(&self, done: u64, message: &str) -> String {
        let seconds = self.started.elapsed().as_secs_f64();
        let here = done.saturating_sub(self.before) as f64;
        let left = seconds / here * self.total.saturating_sub(done) as f64;
        let left = if left.is_finite() { format!("{left:.0} s left") } else { "time left unknown".to_owned() };
        let rate = rate(here / seconds);
        format!("{}: {done}/{} {}, {rate}, {left} {message}", self.what, self.total, self.unit).trim_end().to_owned()
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Writes log lines above the bars instead of through them.
struct AboveBars(MultiProgress);

impl Write for AboveBars {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.suspend(|| io::stderr().lock().write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().lock().flush()
    }
}

/// Whether the user asks for text without colours and bars.
fn plain_text_wanted() -> bool {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    set("NO_COLOR").is_some() || set("TERM").is_some_and(|term| term == "dumb")
}

/// Units a second, with two digits at least.
fn rate(per_second: f64) -> String {
    match per_second {
        r if !r.is_finite() => "-/s".to_owned(),
        r if r >= 10. => format!("{r:.0}/s"),
        r if r >= 1. => format!("{r:.1}/s"),
        r => format!("{r:.2}/s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_have_two_digits() {
        assert_eq!([0.034, 3.26, 1234.5, f64::NAN].map(rate), ["0.03/s", "3.3/s", "1234/s", "-/s"]);
    }

    #[test]
    fn a_plain_line_has_rate_and_time_left() {
        let terminal = Terminal {
            program: Program::default(),
            bars: MultiProgress::with_draw_target(ProgressDrawTarget::hidden()),
            quiet: false,
            interactive: false,
        };
        let work = terminal.bar("goal", 10, 110, "batches");
        std::thread::sleep(Duration::from_millis(20));
        let line = work.line(60, "loss 0.5");
        assert!(
            line.starts_with("goal: 60/110 batches, ") && line.contains("/s, ") && line.ends_with(" s left loss 0.5"),
            "{line}"
        );
    }
}
