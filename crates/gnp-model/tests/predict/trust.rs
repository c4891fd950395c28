//! How much of what the goal network expects is believed.

use gnp_data::{Predictor as _, Window};
use gnp_model::{Device, Gnp, NeighbourFuture, ReferencePath, Representation, Trust};

use super::{checkpoints, features_from, modes, road, window};

fn goal_head(representation: Representation) -> Gnp {
    let features = features_from(&road(false, false), representation, ReferencePath::ConstantVelocity);
    let (goal, _) = checkpoints(&features);
    Gnp::new(modes(&features), &goal, None, NeighbourFuture::ConstantVelocity, &Device::Cpu).unwrap()
}

/// Squared error of the mean of all futures at a share, each window counted with its weight.
fn error(gnp: &Gnp, windows: &[(Window<'_>, f64)], share: f64) -> f64 {
    let gnp = gnp.clone().trusting(Trust::Share(share)).unwrap();
    let of_window = |(window, weight): &(Window<'_>, f64)| {
        let forecast = gnp.predict(&[window.observation()], 50).unwrap().remove(0);
        let squared = |j: usize| {
            let mean =
                |axis: usize| forecast.modes.iter().map(|mode| mode.probability * mode.path[j][axis]).sum::<f32>();
            let truth = window.truth().target(j);
            f64::from(truth.x - mean(0)).powi(2) + f64::from(truth.y - mean(1)).powi(2)
        };
        weight * (0..window.observation().shape().t_pred).map(squared).sum::<f64>()
    };
    windows.iter().map(of_window).sum()
}

#[test]
fn the_fitted_share_has_the_least_error_and_weights_count() {
    let (recording, gnp) = (road(false, false), goal_head(Representation::Deviation));
    let fitted = |weights: [f64; 2]| {
        let windows = [0, 1].map(|track| (window(&recording, track), weights[track]));
        let share = gnp.fitted_trust(&windows).unwrap().unwrap();
        let least = error(&gnp, &windows, share);
        for other in [share - 0.05, share + 0.05].into_iter().filter(|other| (0. ..=1.).contains(other)) {
            let more = error(&gnp, &windows, other);
            assert!(least <= more * (1. + 1e-6), "{weights:?}: {least} at {share}, {more} at {other}");
        }
        share
    };
    // A weight of nothing leaves a window out.
    let alone = |track: usize| {
        let windows = [(window(&recording, track), 1.)];
        gnp.fitted_trust(&windows).unwrap().unwrap()
    };
    assert!((fitted([1., 0.]) - alone(0)).abs() < 1e-6 && (fitted([0., 1.]) - alone(1)).abs() < 1e-6);
    fitted([1., 3.]);
}

#[test]
fn positions_have_nothing_to_believe_instead_and_no_share_is_kept_before_it_is_fitted() {
    let gnp = goal_head(Representation::Position);
    assert_eq!(gnp.fitted_trust(&[(window(&road(false, false), 0), 1.)]).unwrap(), None);
    let refused = goal_head(Representation::Deviation).trusting(Trust::Fitted).unwrap_err().to_string();
    assert!(refused.contains("no share is kept"), "{refused}");
}
