//! Evaluations put together: folds of one split, seeds of one model.

#![allow(clippy::unwrap_used, clippy::panic)] // test code throughout, which clippy sees only inside #[test]

mod road;

use gnp_data::{WindowId, WindowSet};
use gnp_eval::{EvalConfig, EvalError, EvaluatedModel, Metric, MetricKind, Protocol, Score, evaluate};
use road::{Car, Straight, config, find, recording, windows};

#[test]
fn folds_pooled_score_as_all_windows_at_once() {
    let car = |vehicle, v, a| Car { vehicle, x0: 0., y: 2., v, a };
    let first = recording("a", "s", false, &[car(1, 20., 1.), car(2, 25., -2.)]);
    let second = recording("b", "s", true, &[car(1, 22., 0.5), car(7, 18., 3.)]);
    let third = recording("c", "t", false, &[car(4, 30., -1.)]);
    let recordings = [first, second, third];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let config = config(&[Protocol::Clean]);
    let straight = Straight { name: "straight", drift: 0.3 };
    let of = |ids: &[WindowId]| {
        evaluate(&set, ids, &[EvaluatedModel::Predictor(&straight)], &config, &mut |_| Ok(())).unwrap()
    };
    let whole = of(set.ids());
    // The folds share neither a site's order nor its windows.
    let [one, two, three, four, five] = set.ids() else { panic!("five windows") };
    let pooled = of(&[*four, *one]).pooled(of(&[*five, *two])).unwrap().pooled(of(&[*three])).unwrap();
    assert_eq!(pooled.setting(), whole.setting());
    assert_eq!(pooled.scores(&config.bootstrap), whole.scores(&config.bootstrap));
    assert!(whole.scores(&config.bootstrap).iter().any(|score| score.value > 0.));

    let other = evaluate(
        &set,
        &[*one],
        &[EvaluatedModel::Predictor(&Straight { name: "other", drift: 0.3 })],
        &config,
        &mut |_| Ok(()),
    )
    .unwrap();
    let error = of(&[*two]).pooled(other).unwrap_err().to_string();
    assert!(error.contains("models"), "{error}");
    let literature = EvalConfig { protocols: vec![Protocol::Literature], ..config.clone() };
    let other = evaluate(&set, &[*one], &[EvaluatedModel::Predictor(&straight)], &literature, &mut |_| Ok(())).unwrap();
    let error = of(&[*two]).pooled(other).unwrap_err().to_string();
    assert!(error.contains("protocols"), "{error}");
}

/// A model trained with two seeds is one row: contributions are averaged, and a seed of other windows is refused.
#[test]
fn seeds_of_a_model_are_one_row() {
    let cars: Vec<Car> =
        (1..=20).map(|i| Car { vehicle: i, x0: 30. * i as f32, y: 2., v: 20., a: -0.2 * i as f32 }).collect();
    let recordings = [recording("a", "s", false, &cars), recording("b", "t", false, &cars[..9])];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let config = config(&[Protocol::Clean]);
    let of = |models: &[(&'static str, f32)], ids: &[WindowId]| {
        let models: Vec<Straight> = models.iter().map(|(name, drift)| Straight { name, drift: *drift }).collect();
        let models: Vec<_> = models.iter().map(|model| EvaluatedModel::Predictor(model)).collect();
        evaluate(&set, ids, &models, &config, &mut |_| Ok(())).unwrap()
    };
    let ids = set.ids();
    let both = of(&[("ours", 0.), ("rule", 0.5)], ids).with_seed(of(&[("ours", 1.)], ids)).unwrap();
    let scores = both.scores(&config.bootstrap);
    // 2 s to the side at 0 and 1 m/s: squared errors 0 and 4 m².
    let lateral = |model: &str| {
        let metric = Metric::top_1(MetricKind::LateralRmseAt, 2.);
        let own: Vec<Score> = scores.iter().filter(|score| score.model == model).cloned().collect();
        let found = find(&own, "s", metric);
        (found.value, found.seeds, found.windows, found.ci_low.unwrap(), found.ci_high.unwrap())
    };
    let (value, seeds, windows, low, high) = lateral("ours");
    assert!((value - 2f64.sqrt()).abs() < 1e-6 && (seeds, windows) == (2, 20), "{value}");
    // The two trainings give 0 and 2 m, whose mean has the standard error 1 m, and drivers do not differ: Student's
    // 12.7 to each side, and no error is below 0.
    assert!(low == 0. && (high - value - 12.706_205).abs() < 1e-4, "{low} to {high}");
    let (value, seeds, _, low, high) = lateral("rule");
    assert!((value - 1.).abs() < 1e-6 && seeds == 1 && (high - low).abs() < 1e-6);
    let rows = both.comparisons("ours", &config.bootstrap).unwrap();
    assert!(rows.iter().all(|row| row.seeds == [2, 1]));

    // The same seed twice is one seed.
    let twice = of(&[("ours", 0.3)], ids).with_seed(of(&[("ours", 0.3)], ids)).unwrap().scores(&config.bootstrap);
    for (one, two) in of(&[("ours", 0.3)], ids).scores(&config.bootstrap).iter().zip(&twice) {
        let ends = |score: &Score| [score.value, score.ci_low.unwrap_or(0.), score.ci_high.unwrap_or(0.)];
        assert!(ends(one).iter().zip(ends(two)).all(|(one, two)| (one - two).abs() < 1e-9), "{one:?} {two:?}");
        assert_eq!((one.windows, one.vehicles, two.seeds), (two.windows, two.vehicles, 2));
    }

    // Folds pool seed by seed, and only with as many.
    let fold = |ids: &[WindowId]| of(&[("ours", 0.)], ids).with_seed(of(&[("ours", 1.)], ids)).unwrap();
    let pooled = fold(&ids[..15]).pooled(fold(&ids[15..])).unwrap();
    assert_eq!(pooled, fold(ids));
    let error = fold(&ids[..15]).pooled(of(&[("ours", 0.)], &ids[15..])).unwrap_err();
    assert!(error.to_string().contains("seeds"), "{error}");
    let other = of(&[("ours", 0.)], ids).with_seed(of(&[("ours", 1.)], &ids[1..]));
    assert!(matches!(other, Err(EvalError::OtherWindows { first: 29, second: 28 })));
    let other = of(&[("ours", 0.)], ids).with_seed(of(&[("theirs", 1.)], ids));
    assert!(matches!(other, Err(EvalError::NotScored { model, .. }) if model == "theirs"));
}
