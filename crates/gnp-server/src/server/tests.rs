//! Requests that wait for their turn while clients go and the server is stopped.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::thread::{self, JoinHandle, sleep};
use std::time::{Duration, Instant};

use gnp::Machine;
use tokio::sync::OwnedSemaphorePermit;

use super::*;

const SCENE: &str = r#"{"scene":{"vehicles":[{"id":"a","track":[[0,0,2],[0.1,2,2],[0.2,4,2]]}]}}"#;

struct Running {
    address: SocketAddr,
    app: Arc<App>,
    stop: Stop,
    thread: JoinHandle<Result<(), ServerError>>,
}

impl Running {
    fn start(jobs: usize, waiting: usize) -> Self {
        let config = ServerConfig { port: 0, jobs, waiting, ..ServerConfig::default() };
        let model = Model::open(None, &Machine::default()).unwrap();
        let server = Server::bind(config, model, Vec::new()).unwrap();
        let (address, app, stop) = (server.address(), Arc::clone(&server.app), Stop::new());
        let asked = stop.clone();
        let thread = thread::spawn(move || server.run(&asked));
        Self { address, app, stop, thread }
    }

    /// All turns.
    fn hold(&self) -> OwnedSemaphorePermit {
        Builder::new_current_thread().build().unwrap().block_on(self.app.turns.hold_all())
    }

    /// Sends a request for forecasts and leaves the connection open.
    fn ask(&self) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).unwrap();
        let head = format!("POST /v1/predict HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\n", self.address);
        let length = SCENE.len();
        write!(stream, "{head}Content-Length: {length}\r\nConnection: close\r\n\r\n{SCENE}").unwrap();
        stream
    }

    fn wait_until(&self, what: &str, is: impl Fn(&App) -> bool) {
        let started = Instant::now();
        while !is(&self.app) {
            assert!(started.elapsed() < Duration::from_secs(30), "never: {what}");
            sleep(Duration::from_millis(5));
        }
    }

    fn stop(self) {
        self.stop.request();
        self.thread.join().unwrap().unwrap();
    }
}

fn answer(mut stream: TcpStream) -> String {
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    text
}

#[test]
fn work_of_a_client_who_has_gone_is_never_begun() {
    let server = Running::start(1, 8);
    let held = server.hold();
    let (gone, stays) = (server.ask(), server.ask());
    server.wait_until("both wait", |app| app.metrics.in_flight.get() == 2);
    drop(gone);
    server.wait_until("one is dropped", |app| app.metrics.dropped.get() == 1);
    drop(held);
    assert!(answer(stays).starts_with("HTTP/1.1 200"));
    assert_eq!((server.app.metrics.vehicles.get(), server.app.metrics.dropped.get()), (1, 1));
    server.stop();
}

#[test]
fn more_than_may_wait_are_sent_away() {
    let server = Running::start(1, 1);
    let held = server.hold();
    // One has the place of who works, as nobody does, and one that of who waits.
    let waiting = [server.ask(), server.ask()];
    server.wait_until("both wait", |app| app.metrics.in_flight.get() == 2);
    let refused = answer(server.ask());
    assert!(refused.starts_with("HTTP/1.1 503") && refused.contains("urn:gnp:problem:busy"), "{refused}");
    assert!(refused.to_lowercase().contains("retry-after: 1"), "{refused}");
    drop(held);
    assert!(waiting.into_iter().all(|stream| answer(stream).starts_with("HTTP/1.1 200")));
    server.stop();
}

#[test]
fn a_stopped_server_accepts_nobody_and_answers_who_is_there() {
    let server = Running::start(1, 8);
    let held = server.hold();
    let waiting = server.ask();
    server.wait_until("it waits", |app| app.metrics.in_flight.get() == 1);
    server.stop.request();
    let started = Instant::now();
    while TcpStream::connect(server.address).is_ok() {
        assert!(started.elapsed() < Duration::from_secs(30), "it still accepts");
        sleep(Duration::from_millis(5));
    }
    drop(held);
    assert!(answer(waiting).starts_with("HTTP/1.1 200"));
    server.stop();
}

#[test]
fn a_stopped_server_does_not_wait_for_ever() {
    let server = Running::start(1, 8);
    let held = server.hold();
    let waiting = server.ask();
    server.wait_until("it waits", |app| app.metrics.in_flight.get() == 1);
    let started = Instant::now();
    server.stop();
    assert!(started.elapsed() < GRACE + Duration::from_secs(10));
    drop((held, waiting));
}

#[test]
fn a_panic_is_a_problem_and_the_server_goes_on() {
    let server = Running::start(1, 8);
    let runtime = Builder::new_multi_thread().enable_all().build().unwrap();
    let failed = runtime.block_on(server.app.turns.take(|_| -> Result<(), _> { panic!("a test of panics") }));
    assert_eq!(failed.unwrap_err().kind(), crate::ProblemKind::Internal);
    assert!(answer(server.ask()).starts_with("HTTP/1.1 200"));
    server.stop();
}

#[test]
fn a_port_that_is_taken_is_said() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let config = ServerConfig { port: taken.local_addr().unwrap().port(), ..ServerConfig::default() };
    let error = Server::bind(config, Model::open(None, &Machine::default()).unwrap(), Vec::new()).unwrap_err();
    assert!(matches!(&error, ServerError::PortTaken { .. }), "{error}");
    assert!(error.to_string().contains("--port"));
}
