//! Whether anything recorded after the last observed frame reaches a forecast.

use gnp_baselines::{ConstantAcceleration, ConstantVelocity, Idm, Kalman};
use gnp_data::Predictor;

use crate::road::{Car, SHAPE, path, road};

#[test]
fn another_future_gives_the_same_forecasts_to_the_last_bit() {
    let recorded = |scrambled: bool| {
        let after = |t: f64, jump: f64| if scrambled && t > 1e-6 { jump * (7. * t).sin() } else { 0. };
        let target = |t: f64| [14. * t + 0.3 * t * t + after(t, 50.), 0.2 * t + after(t, 3.)];
        let leader = |t: f64| [25. + 11. * t + after(t, -80.), after(t, 2.)];
        road(SHAPE, SHAPE.t_pred, &[Car { from: 0, at: &target }, Car { from: 3, at: &leader }])
    };
    let (one, other) = (recorded(false), recorded(true));
    let last = one.tracks()[0].rows.end - 1;
    assert_ne!(one.state(last), other.state(last));
    let predictors: [&dyn Predictor; 4] =
        [&ConstantVelocity::default(), &ConstantAcceleration::default(), &Kalman::default(), &Idm::default()];
    for predictor in predictors {
        let (a, b) = (path(predictor, SHAPE, &one), path(predictor, SHAPE, &other));
        let bits = |path: &[[f32; 2]]| path.iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&a), bits(&b), "{}", predictor.name());
    }
}
