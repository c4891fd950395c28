//! Reliability of mode probabilities: is a mode of 30 % the right one in 30 % of the windows?

use std::collections::BTreeMap;

use crate::axes::{Axis, Panel};
use crate::figure::{Figure, Sheet, Source};
use crate::palette::{BEST, INK, VEHICLE};
use crate::road_view::LEFT;

/// Fewer vehicles than this in a bin say too little for an interval.
const FEWEST_VEHICLES: usize = 10;

/// A mode and the probability it was given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GivenMode<V> {
    /// The probability.
    pub probability: f64,
    /// Whether it was the right one.
    pub right: bool,
    /// The vehicle whose future it is: its windows are not independent.
    pub vehicle: V,
}

/// Modes whose probabilities fall into one bin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReliabilityBin {
    /// Modes in it.
    pub modes: usize,
    /// Vehicles that these belong to.
    pub vehicles: usize,
    /// Their mean probability.
    pub probability: f64,
    /// Share of them that was the right one.
    pub right: f64,
    /// 95 % interval of that share; `None` where too few vehicles are in the bin.
    pub interval: Option<[f64; 2]>,
}

/// Sorts modes into `bins` of equal width. Empty bins stay, with no modes. `interval` makes the interval of
/// a share from `[right, all]` of each vehicle.
#[must_use]
pub fn reliability_bins<V: Ord + Clone>(
    modes: &[GivenMode<V>],
    bins: usize,
    interval: impl Fn(&[[u64; 2]]) -> Option<[f64; 2]>,
) -> Vec<ReliabilityBin> {
    let bins = bins.max(1);
    let mut found: Vec<(f64, BTreeMap<V, [u64; 2]>)> = vec![(0., BTreeMap::new()); bins];
    for mode in modes.iter().filter(|mode| (0. ..=1.).contains(&mode.probability)) {
        let (sum, vehicles) = &mut found[((mode.probability * bins as f64) as usize).min(bins - 1)];
        *sum += mode.probability;
        let [right, all] = vehicles.entry(mode.vehicle.clone()).or_default();
        *right += u64::from(mode.right);
        *all += 1;
    }
    let bin = |(sum, vehicles): (f64, BTreeMap<V, [u64; 2]>)| {
        let counts: Vec<[u64; 2]> = vehicles.into_values().collect();
        let [right, all] = counts.iter().fold([0, 0], |sum, count| [sum[0] + count[0], sum[1] + count[1]]);
        if all == 0 {
            return ReliabilityBin::default();
        }
        ReliabilityBin {
            modes: all as usize,
            vehicles: counts.len(),
            probability: sum / all as f64,
            right: right as f64 / all as f64,
            interval: if counts.len() < FEWEST_VEHICLES { None } else { interval(&counts) },
        }
    };
    found.into_iter().map(bin).collect()
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
        let Some(interval) = bin.interval else { continue };
        let [low, high] = interval.map(|share| panel.at(bin.probability, share));
        sheet.svg.line(low, high, &format!("class=\"interval\" stroke=\"{BEST}\" stroke-width=\"1\""));
    }
    let place = |bin: &&ReliabilityBin| panel.at(bin.probability, bin.right);
    let sure: Vec<_> = full.iter().filter(|bin| bin.vehicles >= FEWEST_VEHICLES).map(place).collect();
    sheet.svg.path(&sure, &format!("class=\"series\" fill=\"none\" stroke=\"{BEST}\" stroke-width=\"1.6\""));
    for bin in &full {
        let fill = if bin.vehicles >= FEWEST_VEHICLES { BEST } else { "#fff" };
        sheet.svg.circle(
            place(bin),
            2.8,
            &format!("class=\"bin\" fill=\"{fill}\" stroke=\"{BEST}\" stroke-width=\"1\""),
        );
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
         windows; on the diagonal, probabilities are what they say. Bars are 95 % intervals from a bootstrap over \
         vehicles; hollow dots, of fewer than {FEWEST_VEHICLES} vehicles, have none."
    );
    sheet.finish(&caption, source)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(probability: f64, right: bool, vehicle: usize) -> GivenMode<usize> {
        GivenMode { probability, right, vehicle }
    }

    #[test]
    fn modes_are_counted_where_they_belong() {
        let modes = [
            given(0.05, false, 1),
            given(0.08, true, 1),
            given(0.95, true, 1),
            given(1., true, 2),
            given(f64::NAN, true, 3),
        ];
        let bins = reliability_bins(&modes, 10, |_| Some([0., 1.]));
        assert_eq!(bins.iter().map(|bin| bin.modes).collect::<Vec<_>>(), [2, 0, 0, 0, 0, 0, 0, 0, 0, 2]);
        assert_eq!((bins[0].right, bins[9].right), (0.5, 1.));
        assert_eq!((bins[0].vehicles, bins[9].vehicles, bins[9].interval), (1, 2, None));
        assert!((bins[0].probability - 0.065).abs() < 1e-12);
    }

    /// Twelve vehicles, the first with three modes: the interval is made of vehicles, not of modes.
    #[test]
    fn the_interval_is_made_of_counts_by_vehicle() {
        let mut modes: Vec<GivenMode<usize>> = (0..12).map(|vehicle| given(0.5, vehicle % 2 == 0, vehicle)).collect();
        modes.extend([given(0.5, true, 0), given(0.5, false, 0)]);
        let bins = reliability_bins(&modes, 1, |counts| {
            assert_eq!((counts.len(), counts[0], counts[1]), (12, [2, 3], [0, 1]));
            Some([0.25, 0.75])
        });
        assert_eq!((bins[0].modes, bins[0].vehicles, bins[0].interval), (14, 12, Some([0.25, 0.75])));
    }
}
