//! The routes of the server, and what every request passes through.

use std::any::Any;
use std::sync::Arc;
use std::time::Instant;

use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, Request, State};
use axum::http::Method;
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get, post};
use axum::{Json, Router};
use gnp_data::Recording;
use serde_json::Value;
use tower_http::catch_panic::CatchPanicLayer;

use crate::config::ServerConfig;
use crate::error::ServerError;
use crate::explain::ExplainRequest;
use crate::limits::{Rate, at_a_rate, read};
use crate::metrics::Metrics;
use crate::model::ServedModel;
use crate::page;
use crate::predict::{PredictRequest, Predicted};
use crate::problem::{Problem, ProblemKind, Refused};
use crate::recordings::{Recordings, Shown, Span};
use crate::scene::Moments;
use crate::security::{Doorkeeper, guarded, with_headers};
use crate::work::Turns;

/// What all requests share.
#[derive(Debug)]
pub(crate) struct App {
    pub(crate) config: ServerConfig,
    pub(crate) model: ServedModel,
    pub(crate) recordings: Recordings,
    pub(crate) moments: Moments,
    pub(crate) metrics: Metrics,
    pub(crate) turns: Arc<Turns>,
}

impl App {
    /// # Errors
    /// As [`Recordings::new`] and [`ServedModel::new`].
    pub(crate) fn new(
        config: ServerConfig,
        model: gnp::Model,
        recordings: Vec<Recording>,
    ) -> Result<Self, ServerError> {
        let metrics = Metrics::new();
        let turns = Arc::new(Turns::new(config.jobs, config.waiting, metrics.dropped.clone()));
        let model = ServedModel::new(model, config.max_vehicles)?;
        let recordings = Recordings::new(recordings, model.shape())?;
        let moments = Moments::default();
        Ok(Self { config, model, recordings, moments, metrics, turns })
    }
}

/// A page or a function of the API.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Route {
    /// The page.
    Index,
    /// Its scripts and styles.
    Page,
    /// The description of the API.
    OpenApi,
    /// Whether the server is up.
    Health,
    /// Counters and latencies.
    Metrics,
    /// What the model is.
    Model,
    /// Which recordings there are.
    Recordings,
    /// Who drove where.
    Tracks,
    /// Forecasts of a scene.
    Predict,
    /// What is behind one.
    Explain,
}

impl Route {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::Index,
        Self::Page,
        Self::OpenApi,
        Self::Health,
        Self::Metrics,
        Self::Model,
        Self::Recordings,
        Self::Tracks,
        Self::Predict,
        Self::Explain,
    ];

    /// Its path; what varies in it stands in braces.
    #[must_use]
    pub const fn path(self) -> &'static str {
        match self {
            Self::Index => "/",
            Self::Page => "/page/{file}",
            Self::OpenApi => "/openapi.json",
            Self::Health => "/healthz",
            Self::Metrics => "/metrics",
            Self::Model => "/v1/model",
            Self::Recordings => "/v1/recordings",
            Self::Tracks => "/v1/recordings/{name}/tracks",
            Self::Predict => "/v1/predict",
            Self::Explain => "/v1/explain",
        }
    }

    /// Its method; what is asked for by GET is by HEAD, too.
    #[must_use]
    pub const fn method(self) -> &'static str {
        match self {
            Self::Predict | Self::Explain => "POST",
            _ => "GET",
        }
    }

    /// The one of a path, whatever the method.
    fn of(path: &str) -> Option<Self> {
        let fits = |route: &Self| {
            let (pattern, parts) = (route.path().split('/'), path.split('/'));
            pattern.clone().count() == parts.clone().count()
                && pattern.zip(parts).all(|(pattern, part)| pattern.starts_with('{') || pattern == part)
        };
        Self::ALL.into_iter().find(fits)
    }

    fn handler(self) -> MethodRouter<Arc<App>> {
        match self {
            Self::Index => get(async || page::index()),
            Self::Page => get(async |file: Result<Path<String>, PathRejection>| page::of_page(&text(file)?)),
            Self::OpenApi => get(async || page::openapi()),
            Self::Health => get(async || ([("content-type", "application/json")], r#"{"status":"ok"}"#)),
            Self::Metrics => get(async |State(app): State<Arc<App>>| app.metrics.response()),
            Self::Model => get(async |State(app): State<Arc<App>>| Json(app.model.described.clone())),
            Self::Recordings => get(recordings),
            Self::Tracks => get(tracks),
            Self::Predict => post(predict),
            Self::Explain => post(explain),
        }
    }
}

/// The whole server but for its connections.
pub(crate) fn router(app: &Arc<App>, doorkeeper: Doorkeeper) -> Router {
    let rate = Arc::new(Rate::new(app.config.requests_per_s));
    let routes =
        Route::ALL.into_iter().fold(Router::new(), |router, route| router.route(route.path(), route.handler()));
    let routes = routes
        .fallback(async || Problem::new(ProblemKind::NotFound, "there is no such page"))
        .method_not_allowed_fallback(not_allowed)
        .with_state(Arc::clone(app))
        .layer(from_fn_with_state(rate, at_a_rate));
    // The last is the first that a request meets.
    with_headers(guarded(routes, doorkeeper).layer(CatchPanicLayer::custom(after_panic)))
        .layer(from_fn_with_state(Arc::clone(app), observed))
}

async fn not_allowed(method: Method) -> Problem {
    Problem::new(ProblemKind::MethodNotAllowed, format!("{method} is not what this page is for; see the Allow header"))
}

/// The panic itself is printed by its own hook.
fn after_panic(_: Box<dyn Any + Send>) -> Response {
    Problem::new(ProblemKind::Internal, "the work on this request failed").into_response()
}

/// Counts a request and its answer.
async fn observed(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let started = Instant::now();
    let route = Route::of(request.uri().path()).map_or("other", Route::path);
    let _in_flight = InFlight::begun(&app.metrics);
    let response = next.run(request).await;
    let refused = response.extensions().get::<Refused>().map(|Refused(kind)| *kind);
    app.metrics.answered(route, response.status().as_u16(), refused, started.elapsed());
    response
}

/// A request that is being answered, or whose client goes meanwhile.
struct InFlight<'a>(&'a Metrics);

impl<'a> InFlight<'a> {
    fn begun(metrics: &'a Metrics) -> Self {
        metrics.in_flight.inc();
        Self(metrics)
    }
}

impl Drop for InFlight<'_> {
    fn drop(&mut self) {
        self.0.in_flight.dec();
    }
}

/// A part of a path; what is no text names nothing.
fn text(part: Result<Path<String>, PathRejection>) -> Result<String, Problem> {
    let Path(text) = part.map_err(|_| Problem::new(ProblemKind::NotFound, "there is no such page"))?;
    Ok(text)
}

async fn recordings(State(app): State<Arc<App>>) -> Response {
    Json(&app.recordings.listed).into_response()
}

async fn tracks(
    State(app): State<Arc<App>>,
    name: Result<Path<String>, PathRejection>,
    span: Result<Query<Span>, QueryRejection>,
) -> Result<Json<Shown>, Problem> {
    let Query(span) = span.map_err(|error| Problem::at(ProblemKind::InvalidRequest, "query", error.body_text()))?;
    let (number, _) = app.recordings.named(&text(name)?, "name")?;
    let of = Arc::clone(&app);
    let work = move |_: &mut _| Shown::of(of.recordings.number(number)?, span);
    app.turns.take(work).await.map(Json)
}

async fn predict(State(app): State<Arc<App>>, request: Request) -> Result<Json<Predicted>, Problem> {
    let asked: PredictRequest = read(request, app.config.max_body_bytes).await?;
    let of = Arc::clone(&app);
    app.turns.take(move |workspace| asked.answer(&of, workspace)).await.map(Json)
}

async fn explain(State(app): State<Arc<App>>, request: Request) -> Result<Json<Value>, Problem> {
    let asked: ExplainRequest = read(request, app.config.max_body_bytes).await?;
    let of = Arc::clone(&app);
    app.turns.take(move |_| asked.answer(&of)).await.map(Json)
}
