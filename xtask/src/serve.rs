//! The server of this build, `play`, started for a check on a free port of this computer and stopped by a signal.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};

use crate::process::{Ended, Running, Signal, Starter};

/// What the line with the address has before it.
const SCHEME: &str = "http://";
/// Longest time that an answer to [`Server::ask`] is waited for.
const ANSWER: Duration = Duration::from_secs(10);
/// Time after the signal in which it must have ended: what runs is finished first.
const GRACE: Duration = Duration::from_secs(10);

/// A server that runs; it is killed when this goes before [`Server::stop`].
#[derive(Debug)]
pub(crate) struct Server {
    running: Running,
    address: SocketAddr,
}

impl Server {
    /// Starts `play --port 0` with further arguments and waits until it says where it listens.
    ///
    /// # Errors
    /// When it ends before, or says no address.
    pub(crate) fn start(arguments: &[&str]) -> Result<Self> {
        let mut running = Starter::own()?.start(&[&["play", "--port", "0"], arguments].concat())?;
        let mut address = None;
        let listens = running.wait_until_saying(|said| {
            address = address_in(said);
            address.is_some()
        })?;
        match address.filter(|_| listens) {
            Some(address) => Ok(Self { running, address }),
            None => bail!("the server does not start: {}", running.end()?),
        }
    }

    /// Where it listens, as `http://127.0.0.1:PORT`.
    pub(crate) fn url(&self) -> String {
        format!("{SCHEME}{}", self.address)
    }

    /// The body of an answer with status 200, to a GET or, with a body of JSON, to a POST.
    ///
    /// # Errors
    /// When there is none within seconds, or another status.
    pub(crate) fn ask(&self, path: &str, body: Option<&str>) -> Result<String> {
        let mut stream = TcpStream::connect(self.address).with_context(|| format!("cannot reach {}", self.url()))?;
        stream.set_read_timeout(Some(ANSWER))?;
        // Of this version, so that the body comes in one piece and ends with the connection.
        match body {
            None => write!(stream, "GET {path} HTTP/1.0\r\nHost: {}\r\n\r\n", self.address)?,
            Some(body) => write!(
                stream,
                "POST {path} HTTP/1.0\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
                self.address,
                body.len()
            )?,
        }
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).with_context(|| format!("no answer of {path}"))?;
        let answer = String::from_utf8(answer).with_context(|| format!("{path} is answered with bytes"))?;
        let (head, body) =
            answer.split_once("\r\n\r\n").with_context(|| format!("the answer of {path} has no head"))?;
        let status = head.lines().next().unwrap_or_default();
        if !status.contains(" 200") {
            bail!("{path} is answered `{status}`: {body}");
        }
        Ok(body.to_owned())
    }

    /// Resident memory, bytes.
    ///
    /// # Errors
    /// Where the system does not tell.
    pub(crate) fn resident(&self) -> Result<u64> {
        gnp::memory::of(self.running.id())
            .context("the system does not say how much memory a process has (all but Linux)")
    }

    /// Tells it to end, and requires that it does so within seconds with exit code 0.
    ///
    /// # Errors
    /// When it does not, or ended before.
    pub(crate) fn stop(mut self) -> Result<Ended> {
        if !self.running.runs()? {
            bail!("the server ended by itself: {}", self.running.end()?);
        }
        self.running.renew();
        self.running.send(Signal::Terminate)?;
        let told = Instant::now();
        let ended = self.running.end()?;
        if ended.code() != Some(0) || told.elapsed() > GRACE {
            bail!("after SIGTERM the server needed {:.1} s: {ended}", told.elapsed().as_secs_f64());
        }
        Ok(ended)
    }
}

/// The first address of a line with one, once the line has ended.
fn address_in(said: &str) -> Option<SocketAddr> {
    let (_, after) = said.split_once(SCHEME)?;
    let end = after.find(|c: char| !(c.is_ascii_digit() || c == '.' || c == ':'))?;
    after[..end].parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_taken_from_a_whole_line_only() {
        let address = "127.0.0.1:8017".parse().ok();
        assert_eq!(address_in("Open http://127.0.0.1:8017/ in a browser\n"), address);
        assert_eq!(address_in("http://127.0.0.1:8017\nCtrl-C stops it"), address);
        assert_eq!(address_in("http://127.0.0.1:80"), None, "the rest of the number may not have come yet");
        assert_eq!(address_in("reading recordings\n"), None);
    }
}
