//! What is known of the road and asked of recordings, beside the tracks.

use gnp_road::ReferenceLine;

use crate::recording::LaneMarking;

/// What is known of the road and asked of the recordings, beside the tracks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackOptions {
    /// Rate of the recordings, Hz: that of the tracks, or that divided by a whole number. That of the tracks where `None`.
    pub rate_hz: Option<f64>,
    /// The road: x of the recording runs along it, y to its left. Vehicles that drive against it are on a carriageway of
    /// their own. Where `None`, the road must be straight.
    pub road: Option<ReferenceLine>,
    /// Lane lines of the carriageway that runs along `road`, from right to left, y in m from it; without `road`, in m
    /// from the line in the direction of travel through the origin of the tracks' coordinates. On the other carriageway
    /// they count where vehicles are between them.
    pub lines: Option<Vec<LaneMarking>>,
}
