//! A model that multiplies in bf16, where the processor does.

use allocation_counter::measure;
use gnp_model::{Forecasts, Precision, PrecisionError, Selection, Workspace};

use super::into::{difference, observations};
use super::*;

/// A model wide enough to be multiplied in bf16.
fn wide(recording: &Recording, neighbours: NeighbourFuture) -> Gnp {
    let features = features(recording, Representation::Deviation);
    let traj = TrajConfig { hidden: 48, embedding: 40, decoder: vec![64, 64], ..traj_config() };
    let (goal, force) = checkpoints_of(&features, &traj);
    let gnp = Gnp::new(modes(&features), &goal, Some(&force), neighbours, &Device::Cpu).unwrap();
    gnp.selecting(Selection::Central).explaining(true)
}

/// Probabilities and goals, and path points, by window, future and step.
fn parts(model: &Gnp, observations: &[Observation<'_>]) -> [Vec<f32>; 2] {
    let forecasts = model.predict(observations, 5).unwrap();
    let modes = || forecasts.iter().flat_map(|forecast| &forecast.modes);
    let goal = |mode: &gnp_data::Mode| mode.explanation.as_ref().unwrap().goal;
    let goals = modes().flat_map(|mode| [mode.probability, goal(mode)[0], goal(mode)[1]]);
    [goals.collect(), modes().flat_map(|mode| mode.path.as_flattened()).copied().collect()]
}

#[test]
fn a_model_in_bf16_is_near_that_in_f32_and_comes_back_to_its_bits() {
    let recording = road(false, false);
    let observations = observations(&recording);
    let exact = wide(&recording, NeighbourFuture::ConstantVelocity);
    let rounded = match (exact.clone().with_precision(Precision::Bf16), Precision::Bf16.check()) {
        (Ok(rounded), Ok(())) => rounded,
        (Err(ModelError::Precision(PrecisionError::NoInstruction)), Err(_)) => return,
        (found, here) => panic!("{found:?}, {here:?}"),
    };
    assert_eq!([rounded.precision(), exact.precision()], [Precision::Bf16, Precision::F32]);
    let [wanted, found] = [&exact, &rounded].map(|model| parts(model, &observations));
    assert_eq!(found[0], wanted[0], "goals are f32");
    let most = found[1].iter().zip(&wanted[1]).map(|(a, b)| (a - b).abs()).fold(0f32, f32::max);
    assert!(most > 0. && most < 0.1, "{most} m");
    let back = rounded.clone().with_precision(Precision::F32).unwrap();
    assert_eq!(parts(&back, &observations), wanted);

    let (mut workspace, mut out) = (Workspace::new(), Forecasts::default());
    let most = difference(&rounded, &observations, 5, &mut workspace);
    assert!(workspace.is_lean() && most < 0.1, "{most}");
    rounded.predict_into(&observations, 5, &mut workspace, &mut out).unwrap();
    let counted = measure(|| rounded.predict_into(&observations, 5, &mut workspace, &mut out).unwrap());
    assert_eq!(counted.count_total, 0);
}

#[test]
fn joint_neighbours_and_goals_alone_are_not_predicted_in_bf16() {
    let recording = road(false, false);
    let features = features(&recording, Representation::Deviation);
    let (goal, _) = checkpoints(&features);
    let neighbours = NeighbourFuture::ConstantVelocity;
    let alone = Gnp::new(modes(&features), &goal, None, neighbours, &Device::Cpu).unwrap();
    for model in [wide(&recording, NeighbourFuture::Joint), alone] {
        let refused = model.with_precision(Precision::Bf16).unwrap_err();
        match Precision::Bf16.check() {
            Ok(()) => assert!(matches!(&refused, ModelError::Config { key: "predict.precision", .. }), "{refused}"),
            Err(_) => assert!(matches!(&refused, ModelError::Precision(_)), "{refused}"),
        }
    }
}
