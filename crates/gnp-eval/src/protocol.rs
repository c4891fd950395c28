//! Named protocols: which metrics, how many futures a model is asked for, and whether it may be
//! handed recorded futures.
//!
//! The GNP paper's Table 1 sets its own numbers, which are the best of 20 goals averaged up to the
//! horizon, beside other papers' top-1 errors at the instant. These are different quantities, so
//! each has a protocol of its own, and no table mixes two.

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
}

impl Protocol {
    /// All protocols.
    pub const ALL: [Self; 3] = [Self::Paper, Self::Literature, Self::Clean];

    /// Name in score files, configurations and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Literature => "literature",
            Self::Clean => "clean",
        }
    }

    /// What a table says of it in a few words.
    #[must_use]
    pub fn summary(self) -> &'static str {
        match self {
            Self::Paper => "best of k = 20, averaged up to the horizon, RMSE per coordinate",
            Self::Literature => "top-1 (k = 1), error at the instant",
            Self::Clean => "no future input, top-1 (k = 1) and best of k = 6",
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
            Self::Clean => &[6, 20],
        }
    }

    /// Whether models that are handed recorded futures may enter. Their numbers are marked.
    #[must_use]
    pub fn allows_future_input(self) -> bool {
        self != Self::Clean
    }

    /// Its metrics for windows of a shape, at each whole second that has a frame.
    ///
    /// # Errors
    /// When no whole second has a frame.
    pub fn metrics(self, shape: &WindowShape) -> Result<Vec<Metric>, EvalError> {
        use MetricKind as M;
        let seconds = whole_seconds(shape)?;
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
                    metrics.extend([M::LateralRmseAt, M::LongitudinalRmseAt].map(top));
                    metrics.push(Metric::of_all(M::MixtureMeanRmseAt, second));
                    for k in [6, 20] {
                        metrics.extend([M::MinAde, M::MinFde].map(|kind| best(kind, k)));
                    }
                }
            }
        }
        if let (Self::Clean, Some(last)) = (self, seconds.last()) {
            for k in [1, 6, 20] {
                let kinds = [M::MissRate, M::BrierMinFde, M::OffRoad, M::Overlap];
                metrics.extend(kinds.map(|kind| Metric::best_of(kind, k, *last)));
            }
        }
        Ok(metrics)
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

    const SHAPE: WindowShape = WindowShape { observed: 31, predicted: 50, step: 1, rate_hz: 10. };

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
    fn top_1_and_best_of_6_come_from_one_answer() {
        let clean = Protocol::Clean;
        let answer = |kind, k| clean.answer_for(&Metric::best_of(kind, k, 5.));
        assert_eq!(answer(MetricKind::RmseAt, 1), answer(MetricKind::MinFde, 6));
        assert_eq!(answer(MetricKind::MinFde, 20), 1);
        assert_eq!(clean.answer_for(&Metric::of_all(MetricKind::MixtureMeanRmseAt, 5.)), 1);
    }

    #[test]
    fn only_clean_refuses_future_input() {
        assert_eq!(Protocol::ALL.map(Protocol::allows_future_input), [true, true, false]);
    }

    #[test]
    fn names_are_those_of_configurations() {
        for protocol in Protocol::ALL {
            assert_eq!(serde_json::to_value(protocol).unwrap(), protocol.name());
        }
    }

    /// The literature's protocol never looks past the likeliest mode, the paper's never at it alone.
    #[test]
    fn protocols_do_not_mix() {
        assert!(Protocol::Literature.metrics(&SHAPE).unwrap().iter().all(|metric| metric.k == Some(1)));
        assert!(Protocol::Paper.metrics(&SHAPE).unwrap().iter().all(|metric| metric.k == Some(20)));
    }
}
