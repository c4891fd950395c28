//! Drawings read back: what stands where.

#![allow(clippy::unwrap_used, clippy::expect_used)] // helpers of tests

mod drawing;

use std::sync::Arc;

use drawing::{Element, of, read};
use gnp_data::{Account, Cause, Contribution, Explanation, LaneMarking, MarkingKind, Mode, SLOTS, TermForces};
use gnp_plot::{
    Case, ChartPanel, Dot, DotPanel, DotRow, DotScaling, Figure, GivenMode, Intentions, LongitudinalForecast, Mark,
    Other, Potential, Scaling, Scene, Series, Source, SpaceTime, Trace, VehicleBox, WhatIf, cases, charts,
    contributions, dot_note, dot_rows, force_scenes, intentions, potential_field, reliability, reliability_bins,
    space_time, what_if,
};

const STEPS: usize = 25;

fn source(simulated: bool) -> Source {
    Source { words: "a made-up road".to_owned(), simulated }
}

/// A term whose force and parameter are the same in every step.
fn term(name: &str, sources: usize, total: [f32; 2], parameter: Vec<f32>) -> TermForces {
    let descriptor = Arc::new(gnp_force::term::<f32>(name).unwrap().descriptor().clone());
    let forces = vec![[0.; 2]; STEPS * sources];
    TermForces::new(descriptor, sources, forces, vec![parameter.repeat(STEPS)]).with_totals(vec![total; STEPS])
}

/// Three lanes; the target goes ahead and to the left; others at known places.
fn scene() -> Scene {
    let line = |kind, y| LaneMarking { kind, y };
    let path = |slope: f32| (1..=STEPS).map(|j| [2. * j as f32, slope * j as f32]).collect::<Vec<_>>();
    let explanation = Explanation {
        goal: [52., 4.],
        terms: vec![
            term("goal", 1, [1.5, 0.75], vec![0.7]),
            term("neighbours", SLOTS, [-0.5, -0.25], (0..SLOTS).map(|slot| if slot == 0 { 2. } else { 0. }).collect()),
            term("lines", 4, [0., -0.4], vec![0.3, 0.2, 0.2, 0.3]),
        ],
        ..Explanation::default()
    };
    let mode = |probability, slope, explanation| Mode { probability, path: path(slope), explanation };
    let other =
        |x, y| Other { now: VehicleBox { centre: [x, y], size: [5., 2.] }, history: vec![[x - 20., y], [x, y]] };
    Scene {
        title: "a scene".to_owned(),
        lines: vec![
            line(MarkingKind::Boundary, -5.25),
            line(MarkingKind::LaneDivider, -1.75),
            line(MarkingKind::LaneDivider, 1.75),
            line(MarkingKind::Boundary, 5.25),
        ],
        size: [4.5, 1.8],
        history: (0..11).map(|i| [2. * (i as f32 - 10.), 0.]).collect(),
        truth: path(0.15),
        lane_changes: vec![[24., 1.8]],
        others: vec![other(30., 3.5), other(-12., -3.5)],
        modes: vec![mode(0.5, 0.02, Some(explanation)), mode(0.3, 0.14, None), mode(0.2, -0.05, None)],
        dt: 0.2,
    }
}

fn every_figure(simulated: bool) -> Vec<Figure> {
    let (scene, source) = (scene(), source(simulated));
    let slots = std::array::from_fn(|slot| (slot == 0).then_some([30., 3.5]));
    let potential = Potential::of(&scene, &slots, 26.).unwrap();
    let modes = Intentions {
        centres: vec![vec![[10., 0.], [20., 0.]], vec![[9., 1.], [18., 3.]]],
        sizes: vec![40, 3],
        deviation_from: None,
        seconds: 5.,
    };
    let given = |probability, right, vehicle: usize| GivenMode { probability, right, vehicle };
    let modes_given = [given(0.1, false, 1), given(0.9, true, 2), given(0.4, true, 3), given(0.45, false, 4)];
    let bins = reliability_bins(&modes_given, 10, |_| Some([0.1, 0.9]));
    let lane = SpaceTime {
        title: "lane 2".to_owned(),
        traces: vec![Trace { points: vec![[0., 0.], [1., 10.], [2., 30.]] }],
        forecasts: vec![LongitudinalForecast { points: vec![[1., 10.], [3., 40.]] }],
    };
    let case = Case { kind: "left".to_owned(), scene: scene.clone() };
    vec![
        force_scenes("scenes", "Forces", std::slice::from_ref(&scene), 1., &source),
        cases(&[case], &source),
        potential_field(&scene, &potential, &source),
        intentions(&modes, &source),
        charts("errors", "Errors", "Errors.", &[chart()], &source),
        reliability(&bins, 6, 4, &source),
        space_time(&lane, &source),
        contributions("contributions", "What moved it", "a scene, vehicle 12", &account(), &source),
        changed_scene(&source),
        dot_rows("rows", "Rows of models", "Rows.", &rows_of_dots(), &source),
    ]
}

/// Parts whose ends are known, each growing in proportion to time; many are small.
fn account() -> Account {
    let part = |cause, end: [f32; 2]| Contribution {
        cause,
        displacement: (1..=STEPS).map(|j| end.map(|value| value * j as f32 / STEPS as f32)).collect(),
    };
    let leader = |vehicle, place| Cause::Leader { vehicle, place };
    let neighbour = |vehicle| Cause::Neighbour { vehicle };
    let mut parts = vec![
        part(Cause::FreeRoad, [2., 0.]),
        part(leader(34, 1), [-9., 0.]),
        part(leader(35, 2), [1., 0.]),
        part(Cause::Intention, [-3., 1.5]),
        part(Cause::Term("lines".to_owned()), [0., -0.5]),
    ];
    parts.extend((1..=8).map(|vehicle| part(neighbour(vehicle), [0.01 * vehicle as f32, 0.])));
    let explanation = Explanation { velocity: [10., 0.], contributions: parts, ..Explanation::default() };
    let mode = Mode { probability: 1., path: explanation.path(0.2), explanation: Some(explanation) };
    Account::of(12, &mode, 0.2).unwrap()
}

fn changed_scene(source: &Source) -> Figure {
    let at = scene().others[0].now;
    with_marks(source, &[Mark { label: "34".to_owned(), before: Some(at), after: None }], [0.; 2])
}

fn with_marks(source: &Source, marks: &[Mark], shift: [f32; 2]) -> Figure {
    let before = scene();
    let mut after = scene();
    after.others.remove(0);
    after.modes[0].path.iter_mut().for_each(|at| at[0] *= 1.1);
    let gone = Account {
        parts: account().parts.into_iter().filter(|part| part.cause.to_string() != "leader 34").collect(),
        velocity: [12., 0.],
        ..account()
    };
    let change = account().change_to(&gone);
    let what = "without vehicle 34";
    what_if(
        "what-if",
        "What if",
        &WhatIf { what, before: &before, after: &after, shift, marks, change: &change },
        source,
    )
}

fn rows_of_dots() -> Vec<DotPanel> {
    let dot = |value: f64| Some(Dot { value, interval: Some([0.8 * value, 1.2 * value]) });
    let row = |name: &str, uses_future, dots: &[Option<Dot>]| DotRow {
        name: name.to_owned(),
        uses_future,
        dots: dots.to_vec(),
        note: dot_note(12.345),
    };
    let panel = |scaling, columns: &[&str], rows| DotPanel {
        title: "RMSE of the prediction".to_owned(),
        axis: "RMSE (m)".to_owned(),
        scaling,
        columns: columns.iter().map(|c| (*c).to_owned()).collect(),
        notes: "5 s".to_owned(),
        rows,
    };
    let first = row("gnp", false, &[dot(1.), dot(4.)]);
    let errors =
        vec![first, row("constant acceleration", false, &[dot(2.), None]), row("uses_future", true, &[dot(3.), None])];
    let at = |value| Some(Dot { value, interval: None });
    let differences = vec![
        row("gnp", false, &[at(0.)]),
        row("a quarter of the modes", false, &[at(0.5)]),
        row("true goal", true, &[at(-9.)]),
    ];
    vec![panel(DotScaling::Log, &["1", "5"], errors), panel(DotScaling::Difference, &[], differences)]
}

/// The longest name begins within the picture.
#[test]
fn names_of_rows_are_not_cut() {
    let mut panels = rows_of_dots();
    let name = "neighbours at constant velocity";
    panels[1].rows[1].name = name.to_owned();
    let figure = dot_rows("rows", "Rows of models", "Rows.", &panels, &source(false));
    let text = figure.svg.split("<text").find(|text| text.contains(name)).unwrap();
    let x: f64 = text.split("x=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap().parse().unwrap();
    assert!(x >= 4.6 * name.len() as f64, "{x}: {text}");
}

#[test]
fn modes_say_what_they_are_deviations_from() {
    let modes = |deviation_from: Option<&str>| Intentions {
        centres: vec![vec![[1., 0.], [2., 0.]]],
        sizes: vec![4],
        deviation_from: deviation_from.map(str::to_owned),
        seconds: 5.,
    };
    let platoon = intentions(&modes(Some("the platoon")), &source(false));
    assert!(platoon.svg.contains("forward of where the platoon leads") && platoon.caption.contains("from the platoon"));
    assert!(intentions(&modes(None), &source(false)).svg.contains("forward of the vehicle"));
}

fn chart() -> ChartPanel {
    let series = |name: &str, factor: f64| Series {
        name: name.to_owned(),
        points: (1..=5).map(|s| [f64::from(s), factor * f64::from(s)]).collect(),
        band: (1..=5).map(|s| Some([0.8 * factor * f64::from(s), 1.2 * factor * f64::from(s)])).collect(),
    };
    ChartPanel {
        title: "RMSE".to_owned(),
        x: "time ahead (s)".to_owned(),
        y: "RMSE (m)".to_owned(),
        scaling: Scaling::FromZero,
        series: vec![series("gnp", 0.5), series("constant velocity", 1.)],
    }
}

/// From scene to drawing, taken from two boxes whose places are known.
struct Map {
    origin: [f64; 2],
    per_m: [f64; 2],
}

impl Map {
    fn of(elements: &[Element]) -> Self {
        let origin = of(elements, "rect", "target")[0].centre();
        let other = of(elements, "rect", "vehicle")[0].centre();
        Self { origin, per_m: [(other[0] - origin[0]) / 30., (other[1] - origin[1]) / 3.5] }
    }

    fn at(&self, p: [f32; 2]) -> [f64; 2] {
        std::array::from_fn(|i| self.origin[i] + self.per_m[i] * f64::from(p[i]))
    }
}

fn close(a: [f64; 2], b: [f64; 2]) -> bool {
    (a[0] - b[0]).abs() < 0.05 && (a[1] - b[1]).abs() < 0.05
}

#[test]
fn forward_is_right_and_left_is_up() {
    for figure in &every_figure(false)[..3] {
        let elements = read(&figure.svg);
        let map = Map::of(&elements);
        assert!(map.per_m[0] > 0. && map.per_m[1] < 0., "{}: {:?}", figure.name, map.per_m);
        let behind_right = of(&elements, "rect", "vehicle")[1].centre();
        assert!(close(behind_right, map.at([-12., -3.5])), "{}: {behind_right:?}", figure.name);
    }
}

#[test]
fn lane_lines_lie_where_they_are() {
    let elements = read(&every_figure(false)[0].svg);
    let map = Map::of(&elements);
    let lines: Vec<f64> = of(&elements, "line", "lane").iter().map(|line| line.number("y1")).collect();
    let expected = [-5.25, -1.75, 1.75, 5.25].map(|y| map.at([0., y])[1]);
    assert_eq!(lines.len(), 4);
    assert!(lines.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.05), "{lines:?} {expected:?}");
    assert_eq!(of(&elements, "line", "boundary").len(), 2);
}

/// Forces of a step act where the vehicle then is, and point where they push.
#[test]
fn arrows_start_at_the_vehicle_and_point_along_the_force() {
    let scene = scene();
    let elements = read(&every_figure(false)[0].svg);
    let map = Map::of(&elements);
    for (class, force) in [("goal", [1.5, 0.75]), ("neighbours", [-0.5, -0.25]), ("lines", [0., -0.4])] {
        let arrows: Vec<&Element> =
            of(&elements, "line", class).into_iter().filter(|e| e.is("arrow") && !e.is("key")).collect();
        // Rim and colour: two lines an arrow; steps 0, 5, .. 20.
        assert_eq!(arrows.len(), 2 * 5, "{class}");
        for (i, pair) in arrows.chunks(2).enumerate() {
            let at = if i == 0 { [0., 0.] } else { scene.modes[0].path[5 * i - 1] };
            let start = [pair[1].number("x1"), pair[1].number("y1")];
            assert!(close(start, map.at(at)), "{class} {i}: {start:?} is not {:?}", map.at(at));
        }
        // The tip is the first point of the head.
        let tip = elements.iter().find(|e| e.name == "path" && e.is("arrow") && !e.is("key") && e.is(class));
        let tip = tip.unwrap().points()[0];
        let drawn = [tip[0] - map.origin[0], map.origin[1] - tip[1]];
        let along =
            (drawn[0] * force[0] + drawn[1] * force[1]) / (drawn[0].hypot(drawn[1]) * f64::hypot(force[0], force[1]));
        assert!(along > 0.999, "{class}: {drawn:?} does not follow {force:?}");
    }
}

#[test]
fn arrows_have_one_scale() {
    let elements = read(&every_figure(false)[0].svg);
    let map = Map::of(&elements);
    let length = |class: &str| {
        let head = elements.iter().find(|e| e.name == "path" && e.is("arrow") && !e.is("key") && e.is(class)).unwrap();
        let tip = head.points()[0];
        (tip[0] - map.origin[0]).hypot(tip[1] - map.origin[1])
    };
    let (goal, lines) = (length("goal") / 1.5f64.hypot(0.75), length("lines") / 0.4);
    assert!((goal - lines).abs() < 0.01 * goal, "{goal} {lines}");
}

#[test]
fn a_stretched_axis_says_so() {
    let elements = read(&every_figure(false)[0].svg);
    let map = Map::of(&elements);
    let stretch = -map.per_m[1] / map.per_m[0];
    let label = elements.iter().find(|e| e.text.contains("stretched")).expect("the label");
    assert!(stretch > 1.5);
    assert_eq!(
        label.text,
        format!("forward of the vehicle (m); lateral axis stretched \u{d7}{}", (stretch * 2.).round() / 2.)
    );
    let target = of(&elements, "rect", "target")[0];
    assert!((target.number("width") / map.per_m[0] - 4.5).abs() < 0.02);
    assert!((target.number("height") / -map.per_m[1] - 1.8).abs() < 0.02);
}

#[test]
fn the_best_of_k_is_the_one_that_ends_nearest() {
    let scene = scene();
    let elements = read(&every_figure(false)[1].svg);
    let map = Map::of(&elements);
    let best = of(&elements, "path", "best");
    let end = *best[0].points().last().unwrap();
    assert_eq!((scene.best(), best.len()), (1, 1));
    assert!(close(end, map.at(scene.modes[1].path[STEPS - 1])), "{end:?}");
    assert_eq!(of(&elements, "path", "mode").len(), 2);
    let truth = of(&elements, "path", "truth")[0].points();
    assert!(close(truth[0], map.origin) && close(truth[12], map.at(scene.truth[11])));
    let past = of(&elements, "path", "past")[0].points();
    assert!(close(past[0], map.at([-20., 0.])) && close(past[10], map.origin));
}

#[test]
fn simulated_is_said_in_every_figure() {
    for (simulated, plain) in every_figure(true).iter().zip(every_figure(false)) {
        let says = |figure: &Figure| {
            read(&figure.svg).iter().any(|e| e.name == "text" && e.is("source") && e.text.contains("simulated"))
        };
        assert!(says(simulated) && simulated.caption.contains("Simulated"), "{}", simulated.name);
        assert!(!says(&plain), "{}", plain.name);
    }
}

#[test]
fn figures_are_whole_and_the_same_every_time() {
    for (figure, again) in every_figure(true).iter().zip(every_figure(true)) {
        assert_eq!(*figure, again);
        assert!(!figure.svg.contains("NaN") && !figure.svg.contains("inf"), "{}", figure.name);
        let elements = read(&figure.svg);
        assert_eq!(elements[0].number("width"), 340.);
        for text in elements.iter().filter(|e| e.name == "text") {
            let size = text.attributes.get("font-size").map_or(10., |size| size.parse::<f64>().unwrap());
            assert!(size >= 8.5, "{}: {text:?}", figure.name);
        }
    }
}

#[test]
fn axes_carry_units() {
    for figure in every_figure(false) {
        let elements = read(&figure.svg);
        let axes: Vec<String> = of(&elements, "text", "axes").iter().map(|e| e.text.clone()).collect();
        let bare =
            ["mode", "training futures", "modes", "probability given to a mode", "share nearest to the truth of 6"];
        for label in axes.iter().filter(|text| text.chars().any(char::is_alphabetic)) {
            assert!(label.contains('(') || bare.contains(&label.as_str()), "{}: {label}", figure.name);
        }
    }
}

/// Every letter has a glyph, no label lies on another, and none leaves the page.
#[test]
fn labels_stand_free() {
    for figure in every_figure(true) {
        let labels = drawing::labels(&figure.svg);
        assert!(labels.len() > 5, "{}", figure.name);
        for (i, (text, [left, top, right, bottom])) in labels.iter().enumerate() {
            assert!(*left >= 0. && *right <= 340. && *top >= 0., "{}: {text:?} leaves the page: {right}", figure.name);
            for (other, [l, t, r, b]) in &labels[..i] {
                let apart = *right <= *l || *r <= *left || *bottom <= *t || *b <= *top;
                assert!(apart, "{}: {text:?} lies on {other:?}", figure.name);
            }
        }
    }
}

#[test]
fn bars_lead_from_constant_velocity_to_the_path() {
    let elements = read(&every_figure(false)[7].svg);
    let names: Vec<&str> = of(&elements, "text", "name").iter().map(|e| e.text.as_str()).collect();
    let along = [
        "free road",
        "leader 34",
        "leader 35 (2 ahead)",
        "intention",
        "lines",
        "neighbour 7",
        "neighbour 8",
        "6 others together",
        "path",
    ];
    assert_eq!(names, [along, along].concat());
    // Each begins where the last one ended; the sum is as far from zero as all of them lead.
    let bars = &of(&elements, "rect", "bar")[..9];
    let zero = of(&elements, "line", "zero")[0].number("x1");
    let lengths = [2., -9., 1., -3., 0., 0.07, 0.08, 0.21, -8.64];
    let per_m = bars[1].number("width") / 9.;
    let mut at = zero;
    for (bar, length) in bars.iter().zip(lengths) {
        let from = if bar.is("sum") { zero } else { at };
        let [left, right] = [bar.number("x"), bar.number("x") + bar.number("width")];
        let (start, end) = if length < 0. { (right, left) } else { (left, right) };
        assert!((start - from).abs() < 0.1 && (end - start - length * per_m).abs() < 0.1, "{bar:?}");
        at = end;
    }
    let numbers: Vec<&str> = of(&elements, "text", "number").iter().map(|e| e.text.as_str()).collect();
    assert_eq!((numbers[1], numbers[8], numbers[12]), ("\u{2212}9.00", "\u{2212}8.64", "+1.50"));
    // The line of the growth ends at the sum, between the stacks.
    let line = of(&elements, "path", "sum")[0].points();
    let growth: Vec<_> = of(&elements, "path", "stacked").iter().map(|path| path.points()).collect();
    let level = |points: &[[f64; 2]]| points.last().unwrap()[1];
    let lowest = growth.iter().map(|points| level(points)).fold(f64::NEG_INFINITY, f64::max);
    let highest = growth.iter().map(|points| level(points)).fold(f64::INFINITY, f64::min);
    // 3.36 m are stacked up and 12 m down.
    let share = (level(&line) - highest) / (lowest - highest);
    assert!((share - (3.36 + 8.64) / 15.36).abs() < 0.005, "{share}");
    assert!((line[0][1] - line[STEPS][1]).abs() > 20. && line.len() == STEPS + 1);
}

#[test]
fn a_changed_scene_has_the_scale_of_the_first_and_shows_who_is_gone() {
    let elements = read(&every_figure(false)[8].svg);
    let (before, after): (Vec<_>, Vec<_>) = of(&elements, "rect", "target").into_iter().partition(|e| !e.is("changed"));
    assert_eq!((before[0].number("x"), before[0].number("width")), (after[0].number("x"), after[0].number("width")));
    let marks = of(&elements, "rect", "mark");
    let dashed = |e: &Element| e.attributes.contains_key("stroke-dasharray");
    assert_eq!(
        marks.iter().map(|mark| (mark.is("changed"), dashed(mark))).collect::<Vec<_>>(),
        [(false, false), (true, true)]
    );
    assert_eq!(of(&elements, "rect", "vehicle").len(), 3);
    // The first prediction is where it was.
    let first = of(&elements, "path", "best")[0].points();
    let ghost = of(&elements, "path", "as-it-is")[0].points();
    assert!(first.iter().zip(&ghost).all(|(a, b)| (a[0] - b[0]).abs() < 0.01));
    // Its end is seen also where the second one lies on it.
    let [x, y] = ghost[STEPS];
    let ends = of(&elements, "circle", "as-it-is");
    assert!((ends[0].number("cx") - x).abs() < 0.01 && (ends[0].number("cy") - y).abs() < 0.01 && ends.len() == 1);
    let second = of(&elements, "path", "best")[1].points();
    assert!(second[STEPS][0] > ghost[STEPS][0] + 5.);
    let names: Vec<&str> = of(&elements, "text", "name").iter().map(|e| e.text.as_str()).collect();
    assert_eq!(names, ["constant velocity", "leader 34", "difference"]);
}

#[test]
fn a_moved_vehicle_is_dashed_where_it_was_and_an_added_one_is_in_the_changed_scene_alone() {
    let at = |x: f32| Some(VehicleBox { centre: [x, 0.], size: [4., 2.] });
    let mark = |label: &str, before, after| Mark { label: label.to_owned(), before, after };
    let source = Source { words: "test".to_owned(), simulated: false };
    let marks = [mark("34", at(30.), at(18.)), mark("new 1", None, at(60.)), mark("35", at(50.), at(48.))];
    // The vehicle itself is 2 m farther: all others are 2 m less far from it.
    let elements = read(&with_marks(&source, &marks, [-2., 0.]).svg);
    let rects = of(&elements, "rect", "mark");
    let middle = |e: &Element| e.number("x") + e.number("width") / 2.;
    let found: Vec<(bool, bool)> =
        rects.iter().map(|e| (e.is("changed"), e.attributes.contains_key("stroke-dasharray"))).collect();
    // Before: 34 and 35; then 34, its ghost, the new one, and 35, which stays.
    assert_eq!(found, [(false, false), (false, false), (true, false), (true, true), (true, false), (true, false)]);
    let metre = (middle(rects[1]) - middle(rects[0])) / 20.;
    assert!((middle(rects[3]) - middle(rects[2]) - 10. * metre).abs() < 0.05, "30 m less 2 is 10 m beyond 18");
    // So is the prediction as it is.
    let (first, ghost) = (of(&elements, "path", "best")[0].points(), of(&elements, "path", "as-it-is")[0].points());
    assert!((first[0][0] - ghost[0][0] - 2. * metre).abs() < 0.05, "{:?} {:?}", first[0], ghost[0]);
    let labels: Vec<&str> = of(&elements, "text", "label").iter().map(|e| e.text.as_str()).collect();
    assert_eq!(labels, ["34", "35", "34", "new 1", "35"]);
}

#[test]
fn rows_of_dots_stand_at_their_values() {
    let figure = every_figure(false).pop().unwrap();
    let elements = read(&figure.svg);
    let dots = of(&elements, "circle", "row");
    assert_eq!(dots.len(), 6);
    // Logarithmic: 1 to 2 is as far as 2 to 4.
    let x = |i: usize| dots[i].number("cx");
    assert!((x(2) - x(0) - (x(1) - x(2))).abs() < 0.05, "{} {} {}", x(0), x(2), x(1));
    assert!(dots[3].is("uses_future") && dots[3].attributes["fill"] == "#fff" && dots[0].attributes["fill"] != "#fff");
    let interval = of(&elements, "line", "interval")[0];
    assert!(interval.number("x1") < x(0) && interval.number("x2") > x(0));
    assert!(elements.iter().any(|e| e.text.contains("future input")));
    // The second panel shows differences: zero is drawn, and what is worse lies right of it.
    let zero = of(&elements, "line", "zero")[0].number("x1");
    assert!((x(4) - zero).abs() < 0.01 && x(5) > zero + 5.);
    // What is handed the future does not set the axis: it lies beyond, on the better side.
    let beyond = of(&elements, "path", "beyond")[0];
    assert!(beyond.is("uses_future") && beyond.points()[0][0] < zero);
}

#[test]
fn nothing_at_all_is_drawn_without_breaking() {
    let empty = Scene {
        lines: Vec::new(),
        history: Vec::new(),
        truth: Vec::new(),
        lane_changes: Vec::new(),
        others: Vec::new(),
        modes: Vec::new(),
        ..scene()
    };
    let nowhere = Scene { truth: vec![[f32::NAN, 1.], [f32::INFINITY, 2.]], ..scene() };
    let no_lane = SpaceTime { title: String::new(), traces: Vec::new(), forecasts: Vec::new() };
    let none = Intentions {
        centres: Vec::new(),
        sizes: Vec::new(),
        deviation_from: Some("the platoon".to_owned()),
        seconds: 5.,
    };
    let source = source(false);
    for figure in [
        force_scenes("scenes", "Forces", &[empty, nowhere], 1., &source),
        force_scenes("scenes", "Forces", &[], 1., &source),
        cases(&[], &source),
        intentions(&none, &source),
        charts("errors", "Errors", "", &[ChartPanel { series: Vec::new(), ..chart() }], &source),
        reliability(&[], 6, 0, &source),
        space_time(&no_lane, &source),
    ] {
        read(&figure.svg);
        assert!(!figure.svg.contains("NaN"), "{}", figure.name);
    }
}

#[test]
fn larger_errors_are_higher_and_intervals_lie_around() {
    let elements = read(&every_figure(false)[4].svg);
    let series = of(&elements, "path", "series");
    let (gnp, constant) = (series[0].points(), series[1].points());
    assert!(gnp.iter().zip(&constant).all(|(a, b)| a[0] == b[0] && a[1] > b[1]));
    // The axis begins at 0, so heights are in proportion.
    let bottom = of(&elements, "rect", "axes")[0];
    let zero = bottom.number("y") + bottom.number("height");
    assert!(((zero - constant[4][1]) / (zero - gnp[4][1]) - 2.).abs() < 0.01);
    let band = of(&elements, "path", "interval")[0].points();
    assert!(band[4][1] < gnp[4][1] && band[5][1] > gnp[4][1]);
    assert_ne!(series[0].attributes["stroke"], series[1].attributes["stroke"]);
    assert_ne!(series[0].attributes["stroke-dasharray"], series[1].attributes["stroke-dasharray"]);
}

#[test]
fn time_runs_right_and_the_road_up() {
    let elements = read(&every_figure(false)[6].svg);
    let forecast = of(&elements, "path", "forecast")[0].points();
    assert!(forecast[1][0] > forecast[0][0] && forecast[1][1] < forecast[0][1]);
    let trace: Vec<[f64; 2]> = of(&elements, "path", "trace").iter().flat_map(|e| e.points()).collect();
    assert!(close(trace[1], forecast[0]), "the forecast begins where the vehicle is");
}

#[test]
fn the_potential_is_that_of_the_laws() {
    let scene = scene();
    let slots = std::array::from_fn(|slot| (slot == 0).then_some([30., 3.5]));
    let potential = Potential::of(&scene, &slots, 26.).unwrap();
    // At the neighbour: 26 m times 2 m/s², and the lines 1.75 m beside it.
    let centre = 0.2 * ((-1.75f64 * 1.75).exp() + (-16f64).exp());
    let edge = 0.5 * 0.3 / (1.75 * 1.75) + 0.5 * 0.3 / (8.75 * 8.75);
    let value = potential.at(&scene, 30., 3.5);
    assert!((value - (52. + centre + edge)).abs() < 1e-3, "{value}");
    assert!(potential.at(&scene, 0., 0.) < value);
    // Beyond an edge it rises on: back to the road is down.
    assert!(potential.at(&scene, 0., 6.) > potential.at(&scene, 0., 5.));
    assert!(potential.at(&scene, 0., -6.) > potential.at(&scene, 0., -5.));
}
