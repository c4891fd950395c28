//! What is answered is what the library says.

use gnp_data::{Predictor as _, Recording, Snapshot};
use serde_json::{Value, json};

use super::client::{RECORDING, Running, model, recording};

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// The forecast of a vehicle in an answer.
fn of<'a>(answer: &'a Value, id: &str) -> &'a Value {
    let forecasts = answer["forecasts"].as_array().unwrap();
    forecasts.iter().find(|forecast| forecast["id"] == id).unwrap_or_else(|| panic!("no {id} in {answer}"))
}

/// The end of the prediction.
fn end(answer: &Value, id: &str) -> Vec<f64> {
    numbers(of(answer, id)["modes"][0]["path"].as_array().unwrap().last().unwrap())
}

fn predict(request: &Value) -> Value {
    let answer = Running::shared().post("/v1/predict", request);
    assert_eq!(answer.status, 200, "{request}: {answer:?}");
    answer.json()
}

fn changed(changes: Value) -> Value {
    predict(&json!({"scene": {"recording": RECORDING, "time_s": 5}, "changes": changes}))
}

#[test]
fn a_recording_is_predicted_as_by_the_library() {
    let (model, recording) = (model(), recording());
    let answer = changed(json!([]));
    let shape = model.gnp().shape();
    let snapshot = Snapshot::of(&recording, 50, shape).unwrap();
    assert_eq!((&answer["time_s"], answer["dt_s"].as_f64()), (&json!(recording.meta().time_s(50)), Some(0.2)));
    let there: Vec<_> = snapshot.vehicles().filter_map(|it| it.observation()).collect();
    let forecasts = model.gnp().predict(&there, model.card().predict.k).unwrap();
    assert!(there.len() > 20);
    assert_eq!(answer["forecasts"].as_array().unwrap().len(), there.len());
    for (seen, forecast) in there.iter().zip(forecasts) {
        let said = of(&answer, &recording.vehicle_name(seen.vehicle()));
        let near = |said: &Value, is: [f32; 2]| {
            numbers(said).iter().zip(is).all(|(said, is)| (said - f64::from(is)).abs() < 0.0055)
        };
        let origin = seen.origin();
        assert!(near(&said["at"], origin), "{said}");
        assert_eq!(said["leader"].as_str().map(str::to_owned), seen.leader().map(|it| it.vehicle().to_string()));
        let modes = said["modes"].as_array().unwrap();
        assert_eq!(modes.len(), forecast.modes.len());
        for (said, mode) in modes.iter().zip(&forecast.modes) {
            assert!((said["probability"].as_f64().unwrap() - f64::from(mode.probability)).abs() < 1e-4);
            let path = said["path"].as_array().unwrap();
            let every: Vec<_> = mode.path.iter().skip(1).step_by(2).collect();
            assert_eq!(path.len(), every.len());
            for (said, [x, y]) in path.iter().zip(every) {
                assert!(near(said, [origin[0] + x, origin[1] + y]), "{said} {x} {y}");
            }
        }
    }
}

#[test]
fn changes_do_what_they_say() {
    let before = changed(json!([]));
    let leader = of(&before, "542")["leader"].as_str().unwrap().to_owned();
    let ahead = of(&before, "554")["leader"].as_str().unwrap().to_owned();
    let back = changed(json!([{"kind": "move", "vehicle": ahead, "by": [-10, 0]}]));
    let moved = numbers(&of(&back, &ahead)["at"])[0] - numbers(&of(&before, &ahead)["at"])[0];
    assert!((moved + 10.).abs() < 0.011, "{moved}");
    assert!(end(&back, "554")[0] < end(&before, "554")[0] - 2., "a nearer leader holds back");
    let braked = changed(json!([{"kind": "speed", "vehicle": leader, "mps": 3}]));
    assert!(end(&braked, "542")[0] < end(&before, "542")[0] - 3., "{:?}", end(&braked, "542"));

    let without = changed(json!([{"kind": "remove", "vehicle": leader}]));
    assert!(without["forecasts"].as_array().unwrap().iter().all(|it| it["id"] != leader.as_str()));
    assert_ne!(of(&without, "542")["leader"], json!(leader));

    let new = json!({"kind": "add", "vehicle": "new 1", "at": [numbers(&of(&before, "542")["at"])[0] + 12., numbers(&of(&before, "542")["at"])[1]], "mps": 3});
    let added = changed(json!([new]));
    assert_eq!(of(&added, "542")["leader"], "new 1");
    assert_eq!((&of(&added, "new 1")["class"], &of(&added, "new 1")["velocity"]), (&json!("car"), &json!([3.0, 0.0])));
    assert!(end(&added, "542")[0] < end(&before, "542")[0] - 1.);
    // Who was added can be changed, too.
    let gone = changed(json!([new, {"kind": "remove", "vehicle": "new 1"}]));
    assert_eq!(end(&gone, "542"), end(&before, "542"));

    let drawn = changed(json!([{"kind": "goal", "vehicle": "542", "at": [40, 3]}]));
    assert!(end(&drawn, "542")[1] > end(&before, "542")[1] + 1.);
    let slow = changed(json!([{"kind": "speed", "vehicle": "542", "mps": 4}]));
    // As the model takes it from the past.
    assert!((numbers(&of(&slow, "542")["velocity"])[0] - 4.).abs() < 1., "{}", of(&slow, "542")["velocity"]);
    let calm =
        changed(json!([{"kind": "without_term", "term": "neighbours"}, {"kind": "without_term", "term": "lines"}]));
    assert_ne!(calm["forecasts"], before["forecasts"]);
}

#[test]
fn an_explanation_says_what_the_forecasts_are() {
    let server = Running::shared();
    let leader = of(&changed(json!([])), "542")["leader"].as_str().unwrap().to_owned();
    let changes = json!([{"kind": "remove", "vehicle": leader}]);
    let request = json!({"scene": {"recording": RECORDING, "time_s": 5}, "vehicle": "542", "changes": changes});
    let answer = server.post("/v1/explain", &request);
    assert_eq!(answer.status, 200, "{answer:?}");
    let answer = answer.json();
    let (before, after) = (changed(json!([])), changed(changes));
    for (account, forecasts) in [(&answer["as_it_is"], &before), (&answer["changed"], &after)] {
        let [said, is] = [&account["modes"], &of(forecasts, "542")["modes"]];
        assert_eq!(said.as_array().unwrap().len(), is.as_array().unwrap().len());
        for (said, is) in numbers(said[0]["path"].as_array().unwrap().last().unwrap()).iter().zip(end(forecasts, "542"))
        {
            assert!((said - is).abs() < 0.011, "{said} {is}");
        }
        // Constant velocity and the parts are the path.
        let last = |value: &Value| numbers(value.as_array().unwrap().last().unwrap());
        let parts = account["parts"].as_array().unwrap();
        for axis in 0..2 {
            let sum: f64 = parts.iter().map(|part| last(&part["displacement"])[axis]).sum();
            let path = last(&account["constant_velocity"])[axis] + sum;
            assert!((path - last(&account["path"])[axis]).abs() < 0.002, "{path}");
        }
        let steps = account["path"].as_array().unwrap().len();
        assert!(
            account["forces"]
                .as_array()
                .unwrap()
                .iter()
                .all(|force| force["values"].as_array().unwrap().len() == steps)
        );
        assert!(account["parameters"].as_array().unwrap().iter().any(|it| it["slots"] == true));
    }
    assert!(answer["as_it_is"]["parts"].as_array().unwrap().iter().any(|part| part["id"] == leader.as_str()));
    assert!(answer["change"]["sentence"].as_str().unwrap().contains(&leader), "{}", answer["change"]["sentence"]);
    // Fields of another kind of cause are left out, and a name is one of the scene in the difference, too.
    for part in ["as_it_is", "changed", "change"].iter().flat_map(|side| answer[side]["parts"].as_array().unwrap()) {
        let (kind, part) = (part["kind"].as_str().unwrap(), part.as_object().unwrap());
        let of_vehicle = matches!(kind, "leader" | "neighbour");
        assert!(part.contains_key("id") == of_vehicle && part.contains_key("vehicle") == of_vehicle, "{part:?}");
        assert_eq!(part.contains_key("place"), kind == "leader", "{part:?}");
    }
    let alone = server.post("/v1/explain", &json!({"scene": request["scene"], "vehicle": "542"})).json();
    assert_eq!((&alone["changed"], &alone["change"]), (&Value::Null, &Value::Null));
    assert_eq!(alone["as_it_is"], answer["as_it_is"]);
}

/// Its causes in the changed scene, and no difference from one in which it was not.
#[test]
fn a_vehicle_that_is_added_is_explained_as_it_is_then() {
    let server = Running::shared();
    let at = numbers(&of(&changed(json!([])), "542")["at"]);
    // Behind a vehicle, and ahead of another one.
    let new = json!({"kind": "add", "vehicle": "new 1", "at": [at[0] - 12., at[1]], "mps": 14});
    let changes = json!([new, {"kind": "without_term", "term": "lines"}]);
    let explain = |changes: &Value| {
        let scene = json!({"recording": RECORDING, "time_s": 5});
        server.post("/v1/explain", &json!({"scene": scene, "vehicle": "new 1", "changes": changes}))
    };
    let answer = explain(&changes);
    assert_eq!(answer.status, 200, "{answer:?}");
    let answer = answer.json();
    assert_eq!((&answer["as_it_is"], &answer["change"]), (&Value::Null, &Value::Null));
    assert_eq!((answer["vehicle_name"].as_str(), answer["segment"].as_u64()), (Some("new 1"), Some(0)));
    let account = &answer["changed"];
    let sentence = account["sentence"].as_str().unwrap();
    assert!(
        sentence.contains("vehicle new 1 gets ") && sentence.ends_with("is added: there is no forecast from before."),
        "{sentence}"
    );
    let leader = account["parts"].as_array().unwrap().iter().find(|part| part["kind"] == "leader").unwrap();
    assert_eq!((&leader["id"], &leader["place"]), (&json!("542"), &json!(1)));
    let forecasts = changed(changes);
    for (said, is) in
        numbers(account["modes"][0]["path"].as_array().unwrap().last().unwrap()).iter().zip(end(&forecasts, "new 1"))
    {
        assert!((said - is).abs() < 0.011, "{said} {is}");
    }
    for axis in 0..2 {
        let last = |value: &Value| numbers(value.as_array().unwrap().last().unwrap())[axis];
        let sum: f64 = account["parts"].as_array().unwrap().iter().map(|part| last(&part["displacement"])).sum();
        assert!((last(&account["constant_velocity"]) + sum - last(&account["path"])).abs() < 0.002);
    }
    // Who is added and gone has none.
    let gone = explain(&json!([new, {"kind": "remove", "vehicle": "new 1"}]));
    assert_eq!((gone.status, gone.problem().as_str()), (422, "invalid-change"));
    assert!(gone.json()["detail"].as_str().unwrap().contains("vehicle new 1 is the one that is explained"));
}

/// Tracks of a platoon, each place put into a plane.
fn tracks(place: impl Fn([f64; 2]) -> [f64; 2]) -> Value {
    let track = |x: f64, v: f64, y: f64| -> Vec<[f64; 3]> {
        let row = |i: i32| {
            let t = f64::from(i) / 10.;
            let [px, py] = place([x + v * t, y]);
            [t, px, py]
        };
        (0..31).map(row).collect()
    };
    let lines: Value = [0., 3.7, 7.4]
        .iter()
        .map(|y| json!({"y": y, "kind": if *y == 3.7 { "divider" } else { "boundary" }}))
        .collect();
    json!({"lines": lines, "vehicles": [
        {"id": "a", "size": [4.5, 1.8], "class": "car", "track": track(20., 22., 1.85)},
        {"id": "b", "size": [4.5, 1.8], "class": "car", "track": track(52., 17., 1.85)},
        {"id": "c", "size": [12, 2.5], "class": "truck", "track": track(30., 18., 5.55)},
        {"id": "late", "track": [[2.9, place([10., 5.55])[0], place([10., 5.55])[1]], [3.0, place([12., 5.55])[0], place([12., 5.55])[1]]]},
        {"id": "gone", "track": track(140., 20., 5.55)[..20].to_vec()},
        {"id": "sudden", "track": [[3.0, place([160., 1.85])[0], place([160., 1.85])[1]]]},
    ]})
}

#[test]
fn tracks_of_ones_own_are_predicted_where_they_are() {
    let straight = predict(&json!({"scene": tracks(|place| place)}));
    assert_eq!((of(&straight, "a")["leader"].as_str(), &of(&straight, "a")["at"]), (Some("b"), &json!([86.0, 1.85])));
    assert_eq!((&of(&straight, "a")["past"], &of(&straight, "late")["past"]), (&json!("full"), &json!("filled")));
    assert!(end(&straight, "a")[0] > 86. + 60. && (end(&straight, "a")[1] - 1.85).abs() < 1.5, "{straight}");
    let left_out: Vec<&str> =
        straight["left_out"].as_array().unwrap().iter().map(|it| it["id"].as_str().unwrap()).collect();
    assert_eq!(left_out, ["sudden", "gone"], "{}", straight["left_out"]);
    assert_eq!(straight["recording"], Value::Null);

    // The same road to the north, a kilometre away, and driven by its line.
    let north = |[x, y]: [f64; 2]| [1000. - y, 2000. + x];
    let mut scene = tracks(north);
    scene["axis"] = (0..=20).map(|i| json!(north([25. * f64::from(i), 0.]))).collect();
    let turned = predict(&json!({ "scene": scene }));
    for id in ["a", "b", "c", "late"] {
        let ends = [end(&turned, id), north([end(&straight, id)[0], end(&straight, id)[1]]).to_vec()];
        assert!(ends[0].iter().zip(&ends[1]).all(|(a, b)| (a - b).abs() < 0.05), "{id}: {ends:?}");
        let [v, w] = [&turned, &straight].map(|answer| numbers(&of(answer, id)["velocity"]));
        assert!((v[0] + w[1]).abs() < 0.03 && (v[1] - w[0]).abs() < 0.03, "{id}: {v:?} {w:?}");
    }
    // A place is given in the same plane.
    let request =
        json!({"scene": scene, "changes": [{"kind": "add", "vehicle": "new", "at": north([100., 1.85]), "mps": 9}]});
    let added = predict(&request);
    assert_eq!((of(&added, "a")["leader"].as_str(), &of(&added, "new")["at"]), (Some("new"), &json!([998.15, 2100.0])));
}

#[test]
fn tracks_of_a_recording_are_those_that_were_read() {
    let (recording, server) = (recording(), Running::shared());
    let get = |query: &str| server.get(&format!("/v1/recordings/{RECORDING}/tracks{query}")).json();
    let all = get("");
    let mut stretches = 0;
    for (vehicle, track) in all["vehicles"].as_array().unwrap().iter().zip(recording.tracks()) {
        assert_eq!(vehicle["id"], recording.vehicle_name(track.vehicle).as_ref());
        for (name, column) in [("x", &recording.columns().x), ("y", &recording.columns().y)] {
            let steps = numbers(&vehicle[name]);
            assert_eq!(steps.len(), track.rows.len());
            let mut place = 0.;
            for (step, is) in steps.iter().zip(&column[track.rows.clone()]) {
                place += step / 100.;
                assert!((place - f64::from(*is)).abs() < 0.0051, "{place} {is}");
            }
        }
        stretches += 1;
    }
    assert_eq!(stretches, recording.tracks().len());
    // Spans that meet are one.
    let frames = |value: &Value| value["frames"].as_u64().unwrap();
    let [from, to] =
        [all["from_s"].as_f64().unwrap(), all["from_s"].as_f64().unwrap() + 0.1 * (frames(&all) - 1) as f64];
    let (first, second) = (get(&format!("?to_s={}", from + 3.)), get(&format!("?from_s={}&to_s={to}", from + 3.1)));
    assert_eq!(frames(&first) + frames(&second), frames(&all));
    assert!((second["from_s"].as_f64().unwrap() - from - 3.1).abs() < 1e-9);
    let rows = |value: &Value| {
        value["vehicles"].as_array().unwrap().iter().map(|it| it["x"].as_array().unwrap().len()).sum::<usize>()
    };
    assert_eq!(rows(&first) + rows(&second), rows(&all));
}

#[test]
fn what_is_served_is_described() {
    let (recording, server) = (recording(), Running::shared());
    let listed = server.get("/v1/recordings").json();
    let said = &listed["recordings"][0];
    assert_eq!((said["name"].as_str(), said["simulated"].as_bool()), (Some(RECORDING), Some(false)));
    let vehicles: std::collections::BTreeSet<u32> = recording.tracks().iter().map(|track| track.vehicle).collect();
    assert_eq!(said["vehicles"], vehicles.len());
    assert_eq!(said["roads"][0]["lines"].as_array().unwrap().len(), Recording::roads(&recording)[0].lines.len());
    let card = server.get("/v1/model").json();
    assert_eq!((&card["name"], &card["k"]), (&json!("ngsim"), &json!(model().card().predict.k)));
    let terms: Vec<&str> =
        card["terms"].as_array().unwrap().iter().map(|term| term["name"].as_str().unwrap()).collect();
    assert!(["goal", "neighbours", "lines"].iter().all(|name| terms.contains(name)), "{terms:?}");
}

#[test]
fn metrics_count_what_was_done() {
    let server = Running::start(gnp_server::ServerConfig::default());
    let value = |name: &str| -> f64 {
        let text = server.get("/metrics").body;
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.trim().parse().ok());
        line.unwrap_or_else(|| panic!("no {name} in {text}"))
    };
    let request = json!({"scene": {"recording": RECORDING, "time_s": 5}, "vehicles": ["542", "544"]});
    assert_eq!(server.post("/v1/predict", &request).status, 200);
    assert_eq!(server.post("/v1/predict", &json!({})).status, 422);
    server.get("/no/such/page");
    assert_eq!(value("gnp_vehicles_predicted_total"), 2.);
    assert_eq!(value(r#"gnp_requests_total{route="/v1/predict",status="200"}"#), 1.);
    assert_eq!(value(r#"gnp_requests_total{route="/v1/predict",status="422"}"#), 1.);
    assert_eq!(value(r#"gnp_requests_total{route="other",status="404"}"#), 1.);
    assert_eq!(value(r#"gnp_requests_rejected_total{reason="invalid-request"}"#), 1.);
    assert_eq!(value(r#"gnp_request_duration_seconds_count{route="/v1/predict"}"#), 2.);
    assert_eq!((value("gnp_requests_dropped_total"), value("gnp_requests_in_flight")), (0., 1.));
    if cfg!(target_os = "linux") {
        assert!(value("gnp_resident_memory_bytes") > 1e6);
    }
    server.stop();
}
