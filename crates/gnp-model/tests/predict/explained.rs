//! What is said about a forecast: its contributions, and a term of one's own.

use std::sync::Arc;

use gnp_data::{Cause, Forecast};
use gnp_force::na::Vector2;
use gnp_force::{Arity, ForceTerm, Source, State, TermDescriptor, TermParameter, TermVjp};
use gnp_model::Selection;

use super::*;

/// What moved the vehicle, cause by cause, leads from constant velocity to the path, whatever the reference.
#[test]
fn contributions_add_up_to_the_path() {
    let recording = road(false, false);
    for neighbours in [NeighbourFuture::ConstantVelocity, NeighbourFuture::Platoon] {
        let model = model(&recording, neighbours).explaining(true);
        let observations = [0, 1].map(|track| window(&recording, track).observation());
        let forecasts = model.predict(&observations, 4).unwrap();
        for mode in forecasts.iter().flat_map(|forecast| &forecast.modes) {
            let why = mode.explanation.as_ref().unwrap();
            let path = why.path(SHAPE.dt() as f32);
            assert_eq!(path.len(), SHAPE.t_pred);
            for (sum, point) in path.iter().zip(&mode.path) {
                for axis in 0..2 {
                    assert!((sum[axis] - point[axis]).abs() < 1e-4, "{neighbours:?}: {sum:?} {point:?}");
                }
            }
        }
        let why = forecasts[0].modes[0].explanation.as_ref().unwrap();
        let has = |wanted: &Cause| why.contributions.iter().any(|part| part.cause == *wanted);
        assert!(has(&Cause::Intention) && has(&Cause::Neighbour { vehicle: 2 }) && has(&Cause::Term("lines".into())));
        let platoon = neighbours == NeighbourFuture::Platoon;
        assert_eq!(has(&Cause::Leader { vehicle: 2, place: 1 }), platoon);
        assert_eq!(why.term("car_following").is_some(), platoon);
    }
}

/// The leader of the made-up road goes 1 m/s faster from 30 m ahead: the driver is held back by him from what an empty
/// road would let him do, and is told so.
#[test]
fn a_leader_is_named_with_what_his_absence_would_change() {
    let recording = road(false, false);
    let model = model(&recording, NeighbourFuture::Platoon).explaining(true);
    let forecast = model.predict(&[window(&recording, 0).observation()], 1).unwrap().remove(0);
    let why = forecast.modes[0].explanation.as_ref().unwrap();
    let leader = why.moved_by(|cause| matches!(cause, Cause::Leader { .. }));
    let rule = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    let end = |observation| rule.predict(&[observation], 1).unwrap()[0].modes[0].path[SHAPE.t_pred - 1][0];
    let traffic = rule.traffic(&window(&recording, 0).observation()).without_nearest(1);
    let alone = rule.roll_out("us-101", &traffic, &SHAPE).unwrap().position(0, SHAPE.t_pred) as f32;
    let held = end(window(&recording, 0).observation()) - alone;
    assert!((leader[0] - held).abs() < 1e-3 && held.abs() > 0.01, "{leader:?} {held}");
}

#[test]
fn neighbours_cannot_follow_a_platoon_that_is_no_reference_nor_be_joint_in_its_frame() {
    let recording = road(false, false);
    for (reference, neighbours, problem) in [
        (ReferencePath::ConstantVelocity, NeighbourFuture::Platoon, "needs features.reference"),
        (ReferencePath::Platoon, NeighbourFuture::Joint, "follow each other already"),
    ] {
        let features = features_from(&recording, Representation::Deviation, reference);
        let (goal, force) = checkpoints(&features);
        let made = Gnp::new(modes(&features), &goal, Some(&force), neighbours, &Device::Cpu);
        let message = made.unwrap_err().to_string();
        assert!(message.contains("predict.neighbours") && message.contains(problem), "{message}");
    }
}

#[test]
fn the_central_goal_comes_first_and_is_the_one_of_one() {
    let recording = road(false, false);
    let model = model(&recording, NeighbourFuture::Platoon).selecting(Selection::Central);
    let observation = [window(&recording, 0).observation()];
    let (one, three) = (model.predict(&observation, 1).unwrap(), model.predict(&observation, 3).unwrap());
    assert_eq!(one[0].modes[0].path, three[0].modes[0].path);
    assert!(three[0].modes[1].probability >= three[0].modes[2].probability);
}

/// A drag against the motion, `-c v`, that no crate of this project knows.
#[derive(Debug)]
struct Drag(TermDescriptor);

impl ForceTerm<f32> for Drag {
    fn descriptor(&self) -> &TermDescriptor {
        &self.0
    }

    fn force(&self, state: &State<f32>, _: &Source<f32>, parameters: &[f32]) -> Vector2<f32> {
        -state.velocity * parameters[0]
    }

    fn vjp(
        &self,
        state: &State<f32>,
        _: &Source<f32>,
        parameters: &[f32],
        cotangent: Vector2<f32>,
        dparameters: &mut [f32],
    ) -> TermVjp<f32> {
        dparameters[0] = -state.velocity.dot(&cotangent);
        TermVjp { velocity: -cotangent * parameters[0], ..TermVjp::zeros() }
    }
}

/// From the roll-out to the explanation, a file and a figure, without a line of code in between that knows it.
#[test]
fn a_made_up_term_acts_is_explained_written_and_drawn() {
    let recording = road(false, false);
    let plain = model(&recording, NeighbourFuture::ConstantVelocity).explaining(true);
    let c = TermParameter::varying("c", "1/s", "drag per speed");
    let descriptor = TermDescriptor::new("drag", Arity::One, "#7a5195").means("drag of the air", "drag").with(vec![c]);
    let model = model(&recording, NeighbourFuture::ConstantVelocity)
        .explaining(true)
        .with_term(Arc::new(Drag(descriptor)), &[0.2])
        .unwrap();
    let window = window(&recording, 0);
    let forecast = model.predict(&[window.observation()], 2).unwrap().remove(0);
    let without = plain.predict(&[window.observation()], 2).unwrap().remove(0);
    let end = |forecast: &Forecast| forecast.modes[0].path[SHAPE.t_pred - 1][0];
    assert!(end(&forecast) < end(&without) - 0.1, "{} with drag, {} without", end(&forecast), end(&without));

    let why = forecast.modes[0].explanation.as_ref().unwrap();
    let drag = why.term("drag").unwrap();
    assert_eq!(drag.parameter(0, 3), [0.2]);
    let start = AugmentedView::recorded(window.observation()).velocity(0.4);
    assert!((drag.total(0)[0] + 0.2 * start[0]).abs() < 1e-5 * start[0].abs(), "{:?}", drag.total(0));
    let (dt, mut v) = (SHAPE.dt() as f32, start);
    for step in 0..SHAPE.t_pred {
        let next = std::array::from_fn(|axis| v[axis] + dt * why.total(step)[axis]);
        let moved = forecast.modes[0].path[step][0] - if step == 0 { 0. } else { forecast.modes[0].path[step - 1][0] };
        assert!((moved - dt * next[0]).abs() < 1e-4, "the terms add up to the acceleration, step {step}");
        v = next;
    }

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    let provenance = gnp_eval::Provenance {
        model: "gnp".to_owned(),
        dataset: Dataset::NGSIM,
        rate_hz: SHAPE.rate_hz,
        simulated: false,
        uses_future: false,
    };
    let mut writer = gnp_eval::PredictionWriter::create(&path, &provenance).unwrap();
    writer.write(&window.key(), [0., 0.], &forecast).unwrap();
    writer.finish().unwrap();
    let file = gnp_eval::read_predictions(&path, gnp_eval::Detail::Explanations).unwrap();
    let read = file.get(&window.key()).unwrap().forecast.modes[0].explanation.as_ref().unwrap();
    assert_eq!(read.term("drag"), Some(drag), "descriptor, forces and parameters come back");
    assert_eq!(read.terms.len(), 4);

    let scene = gnp_plot::Scene::of(&window, forecast.clone(), "a made-up road".to_owned());
    let source = gnp_plot::Source { words: "a made-up road".to_owned(), simulated: false };
    let figure = gnp_plot::force_scenes("scenes", "Forces", &[scene], 1., &source);
    for part in ["drag of the air", "class=\"drag\"", "arrow drag", "#7a5195"] {
        assert!(figure.svg.contains(part), "{part}");
    }
}
