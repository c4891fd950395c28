//! What the user sees: progress and logs on stderr, results on stdout.
//!
//! On a terminal progress is a bar with rate and time left; elsewhere it is a plain line now and
//! then, so that a log file stays readable.

use std::fmt;
use std::io::{self, IsTerminal as _, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use tracing_subscriber::filter::LevelFilter;

/// Widest line of a result.
pub(crate) const COLUMNS: usize = 100;
/// Plain lines of one piece of work are at least this far apart.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Where progress goes.
#[derive(Clone, Debug)]
pub(crate) struct Terminal {
    bars: MultiProgress,
    quiet: bool,
    interactive: bool,
}

impl Terminal {
    /// Sets up progress and logs; call once. Colours are left out when `NO_COLOR` is set.
    pub(crate) fn start(quiet: bool, verbose: bool) -> Self {
        let interactive = io::stderr().is_terminal() && !quiet;
        let target = if interactive { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let terminal = Self { bars: MultiProgress::with_draw_target(target), quiet, interactive };
        let coloured = io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        let bars = terminal.bars.clone();
        // A second call (tests in one process) keeps the first subscriber.
        let _ = tracing_subscriber::fmt()
            .with_max_level(if verbose { LevelFilter::INFO } else { LevelFilter::WARN })
            .with_ansi(coloured)
            .with_target(false)
            .without_time()
            .with_writer(move || AboveBars(bars.clone()))
            .try_init();
        terminal
    }

    /// A line of a result, on stdout.
    pub(crate) fn result(&self, text: &str) {
        self.bars.suspend(|| {
            // A closed pipe (`| head`) is no reason to fail.
            let _ = writeln!(io::stdout().lock(), "{}", text.trim_end_matches('\n'));
        });
    }

    /// A line about what is going on, on stderr; nothing with `--quiet`.
    pub(crate) fn note(&self, text: &str) {
        if !self.quiet {
            self.bars.suspend(|| {
                let _ = writeln!(io::stderr().lock(), "{text}");
            });
        }
    }

    /// Starts showing a piece of work of `total` units.
    pub(crate) fn work(&self, what: &str, total: u64, unit: &'static str) -> Work {
        self.resumed_work(what, 0, total, unit)
    }

    /// Starts showing a piece of work of `total` units, `done` of which were done earlier.
    pub(crate) fn resumed_work(&self, what: &str, done: u64, total: u64, unit: &'static str) -> Work {
        let bar = self.bars.add(ProgressBar::new(total).with_position(done));
        bar.reset_eta();
        let colour = if std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()) { ".cyan/dim" } else { "" };
        let template =
            format!("{{prefix:12}} {{bar:30{colour}}} {{pos}}/{{len}} {unit}, {{rate}}, {{eta}} left {{msg}}");
        let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style.with_key("rate", |state: &ProgressState, out: &mut dyn fmt::Write| {
            let _ = write!(out, "{:.0}/s", state.per_sec()); // into memory
        }));
        bar.set_prefix(what.to_owned());
        let plain = !self.interactive && !self.quiet;
        let now = Instant::now();
        Work { bar, what: what.to_owned(), unit, plain, started: now, before: done, total, last: Mutex::new(now) }
    }
}

/// Progress of one piece of work.
#[derive(Debug)]
pub(crate) struct Work {
    bar: ProgressBar,
    what: String,
    unit: &'static str,
    plain: bool,
    started: Instant,
    before: u64,
    total: u64,
    last: Mutex<Instant>,
}

impl Work {
    /// `done` units are done; `message` says how it goes (a loss, a file).
    pub(crate) fn at(&self, done: u64, message: &str) {
        self.bar.set_message(message.to_owned());
        self.bar.set_position(done);
        if self.plain && self.due() {
            eprintln!("{}", self.line(done, message));
        }
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

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
        format!("{}: {done}/{} {}, {left} {message}", self.what, self.total, self.unit).trim_end().to_owned()
    }
}

impl Drop for Work {
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

/// Text broken between words into lines of at most [`COLUMNS`]; all but the first are indented.
pub(crate) fn wrapped(text: &str) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let Some(line) = lines.last_mut() else { break };
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= COLUMNS {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(format!("  {word}"));
        }
    }
    lines.join("\n")
}

/// A duration as `1 h 02 min`, `3 min 04 s` or `5.6 s`.
pub(crate) fn duration(time: Duration) -> String {
    let seconds = time.as_secs();
    match seconds {
        0..60 => format!("{:.1} s", time.as_secs_f64()),
        60..3600 => format!("{} min {:02} s", seconds / 60, seconds % 60),
        _ => format!("{} h {:02} min", seconds / 3600, seconds / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_broken_between_words() {
        let text = "word ".repeat(50);
        let broken = wrapped(&text);
        assert!(broken.lines().count() == 3 && broken.lines().all(|line| line.chars().count() <= COLUMNS), "{broken}");
        assert_eq!(broken.split_whitespace().count(), 50);
        assert_eq!(wrapped("a  b"), "a b");
    }

    #[test]
    fn durations_read_well() {
        for (millis, text) in [(5_600, "5.6 s"), (184_000, "3 min 04 s"), (3_720_000, "1 h 02 min")] {
            assert_eq!(duration(Duration::from_millis(millis)), text);
        }
    }
}
