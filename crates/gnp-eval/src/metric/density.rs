//! What one window adds to the metrics of a forecast's density; nothing where the system has none.

use crate::case::ScoredWindow;
use crate::error::EvalError;
use crate::spreads::{negative_log_likelihood, share_below};

/// Negative log likelihood of what happened at `horizon_s`, nats, the density per m².
///
/// # Errors
/// When the window has no frame at the horizon.
pub(super) fn negative_log_likelihood_at(case: &ScoredWindow<'_>, horizon_s: f64) -> Result<Option<f64>, EvalError> {
    let frames = case.reference().frames(horizon_s)?;
    Ok(case.spreads_to(horizon_s).last().map(|spread| negative_log_likelihood(case, frames, spread)))
}

/// Mean of [`negative_log_likelihood_at`] over the whole seconds up to `horizon_s`, nats.
///
/// # Errors
/// As [`negative_log_likelihood_at`].
pub(super) fn negative_log_likelihood_to(case: &ScoredWindow<'_>, horizon_s: f64) -> Result<Option<f64>, EvalError> {
    let spreads = case.spreads_to(horizon_s);
    let mut sum = 0.;
    for spread in spreads {
        sum += negative_log_likelihood(case, case.reference().frames(spread.horizon_s)?, spread);
    }
    Ok((!spreads.is_empty()).then(|| sum / spreads.len() as f64))
}

/// Whether the distance driven along the road by `horizon_s` lies in the central interval that holds `share` of the
/// forecast's probability.
///
/// # Errors
/// As [`negative_log_likelihood_at`].
pub(super) fn in_central(case: &ScoredWindow<'_>, horizon_s: f64, share: f64) -> Result<Option<bool>, EvalError> {
    let frames = case.reference().frames(horizon_s)?;
    let inside = |below: f64| (below - 0.5).abs() <= share / 2.;
    Ok(case.spreads_to(horizon_s).last().map(|spread| inside(share_below(case, frames, spread))))
}
