//! What is known of the road, beside the tracks.

use std::path::Path;

use gnp_data::{LaneMarking, TrackOptions};
use gnp_road::RoadFile;

use crate::error::{Context as _, Result};

/// What readers of tracks are told of the road: its line by a file ([`RoadFile::read`]), and lane lines beside it, m, from
/// right to left; without them those of the file, where it has any.
///
/// # Errors
/// When the file cannot be read or has no road, or the lines make no lanes.
pub fn road_options(file: Option<&Path>, lane_lines: Option<&[f64]>) -> Result<TrackOptions> {
    let road = file.map(RoadFile::read).transpose().context("the road's line")?;
    let of_file = road.as_ref().and_then(|road| road.lane_lines.as_deref());
    let lines = lane_lines.or(of_file).map(LaneMarking::of_carriageway).transpose().context("lane lines")?;
    Ok(TrackOptions { road: road.map(|road| road.line), lines, ..TrackOptions::default() })
}
