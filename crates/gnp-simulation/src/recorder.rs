//! What a simulator did, as a recording.
use crate::error::SimulationError;
use gnp_data::{
    Dataset, LaneMarking, NeighbourSource, Recording, RecordingMeta, Road, Rows, VehicleBody, VehicleClass,
};
use gnp_force::{MarkingKind, PairRule, Simulator};

/// Longer vehicles are recorded as trucks, m.
const TRUCK_M: f64 = 7.5;

/// Takes down the vehicles of a simulator, frame by frame.
///
/// Lanes are numbered from the left, 1 leftmost, and vehicles from 1, in the order in which they were added. Positions on a
/// ring are those on it, from 0 to its circumference.
#[derive(Debug)]
pub struct Recorder {
    meta: RecordingMeta,
    road: Road,
    lanes: usize,
    frame: u32,
    rows: Rows,
    velocity: [Vec<f32>; 2],
    bodies: Vec<VehicleBody>,
}

impl Recorder {
    /// A recorder for a road, of frames at `rate_hz`. `site` and `name` are those of the recording, which says that it was
    /// simulated.
    #[must_use]
    pub fn new(road: &gnp_force::Road<f64>, site: &str, name: &str, rate_hz: f64) -> Self {
        let marking = |line: &gnp_force::Line<f64>| LaneMarking { kind: line.kind, y: line.y as f32 };
        let lines = if road.lines().is_empty() { open_road() } else { road.lines().iter().map(marking).collect() };
        Self {
            meta: RecordingMeta::new(Dataset::LIVE, site, name, rate_hz).with_simulated(true),
            road: Road { driving_direction: 2, lines, fitted: false, axis: None },
            lanes: road.lanes(),
            frame: 0,
            rows: Rows::new(Vec::new(), Vec::new(), Vec::new(), Vec::new()),
            velocity: [Vec::new(), Vec::new()],
            bodies: Vec::new(),
        }
    }

    /// Takes down the vehicles as they stand: the next frame.
    ///
    /// # Errors
    /// When there are more vehicles or frames than numbers of 32 bits.
    pub fn take<R: PairRule<f64>>(&mut self, scene: &Simulator<f64, R>) -> Result<(), SimulationError> {
        for (id, vehicle) in scene.vehicles() {
            let number = u32::try_from(id.0 + 1).map_err(|_| too_large("the number of vehicles", id.0))?;
            let lane = scene.road().lane_at(vehicle.state.position.y);
            self.rows.vehicle.push(number);
            self.rows.frame.push(self.frame);
            self.rows.x.push(vehicle.state.position.x as f32);
            self.rows.y.push(vehicle.state.position.y as f32);
            self.rows.lane.push((self.lanes - lane) as i16);
            self.velocity[0].push(vehicle.state.velocity.x as f32);
            self.velocity[1].push(vehicle.state.velocity.y as f32);
            let class = if vehicle.extent.length > TRUCK_M { VehicleClass::Truck } else { VehicleClass::Car };
            let (length, width) = (vehicle.extent.length as f32, vehicle.extent.width as f32);
            self.bodies.push(VehicleBody { class, length, width, road: 0 });
        }
        self.frame = self.frame.checked_add(1).ok_or_else(|| too_large("the number of frames", u64::MAX))?;
        Ok(())
    }

    /// Frames taken.
    #[must_use]
    pub fn frames(&self) -> u32 {
        self.frame
    }

    /// The recording.
    ///
    /// # Errors
    /// When the rows make no recording.
    pub fn finish(mut self) -> Result<Recording, SimulationError> {
        self.rows.velocity = Some(self.velocity);
        self.rows.neighbours = NeighbourSource::Lanes(|lane| lane);
        let bodies = self.bodies;
        let (recording, _) = Recording::from_rows(self.meta, vec![self.road], self.rows, |row| bodies[row])?;
        Ok(recording)
    }
}

/// Lines for a road that has none: edges far to either side.
fn open_road() -> Vec<LaneMarking> {
    [-50.0, 50.0].map(|y| LaneMarking { kind: MarkingKind::Boundary, y }).to_vec()
}

fn too_large(what: &'static str, value: u64) -> SimulationError {
    SimulationError::TooLarge { what, value, most: u64::from(u32::MAX) }
}
