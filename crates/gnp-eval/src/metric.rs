//! Metrics: each with a name, a unit, a direction, the number of modes it chooses from, what one
//! window contributes and how the mean contribution becomes the value.
//!
//! "Best of k" means the best of the first k modes (the prediction, then the likeliest others), and every metric
//! chooses its own: the mode with the least ADE need not be the one with the least FDE. A forecast with fewer than k
//! modes is scored on those it has.

mod density;
mod displacement;
mod lane_change;
mod overlap;
mod sampled;

use std::fmt;

pub use crate::metric::lane_change::{BEGUN_M, BEGUN_S};
pub(crate) use crate::metric::overlap::Footprint;

use crate::case::ScoredWindow;
use crate::error::EvalError;
use crate::metric::lane_change::Beginning;

/// Beyond this error at the horizon a forecast has missed, m (Argoverse 2).
pub const MISS_M: f64 = 2.;

/// Shares of probability whose central interval along the road is looked at.
const HALF: f64 = 0.5;
const NINE_TENTHS: f64 = 0.9;

/// What a metric measures. `h` is its horizon, "error" the distance between the predicted and the
/// recorded centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MetricKind {
    /// Root of the mean squared error at `h`; best of k.
    RmseAt,
    /// As [`MetricKind::RmseAt`], squared errors first averaged within each vehicle (as PiP scores).
    RmseAtByVehicle,
    /// Root of the mean squared error over all frames up to `h`; best of k.
    RmseTo,
    /// As [`MetricKind::RmseTo`], the squared error averaged over the two coordinates: smaller by
    /// the root of 2. What the GNP paper's RMSE column appears to be.
    RmseToPerCoordinate,
    /// Root of the mean squared error across the road at `h`, of the first mode, the prediction.
    LateralRmseAt,
    /// Root of the mean squared error along the road at `h`, of the first mode, the prediction.
    LongitudinalRmseAt,
    /// Mean of predicted minus recorded position along the road at `h`, of the first mode, the prediction: below 0 a
    /// system lags behind.
    LongitudinalBiasAt,
    /// Root of the mean squared error at `h` of the mean of all modes, weighted by probability.
    MixtureMeanRmseAt,
    /// Root of the mean squared error at `h` of the likeliest mode, the one with the largest probability of all that
    /// are given (arg-max); of equal ones the first.
    LikeliestRmseAt,
    /// Average displacement error: mean error over all frames up to `h`, of the first mode, the prediction.
    Ade,
    /// Final displacement error: error at `h`, of the first mode, the prediction.
    Fde,
    /// Least ADE among k modes.
    MinAde,
    /// Least FDE among k modes.
    MinFde,
    /// Share of windows whose least FDE among k modes exceeds [`MISS_M`].
    MissRate,
    /// Least FDE among k modes plus (1 - p)², p the probability of that mode among the k
    /// (Argoverse 2). A number of mixed units, as published.
    BrierMinFde,
    /// Share of the first k modes whose centre goes beyond the outermost lines in any frame up
    /// to `h`.
    OffRoad,
    /// Share of the first k modes whose box, turned along the path, overlaps the recorded box
    /// of another vehicle in any frame up to `h`.
    Overlap,
    /// Share of windows in which the *recorded* box of the target, turned along its path, overlaps
    /// that of another vehicle in any frame up to `h`: measured positions and sizes are not exact.
    /// The floor under [`MetricKind::Overlap`], the same for every model.
    RecordedOverlap,
    /// Share of the lane changes that begin within the first second in which one of k modes ends, at
    /// `h`, in the lane in which the recorded vehicle ends. A lane change begins at the last moment at
    /// which the centre is less than [`BEGUN_M`] from where it was when last observed, so that it
    /// stays away from then on; one under way by then does not count here.
    LaneChangeRecall,
    /// As [`MetricKind::LaneChangeRecall`], of the lane changes under way: those that had taken the
    /// centre [`BEGUN_M`] or more to the side within the last observed second.
    LaneChangeRecallUnderWay,
    /// Least ADE among k modes over points 0.5 s apart up to `h` (nuScenes, Waymo).
    SampledMinAde,
    /// Share of windows in which each of k modes is [`MISS_M`] off or more at some point, of points
    /// 0.5 s apart up to `h` (nuScenes).
    AnyPointMissRate,
    /// Share of windows in which none of k modes ends in a box around the recorded centre at `h`,
    /// turned along the recorded path: 1 m to the sides and 2 m along at 3 s, 1.8 and 3.6 m at 5 s,
    /// 3 and 6 m at 8 s, half of that up to a present speed of 1.4 m/s, whole from 11 m/s on (Waymo).
    BoxMissRate,
    /// Negative log likelihood of the recorded position at `h`, under the density of the forecast
    /// ([`Spreads`](crate::Spreads)), which is per m².
    NllAt,
    /// Mean of [`MetricKind::NllAt`] over the whole seconds up to `h`.
    NllTo,
    /// Share of windows whose recorded position along the road at `h` lies in the central half of the forecast's
    /// density along the road: half of them, where forecasts say how sure they are.
    Coverage50At,
    /// The same of the central nine tenths.
    Coverage90At,
}

/// Unit of a metric's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Metres.
    Metre,
    /// A share, 0 to 1.
    Share,
    /// A sum of unlike quantities.
    Mixed,
    /// Nats, of a density per m².
    Nat,
}

/// Which way a metric is better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Direction {
    /// Lower is better.
    Lower,
    /// Higher is better.
    Higher,
    /// Nearer to a value is better.
    Towards(f64),
}

impl MetricKind {
    /// Name in score files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::RmseAt => "rmse_at",
            Self::RmseAtByVehicle => "rmse_at_by_vehicle",
            Self::RmseTo => "rmse_to",
            Self::RmseToPerCoordinate => "rmse_to_per_coordinate",
            Self::LateralRmseAt => "lateral_rmse_at",
            Self::LongitudinalRmseAt => "longitudinal_rmse_at",
            Self::LongitudinalBiasAt => "longitudinal_bias_at",
            Self::MixtureMeanRmseAt => "mixture_mean_rmse_at",
            Self::LikeliestRmseAt => "likeliest_rmse_at",
            Self::Ade => "ade",
            Self::Fde => "fde",
            Self::MinAde => "min_ade",
            Self::MinFde => "min_fde",
            Self::MissRate => "miss_rate",
            Self::BrierMinFde => "brier_min_fde",
            Self::OffRoad => "off_road",
            Self::Overlap => "overlap",
            Self::RecordedOverlap => "recorded_overlap",
            Self::LaneChangeRecall => "lane_change_recall",
            Self::LaneChangeRecallUnderWay => "lane_change_recall_under_way",
            Self::SampledMinAde => "min_ade_2hz",
            Self::AnyPointMissRate => "miss_rate_any_point",
            Self::BoxMissRate => "miss_rate_box",
            Self::NllAt => "nll_at",
            Self::NllTo => "nll_to",
            Self::Coverage50At => "coverage_50_at",
            Self::Coverage90At => "coverage_90_at",
        }
    }

    /// Unit of the value.
    #[must_use]
    pub fn unit(self) -> Unit {
        match self {
            Self::MissRate
            | Self::OffRoad
            | Self::Overlap
            | Self::RecordedOverlap
            | Self::LaneChangeRecall
            | Self::LaneChangeRecallUnderWay
            | Self::AnyPointMissRate
            | Self::BoxMissRate
            | Self::Coverage50At
            | Self::Coverage90At => Unit::Share,
            Self::BrierMinFde => Unit::Mixed,
            Self::NllAt | Self::NllTo => Unit::Nat,
            _ => Unit::Metre,
        }
    }

    /// Which way is better.
    #[must_use]
    pub fn direction(self) -> Direction {
        match self {
            Self::LaneChangeRecall | Self::LaneChangeRecallUnderWay => Direction::Higher,
            Self::LongitudinalBiasAt => Direction::Towards(0.),
            Self::Coverage50At => Direction::Towards(HALF),
            Self::Coverage90At => Direction::Towards(NINE_TENTHS),
            _ => Direction::Lower,
        }
    }

    /// Least and largest value that it can have.
    #[must_use]
    pub(crate) fn range(self) -> [f64; 2] {
        match self.unit() {
            Unit::Share => [0., 1.],
            Unit::Nat => [f64::NEG_INFINITY, f64::INFINITY],
            _ if self == Self::LongitudinalBiasAt => [f64::NEG_INFINITY, f64::INFINITY],
            _ => [0., f64::INFINITY],
        }
    }

    /// Whether it applies to every window, and so counts as many as there are.
    #[must_use]
    pub(crate) fn is_of_all_windows(name: &str) -> bool {
        let of_some = [
            Self::OffRoad,
            Self::LaneChangeRecall,
            Self::LaneChangeRecallUnderWay,
            Self::NllAt,
            Self::NllTo,
            Self::Coverage50At,
            Self::Coverage90At,
        ];
        !of_some.iter().any(|kind| kind.name() == name)
    }

    /// Whether windows are first averaged within each vehicle.
    #[must_use]
    pub(crate) fn by_vehicle(self) -> bool {
        self == Self::RmseAtByVehicle
    }

    /// The value, from the mean contribution.
    #[must_use]
    pub(crate) fn value(self, mean: f64) -> f64 {
        match self {
            Self::RmseAt
            | Self::RmseAtByVehicle
            | Self::RmseTo
            | Self::RmseToPerCoordinate
            | Self::LateralRmseAt
            | Self::LongitudinalRmseAt
            | Self::MixtureMeanRmseAt
            | Self::LikeliestRmseAt => mean.sqrt(),
            _ => mean,
        }
    }
}

/// A metric with its horizon and the number of modes it chooses from.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Metric {
    /// What is measured.
    pub kind: MetricKind,
    /// Modes to choose from, the first k; `None` where all modes enter.
    pub k: Option<usize>,
    /// Time up to which, or at which, it is measured, s.
    pub horizon_s: f64,
}

impl Metric {
    /// A metric of the first mode alone, the prediction.
    #[must_use]
    pub fn top_1(kind: MetricKind, horizon_s: f64) -> Self {
        Self { kind, k: Some(1), horizon_s }
    }

    /// A metric of the first k modes.
    #[must_use]
    pub fn best_of(kind: MetricKind, k: usize, horizon_s: f64) -> Self {
        Self { kind, k: Some(k), horizon_s }
    }

    /// A metric of all modes.
    #[must_use]
    pub fn of_all(kind: MetricKind, horizon_s: f64) -> Self {
        Self { kind, k: None, horizon_s }
    }

    /// What one window adds: the metric's value is a function of the mean of these, so their sums by
    /// vehicle are all that an interval needs. `None` where the metric does not apply, as off-road
    /// without lines.
    ///
    /// # Errors
    /// When the window has no frame at the horizon.
    pub fn contribution(&self, case: &ScoredWindow<'_>) -> Result<Option<f64>, EvalError> {
        let frames = case.reference().frames(self.horizon_s)?;
        let k = self.k.unwrap_or(usize::MAX).clamp(1, case.modes().len());
        Ok(match self.kind {
            MetricKind::RmseAt | MetricKind::RmseAtByVehicle => Some(displacement::least_squared_at(case, k, frames)),
            MetricKind::RmseTo => Some(displacement::least_squared_to(case, k, frames)),
            MetricKind::RmseToPerCoordinate => Some(displacement::least_squared_to(case, k, frames) / 2.),
            MetricKind::LateralRmseAt => Some(displacement::squared_along(case, 1, frames)),
            MetricKind::LongitudinalRmseAt => Some(displacement::squared_along(case, 0, frames)),
            MetricKind::LongitudinalBiasAt => Some(displacement::ahead(case, frames)),
            MetricKind::MixtureMeanRmseAt => Some(displacement::squared_of_mean(case, frames)),
            MetricKind::LikeliestRmseAt => Some(displacement::squared_of_likeliest(case, frames)),
            MetricKind::Ade => Some(displacement::least_ade(case, 1, frames)),
            MetricKind::Fde => Some(displacement::least_squared_at(case, 1, frames).sqrt()),
            MetricKind::MinAde => Some(displacement::least_ade(case, k, frames)),
            MetricKind::MinFde => Some(displacement::least_squared_at(case, k, frames).sqrt()),
            MetricKind::MissRate => Some(one_if(displacement::least_squared_at(case, k, frames).sqrt() > MISS_M)),
            MetricKind::BrierMinFde => Some(displacement::brier_least_fde(case, k, frames)),
            MetricKind::OffRoad => displacement::share_off_road(case, k, frames),
            MetricKind::Overlap => Some(overlap::share(case, k, frames)),
            MetricKind::RecordedOverlap => Some(one_if(overlap::recorded(case, frames))),
            MetricKind::LaneChangeRecall => lane_change::found(case, k, frames, Beginning::FirstSecond),
            MetricKind::LaneChangeRecallUnderWay => lane_change::found(case, k, frames, Beginning::Before),
            MetricKind::SampledMinAde => Some(sampled::least_ade(case, k, self.horizon_s)),
            MetricKind::AnyPointMissRate => Some(one_if(sampled::every_mode_leaves(case, k, self.horizon_s))),
            MetricKind::BoxMissRate => Some(one_if(sampled::outside_box(case, k, frames, self.horizon_s))),
            MetricKind::NllAt => density::negative_log_likelihood_at(case, self.horizon_s)?,
            MetricKind::NllTo => density::negative_log_likelihood_to(case, self.horizon_s)?,
            MetricKind::Coverage50At => density::in_central(case, self.horizon_s, HALF)?.map(one_if),
            MetricKind::Coverage90At => density::in_central(case, self.horizon_s, NINE_TENTHS)?.map(one_if),
        })
    }
}

/// A window that counts, or one that does not.
fn one_if(counts: bool) -> f64 {
    f64::from(u8::from(counts))
}

impl fmt::Display for Metric {
    /// As `min_fde (k = 6, 5 s)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.k {
            Some(k) => write!(f, "{} (k = {k}, {} s)", self.kind.name(), self.horizon_s),
            None => write!(f, "{} ({} s)", self.kind.name(), self.horizon_s),
        }
    }
}

#[cfg(test)]
mod tests;
