//! Terms of the force that are switched off, in the model that comes with the program and on recorded traffic.

use allocation_counter::measure;
use gnp_data::{Account, Cause, Explanation, WindowConfig, WindowSet};
use gnp_model::{Forecasts, Workspace};

use super::into::{difference, recorded};
use super::*;

const NAMES: [&str; 6] = ["goal", "neighbours", "lines", "free_road", "car_following", "habit"];

fn shipped() -> Gnp {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/ngsim");
    Gnp::open(&folder, &Device::Cpu).unwrap().explaining(true)
}

fn traffic() -> Vec<Recording> {
    recorded(Dataset::NGSIM, "ngsim", 10.)
}

/// Windows of the recordings, `count` of them, far from each other.
fn some(recordings: &[Recording], count: usize) -> Vec<Observation<'_>> {
    let site_stride_s = BTreeMap::new();
    let config = WindowConfig { observed_s: 3., predicted_s: 5., rate_hz: 10., stride_s: 1., site_stride_s };
    let (set, _) = WindowSet::cut(recordings, &config).unwrap();
    set.iter().step_by(set.len() / count).map(|window| window.observation()).take(count).collect()
}

/// The forces that make a path by cause, and the term that makes each of them.
fn is_of(cause: &Cause) -> &str {
    match cause {
        Cause::FreeRoad => "habit",
        Cause::Leader { .. } => "car_following",
        Cause::Intention => "goal",
        Cause::Neighbour { .. } => "neighbours",
        Cause::Term(name) => name,
        _ => "told apart nowhere",
    }
}

fn close(a: &[[f32; 2]], b: &[[f32; 2]], tolerance: f32, what: &str) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (a, b) in a.iter().zip(b) {
        assert!((a[0] - b[0]).abs() < tolerance && (a[1] - b[1]).abs() < tolerance, "{what}: {a:?} {b:?}");
    }
}

#[test]
fn what_is_off_exerts_no_force_and_the_rest_still_adds_up() {
    let (model, recordings) = (shipped(), traffic());
    let dt = model.shape().dt() as f32;
    let observations = some(&recordings, 3);
    let mut workspace = Workspace::new();
    assert_eq!(model.term_descriptors().iter().map(|term| &*term.name).collect::<Vec<_>>(), NAMES);
    for mask in 0..1 << NAMES.len() {
        let off: Vec<&str> = (0..NAMES.len()).filter(|i| mask & (1 << i) != 0).map(|i| NAMES[i]).collect();
        let on: Vec<&str> = NAMES.into_iter().filter(|name| !off.contains(name)).collect();
        let model = model.without_terms(&off).unwrap();
        let apart = difference(&model, &observations, 2, &mut workspace);
        assert!(workspace.is_lean() && apart < 1e-4, "without {off:?}: {apart}");
        for forecast in model.predict(&observations, 2).unwrap() {
            for mode in &forecast.modes {
                let why = mode.explanation.as_ref().unwrap();
                assert_eq!(why.terms.iter().map(|term| &*term.term().name).collect::<Vec<_>>(), on);
                let sum = why.path(dt);
                close(&sum, &mode.path, 1e-4, &format!("without {off:?}"));
                // Where nothing moves it, the free road stands alone, with 0.
                let still = why.contributions.len() == 1 && why.contributions[0].at_end() == [0.; 2];
                let unwanted = why.contributions.iter().find(|part| off.contains(&is_of(&part.cause)));
                assert!(why.contributions.iter().all(|part| NAMES.contains(&is_of(&part.cause))));
                assert!(unwanted.is_none() || still, "without {off:?}: {unwanted:?}");
                if on.is_empty() {
                    let straight: Vec<_> = (1..=50).map(|step| why.velocity.map(|v| v * dt * step as f32)).collect();
                    close(&mode.path, &straight, 1e-4, "constant velocity");
                }
            }
            assert!(Account::of(1, &forecast.modes[0], f64::from(dt)).is_some());
        }
        let towards = model.predict_towards(&observations, &[[[90., 0.]]; 3].map(|goal| goal.to_vec())).unwrap();
        let ends =
            towards.iter().map(|forecast| forecast.modes[0].explanation.as_ref().unwrap().term("goal").is_some());
        assert!(ends.clone().all(|pulled| pulled != off.contains(&"goal")));
    }
}

/// The path of the platoon is what is left without the network's forces; its leaders' part is what car following makes.
#[test]
fn each_term_takes_its_own_part_along() {
    let (model, recordings) = (shipped(), traffic());
    let site = recordings[0].meta().site.clone();
    let observations: Vec<_> = some(&recordings, 12).into_iter().filter(|it| it.leader().is_some()).collect();
    assert!(observations.len() > 4 && !site.is_empty());
    let whys = |names: &[&str]| -> Vec<(Vec<[f32; 2]>, Explanation)> {
        let forecasts = model.without_terms(names).unwrap().predict(&observations, 1).unwrap();
        forecasts.into_iter().map(|mut it| it.modes.remove(0)).map(|it| (it.path, it.explanation.unwrap())).collect()
    };
    let network = ["goal", "neighbours", "lines"];
    let (all, platoon, alone) = (whys(&[]), whys(&network), whys(&["goal", "neighbours", "lines", "car_following"]));
    let moved_by = |why: &Explanation, is: fn(&Cause) -> bool| -> Vec<[f32; 2]> {
        let parts = why.contributions.iter().filter(|part| is(&part.cause));
        parts.fold(vec![[0f32; 2]; 50], |sum, part| {
            sum.iter().zip(&part.displacement).map(|(a, b)| [a[0] + b[0], a[1] + b[1]]).collect()
        })
    };
    let rule = model.header().features.platoon().unwrap();
    let mut led = 0f32;
    for (i, observation) in observations.iter().enumerate() {
        let along = |path: &[[f32; 2]]| path.iter().map(|point| [point[0], 0.]).collect::<Vec<_>>();
        let reference = rule.predict(&[*observation], 1).unwrap().remove(0).modes.remove(0).path;
        close(&along(&platoon[i].0), &along(&reference), 1e-3, "the platoon");
        let leaders = moved_by(&all[i].1, |cause| matches!(cause, Cause::Leader { .. }));
        let gap: Vec<_> = platoon[i].0.iter().zip(&alone[i].0).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect();
        close(&gap, &leaders, 1e-3, "leaders");
        led = led.max(leaders[49][0].abs());
        // The network expects the same deviation, whichever reference it is beside.
        let expected = |why: &Explanation, path: &[[f32; 2]]| [why.goal[0] - path[49][0], why.goal[1]];
        let (a, b) = (expected(&platoon[i].1, &platoon[i].0), expected(&alone[i].1, &alone[i].0));
        assert!((a[0] - b[0]).abs() < 1e-3 && a[1] == b[1], "{a:?} {b:?}");
    }
    assert!(led > 1., "{led} m by leaders");
    let chances = |model: &Gnp| -> Vec<f32> {
        let forecasts = model.predict(&observations, 4).unwrap();
        forecasts.iter().flat_map(|forecast| &forecast.modes).map(|mode| mode.probability).collect()
    };
    assert_eq!(chances(&model.without_terms(&NAMES).unwrap()), chances(&model));
}

#[test]
fn an_unknown_term_is_refused_with_those_that_there_are() {
    let model = shipped();
    match model.without_terms(&["lines", "gravity"]) {
        Err(ModelError::UnknownTerm { name, known }) => assert!(name == "gravity" && known == NAMES),
        other => panic!("{other:?}"),
    }
    let message = model.without_terms(&["gravity"]).unwrap_err().to_string();
    assert!(message.contains("there are goal, neighbours"), "{message}");
    // Of a model whose reference is constant velocity the platoon's are none.
    let straight = self::super::model(&road(false, false), NeighbourFuture::ConstantVelocity);
    assert_eq!(straight.term_descriptors().len(), 3);
    assert!(straight.without_terms(&["habit"]).is_err() && straight.without_terms(&NAMES[..3]).is_ok());
}

#[test]
fn nothing_is_allocated_with_terms_off() {
    let (model, recordings) = (shipped(), traffic());
    let observations = some(&recordings, 8);
    for off in [&["goal"][..], &["car_following", "lines"], &["neighbours", "free_road", "habit"], &NAMES] {
        let model = model.without_terms(off).unwrap();
        let (mut workspace, mut out) = (Workspace::new(), Forecasts::default());
        let mut predict = |some: &[Observation<'_>]| model.predict_into(some, 3, &mut workspace, &mut out).unwrap();
        predict(&observations);
        for count in [8, 3, 5, 1] {
            let counted = measure(|| predict(&observations[8 - count..]));
            assert_eq!(counted.count_total, 0, "{count} windows without {off:?}");
        }
    }
}
