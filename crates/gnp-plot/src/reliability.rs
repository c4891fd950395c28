//! Reliability of mode probabilities: is a mode of 30 % the right one in 30 % of the windows?

use crate::axes::{Axis, Panel};
use crate::figure::{Figure, Sheet, Source};
use crate::palette::{BEST, INK, VEHICLE};
use crate::road_view::LEFT;

/// Modes whose probabilities fall into one bin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReliabilityBin {
    /// Modes in it.
    pub modes: usize,
    /// Their mean probability.
    pub probability: f64,
    /// Share of them that was the right one.
    pub right: f64,
    /// 95 % interval of that share (Wilson).
    pub interval: [f64; 2],
}

/// Sorts modes, each a probability and whether it was the right one, into `bins` of equal width.
/// Empty bins stay, with no modes.
#[must_use]
pub fn reliability_bins(modes: &[(f64, bool)], bins: usize) -> Vec<ReliabilityBin> {
    let bins = bins.max(1);
    let mut found = vec![(0usize, 0f64, 0usize); bins];
    for (probability, right) in modes.iter().filter(|(p, _)| (0. ..=1.).contains(p)) {
        let bin = &mut found[((probability * bins as f64) as usize).min(bins - 1)];
        *bin = (bin.0 + 1, bin.1 + probability, bin.2 + usize::from(*right));
    }
    let bin = |(modes, sum, right): (usize, f64, usize)| match modes {
        0 => ReliabilityBin::default(),
        _ => ReliabilityBin {
            modes,
            probability: sum / modes as f64,
            right: right as f64 / modes as f64,
            interval: wilson(right as f64, modes as f64),
        },
    };
    found.into_iter().map(bin).collect()
}

/// 95 % interval of a share of `right` in `n` independent draws.
fn wilson(right: f64, n: f64) -> [f64; 2] {
    const Z: f64 = 1.96;
    let share = right / n;
    let middle = (share + Z * Z / (2. * n)) / (1. + Z * Z / n);
    let half = Z / (1. + Z * Z / n) * (share * (1. - share) / n + Z * Z / (4. * n * n)).sqrt();
    [(middle - half).max(0.), (middle + half).min(1.)]
}

/// The diagram, with the number of modes in each bin below. `k` futures a window.
#[must_use]
pub fn reliability(bins: &[ReliabilityBin], k: usize, windows: usize, source: &Source) -> Figure {
    let mut sheet = Sheet::new("reliability", "Reliability of mode probabilities");
    let panel = Panel { place: [LEFT + 21., sheet.y + 8., 240., 240.], x: Axis::new(0., 1.), y: Axis::new(0., 1.) };
    let right_label = format!("share nearest to the truth of {k}");
    panel.frame(&mut sheet.svg, "probability given to a mode", &right_label, true);
    let diagonal = format!("class=\"diagonal\" stroke=\"{INK}\" stroke-width=\"1\" stroke-dasharray=\"4 3\"");
    sheet.svg.line(panel.at(0., 0.), panel.at(1., 1.), &diagonal);
    sheet.svg.text(panel.at(0.78, 0.85), "calibrated", &format!("font-size=\"9\" fill=\"{INK}\" text-anchor=\"end\""));
    let full: Vec<&ReliabilityBin> = bins.iter().filter(|bin| bin.modes > 0).collect();
    for bin in &full {
        let [low, high] = bin.interval.map(|share| panel.at(bin.probability, share));
        sheet.svg.line(low, high, &format!("class=\"interval\" stroke=\"{BEST}\" stroke-width=\"1\""));
    }
    let points: Vec<_> = full.iter().map(|bin| panel.at(bin.probability, bin.right)).collect();
    sheet.svg.path(&points, &format!("class=\"series\" fill=\"none\" stroke=\"{BEST}\" stroke-width=\"1.6\""));
    for point in &points {
        sheet.svg.circle(*point, 2.8, &format!("class=\"bin\" fill=\"{BEST}\""));
    }
    sheet.y += 8. + 240. + 30.;
    let most = bins.iter().map(|bin| bin.modes).max().unwrap_or(1).max(1) as f64;
    let counts =
        Panel { place: [LEFT + 21., sheet.y + 4., 240., 56.], x: Axis::new(0., 1.), y: Axis::log(0.8, most * 1.5) };
    counts.frame(&mut sheet.svg, "probability given to a mode", "modes", true);
    for (i, bin) in bins.iter().enumerate().filter(|(_, bin)| bin.modes > 0) {
        let wide = 1. / bins.len() as f64;
        let [left, top] = counts.at((i as f64 + 0.06) * wide, bin.modes as f64);
        let [right, bottom] = counts.at((i as f64 + 0.94) * wide, 0.8);
        sheet.svg.rect(left, top, right - left, bottom - top, &format!("class=\"count\" fill=\"{VEHICLE}\""));
    }
    sheet.y += 60. + 26.;
    let caption = format!(
        "How often a mode given a probability was the one of {k} that ended nearest to the truth, over {windows} \
         windows; on the diagonal, probabilities are what they say. Bars are 95 % intervals as if windows were \
         independent, which windows of one vehicle are not: the true ones are wider."
    );
    sheet.finish(&caption, source)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_counted_where_they_belong() {
        let bins = reliability_bins(&[(0.05, false), (0.08, true), (0.95, true), (1., true), (f64::NAN, true)], 10);
        assert_eq!(bins.iter().map(|bin| bin.modes).collect::<Vec<_>>(), [2, 0, 0, 0, 0, 0, 0, 0, 0, 2]);
        assert_eq!((bins[0].right, bins[9].right), (0.5, 1.));
        assert!((bins[0].probability - 0.065).abs() < 1e-12);
    }

    /// Wilson's interval of 8 in 10 is 0.490 to 0.943.
    #[test]
    fn the_interval_is_known() {
        let [low, high] = wilson(8., 10.);
        assert!((low - 0.490).abs() < 1e-3 && (high - 0.943).abs() < 1e-3, "{low} {high}");
        assert_eq!(wilson(0., 5.)[0], 0.);
    }
}
