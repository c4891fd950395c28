//! Scenes: forces in chosen windows, six cases, a potential field.

use std::collections::BTreeMap;

use crate::error::Result;
use gnp_data::{Forecast, Predictor as _, Window};
use gnp_plot::{
    Case, Figure, LateralManoeuvre, Potential, Scene, SceneRule, cases, find_scene, force_scenes, lateral_manoeuvre,
    potential_field, quantiles,
};

use super::Material;

/// Arrows stand this far apart, s.
const EVERY_S: f64 = 1.;

pub(super) fn figures(material: &Material<'_>) -> Result<Vec<Figure>> {
    let mut by_direction: BTreeMap<u8, Vec<usize>> = BTreeMap::new();
    for (i, id) in material.ids.iter().enumerate() {
        let recording = &material.recordings[id.recording as usize];
        let road = usize::from(recording.tracks()[id.track as usize].road);
        by_direction.entry(recording.roads()[road].driving_direction).or_default().push(i);
    }
    let mut figures = Vec::new();
    let both = by_direction.len() > 1;
    for (direction, indices) in &by_direction {
        let mut windows: Vec<Window<'_>> = indices.iter().map(|i| material.windows[*i]).collect();
        let mut scenes = Vec::new();
        for rule in SceneRule::ALL {
            let Some(found) = find_scene(rule, &windows) else { continue };
            scenes.push(explained(material, &windows[found], rule.name())?);
            // Each scene shows another vehicle.
            let shown = (windows[found].key().recording, windows[found].key().vehicle);
            windows.retain(|window| (window.key().recording, window.key().vehicle) != shown);
        }
        if scenes.is_empty() {
            continue;
        }
        let (name, title) = if both {
            (format!("scenes-direction-{direction}"), format!("Forces on the way, driving direction {direction}"))
        } else {
            ("scenes".to_owned(), "Forces on the way".to_owned())
        };
        figures.push(force_scenes(&name, &title, &scenes, EVERY_S, &material.source));
    }
    figures.extend(six_cases(material)?);
    figures.extend(field(material)?);
    Ok(figures)
}

/// The scene of a window with the forces of its forecast.
fn explained(material: &Material<'_>, window: &Window<'_>, what: &str) -> Result<Scene> {
    let seen = window.observation();
    let k = material.run.config.predict.k;
    let forecast = material.gnp.predict(&[seen], k)?.pop().unwrap_or_default();
    let speed = seen.target(seen.shape().t_obs - 1).vx;
    let key = window.key();
    let title = format!("{what}: {}, vehicle {}, frame {}, {speed:.0} m/s", key.recording, key.vehicle, key.t0);
    Ok(Scene::of(window, forecast, title))
}

/// Two windows of each manoeuvre, a third and two thirds up the ranking by the best future's error.
fn six_cases(material: &Material<'_>) -> Result<Option<Figure>> {
    let mut found = Vec::new();
    for kind in [LateralManoeuvre::Straight, LateralManoeuvre::Left, LateralManoeuvre::Right] {
        let of_kind: Vec<usize> =
            (0..material.windows.len()).filter(|i| lateral_manoeuvre(&material.windows[*i]) == Some(kind)).collect();
        let ranked: Vec<_> = of_kind
            .iter()
            .map(|i| {
                let (window, key) = (&material.windows[*i], material.windows[*i].key());
                (f64::from(nearest(&material.forecasts[*i], window).1), (key.recording, key.vehicle))
            })
            .collect();
        for index in quantiles(&ranked, &[1. / 3., 2. / 3.]) {
            let scene = explained(material, &material.windows[of_kind[index]], "")?;
            let scene = Scene { title: scene.title.trim_start_matches(": ").to_owned(), ..scene };
            found.push(Case { kind: kind.name().to_owned(), scene });
        }
    }
    Ok((!found.is_empty()).then(|| cases(&found, &material.source)))
}

/// Index and distance in m of the future that ends nearest to the truth.
pub(super) fn nearest(forecast: &Forecast, window: &Window<'_>) -> (usize, f32) {
    let [x, y] = window.truth().goal();
    let miss = |mode: &gnp_data::Mode| mode.path.last().map_or(f32::INFINITY, |p| (p[0] - x).hypot(p[1] - y));
    let all = forecast.modes.iter().map(miss).enumerate();
    all.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, f32::INFINITY))
}

/// The field of the lane change against traffic, or of straight driving where nobody changes lanes.
fn field(material: &Material<'_>) -> Result<Option<Figure>> {
    let rules = [SceneRule::ChangeAgainstTraffic, SceneRule::StraightWithTraffic];
    let Some((rule, found)) =
        rules.into_iter().find_map(|rule| find_scene(rule, material.windows).map(|found| (rule, found)))
    else {
        return Ok(None);
    };
    let window = &material.windows[found];
    let scene = explained(material, window, rule.name())?;
    let slots = window.observation().neighbours().map(|slot| slot.map(|n| [n.now().x, n.now().y])).0;
    let potential = Potential::of(&scene, &slots, material.run.config.traj.r_col);
    Ok(potential.map(|potential| potential_field(&scene, &potential, &material.source)))
}
