//! Limits on requests: how many a client may make, how large and of what kind a body is, how soon it must come.

use std::net::IpAddr;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use axum::body::to_bytes;
use axum::extract::connect_info::ConnectInfo;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use governor::clock::{Clock as _, DefaultClock};
use governor::{DefaultKeyedRateLimiter, Quota, RateLimiter};
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::time::timeout;

use crate::connections::Client;
use crate::object::Object;
use crate::problem::{Problem, ProblemKind};

/// In so much time the body of a request must be there.
const BODY_IN: Duration = Duration::from_secs(10);
/// Requests after which clients that ask no more are forgotten.
const FORGET_EVERY: u32 = 10_000;

/// How often each client has asked lately.
#[derive(Debug)]
pub(crate) struct Rate {
    limiter: DefaultKeyedRateLimiter<IpAddr>,
    clock: DefaultClock,
    asked: AtomicU32,
}

impl Rate {
    /// So many requests a second for each client, and as many at once; 1 where it is 0.
    pub(crate) fn new(requests_per_s: u32) -> Self {
        let quota = Quota::per_second(NonZeroU32::new(requests_per_s).unwrap_or(NonZeroU32::MIN));
        Self { limiter: RateLimiter::keyed(quota), clock: DefaultClock::default(), asked: AtomicU32::new(0) }
    }

    fn check(&self, client: IpAddr) -> Result<(), Problem> {
        if self.asked.fetch_add(1, Ordering::Relaxed).is_multiple_of(FORGET_EVERY) {
            self.limiter.retain_recent();
            self.limiter.shrink_to_fit();
        }
        self.limiter.check_key(&client).map_err(|refused| {
            let wait = refused.wait_time_from(self.clock.now());
            let detail = "this client asks more often than it may; --rate says how often";
            Problem::new(ProblemKind::TooManyRequests, detail).retry_after(wait.as_secs() + 1)
        })
    }
}

/// Lets a request pass if its client may ask now.
pub(crate) async fn at_a_rate(State(rate): State<Arc<Rate>>, request: Request, next: Next) -> Response {
    let client = request.extensions().get::<ConnectInfo<Client>>();
    match client.map_or(Ok(()), |ConnectInfo(Client(address))| rate.check(*address)) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

/// What a request says in its body, as JSON of at most `most` bytes.
///
/// # Errors
/// A problem for another kind of body, a body that is larger, late, no JSON, or not what is asked for, with the field.
pub(crate) async fn read<T: DeserializeOwned>(request: Request, most: usize) -> Result<T, Problem> {
    if !is_json(request.headers()) {
        let detail = "say Content-Type: application/json";
        return Err(Problem::new(ProblemKind::UnsupportedMediaType, detail));
    }
    let encoding = request.headers().get(header::CONTENT_ENCODING);
    if encoding.is_some_and(|encoding| !encoding.as_bytes().eq_ignore_ascii_case(b"identity")) {
        let detail = "send the body as it is, without Content-Encoding";
        return Err(Problem::new(ProblemKind::UnsupportedMediaType, detail));
    }
    let too_large = || Problem::new(ProblemKind::BodyTooLarge, format!("a body has at most {most} bytes"));
    let length =
        request.headers().get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    if length.is_some_and(|length| length > most as u64) {
        return Err(too_large());
    }
    let body = timeout(BODY_IN, to_bytes(request.into_body(), most)).await;
    let late = |_| Problem::new(ProblemKind::SlowRequest, format!("the body must come within {} s", BODY_IN.as_secs()));
    // It fails for its length, or when the client has gone, who hears nothing of it.
    let body = body.map_err(late)?.map_err(|_| too_large())?;
    parse(&body)
}

fn is_json(headers: &HeaderMap) -> bool {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    let mut parts = kind.split(';').map(str::trim);
    let json = parts.next().is_some_and(|kind| kind.eq_ignore_ascii_case("application/json"));
    json && parts.all(|part| part.is_empty() || part.replace('"', "").eq_ignore_ascii_case("charset=utf-8"))
}

/// What JSON says.
///
/// # Errors
/// A problem for no JSON, or not what is asked for, with the field.
pub(crate) fn parse<T: DeserializeOwned>(body: &[u8]) -> Result<T, Problem> {
    let mut json = serde_json::Deserializer::from_slice(body);
    let parsed = serde_path_to_error::deserialize(&mut json);
    let ended = json.end();
    match parsed {
        Ok(Object(value)) => {
            ended.map(|()| value).map_err(|error| Problem::new(ProblemKind::NotJson, error.to_string()))
        }
        Err(error) if error.inner().is_data() => Err(not_asked_for(error)),
        // Of a list that is too long, or a number in place of a word, the reader says that the text goes on wrongly.
        Err(_) => {
            let value: Value =
                serde_json::from_slice(body).map_err(|error| Problem::new(ProblemKind::NotJson, error.to_string()))?;
            serde_path_to_error::deserialize(value).map(|Object(value)| value).map_err(not_asked_for)
        }
    }
}

fn not_asked_for(error: serde_path_to_error::Error<serde_json::Error>) -> Problem {
    // Where the value as a whole is wrong the path is a dot; a field may have an empty name.
    let field = Some(error.path().to_string())
        .filter(|path| path != "." && !path.is_empty())
        .unwrap_or_else(|| "body".to_owned());
    Problem::at(ProblemKind::InvalidRequest, field, error.into_inner().to_string())
}
