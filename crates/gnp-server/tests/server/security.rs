//! Who is answered, and with what.

use gnp_server::ServerConfig;
use serde_json::json;

use super::client::{RECORDING, Running};

const JSON: &str = "Content-Type: application/json";

fn asking() -> String {
    json!({"scene": {"recording": RECORDING, "time_s": 5}, "vehicles": ["542"], "k": 1}).to_string()
}

#[test]
fn a_request_that_names_another_host_is_misdirected() {
    let server = Running::shared();
    let port = server.address.port();
    let get = |lines: &str| server.raw(&format!("GET {lines}Connection: close\r\n\r\n"));
    for good in [format!("127.0.0.1:{port}"), format!("localhost:{port}"), format!("[::1]:{port}")] {
        assert_eq!(get(&format!("/healthz HTTP/1.1\r\nHost: {good}\r\n")).status, 200, "{good}");
    }
    for bad in [
        "evil.example".to_owned(),
        format!("evil.example:{port}"),
        "127.0.0.1".to_owned(),
        format!("localhost:{}", port ^ 1),
    ] {
        for path in ["/", "/v1/model", "/no/such/page"] {
            let answer = get(&format!("{path} HTTP/1.1\r\nHost: {bad}\r\n"));
            assert_eq!((answer.status, answer.problem().as_str()), (421, "wrong-host"), "{bad}");
        }
    }
    // Without one, with two, and with another one in the first line.
    assert_eq!(get("/healthz HTTP/1.0\r\n").status, 421);
    let two = get(&format!("/healthz HTTP/1.1\r\nHost: localhost:{port}\r\nHost: evil.example\r\n"));
    assert!(matches!(two.status, 400 | 421), "{two:?}");
    let absolute = get(&format!("http://evil.example/healthz HTTP/1.1\r\nHost: localhost:{port}\r\n"));
    assert!(matches!(absolute.status, 400 | 421), "{absolute:?}");
}

#[test]
fn a_host_that_is_allowed_is_answered() {
    let mut config = ServerConfig::default();
    config.allowed_hosts = vec!["gnp.example.org".to_owned()];
    let server = Running::start(config);
    let get =
        |host: &str| server.raw(&format!("GET /healthz HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")).status;
    assert_eq!([get("gnp.example.org"), get("GNP.example.org:443"), get("www.gnp.example.org")], [200, 200, 421]);
    server.stop();
}

#[test]
fn pages_of_other_origins_are_refused_unless_listed() {
    let mut config = ServerConfig::default();
    config.allowed_origins = vec!["https://app.example.org".to_owned()];
    let server = Running::start(config);
    let own = format!("Origin: http://{}", server.address);
    let listed = "Origin: https://app.example.org";
    for origin in [own.as_str(), listed] {
        let answer = server.request("POST", "/v1/predict", &[JSON, origin], &asking());
        assert_eq!(answer.status, 200, "{answer:?}");
    }
    for origin in ["https://evil.example", "null", "http://localhost:1", "https://app.example.org.evil.example", ""] {
        for (method, path, body) in [("POST", "/v1/predict", asking()), ("GET", "/v1/model", String::new())] {
            let answer = server.request(method, path, &[JSON, &format!("Origin: {origin}")], &body);
            assert_eq!((answer.status, answer.problem().as_str()), (403, "origin-not-allowed"), "{origin}");
            assert_eq!(answer.header("access-control-allow-origin"), None);
        }
    }
    let answer = server.request("POST", "/v1/predict", &[JSON, listed], &asking());
    assert_eq!(answer.header("access-control-allow-origin"), Some("https://app.example.org"));
    // A browser asks before it sends JSON to another origin.
    let wanted = ["Access-Control-Request-Method: POST", "Access-Control-Request-Headers: content-type"];
    let preflight = |origin: &str| server.request("OPTIONS", "/v1/predict", &[origin, wanted[0], wanted[1]], "");
    let answer = preflight(listed);
    assert_eq!(answer.status, 200, "{answer:?}");
    assert_eq!(answer.header("access-control-allow-origin"), Some("https://app.example.org"));
    assert!(answer.header("access-control-allow-methods").unwrap().contains("POST"));
    assert!(answer.header("access-control-allow-headers").unwrap().contains("content-type"));
    let refused = preflight("Origin: https://evil.example");
    assert_eq!((refused.status, refused.header("access-control-allow-origin")), (403, None));
    server.stop();
}

#[test]
fn every_answer_says_what_a_browser_may_do_with_it() {
    let server = Running::shared();
    let misdirected = server.raw("GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n");
    for answer in [
        server.get("/"),
        server.get("/v1/model"),
        server.get("/no"),
        server.post("/v1/predict", &json!([])),
        misdirected,
    ] {
        let policy = answer.header("content-security-policy").unwrap_or_default();
        for part in [
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "connect-src 'self'",
            "frame-ancestors 'none'",
        ] {
            assert!(policy.contains(part), "{part}: {answer:?}");
        }
        assert!(!policy.contains("unsafe") && !policy.contains('*'), "{policy}");
        assert_eq!(answer.header("x-content-type-options"), Some("nosniff"));
        assert_eq!(answer.header("referrer-policy"), Some("no-referrer"));
        assert_eq!(answer.header("cross-origin-resource-policy"), Some("same-origin"));
    }
}

#[test]
fn the_page_holds_nothing_that_its_policy_forbids() {
    let page = Running::shared().get("/").body.to_lowercase();
    assert!(!page.contains("<style") && !page.contains(" style=") && !page.contains("javascript:"), "{page}");
    for tag in page.split("<script").skip(1) {
        assert!(tag.split('>').next().unwrap().contains("src=\"/page/"), "{tag}");
    }
    let handler = |word: &str| word.starts_with("on") && word.contains('=');
    assert!(!page.split_whitespace().any(handler), "an inline handler");
}

#[test]
fn no_path_leads_to_a_file() {
    let server = Running::shared();
    for path in [
        "/page/../../etc/passwd",
        "/page/..%2f..%2fetc%2fpasswd",
        "/page/%2e%2e/%2e%2e/Cargo.toml",
        "/page/%2e%2e%2fsrc%2flib.rs",
        "/page//etc/passwd",
        "/page/index.html%00.js",
        "/page/",
        "/page/lib.rs",
        "/page/%ff",
        "/v1/recordings/%ff/tracks",
        "/../Cargo.toml",
        "/%2e%2e/Cargo.toml",
        "/etc/passwd",
        "/v1/recordings/../../etc/passwd/tracks",
        "/v1/recordings/..%2fx/tracks",
        "/v1/recordings/%2e%2e/tracks",
        "/v1/recordings/us101-10_1.csv.gz/tracks",
    ] {
        let answer = server.get(path);
        assert_eq!(answer.status, 404, "{path}: {answer:?}");
        assert!(["not-found", "unknown-recording"].contains(&answer.problem().as_str()), "{path}");
    }
    let named = json!({"scene": {"recording": "../x", "time_s": 1}});
    assert_eq!(server.post("/v1/predict", &named).problem(), "unknown-recording");
}

#[test]
fn pages_are_for_reading() {
    let server = Running::shared();
    for path in ["/", "/page/play.css", "/v1/model", "/openapi.json"] {
        for method in ["POST", "PUT", "DELETE", "PATCH", "TRACE"] {
            let answer = server.request(method, path, &[], "");
            assert_eq!((answer.status, answer.problem().as_str()), (405, "method-not-allowed"), "{method} {path}");
            assert!(answer.header("allow").unwrap().contains("GET"), "{answer:?}");
        }
    }
    let head = server.request("HEAD", "/", &[], "");
    assert_eq!((head.status, head.body.as_str()), (200, ""));
    let answer = server.get("/v1/predict");
    assert_eq!((answer.status, answer.header("allow")), (405, Some("POST")));
}
