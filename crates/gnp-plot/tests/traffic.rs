//! Drawings of traffic read back: what stands where.

#![allow(clippy::unwrap_used, clippy::expect_used)] // helpers of tests

mod drawing;

use drawing::{Element, labels, of, read};
use gnp_plot::{
    DetectorSeries, Figure, FlowDensity, Source, SpeedField, Trace, detector_series, flow_density, speed_field,
};

fn source(simulated: bool) -> Source {
    Source { words: "a made-up road".to_owned(), simulated }
}

fn diagram() -> FlowDensity {
    FlowDensity {
        title: "cells".to_owned(),
        lanes: vec![
            ("lane 1".to_owned(), vec![[10., 1080.], [20., 2160.]]),
            ("lane 2".to_owned(), vec![[60., 1440.], [100., 720.], [f64::NAN, 3.]]),
        ],
        free_speed: Some(30.),
        congested: Some([5., 140.]),
        capacity: Some(2100.),
    }
}

fn field() -> SpeedField {
    SpeedField {
        title: "lane 1".to_owned(),
        t: vec![0., 10., 20., 30.],
        x: vec![100., 200., 300.],
        // A slow cell that moves upstream, and one without a vehicle.
        speed: [[Some(25.), Some(2.)], [Some(2.), Some(25.)], [Some(25.), None]].concat(),
        traces: vec![Trace { points: vec![[0., 100.], [10., 300.]] }],
        wave_speed: Some(10.),
    }
}

fn detectors() -> Vec<DetectorSeries> {
    let of = |name: &str, flow: f64| DetectorSeries {
        name: name.to_owned(),
        time: vec![5., 15., 25.],
        flow: vec![flow, 0., flow],
        speed: vec![Some(20.), None, Some(25.)],
    };
    vec![of("lane 1", 1200.), of("lane 2", 900.)]
}

fn figures(simulated: bool) -> Vec<Figure> {
    let source = source(simulated);
    vec![
        flow_density(&diagram(), &source),
        speed_field(&field(), &source),
        detector_series("Detector", &detectors(), &source),
    ]
}

/// Corners of the frame of the axes: left, top, width, height.
fn frame(elements: &[Element]) -> [f64; 4] {
    let frame = of(elements, "rect", "axes")[0];
    ["x", "y", "width", "height"].map(|key| frame.number(key))
}

#[test]
fn points_and_branches_lie_where_they_are() {
    let elements = read(&figures(false)[0].svg);
    let points = |class: &str| elements.iter().filter(|e| e.is(class) && e.is("point")).collect::<Vec<_>>();
    // Two and its legend of either lane; what is not a number is not drawn.
    let (one, two) = (points("s0"), points("s1"));
    assert_eq!((one.len(), two.len()), (3, 3));
    let at = |point: &Element| [point.number("cx"), point.number("cy")];
    let ([x1, y1], [x2, y2]) = (at(one[1]), at(one[2]));
    let [left, top, _, height] = frame(&elements);
    // The second is twice as far from the origin.
    assert!((x2 - left - 2. * (x1 - left)).abs() < 0.05);
    assert!((top + height - y2 - 2. * (top + height - y1)).abs() < 0.05);
    let (per_k, per_q) = ((x2 - x1) / 10., (y2 - y1) / 1080.);
    let path = |class: &str| of(&elements, "path", class)[0].points();
    let value = |[x, y]: [f64; 2]| [(x - left) / per_k, (y - top - height) / per_q];
    let (free, congested) = (path("free"), path("congested"));
    // 30 m/s and 5 m/s upstream from 140 vehicles/km meet at 20 vehicles/km.
    let ([k, q], [jam, none]) = (value(free[1]), value(congested[1]));
    assert!((k - 20.).abs() < 0.1 && (q - 2160.).abs() < 8., "{k} {q}");
    assert!((jam - 140.).abs() < 0.2 && none.abs() < 5., "{jam} {none}");
    assert_eq!(congested[0], free[1]);
    assert!((value(path("capacity")[0])[1] - 2100.).abs() < 8.);
    assert!(figures(false)[0].svg.contains("free speed 108 km/h, capacity 2100 vehicles/h a lane"));
    assert!(figures(false)[0].svg.contains("congested branch: slope 18.0 km/h, jam 140 vehicles/km"));
}

#[test]
fn without_a_branch_none_is_drawn() {
    let bare = FlowDensity { free_speed: None, congested: None, capacity: None, ..diagram() };
    let elements = read(&flow_density(&bare, &source(false)).svg);
    for class in ["free", "congested", "capacity"] {
        assert!(of(&elements, "path", class).is_empty(), "{class}");
    }
    assert!(elements.iter().any(|e| e.text == "no congested branch"));
    let alone = FlowDensity { free_speed: None, ..diagram() };
    let elements = read(&flow_density(&alone, &source(false)).svg);
    // It ends at capacity, and does not leave the panel.
    let [_, top, ..] = frame(&elements);
    assert!(of(&elements, "path", "congested")[0].points()[0][1] > top);
}

#[test]
fn slow_is_dark_and_the_wave_falls_to_the_right() {
    let elements = read(&figures(false)[1].svg);
    let [left, top, width, height] = frame(&elements);
    let cells = of(&elements, "rect", "heat");
    assert_eq!(cells.len(), 6);
    let of_cell = |t: usize, x: usize| {
        let [cx, cy] = [left + width * (t as f64 + 0.5) / 3., top + height * (1. - (x as f64 + 0.5) / 2.)];
        let covers = |e: &&&Element| (e.centre()[0] - cx).abs() < 1. && (e.centre()[1] - cy).abs() < 1.;
        cells.iter().find(covers).expect("a cell").attributes["fill"].clone()
    };
    let light = |colour: &str| u32::from_str_radix(&colour[3..5], 16).unwrap();
    assert_eq!(of_cell(0, 1), of_cell(1, 0));
    assert!(light(&of_cell(0, 1)) < light(&of_cell(0, 0)));
    assert_eq!(of_cell(2, 1), "#e4e7ec");
    let wave = of(&elements, "path", "wave")[0].points();
    let metres = (wave[1][1] - wave[0][1]) / height * 200.;
    let seconds = (wave[1][0] - wave[0][0]) / width * 30.;
    assert!((metres / seconds - 10.).abs() < 0.1, "{metres} {seconds}");
    // The vehicle goes from the lower left corner to a third of the upper edge.
    let trace = of(&elements, "path", "trace")[0].points();
    assert!((trace[0][1] - top - height).abs() < 0.02 && (trace[1][0] - left - width / 3.).abs() < 0.02);
}

#[test]
fn an_interval_in_which_nobody_passed_has_a_flow_and_no_speed() {
    let elements = read(&figures(false)[2].svg);
    let markers = |class: &str| elements.iter().filter(|e| e.is(class) && e.is("marker")).count();
    // Legend, three flows and two speeds.
    assert_eq!([markers("s0"), markers("s1")], [6, 6]);
}

#[test]
fn figures_say_what_they_are_and_labels_stand_free() {
    for (figure, plain) in figures(true).into_iter().zip(figures(false)) {
        let says = |figure: &Figure| read(&figure.svg).iter().any(|e| e.is("source") && e.text.contains("simulated"));
        assert!(says(&figure) && !says(&plain) && figure.caption.contains("Simulated"));
        assert!(!figure.svg.contains("NaN") && !figure.svg.contains("inf"), "{}", figure.name);
        let placed = labels(&figure.svg);
        for (i, (text, [l, t, r, b])) in placed.iter().enumerate() {
            assert!(*l >= 0. && *r <= 340., "{}: {text} leaves the page", figure.name);
            for (other, [ol, ot, or, ob]) in &placed[i + 1..] {
                let apart = r <= ol || or <= l || b <= ot || ob <= t;
                assert!(apart, "{}: {text} lies on {other}", figure.name);
            }
        }
    }
}

#[test]
fn nothing_to_draw_is_drawn_without_a_fault() {
    let empty = FlowDensity { lanes: Vec::new(), ..diagram() };
    assert!(!flow_density(&empty, &source(false)).svg.contains("NaN"));
    let field = SpeedField { t: Vec::new(), x: Vec::new(), speed: Vec::new(), ..field() };
    assert!(of(&read(&speed_field(&field, &source(false)).svg), "rect", "heat").is_empty());
    assert!(!detector_series("none", &[], &source(false)).svg.contains("NaN"));
}
