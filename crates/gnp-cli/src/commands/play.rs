//! `play`: recordings in the browser, with live forecasts.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

use anyhow::Result;
use gnp::{Model, RecordingsRequest};
use gnp_server::{Listening, ServerConfig};

use crate::arguments::PlayArgs;
use crate::program::Program;

pub(super) fn play(args: &PlayArgs, program: &Program) -> Result<()> {
    let machine = crate::machine(&args.machine, program)?;
    // What is wrong with an option is said before recordings are read, which may take long.
    let listening = Listening::begin(config(args))?;
    let model = Model::open(args.model.as_deref(), &machine)?;
    let (road, lines) = args.road.parts()?;
    let request = RecordingsRequest {
        input: args.input.clone(),
        format: args.format,
        tracks: gnp::road_options(road.as_deref(), lines.as_deref())?,
        recording: args.recording.clone(),
    };
    let recordings = gnp::recordings(&request, model.gnp().shape(), &machine)?;
    let server = listening.serve(model, recordings)?;
    let address = server.address();
    // Programs read this line.
    machine.progress.result(&format!("listening on http://{}/", reachable(address)));
    if !address.ip().is_loopback() {
        machine.progress.note(&format!(
            "whoever reaches {address} can use it, there is no password and no encryption; names other than its address \
             must be listed: --allow-host"
        ));
    }
    machine.progress.note("Ctrl-C ends it");
    server.run(&machine.stop)?;
    machine.progress.note("stopped");
    Ok(())
}

fn config(args: &PlayArgs) -> ServerConfig {
    let mut config = ServerConfig::default();
    config.listen = args.listen;
    config.port = args.port;
    config.allowed_hosts.clone_from(&args.allow_host);
    config.allowed_origins.clone_from(&args.allow_origin);
    config.max_vehicles = args.max_vehicles as usize;
    config.max_body_bytes = args.max_body_kb as usize * 1024;
    config.requests_per_s = args.rate;
    if let Some(jobs) = args.jobs.or(args.machine.threads) {
        config.jobs = jobs.into();
    }
    config
}

/// An address that a browser on this computer takes.
fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}
