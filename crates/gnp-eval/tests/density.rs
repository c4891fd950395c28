//! Densities of forecasts: spreads fitted to some windows, scored on others.

#![allow(clippy::unwrap_used, clippy::panic, dead_code)] // test code throughout, which clippy sees only inside #[test]

mod road;

use std::f64::consts::TAU;

use gnp_data::{Forecast, Observation, PredictError, Predictor, Recording, WindowConfig, WindowSet};
use gnp_eval::{ALL_SITES, EvalError, EvaluatedModel, Metric, MetricKind, Protocol, Score, Spreads, evaluate};
use road::{Car, Straight, config, find, recording, windows};

/// [`Straight`] with its first future alone.
struct Single(Straight);

impl Predictor for Single {
    fn name(&self) -> &str {
        self.0.name
    }

    fn predict(&self, observations: &[Observation<'_>], _: usize) -> Result<Vec<Forecast>, PredictError> {
        self.0.predict(observations, 1)
    }
}

fn single() -> Single {
    Single(Straight { name: "single", drift: 0. })
}

/// Twelve vehicles on one site and three on another; each changes its speed in its own way.
fn roads() -> [Recording; 2] {
    let car = |i: u32| Car { vehicle: i, x0: 60. * i as f32, y: 2., v: 20., a: 0.25 * i as f32 - 1.5 };
    let cars: Vec<Car> = (1..=15).map(car).collect();
    [recording("a", "s", false, &cars[..12]), recording("b", "t", false, &cars[12..])]
}

fn value(scores: &[Score], site: &str, metric: Metric) -> f64 {
    find(scores, site, metric).value
}

/// On the windows of the fit itself, where the mean squared error is the variance, the likelihood of one Gaussian is
/// known: 1/2 and the log of 2 pi times both deviations. Across the road there is no error: 1 cm.
#[test]
fn spreads_are_by_site_where_there_are_enough_vehicles() {
    let recordings = roads();
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let model = single();
    let spreads = Spreads::fit(&set, set.ids(), &model, 4, &mut |_| Ok(())).unwrap();
    let models = [EvaluatedModel::WithSpreads(&model, &spreads)];
    let config = config(&[Protocol::Clean]);
    let evaluation = evaluate(&set, set.ids(), &models, &config, &mut |_| Ok(())).unwrap();
    let scores = evaluation.scores(&config.bootstrap);
    let rmse = |site, at| value(&scores, site, Metric::top_1(MetricKind::LongitudinalRmseAt, at));
    for at in [1., 2.] {
        let own = spreads.of("s").iter().find(|it| it.horizon_s == at).unwrap();
        assert!((own.along_m - rmse("s", at)).abs() < 1e-6 && own.across_m == 0.01, "{own:?}");
        let nll = value(&scores, "s", Metric::of_all(MetricKind::NllAt, at));
        assert!((nll - 0.5 - (TAU * own.along_m * 0.01).ln()).abs() < 1e-6, "{nll}");
        // Three vehicles are too few for spreads of their own; a site never seen has none either.
        let pooled = spreads.of("t").iter().find(|it| it.horizon_s == at).unwrap();
        assert!((pooled.along_m - rmse(ALL_SITES, at)).abs() < 1e-6, "{pooled:?}");
        assert_eq!(spreads.of("elsewhere"), spreads.of("t"));
    }
    let mean = value(&scores, "s", Metric::of_all(MetricKind::NllTo, 2.));
    let both = [1., 2.].map(|at| value(&scores, "s", Metric::of_all(MetricKind::NllAt, at)));
    assert!((mean - (both[0] + both[1]) / 2.).abs() < 1e-12);
    // Errors of -2.5 to 3 m by half metres, whose root mean square is 1.74 m: five lie within 0.674 of these, eleven
    // within 1.645.
    for (kind, inside) in [(MetricKind::Coverage50At, 5.), (MetricKind::Coverage90At, 11.)] {
        let found = value(&scores, "s", Metric::of_all(kind, 2.));
        assert!((found - inside / 12.).abs() < 1e-12, "{kind:?}: {found}");
    }
}

/// Fifteen windows of three vehicles are no more than three vehicles; in two recordings of a site vehicles add up.
#[test]
fn windows_of_few_vehicles_have_the_spreads_of_all_sites() {
    let [many, few] = roads();
    let cars: Vec<Car> = (1..=7).map(|i| Car { vehicle: i, x0: 60. * i as f32, y: 2., v: 20., a: i as f32 }).collect();
    let halves = [recording("c", "u", false, &cars[..5]), recording("d", "u", false, &cars[..5])];
    let recordings: Vec<Recording> =
        [many, few].into_iter().chain(halves).chain([recording("e", "v", false, &cars)]).collect();
    let config = WindowConfig { observed_s: 1., predicted_s: 1., stride_s: 0.5, ..windows() };
    let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
    let on = |site: &str| set.iter().filter(|window| window.observation().site() == site).count();
    assert!(on("t") > 10 && on("u") > 10 && on("v") > 10, "windows enough");
    let spreads = Spreads::fit(&set, set.ids(), &single(), 4, &mut |_| Ok(())).unwrap();
    let pooled = spreads.of("elsewhere");
    assert_eq!((spreads.of("t"), spreads.of("v")), (pooled, pooled));
    assert_ne!(spreads.of("s"), pooled);
    assert_ne!(spreads.of("u"), pooled);
}

/// A model without spreads has no density, and is not compared by one.
#[test]
fn a_model_without_spreads_has_no_density() {
    let recordings = roads();
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let (ours, other) = (single(), Straight { name: "other", drift: 0.4 });
    let config = config(&[Protocol::Clean]);
    let stop = &mut |_: &gnp_eval::Batch<'_>| Ok(());
    let spreads = Spreads::fit(&set, set.ids(), &ours, 4, stop).unwrap();
    let of_other = Spreads::fit(&set, set.ids(), &other, 4, stop).unwrap();
    let comparisons = |other: EvaluatedModel<'_>| {
        let models = [EvaluatedModel::WithSpreads(&ours, &spreads), other];
        let evaluation = evaluate(&set, set.ids(), &models, &config, &mut |_| Ok(())).unwrap();
        let scored = |s: &&Score| s.model == "other" && (s.metric.starts_with("nll") || s.metric.starts_with("cov"));
        let scores = evaluation.scores(&config.bootstrap).iter().filter(scored).count();
        let rows = evaluation.comparisons("single", &config.bootstrap).unwrap();
        (scores > 0, rows.len(), rows.iter().any(|row| row.metric == "nll_to"))
    };
    assert_eq!(comparisons(EvaluatedModel::Predictor(&other)), (false, 3 * 6, false));
    assert_eq!(comparisons(EvaluatedModel::WithSpreads(&other, &of_other)), (true, 3 * 7, true));
}

#[test]
fn densities_are_the_same_bits_on_one_thread_and_on_two() {
    let recordings = roads();
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let model = Straight { name: "straight", drift: 0.3 };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let spreads = Spreads::fit(&set, set.ids(), &model, 4, &mut |_| Ok(())).unwrap();
            let models = [EvaluatedModel::WithSpreads(&model, &spreads)];
            let config = config(&[Protocol::Clean]);
            let evaluation = evaluate(&set, set.ids(), &models, &config, &mut |_| Ok(())).unwrap();
            (spreads, evaluation.scores(&config.bootstrap))
        })
    };
    assert_eq!(on(1), on(2));
}

#[test]
fn a_fit_without_windows_is_refused_and_one_can_be_stopped() {
    let recordings = roads();
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let none = Spreads::fit(&set, &[], &single(), 4, &mut |_| Ok(()));
    assert!(matches!(none, Err(EvalError::NoWindows)));
    let mut seen = 0;
    let stopped = Spreads::fit(&set, set.ids(), &single(), 4, &mut |batch| {
        seen = batch.done;
        if batch.done > 8 { Err(EvalError::Stopped) } else { Ok(()) }
    });
    assert!(matches!(stopped, Err(EvalError::Stopped)) && seen > 8 && seen < set.len(), "{seen}");
}
