//! Intervals by driver and by event, of recordings that share drivers.

#![allow(clippy::unwrap_used, clippy::panic, dead_code)] // test code throughout, which clippy sees only inside #[test]

mod road;

use gnp_data::{Forecast, Observation, PredictError, Predictor, Recording, WindowId, WindowSet};
use gnp_eval::{EvaluatedModel, Metric, MetricKind, Protocol, Verdict, evaluate};
use road::{Car, Straight, config, find, sized, windows};

/// Eight drivers in each of four scenes of one site, under the same numbers and of the same sizes; in each scene all
/// drive otherwise, and harder from scene to scene.
fn scenes(shared: bool) -> Vec<Recording> {
    let scene = |(index, name): (usize, &str)| {
        let car = |i: u32| Car {
            vehicle: i,
            x0: 40. * i as f32,
            y: 2.,
            v: 15. + 2. * index as f32,
            a: -0.5 - 0.7 * index as f32 - 0.01 * i as f32,
        };
        let cars: Vec<Car> = (1..=8).map(car).collect();
        let own = if shared { 0. } else { 0.011 * index as f32 };
        let size = |car: &Car| [3.9 + own + 0.137 * car.vehicle as f32, 1.7 + 0.043 * car.vehicle as f32];
        sized(name, "us-101", false, &cars, size)
    };
    ["a", "b", "c", "d"].into_iter().enumerate().map(scene).collect()
}

#[test]
fn a_driver_counts_once_whatever_the_scene_and_the_fold() {
    let recordings = scenes(true);
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let model = Straight { name: "straight", drift: 0. };
    let config = config(&[Protocol::Clean]);
    let of =
        |ids: &[WindowId]| evaluate(&set, ids, &[EvaluatedModel::Predictor(&model)], &config, &mut |_| Ok(())).unwrap();
    let whole = of(set.ids());
    let scores = whole.scores(&config.bootstrap);
    let fde = find(&scores, "us-101", Metric::top_1(MetricKind::Fde, 2.));
    // Short scenes of the same drivers are of one event, which says nothing of others.
    assert_eq!((fde.windows, fde.vehicles, fde.events), (32, 8, 1));
    assert_eq!(fde.event_ci_low, None);

    // Folds agree on who is who, although none of them has all scenes.
    let part = |names: &[&str]| -> Vec<WindowId> {
        let in_part = |id: &&WindowId| names.contains(&set.recording(**id).unwrap().meta().name.as_str());
        set.ids().iter().filter(in_part).copied().collect()
    };
    let pooled = of(&part(&["b", "d"])).pooled(of(&part(&["a"]))).unwrap().pooled(of(&part(&["c"]))).unwrap();
    assert_eq!(pooled.scores(&config.bootstrap), scores);
}

/// [`Straight`] ahead, but to the left in some scenes.
struct Astray {
    name: &'static str,
    scenes: &'static [&'static str],
}

impl Predictor for Astray {
    fn name(&self) -> &str {
        self.name
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let of_window = |seen: &Observation<'_>| {
            let drift = if self.scenes.contains(&seen.recording_name()) { 3. } else { 0. };
            Straight { name: self.name, drift }.predict(std::slice::from_ref(seen), k)
        };
        observations.iter().map(of_window).collect::<Result<Vec<_>, _>>().map(|forecasts| forecasts.concat())
    }
}

/// In three of four scenes one model is better. By driver that is sure; whether it would be so in other scenes, four do
/// not say.
#[test]
fn events_must_agree_for_a_verdict() {
    let recordings = scenes(false);
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let config = config(&[Protocol::Literature]);
    let verdict = |scenes: &'static [&'static str], of_other: &'static [&'static str]| {
        let (ours, other) = (Astray { name: "ours", scenes }, Astray { name: "other", scenes: of_other });
        let models = [EvaluatedModel::Predictor(&ours), EvaluatedModel::Predictor(&other)];
        let evaluation = evaluate(&set, set.ids(), &models, &config, &mut |_| Ok(())).unwrap();
        let rows = evaluation.comparisons("ours", &config.bootstrap).unwrap();
        let row = &rows[0];
        assert!((row.vehicles, row.events) == (32, 4) && row.ci_high.unwrap() < 0., "{row:?}");
        (row.verdict, row.event_ci_high.unwrap() < 0.)
    };
    assert_eq!(verdict(&["d"], &["a", "b", "c"]), (Verdict::Open, false));
    assert_eq!(verdict(&[], &["a", "b", "c", "d"]), (Verdict::Better, true));
}
