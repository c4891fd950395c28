//! What must be true of the column network, on a made-up lane.

use std::sync::atomic::AtomicBool;

use gnp_baselines::Drivers;
use gnp_data::{LaneMarking, LiveScene, Sample, VehicleClass, WindowConfig, WindowSet};
use tempfile::TempDir;

use super::*;

const VEHICLES: usize = 36;
const RATE_HZ: f64 = 10.;

/// A lane of vehicles far from each other that keep accelerations of their own, from -0.4 to 0.4 m/s².
fn lane() -> LiveScene {
    let lines = [-1.8, 1.8].map(|y| LaneMarking::new(y, true)).to_vec();
    let mut scene = LiveScene::new(RATE_HZ, lines).unwrap();
    for vehicle in 0..VEHICLES {
        let acceleration = 0.1 * ((vehicle * 5) % 9) as f64 - 0.4;
        let (start, speed) = (500. * vehicle as f64, 15. + (vehicle % 7) as f64);
        let at = |frame: usize| {
            let t = frame as f64 / RATE_HZ;
            Sample::new(t, [(start + speed * t + acceleration * t * t / 2.) as f32, 0.05 * t as f32])
        };
        let samples: Vec<Sample> = (0..111).map(at).collect();
        scene.push(vehicle as u32, [5., 1.8], VehicleClass::Car, &samples).unwrap();
    }
    scene
}

fn recipe() -> ColumnRecipe {
    ColumnRecipe {
        networks: 2,
        hidden: 16,
        dropout: 0.,
        epochs: 60,
        batch: 16,
        learning_rate: 3e-3,
        weight_decay: 0.,
        seed: 1,
    }
}

/// The rule without habits: it keeps the speed of whoever has nobody near ahead.
fn platoon() -> PlatoonRule {
    PlatoonRule::of_drivers(Drivers { habit: 1e-6, slow_habit: 0., ..Drivers::TYPICAL }).unwrap()
}

/// Calls `check` with windows to train on, and windows of other vehicles.
fn with_windows(check: impl Fn(&Training<'_>)) {
    let scene = lane();
    let recordings = [scene.recording().unwrap().clone()];
    let config = WindowConfig {
        observed_s: 3.,
        predicted_s: 5.,
        rate_hz: RATE_HZ,
        stride_s: 0.5,
        site_stride_s: Default::default(),
    };
    let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
    let (validation, train): (Vec<WindowId>, Vec<WindowId>) =
        set.ids().iter().partition(|id| set.get(**id).unwrap().key().vehicle % 4 == 0);
    check(&Training {
        set: &set,
        train: &train,
        validation: &validation,
        split_hash: "one",
        reference: Some(&platoon()),
    });
}

fn train(recipe: &ColumnRecipe, data: &Training<'_>, folder: &Path) -> Result<ColumnNetwork, NeuralBaselineError> {
    ColumnNetwork::train(recipe, data, folder, &Device::Cpu, (), &AtomicBool::new(false))
}

/// Root mean square of the error along the road in the last frame, m.
fn error(of: &dyn Predictor, data: &Training<'_>) -> f64 {
    let windows: Vec<Window<'_>> = data.validation.iter().filter_map(|id| data.set.get(*id)).collect();
    let seen: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
    let forecasts = of.predict(&seen, 6).unwrap();
    let square = |(forecast, window): (&Forecast, &Window<'_>)| {
        f64::from(forecast.modes[0].path[49][0] - window.truth().target(49).x).powi(2)
    };
    (forecasts.iter().zip(&windows).map(square).sum::<f64>() / windows.len() as f64).sqrt()
}

#[test]
fn untrained_it_is_the_mean_of_its_references() {
    with_windows(|data| {
        let folder = TempDir::new().unwrap();
        let network =
            train(&ColumnRecipe { epochs: 1, learning_rate: 1e-12, ..recipe() }, data, folder.path()).unwrap();
        let windows: Vec<Window<'_>> = data.train.iter().take(40).filter_map(|id| data.set.get(*id)).collect();
        let seen: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
        let (found, rule) = (network.predict(&seen, 6).unwrap(), platoon().predict(&seen, 6).unwrap());
        for ((found, rule), seen) in found.iter().zip(&rule).zip(&seen) {
            assert_eq!((found.modes.len(), found.modes[0].path.len()), (1, 50));
            let (found, rule) = (&found.modes[0].path, &rule.modes[0].path);
            // The speed that both set out from: the slope over the last 0.8 s of a parabola is that of its middle.
            let x = |frame: usize| f64::from(seen.target(frame).x);
            let speed = (x(30) - x(22)) / 0.8;
            for second in 1..=5usize {
                let step = second * 10 - 1;
                let expected = (speed * second as f64 + 2. * f64::from(rule[step][0])) / 3.;
                assert!(
                    (f64::from(found[step][0]) - expected).abs() < 1e-2,
                    "{second} s: {:?} {expected}",
                    found[step]
                );
            }
            assert!(found.iter().zip(rule).all(|(found, rule)| found[1] == rule[1]));
        }
    });
}

#[test]
fn it_learns_what_past_speeds_tell_and_is_read_where_it_was_trained() {
    with_windows(|data| {
        let folder = TempDir::new().unwrap();
        let network = train(&recipe(), data, folder.path()).unwrap();
        let (learned, rule) = (error(&network, data), error(&platoon(), data));
        // A third of the prediction is the rule itself.
        assert!(rule > 2.5 && learned < 0.45 * rule, "{learned} {rule}");

        let again = train(&recipe(), data, folder.path()).unwrap();
        assert_eq!((again.header(), error(&again, data)), (network.header(), learned));
        let other = TempDir::new().unwrap();
        assert_eq!(error(&train(&recipe(), data, other.path()).unwrap(), data), learned);
        let refused = |recipe: ColumnRecipe, hash| {
            train(&recipe, &Training { split_hash: hash, ..*data }, folder.path()).unwrap_err().to_string()
        };
        assert!(refused(ColumnRecipe { seed: 2, ..recipe() }, "one").contains("another recipe"));
        assert!(refused(recipe(), "two").contains("another split"));
    });
}

#[test]
fn a_stop_leaves_nothing_and_bad_recipes_are_named() {
    with_windows(|data| {
        let folder = TempDir::new().unwrap();
        let stop = AtomicBool::new(true);
        let error = ColumnNetwork::train(&recipe(), data, folder.path(), &Device::Cpu, (), &stop).unwrap_err();
        assert!(matches!(error, NeuralBaselineError::Interrupted { .. }), "{error}");
        assert!(!ColumnNetwork::path(folder.path()).exists());
        for (bad, key) in [
            (ColumnRecipe { networks: 0, ..recipe() }, "networks"),
            (ColumnRecipe { hidden: 0, ..recipe() }, "hidden"),
            (ColumnRecipe { dropout: 1., ..recipe() }, "dropout"),
            (ColumnRecipe { epochs: 0, ..recipe() }, "epochs"),
            (ColumnRecipe { weight_decay: f64::NAN, ..recipe() }, "weight_decay"),
        ] {
            assert!(train(&bad, data, folder.path()).unwrap_err().to_string().contains(key), "{key}");
        }
    });
}
