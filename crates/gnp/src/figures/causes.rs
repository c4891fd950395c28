//! What moves a vehicle, and what would without its leader: the window in which deleting the leader changes most.

use gnp_data::{DataError, EditedScene, Forecast, Observation, Predictor as _, SceneEdit};
use gnp_plot::Figure;

use super::Material;
use crate::error::Result;
use crate::explain::pictures;
use crate::what_if::{Change, Moment, ScenePredictor};

/// Windows of which the leader is deleted, at most; of more, every n-th is taken.
const MOST: usize = 400;

/// `contributions` and `what-if`; nothing where no vehicle has a leader or the model has no physics.
pub(super) fn figures(material: &Material<'_>) -> Result<Vec<Figure>> {
    let (run, gnp) = (material.run, material.gnp);
    let led: Vec<(usize, u32)> = (0..material.windows.len())
        .filter_map(|i| Some((i, material.windows[i].observation().leader()?.vehicle())))
        .collect();
    let every = led.len().div_ceil(MOST).max(1);
    let led: Vec<(usize, u32)> = led.into_iter().step_by(every).collect();
    let mut most: Option<(f32, usize, u32)> = None;
    for batch in led.chunks(run.config.evaluate.batch) {
        run.machine.stop.check()?;
        let without = |(i, leader): &(usize, u32)| -> Result<(u32, EditedScene)> {
            let seen = material.windows[*i].observation();
            let scene =
                EditedScene::of(&seen).with(&SceneEdit::Remove { vehicle: *leader }).map_err(DataError::from)?;
            Ok((seen.vehicle(), scene))
        };
        let scenes = batch.iter().map(without).collect::<Result<Vec<(u32, EditedScene)>>>()?;
        let seen = scenes.iter().map(|(vehicle, scene)| Ok(scene.observation(*vehicle)?));
        let seen = seen.collect::<Result<Vec<Observation<'_>>>>()?;
        let plain = gnp.clone().explaining(false);
        for ((i, leader), changed) in batch.iter().zip(plain.predict(&seen, run.config.predict.k)?) {
            let moved = apart(&material.forecasts[*i], &changed);
            if most.is_none_or(|(most, ..)| moved > most) {
                most = Some((moved, *i, *leader));
            }
        }
    }
    let Some((_, found, leader)) = most else { return Ok(Vec::new()) };
    let window = &material.windows[found];
    let observation = window.observation();
    let moment = Moment::of_observation(&observation);
    let changes = [Change::Scene(SceneEdit::Remove { vehicle: leader })];
    let predictor = ScenePredictor::of(gnp.clone(), material.source.simulated);
    let (explained, changed) = predictor.told(&moment, observation.vehicle(), &changes, run.config.predict.k)?;
    pictures(&explained, Some(window), (&moment, &changed), &changes, &material.source)
}

/// Distance between the ends of two predictions, m.
fn apart(a: &Forecast, b: &Forecast) -> f32 {
    let end = |forecast: &Forecast| forecast.modes.first().and_then(|mode| mode.path.last().copied());
    match (end(a), end(b)) {
        (Some(a), Some(b)) => (a[0] - b[0]).hypot(a[1] - b[1]),
        _ => 0.,
    }
}
