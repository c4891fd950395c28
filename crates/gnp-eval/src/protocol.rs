//! Named protocols: which metrics, how many futures a model is asked for, and whether it may be
//! handed recorded futures.
//!
//! The GNP paper's Table 1 sets its own numbers, which are the best of 20 goals averaged up to the
//! horizon, beside other papers' top-1 errors at the instant. These are different quantities, so
//! each has a protocol of its own, and no table mixes two.
//!
//! [`Protocol::Argoverse2`], [`Protocol::NuScenes`] and [`Protocol::Waymo`] are presets: the metrics
//! of those benchmarks by their definitions, on the windows at hand. Their numbers of modes, miss
//! rules and sampling are kept; their history, horizon and data are not, so no number may be set
//! beside a leaderboard's. Waymo's mean average precision is not among them.

use gnp_data::WindowShape;
use serde::{Deserialize, Serialize};

use crate::case::whole_seconds;
use crate::error::EvalError;
use crate::metric::{Metric, MetricKind};

/// A way to score.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// Best of 20, averaged up to the horizon, RMSE per coordinate: comparable with the GNP column
    /// of the paper's Table 1 alone.
    Paper,
    /// Top-1 RMSE in metres at each whole second: comparable with the printed S-LSTM, CS-LSTM, PiP
    /// and STDAN columns when the split is by vehicle.
    Literature,
    /// The headline: no future input of any kind, top-1 and best of 6 side by side (best of 20 as
    /// well), the same windows for every model.
    Clean,
    /// Preset: minADE, minFDE, miss rate (end error above 2 m) and brier-minFDE, k = 1 and 6.
    #[serde(rename = "av2")]
    Argoverse2,
    /// Preset: minADE over points 0.5 s apart, minFDE, miss rate (largest error of any such point
    /// 2 m or more), share of modes off the road; the first 1, 5 and 10.
    #[serde(rename = "nuscenes")]
    NuScenes,
    /// Preset: minADE over points 0.5 s apart, minFDE and miss rate (outside a box along the
    /// heading) of 6 modes at those of 3, 5 and 8 s that the windows have; box overlap of the
    /// first mode.
    Waymo,
}

/// Horizons of the Waymo preset, s.
const WAYMO_S: [f64; 3] = [3., 5., 8.];

impl Protocol {
    /// All protocols.
    pub const ALL: [Self; 6] =
        [Self::Paper, Self::Literature, Self::Clean, Self::Argoverse2, Self::NuScenes, Self::Waymo];

    /// Name in score files, configurations and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Literature => "literature",
            Self::Clean => "clean",
            Self::Argoverse2 => "av2",
            Self::NuScenes => "nuscenes",
            Self::Waymo => "waymo",
        }
    }

    /// What a table says of it in a few words.
    #[must_use]
    pub fn summary(self) -> &'static str {
        match self {
            Self::Paper => "best of k = 20, averaged up to the horizon, RMSE per coordinate",
            Self::Literature => "top-1 (k = 1), error at the instant",
            Self::Clean => "no future input, top-1 (k = 1) and best of k = 6",
            Self::Argoverse2 => "metrics of Argoverse 2, k = 1 and 6",
            Self::NuScenes => "metrics of nuScenes, points 0.5 s apart, the first k = 1, 5 and 10",
            Self::Waymo => "metrics of Waymo motion, points 0.5 s apart, k = 6",
        }
    }

    /// How many futures a model is asked for, once for each entry. A metric of the best of k is
    /// taken from the answer to the smallest entry that is not below k: a model that chooses its
    /// futures knowing how many it may give is scored on that choice.
    #[must_use]
    pub fn asks(self) -> &'static [usize] {
        match self {
            Self::Paper => &[20],
            Self::Literature => &[1],
            Self::Clean => &[1, 6, 20],
            Self::Argoverse2 | Self::Waymo => &[6],
            Self::NuScenes => &[10],
        }
    }

    /// Whether models that are handed recorded futures may enter. Their numbers are marked.
    #[must_use]
    pub fn allows_future(self) -> bool {
        self != Self::Clean
    }

    /// Its metrics for windows of a shape, at each whole second that has a frame.
    ///
    /// # Errors
    /// When no whole second has a frame; for Waymo, none of 3, 5 and 8 s.
    pub fn metrics(self, shape: &WindowShape) -> Result<Vec<Metric>, EvalError> {
        use MetricKind as M;
        let seconds = whole_seconds(shape)?;
        let last = seconds.last().copied().unwrap_or_default();
        let mut metrics = Vec::new();
        for second in &seconds {
            let second = *second;
            let top = |kind| Metric::top_1(kind, second);
            let best = |kind, k| Metric::best_of(kind, k, second);
            match self {
                Self::Paper => {
                    metrics
                        .extend([M::MinAde, M::MinFde, M::RmseTo, M::RmseToPerCoordinate].map(|kind| best(kind, 20)));
                }
                Self::Literature => metrics.extend([M::RmseAt, M::RmseAtByVehicle].map(top)),
                Self::Clean => {
                    metrics.extend([M::RmseAt, M::RmseTo, M::RmseToPerCoordinate, M::Ade, M::Fde].map(top));
                    metrics.extend([M::LateralRmseAt, M::LongitudinalRmseAt, M::LongitudinalBiasAt].map(top));
                    let of_all = [M::MixtureMeanRmseAt, M::LikeliestRmseAt, M::NllAt, M::Coverage50At, M::Coverage90At];
                    metrics.extend(of_all.map(|kind| Metric::of_all(kind, second)));
                    for k in [6, 20] {
                        metrics.extend([M::MinAde, M::MinFde].map(|kind| best(kind, k)));
                    }
                }
                Self::Waymo if WAYMO_S.contains(&second) => {
                    metrics.extend([M::SampledMinAde, M::MinFde, M::BoxMissRate].map(|kind| best(kind, 6)));
                    metrics.push(top(M::Overlap));
                }
                Self::Argoverse2 | Self::NuScenes | Self::Waymo => {}
            }
        }
        let at_end: (&[usize], &[M]) = match self {
            Self::Paper | Self::Literature | Self::Waymo => (&[], &[]),
            Self::Clean => (&[1, 6, 20], &[M::MissRate, M::BrierMinFde, M::OffRoad, M::Overlap]),
            Self::Argoverse2 => (&[1, 6], &[M::MinAde, M::MinFde, M::MissRate, M::BrierMinFde]),
            Self::NuScenes => (&[1, 5, 10], &[M::SampledMinAde, M::MinFde, M::AnyPointMissRate, M::OffRoad]),
        };
        for k in at_end.0 {
            metrics.extend(at_end.1.iter().map(|kind| Metric::best_of(*kind, *k, last)));
        }
        if self == Self::Clean {
            metrics.extend([M::NllTo, M::RecordedOverlap].map(|kind| Metric::of_all(kind, last)));
            for kind in [M::LaneChangeRecall, M::LaneChangeRecallUnderWay] {
                metrics.extend([1, 6].map(|k| Metric::best_of(kind, k, last)));
            }
        }
        if metrics.is_empty() {
            return Err(EvalError::Horizon { horizon_s: WAYMO_S[0], rate_hz: shape.rate_hz, t_pred: shape.t_pred });
        }
        Ok(metrics)
    }

    /// The metrics by which one model is called better than another, at the last whole second. Those of densities
    /// apply to models that have [`Spreads`](crate::Spreads).
    ///
    /// # Errors
    /// As [`Protocol::metrics`].
    pub fn headline(self, shape: &WindowShape) -> Result<Vec<Metric>, EvalError> {
        let last = self.metrics(shape)?.iter().map(|metric| metric.horizon_s).fold(0., f64::max);
        Ok(self.headline_at(last))
    }

    /// [`Protocol::headline`] at the last horizon of its metrics, s.
    pub(crate) fn headline_at(self, last: f64) -> Vec<Metric> {
        use MetricKind as M;
        let best = |kind, k| Metric::best_of(kind, k, last);
        match self {
            Self::Paper => vec![best(M::MinAde, 20), best(M::MinFde, 20), best(M::RmseToPerCoordinate, 20)],
            Self::Literature => vec![best(M::RmseAt, 1)],
            Self::Clean => vec![
                best(M::RmseAt, 1),
                Metric::of_all(M::MixtureMeanRmseAt, last),
                Metric::of_all(M::LikeliestRmseAt, last),
                best(M::MinAde, 6),
                best(M::MinFde, 6),
                best(M::MissRate, 6),
                Metric::of_all(M::NllTo, last),
            ],
            Self::Argoverse2 => vec![best(M::MinFde, 6), best(M::BrierMinFde, 6)],
            Self::NuScenes => vec![best(M::SampledMinAde, 5), best(M::AnyPointMissRate, 5)],
            Self::Waymo => vec![best(M::SampledMinAde, 6), best(M::BoxMissRate, 6)],
        }
    }

    /// Whether scores are also given by [`Manoeuvre`](crate::Manoeuvre).
    #[must_use]
    pub(crate) fn by_manoeuvre(self) -> bool {
        self == Self::Clean
    }

    /// Index into [`Protocol::asks`] of the answer a metric is taken from. Metrics of all modes
    /// take the largest.
    #[must_use]
    pub(crate) fn answer_for(self, metric: &Metric) -> usize {
        let asks = self.asks();
        let wanted = metric.k.unwrap_or(usize::MAX);
        asks.iter().position(|ask| *ask >= wanted).unwrap_or(asks.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: WindowShape = WindowShape { t_obs: 31, t_pred: 50, step: 1, rate_hz: 10. };

    #[test]
    fn every_metric_has_an_answer_with_enough_modes() {
        for protocol in Protocol::ALL {
            let metrics = protocol.metrics(&SHAPE).unwrap();
            for metric in &metrics {
                let asked = protocol.asks()[protocol.answer_for(metric)];
                assert!(asked >= metric.k.unwrap_or(0), "{}: {metric}", protocol.name());
            }
            for (i, metric) in metrics.iter().enumerate() {
                assert!(!metrics[..i].contains(metric), "{}: {metric} twice", protocol.name());
            }
        }
    }

    #[test]
    fn each_metric_takes_the_answer_to_its_own_number_of_futures() {
        let clean = Protocol::Clean;
        let answer = |kind, k| clean.asks()[clean.answer_for(&Metric::best_of(kind, k, 5.))];
        assert_eq!(answer(MetricKind::RmseAt, 1), 1);
        assert_eq!(answer(MetricKind::MinFde, 6), 6);
        assert_eq!(answer(MetricKind::MinFde, 20), 20);
        let mixture = Metric::of_all(MetricKind::MixtureMeanRmseAt, 5.);
        assert_eq!(clean.asks()[clean.answer_for(&mixture)], 20);
    }

    #[test]
    fn only_clean_refuses_future_input() {
        let refusing: Vec<_> = Protocol::ALL.into_iter().filter(|protocol| !protocol.allows_future()).collect();
        assert_eq!(refusing, [Protocol::Clean]);
    }

    #[test]
    fn names_are_those_of_configurations() {
        for protocol in Protocol::ALL {
            assert_eq!(serde_json::to_value(protocol).unwrap(), protocol.name());
        }
    }

    /// The literature's protocol never looks past the first mode, the paper's never at it alone.
    #[test]
    fn protocols_do_not_mix() {
        assert!(Protocol::Literature.metrics(&SHAPE).unwrap().iter().all(|metric| metric.k == Some(1)));
        assert!(Protocol::Paper.metrics(&SHAPE).unwrap().iter().all(|metric| metric.k == Some(20)));
    }

    #[test]
    fn headlines_are_among_the_metrics() {
        for protocol in Protocol::ALL {
            let metrics = protocol.metrics(&SHAPE).unwrap();
            let headline = protocol.headline(&SHAPE).unwrap();
            assert!(!headline.is_empty());
            for metric in headline {
                assert!(metrics.contains(&metric), "{}: {metric}", protocol.name());
            }
        }
    }

    #[test]
    fn waymo_has_the_horizons_that_windows_reach() {
        let seconds = |t_pred| {
            let metrics = Protocol::Waymo.metrics(&WindowShape { t_pred, ..SHAPE })?;
            let mut seconds: Vec<f64> = metrics.iter().map(|metric| metric.horizon_s).collect();
            seconds.dedup();
            Ok(seconds)
        };
        assert_eq!(seconds(80).unwrap(), [3., 5., 8.]);
        assert_eq!(seconds(50).unwrap(), [3., 5.]);
        let short: Result<_, EvalError> = seconds(29);
        assert!(matches!(short, Err(EvalError::Horizon { .. })));
    }
}
