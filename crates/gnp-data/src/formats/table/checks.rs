//! Values of a column that must lie in a range, with the line of the first that does not.

use super::{Table, Wanted};
use crate::error::DataError;
use crate::limits::MAX_POSITION;
use crate::parts::MAX_FRAMES;

impl Table {
    /// Numbers of vehicles and frames.
    pub(in crate::formats) fn natural(&self, values: Vec<i32>, column: Wanted) -> Result<Vec<u32>, DataError> {
        if let Some(row) = values.iter().position(|v| *v < 0) {
            return Err(self.bad_value(row, column, values[row], "is negative; repair it or remove the row"));
        }
        Ok(values.into_iter().map(i32::cast_unsigned).collect())
    }

    /// Frames, not further apart than a recording may be long.
    pub(in crate::formats) fn frames(&self, values: Vec<i32>, column: Wanted) -> Result<Vec<u32>, DataError> {
        let frames = self.natural(values, column)?;
        let first = frames.iter().min().copied().unwrap_or(0);
        match frames.iter().position(|frame| frame - first > MAX_FRAMES) {
            Some(row) => Err(self.bad_value(row, column, frames[row], "is far from all other frames; repair it")),
            None => Ok(frames),
        }
    }

    /// Lane numbers; 0 is unknown.
    pub(in crate::formats) fn lane_numbers(&self, values: Vec<i32>, column: Wanted) -> Result<Vec<i16>, DataError> {
        if let Some(row) = values.iter().position(|v| !(0..=i32::from(i16::MAX)).contains(v)) {
            return Err(self.bad_value(row, column, values[row], "is not a lane number; repair it or remove the row"));
        }
        Ok(values.into_iter().map(|v| v as i16).collect())
    }

    /// Sizes.
    pub(in crate::formats) fn positive(&self, values: Vec<f32>, column: Wanted) -> Result<Vec<f32>, DataError> {
        if let Some(row) = values.iter().position(|v| *v <= 0.) {
            return Err(self.bad_value(
                row,
                column,
                format!("{} m", values[row]),
                "is no size: it must be positive; repair it or remove the vehicle",
            ));
        }
        Ok(values)
    }

    /// Coordinates, m.
    pub(in crate::formats) fn positions(&self, values: Vec<f32>, column: Wanted) -> Result<Vec<f32>, DataError> {
        if let Some(row) = values.iter().position(|v| v.abs() > MAX_POSITION) {
            return Err(self.bad_value(
                row,
                column,
                format!("{} m", values[row]),
                "is no place on a recorded road, which is within 131 km of the origin; repair it or remove the row",
            ));
        }
        Ok(values)
    }

    /// The error for what cannot be true together, in `row` of the file where one is known.
    pub(in crate::formats) fn contradiction(
        &self,
        row: Option<usize>,
        column: &str,
        what: String,
        remedy: &'static str,
    ) -> DataError {
        let place = match row.map(|row| self.line_of(row)).transpose() {
            Ok(Some(line)) => format!("line {line}, column `{column}`"),
            Ok(None) => format!("column `{column}`"),
            Err(e) => return e,
        };
        DataError::Contradiction { file: self.file.clone(), place, what, remedy }
    }

    /// Row `row` whose frame is before that of an earlier row of its vehicle.
    pub(in crate::formats) fn frame_order(
        &self,
        column: &str,
        row: usize,
        vehicle: u32,
        frame: u32,
        previous: u32,
    ) -> DataError {
        match self.line_of(row) {
            Ok(line) => {
                let (file, column) = (self.file.clone(), column.to_owned());
                DataError::FrameOrder { file, line, column, vehicle, frame, previous }
            }
            Err(e) => e,
        }
    }
}
