//! The time to estimate a motion from, fitted.

use gnp_data::{Observation, PredictError, Predictor, Window, WindowShape};
use rayon::prelude::*;

use crate::by_site::check_shapes;
use crate::motion::BaselineError;

/// Predicted frames after each whole second, from 1; the last frame where the future is shorter.
pub(crate) fn whole_seconds(shape: WindowShape) -> Vec<usize> {
    let per_second = shape.rate_hz.round().max(1.) as usize;
    let steps: Vec<usize> = (per_second..=shape.t_pred).step_by(per_second).collect();
    if steps.is_empty() { vec![shape.t_pred] } else { steps }
}

/// Of the spans from `least` frame periods to the whole past the one, s, with which the predictor that `make` makes has the
/// least squared error over whole seconds of `windows`; of equal ones the shortest.
pub(crate) fn best_span<P: Predictor>(
    rule: &'static str,
    windows: &[Window<'_>],
    least: usize,
    make: impl Fn(f64) -> Result<P, BaselineError> + Sync,
) -> Result<f64, BaselineError> {
    check_shapes(windows)?;
    let shape = windows[0].observation().shape();
    let error = |periods: usize| {
        // To the microsecond, for people who read it.
        let span_s = (periods as f64 * shape.dt() * 1e6).round() / 1e6;
        let predictor = make(span_s)?;
        let squares = squares(&predictor, windows)
            .map_err(|source| BaselineError::Rule { rule: rule.to_owned(), source: source.into() })?;
        Ok((squares, span_s))
    };
    if shape.t_obs <= least {
        let needs = format!("{rule}: windows observe {} frames and must observe {}", shape.t_obs, least + 1);
        return Err(BaselineError::Rule { rule: rule.to_owned(), source: needs.into() });
    }
    let last = shape.t_obs - 1;
    let tried = (least..=last).into_par_iter().map(error).collect::<Result<Vec<_>, BaselineError>>()?;
    let best = tried.into_iter().min_by(|(a, _), (b, _)| a.total_cmp(b));
    best.map(|(_, span_s)| span_s).ok_or(BaselineError::NoWindows)
}

/// Sum of the squared distances from the truth after each whole second, m².
fn squares(predictor: &impl Predictor, windows: &[Window<'_>]) -> Result<f64, PredictError> {
    let mut sum = 0.;
    // Some at a time: paths of all at once would fill the memory.
    for some in windows.chunks(256) {
        let observations: Vec<Observation<'_>> = some.iter().map(|window| window.observation()).collect();
        for (window, forecast) in some.iter().zip(predictor.predict(&observations, 1)?) {
            let Some(mode) = forecast.modes.first() else { continue };
            for step in whole_seconds(window.observation().shape()) {
                let (truth, [x, y]) = (window.truth().target(step - 1), mode.path[step - 1]);
                sum += f64::from(x - truth.x).powi(2) + f64::from(y - truth.y).powi(2);
            }
        }
    }
    Ok(sum)
}
