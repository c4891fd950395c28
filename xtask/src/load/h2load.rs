//! The program h2load: started, and what it says of every request.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};

use crate::bench::Sample;
use crate::serve::Server;

/// One request, sent again and again.
#[derive(Debug)]
pub(super) struct Load {
    program: PathBuf,
    body: PathBuf,
    path: &'static str,
    log: PathBuf,
}

/// How fast.
#[derive(Clone, Copy, Debug)]
pub(super) enum Pace {
    /// Each connection asks again as soon as it is answered.
    Most(Duration),
    /// So many requests a second on all connections together, answered in time or not.
    Steady { a_second: f64, time: Duration },
}

/// A load that is on.
#[derive(Debug)]
pub(super) struct Asking {
    child: Child,
    log: PathBuf,
}

/// What was answered.
#[derive(Clone, Debug)]
pub(super) struct Answers {
    seconds: Sample,
    /// From the first request to the last answer, s.
    span_s: f64,
}

impl Load {
    /// A request to `path` with a body of JSON; its files are in `folder`, by `name`.
    ///
    /// # Errors
    /// When the body cannot be written.
    pub(super) fn new(program: &Path, folder: &Path, name: &str, path: &'static str, body: &str) -> Result<Self> {
        let file = folder.join(format!("{name}.json"));
        fs::write(&file, body).with_context(|| format!("cannot write {}", file.display()))?;
        let log = folder.join(format!("{name}.log"));
        Ok(Self { program: program.to_owned(), body: file, path, log })
    }

    /// Starts it.
    ///
    /// # Errors
    /// When the program cannot be started.
    pub(super) fn start(&self, server: &Server, connections: usize, pace: Pace) -> Result<Asking> {
        // The program adds to a log that is there.
        if self.log.exists() {
            fs::remove_file(&self.log).with_context(|| format!("cannot remove {}", self.log.display()))?;
        }
        let mut command = Command::new(&self.program);
        command.args(["--h1", "--threads", "1", "--max-concurrent-streams", "1"]);
        command.args(["--header", "content-type: application/json", "--clients", &connections.to_string()]);
        match pace {
            Pace::Most(time) => command.arg(format!("--duration={}", time.as_secs())),
            Pace::Steady { a_second, time } => {
                let requests = (a_second * time.as_secs_f64()).ceil().max(connections as f64);
                command.arg(format!("--requests={requests}"));

                command.arg(format!("--rps={:.3}", a_second / connections as f64))
            }
        };
        command.arg("--data").arg(&self.body).arg("--log-file").arg(&self.log);
        command.arg(format!("{}{}", server.url(), self.path)).stdin(Stdio::null()).stdout(Stdio::piped());
        let child = command.spawn().with_context(|| format!("cannot start {}", self.program.display()))?;
        Ok(Asking { child, log: self.log.clone() })
    }
}

impl Asking {
    /// Waits until it is over.
    ///
    /// # Errors
    /// When a request failed, or none was answered.
    pub(super) fn end(self) -> Result<Answers> {
        let output = self.child.wait_with_output().context("h2load")?;
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        if !output.status.success() {
            bail!("h2load failed ({}): {said}", output.status);
        }
        counted(&said)?;
        let log = fs::read_to_string(&self.log).with_context(|| format!("cannot read {}", self.log.display()))?;
        Answers::of_log(&log)
    }
}

/// Requires that what h2load has counted has no failure: what got no answer at all is not in its log.
fn counted(said: &str) -> Result<()> {
    let line = said.lines().find(|line| line.starts_with("requests: ")).context("h2load counts no requests")?;
    let none = ["0 failed", "0 errored", "0 timeout"];
    let counts: Vec<&str> = line.split(", ").collect();
    if !none.iter().all(|one| counts.contains(one)) {
        let status = said.lines().find(|line| line.starts_with("status codes: ")).unwrap_or_default();
        bail!("not every request was answered well: {line}; {status}");
    }
    Ok(())
}

impl Answers {
    /// From lines of the start in microseconds since 1970, the status, and the microseconds until the end of the answer.
    fn of_log(log: &str) -> Result<Self> {
        let (mut first, mut last, mut seconds) = (u64::MAX, 0, Vec::new());
        for line in log.lines() {
            let mut fields = line.split('\t');
            let mut field = || fields.next().and_then(|text| text.parse::<u64>().ok());
            let (Some(start), Some(status), Some(time)) = (field(), field(), field()) else {
                bail!("h2load's log has the line `{line}`, which is not start, status and time");
            };
            if status != 200 {
                bail!("an answer has status {status}");
            }
            (first, last) = (first.min(start), last.max(start + time));
            seconds.push(time as f64 / 1e6);
        }
        if seconds.is_empty() {
            bail!("no request was answered");
        }
        Ok(Self { seconds: Sample::new(seconds), span_s: (last - first) as f64 / 1e6 })
    }

    /// How many.
    pub(super) fn len(&self) -> usize {
        self.seconds.len()
    }

    /// How many a second.
    pub(super) fn rate(&self) -> f64 {
        self.len() as f64 / self.span_s.max(f64::MIN_POSITIVE)
    }

    /// The time, s, that `share` of the answers did not exceed.
    pub(super) fn quantile(&self, share: f64) -> f64 {
        self.seconds.quantile(share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_becomes_times_and_a_rate() {
        let answers = Answers::of_log("1000000\t200\t1000\n1500000\t200\t3000\n2990000\t200\t10000\n").unwrap();
        assert_eq!((answers.len(), answers.quantile(0.5), answers.quantile(1.)), (3, 0.003, 0.01));
        assert!((answers.rate() - 1.5).abs() < 1e-9);
        for bad in ["", "1\t503\t7\n", "1\t200\n", "a\t200\t7\n"] {
            assert!(Answers::of_log(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn a_request_without_an_answer_is_seen() {
        let said = |failed, errored, timeout| {
            format!(
                "finished in 3 s\nrequests: 9 total, 9 started, 9 done, 9 succeeded, {failed} failed, {errored} errored, {timeout} timeout\nstatus codes: 9 2xx\n"
            )
        };
        counted(&said(0, 0, 0)).unwrap();
        for bad in [said(10, 0, 0), said(0, 1, 0), said(0, 0, 20), String::new()] {
            assert!(counted(&bad).is_err(), "{bad}");
        }
    }
}
