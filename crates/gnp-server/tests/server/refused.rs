//! What is refused, by what problem, naming which field.

use gnp_server::ServerConfig;
use serde_json::{Value, json};

use super::client::{Answer, RECORDING, Running};
use super::openapi::{assert_valid, description, schema};

/// Scene of two vehicles of 3 s, changed by `change`.
fn scene(change: impl FnOnce(&mut Value)) -> Value {
    let track = |x: f64, v: f64| -> Value {
        (0..31).map(|i| json!([0.1 * f64::from(i), x + v * 0.1 * f64::from(i), 1.8])).collect()
    };
    let mut scene = json!({
        "lines": [{"y": 0, "kind": "boundary"}, {"y": 3.7, "kind": "boundary"}],
        "vehicles": [{"id": "a", "track": track(0., 20.)}, {"id": "b", "track": track(40., 18.)}],
    });
    change(&mut scene);
    json!({ "scene": scene })
}

/// A moment of the recording, with one change of it.
fn changed(change: Value) -> Value {
    json!({"scene": {"recording": RECORDING, "time_s": 5}, "changes": [{"kind": "remove", "vehicle": "518"}, change]})
}

/// A moment of the recording, with other fields.
fn with(fields: Value) -> Value {
    let mut request = json!({"scene": {"recording": RECORDING, "time_s": 5}});
    request.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    request
}

/// The field that a problem names, and the row.
fn place(answer: &Answer) -> (String, Option<u64>) {
    let problem = answer.json();
    let error = &problem["errors"][0];
    assert!(problem["detail"].as_str().unwrap().len() > 5 && error["detail"].as_str().unwrap().len() > 5, "{problem}");
    (error["field"].as_str().unwrap().to_owned(), error["row"].as_u64())
}

#[test]
fn a_request_that_cannot_be_answered_says_which_field_is_wrong() {
    let description = description();
    let valid = schema(&description, "Problem");
    let server = Running::shared();
    let cases: Vec<(Value, u16, &str, &str)> = vec![
        (json!([1]), 422, "invalid-request", "body"),
        (json!({}), 422, "invalid-request", "body"),
        (json!([{"recording": RECORDING, "time_s": 5}]), 422, "invalid-request", "body"),
        (json!({"scene": [RECORDING, 0, 5, null, null, null]}), 422, "invalid-request", "scene"),
        (with(json!({"colour": 1})), 422, "invalid-request", "colour"),
        (with(json!({"": 1})), 422, "invalid-request", "body"),
        (with(json!({"changes": [{"kind": 1, "vehicle": "518"}]})), 422, "invalid-request", "changes[0].kind"),
        (changed(json!({"kind": "move", "vehicle": "533", "by": [1, 2, 3]})), 422, "invalid-request", "changes[1].by"),
        (
            scene(|it| it["vehicles"][1]["track"][4] = json!([0.4, 1, 2, 3])),
            422,
            "invalid-request",
            "scene.vehicles[1].track[4]",
        ),
        (with(json!({"k": -1})), 422, "invalid-request", "k"),
        (with(json!({"k": 0})), 422, "invalid-request", "k"),
        (with(json!({"k": 100_000})), 422, "invalid-request", "k"),
        (with(json!({"every_s": 0})), 422, "invalid-request", "every_s"),
        (with(json!({"every_s": 1e9})), 422, "invalid-request", "every_s"),
        (with(json!({"vehicles": ["542", "nobody"]})), 422, "unknown-vehicle", "vehicles[1]"),
        (json!({"scene": {}}), 422, "invalid-request", "scene"),
        (json!({"scene": {"recording": "nowhere", "time_s": 1}}), 404, "unknown-recording", "scene.recording"),
        (json!({"scene": {"recording": RECORDING}}), 422, "invalid-request", "scene.time_s"),
        (json!({"scene": {"recording": RECORDING, "time_s": 1e6}}), 422, "outside-recording", "scene.time_s"),
        (json!({"scene": {"recording": RECORDING, "time_s": -1}}), 422, "outside-recording", "scene.time_s"),
        (json!({"scene": {"recording": RECORDING, "time_s": 5, "road": 7}}), 422, "invalid-request", "scene.road"),
        (json!({"scene": {"recording": RECORDING, "time_s": 5, "lines": []}}), 422, "invalid-request", "scene.lines"),
        (json!({"scene": {"recording": RECORDING, "time_s": 5, "vehicles": []}}), 422, "invalid-request", "scene"),
        (changed(json!({"kind": "fly", "vehicle": "542"})), 422, "invalid-request", "changes[1].kind"),
        (changed(json!({"kind": "remove"})), 422, "invalid-request", "changes[1].vehicle"),
        (changed(json!({"kind": "remove", "vehicle": 542})), 422, "invalid-request", "changes[1].vehicle"),
        (changed(json!({"kind": "remove", "vehicle": "542", "by": [1, 1]})), 422, "invalid-request", "changes[1].by"),
        (changed(json!({"kind": "remove", "vehicle": "518"})), 422, "unknown-vehicle", "changes[1].vehicle"),
        (changed(json!({"kind": "remove", "vehicle": "999999"})), 422, "unknown-vehicle", "changes[1].vehicle"),
        (changed(json!({"kind": "move", "vehicle": "542", "by": [1e300, 0]})), 422, "invalid-change", "changes[1].by"),
        (changed(json!({"kind": "move", "vehicle": "542", "by": [1]})), 422, "invalid-request", "changes[1].by"),
        (changed(json!({"kind": "speed", "vehicle": "542", "mps": -1})), 422, "invalid-change", "changes[1].mps"),
        (changed(json!({"kind": "speed", "vehicle": "542", "mps": 1e30})), 422, "invalid-change", "changes[1].mps"),
        (
            changed(json!({"kind": "add", "vehicle": "542", "at": [0, 0], "mps": 5})),
            422,
            "invalid-change",
            "changes[1].vehicle",
        ),
        (
            changed(json!({"kind": "add", "vehicle": "", "at": [0, 0], "mps": 5})),
            422,
            "invalid-change",
            "changes[1].vehicle",
        ),
        (
            changed(json!({"kind": "add", "vehicle": "n", "at": [1e30, 0], "mps": 5})),
            422,
            "invalid-change",
            "changes[1].at",
        ),
        (
            changed(json!({"kind": "add", "vehicle": "n", "at": [90, 9], "mps": 5, "size": [0, 0]})),
            422,
            "invalid-change",
            "changes[1].size",
        ),
        (
            changed(json!({"kind": "add", "vehicle": "n", "at": [90, 9], "mps": 5, "class": "ship"})),
            422,
            "invalid-request",
            "changes[1].class",
        ),
        (changed(json!({"kind": "goal", "vehicle": "542", "at": [1e30, 0]})), 422, "invalid-change", "changes[1].at"),
        (changed(json!({"kind": "without_term", "term": "magic"})), 422, "unknown-term", "changes[1].term"),
        (scene(|scene| scene["vehicles"] = json!([])), 422, "invalid-tracks", "scene.vehicles"),
        (scene(|scene| scene["vehicles"][1]["id"] = json!("a")), 422, "invalid-tracks", "scene.vehicles[1].id"),
        (scene(|scene| scene["vehicles"][1]["id"] = json!("")), 422, "invalid-tracks", "scene.vehicles[1].id"),
        (
            scene(|scene| scene["vehicles"][1]["size"] = json!([900, 1])),
            422,
            "invalid-tracks",
            "scene.vehicles[1].size",
        ),
        (scene(|scene| scene["vehicles"][1]["track"] = json!([])), 422, "invalid-tracks", "scene.vehicles[1].track"),
        (
            scene(|scene| scene["vehicles"][1]["track"][3] = json!([0.3, 1])),
            422,
            "invalid-request",
            "scene.vehicles[1].track[3]",
        ),
        (
            scene(|scene| scene["vehicles"][1]["track"][3][1] = json!(null)),
            422,
            "invalid-request",
            "scene.vehicles[1].track[3][1]",
        ),
        (
            scene(|scene| scene["lines"] = json!([{"y": 3, "kind": "boundary"}, {"y": 0, "kind": "boundary"}])),
            422,
            "invalid-tracks",
            "scene.lines",
        ),
        (scene(|scene| scene["axis"] = json!([[0, 0]])), 422, "invalid-tracks", "scene.axis"),
        (scene(|scene| scene["time_s"] = json!(1)), 422, "invalid-request", "scene.time_s"),
        (scene(|scene| scene["speed"] = json!(1)), 422, "invalid-request", "scene.speed"),
    ];
    for (request, status, name, field) in cases {
        let answer = server.post("/v1/predict", &request);
        assert_eq!((answer.status, answer.problem().as_str()), (status, name), "{request}: {answer:?}");
        assert_valid(&valid, &answer.json(), name);
        assert_eq!(place(&answer).0, field, "{request}: {answer:?}");
    }
    let explain = |vehicle: &str, changes: Value| {
        server.post("/v1/explain", &with(json!({"vehicle": vehicle, "changes": changes})))
    };
    let gone = explain("542", json!([{"kind": "remove", "vehicle": "542"}]));
    assert_eq!(
        (gone.status, gone.problem().as_str(), place(&gone).0.as_str()),
        (422, "invalid-change", "changes[0].vehicle")
    );
    let nobody = explain("nobody", json!([]));
    assert_eq!(
        (nobody.status, nobody.problem().as_str(), place(&nobody).0.as_str()),
        (422, "unknown-vehicle", "vehicle")
    );
}

#[test]
fn a_bad_row_of_a_track_is_named() {
    let server = Running::shared();
    let cases: [(&str, Value, usize); 5] = [
        ("time goes back", json!([0.5, 50, 1.8]), 12),
        ("time stands still", json!([1.1, 50, 1.8]), 12),
        ("between two frames", json!([1.23, 62, 1.8]), 12),
        ("a huge place", json!([1.2, 1e300, 1.8]), 12),
        ("no place on earth", json!([1.2, 5e8, 1.8]), 12),
    ];
    for (what, row, number) in cases {
        let answer = server.post("/v1/predict", &scene(|scene| scene["vehicles"][1]["track"][number] = row));
        assert_eq!((answer.status, answer.problem().as_str()), (422, "invalid-tracks"), "{what}: {answer:?}");
        assert_eq!(
            place(&answer),
            (format!("scene.vehicles[1].track[{number}]"), Some(number as u64)),
            "{what}: {answer:?}"
        );
    }
}

#[test]
fn tracks_at_another_rate_are_refused() {
    let slow = |scene: &mut Value| {
        for vehicle in scene["vehicles"].as_array_mut().unwrap() {
            for row in vehicle["track"].as_array_mut().unwrap() {
                row[0] = json!(row[0].as_f64().unwrap() * 1.5);
            }
        }
    };
    let answer = Running::shared().post("/v1/predict", &scene(slow));
    assert_eq!((answer.status, answer.problem().as_str()), (422, "invalid-tracks"), "{answer:?}");
    assert!(answer.body.contains("Hz") || answer.body.contains("frames per second"), "{answer:?}");
}

#[test]
fn bodies_that_are_no_json_are_refused() {
    let server = Running::shared();
    let post =
        |kind: &str, body: &str| server.request("POST", "/v1/predict", &[&format!("Content-Type: {kind}")], body);
    for body in ["", "{", "scene=1", "{\"k\": NaN}", "{\"k\": 1e999}", "{\"scene\": {}} {}", "\u{feff}{}"] {
        let answer = post("application/json", body);
        assert_eq!((answer.status, answer.problem().as_str()), (400, "not-json"), "{body}: {answer:?}");
    }
    for kind in ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "", "application/json5"] {
        let answer = post(kind, "{}");
        assert_eq!((answer.status, answer.problem().as_str()), (415, "unsupported-media-type"), "{kind}: {answer:?}");
    }
    assert_eq!(server.request("POST", "/v1/predict", &[], "{}").status, 415);
    assert_eq!(post("Application/JSON; charset=UTF-8", "{").status, 400);
    assert_eq!(post("application/json;charset=\"utf-8\"", "{").status, 400);
    let packed = ["Content-Type: application/json", "Content-Encoding: gzip"];
    assert_eq!(server.request("POST", "/v1/predict", &packed, "{}").status, 415);
}

#[test]
fn what_is_too_large_is_refused() {
    let mut config = ServerConfig::default();
    (config.max_vehicles, config.max_body_bytes) = (20, 20_000);
    let server = Running::start(config);
    let many = |count: usize| -> Value {
        let vehicle = |i: usize| json!({"id": i.to_string(), "track": [[0, 30 * i, 1.8], [0.1, 30 * i + 2, 1.8]]});
        json!({"scene": {"vehicles": (0..count).map(vehicle).collect::<Vec<_>>()}})
    };
    assert_eq!(server.post("/v1/predict", &many(20)).status, 200);
    let answer = server.post("/v1/predict", &many(21));
    assert_eq!((answer.status, answer.problem().as_str()), (422, "too-many-vehicles"), "{answer:?}");
    let answer = server.post("/v1/predict", &many(10_000));
    assert_eq!((answer.status, answer.problem().as_str()), (413, "body-too-large"), "{answer:?}");
    // All of a recording at once, and some of it.
    let answer = server.post("/v1/predict", &with(json!({})));
    assert_eq!((answer.status, answer.problem().as_str()), (422, "too-many-vehicles"), "{answer:?}");
    assert_eq!(server.post("/v1/predict", &with(json!({"vehicles": ["542"]}))).status, 200);
    // Without a length the end of a body is known late.
    let part = "x".repeat(15_000);
    let chunk = format!("{:x}\r\n{part}\r\n", part.len());
    let head = format!("POST /v1/predict HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\n", server.address);
    let answer =
        server.raw(&format!("{head}Transfer-Encoding: chunked\r\nConnection: close\r\n\r\n{chunk}{chunk}0\r\n\r\n"));
    assert_eq!((answer.status, answer.problem().as_str()), (413, "body-too-large"), "{answer:?}");
    server.stop();
}

#[test]
fn who_asks_too_often_is_told_when_to_come_back() {
    let mut config = ServerConfig::default();
    config.requests_per_s = 3;
    let server = Running::start(config);
    let answers: Vec<Answer> = (0..6).map(|_| server.get("/healthz")).collect();
    assert!(answers[..3].iter().all(|answer| answer.status == 200), "{answers:?}");
    let refused = answers.iter().find(|answer| answer.status == 429).unwrap();
    assert_eq!((refused.problem().as_str(), refused.header("retry-after")), ("too-many-requests", Some("1")));
    server.stop();
}

#[test]
fn spans_of_tracks_that_are_not_there_are_refused() {
    let server = Running::shared();
    let tracks = |query: &str| server.get(&format!("/v1/recordings/{RECORDING}/tracks?{query}"));
    for (query, name) in [
        ("road=3", "invalid-request"),
        ("from_s=5&to_s=1", "invalid-request"),
        ("from_s=0&to_s=121", "invalid-request"),
        ("from_s=NaN", "invalid-request"),
        ("from_s=0&to_s=inf", "invalid-request"),
        ("from_s=1e9&to_s=1000000001", "outside-recording"),
        ("from_s=soon", "invalid-request"),
        ("from=1", "invalid-request"),
    ] {
        let answer = tracks(query);
        assert_eq!((answer.status, answer.problem().as_str()), (422, name), "{query}: {answer:?}");
    }
    assert_eq!(server.get("/v1/recordings/nowhere/tracks").problem(), "unknown-recording");
}

/// Names are those of the request, not the numbers that vehicles have inside.
#[test]
fn problems_call_vehicles_by_their_names() {
    let server = Running::shared();
    let refused = |changes: Value| {
        let mut request = scene(|_| ());
        request["changes"] = changes;
        let answer = server.post("/v1/predict", &request);
        assert_eq!(answer.status, 422, "{answer:?}");
        answer.json()["detail"].as_str().unwrap().to_owned()
    };
    let gone = json!([{"kind": "remove", "vehicle": "b"}, {"kind": "remove", "vehicle": "b"}]);
    assert_eq!(refused(gone), "vehicle b was removed by an earlier change; there are a");
    let like = json!([{"kind": "remove", "vehicle": "bb"}]);
    assert_eq!(refused(like), "there is no vehicle bb at this moment; there are a, b");
    let fast = json!([{"kind": "speed", "vehicle": "b", "mps": 101}]);
    assert_eq!(refused(fast), "vehicle b: a speed of 101 m/s is not between 0 and 100 m/s");
    let large = json!([{"kind": "add", "vehicle": "bus", "at": [20, 1.8], "mps": 20, "size": [99, 9]}]);
    assert!(refused(large).starts_with("vehicle bus: 99 m by 9 m is no size"));
    let again =
        json!([{"kind": "remove", "vehicle": "b"}, {"kind": "add", "vehicle": "b", "at": [20, 1.8], "mps": 20}]);
    assert_eq!(
        refused(again),
        "b is the name of another vehicle of this scene, or was; give the new one a name of its own"
    );
}
