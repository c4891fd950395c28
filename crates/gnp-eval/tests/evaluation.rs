//! Whole evaluations on small made-up roads: golden values, order, marks, refusals.

#![allow(clippy::unwrap_used, clippy::panic)] // test code throughout, which clippy sees only inside #[test]

mod road;

use std::collections::BTreeMap;

use gnp_data::{
    Dataset, Forecast, Mode, Observation, OraclePredictor, PredictError, Predictor, Recording, Window, WindowId,
    WindowSet,
};
use gnp_eval::{
    ALL_SITES, Batch, Bootstrap, Comparison, Coverage, Detail, EvalConfig, EvalError, EvaluatedModel, ForecastProblem,
    Manoeuvre, Metric, MetricKind, Prediction, PredictionWriter, Predictions, Protocol, Provenance, Score, TableHead,
    Verdict, evaluate, read_predictions, save_comparisons, tables,
};
use road::{Car, RATE_HZ, Straight, config, find, recording, windows};

/// Protocols that have a metric on windows of 2 s.
const SHORT: [Protocol; 5] =
    [Protocol::Paper, Protocol::Literature, Protocol::Clean, Protocol::Argoverse2, Protocol::NuScenes];

/// Repeats what was recorded.
struct Oracle;

impl OraclePredictor for Oracle {
    fn name(&self) -> &str {
        "oracle"
    }

    fn predict_with_future(&self, windows: &[Window<'_>], _: usize) -> Result<Vec<Forecast>, PredictError> {
        let of_window = |window: &Window<'_>| {
            let states = (0..window.observation().shape().t_pred).map(|j| window.truth().target(j));
            let path = states.map(|state| [state.x, state.y]).collect();
            Forecast { modes: vec![Mode { probability: 1., path, explanation: None }] }
        };
        Ok(windows.iter().map(of_window).collect())
    }
}

fn scores_of(recordings: &[Recording], models: &[EvaluatedModel<'_>], protocols: &[Protocol]) -> Vec<Score> {
    let (set, _) = WindowSet::cut(recordings, &windows()).unwrap();
    let evaluation = evaluate(&set, set.ids(), models, &config(protocols), &mut |_| Ok(())).unwrap();
    evaluation.scores(&config(protocols).bootstrap)
}

fn value(scores: &[Score], site: &str, metric: Metric) -> f64 {
    find(scores, site, metric).value
}

/// Car 1 keeps its speed, car 2 brakes with 2 m/s²: from its last observed velocity (backwards over
/// half a second, so 0.5 m/s above the true one) the forecast is off by 0.5 t + t² after t seconds.
/// 1 s: 1.5 m; 2 s: 5 m; frames 0.5, 1, 1.5, 2 s: 0.5, 1.5, 3, 5 m.
#[test]
fn golden_values_by_site() {
    use MetricKind as M;
    let keeps = Car { vehicle: 1, x0: 0., y: 2., v: 20., a: 0. };
    let brakes = Car { vehicle: 2, x0: 500., y: 6., v: 30., a: -2. };
    let recordings = [recording("a", "us-101", false, &[keeps, brakes]), recording("b", "i-80", false, &[keeps])];
    let model = Straight { name: "straight", drift: 0. };
    let scores = scores_of(&recordings, &[EvaluatedModel::Predictor(&model)], &[Protocol::Clean, Protocol::Literature]);
    let cases = [
        ("us-101", Metric::top_1(M::RmseAt, 1.), (1.5f64.powi(2) / 2.).sqrt()),
        ("us-101", Metric::top_1(M::RmseAt, 2.), 12.5f64.sqrt()),
        ("us-101", Metric::top_1(M::RmseAtByVehicle, 2.), 12.5f64.sqrt()),
        ("us-101", Metric::top_1(M::LongitudinalRmseAt, 2.), 12.5f64.sqrt()),
        ("us-101", Metric::top_1(M::LateralRmseAt, 2.), 0.),
        ("us-101", Metric::top_1(M::LongitudinalBiasAt, 2.), 2.5),
        ("us-101", Metric::of_all(M::LikeliestRmseAt, 2.), 12.5f64.sqrt()),
        ("us-101", Metric::top_1(M::Ade, 2.), 1.25),
        ("us-101", Metric::top_1(M::Fde, 2.), 2.5),
        ("us-101", Metric::top_1(M::RmseTo, 2.), (36.5f64 / 8.).sqrt()),
        ("us-101", Metric::best_of(M::MissRate, 6, 2.), 0.5),
        ("i-80", Metric::top_1(M::RmseAt, 2.), 0.),
        (ALL_SITES, Metric::top_1(M::RmseAt, 2.), (25f64 / 3.).sqrt()),
        (ALL_SITES, Metric::top_1(M::Fde, 2.), 5. / 3.),
        // Modes 0, 1 and 2 go 0, 2 and 4 m to the left: their mean 2 m, besides 5 m along for car 2.
        ("i-80", Metric::of_all(M::MixtureMeanRmseAt, 2.), 2.),
        ("us-101", Metric::of_all(M::MixtureMeanRmseAt, 2.), (25f64 / 2. + 4.).sqrt()),
    ];
    for (site, metric, expected) in cases {
        let found = value(&scores, site, metric);
        assert!((found - expected).abs() < 1e-4, "{metric} on {site}: {found}, not {expected}");
    }
    let all = find(&scores, ALL_SITES, Metric::top_1(M::Fde, 2.));
    assert_eq!((all.windows, all.vehicles), (3, 3));
    assert!(all.ci_low.unwrap() <= all.value && all.value <= all.ci_high.unwrap());
    let one = find(&scores, "i-80", Metric::top_1(M::Fde, 2.));
    assert_eq!((one.vehicles, one.ci_low), (1, None), "one vehicle has no interval");
}

/// The road ends at y = 8 m. From y = 6 m a mode that drifts by d m/s reaches 6 + 2 d.
#[test]
fn off_road_is_beyond_the_outermost_lines() {
    let car = Car { vehicle: 1, x0: 0., y: 6., v: 20., a: 0. };
    let recordings = [recording("a", "us-101", false, &[car])];
    for (drift, top_1, of_3) in [(0., 0., 1. / 3.), (0.9, 0., 2. / 3.), (1.1, 1., 1.), (-3.1, 1., 1. / 3.)] {
        let model = Straight { name: "straight", drift };
        let scores = scores_of(&recordings, &[EvaluatedModel::Predictor(&model)], &[Protocol::Clean]);
        let off = |k| value(&scores, "us-101", Metric::best_of(MetricKind::OffRoad, k, 2.));
        assert!(
            (off(1) - top_1).abs() < 1e-12 && (off(6) - of_3).abs() < 1e-12,
            "drift {drift}: {}, {}",
            off(1),
            off(6)
        );
    }
}

/// Car 1 goes at 20 m/s; car 2, 20 m ahead, at 10 m/s: centres are 10 m apart after 1 s and 0 m after
/// 2 s, when the boxes overlap. A car in the other lane, 4 m beside, does not overlap.
#[test]
fn overlap_is_of_boxes_in_the_same_frame() {
    let fast = Car { vehicle: 1, x0: 0., y: 2., v: 20., a: 0. };
    let start = 20. * 2. + 20. - 10. * 2.;
    let slow = Car { vehicle: 2, x0: start, y: 2., v: 10., a: 0. };
    let model = Straight { name: "straight", drift: 0. };
    let overlap = |other: Car| {
        let recordings = [recording("a", "us-101", false, &[fast, other])];
        let scores = scores_of(&recordings, &[EvaluatedModel::Predictor(&model)], &[Protocol::Clean]);
        value(&scores, "us-101", Metric::best_of(MetricKind::Overlap, 1, 2.))
    };
    assert_eq!(overlap(slow), 1., "each of the two meets the other");
    assert_eq!(overlap(Car { y: 6., ..slow }), 0.);
    // 4.5 m ahead at the end: bumper to bumper with half a metre between.
    assert_eq!(overlap(Car { x0: start + 4.5, ..slow }), 0.);
    assert_eq!(overlap(Car { x0: start + 3.5, ..slow }), 1.);
    // Through the crossing: at 0.5 s steps the gaps are 5, 0, -5 and -10 m.
    assert_eq!(overlap(Car { x0: start - 10., ..slow }), 1.);
}

#[test]
fn informed_models_are_marked_and_kept_out_of_clean() {
    let car = Car { vehicle: 1, x0: 0., y: 2., v: 20., a: -1. };
    let recordings = [recording("a", "us-101", false, &[car])];
    let scores = scores_of(&recordings, &[EvaluatedModel::Oracle(&Oracle)], &[Protocol::Literature, Protocol::Paper]);
    assert!(scores.iter().all(|score| score.uses_future && score.value == 0.));
    let head = TableHead { split: "recording".to_owned(), rate_hz: RATE_HZ };
    assert!(tables(&scores, &head).iter().all(|table| table.terminal().contains("oracle (future input)")));
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let refused =
        evaluate(&set, set.ids(), &[EvaluatedModel::Oracle(&Oracle)], &config(&Protocol::ALL), &mut |_| Ok(()));
    assert!(matches!(refused, Err(EvalError::FutureInput { protocol: "clean", .. })));
}

#[test]
fn one_simulated_recording_marks_every_number() {
    let car = Car { vehicle: 1, x0: 0., y: 2., v: 20., a: 0. };
    let recordings = [recording("a", "s", false, &[car]), recording("b", "s", true, &[car])];
    let model = Straight { name: "straight", drift: 0. };
    let scores = scores_of(&recordings, &[EvaluatedModel::Predictor(&model)], &[Protocol::Clean]);
    assert!(scores.iter().all(|score| score.simulated));
    // The simulated one alone is not scored: nothing to mark.
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let real = &set.ids()[..1];
    let evaluation =
        evaluate(&set, real, &[EvaluatedModel::Predictor(&model)], &config(&[Protocol::Clean]), &mut |_| Ok(()))
            .unwrap();
    assert!(!evaluation.setting().simulated);
}

/// Windows come by recording and instant whatever the order of the ids, an instant stays in one
/// batch, and the watcher sees every answer.
#[test]
fn scenes_reach_models_whole_and_in_order() {
    let cars: Vec<Car> = (1..=3).map(|i| Car { vehicle: i, x0: 50. * i as f32, y: 2., v: 20., a: 0. }).collect();
    let recordings = [recording("a", "s", false, &cars), recording("b", "s", false, &cars)];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let mut ids = set.ids().to_vec();
    ids.reverse();
    let model = Straight { name: "straight", drift: 0. };
    let mut seen = Vec::new();
    let mut watch = |batch: &Batch<'_>| {
        let keys: Vec<String> =
            batch.windows.iter().map(|w| format!("{}{}", w.key().recording, w.key().vehicle)).collect();
        assert_eq!(batch.forecasts.len(), keys.len());
        seen.push((batch.asked, keys.join(" "), batch.done, batch.total));
        Ok(())
    };
    evaluate(&set, &ids, &[EvaluatedModel::Predictor(&model)], &config(&[Protocol::Clean]), &mut watch).unwrap();
    let scenes = ["a1 a2 a3", "b1 b2 b3"].into_iter().flat_map(|keys| [1, 6, 20].map(|asked| (asked, keys)));
    let expected = scenes.zip(1..).map(|((asked, keys), batch)| (asked, keys.to_owned(), 3 * batch, 18));
    assert_eq!(seen, expected.collect::<Vec<_>>());
}

#[test]
fn the_watcher_can_stop() {
    let car = Car { vehicle: 1, x0: 0., y: 2., v: 20., a: 0. };
    let recordings = [recording("a", "s", false, &[car])];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let model = Straight { name: "straight", drift: 0. };
    let models = [EvaluatedModel::Predictor(&model)];
    let stopped = evaluate(&set, set.ids(), &models, &config(&[Protocol::Clean]), &mut |_| Err(EvalError::Stopped));
    assert!(matches!(stopped, Err(EvalError::Stopped)));
}

#[test]
fn scores_are_the_same_bits_on_one_thread_and_on_two() {
    let cars: Vec<Car> =
        (1..=7).map(|i| Car { vehicle: i, x0: 30. * i as f32, y: 2., v: 20., a: -0.3 * i as f32 }).collect();
    let recordings = [recording("a", "s", false, &cars)];
    let model = Straight { name: "straight", drift: 0.3 };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let scores = pool.install(|| scores_of(&recordings, &[EvaluatedModel::Predictor(&model)], &SHORT));
        scores.iter().map(|s| (s.value.to_bits(), s.ci_low.map(f64::to_bits), s.ci_high.map(f64::to_bits))).collect()
    };
    let (one, two): (Vec<_>, Vec<_>) = (on(1), on(2));
    assert!(!one.is_empty());
    assert_eq!(one, two);
}

/// Two models whose errors differ by a little on every vehicle.
#[test]
fn paired_difference_between_models() {
    let cars: Vec<Car> =
        (1..=20).map(|i| Car { vehicle: i, x0: 30. * i as f32, y: 2., v: 20., a: -0.2 * i as f32 }).collect();
    let recordings = [recording("a", "s", false, &cars)];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let (near, far) = (Straight { name: "near", drift: 0.1 }, Straight { name: "far", drift: 0.5 });
    let models = [EvaluatedModel::Predictor(&near), EvaluatedModel::Predictor(&far)];
    let config = config(&[Protocol::Clean]);
    let evaluation = evaluate(&set, set.ids(), &models, &config, &mut |_| Ok(())).unwrap();
    let metric = Metric::top_1(MetricKind::RmseAt, 2.);
    let difference = |a, b, metric| evaluation.difference(Protocol::Clean, "s", (a, b), metric, &config.bootstrap);
    let forth = difference("near", "far", metric).unwrap();
    assert!(forth.value < 0. && forth.is_clear() && forth.share_better == 1.);
    let back = difference("far", "near", metric).unwrap();
    assert!((forth.value + back.value).abs() < 1e-12 && back.share_better == 0.);
    assert!(matches!(difference("near", "none", metric), Err(EvalError::Unpaired { .. })));
    let absent = Metric::top_1(MetricKind::RmseAt, 9.);
    assert!(matches!(difference("near", "far", absent), Err(EvalError::Unpaired { .. })));
}

#[test]
fn every_model_is_compared_with_one() {
    let cars: Vec<Car> =
        (1..=20).map(|i| Car { vehicle: i, x0: 30. * i as f32, y: 2., v: 20., a: -0.2 * i as f32 }).collect();
    let recordings = [recording("a", "s", false, &cars), recording("b", "t", false, &cars[..9])];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let models = [("near", 0.1), ("far", 0.5), ("same", 0.1)].map(|(name, drift)| Straight { name, drift });
    let models = models.each_ref().map(|model| EvaluatedModel::Predictor(model));
    let config = config(&[Protocol::Clean, Protocol::Literature]);
    let evaluation = evaluate(&set, set.ids(), &models, &config, &mut |_| Ok(())).unwrap();
    let rows = evaluation.comparisons("near", &config.bootstrap).unwrap();
    // Three places, two other models, six headline metrics under one protocol (no densities) and one under
    // the other.
    assert_eq!(rows.len(), 3 * 2 * (6 + 1));
    let at = |b: &str, site: &str| {
        rows.iter().find(|row| row.b == b && row.site == site && row.protocol == Protocol::Literature).unwrap()
    };
    assert_eq!((at("far", "s").verdict, at("same", "s").verdict), (Verdict::Better, Verdict::Open));
    assert_eq!((at("far", ALL_SITES).windows, at("far", "t").vehicles), (29, 9));
    let back = evaluation.comparisons("far", &config.bootstrap).unwrap();
    assert!(back.iter().filter(|row| row.metric == "rmse_at").all(|row| row.verdict == Verdict::Worse));
    assert!(matches!(evaluation.comparisons("none", &config.bootstrap), Err(EvalError::NotScored { .. })));

    let folder = tempfile::tempdir().unwrap();
    save_comparisons(&folder.path().join("differences.json"), &rows).unwrap();
    let text = std::fs::read_to_string(folder.path().join("differences.json")).unwrap();
    let read: Vec<Comparison> = serde_json::from_str(&text).unwrap();
    let verdicts = |rows: &[Comparison]| rows.iter().map(|row| (row.b.clone(), row.verdict, row.k)).collect::<Vec<_>>();
    assert_eq!(verdicts(&read), verdicts(&rows));
}

/// Cars 1 and 2 keep their speed, car 3 brakes with 2 m/s²: brake holds it alone, keep holds all.
#[test]
fn scores_come_by_manoeuvre_under_clean() {
    let car = |vehicle, a| Car { vehicle, x0: 100. * vehicle as f32, y: 2., v: 20., a };
    let recordings =
        [recording("a", "s", false, &[car(1, 0.), car(2, 0.)]), recording("b", "t", false, &[car(3, -2.)])];
    let model = Straight { name: "straight", drift: 0. };
    let scores = scores_of(&recordings, &[EvaluatedModel::Predictor(&model)], &SHORT);
    let of = |manoeuvre| {
        let fde = |s: &&Score| s.metric == "fde" && s.horizon_s == 2. && s.manoeuvre == Some(manoeuvre);
        scores.iter().filter(fde).map(|s| (s.site.as_str(), s.windows, s.value)).collect::<Vec<_>>()
    };
    let [(site, windows, value)] = of(Manoeuvre::Brake)[..] else { panic!("{:?}", of(Manoeuvre::Brake)) };
    assert!((site, windows) == (ALL_SITES, 1) && (value - 5.).abs() < 1e-4, "{value}");
    let [(_, windows, value)] = of(Manoeuvre::Keep)[..] else { panic!("{:?}", of(Manoeuvre::Keep)) };
    assert!(windows == 3 && (value - 5. / 3.).abs() < 1e-4, "{value}");
    assert!(of(Manoeuvre::Left).is_empty());
    assert!(scores.iter().all(|score| score.manoeuvre.is_none() || score.protocol == Protocol::Clean));
}

/// Two recorded boxes that drive into one another: no model can be held to less.
#[test]
fn the_overlap_of_recorded_boxes_does_not_depend_on_the_model() {
    let fast = Car { vehicle: 1, x0: 0., y: 2., v: 20., a: 0. };
    let slow = Car { vehicle: 2, x0: 40., y: 2., v: 10., a: 0. };
    let recordings = [recording("a", "s", false, &[fast, slow, Car { vehicle: 3, x0: 900., ..fast }])];
    for drift in [0., 4.] {
        let model = Straight { name: "straight", drift };
        let scores = scores_of(&recordings, &[EvaluatedModel::Predictor(&model)], &[Protocol::Clean]);
        let floor = value(&scores, "s", Metric::of_all(MetricKind::RecordedOverlap, 2.));
        assert!((floor - 2. / 3.).abs() < 1e-12, "{floor}");
    }
}

#[test]
fn models_that_may_not_enter_everywhere_join_later() {
    let cars: Vec<Car> =
        (1..=6).map(|i| Car { vehicle: i, x0: 30. * i as f32, y: 2., v: 20., a: -0.2 * i as f32 }).collect();
    let recordings = [recording("a", "s", false, &cars)];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let model = Straight { name: "straight", drift: 0. };
    let run = |ids: &[WindowId], model, protocols: &[Protocol]| {
        evaluate(&set, ids, &[model], &config(protocols), &mut |_| Ok(())).unwrap()
    };
    let both = [Protocol::Clean, Protocol::Literature];
    let blind = || run(set.ids(), EvaluatedModel::Predictor(&model), &both);
    let oracle = run(set.ids(), EvaluatedModel::Oracle(&Oracle), &both[1..]);
    let joined = blind().joined(oracle.clone()).unwrap();
    let bootstrap = config(&both).bootstrap;
    let rows = joined.comparisons("straight", &bootstrap).unwrap();
    assert_eq!(rows.len(), 1, "the oracle is compared where it entered");
    assert!(rows[0].protocol == Protocol::Literature && rows[0].uses_future && rows[0].verdict == Verdict::Worse);
    assert_eq!(joined.scores(&bootstrap).len(), blind().scores(&bootstrap).len() + oracle.scores(&bootstrap).len());
    assert!(matches!(joined.joined(oracle), Err(EvalError::SameName { .. })));
    let fewer = run(&set.ids()[..2], EvaluatedModel::Oracle(&Oracle), &both[1..]);
    assert!(matches!(blind().joined(fewer), Err(EvalError::OtherWindows { first: 6, second: 2 })));
}

/// A model that gives what it must not.
struct Broken(fn(&mut Vec<Forecast>));

impl Predictor for Broken {
    fn name(&self) -> &str {
        "broken"
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let mut forecasts = Straight { name: "straight", drift: 0. }.predict(observations, k)?;
        (self.0)(&mut forecasts);
        Ok(forecasts)
    }
}

#[test]
fn failures_name_the_model_and_the_window() {
    let cars = [1, 2].map(|vehicle| Car { vehicle, x0: 90. * vehicle as f32, y: 2., v: 20., a: 0. });
    let recordings = [recording("a", "s", false, &cars)];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let run = |change| {
        let model = Broken(change);
        evaluate(&set, set.ids(), &[EvaluatedModel::Predictor(&model)], &config(&[Protocol::Literature]), &mut |_| {
            Ok(())
        })
        .unwrap_err()
    };
    let error = run(|forecasts| forecasts[1].modes[0].path[2][1] = f32::INFINITY);
    assert_eq!(error.to_string(), "broken, recording a, vehicle 2, frame 104: mode 0, step 3: position is not finite");
    let error = run(|forecasts| forecasts[0].modes.clear());
    assert!(matches!(error, EvalError::Forecast { problem: ForecastProblem::NoModes, .. }));
    let error = run(|forecasts| drop(forecasts.pop()));
    assert!(matches!(error, EvalError::Count { windows: 2, found: 1, .. }));
}

#[test]
fn what_cannot_be_evaluated_is_refused() {
    let car = Car { vehicle: 1, x0: 0., y: 2., v: 20., a: 0. };
    let recordings = [recording("a", "s", false, &[car])];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let model = Straight { name: "straight", drift: 0. };
    let one = [EvaluatedModel::Predictor(&model)];
    let twice = [EvaluatedModel::Predictor(&model), EvaluatedModel::Predictor(&model)];
    let clean = config(&[Protocol::Clean]);
    let run = |ids: &[WindowId], models: &[EvaluatedModel<'_>], config: &EvalConfig| {
        evaluate(&set, ids, models, config, &mut |_| Ok(())).unwrap_err()
    };
    assert!(matches!(run(&[], &one, &clean), EvalError::NoWindows));
    assert!(matches!(run(set.ids(), &twice, &clean), EvalError::SameName { .. }));
    let mut foreign = set.ids()[0];
    foreign.track = 7;
    assert!(matches!(run(&[foreign], &one, &clean), EvalError::UnknownWindow { .. }));
    for (key, wrong) in [
        ("batch", EvalConfig { batch: 0, ..clean.clone() }),
        ("protocols", EvalConfig { protocols: vec![], ..clean.clone() }),
        ("protocols", EvalConfig { protocols: vec![Protocol::Clean, Protocol::Clean], ..clean.clone() }),
        ("resamples", EvalConfig { bootstrap: Bootstrap { resamples: 3, seed: 1 }, ..clean.clone() }),
    ] {
        let error = run(set.ids(), &one, &wrong);
        assert!(matches!(error, EvalError::Config { key: found, .. } if found == key), "{error}");
    }
}

/// Predictions written while a model is scored, read back and scored as anyone's file give the same
/// numbers.
#[test]
fn a_prediction_file_scores_as_its_model() {
    let cars: Vec<Car> =
        (1..=4).map(|i| Car { vehicle: i, x0: 60. * i as f32, y: 2., v: 20., a: -0.5 * i as f32 }).collect();
    let recordings = [recording("a", "s", false, &cars)];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    let provenance = Provenance {
        model: "straight".to_owned(),
        dataset: Dataset::NGSIM,
        rate_hz: RATE_HZ,
        simulated: false,
        uses_future: false,
    };
    let mut writer = PredictionWriter::create(&path, &provenance).unwrap();
    let mut watch = |batch: &Batch<'_>| {
        for (window, forecast) in batch.windows.iter().zip(batch.forecasts).filter(|_| batch.asked == 20) {
            writer.write(&window.key(), window.observation().origin(), forecast)?;
        }
        Ok(())
    };
    let model = Straight { name: "straight", drift: 0.2 };
    let config = config(&[Protocol::Clean]);
    let ran = evaluate(&set, set.ids(), &[EvaluatedModel::Predictor(&model)], &config, &mut watch).unwrap();
    writer.finish().unwrap();
    let file = read_predictions(&path, Detail::Paths).unwrap();
    let read = evaluate(&set, set.ids(), &[EvaluatedModel::Predictor(&file)], &config, &mut |_| Ok(())).unwrap();
    assert_eq!(ran.scores(&config.bootstrap), read.scores(&config.bootstrap));

    let all = Coverage { matched: 4, windows_alone: 0, predictions_alone: 0 };
    assert_eq!(file.coverage(set.iter()), all);
    let fewer = Predictions::new("fewer", file.iter().skip(1).cloned().chain([elsewhere(&file)]));
    let partly = Coverage { matched: 3, windows_alone: 1, predictions_alone: 1 };
    assert_eq!(fewer.coverage(set.iter()), partly);
    let missing =
        evaluate(&set, set.ids(), &[EvaluatedModel::Predictor(&fewer)], &config, &mut |_| Ok(())).unwrap_err();
    let source = std::error::Error::source(&missing).unwrap();
    assert!(
        source.to_string().contains("no prediction for recording a, vehicle 1, frame 104") || {
            source.source().unwrap().to_string().contains("no prediction for recording a, vehicle 1, frame 104")
        }
    );
}

/// A prediction for a window that nobody has.
fn elsewhere(file: &Predictions) -> Prediction {
    let mut prediction = file.iter().next().unwrap().clone();
    prediction.key.recording = "elsewhere".to_owned();
    prediction
}

/// Every protocol gives each of its metrics once for each site and for all.
#[test]
fn no_score_is_given_twice() {
    let car = Car { vehicle: 1, x0: 0., y: 2., v: 20., a: 0. };
    let recordings = [recording("a", "us-101", false, &[car]), recording("b", "i-80", false, &[car])];
    let model = Straight { name: "straight", drift: 0. };
    let scores = scores_of(&recordings, &[EvaluatedModel::Predictor(&model)], &SHORT);
    let mut counts = BTreeMap::new();
    for s in &scores {
        *counts.entry((s.protocol, &s.site, s.manoeuvre, &s.metric, s.k, s.horizon_s as u32)).or_insert(0) += 1;
    }
    assert!(counts.values().all(|count| *count == 1));
    let sites: Vec<&str> = scores
        .iter()
        .filter(|s| s.manoeuvre.is_none() && s.protocol == Protocol::Clean)
        .filter(|s| s.metric == "min_fde" && s.k == Some(6) && s.horizon_s == 2.)
        .map(|s| s.site.as_str())
        .collect();
    assert_eq!(sites, ["i-80", "us-101", ALL_SITES]);
}
