//! A snapshot of a program's own tracks.

use super::{LaneMarking, LiveError, Road, Snapshot, VelocitySource, check_lines};
use crate::assemble::{VehicleBody, slope_at};
use crate::dataset::Dataset;
use crate::lanes::lane_at;
use crate::limits::{self, MAX_POSITION, MAX_SPEED};
use crate::neighbours::LanePosition;
use crate::recording::{NO_TRACK, RecordingMeta, Track};
use crate::slot::SLOTS;
use crate::window_shape::WindowShape;

impl Snapshot {
    /// An empty snapshot of one carriageway between `lines`, from right to left, for windows of `shape`. Vehicles are added
    /// by [`Snapshot::push`] and found as neighbours of one another by [`Snapshot::finish`].
    ///
    /// `site` is where drivers were fitted that the traffic ahead is rolled out with; one that a model does not know,
    /// such as `live`, gets the drivers of all sites.
    ///
    /// # Errors
    /// [`LiveError::Window`] for a shape that is none, [`LiveError::Rate`], [`LiveError::Lines`].
    pub fn live(site: &str, lines: Vec<LaneMarking>, shape: WindowShape) -> Result<Self, LiveError> {
        check_lines(&lines)?;
        shape.check()?;
        let rate_hz = shape.rate_hz * shape.step as f64;
        if !limits::is_rate(rate_hz) {
            return Err(LiveError::Rate { rate_hz });
        }
        let meta = RecordingMeta::new(Dataset::LIVE, site, "live", rate_hz);
        let mut snapshot =
            Self::empty(meta, vec![Road { driving_direction: 2, lines, fitted: false, axis: None }], shape)?;
        snapshot.begin();
        Ok(snapshot)
    }

    /// Moves the lane lines, from right to left.
    ///
    /// # Errors
    /// [`LiveError::Lines`]. Then the old ones stay.
    pub fn set_lines(&mut self, lines: Vec<LaneMarking>) -> Result<(), LiveError> {
        check_lines(&lines)?;
        if let Some(road) = self.recording.roads.first_mut() {
            road.lines = lines;
        }
        Ok(())
    }

    /// Forgets all vehicles, for those of another moment.
    pub fn begin(&mut self) {
        self.clear();
        self.frame = self.needed() as u32;
        self.recording.meta.velocities = VelocitySource::Derived;
    }

    /// Most frames of a vehicle that are used: the observed ones of a window, and one before them.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.needed() + 1
    }

    /// Adds a vehicle with its positions in the last frames up to the moment, m, road frame, one a period of
    /// the recording's rate, and its velocities, m/s, where they are measured. Of more than [`Snapshot::frames`] the
    /// last count; what is not measured is differentiated from positions.
    ///
    /// # Errors
    /// [`LiveError::Value`] for what is beyond [`limits`](crate::limits), [`LiveError::Absent`] without a position,
    /// [`LiveError::Number`] where numbers of vehicles do not grow. Then nothing is added.
    pub fn push(
        &mut self,
        vehicle: u32,
        body: VehicleBody,
        positions: &[[f32; 2]],
        velocities: &[Option<[f32; 2]>],
    ) -> Result<(), LiveError> {
        let value = |what| Err(LiveError::Value { vehicle, what });
        if !limits::is_size([body.length, body.width]) || body.road != 0 {
            return value(format!(
                "{} m by {} m on carriageway {} is no vehicle of this one: vehicles are {}",
                body.length,
                body.width,
                body.road,
                limits::sizes()
            ));
        }
        if let Some([x, y]) = positions.iter().find(|position| !limits::is_position(**position)) {
            return value(format!("the position ({x}, {y}) m is not within {MAX_POSITION} m of the origin"));
        }
        if let Some([vx, vy]) = velocities.iter().flatten().find(|velocity| !limits::is_velocity(**velocity)) {
            return value(format!("the velocity ({vx}, {vy}) m/s is not within {MAX_SPEED} m/s"));
        }
        if positions.is_empty() {
            return Err(LiveError::Absent { vehicle });
        }
        if let Some(last) = self.recording.tracks.last().filter(|last| last.vehicle >= vehicle) {
            return Err(LiveError::Number { vehicle, last: last.vehicle });
        }
        // Both lists end at the moment.
        let kept = positions.len().min(self.frames());
        let positions = &positions[positions.len() - kept..];
        let measured = |i: usize| velocities.len().checked_sub(kept - i).and_then(|i| velocities[i]);
        let rate_hz = self.recording.meta.rate_hz;
        let line = self.recording.roads.first().map_or(&[][..], |road| &road.lines);
        let columns = &mut self.recording.columns;
        let start = columns.x.len();
        for (i, [x, y]) in positions.iter().enumerate() {
            let derived = || [0, 1].map(|axis| slope_at(|i| positions[i][axis], i, kept, rate_hz));
            let [vx, vy] = measured(i).unwrap_or_else(derived);
            columns.x.push(*x);
            columns.y.push(*y);
            columns.vx.push(vx);
            columns.vy.push(vy);
            columns.lane.push(lane_at(line, *y));
            columns.neighbours.push([NO_TRACK; SLOTS]);
        }
        if (0..kept).any(|i| measured(i).is_some()) {
            self.recording.meta.velocities = VelocitySource::Recorded;
        }
        let track = Track { class: body.class, ..Track::new(vehicle, [body.length, body.width], 0, start..start) };
        self.add(track, start, measured(0));
        Ok(())
    }

    /// Finds who is whose neighbour once all vehicles of the moment are there.
    pub fn finish(&mut self) {
        let Self { recording, places, neighbours, .. } = self;
        places.clear();
        places.extend(recording.tracks.iter().map(|track| {
            let last = track.rows.end - 1;
            LanePosition { lane: recording.columns.lane[last], x: recording.columns.x[last], length: track.length }
        }));
        neighbours.find(places);
        for i in 0..self.pasts.len() {
            self.set_neighbours(i, self.neighbours.of(i));
        }
        self.index();
    }
}
