//! What is counted and measured, in the text form that Prometheus reads.

use std::sync::atomic::AtomicU64;
use std::time::Duration;

use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::prometheus_text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

use crate::problem::{Problem, ProblemKind};

/// Upper ends of the bins of latencies, s: fine around what a drag of the mouse bears.
const LATENCIES_S: [f64; 12] = [0.001, 0.0025, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.25, 0.5, 1., 5.];

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Answered {
    route: &'static str,
    status: u16,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct OfRoute {
    route: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Reason {
    reason: &'static str,
}

/// The counters of a server.
#[derive(Debug)]
pub(crate) struct Metrics {
    registry: Registry,
    requests: Family<Answered, Counter>,
    latency: Family<OfRoute, Histogram, fn() -> Histogram>,
    rejected: Family<Reason, Counter>,
    memory: Gauge<f64, AtomicU64>,
    /// Requests that are being answered.
    pub(crate) in_flight: Gauge,
    /// Requests whose client had gone before their work began.
    pub(crate) dropped: Counter,
    /// Vehicles that were predicted.
    pub(crate) vehicles: Counter,
}

impl Metrics {
    pub(crate) fn new() -> Self {
        let mut registry = Registry::with_prefix("gnp");
        let requests = Family::<Answered, Counter>::default();
        let latency: Family<OfRoute, Histogram, fn() -> Histogram> =
            Family::new_with_constructor(|| Histogram::new(LATENCIES_S));
        let rejected = Family::<Reason, Counter>::default();
        let (in_flight, memory) = (Gauge::default(), Gauge::<f64, AtomicU64>::default());
        let (dropped, vehicles) = (Counter::default(), Counter::default());
        registry.register("requests", "Requests answered, by route and status", requests.clone());
        registry.register_with_unit(
            "request_duration",
            "Time from a request's head to its answer's, by route",
            Unit::Seconds,
            latency.clone(),
        );
        registry.register("requests_rejected", "Requests refused, by kind of problem", rejected.clone());
        registry.register(
            "requests_dropped",
            "Requests whose client had gone before their work began",
            dropped.clone(),
        );
        registry.register("requests_in_flight", "Requests that are being answered", in_flight.clone());
        registry.register("vehicles_predicted", "Vehicles that were predicted", vehicles.clone());
        registry.register_with_unit("resident_memory", "Resident memory of the process", Unit::Bytes, memory.clone());
        Self { registry, requests, latency, rejected, memory, in_flight, dropped, vehicles }
    }

    /// An answer was made.
    pub(crate) fn answered(&self, route: &'static str, status: u16, refused: Option<ProblemKind>, took: Duration) {
        self.requests.get_or_create(&Answered { route, status }).inc();
        self.latency.get_or_create(&OfRoute { route }).observe(took.as_secs_f64());
        if let Some(kind) = refused {
            self.rejected.get_or_create(&Reason { reason: kind.name() }).inc();
        }
    }

    /// `GET /metrics`
    pub(crate) fn response(&self) -> Response {
        if let Some(bytes) = gnp::memory::now() {
            self.memory.set(bytes as f64);
        }
        let mut text = String::new();
        match encode(&mut text, &self.registry) {
            Ok(()) => {
                let kind = HeaderValue::from_static("text/plain; version=0.0.4; charset=utf-8");
                ([(header::CONTENT_TYPE, kind)], text).into_response()
            }
            Err(_) => Problem::new(ProblemKind::Internal, "the metrics cannot be written").into_response(),
        }
    }
}
