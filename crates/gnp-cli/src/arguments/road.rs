//! What is known of the road, of commands that read tracks.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use gnp::{DataConfig, road_options};
use gnp_data::TrackOptions;

/// `--lines`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LaneLines(Vec<f64>);

fn lane_lines(text: &str) -> Result<LaneLines, gnp_road::LaneLinesError> {
    gnp_road::parse_lane_lines(text).map(LaneLines)
}

/// What is known of the road.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct RoadArgs {
    /// Line along a road that curves, in the direction of travel and in the coordinates of the tracks, m: CSV with columns x
    /// and y, or GeoJSON [default: the road is straight, which is checked]. See docs/roads.md.
    #[arg(long, value_name = "FILE")]
    pub(crate) road: Option<PathBuf>,
    /// Lane lines beside the road's line, m, from right to left and positive to the left, such as -3.7,0,3.7 [default: those
    /// of the file, or found from the tracks].
    #[arg(long, value_name = "M,M,...", value_parser = lane_lines, allow_hyphen_values = true)]
    pub(crate) lines: Option<LaneLines>,
}

impl RoadArgs {
    /// Whether anything is said of the road.
    pub(crate) fn any(&self) -> bool {
        self.road.is_some() || self.lines.is_some()
    }

    /// Puts what is said into a configuration.
    pub(crate) fn set(&self, data: &mut DataConfig) -> Result<()> {
        if let Some(file) = &self.road {
            // A run may be resumed from another folder.
            data.road = Some(std::path::absolute(file)?);
        }
        if let Some(LaneLines(lines)) = &self.lines {
            data.lane_lines = Some(lines.clone());
        }
        Ok(())
    }

    /// The same for readers.
    ///
    /// # Errors
    /// When the file has no road.
    #[expect(clippy::result_large_err, reason = "the library's error, which it asks for")]
    pub(crate) fn options(&self) -> gnp::Result<TrackOptions> {
        road_options(self.road.as_deref(), self.lines.as_ref().map(|LaneLines(lines)| &lines[..]))
    }
}
