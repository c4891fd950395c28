//! What a stream refuses: a frame, or a track.

use gnp_data::limits::{MAX_LANE_WIDTH, MAX_POSITION, MAX_SPEED};
use gnp_data::{LiveError, PredictError};
use gnp_road::OffLine;

/// Why there is no stream, or no prediction for a frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OnlineError {
    /// A number of the configuration out of its range.
    #[error("{key} is {value}; give a number from {least} to {most} {unit}")]
    Config {
        /// Name of the field.
        key: &'static str,
        /// Its value.
        value: f64,
        /// Least that is allowed.
        least: f64,
        /// Most that is allowed.
        most: f64,
        /// Unit of all three.
        unit: &'static str,
    },
    /// A lane that no road has.
    #[error(
        "the lane between the lines at {right} m and {left} m is {:.1} m wide, more than {MAX_LANE_WIDTH} m: if the lines \
         are in feet, multiply them, positions and sizes by 0.3048",
        left - right
    )]
    LaneWidth {
        /// Line on the right of the lane, m.
        right: f32,
        /// Line on its left, m.
        left: f32,
    },
    /// Lane lines that make no lane, or a model whose windows cannot be.
    #[error(transparent)]
    Scene(#[from] LiveError),
    /// A time that is not after the last one. The stream is as it was before.
    #[error(
        "a frame at {time_s} s after one at {last_s} s: times must be finite and grow; `Stream::reset` starts anew"
    )]
    Time {
        /// Time of the frame, s.
        time_s: f64,
        /// Time of the frame before, s; negative infinity before the first.
        last_s: f64,
    },
    /// The model failed for all vehicles of the frame, which count as seen.
    #[error(transparent)]
    Predict(#[from] PredictError),
}

/// Why a track was not taken as it came, or a vehicle is not predicted.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Reason {
    /// A position that is not finite or too far out. The track was left out.
    #[error("its position is not finite, or not within {MAX_POSITION} m of the origin")]
    Position,
    /// A position without a place on the road's line. The track was left out.
    #[error("{0}")]
    OffRoad(OffLine),
    /// The same id a second time in the frame. The first track counts.
    #[error("its id was there already in the frame")]
    Duplicate,
    /// A new vehicle while as many are remembered as may be. The track was left out.
    #[error("there are already {0} vehicles; raise max_vehicles")]
    Capacity(usize),
    /// A velocity that cannot be. The position was used without it.
    #[error("its velocity is not finite, or above {MAX_SPEED} m/s; differences of positions were used")]
    Velocity,
    /// A size that cannot be. The one before, or that of its class, was used.
    #[error("it is longer, shorter, wider or narrower than any vehicle; the size before it was used. Check the unit")]
    Size,
    /// One position and no velocity: the next frame will tell.
    #[error("its velocity is not known yet")]
    NoVelocity,
    /// The model gave numbers that are not finite.
    #[error("the model gave no finite forecast for it")]
    NotFinite,
}

impl Reason {
    /// Whether the track was left out, so that the vehicle counts as missing in the frame.
    #[must_use]
    pub fn leaves_out(&self) -> bool {
        matches!(self, Self::Position | Self::OffRoad(_) | Self::Duplicate | Self::Capacity(_))
    }
}
