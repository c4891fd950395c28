//! The report: what it says, that it needs no network, and that its player works in a browser.

#![allow(clippy::unwrap_used, clippy::expect_used)] // helpers of tests

use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use gnp_data::{Explanation, LaneMarking, MarkingKind, Mode, TermForces, VehicleClass};
use gnp_force::{Arity, TermDescriptor};
use gnp_plot::{
    Clip, ClipForecast, ClipNeighbour, ClipVehicle, Figure, Report, ReportCell, ReportSection, ReportTable, TimedState,
};

/// Two vehicles for 10 s at 10 Hz; forecasts each second from 3 s on.
fn clip() -> Clip {
    let mut clip = Clip::new("a recording", 10.);
    clip.simulated = true;
    (clip.first_frame, clip.frames) = (200, 100);
    (clip.observed_s, clip.predicted_s) = (3., 5.);
    clip.subset = "validation".to_owned();
    clip.lines = [-1.75, 1.75, 5.25]
        .map(|y| LaneMarking { y, kind: if y == 1.75 { MarkingKind::LaneDivider } else { MarkingKind::Boundary } })
        .to_vec();
    let term = |descriptor: &TermDescriptor, sources: usize, total: [f32; 2], parameter: f32| {
        let forces = vec![[0.; 2]; 50 * sources];
        let parameters = vec![vec![parameter; 50 * sources]; descriptor.varying().count()];
        TermForces::new(Arc::new(descriptor.clone()), sources, forces, parameters).with_totals(vec![total; 50])
    };
    let [goal, neighbours, lines, ..] = gnp_force::terms::<f32>().map(|term| term.descriptor());
    let drag = TermDescriptor::new("drag", Arity::One, "#7a5195").means("drag of the air", "drag");
    let terms = vec![
        term(goal, 1, [1.5, 0.5], 0.8),
        term(neighbours, 8, [-0.4, 0.1], 1.),
        term(lines, 3, [0., -0.3], 0.2),
        term(&drag, 1, [-0.2, 0.], 0.),
    ];
    let mode = |probability, side: f32| Mode {
        probability,
        path: (1..=50).map(|j| [2. * j as f32, 0.01 * side * j as f32]).collect(),
        explanation: (side > 0.).then(|| Explanation {
            goal: [100., 0.5],
            terms: terms.clone(),
            ..Explanation::default()
        }),
    };
    let vehicle = |id: u32, x: f32, y: f32, class| {
        let centre = |i: u32| [x + 2. * i as f32, y];
        let forecast = |i: u32| {
            let mut neighbours = [ClipNeighbour::Empty; 8];
            neighbours[7] = ClipNeighbour::Outside;
            if id == 7 {
                neighbours[0] = ClipNeighbour::Vehicle(1);
            }
            let history = (i - 30..=i).map(centre).collect();
            ClipForecast { frame: 200 + i, history, neighbours, modes: vec![mode(0.75, 1.), mode(0.25, -4.)] }
        };
        ClipVehicle {
            id,
            class,
            evaluated: id == 7,
            size: [4.5, 1.8],
            states: (0..100).map(|i| TimedState { frame: 200 + i, centre: centre(i), velocity: [20., 0.] }).collect(),
            forecasts: (30..100).step_by(10).map(forecast).collect(),
        }
    };
    clip.vehicles = vec![vehicle(7, 7., 0., VehicleClass::Car), vehicle(25, 25., 3.5, VehicleClass::Truck)];
    clip
}

fn words(list: &[&str]) -> Vec<String> {
    list.iter().map(|word| (*word).to_owned()).collect()
}

fn table(title: &str) -> ReportTable {
    let value = ReportCell { text: "0.51".to_owned(), interval: Some("(0.4 to 0.6)".to_owned()) };
    ReportTable {
        title: title.to_owned(),
        head: words(&["model", "1 s"]),
        rows: vec![vec!["<gnp>".into(), value]],
        notes: words(&["a note"]),
    }
}

fn figure(name: &str) -> Figure {
    Figure {
        name: name.to_owned(),
        caption: "seen".to_owned(),
        svg: "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"4\" height=\"3\"></svg>\n".to_owned(),
    }
}

fn report() -> Report {
    let mut report = Report::new("A run & its report", true);
    report.headline = "GNP ends < 6 m away.".to_owned();
    report.summary = Some(table(""));
    report.figures = vec![figure("error-by-horizon")];
    report.player = Some(clip());
    let mut details = ReportSection::new("Scores under clean");
    (details.tables, details.figures) = (vec![table("Scores")], vec![figure("modes")]);
    let mut others = ReportSection::new("Other protocols").folded();
    others.tables = vec![table("Best of 20")];
    let mut provenance = ReportSection::new("Provenance");
    provenance.facts = vec![("split hash".to_owned(), "abc123".to_owned())];
    report.sections = vec![details, others, provenance];
    report
}

#[test]
fn a_report_has_all_its_parts_and_escapes_them() {
    let page = report().html().unwrap();
    for part in [
        "A run &amp; its report",
        "<em>simulated</em>",
        "GNP ends &lt; 6 m away.",
        "<dt>split hash</dt><dd>abc123</dd>",
        "<th scope=\"row\">&lt;gnp&gt;</th><td>0.51 <small>(0.4 to 0.6)</small></td>",
        "<p class=\"keys\">a note</p>",
        "<figcaption>seen</figcaption>",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert_eq!(page, report().html().unwrap());
    let mut real = report();
    (real.simulated, real.player) = (false, None);
    let real = real.html().unwrap();
    assert!(!real.contains("<em>simulated</em>") && !real.contains("application/json"));
}

/// What was found comes first, what it rests on last, and what few ask for is folded away.
#[test]
fn a_report_opens_with_what_was_found() {
    let page = report().html().unwrap();
    let order = [
        "GNP ends",
        "class=\"summary\"",
        "id=\"figure-error-by-horizon\"",
        "id=\"player\"",
        "Scores under clean",
        "<h3>Scores</h3>",
        "id=\"figure-modes\"",
        "<summary><h2>Other protocols",
        "<h3>Best of 20</h3>",
        "</details>",
        "split hash",
    ];
    let places: Vec<usize> = order.iter().map(|part| page.find(part).unwrap_or_else(|| panic!("no {part}"))).collect();
    assert!(places.is_sorted(), "{:?}", order.iter().zip(&places).collect::<Vec<_>>());
    assert_eq!(page.matches("<details>").count(), 1);
    assert!(!page.contains("<h3></h3>"), "a table without a title has no heading");
}

/// Text of a recording cannot end the script that holds it.
#[test]
fn a_clip_is_short_text_that_stays_in_its_script() {
    let mut report = report();
    let clip = report.player.as_mut().unwrap();
    clip.subset = "</script>".to_owned();
    let page = report.html().unwrap();
    let from = page.find("id=\"recording\">").unwrap() + 15;
    let text = &page[from..from + page[from..].find("</script>").unwrap()];
    let json: serde_json::Value = serde_json::from_str(text).unwrap();
    assert_eq!(json["subset"], "</script>");
    assert_eq!((&json["rate"], &json["every"], &json["frames"]), (&10.0.into(), &0.5.into(), &100.into()));
    let truck = &json["vehicles"][1];
    assert_eq!((&truck["class"], &truck["first"], &truck["evaluated"]), (&"truck".into(), &0.into(), &false.into()));
    assert_eq!((&truck["x"][0], &truck["x"][1], &truck["y"][1]), (&2500.into(), &200.into(), &0.into()));
    let first = &json["forecasts"][0];
    assert_eq!(
        (&first["vehicle"], &first["frame"], &first["at"]),
        (&0.into(), &30.into(), &serde_json::json!([6700, 0]))
    );
    assert_eq!(first["neighbours"], serde_json::json!([1, -2, -2, -2, -2, -2, -2, -1]));
    // A point and a step each half second.
    assert_eq!(
        (first["modes"][0]["path"].as_array().unwrap().len(), &first["modes"][0]["path"][0]),
        (20, &1000.into())
    );
    assert_eq!(first["steps"].as_array().unwrap().len(), 10);
    assert_eq!(first["steps"][0]["forces"], serde_json::json!([[1.5, 0.5], [-0.4, 0.1], [0., -0.3], [-0.2, 0.]]));
    assert_eq!(first["steps"][0]["parameters"], serde_json::json!([[0.8], [1., 1., 1., 1., 1., 1., 1., 1.]]));
    let term = &json["terms"][3];
    assert_eq!((&term["label"], &term["colour"]), (&"drag of the air".into(), &"#7a5195".into()));
}

/// Nothing is fetched: no address but the name of SVG's namespace.
#[test]
fn a_report_needs_no_network() {
    let page = report().html().unwrap().replace("http://www.w3.org/2000/svg", "");
    for sign in ["http:", "https:", "//cdn", " src=", "@import", "url(h", "fetch(", "import("] {
        assert!(!page.contains(sign), "{sign}");
    }
}

/// Opens the report in a headless Chromium and uses it: steps, picks, toggles, plays, scrubs, hovers.
#[test]
fn the_player_works_in_a_browser() {
    let Some(browser) = browser() else {
        eprintln!("SKIPPED: no Chromium found (Debian: apt-get install chromium); the player was not driven");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let watch = "<script>window.__errors = []; addEventListener(\"error\", (e) => __errors.push(e.message));</script>";
    let driver = format!("<script>\n{}</script>\n</body>", include_str!("driver.js"));
    let page =
        report().html().unwrap().replacen("<head>", &format!("<head>{watch}"), 1).replacen("</body>", &driver, 1);
    let path = folder.path().join("report.html");
    std::fs::write(&path, page).unwrap();
    let dom = browse(browser, folder.path(), &["--virtual-time-budget=10000", "--dump-dom"], &path);
    let from = dom.find("<pre id=\"driven\">").expect("the driver did not finish") + 17;
    let text = dom[from..].split("</pre>").next().unwrap().replace("&lt;", "<").replace("&gt;", ">");
    let found: serde_json::Value = serde_json::from_str(&text).unwrap();
    let says = |key: &str, words: &str| {
        let said = found[key].as_str().unwrap_or_default();
        assert!(said.contains(words), "{key}: {said:?} without {words:?} in {found}");
    };
    assert_eq!(found["errors"], serde_json::json!([]), "{found}");
    says("start", "0.0 s, vehicle 7: 20.0 m/s, no forecast yet");
    assert!(found["colours"].as_u64().unwrap() > 5, "blank: {found}");
    says("stepped", "4.5 s");
    says("picked", "forecast made at 4.0 s, the first of 2: 75 % (validation subset)");
    assert!(found["forces"].as_u64().unwrap() > 10, "no yellow arrow: {found}");
    assert_eq!((&found["withoutForces"], &found["pressed"]), (&0.into(), &"false".into()));
    assert_eq!(found["played"], true, "{found}");
    says("scrubbed", "2.0 s");
    says("hover", "vehicle ");
    says("clicked", "vehicle ");
    says("addressed", "5.5 s, vehicle 25: ");
    says("ready", "10 s of traffic, 2 vehicles, 14 forecasts");
    assert_eq!(found["tip"], serde_json::json!([true, true]), "{found}");
    says("theme", "dark");
    // A picture of a blank page is a few kB.
    let picture = folder.path().join("report.png");
    let screenshot = format!("--screenshot={}", picture.display());
    browse(browser, folder.path(), &["--window-size=1200,900", "--virtual-time-budget=3000", &screenshot], &path);
    let size = std::fs::metadata(&picture).expect("a screenshot").len();
    assert!(size > 15_000, "{size} bytes");
}

fn browser() -> Option<&'static str> {
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    names
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success()))
}

/// What the browser prints.
fn browse(browser: &str, folder: &Path, arguments: &[&str], page: &Path) -> String {
    let profile = format!("--user-data-dir={}", folder.join("profile").display());
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", &profile])
        .args(arguments)
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned()
}
