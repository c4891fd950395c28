//! The fundamental diagram and what is read from it.

use serde::{Deserialize, Serialize};

use crate::cells::{Cell, Cells};
use crate::error::{MeasureError, Missing};
use crate::robust::{kendall, median, quantile, theil_sen, weighted_median};

/// Congested cells are put together in classes of density of this width, vehicles/km: the many near capacity would else outweigh
/// the few in a jam.
const CLASS: f64 = 5.;
/// Density that the congested cells must span, between a twentieth and nineteen twentieths of them, vehicles/km.
const SPAN: f64 = 15.;
/// Rank correlation at or below which flow falls with density, and in standard deviations.
const FALLING: [f64; 2] = [-0.2, -3.];
/// Cells with at least this share of the capacity tell the density at capacity.
const NEAR_CAPACITY: f64 = 0.9;
/// Congested traffic where the free speed is not known is slower than this, m/s.
const CONGESTED: f64 = 60. / 3.6;

/// What of a fundamental diagram counts as what.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiagramSettings {
    /// Capacity is this quantile of the flow over cells.
    pub capacity_quantile: f64,
    /// Traffic is free up to this density, vehicles a kilometre and lane.
    pub free_density_veh_km: f64,
    /// Congested traffic is slower than this share of the free speed (than 60 km/h where the free speed is not known).
    pub congested_share: f64,
    /// Cells that any estimate needs.
    pub least_cells: usize,
}

impl Default for DiagramSettings {
    fn default() -> Self {
        Self { capacity_quantile: 0.98, free_density_veh_km: 12., congested_share: 0.6, least_cells: 10 }
    }
}

impl DiagramSettings {
    pub(crate) fn checked(self) -> Result<Self, MeasureError> {
        MeasureError::share("capacity_quantile", self.capacity_quantile)?;
        MeasureError::positive("free_density_veh_km", self.free_density_veh_km)?;
        MeasureError::share("congested_share", self.congested_share)?;
        Ok(self)
    }
}

/// A cell of one lane as a point of the diagram.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FlowPoint {
    /// Lane number of the file.
    pub lane: i16,
    /// Density, vehicles a kilometre.
    pub density_veh_km: f64,
    /// Flow, vehicles an hour.
    pub flow_veh_h: f64,
    /// Space-mean speed, m/s.
    pub speed: f64,
}

/// The flow that is hardly ever exceeded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Capacity {
    /// Flow of a lane, vehicles an hour.
    pub flow_veh_h: f64,
    /// The quantile of the cells' flow that this is.
    pub quantile: f64,
    /// Cells it is taken of. Where traffic never reached capacity it is merely the greatest flow there was.
    pub cells: usize,
}

/// The falling branch of the diagram, as a straight line: Theil's and Sen's median slope through the medians of classes of density,
/// 5 vehicles/km wide.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CongestedBranch {
    /// Speed at which changes of density run against the traffic, m/s; positive upstream.
    pub wave_speed: f64,
    /// Density at which the line has no flow, vehicles a kilometre and lane.
    pub jam_density_veh_km: f64,
    /// Kendall's rank correlation of flow and density on the branch.
    pub tau: f64,
    /// Cells of the branch.
    pub cells: usize,
}

/// Flow over density of the cells of one lane, or of every lane of a carriageway, each lane for itself.
///
/// Free speed, capacity and the congested branch are those of a triangular diagram; see Treiber and Kesting (2013),
/// *Traffic Flow Dynamics*, chapter 4. Each is given only where the cells show it, else the reason stands in its place.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FundamentalDiagram {
    /// Index of the carriageway.
    pub road: u16,
    /// Lane number of the file; `None`: the cells of all lanes, quantities by lane.
    pub lane: Option<i16>,
    /// Cells in which there was a vehicle.
    pub points: Vec<FlowPoint>,
    /// Cells in which there was none.
    pub empty_cells: usize,
    /// Capacity.
    pub capacity: Result<Capacity, Missing>,
    /// Median speed of the cells of free density, m/s, each weighing as much as was driven in it: a lane that few use does not count
    /// as much as one that many do.
    pub free_speed: Result<f64, Missing>,
    /// The congested branch.
    pub congested: Result<CongestedBranch, Missing>,
}

impl FundamentalDiagram {
    /// The diagram of each lane, from left to right, and that of all of them last.
    ///
    /// # Errors
    /// [`MeasureError::Setting`] for settings out of range.
    pub fn of(cells: &Cells, settings: &DiagramSettings) -> Result<Vec<Self>, MeasureError> {
        let settings = settings.checked()?;
        let lanes = cells.lanes().iter().copied().map(Some).chain([None]);
        Ok(lanes.map(|lane| Self::of_lane(cells, lane, &settings)).collect())
    }

    fn of_lane(cells: &Cells, lane: Option<i16>, settings: &DiagramSettings) -> Self {
        let (mut points, mut empty_cells) = (Vec::new(), 0);
        for cell in cells.iter().filter(|cell| cell.lane.is_some() && (lane.is_none() || lane == cell.lane)) {
            let Cell { lane: Some(lane), speed: Some(speed), density_veh_km, flow_veh_h, .. } = cell else {
                empty_cells += 1;
                continue;
            };
            points.push(FlowPoint { lane, density_veh_km, flow_veh_h, speed });
        }
        let free_speed = free_speed(&points, settings);
        let slow = free_speed.as_ref().map_or(CONGESTED, |free| free * settings.congested_share);
        let capacity = capacity(&points, settings);
        let congested = congested(&points, &capacity, slow, settings.least_cells);
        Self { road: cells.road(), lane, points, empty_cells, capacity, free_speed, congested }
    }
}

fn enough<T>(points: &[T], which: &'static str, needed: usize) -> Result<(), Missing> {
    let found = points.len();
    if found >= needed.max(2) { Ok(()) } else { Err(Missing::FewPoints { which, found, needed: needed.max(2) }) }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

fn capacity(points: &[FlowPoint], settings: &DiagramSettings) -> Result<Capacity, Missing> {
    enough(points, "with a vehicle", settings.least_cells)?;
    let flows = sorted(points.iter().map(|point| point.flow_veh_h));
    let flow_veh_h = quantile(&flows, settings.capacity_quantile).unwrap_or_default();
    Ok(Capacity { flow_veh_h, quantile: settings.capacity_quantile, cells: flows.len() })
}

fn free_speed(points: &[FlowPoint], settings: &DiagramSettings) -> Result<f64, Missing> {
    let free = points.iter().filter(|point| point.density_veh_km <= settings.free_density_veh_km);
    let speeds: Vec<[f64; 2]> = free.map(|point| [point.speed, point.flow_veh_h.max(0.)]).collect();
    enough(&speeds, "of free traffic", settings.least_cells)?;
    Ok(weighted_median(speeds).unwrap_or_default())
}

/// The branch begins at the density at capacity or, where flow fell before capacity was reached, wherever traffic is slow: of the
/// two the one whose cells are nearer to their line.
fn congested(
    points: &[FlowPoint],
    capacity: &Result<Capacity, Missing>,
    slow: f64,
    least: usize,
) -> Result<CongestedBranch, Missing> {
    let enough_flow = capacity.as_ref().map_or(f64::INFINITY, |it| it.flow_veh_h * NEAR_CAPACITY);
    let full = points.iter().filter(|point| point.flow_veh_h >= enough_flow).map(|point| point.density_veh_km);
    let critical = median(full.collect()).unwrap_or(0.);
    let slow = |from: f64| {
        let branch = points.iter().filter(|point| point.speed < slow && point.density_veh_km > from);
        branch.map(|point| [point.density_veh_km, point.flow_veh_h]).collect::<Vec<_>>()
    };
    match [critical, 0.].map(|from| branch(slow(from), least)) {
        [Ok(dense), Ok(all)] => Ok(if dense.1 <= all.1 { dense.0 } else { all.0 }),
        [Ok(found), Err(_)] | [Err(_), Ok(found)] => Ok(found.0),
        [Err(reason), Err(_)] => Err(reason),
    }
}

/// A line through congested cells, and how far these are from it: the median deviation as a share of that of their flow.
fn branch(points: Vec<[f64; 2]>, least: usize) -> Result<(CongestedBranch, f64), Missing> {
    enough(&points, "of congested traffic", least)?;
    let densities = sorted(points.iter().map(|point| point[0]));
    let at = |p| quantile(&densities, p).unwrap_or_default();
    let span = at(0.95) - at(0.05);
    let line = theil_sen(&classes(points.clone())).filter(|_| span >= SPAN);
    let Some(line) = line else { return Err(Missing::NarrowBranch { span, needed: SPAN }) };
    let [tau, deviations] = kendall(&points);
    if line.slope >= 0. || tau > FALLING[0] || deviations > FALLING[1] {
        return Err(Missing::NoFallingBranch { tau });
    }
    let (wave_speed, jam_density_veh_km) = (-line.slope / 3.6, -line.intercept / line.slope);
    let middle = median(points.iter().map(|point| point[1]).collect()).unwrap_or_default();
    let apart =
        |from: &dyn Fn(&[f64; 2]) -> f64| median(points.iter().map(|point| (point[1] - from(point)).abs()).collect());
    let [from_line, all] = [apart(&|point| line.intercept + line.slope * point[0]), apart(&|_| middle)];
    let share = from_line.zip(all).map_or(f64::INFINITY, |(from_line, all)| from_line / all.max(f64::EPSILON));
    Ok((CongestedBranch { wave_speed, jam_density_veh_km, tau, cells: points.len() }, share))
}

/// Median density and flow of each class of density.
fn classes(mut branch: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    branch.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    let class = |point: &[f64; 2]| (point[0] / CLASS) as i64;
    let middle = |points: &[[f64; 2]]| {
        let of = |axis: usize| median(points.iter().map(|point| point[axis]).collect());
        Some([of(0)?, of(1)?])
    };
    branch.chunk_by(|a, b| class(a) == class(b)).filter_map(middle).collect()
}
