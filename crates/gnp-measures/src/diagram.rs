//! The fundamental diagram and what is read from it.

use serde::{Deserialize, Serialize};

use crate::cells::{Cell, Cells};
use crate::error::{MeasureError, Missing};
use crate::robust::{median, quantile, theil_sen};

/// Least densities apart of two cells that make a slope, vehicles/km.
const APART: f64 = 2.;
/// Density that the congested cells must span, between a twentieth and nineteen twentieths of them, vehicles/km.
const SPAN: f64 = 15.;
/// Rank correlation at or below which flow falls with density, and in standard deviations.
const FALLING: [f64; 2] = [-0.2, -3.];
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
    /// Traffic is congested below this share of the free speed (below 60 km/h where the free speed is not known).
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

/// The falling branch of the diagram, as a straight line: Theil's and Sen's median slope.
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
    /// Median speed of the cells of free density, m/s.
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
        let (capacity, congested) = (capacity(&points, settings), congested(&points, slow, settings.least_cells));
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
    let speeds: Vec<f64> = free.map(|point| point.speed).collect();
    enough(&speeds, "of free traffic", settings.least_cells)?;
    Ok(median(speeds).unwrap_or_default())
}

fn congested(points: &[FlowPoint], slow: f64, least: usize) -> Result<CongestedBranch, Missing> {
    let branch: Vec<[f64; 2]> = points
        .iter()
        .filter(|point| point.speed < slow)
        .map(|point| [point.density_veh_km, point.flow_veh_h])
        .collect();
    enough(&branch, "of congested traffic", least)?;
    let densities = sorted(branch.iter().map(|point| point[0]));
    let at = |p| quantile(&densities, p).unwrap_or_default();
    let span = at(0.95) - at(0.05);
    let line = theil_sen(&branch, APART).filter(|_| span >= SPAN);
    let Some(line) = line else { return Err(Missing::NarrowBranch { span, needed: SPAN }) };
    if line.slope >= 0. || line.tau > FALLING[0] || line.tau_z > FALLING[1] {
        return Err(Missing::NoFallingBranch { tau: line.tau });
    }
    Ok(CongestedBranch {
        wave_speed: -line.slope / 3.6,
        jam_density_veh_km: -line.intercept / line.slope,
        tau: line.tau,
        cells: branch.len(),
    })
}
