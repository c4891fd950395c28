//! A server in this process, and a client that says exactly what it is told to.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::sync::OnceLock;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use gnp::{Machine, Model, RecordingsRequest, Stop};
use gnp_data::Recording;
use gnp_server::{Server, ServerConfig, ServerError};
use serde_json::Value;

/// The recording that tests are about.
pub(crate) const RECORDING: &str = "us101-10_1";

/// A server on a thread of its own.
pub(crate) struct Running {
    pub(crate) address: SocketAddr,
    stop: Stop,
    thread: JoinHandle<Result<(), ServerError>>,
}

impl Running {
    /// One at any free port.
    pub(crate) fn start(mut config: ServerConfig) -> Self {
        config.port = 0;
        let server = Server::bind(config, model(), vec![recording()]).unwrap();
        let (address, stop) = (server.address(), Stop::new());
        let asked = stop.clone();
        let thread = thread::spawn(move || server.run(&asked));
        Self { address, stop, thread }
    }

    /// The one that all tests share which change nothing.
    pub(crate) fn shared() -> &'static Self {
        static SHARED: OnceLock<Running> = OnceLock::new();
        SHARED.get_or_init(|| Self::start(ServerConfig::default()))
    }

    /// Asks it to stop and waits for its end.
    pub(crate) fn stop(self) {
        self.stop.request();
        self.thread.join().unwrap().unwrap();
    }

    pub(crate) fn get(&self, path: &str) -> Answer {
        self.request("GET", path, &[], "")
    }

    pub(crate) fn post(&self, path: &str, body: &Value) -> Answer {
        self.request("POST", path, &["Content-Type: application/json"], &body.to_string())
    }

    /// A request to this server with these headers beside those that are needed.
    pub(crate) fn request(&self, method: &str, path: &str, headers: &[&str], body: &str) -> Answer {
        let headers: String = headers.iter().map(|header| format!("{header}\r\n")).collect();
        let length = body.len();
        let head = format!("{method} {path} HTTP/1.1\r\nHost: {}\r\nContent-Length: {length}\r\n", self.address);
        self.raw(&format!("{head}{headers}Connection: close\r\n\r\n{body}"))
    }

    /// What comes back for these bytes.
    pub(crate) fn raw(&self, bytes: &str) -> Answer {
        let mut stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        // A server may refuse before it has read everything.
        let _ = stream.write_all(bytes.as_bytes());
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let _ = stream.shutdown(Shutdown::Both);
        Answer::parse(&answer)
    }
}

/// What a server answered.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    headers: Vec<(String, String)>,
    pub(crate) body: String,
}

impl Answer {
    fn parse(bytes: &[u8]) -> Self {
        let text = String::from_utf8_lossy(bytes);
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("no answer: {text:?}"));
        let mut lines = head.lines();
        let status = lines.next().unwrap().split(' ').nth(1).unwrap().parse().unwrap();
        let header = |line: &str| line.split_once(": ").map(|(name, value)| (name.to_lowercase(), value.to_owned()));
        Self { status, headers: lines.filter_map(header).collect(), body: body.to_owned() }
    }

    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    /// The name of the problem that it is.
    pub(crate) fn problem(&self) -> String {
        assert_eq!(self.header("content-type"), Some("application/problem+json"), "{self:?}");
        let problem = self.json();
        assert_eq!(problem["status"], self.status, "{self:?}");
        problem["type"].as_str().unwrap().strip_prefix("urn:gnp:problem:").unwrap().to_owned()
    }
}

pub(crate) fn model() -> Model {
    static MODEL: OnceLock<Model> = OnceLock::new();
    MODEL.get_or_init(|| Model::open(None, &Machine::default()).unwrap()).clone()
}

pub(crate) fn recording() -> Recording {
    static FOUND: OnceLock<Recording> = OnceLock::new();
    let read = || {
        let request = RecordingsRequest { recording: Some(RECORDING.to_owned()), ..RecordingsRequest::default() };
        gnp::recordings(&request, model().gnp().shape(), &Machine::default()).unwrap().remove(0)
    };
    FOUND.get_or_init(read).clone()
}
