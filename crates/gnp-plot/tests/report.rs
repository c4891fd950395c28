//! The report: what it says, that it needs no network, and that its player works in a browser.

#![allow(clippy::unwrap_used, clippy::expect_used)] // helpers of tests

use std::path::Path;
use std::process::Command;

use gnp_plot::{
    Figure, PlayedForecast, PlayedLine, PlayedMode, PlayedParameter, PlayedRecording, PlayedStep, PlayedTerm, PlayedVehicle, Report,
    ReportTable,
};

/// Two vehicles for 10 s at 10 Hz; forecasts each second from 3 s on.
fn recording() -> PlayedRecording {
    let frames = 100;
    let vehicle = |id, y, class: &str| PlayedVehicle {
        id,
        class: class.to_owned(),
        test: id == 7,
        size: [450, 180],
        first: 0,
        x: (0..frames).map(|i| if i == 0 { 100 * id as i32 } else { 200 }).collect(),
        y: (0..frames).map(|i| if i == 0 { y } else { 0 }).collect(),
    };
    let step = PlayedStep {
        forces: vec![[1.5, 0.5], [-0.4, 0.1], [0., -0.3], [0.2, 0.]],
        parameters: vec![vec![0.8], vec![1.; 8]],
    };
    let parameter = |name: &str, slots| PlayedParameter {
        name: name.to_owned(),
        title: "a parameter".to_owned(),
        unit: "s".to_owned(),
        slots,
    };
    let term = |label: &str, colour: &str, parameters| PlayedTerm {
        label: label.to_owned(),
        unit: "m/s²".to_owned(),
        colour: colour.to_owned(),
        parameters,
    };
    let terms = vec![
        term("goal", "#f5c400", vec![parameter("tau", false)]),
        term("neighbours", "#0072b2", vec![parameter("k", true)]),
        term("lane lines", "#000000", Vec::new()),
        term("drag", "#7a5195", Vec::new()),
    ];
    let path = |side: i32| (1..=10).flat_map(|i| [1000 * i, side * i]).collect();
    let forecast = |frame: usize, vehicle: usize| PlayedForecast {
        vehicle,
        frame,
        at: [if vehicle == 0 { 700 } else { 2500 } + 200 * frame as i32, 350 * vehicle as i32],
        neighbours: vec![if vehicle == 0 { 1 } else { -2 }, -2, -2, -2, -2, -2, -2, -1],
        modes: vec![PlayedMode { p: 0.75, path: path(5) }, PlayedMode { p: 0.25, path: path(-20) }],
        steps: vec![step.clone(); 10],
    };
    PlayedRecording {
        simulated: true,
        rate: 10.,
        frames,
        observed: 3.,
        horizon: 5.,
        every: 0.5,
        terms,
        lines: [-175, 175, 525].map(|y| PlayedLine { y, boundary: y != 175 }).to_vec(),
        vehicles: vec![vehicle(7, 0, "car"), vehicle(25, 350, "<truck>")],
        forecasts: (30..frames).step_by(10).flat_map(|frame| [forecast(frame, 0), forecast(frame, 1)]).collect(),
    }
}

fn report() -> Report {
    let words = |list: &[&str]| list.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
    Report {
        title: "A run & its report".to_owned(),
        simulated: true,
        facts: vec![("split hash".to_owned(), "abc123".to_owned())],
        tables: vec![ReportTable {
            title: "Scores".to_owned(),
            head: words(&["model", "1 s"]),
            rows: vec![words(&["<gnp>", "0.51"])],
            notes: words(&["a note"]),
        }],
        figures: vec![Figure {
            name: "f".to_owned(),
            caption: "seen".to_owned(),
            svg: "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"4\" height=\"3\"></svg>\n".to_owned(),
        }],
        player: Some(recording()),
    }
}

#[test]
fn a_report_has_all_its_parts_and_escapes_them() {
    let page = report().html().unwrap();
    for part in [
        "A run &amp; its report",
        "<em>simulated</em>",
        "<dt>split hash</dt><dd>abc123</dd>",
        "<td>&lt;gnp&gt;</td><td>0.51</td>",
        "<p class=\"keys\">a note</p>",
        "<figcaption>seen</figcaption>",
        "\\u003ctruck>",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert_eq!(page, report().html().unwrap());
    let real = Report { simulated: false, player: None, ..report() }.html().unwrap();
    assert!(!real.contains("<em>simulated</em>") && !real.contains("application/json"));
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
    says("picked", "forecast made at 4.0 s, likeliest of 2: 75 %");
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
