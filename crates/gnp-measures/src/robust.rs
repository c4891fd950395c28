//! Quantiles, and a line through scattered points that a few of them cannot turn.

/// Points whose every pair is looked at, at most.
const MOST: usize = 1500;

/// Quantile `p` of sorted values, interpolated between neighbours (type 7 of Hyndman and Fan 1996); `None` without values.
pub(crate) fn quantile(sorted: &[f64], p: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let place = p.clamp(0., 1.) * last as f64;
    let below = (place as usize).min(last);
    let above = (below + 1).min(last);
    Some(sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64))
}

/// The median of values in any order.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    quantile(&values, 0.5)
}

/// The value below and above which half of the weight lies, of (value, weight).
pub(crate) fn weighted_median(mut values: Vec<[f64; 2]>) -> Option<f64> {
    values.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    let half = values.iter().map(|value| value[1]).sum::<f64>() / 2.;
    let mut below = 0.;
    let reaches = |value: &&[f64; 2]| {
        below += value[1];
        below >= half
    };
    values.iter().find(reaches).map(|value| value[0])
}

/// A line through points.
pub(crate) struct Line {
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
}

/// The line of Theil (1950) and Sen (1968) with Jaeckel's (1972) weights: the median slope of all pairs, each weighing as much as
/// they are apart. `None` where all points are at one place.
pub(crate) fn theil_sen(points: &[[f64; 2]]) -> Option<Line> {
    let mut slopes = Vec::new();
    for (i, a) in points.iter().enumerate() {
        let others = points[i + 1..].iter().filter(|b| b[0] != a[0]);
        slopes.extend(others.map(|b| [(b[1] - a[1]) / (b[0] - a[0]), (b[0] - a[0]).abs()]));
    }
    let slope = weighted_median(slopes)?;
    Some(Line { slope, intercept: median(points.iter().map(|p| p[1] - slope * p[0]).collect())? })
}

/// Kendall's rank correlation, and the same in standard deviations of independent points. Beyond 1500 points an even choice of them is
/// taken; 0 of fewer than two.
pub(crate) fn kendall(points: &[[f64; 2]]) -> [f64; 2] {
    let chosen: Vec<[f64; 2]> = points.iter().copied().step_by(points.len().div_ceil(MOST).max(1)).collect();
    let mut balance = 0i64;
    for (i, a) in chosen.iter().enumerate() {
        let concordant =
            |b: &[f64; 2]| ((b[0] - a[0]) * (b[1] - a[1])).partial_cmp(&0.).map_or(0, |order| order as i64);
        balance += chosen[i + 1..].iter().map(concordant).sum::<i64>();
    }
    let n = chosen.len().max(2) as f64;
    let tau = balance as f64 / (n * (n - 1.) / 2.);
    [tau, tau / (2. * (2. * n + 5.) / (9. * n * (n - 1.))).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!([0., 0.5, 0.75, 1.].map(|p| quantile(&[1., 2., 3., 11.], p).unwrap()), [1., 2.5, 5., 11.]);
        assert_eq!(median(vec![9., 1., 2.]), Some(2.));
    }

    #[test]
    fn a_fifth_of_wild_points_does_not_turn_the_line() {
        let mut points: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i), 100. - 3. * f64::from(i)]).collect();
        points.iter_mut().step_by(5).for_each(|p| p[1] = 1000.);
        let line = theil_sen(&points).unwrap();
        assert!((line.slope + 3.).abs() < 1e-9 && (line.intercept - 100.).abs() < 1e-9);
        let [tau, deviations] = kendall(&points);
        assert!(tau < -0.4 && deviations < -3.);
        assert!(theil_sen(&points[..1]).is_none());
    }

    #[test]
    fn weights_shift_the_median() {
        assert_eq!(weighted_median(vec![[3., 1.], [1., 1.], [2., 1.]]), Some(2.));
        assert_eq!(weighted_median(vec![[3., 5.], [1., 1.], [2., 1.]]), Some(3.));
        assert_eq!(weighted_median(Vec::new()), None);
        assert_eq!(kendall(&[[1., 1.], [2., 2.], [3., 3.]])[0], 1.);
    }
}
