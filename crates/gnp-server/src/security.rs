//! Who is answered: requests that name this server, from no foreign page. And what a browser may do with an answer.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use axum::Router;
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue, Method, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use tower_http::cors::CorsLayer;
use tower_http::set_header::SetResponseHeaderLayer;

use crate::config::ServerConfig;
use crate::error::ServerError;
use crate::problem::{Problem, ProblemKind};

/// Scripts, styles and connections of this server alone, nothing inline, no frame around it.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
     img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Whom a server answers.
#[derive(Debug)]
pub(crate) struct Doorkeeper {
    address: SocketAddr,
    hosts: Vec<Host>,
    origins: Vec<HeaderValue>,
}

/// A name that the `Host` header may have, and the port where it must be one.
#[derive(Debug, PartialEq)]
struct Host {
    name: String,
    port: Option<u16>,
}

impl Host {
    /// `name`, `name:port`, `[::1]` or `[::1]:port`.
    fn parse(text: &str) -> Option<Self> {
        let (name, port) = match text.rsplit_once(':') {
            Some((name, port)) if !port.ends_with(']') => (name, Some(port.parse().ok()?)),
            _ => (text, None),
        };
        let bracketed = name.starts_with('[') && name.ends_with(']');
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
        let good = !name.is_empty()
            && (bracketed && name[1..name.len() - 1].parse::<IpAddr>().is_ok() || name.chars().all(plain));
        good.then(|| Self { name: name.to_ascii_lowercase(), port })
    }

    fn address(&self) -> Option<IpAddr> {
        self.name.trim_start_matches('[').trim_end_matches(']').parse().ok()
    }
}

impl Doorkeeper {
    /// # Errors
    /// [`ServerError::Config`] for hosts and origins that are none.
    pub(crate) fn new(config: &ServerConfig, address: SocketAddr) -> Result<Self, ServerError> {
        let host = |text: &String| {
            let wrong = || {
                ServerError::Config(format!(
                    "{text:?} is no host; give a name, or a name and a port, such as gnp.example.org:8017"
                ))
            };
            Host::parse(text).ok_or_else(wrong)
        };
        let origin = |text: &String| {
            let wrong = || {
                ServerError::Config(format!(
                    "{text:?} is no origin; give scheme and host, and the port where there is one, such as https://example.org"
                ))
            };
            let (scheme, host) = text.split_once("://").ok_or_else(wrong)?;
            if !matches!(scheme, "http" | "https") || Host::parse(host).is_none() {
                return Err(wrong());
            }
            HeaderValue::from_str(&text.to_ascii_lowercase()).map_err(|_| wrong())
        };
        let hosts = config.allowed_hosts.iter().map(host).collect::<Result<_, _>>()?;
        let origins = config.allowed_origins.iter().map(origin).collect::<Result<_, _>>()?;
        Ok(Self { address, hosts, origins })
    }

    /// Whether a `Host` header names this server. A page of a stranger whose name leads here (DNS rebinding) has that name
    /// in it.
    fn is_me(&self, host: &Host) -> bool {
        let listed = |known: &Host| known.name == host.name && (known.port.is_none() || known.port == host.port);
        // Without a port it is that of the scheme.
        let here = host.port.unwrap_or(80) == self.address.port();
        let mine = |address: IpAddr| address.is_loopback() || address == self.address.ip() && !address.is_unspecified();
        let named = host.name == "localhost" || host.address().is_some_and(mine);
        self.hosts.iter().any(listed) || here && named
    }

    fn check(&self, request: &Request) -> Result<(), Problem> {
        let mut hosts = request.headers().get_all(header::HOST).iter();
        let (Some(host), None) = (hosts.next(), hosts.next()) else {
            return Err(Problem::new(ProblemKind::WrongHost, "give one Host header"));
        };
        let text = host.to_str().unwrap_or_default();
        // A request may name its server in its first line, too.
        let named = request.uri().authority().is_none_or(|named| named.as_str().eq_ignore_ascii_case(text));
        if !named || !Host::parse(text).is_some_and(|host| self.is_me(&host)) {
            let detail = "the Host header does not name this server; a name of its own is allowed by --allow-host";
            return Err(Problem::new(ProblemKind::WrongHost, detail));
        }
        let Some(origin) = request.headers().get(header::ORIGIN) else { return Ok(()) };
        let own = origin.to_str().is_ok_and(|origin| {
            let mine = |scheme: &str| origin.strip_prefix(scheme).is_some_and(|rest| rest.eq_ignore_ascii_case(text));
            mine("http://") || mine("https://")
        });
        if own || self.origins.contains(origin) {
            return Ok(());
        }
        let detail = "a page of another origin asks, which is not listed; it is by --allow-origin";
        Err(Problem::new(ProblemKind::OriginNotAllowed, detail))
    }
}

async fn at_the_door(State(doorkeeper): State<Arc<Doorkeeper>>, request: Request, next: Next) -> Response {
    match doorkeeper.check(&request) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

/// `router` behind a doorkeeper.
pub(crate) fn guarded(router: Router, doorkeeper: Doorkeeper) -> Router {
    let cors = CorsLayer::new()
        .allow_origin(doorkeeper.origins.clone())
        .allow_methods([Method::GET, Method::POST])
        .allow_headers([header::CONTENT_TYPE]);
    router.layer(cors).layer(from_fn_with_state(Arc::new(doorkeeper), at_the_door))
}

/// `router` whose answers, refusals among them, tell a browser what it may do with them.
pub(crate) fn with_headers(router: Router) -> Router {
    let headers = [
        (header::CONTENT_SECURITY_POLICY, CONTENT_SECURITY_POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ];
    headers.into_iter().fold(router, |router, (name, value)| {
        router.layer(SetResponseHeaderLayer::overriding(name, HeaderValue::from_static(value)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doorkeeper(listen: &str, hosts: &[&str]) -> Doorkeeper {
        let address: SocketAddr = listen.parse().unwrap();
        let allowed_hosts = hosts.iter().map(|host| (*host).to_owned()).collect();
        Doorkeeper::new(&ServerConfig { allowed_hosts, ..ServerConfig::default() }, address).unwrap()
    }

    #[test]
    fn only_names_of_this_server_are_answered() {
        let local = doorkeeper("127.0.0.1:8017", &["gnp.example.org", "b.example.org:9"]);
        let answers = |door: &Doorkeeper, host: &str| Host::parse(host).is_some_and(|host| door.is_me(&host));
        for host in [
            "localhost:8017",
            "LOCALHOST:8017",
            "127.0.0.1:8017",
            "127.9.9.9:8017",
            "[::1]:8017",
            "gnp.example.org",
            "gnp.example.org:443",
            "b.example.org:9",
        ] {
            assert!(answers(&local, host), "{host}");
        }
        for host in [
            "",
            "localhost",
            "localhost:80",
            "localhost:",
            "localhost:8017x",
            "evil.example:8017",
            "localhost.evil.example:8017",
            "127.0.0.1.evil.example:8017",
            "192.168.1.5:8017",
            "b.example.org",
            "a@localhost:8017",
            "[::1",
        ] {
            assert!(!answers(&local, host), "{host}");
        }
        // Listening everywhere makes no other name one's own.
        let everywhere = doorkeeper("0.0.0.0:8017", &[]);
        assert!(answers(&everywhere, "127.0.0.1:8017") && !answers(&everywhere, "0.0.0.0:8017"));
        let one = doorkeeper("192.168.1.5:80", &[]);
        assert!(answers(&one, "192.168.1.5") && answers(&one, "192.168.1.5:80") && !answers(&one, "192.168.1.6"));
    }

    #[test]
    fn what_is_no_host_or_origin_is_refused_at_the_start() {
        let with = |hosts: &[&str], origins: &[&str]| {
            let owned = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
            let config = ServerConfig {
                allowed_hosts: owned(hosts),
                allowed_origins: owned(origins),
                ..ServerConfig::default()
            };
            Doorkeeper::new(&config, "127.0.0.1:1".parse().unwrap())
        };
        assert!(with(&["a.b", "a.b:1"], &["https://a.b", "http://localhost:3000"]).is_ok());
        for host in ["*", "http://a.b", "a b", "a:99999"] {
            assert!(with(&[host], &[]).is_err(), "{host}");
        }
        for origin in ["*", "null", "a.b", "https://a.b/", "ftp://a.b", "https://*.a.b"] {
            assert!(with(&[], &[origin]).is_err(), "{origin}");
        }
    }
}
