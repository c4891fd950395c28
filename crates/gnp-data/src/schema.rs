//! What the readers take and what comes out: columns, units, conventions, as text.

use std::fmt::Write as _;

use crate::recording::Dataset;

/// A column: its name, its unit, what it means.
type Column = (&'static str, &'static str, &'static str);

/// Columns read of an NGSIM table.
const NGSIM: [Column; 11] = [
    ("Vehicle_ID", "-", "vehicle; begins again in every period, and may return after a gap"),
    ("Frame_ID", "0.1 s", "frame; begins again in every period"),
    ("Global_Time", "ms", "time; tells periods and the rate"),
    ("Local_X", "ft", "front centre, from the left edge of the road to the right"),
    ("Local_Y", "ft", "front centre, along the road"),
    ("v_Length", "ft", "length of the vehicle"),
    ("v_Width", "ft", "width of the vehicle"),
    ("v_Class", "-", "1 motorcycle, 2 car, 3 truck"),
    ("v_Vel", "ft/s", "speed, a scalar: checked, then left; velocities come from positions"),
    ("Lane_ID", "-", "lane, 1 leftmost; 7 and 8 are ramps; 0 unknown"),
    ("Location", "-", "site, where the file has it: us-101 and i-80 are read, streets are counted and skipped"),
];

/// Columns read of highD's `NN_tracks.csv`.
const HIGHD_TRACKS: [Column; 17] = [
    ("frame", "1/frameRate s", "frame"),
    ("id", "-", "vehicle"),
    ("x", "m", "upper-left corner of the box, to the right in the image"),
    ("y", "m", "upper-left corner of the box, downwards in the image"),
    ("width", "m", "extent along x: the vehicle's length"),
    ("height", "m", "extent along y: the vehicle's width"),
    ("xVelocity", "m/s", "velocity along x"),
    ("yVelocity", "m/s", "velocity along y, downwards"),
    ("precedingId", "-", "vehicle ahead in the lane; 0 or -1 none"),
    ("followingId", "-", "vehicle behind in the lane"),
    ("leftPrecedingId", "-", "vehicle ahead in the lane to the left of travel"),
    ("leftAlongsideId", "-", "vehicle beside in the lane to the left"),
    ("leftFollowingId", "-", "vehicle behind in the lane to the left"),
    ("rightPrecedingId", "-", "vehicle ahead in the lane to the right of travel"),
    ("rightAlongsideId", "-", "vehicle beside in the lane to the right"),
    ("rightFollowingId", "-", "vehicle behind in the lane to the right"),
    ("laneId", "-", "lane"),
];

/// Columns read of highD's `NN_tracksMeta.csv`.
const HIGHD_TRACKS_META: [Column; 5] = [
    ("id", "-", "vehicle"),
    ("width", "m", "length of the vehicle"),
    ("height", "m", "width of the vehicle"),
    ("class", "-", "Car, Van, Truck, Bus, Motorcycle"),
    ("drivingDirection", "-", "1 upper carriageway, towards smaller x; 2 lower"),
];

/// Columns read of highD's `NN_recordingMeta.csv`.
const HIGHD_RECORDING_META: [Column; 4] = [
    ("frameRate", "Hz", "frames per second"),
    ("locationId", "-", "site"),
    ("upperLaneMarkings", "m", "y of every marking of carriageway 1, `a;b;c`; the outer two are boundaries"),
    ("lowerLaneMarkings", "m", "y of every marking of carriageway 2"),
];

/// Columns of a recording, whatever it was read from.
const RECORDING: [Column; 10] = [
    ("vehicle", "-", "vehicle of the file"),
    ("segment", "-", "gap-free stretch of the vehicle, from 0"),
    ("frame", "1/rate_hz s", "frame of the file"),
    ("x", "m", "centre of the box, forward along the road"),
    ("y", "m", "centre of the box, to the left of travel"),
    ("vx", "m/s", "velocity forward"),
    ("vy", "m/s", "velocity to the left"),
    ("length, width", "m", "extent of the box along and across the road"),
    ("lane", "-", "lane of the file, 0 unknown"),
    (
        "neighbours",
        "-",
        "tracks in the eight slots: preceding, following, left and right preceding, alongside, following",
    ),
];

/// The columns that are read of a dataset, those of the recording they become, and their units.
#[must_use]
pub fn describe(dataset: Dataset) -> String {
    let mut text = String::new();
    match dataset {
        Dataset::Ngsim => {
            text.push_str(
                "NGSIM: one table a period and site, .csv or .txt, plain or .gz, 18 columns separated by commas or\n\
                 blanks, with or without a header; with `Location` as well; or the merged export of 25 columns.\n\
                 Rate: 10 frames per second, measured from Global_Time.\n",
            );
            table(&mut text, "Columns read", &NGSIM);
            text.push_str(
                "\nfeet become metres; the front centre becomes the centre, half a length back; x = Local_Y,\n\
                 y = -Local_X. The data has no markings: lane lines are fitted midway between the lanes' median\n\
                 positions, with edges 3.66 m beyond the outermost. Neighbours come from Lane_ID and x.\n",
            );
        }
        Dataset::HighD => {
            text.push_str(
                "highD: three tables a recording, plain or .gz, beside one another. Rate: frameRate, 25 in the original.\n",
            );
            table(&mut text, "Columns read of NN_tracks.csv", &HIGHD_TRACKS);
            table(&mut text, "Columns read of NN_tracksMeta.csv", &HIGHD_TRACKS_META);
            table(&mut text, "Columns read of NN_recordingMeta.csv", &HIGHD_RECORDING_META);
            text.push_str(
                "\nThe corner becomes the centre, y is flipped, and carriageway 1 is rotated by pi: its x' = -x, y' = y;\n\
                 carriageway 2 has x' = x, y' = -y. Left stays left, velocities and markings turn with the positions.\n",
            );
        }
    }
    table(&mut text, "Columns of the recording", &RECORDING);
    text
}

fn table(text: &mut String, title: &str, columns: &[Column]) {
    let name = columns.iter().map(|column| column.0.len()).max().unwrap_or(0);
    let unit = columns.iter().map(|column| column.1.len()).max().unwrap_or(0);
    // Writing to a String cannot fail.
    let _ = writeln!(text, "\n{title}");
    for column in columns {
        let _ = writeln!(text, "  {:name$}  {:unit$}  {}", column.0, column.1, column.2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reader::columns_read;

    #[test]
    fn describes_every_column_that_is_read() {
        for dataset in [Dataset::Ngsim, Dataset::HighD] {
            let text = describe(dataset);
            for column in columns_read(dataset) {
                assert!(text.lines().any(|line| line.starts_with(&format!("  {column} "))), "{column} of {dataset:?}");
            }
        }
    }
}
