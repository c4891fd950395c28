//! An observation as a network is to see it: as recorded, or in a mirror along the road.

use gnp_data::{Observation, TrackState};

use crate::grid::{LANE_CELLS, LANE_COLUMNS, LANE_ROWS, PLACE_COLUMNS};

/// An observation, with left and right exchanged or not. Mirroring is an augmentation for training,
/// never used for prediction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OrientedView<'a> {
    pub(crate) observation: Observation<'a>,
    pub(crate) side: Orientation,
}

/// Which way left is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Orientation {
    /// As recorded.
    Recorded,
    /// Where right was.
    Mirrored,
}

impl<'a> OrientedView<'a> {
    /// As recorded.
    pub(crate) fn recorded(observation: &Observation<'a>) -> Self {
        Self { observation: *observation, side: Orientation::Recorded }
    }
}

impl Orientation {
    /// A position or displacement of the window's frame.
    pub(crate) fn turn(self, state: TrackState) -> TrackState {
        match self {
            Self::Recorded => state,
            Self::Mirrored => TrackState { y: -state.y, vy: -state.vy, ..state },
        }
    }

    /// A cell of the grid by lane, `13 * column + row`.
    pub(crate) fn lane_cell(self, cell: usize) -> usize {
        match self {
            Self::Mirrored if cell < LANE_CELLS => {
                let (column, row) = (cell / LANE_ROWS, cell % LANE_ROWS);
                LANE_ROWS * (LANE_COLUMNS - 1 - column) + row
            }
            _ => cell,
        }
    }

    /// A cell of the grid by position, `5 * row + column`.
    pub(crate) fn place_cell(self, cell: usize) -> usize {
        match self {
            Self::Recorded => cell,
            Self::Mirrored => {
                let (row, column) = (cell / PLACE_COLUMNS, cell % PLACE_COLUMNS);
                PLACE_COLUMNS * row + (PLACE_COLUMNS - 1 - column)
            }
        }
    }

    /// A lateral manoeuvre: keep (0), left (1), right (2).
    pub(crate) fn lateral(self, class: usize) -> usize {
        match (self, class) {
            (Self::Mirrored, 1) => 2,
            (Self::Mirrored, 2) => 1,
            _ => class,
        }
    }
}
