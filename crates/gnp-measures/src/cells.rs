//! Flow, density and speed over cells of space and time.

use serde::{Deserialize, Serialize};

use crate::bins::Bins;
use crate::error::MeasureError;
use crate::traffic::{Step, Traffic};

/// Cells are made at most, over all lanes of a carriageway.
const MOST: usize = 50_000_000;

/// Size of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellSize {
    /// Along the road, m; the cells of a stretch are equally long, about so.
    pub x: f64,
    /// In time, s; the last cell takes what is left.
    pub t: f64,
}

impl CellSize {
    pub(crate) fn checked(self) -> Result<Self, MeasureError> {
        MeasureError::positive("cell length, m", self.x)?;
        MeasureError::positive("cell duration, s", self.t)?;
        Ok(self)
    }
}

/// Distance travelled and time spent by all vehicles in cells of a carriageway, by lane and over all lanes.
///
/// These are the generalised definitions of Edie (1963), *Discussion of traffic stream measurements and definitions*: in a
/// region of area `A` (m times s) in which vehicles travel `d` m in `t` s altogether, flow is `d / A`, density `t / A`, and
/// space-mean speed `d / t`, so that flow is density times speed, exactly, in every cell. Between two frames a vehicle
/// moves evenly, and is in the lane of the earlier one.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    road: u16,
    x: Bins,
    t: Bins,
    /// Lane numbers from left to right.
    lanes: Vec<i16>,
    /// Vehicle-metres and vehicle-seconds, `[lanes + 1][times][places]`; the last of the lanes is all of them.
    sums: Vec<[f64; 2]>,
    no_lane_s: f64,
    outside_s: f64,
}

/// A cell of space and time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// Index of the carriageway.
    pub road: u16,
    /// Lane number of the file; `None` for all lanes together.
    pub lane: Option<i16>,
    /// Start and end, s.
    pub t: [f64; 2],
    /// Start and end, m.
    pub x: [f64; 2],
    /// Distance travelled by all vehicles, m.
    pub vehicle_m: f64,
    /// Time spent by all vehicles, s.
    pub vehicle_s: f64,
    /// Flow, vehicles an hour.
    pub flow_veh_h: f64,
    /// Density, vehicles a kilometre.
    pub density_veh_km: f64,
    /// Space-mean speed, m/s; `None` where no vehicle was.
    pub speed: Option<f64>,
}

impl Traffic<'_> {
    /// Cells over the measured stretch of a carriageway and the whole recording. `None` where no vehicle is on it.
    ///
    /// # Errors
    /// [`MeasureError::Setting`] for sizes that are not positive, [`MeasureError::TooFine`].
    pub fn cells(&self, road: u16, size: CellSize) -> Result<Option<Cells>, MeasureError> {
        let size = size.checked()?;
        let Some([from, to]) = self.extent(road) else { return Ok(None) };
        let (x, t) = (Bins::even(from, to, size.x), Bins::covering(0., self.duration_s(), size.t));
        let lanes: Vec<i16> = self.lanes_of(road).map(|lane| lane.number).collect();
        let count = x.count.saturating_mul(t.count).saturating_mul(lanes.len() + 1);
        if count > MOST {
            return Err(MeasureError::TooFine { x: size.x, t: size.t, cells: count, most: MOST });
        }
        let sums = vec![[0.; 2]; count];
        let mut cells = Cells { road, x, t, lanes, sums, no_lane_s: 0., outside_s: 0. };
        for track in self.recording().tracks().iter().filter(|track| track.road == road) {
            for step in self.steps(track) {
                cells.add(&step, self.lane(step.row).map(|lane| lane.from_left), self.circumference());
            }
        }
        Ok(Some(cells))
    }
}

impl Cells {
    /// Index of the carriageway.
    #[must_use]
    pub fn road(&self) -> u16 {
        self.road
    }

    /// Places.
    #[must_use]
    pub fn x(&self) -> &Bins {
        &self.x
    }

    /// Times.
    #[must_use]
    pub fn t(&self) -> &Bins {
        &self.t
    }

    /// Lane numbers, from left to right.
    #[must_use]
    pub fn lanes(&self) -> &[i16] {
        &self.lanes
    }

    /// Vehicle-seconds of rows without a lane; they count in all lanes together.
    #[must_use]
    pub fn no_lane_s(&self) -> f64 {
        self.no_lane_s
    }

    /// Vehicle-seconds beyond the measured stretch; they count nowhere.
    #[must_use]
    pub fn outside_s(&self) -> f64 {
        self.outside_s
    }

    /// The cell of a lane (`None`: all together), a time and a place; `None` where there is none.
    #[must_use]
    pub fn cell(&self, lane: Option<i16>, t: usize, x: usize) -> Option<Cell> {
        let plane = match lane {
            Some(number) => self.lanes.iter().position(|other| *other == number)?,
            None => self.lanes.len(),
        };
        (t < self.t.count && x < self.x.count).then(|| self.at(plane, t, x))
    }

    /// Every cell: by lane from left to right, all lanes last; then by time, then by place.
    pub fn iter(&self) -> impl Iterator<Item = Cell> {
        let (planes, times, places) = (self.lanes.len() + 1, self.t.count, self.x.count);
        (0..planes)
            .flat_map(move |plane| (0..times).flat_map(move |t| (0..places).map(move |x| (plane, t, x))))
            .map(|(plane, t, x)| self.at(plane, t, x))
    }

    /// Space-mean speed by time, m/s, at a place; `None` where no vehicle was.
    pub(crate) fn speeds(&self, lane: usize, x: usize) -> impl Iterator<Item = Option<f64>> {
        (0..self.t.count).map(move |t| {
            let [metres, seconds] = self.sums[self.index(lane, t, x)];
            (seconds > 0.).then(|| metres / seconds)
        })
    }

    fn at(&self, plane: usize, t: usize, x: usize) -> Cell {
        let [vehicle_m, vehicle_s] = self.sums[self.index(plane, t, x)];
        let area = self.t.width(t) * self.x.width(x);
        Cell {
            road: self.road,
            lane: self.lanes.get(plane).copied(),
            t: self.t.range(t),
            x: self.x.range(x),
            vehicle_m,
            vehicle_s,
            flow_veh_h: vehicle_m / area * 3600.,
            density_veh_km: vehicle_s / area * 1000.,
            speed: (vehicle_s > 0.).then(|| vehicle_m / vehicle_s),
        }
    }

    fn index(&self, plane: usize, t: usize, x: usize) -> usize {
        (plane * self.t.count + t) * self.x.count + x
    }

    fn add(&mut self, step: &Step, lane: Option<usize>, around: Option<f64>) {
        let seconds = step.t[1] - step.t[0];
        if lane.is_none() {
            self.no_lane_s += seconds;
        }
        let by = step.x[1] - step.x[0];
        let place = |x: f64| around.map_or(x, |around| x.rem_euclid(around));
        let start = place(step.x[0]);
        let whole =
            [(step.t[0], start), (step.t[1], start + by)].map(|(t, x)| Some((self.t.index(t)?, self.x.index(x)?)));
        if let [Some(cell), Some(same)] = whole
            && cell == same
        {
            self.count(Some(cell), lane, [by, seconds]);
            return;
        }
        // Shares of the step at which it passes from one cell to another.
        let mut cuts = vec![0., 1.];
        cuts.extend(self.t.edges_within(step.t).map(|edge| (edge - step.t[0]) / seconds));
        let rounds: &[f64] = if around.is_some() { &[-1., 0., 1.] } else { &[0.] };
        for offset in rounds.iter().map(|round| round * around.unwrap_or(0.)) {
            let within = [start.min(start + by) - offset, start.max(start + by) - offset];
            cuts.extend(self.x.edges_within(within).map(|edge| (edge + offset - start) / by));
        }
        cuts.sort_unstable_by(f64::total_cmp);
        for pair in cuts.windows(2).filter(|pair| pair[1] > pair[0]) {
            let (middle, share) = ((pair[0] + pair[1]) / 2., pair[1] - pair[0]);
            let t = self.t.index(step.t[0] + middle * seconds);
            let x = self.x.index(place(start + middle * by));
            self.count(t.zip(x), lane, [by * share, seconds * share]);
        }
    }

    fn count(&mut self, cell: Option<(usize, usize)>, lane: Option<usize>, [metres, seconds]: [f64; 2]) {
        let Some((t, x)) = cell else {
            self.outside_s += seconds;
            return;
        };
        for plane in lane.into_iter().chain([self.lanes.len()]) {
            let at = self.index(plane, t, x);
            self.sums[at][0] += metres;
            self.sums[at][1] += seconds;
        }
    }
}
