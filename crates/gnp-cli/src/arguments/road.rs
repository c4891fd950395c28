//! What is known of the road, of commands that read tracks.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

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
    /// and y, GeoJSON, or OpenDRIVE (FILE#ID for one road of several) [default: the road is straight, which is checked].
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

    /// The file, from the root, as a run may be resumed from another folder, and the lane lines.
    pub(crate) fn parts(&self) -> Result<(Option<PathBuf>, Option<Vec<f64>>)> {
        let file = self.road.as_deref().map(std::path::absolute).transpose()?;
        Ok((file, self.lines.as_ref().map(|LaneLines(lines)| lines.clone())))
    }

    /// As they are written on a command line.
    pub(crate) fn words(&self) -> String {
        let file = self.road.iter().map(|file| format!(" --road {}", file.display()));
        let lines = self.lines.iter().map(|LaneLines(lines)| {
            let lines: Vec<String> = lines.iter().map(f64::to_string).collect();
            format!(" --lines {}", lines.join(","))
        });
        file.chain(lines).collect()
    }
}
