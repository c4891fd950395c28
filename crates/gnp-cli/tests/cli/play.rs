//! `play` as users and programs start and end it.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};

use crate::program::{data, program, run};

/// One recording, so that it starts soon.
const SCENE: &str = "ngsim/us101-10_1.csv.gz";

#[test]
fn a_server_says_where_it_is_and_a_signal_ends_it_well() {
    let tracks = data(&[SCENE]);
    let words = ["play", "--input", tracks.path().to_str().unwrap(), "--port", "0"];
    let mut child = program(&words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("listening on http://").and_then(|it| it.strip_suffix('/'));
    let Some(address) = address else { panic!("{line:?}") };
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET /v1/recordings HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains(r#""name":"us101-10_1""#), "{answer}");
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    let ended = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success() && said.contains("stopped"), "{:?} {said}", ended.status);
    assert!(TcpStream::connect(address).is_err());
}

#[test]
fn a_port_that_is_taken_is_an_error_with_what_to_do() {
    let (tracks, taken) = (data(&[SCENE]), TcpListener::bind("127.0.0.1:0").unwrap());
    let port = taken.local_addr().unwrap().port().to_string();
    run(&["play", "--input", tracks.path().to_str().unwrap(), "--port", &port])
        .badly(&["another program listens", "--port 0"]);
}

/// The recordings would be an error of their own.
#[test]
fn what_is_wrong_with_an_option_is_said_before_recordings_are_read() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let badly = |words: &[&str], parts: &[&str]| {
        let all = [&["play", "--input", "nowhere.csv"], words].concat();
        assert!(!run(&all).badly(parts).err.contains("nowhere.csv"), "{words:?}");
    };
    badly(&["--port", "0", "--allow-host", "http://a.example"], &["\"http://a.example\" is no host"]);
    badly(&["--port", "0", "--allow-origin", "a.example"], &["\"a.example\" is no origin"]);
    badly(&["--port", &port], &["another program listens"]);
    badly(&["--port", "0", "--listen", "192.0.2.1"], &["cannot listen on 192.0.2.1:0"]);
    badly(&["--port", "0", "--model", "no/model"], &["no/model"]);
    badly(&["--port", "0", "--road", "no-road.csv"], &["no-road.csv"]);
    run(&["play", "--port", "0", "--input", "nowhere.csv"]).badly(&["nowhere.csv"]);
}

#[test]
fn a_recording_that_is_not_there_is_named_beside_those_that_are() {
    let tracks = data(&[SCENE]);
    let words = ["play", "--input", tracks.path().to_str().unwrap(), "--recording", "x", "--port", "0"];
    run(&words).badly(&["no recording x", "us101-10_1"]);
}
