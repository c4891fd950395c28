//! Quantiles, and a line through scattered points that a few of them cannot turn.

/// Points a line is fitted to at most: every pair of them is looked at.
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

/// A line through points.
pub(crate) struct Line {
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
    /// Kendall's rank correlation of the points.
    pub(crate) tau: f64,
    /// The same in standard deviations of independent points.
    pub(crate) tau_z: f64,
}

/// The line of Theil (1950) and Sen (1968): the median slope of all pairs at least `apart` apart in x. Beyond 1500 points
/// an even choice of them is taken. `None` where no pair is so far apart.
pub(crate) fn theil_sen(points: &[[f64; 2]], apart: f64) -> Option<Line> {
    let chosen: Vec<[f64; 2]> = points.iter().copied().step_by(points.len().div_ceil(MOST).max(1)).collect();
    let (mut slopes, mut balance) = (Vec::new(), 0i64);
    for (i, a) in chosen.iter().enumerate() {
        for b in &chosen[i + 1..] {
            let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
            balance += (dx * dy).partial_cmp(&0.).map_or(0, |order| order as i64);
            if dx.abs() >= apart && dx != 0. {
                slopes.push(dy / dx);
            }
        }
    }
    let slope = median(slopes)?;
    let intercept = median(chosen.iter().map(|p| p[1] - slope * p[0]).collect())?;
    let n = chosen.len() as f64;
    let tau = balance as f64 / (n * (n - 1.) / 2.);
    Some(Line { slope, intercept, tau, tau_z: tau / (2. * (2. * n + 5.) / (9. * n * (n - 1.))).sqrt() })
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
        let line = theil_sen(&points, 1.).unwrap();
        assert!((line.slope + 3.).abs() < 1e-9 && (line.intercept - 100.).abs() < 1e-9);
        assert!(line.tau < -0.4 && line.tau_z < -3.);
        assert!(theil_sen(&points[..1], 1.).is_none());
    }
}
