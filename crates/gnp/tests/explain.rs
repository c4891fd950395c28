//! Forecasts explained: what adds up, what a changed scene changes, what cannot be asked.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod smoke;

use gnp::{AddedCar, Explained, NamedChange, Question, Run, Stage, WhatIf};
use gnp_data::{Account, Cause, EditedScene, Observation, OraclePredictor as _, Predictor as _, SceneEdit};
use tempfile::TempDir;

use smoke::{config, trained};

fn adds_up(account: &Account) {
    assert!(account.steps() == 50 && !account.parts.is_empty());
    for step in 1..=account.steps() {
        let (start, sum, path) = (account.constant_velocity(step), account.sum(step), account.path_at(step));
        for axis in 0..2 {
            assert!((start[axis] + sum[axis] - path[axis]).abs() < 1e-4, "step {step}: {start:?} {sum:?} {path:?}");
        }
    }
}

fn account(explained: &Explained) -> &Account {
    &explained.as_it_is.as_ref().unwrap().account
}

/// The nearest leader's part at the end, along the road.
fn leader(explained: &Explained) -> (u32, f32) {
    let parts = account(explained).parts.iter();
    let mut led = parts.filter_map(|part| match part.cause {
        Cause::Leader { vehicle, place: 1 } => Some((vehicle, part.at_end()[0])),
        _ => None,
    });
    led.next().unwrap()
}

#[test]
fn forecasts_come_apart_and_scenes_can_be_changed() {
    let place = TempDir::new().unwrap();
    let run = trained(config(&[]), &place.path().join("run"));

    // Without a word, one that a leader moves most.
    let explained = gnp::explain(&run, &Question::default()).unwrap();
    adds_up(account(&explained));
    let (ahead, part) = leader(&explained);
    assert!(part.abs() > 0.5 && explained.changed.is_none(), "{part}");
    let names = |explained: &Explained| explained.figures.iter().map(|figure| figure.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&explained), ["contributions"]);
    // Its figures stay in the run, whatever a stranger called the recording.
    let folder = explained.folder(&run).unwrap();
    assert!(folder.starts_with(run.path().join("explain")), "{}", folder.display());
    for name in ["../../elsewhere", "/elsewhere"] {
        let mut named = explained.clone();
        named.key.recording = name.to_owned();
        assert!(named.folder(&run).unwrap_err().to_string().contains("no name of something in this folder"));
    }

    // The same by its name; without its leader nobody else's part is his.
    let key = explained.key.clone();
    let asked = |changes: &[NamedChange]| Question {
        recording: Some(key.recording.clone()),
        vehicle: Some(key.vehicle.to_string()),
        frame: Some(key.t0),
        what_if: WhatIf { changes: changes.to_vec(), ..WhatIf::default() },
    };
    let called = |vehicle: u32| vehicle.to_string();
    let free = gnp::explain(&run, &asked(&[NamedChange::Remove { vehicle: called(ahead) }])).unwrap();
    assert_eq!((&free.as_it_is, &free.key), (&explained.as_it_is, &key));
    assert_eq!(names(&free), ["contributions", "what-if"]);
    let (changed, change) = (free.changed.clone().unwrap().account, free.change().unwrap());
    adds_up(&changed);
    adds_up(&change);
    let of =
        |account: &Account| account.parts.iter().filter(|it| it.cause.to_string().contains(&ahead.to_string())).count();
    assert_eq!(of(&changed), 0);
    let gone = change.parts.iter().find(|it| matches!(it.cause, Cause::Leader { vehicle, .. } if vehicle == ahead));
    assert!((gone.unwrap().at_end()[0] + part).abs() < 1e-5, "his part is gone");
    assert!(free.text().contains(&format!("Without vehicle {ahead}, vehicle {}", key.vehicle)), "{}", free.text());

    // A leader that stands lets it get less far than one that speeds.
    let at = |speed_mps| {
        let explained =
            gnp::explain(&run, &asked(&[NamedChange::Speed { vehicle: called(ahead), speed_mps }])).unwrap();
        explained.changed.unwrap().account.path_at(50)[0]
    };
    assert!(at(0.) < at(30.) - 1.);
    // So does one that is nearer, and one that is put between.
    let near = |by: f32| {
        let change = NamedChange::Move { vehicle: called(ahead), by: [by, 0.] };
        let explained = gnp::explain(&run, &asked(&[change])).unwrap();
        adds_up(&explained.change().unwrap());
        assert!(explained.text().contains(&format!("vehicle {ahead} moved {} m ", by.abs())), "{}", explained.text());
        explained.changed.unwrap().account.path_at(50)[0]
    };
    assert!(near(-4.) < near(30.) - 1., "{} {}", near(-4.), near(30.));
    let cars = vec![AddedCar { at: [7., 0.], speed_mps: 1. }, AddedCar { at: [-90., 40.], speed_mps: 1. }];
    let with_cars = |watch: Option<&str>| {
        let what_if = WhatIf { added: cars.clone(), watch: watch.map(str::to_owned), ..WhatIf::default() };
        gnp::explain(&run, &Question { what_if, ..asked(&[]) }).map_err(Box::new)
    };
    let added = with_cars(None).unwrap();
    assert!(
        added.text().contains("With a vehicle new 1 added at 1 m/s and with a vehicle new 2 added at 1 m/s, vehicle")
    );
    assert!(added.text().contains("leader new 1"), "{}", added.text());
    assert!(added.changed.as_ref().unwrap().account.path_at(50)[0] < account(&explained).path_at(50)[0] - 0.5);
    // That car itself has causes, and nothing from before.
    let of_car = with_cars(Some("new 1")).unwrap();
    assert!(of_car.as_it_is.is_none() && of_car.change().is_none() && of_car.name() == "new 1");
    adds_up(&of_car.changed.as_ref().unwrap().account);
    assert_eq!(names(&of_car), ["contributions"]);
    assert!(of_car.figures[0].svg.contains("new 1"));
    assert!(of_car.text().contains("Vehicle new 1 is added: there is no forecast from before."), "{}", of_car.text());
    assert_eq!(with_cars(Some(&called(key.vehicle))).unwrap().changed, added.changed);
    assert!(with_cars(Some("new 3")).unwrap_err().to_string().contains("new 1, new 2 (most like it"));
    // Its own speed changes where constant velocity leads.
    let slower =
        gnp::explain(&run, &asked(&[NamedChange::Speed { vehicle: called(key.vehicle), speed_mps: 1. }])).unwrap();
    adds_up(&slower.change().unwrap());
    assert!(slower.changed.unwrap().account.velocity[0] < account(&explained).velocity[0]);

    // A goal that is forced is what the true goal is when it is the recorded one.
    let gnp = run.model().unwrap();
    let set = run.windows().unwrap();
    let windows: Vec<_> = set.iter().filter(|window| window.key().recording == key.recording).take(3).collect();
    let seen: Vec<Observation<'_>> = windows.iter().map(|window| window.observation()).collect();
    let goals: Vec<Vec<[f32; 2]>> = windows.iter().map(|it| vec![it.truth().goal(), [5., 1.]]).collect();
    let towards = gnp.predict_towards(&seen, &goals).unwrap();
    for (towards, truth) in towards.iter().zip(gnp.true_goal().predict_with_future(&windows, 1).unwrap()) {
        assert_eq!(towards.modes.iter().map(|mode| mode.probability).collect::<Vec<_>>(), [0.5, 0.5]);
        let (a, b) = (&towards.modes[0].path, &truth.modes[0].path);
        assert!(a.iter().zip(b).all(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-4));
        assert_ne!(towards.modes[1].path, towards.modes[0].path);
    }
    let forced =
        gnp::explain(&run, &asked(&[NamedChange::Goal { vehicle: called(key.vehicle), at: [5., 1.] }])).unwrap();
    adds_up(&forced.changed.clone().unwrap().account);
    let by_flag = Question { what_if: WhatIf { goal: Some([5., 1.]), ..WhatIf::default() }, ..asked(&[]) };
    assert_eq!(gnp::explain(&run, &by_flag).unwrap().changed, forced.changed);
    assert!(gnp.predict_towards(&[], &[]).unwrap().is_empty());
    for wrong in [vec![], vec![vec![[1., 1.]]; 2], vec![vec![[1., 1.]], vec![], vec![]], vec![vec![[f32::NAN, 1.]]; 3]]
    {
        let error = gnp.predict_towards(&seen, &wrong).unwrap_err();
        assert!(std::error::Error::source(&error).unwrap().to_string().contains("goals"), "{error}");
    }

    what_is_not_there(&run, &explained);
    pictures(run, &place);
}

/// Errors name what there is.
fn what_is_not_there(run: &Run, explained: &Explained) {
    let key = &explained.key;
    let vehicle = key.vehicle.to_string();
    let refused = |question: Question, parts: &[&str]| {
        let error = gnp::explain(run, &question).unwrap_err().chain();
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    };
    let named = Question { vehicle: Some(vehicle.clone()), frame: Some(key.t0), ..Question::default() };
    refused(Question { recording: Some("nowhere".to_owned()), ..named.clone() }, &["nowhere", &key.recording]);
    refused(
        Question { vehicle: Some("999999".to_owned()), frame: None, ..named.clone() },
        &["999999", "vehicles with one"],
    );
    let recording = Some(key.recording.clone());
    let unseen = Question { vehicle: Some("999999".to_owned()), recording: recording.clone(), ..named.clone() };
    refused(unseen, &["999999", "vehicles in frame", &vehicle]);
    let early = Question { frame: Some(0), recording: recording.clone(), ..named.clone() };
    refused(early, &["frame 0", "it can in frames", &key.recording]);
    let at = Question { recording, ..named };
    let with = |change| Question { what_if: WhatIf { changes: vec![change], ..WhatIf::default() }, ..at.clone() };
    refused(with(NamedChange::Remove { vehicle: "999999".to_owned() }), &["999999", "there are "]);
    refused(with(NamedChange::Remove { vehicle: vehicle.clone() }), &["change 1", "is the one that is explained"]);
    refused(with(NamedChange::Speed { vehicle: vehicle.clone(), speed_mps: -1. }), &["-1 m/s"]);
    refused(with(NamedChange::Goal { vehicle: vehicle.clone(), at: [f32::NAN, 0.] }), &["a goal at NaN"]);
}

/// The run's own figures have the window in which deleting the leader changes most.
fn pictures(mut run: Run, place: &TempDir) {
    run.perform(Stage::Evaluate).unwrap();
    let figures = gnp::draw_figures(&mut run, None, &place.path().join("figures")).unwrap();
    let svg = |name: &str| &figures.iter().find(|figure| figure.name == name).unwrap().svg;
    let window = |svg: &str| {
        let (before, rest) = svg.split_once(", vehicle ").unwrap();
        let (vehicle, frame) = rest.split_once(", frame ").unwrap();
        let digits = |text: &str| text.chars().take_while(char::is_ascii_digit).collect::<String>();
        (before.rsplit('>').next().unwrap().to_owned(), digits(vehicle), digits(frame))
    };
    let shown = window(svg("what-if"));
    assert_eq!(window(svg("contributions")), shown);
    let gnp = run.model().unwrap();
    let set = run.windows().unwrap();
    let split = run.split(&set).unwrap();
    let moved = |seen: &Observation<'_>| {
        let leader = SceneEdit::Remove { vehicle: seen.leader()?.vehicle() };
        let scene = EditedScene::of(seen).with(&leader).unwrap();
        let ends = gnp.predict(&[*seen, scene.observation(seen.vehicle()).unwrap()], run.config().predict.k).unwrap();
        let end = |i: usize| *ends[i].modes[0].path.last().unwrap();
        Some((end(0)[0] - end(1)[0]).hypot(end(0)[1] - end(1)[1]))
    };
    let test = split.test().iter().filter_map(|id| set.get(*id)).map(|window| window.observation());
    let led: Vec<Observation<'_>> = test.filter(|seen| seen.leader().is_some()).collect();
    // Of more than 400 every n-th is looked at.
    let looked_at = || led.iter().step_by(led.len().div_ceil(400));
    let most = looked_at().filter_map(moved).fold(0., f32::max);
    let of_shown = looked_at()
        .find(|seen| {
            let key = seen.key();
            (key.recording, key.vehicle.to_string(), key.t0.to_string()) == shown
        })
        .and_then(moved)
        .unwrap();
    assert!(of_shown > most - 1e-2, "{of_shown} of {most}");
}
