//! Products in bf16: the same path but for rounding where the processor makes them, a refusal everywhere else.

use candle_core::Var;
use gnp_nn::{Precision, PrecisionError};
use gnp_traj::{Engine, Phase, RollOutBatch, RollOutWorkspace, SocialForce, TrajConfig, TrajError};

use crate::into::plain;
use crate::scenes::{Outcome, network, scene, small, values};

/// Wide enough to be multiplied in bf16.
fn wide() -> TrajConfig {
    TrajConfig {
        hidden: 48,
        embedding: 40,
        latent_dim: 24,
        encoder: vec![40, 50],
        decoder: vec![64, 40, 64],
        network_period: 2,
        ..small()
    }
}

/// The network in bf16, and in f32; none where the processor does not multiply bf16, which then was said.
fn both() -> Outcome<Option<[SocialForce; 2]>> {
    let (network, _) = network(&wide(), 7)?;
    match (network.frozen_in(Precision::Bf16), Precision::Bf16.check()) {
        (Ok(rounded), Ok(())) => Ok(Some([rounded, network.frozen()?])),
        (Err(TrajError::Precision(PrecisionError::NoInstruction)), Err(_)) => Ok(None),
        (found, here) => Err(format!("{:?}, {here:?}", found.map(|network| network.precision())).into()),
    }
}

#[test]
fn a_path_in_bf16_is_near_that_in_f32_and_the_same_bits_by_either_way() -> Outcome {
    let Some([rounded, exact]) = both()? else { return Ok(()) };
    assert_eq!([rounded.precision(), exact.precision()], [Precision::Bf16, Precision::F32]);
    let mut workspace = RollOutWorkspace::default();
    for (windows, goals) in [(1, 1), (9, 2), (30, 4)] {
        let scene = scene(windows, goals, 11)?;
        let (found, wanted) = (rounded.roll_out(&scene, Phase::Full)?, exact.roll_out(&scene, Phase::Full)?);
        let (found, wanted) = (values(&found)?, values(&wanted)?);
        let most = found.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0f32, f32::max);
        assert!(most > 0. && most < 0.02, "{most} m");
        workspace.values = plain(&scene)?;
        assert_eq!(rounded.roll_out_into(Phase::Full, false, &mut workspace)?.path(), found);
        assert_eq!(values(&rounded.predict(&scene, Phase::Full)?)?, found);
        assert_eq!(values(&rounded.roll_out_explained(&scene, Phase::Full)?.path)?, found);
        // Each window for itself: what others are in the batch does not matter.
        let alone = RollOutBatch {
            observed: scene.observed.narrow(0, 0, 1)?,
            goals: scene.goals.narrow(0, 0, 1)?,
            neighbours: None,
            lines: None,
            ..scene.clone()
        };
        let of_all = RollOutBatch { neighbours: None, lines: None, ..scene };
        let (alone, of_all) =
            (rounded.roll_out(&alone, Phase::Attraction)?, rounded.roll_out(&of_all, Phase::Attraction)?);
        assert_eq!(values(&alone)?, values(&of_all.narrow(0, 0, 1)?)?);
    }
    Ok(())
}

#[test]
fn what_is_not_made_in_bf16_is_refused() -> Outcome {
    let Some([rounded, exact]) = both()? else { return Ok(()) };
    let scene = scene(3, 2, 11)?;
    let refused = |result: Result<candle_core::Tensor, TrajError>| match result {
        Err(TrajError::Batch { name: "network", problem }) => Ok(problem),
        other => Err(format!("{other:?}")),
    };
    assert!(refused(rounded.roll_out_on(Engine::Graph, &scene, Phase::Full))?.contains("take f32"));
    let goals = Var::from_tensor(&scene.goals)?;
    let learning = RollOutBatch { goals: goals.as_tensor().clone(), ..scene.clone() };
    assert!(refused(rounded.roll_out(&learning, Phase::Full))?.contains("gradient"));
    // From one in bf16 back to the bits of f32.
    let back = rounded.frozen_in(Precision::F32)?;
    assert_eq!(values(&back.roll_out(&scene, Phase::Full)?)?, values(&exact.roll_out(&scene, Phase::Full)?)?);
    Ok(())
}
