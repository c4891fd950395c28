//! Answers over HTTP under load: how many a second, how soon, without an error and with memory that does not grow.
//!
//! The load is made by h2load, of the project nghttp2 (Debian: package `nghttp2-client`), over the loopback address.

mod h2load;
mod scenes;

use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use clap::Args;
use gnp::Progress as _;
use gnp_cli::Terminal;

use crate::bench::{self, table};
use crate::ci::supply::installed;
use crate::serve::Server;
use h2load::{Answers, Load, Pace};
use scenes::Scenes;

/// Connections that ask at once.
const CONNECTIONS: usize = 8;
/// Requests a second that the server is to answer, where its machine can.
const RATE: f64 = 1000.;
/// The share of the most it gives at which it is asked where that is less than [`RATE`]: beyond, only the queue grows.
const SHARE: f64 = 0.8;
/// Nobody is refused for asking often or much: the load comes from one address.
const LIMITS: [&str; 4] = ["--rate", "1000000", "--max-vehicles", "400"];
/// Seconds after which memory is looked at first: until then threads get their buffers.
const SETTLED: Duration = Duration::from_secs(10);
/// Growth of memory from then to the end, at most, over what it was, and in bytes beside that.
const GROWTH: (f64, u64) = (1.2, 32 << 20);

/// How long.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct LoadArgs {
    /// Seconds of each part; memory is held against what it was after 10 s, or half of shorter ones.
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u16).range(2..=3600))]
    pub(crate) seconds: u16,
}

/// Explanations a second that a page asks for: as often as forecasts of 60 vehicles are there.
const PAGE_ASKS: f64 = 40.;

/// Starts a server, asks it as a program does and as its page does, prints a table, and stops it.
///
/// # Errors
/// When an answer is an error, memory grows, or the server does not end well.
pub(crate) fn run(arguments: LoadArgs, terminal: &Terminal) -> Result<()> {
    let Some(program) = installed("h2load") else {
        terminal.note("load: SKIPPED: there is no h2load (Debian: apt-get install nghttp2-client)");
        return Ok(());
    };
    let folder = tempfile::tempdir().context("cannot make a folder for the load")?;
    let time = Duration::from_secs(arguments.seconds.into());
    let settled = SETTLED.min(time / 2);
    let others = bench::load();
    let server = Server::start(&LIMITS)?;
    let scenes = Scenes::of(&server)?;
    let load =
        |name: &'static str, path: &'static str, body: &str| Load::new(&program, folder.path(), name, path, body);
    let program_asks = load("program", "/v1/predict", &scenes.of_program)?;
    let page =
        [load("page-predict", "/v1/predict", &scenes.predict)?, load("page-explain", "/v1/explain", &scenes.explain)?];

    terminal.note("load: as many as it gives");
    let fresh = server.resident()?;
    let running = program_asks.start(&server, CONNECTIONS, Pace::Most(time))?;
    std::thread::sleep(settled);
    let early = server.resident()?;
    let most = running.end()?;
    let rate = most.rate();
    let asked = if rate > RATE / SHARE { RATE } else { (rate * SHARE).floor().max(1.) };
    terminal.note(&format!("load: {rate:.0} a second; now {asked:.0} a second"));
    let steady = program_asks.start(&server, CONNECTIONS, Pace::Steady { a_second: asked, time })?.end()?;
    terminal.note("load: as the page asks while somebody drags a vehicle");
    // It asks both at once and again when both are there, so that the second waits for the first.
    let paces = [Pace::Most(time), Pace::Steady { a_second: PAGE_ASKS, time }];
    let dragged: Vec<_> =
        page.iter().zip(paces).map(|(one, pace)| one.start(&server, 1, pace)).collect::<Result<_>>()?;
    let dragged: Vec<Answers> = dragged.into_iter().map(h2load::Asking::end).collect::<Result<_>>()?;
    let late = server.resident()?;
    server.stop()?;

    let rows = vec![
        row("predict, most", CONNECTIONS, &most),
        row("predict, steady", CONNECTIONS, &steady),
        row("page: predict", 1, &dragged[0]),
        row("page: explain", 1, &dragged[1]),
    ];
    let header = ["asked", "by", "answers", "a second", "p50", "p95", "p99", "longest"];
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    terminal.result(&format!(
        "Answers over HTTP on the loopback address, {time:?} each, h2load on the same cores; load average before {others}.
{}.
`predict` sends the tracks of {} vehicles, on {CONNECTIONS} connections: as many as are answered, and {asked:.0} a second.
The page asks both, explanations {PAGE_ASKS} times a second, of {} vehicles, {} of them recorded. Times in ms.
{}
No error. Memory of the server: {:.0} MiB before, {:.0} after {settled:?}, {:.0} in the end.",
        bench::processor(),
        scenes::VEHICLES,
        scenes.shown,
        scenes.recorded,
        table(header.map(str::to_owned).to_vec(), rows),
        mib(fresh),
        mib(early),
        mib(late),
    ));
    flat(early, late)
}

fn row(what: &str, connections: usize, answers: &Answers) -> Vec<String> {
    let ms = |share| format!("{:.1}", answers.quantile(share) * 1e3);
    let [count, rate] = [answers.len().to_string(), format!("{:.0}", answers.rate())];
    vec![what.to_owned(), connections.to_string(), count, rate, ms(0.5), ms(0.95), ms(0.99), ms(1.)]
}

/// Requires that memory did not grow from `early` to `late`, bytes.
fn flat(early: u64, late: u64) -> Result<()> {
    let most = (early as f64 * GROWTH.0) as u64 + GROWTH.1;
    if late > most {
        bail!("the server's memory grows under load: from {early} to {late} bytes, at most {most} were allowed");
    }
    Ok(())
}
