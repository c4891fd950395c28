//! Who stands in which cell around a vehicle, at the last observed frame.

use gnp_data::{LaneMarking, MarkingKind, Neighbour, Observation};

/// Rows of the grid by lane, along the road.
pub(crate) const LANE_ROWS: usize = 13;
/// Columns of the grid by lane: left lane, own lane, right lane.
pub(crate) const LANE_COLUMNS: usize = 3;
/// Cells of the grid by lane.
pub(crate) const LANE_CELLS: usize = LANE_ROWS * LANE_COLUMNS;
/// Rows of PiP's grid by position, along the road.
pub(crate) const PLACE_ROWS: usize = 25;
/// Columns of PiP's grid by position.
pub(crate) const PLACE_COLUMNS: usize = 5;
/// Cells of PiP's grid by position.
pub(crate) const PLACE_CELLS: usize = PLACE_ROWS * PLACE_COLUMNS;

/// A foot, m: the published grids are laid out in feet.
const FOOT: f32 = 0.3048;
/// Width of a lane where a road has no lines, m.
const LANE_WIDTH: f32 = 3.66;

/// A vehicle in a cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Occupant<'a> {
    /// `rows * column + row` in the grid by lane, `columns * row + column` in that by position.
    pub(crate) cell: usize,
    /// Who.
    pub(crate) neighbour: Neighbour<'a>,
}

/// The occupied cells of a grid, in the order of the cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grid<'a> {
    /// One a cell.
    pub(crate) occupants: Vec<Occupant<'a>>,
    /// Vehicles left out because a nearer one stands in their cell.
    pub(crate) collisions: usize,
}

impl<'a> Grid<'a> {
    /// One vehicle a cell, the nearer one (then the smaller id), so that the order in which
    /// vehicles are listed does not matter. Only those with a whole past stand in a grid.
    fn new(mut found: Vec<(usize, Neighbour<'a>)>, along: f32) -> Self {
        let distance = |neighbour: &Neighbour<'_>| {
            let now = neighbour.now();
            (now.x * along).hypot(now.y)
        };
        found.sort_by(|(a, first), (b, second)| {
            let near = distance(first).total_cmp(&distance(second));
            a.cmp(b).then(near).then(first.vehicle().cmp(&second.vehicle()))
        });
        let vehicles = found.len();
        found.dedup_by_key(|(cell, _)| *cell);
        let collisions = vehicles - found.len();
        let occupants = found.into_iter().map(|(cell, neighbour)| Occupant { cell, neighbour }).collect();
        Self { occupants, collisions }
    }
}

/// The 13 x 3 grid by lane (Deo and Trivedi 2018): rows of 15 feet from 90 feet behind to 90 feet
/// ahead, columns left, own and right lane. Lanes are counted between the road's lines; where there
/// are none, by lateral distance. Distances along the road count `along`-fold.
#[must_use]
pub(crate) fn by_lane<'a>(observation: &Observation<'a>, along: f32) -> Grid<'a> {
    let lines: Vec<LaneMarking> = observation.lines().collect();
    let cell = |neighbour: Neighbour<'a>| {
        whole_past(observation, &neighbour).then_some(())?;
        let now = neighbour.now();
        let cell = lane_cell(now.x * along, lanes_to_left(&lines, now.y))?;
        Some((cell, neighbour))
    };
    Grid::new(observation.others().filter_map(cell).collect(), along)
}

/// The 25 x 5 grid by position of PiP (Song et al. 2020): cells of 8 by 7 feet, 200 feet by 35. Distances along the road
/// count `along`-fold.
#[must_use]
pub(crate) fn by_place<'a>(observation: &Observation<'a>, along: f32) -> Grid<'a> {
    let cell = |neighbour: Neighbour<'a>| {
        whole_past(observation, &neighbour).then_some(())?;
        let now = neighbour.now();
        Some((place_cell([now.x * along, now.y])?, neighbour))
    };
    Grid::new(observation.others().filter_map(cell).collect(), along)
}

/// Tracks have no gaps: who was there in the first observed frame was there in all.
fn whole_past(observation: &Observation<'_>, neighbour: &Neighbour<'_>) -> bool {
    observation.shape().t_obs > 0 && neighbour.state(0).is_some()
}

/// Lanes from the window's origin to `y` (m), positive to the left.
pub(crate) fn lanes_to_left(lines: &[LaneMarking], y: f32) -> i32 {
    if lines.is_empty() {
        return (y / LANE_WIDTH).round() as i32;
    }
    let below = |y: f32| lines.iter().filter(|line| line.kind == MarkingKind::LaneDivider && line.y < y).count() as i32;
    below(y) - below(0.)
}

/// Cell of a vehicle `x` m ahead and `lanes` to the left; `None` outside, and for one exactly alongside
/// in the own lane, which can only be the target itself.
fn lane_cell(x: f32, lanes: i32) -> Option<usize> {
    let feet = x / FOOT;
    let column = match lanes {
        1 => 0,
        0 if feet != 0. => 1,
        -1 => 2,
        _ => return None,
    };
    // `round` takes halves away from zero, as MATLAB does.
    (feet.abs() < 90.).then(|| LANE_ROWS * column + ((feet + 90.) / 15.).round() as usize)
}

/// Cell of PiP's grid of a vehicle at `position` (m); `None` outside and in the centre cell.
pub(crate) fn place_cell([x, y]: [f32; 2]) -> Option<usize> {
    let row = ((x / FOOT + 100.) / 8.).ceil() - 1.;
    let column = ((-y / FOOT + 17.5) / 7.).ceil() - 1.;
    let inside = |value: f32, count: usize| (0. ..count as f32).contains(&value);
    if !inside(row, PLACE_ROWS) || !inside(column, PLACE_COLUMNS) {
        return None;
    }
    let cell = PLACE_COLUMNS * row as usize + column as usize;
    (cell != PLACE_CENTRE).then_some(cell)
}

/// The cell that a grid by position is around.
pub(crate) const PLACE_CENTRE: usize = PLACE_COLUMNS * (PLACE_ROWS / 2) + PLACE_COLUMNS / 2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lane_cells_are_those_of_the_published_grid() {
        let feet = |feet: f32, lanes| lane_cell(feet * FOOT, lanes);
        assert_eq!(feet(-89.9, 1), Some(0));
        assert_eq!(feet(89.9, 1), Some(12));
        assert_eq!(feet(20., 0), Some(13 + 7));
        assert_eq!(feet(-20., 0), Some(13 + 5));
        assert_eq!(feet(0., -1), Some(26 + 6));
        assert_eq!(feet(7.6, -1), Some(26 + 7));
        assert_eq!(feet(7.4, -1), Some(26 + 6));
        for (ahead, lanes) in [(90.1, 0), (-90.1, 1), (10., 2), (10., -2), (0., 0)] {
            assert_eq!(feet(ahead, lanes), None, "{ahead} {lanes}");
        }
    }

    #[test]
    fn lanes_are_counted_between_lines_or_by_width() {
        let line = |kind, y| LaneMarking { kind, y };
        let lines = [
            line(MarkingKind::Boundary, -5.),
            line(MarkingKind::LaneDivider, -1.5),
            line(MarkingKind::LaneDivider, 2.),
            line(MarkingKind::Boundary, 5.5),
        ];
        let at = |y| lanes_to_left(&lines, y);
        assert_eq!([at(-6.), at(-1.6), at(1.9), at(2.1), at(7.)], [-1, -1, 0, 1, 1]);
        assert_eq!([-4., -1., 1.9, 3.].map(|y| lanes_to_left(&[], y)), [-1, 0, 1, 1]);
    }

    #[test]
    fn place_cells_grow_forward_and_to_the_right_and_leave_out_the_centre() {
        let feet = |x: f32, y: f32| place_cell([x * FOOT, y * FOOT]);
        assert_eq!(feet(-99., 17.), Some(0));
        assert_eq!(feet(99., -17.), Some(124));
        assert_eq!(feet(5., 0.), Some(5 * 13 + 2));
        assert_eq!(feet(0., 7.), Some(5 * 12 + 1));
        assert_eq!(feet(3.9, -3.4), None, "the centre");
        assert_eq!(feet(101., 0.), None);
        assert_eq!(feet(0., 18.), None);
    }
}
