//! Intervals by drawing scenes anew.
use super::Estimate;
use crate::chance::choice;

/// Draws.
const DRAWS: usize = 1000;

/// The mean of what scenes contribute, each a sum and its weight, with the interval of 95 %; none without weight.
pub(super) fn estimate(scenes: &[(f64, f64)]) -> Option<Estimate> {
    let ratio = |(sum, weight): (f64, f64)| (weight > 0.0).then(|| sum / weight);
    let add = |a: (f64, f64), b: &(f64, f64)| (a.0 + b.0, a.1 + b.1);
    let mean = ratio(scenes.iter().fold((0.0, 0.0), add))?;
    let mut means: Vec<f64> = (0..DRAWS as u64)
        .filter_map(|draw| {
            let drawn = (0..scenes.len() as u64).map(|place| &scenes[choice(&[draw, place], scenes.len())]);
            ratio(drawn.fold((0.0, 0.0), add))
        })
        .collect();
    means.sort_by(f64::total_cmp);
    let quantile = |p: f64| means.get((means.len().saturating_sub(1) as f64 * p).round() as usize).copied();
    Some(Estimate { mean, low: quantile(0.025)?, high: quantile(0.975)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_that_of_the_mean() {
        let scenes: Vec<(f64, f64)> = (0..100).map(|i| (f64::from(i % 2), 1.0)).collect();
        let found = estimate(&scenes).unwrap();
        // A share of one half of 100: the standard error is 0.05.
        assert_eq!(found.mean, 0.5);
        assert!((found.high - found.low - 2.0 * 1.96 * 0.05).abs() < 0.03, "{found:?}");
        assert_eq!(estimate(&[(3.0, 2.0); 5]).unwrap(), Estimate { mean: 1.5, low: 1.5, high: 1.5 });
        assert_eq!(estimate(&[(0.0, 0.0)]), None);
    }
}
