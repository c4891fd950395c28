//! An observation as a network is to see it: as recorded, or varied for training.

use gnp_data::{Observation, TrackState};

use crate::grid::{LANE_CELLS, LANE_COLUMNS, LANE_ROWS, PLACE_COLUMNS};

/// An observation, varied or not. Variations are for training, never used for prediction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OrientedView<'a> {
    pub(crate) observation: Observation<'a>,
    pub(crate) variation: Variation,
}

/// How a window is varied: the augmentations of GNP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Variation {
    /// Whether left and right are exchanged.
    pub(crate) mirrored: bool,
    /// Factor on lengths and speeds along the road: the same drivers in faster or slower traffic. Sizes of vehicles stay.
    pub(crate) along: f32,
}

impl<'a> OrientedView<'a> {
    /// As recorded.
    pub(crate) fn recorded(observation: &Observation<'a>) -> Self {
        Self { observation: *observation, variation: Variation::RECORDED }
    }
}

impl Variation {
    /// None.
    pub(crate) const RECORDED: Self = Self { mirrored: false, along: 1. };

    /// A position or displacement of the window's frame.
    pub(crate) fn turn(self, state: TrackState) -> TrackState {
        let state = TrackState { x: state.x * self.along, vx: state.vx * self.along, ..state };
        if self.mirrored { TrackState { y: -state.y, vy: -state.vy, ..state } } else { state }
    }

    /// A cell of the grid by lane, `13 * column + row`.
    pub(crate) fn lane_cell(self, cell: usize) -> usize {
        if self.mirrored && cell < LANE_CELLS {
            let (column, row) = (cell / LANE_ROWS, cell % LANE_ROWS);
            return LANE_ROWS * (LANE_COLUMNS - 1 - column) + row;
        }
        cell
    }

    /// A cell of the grid by position, `5 * row + column`.
    pub(crate) fn place_cell(self, cell: usize) -> usize {
        if self.mirrored {
            let (row, column) = (cell / PLACE_COLUMNS, cell % PLACE_COLUMNS);
            return PLACE_COLUMNS * row + (PLACE_COLUMNS - 1 - column);
        }
        cell
    }

    /// A lateral manoeuvre: keep (0), left (1), right (2).
    pub(crate) fn lateral(self, class: usize) -> usize {
        match (self.mirrored, class) {
            (true, 1) => 2,
            (true, 2) => 1,
            _ => class,
        }
    }
}
