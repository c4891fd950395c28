//! Everything that is measured of one recording.

use gnp_data::{Dataset, VelocitySource};
use serde::Serialize;

use crate::cells::Cell;
use crate::detectors::DetectorInterval;
use crate::diagram::FundamentalDiagram;
use crate::error::MeasureError;
use crate::lane_changes::LaneChanges;
use crate::safety::Safety;
use crate::samples::Distributions;
use crate::settings::Settings;
use crate::traffic::{Course, Lane, Traffic};
use crate::waves::Waves;

/// What could not be used, and why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// What, and why.
    pub what: String,
    /// How much of it.
    pub amount: f64,
    /// Its unit.
    pub unit: &'static str,
}

/// All measures of one recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Summary {
    /// The data family.
    pub dataset: Dataset,
    /// Site.
    pub site: String,
    /// Name of the recording.
    pub recording: String,
    /// Made by a simulator.
    pub simulated: bool,
    /// Frames a second.
    pub rate_hz: f64,
    /// Where its velocities come from.
    pub velocities: VelocitySource,
    /// How the road runs.
    pub course: Course,
    /// Duration, s.
    pub duration_s: f64,
    /// Rows: vehicles times frames.
    pub rows: usize,
    /// Different vehicles.
    pub vehicles: usize,
    /// Distance driven, km.
    pub vehicle_km: f64,
    /// Time driven, h.
    pub vehicle_h: f64,
    /// Measured stretch by carriageway, m; `None` where no vehicle is on it.
    pub extents: Vec<Option<[f64; 2]>>,
    /// Lanes by carriageway, from left to right.
    pub lanes: Vec<Lane>,
    /// How it was measured.
    pub settings: Settings,
    /// Flow, density and speed over cells of time and space.
    pub cells: Vec<Cell>,
    /// Flow, speed and occupancy at places.
    pub detectors: Vec<DetectorInterval>,
    /// Fundamental diagrams, by carriageway and lane.
    pub diagrams: Vec<FundamentalDiagram>,
    /// Waves, by carriageway and lane.
    pub waves: Vec<Waves>,
    /// Surrogate safety.
    pub safety: Safety,
    /// Lane changes.
    pub lane_changes: LaneChanges,
    /// Distributions.
    pub distributions: Distributions,
    /// What could not be used.
    pub left_out: Vec<LeftOut>,
}

impl Summary {
    /// Measures a recording.
    ///
    /// # Errors
    /// [`MeasureError::Setting`] for a setting out of range, [`MeasureError::TooFine`] for cells too small.
    pub fn of(traffic: &Traffic<'_>, settings: &Settings) -> Result<Self, MeasureError> {
        MeasureError::positive("acceleration_span_s", settings.acceleration_span_s)?;
        let recording = traffic.recording();
        let meta = recording.meta().clone();
        let roads = recording.roads().len() as u16;
        let mut left_out = Vec::new();
        let (mut cells, mut detectors, mut diagrams, mut waves) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for road in 0..roads {
            let mut leave_out = |what: &str, amount: f64, unit| {
                if amount > 0. {
                    left_out.push(LeftOut { what: format!("carriageway {road}: {what}"), amount, unit });
                }
            };
            let Some(of_road) = traffic.cells(road, settings.cells)? else { continue };
            leave_out("no lane, in cells of all lanes only", of_road.no_lane_s(), "vehicle-seconds");
            leave_out("beyond the measured stretch, in no cell", of_road.outside_s(), "vehicle-seconds");
            diagrams.extend(FundamentalDiagram::of(&of_road, &settings.diagram)?);
            cells.extend(of_road.iter());
            waves.extend(traffic.waves(road, &settings.waves)?);
            let (places, beyond) = places(traffic, road, settings);
            leave_out("detectors beyond the measured stretch", beyond as f64, "detectors");
            for x in places {
                let station = traffic.station(road, x, settings.loop_length)?;
                leave_out(
                    "passed a detector without a lane, in all lanes only",
                    station.without_lane() as f64,
                    "vehicles",
                );
                detectors.extend(station.intervals(settings.interval_s)?);
            }
        }
        let samples = traffic.samples(settings.acceleration_span_s);
        let rows =
            |(what, rows): (&&str, &u64)| LeftOut { what: (*what).to_owned(), amount: *rows as f64, unit: "rows" };
        left_out.extend(samples.left_out.iter().map(rows));
        let tracks = recording.tracks();
        let named = recording.columns().named_leader.iter().flatten().filter(|named| named.vehicle != 0).count();
        if named > 0 {
            let what =
                "leader without rows of its own: flow and density are those of a sample of the traffic".to_owned();
            left_out.push(LeftOut { what, amount: named as f64, unit: "rows" });
        }
        Ok(Self {
            dataset: meta.dataset,
            site: meta.site,
            recording: meta.name,
            simulated: meta.simulated,
            rate_hz: meta.rate_hz,
            velocities: meta.velocities,
            course: traffic.course(),
            duration_s: traffic.duration_s(),
            rows: recording.len(),
            // Tracks are sorted by vehicle.
            vehicles: tracks.chunk_by(|a, b| a.vehicle == b.vehicle).count(),
            vehicle_km: traffic.distance_m() / 1000.,
            vehicle_h: recording.len() as f64 / meta.rate_hz / 3600.,
            extents: (0..roads).map(|road| traffic.extent(road)).collect(),
            lanes: traffic.lanes().to_vec(),
            settings: settings.clone(),
            cells,
            detectors,
            diagrams,
            waves,
            safety: traffic.safety(&settings.safety)?,
            lane_changes: traffic.lane_changes(&settings.lane_changes)?,
            distributions: samples.distributions(),
            left_out,
        })
    }
}

/// Places of the detectors of a carriageway, and how many lie beyond what is measured of it.
fn places(traffic: &Traffic<'_>, road: u16, settings: &Settings) -> (Vec<f64>, usize) {
    let Some([from, to]) = traffic.extent(road) else { return (Vec::new(), 0) };
    if settings.detectors.is_empty() {
        let count = settings.spread_detectors;
        return ((1..=count).map(|i| from + (to - from) * i as f64 / (count + 1) as f64).collect(), 0);
    }
    let inside = |x: &f64| (from..=to).contains(&traffic.place(*x));
    let places: Vec<f64> = settings.detectors.iter().copied().filter(inside).collect();
    let beyond = settings.detectors.len() - places.len();
    (places, beyond)
}
