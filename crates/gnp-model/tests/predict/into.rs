//! Prediction into memory that is used again: the forecasts of `predict`, and no allocation.

use allocation_counter::measure;
use gnp_data::{Expectation, WindowConfig, WindowSet, discover, read};
use gnp_model::{Forecasts, Selection, Trust, Workspace};

use super::*;

/// The largest difference of probabilities, paths (m) and forces (m/s²) from what `predict` gives.
pub(crate) fn difference(model: &Gnp, observations: &[Observation<'_>], k: usize, workspace: &mut Workspace) -> f32 {
    let (wanted, mut found) = (model.predict(observations, k).unwrap(), Forecasts::default());
    model.predict_into(observations, k, workspace, &mut found).unwrap();
    assert_eq!((found.windows(), found.steps()), (observations.len(), model.shape().t_pred));
    let mut most = 0f32;
    let mut compare = |a: f32, b: f32| most = most.max((a - b).abs());
    for (window, forecast) in wanted.iter().enumerate() {
        assert_eq!(found.modes(), forecast.modes.len());
        for (i, mode) in forecast.modes.iter().enumerate() {
            compare(found.probabilities()[window * found.modes() + i], mode.probability);
            let path = found.path(window, i);
            assert_eq!(path.len(), mode.path.len());
            path.as_flattened().iter().zip(mode.path.as_flattened()).for_each(|(a, b)| compare(*a, *b));
            let Some(why) = &mode.explanation else {
                assert!(found.terms().is_empty() && found.goals().is_empty());
                continue;
            };
            found.goals()[window * found.modes() + i].iter().zip(why.goal).for_each(|(a, b)| compare(*a, b));
            assert_eq!(found.terms().len(), why.terms.len());
            for (t, term) in why.terms.iter().enumerate() {
                assert_eq!(*found.terms()[t].term, *term.term());
                let force = found.force(t, window, i);
                assert_eq!(force.len(), term.totals().len());
                force.as_flattened().iter().zip(term.totals().as_flattened()).for_each(|(a, b)| compare(*a, *b));
            }
        }
    }
    most
}

/// Everything that any row of the first two vehicles shows.
pub(crate) fn observations(recording: &Recording) -> Vec<Observation<'_>> {
    let rows = |track: usize| recording.tracks()[track].rows.clone().map(move |row| (track, row));
    let all = [0, 1].into_iter().flat_map(rows);
    all.filter_map(|(track, row)| Observation::new(recording, SHAPE, track, row).ok()).collect()
}

#[test]
fn forecasts_are_those_of_predict() {
    let recording = road(false, false);
    let observations = observations(&recording);
    assert!(observations.len() > 20);
    let mut workspace = Workspace::new();
    for neighbours in [NeighbourFuture::ConstantVelocity, NeighbourFuture::Platoon] {
        for (selection, share) in [(Selection::Central, 0.4), (Selection::Medoids, 1.)] {
            let model = model(&recording, neighbours).selecting(selection).trusting(Trust::Share(share)).unwrap();
            for (k, explain) in [(4, true), (4, false), (1, true), (50, true)] {
                let model = model.clone().explaining(explain);
                let most = difference(&model, &observations, k, &mut workspace);
                assert!(workspace.is_lean());
                eprintln!("{neighbours:?} {selection:?} {k} {explain}: {most}");
                assert!(most < 1e-5, "{neighbours:?}, {selection:?}, {k} goals: {most}");
            }
        }
    }
}

/// The embedded recordings of highD's layout with the steps of `configs/highd.toml`, and those of NGSIM with its own.
pub(crate) fn recorded(dataset: Dataset, folder: &str, rate_hz: f64) -> Vec<Recording> {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(folder);
    let source = discover(&fixtures, dataset).unwrap().swap_remove(0);
    let expect = Expectation { dataset, rate_hz: Some(rate_hz) };
    read(&source, &expect).unwrap().into_iter().map(|(recording, _)| recording).collect()
}

/// With real traffic, whose columns, neighbours and lane lines change from window to window.
#[test]
fn nothing_is_allocated_once_as_many_windows_were_seen() {
    const MOST: usize = 40;
    for (dataset, folder, recording_hz, rate_hz) in
        [(Dataset::HIGHD, "highd", 25., 5.), (Dataset::NGSIM, "ngsim", 10., 10.)]
    {
        let recordings = recorded(dataset, folder, recording_hz);
        let site_stride_s = BTreeMap::new();
        let config = WindowConfig { observed_s: 3., predicted_s: 5., rate_hz, stride_s: 1., site_stride_s };
        let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
        let mut observations: Vec<_> = set.iter().map(|window| window.observation()).collect();
        observations.sort_by_key(Observation::frame);
        let config = FeatureConfig {
            representation: Representation::Deviation,
            reference: ReferencePath::Platoon,
            length_scale: 5.,
            velocity_window_s: 0.5,
            history_block_s: 0.,
            vehicles_ahead: 2,
            neighbours: SeenNeighbours::All,
            car_following_features: true,
        };
        let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
        let fitted = observations.iter().step_by(observations.len() / 50);
        let features = Features::fit(&config, set.shape(), Some(&platoon), fitted.copied()).unwrap();
        let (goal, force) = checkpoints(&features);
        let model = Gnp::new(modes(&features), &goal, Some(&force), NeighbourFuture::Platoon, &Device::Cpu).unwrap();
        let model = model.selecting(Selection::Central).trusting(Trust::Share(0.5)).unwrap().explaining(true);
        let (mut workspace, mut out) = (Workspace::new(), Forecasts::default());
        // Lines differ by recording: those of the warm windows are no fewer.
        let lines = |observation: &&Observation<'_>| observation.lines().len();
        let many = *observations.iter().max_by_key(lines).unwrap();
        model.predict_into(&[many; MOST], 3, &mut workspace, &mut out).unwrap();
        let mut first = 0;
        for call in 0..100 {
            let count = (call * 7) % MOST + 1;
            let some = &observations[first % (observations.len() - count)..][..count];
            let counted = measure(|| model.predict_into(some, 3, &mut workspace, &mut out).unwrap());
            assert_eq!(counted.count_total, 0, "call {call} with {count} windows of {dataset}");
            first += 31;
        }
        let before = measure(|| drop(model.predict(&observations[..MOST], 3)));
        eprintln!("{} allocations by predict", before.count_total);
        assert!(before.count_total > 100, "allocations are counted");
        let most = difference(&model, &observations[..MOST], 3, &mut workspace);
        eprintln!("{dataset}: {most}");
        assert!(most < 1e-4, "{dataset}: {most}");
    }
}

/// Where nothing lean is offered, the forecasts come by way of `predict`.
#[test]
fn other_models_and_bad_windows_are_served_as_by_predict() {
    let recording = road(false, false);
    let observations = observations(&recording);
    let (mut workspace, mut out) = (Workspace::new(), Forecasts::default());
    let joint = model(&recording, NeighbourFuture::Joint).explaining(true);
    assert_eq!(difference(&joint, &observations[..3], 4, &mut workspace), 0.);
    assert!(!workspace.is_lean());
    let straight = model(&recording, NeighbourFuture::ConstantVelocity);
    let likeliest = straight.clone().selecting(Selection::MostProbable);
    assert_eq!(difference(&likeliest, &observations[..3], 4, &mut workspace), 0.);
    assert!(!workspace.is_lean());

    straight.predict_into(&[], 4, &mut workspace, &mut out).unwrap();
    assert!(workspace.is_lean() && out.windows() == 0 && out.paths().is_empty() && out.path(0, 0).is_empty());
    straight.predict_into(&observations[..2], 4, &mut workspace, &mut out).unwrap();
    assert!(out.path(1, 3).len() == SHAPE.t_pred && out.path(1, 4).is_empty() && out.path(2, 0).is_empty());
    let short = WindowShape { t_obs: 5, ..SHAPE };
    let other = Observation::new(&recording, short, 0, T0).unwrap();
    let refused = straight.predict_into(&[observations[0], other], 4, &mut workspace, &mut out).unwrap_err();
    assert_eq!(refused.to_string(), straight.predict(&[other], 4).unwrap_err().to_string());
    // A refusal leaves nothing behind.
    assert!(difference(&straight, &observations, 4, &mut workspace) < 1e-5);
}
