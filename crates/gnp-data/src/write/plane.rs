//! A recording's tracks in a right-handed plane: the way back from its carriageways to a table.

use gnp_road::ReferenceLine;

use super::frame;
use crate::recording::{Recording, Road, VelocitySource};
use crate::track_table::{TableVehicle, TrackTable};

/// Below this speed, m/s, a vehicle is taken to point along the road.
const STANDING: f64 = 0.5;

impl Recording {
    /// Position in a right-handed plane, m, of what is at `[s, d]`, m, on a carriageway: in the coordinates of the data
    /// where these are known ([`Road::axis`]) and their y points up; with y upwards where it points down; else in the
    /// frame of the carriageway that drives forward, to which the other is rotated by pi.
    #[must_use]
    pub fn in_plane(&self, road: usize, [s, d]: [f64; 2]) -> [f64; 2] {
        match self.roads.get(road) {
            Some(Road { axis: Some(axis), .. }) => {
                let [x, y] = axis.to_world(s, d);
                if is_mirrored(axis) { [x, -y] } else { [x, y] }
            }
            Some(Road { driving_direction: 1, .. }) => [-s, -d],
            _ => [s, d],
        }
    }

    /// Velocity in the same plane, m/s, of what moves with `rates` of s and d, m/s, at `[s, d]`, m.
    fn velocity_in_plane(&self, road: usize, [s, d]: [f64; 2], rates: [f64; 2]) -> [f64; 2] {
        match self.roads.get(road) {
            Some(Road { axis: Some(axis), .. }) => {
                let [vx, vy] = axis.at(s, d).velocity_to_world(rates);
                if is_mirrored(axis) { [vx, -vy] } else { [vx, vy] }
            }
            Some(Road { driving_direction: 1, .. }) => rates.map(|rate| -rate),
            _ => rates,
        }
    }
}

/// Whether `d` grows to the left of a line where y points down.
fn is_mirrored(axis: &ReferenceLine) -> bool {
    let at = axis.at(0., 0.);
    let [along, across] = [[1., 0.], [0., 1.]].map(|rates| at.velocity_to_world(rates));
    along[0] * across[1] - along[1] * across[0] < 0.
}

impl TrackTable {
    /// The tracks of a recording, by vehicle and time, in a right-handed plane: see [`Recording::in_plane`].
    ///
    /// Velocities that were derived from positions are not given, as they would then count as recorded; a direction is
    /// that of the way to a row, or of the road where a vehicle stands. Lanes are those between the lane lines, 1 the
    /// leftmost.
    #[must_use]
    pub fn of(recording: &Recording) -> Self {
        let (meta, c, rows) = (recording.meta(), recording.columns(), recording.len());
        let mut table = Self::new(meta.dataset, &meta.site, &meta.name);
        table.simulated = meta.simulated;
        let recorded = meta.velocities == VelocitySource::Recorded;
        let (mut velocity, mut heading) =
            ([Vec::with_capacity(rows), Vec::with_capacity(rows)], Vec::with_capacity(rows));
        let mut lane = Vec::with_capacity(rows);
        let mut last = None;
        for (index, track) in recording.tracks().iter().enumerate() {
            if last.replace(track.vehicle) != Some(track.vehicle) {
                let name = recording.vehicle_name(track.vehicle).into_owned();
                let (length, width) = (Some(track.length), Some(track.width));
                let class = Some(track.class);
                table.vehicles.push(TableVehicle { class, length, width, ..TableVehicle::named(name) });
            }
            let road = usize::from(track.road);
            for row in track.rows.clone() {
                let place = [c.x[row], c.y[row]].map(f64::from);
                let rates = recording.velocity_one_sided(index, row).unwrap_or_else(|| {
                    // Of a first row only the next one tells it.
                    let next = (row + 1).min(track.rows.end - 1);
                    let rate = meta.rate_hz as f32;
                    [(c.x[next] - c.x[row]) * rate, (c.y[next] - c.y[row]) * rate]
                });
                let rates = rates.map(f64::from);
                let [vx, vy] = recording.velocity_in_plane(road, place, rates);
                let moves = rates[0].hypot(rates[1]) >= STANDING;
                let [ax, ay] = if moves { [vx, vy] } else { recording.velocity_in_plane(road, place, [1., 0.]) };
                let [x, y] = recording.in_plane(road, place);
                table.vehicle.push(table.vehicles.len() as u32 - 1);
                table.time_s.push(meta.time_s(frame(track, row)));
                table.x.push(x);
                table.y.push(y);
                velocity[0].push(vx);
                velocity[1].push(vy);
                heading.push(ay.atan2(ax));
                lane.push(recording.roads.get(road).map_or(0, |road| super::lane(recording, road, row)));
            }
        }
        table.velocity = recorded.then_some(velocity);
        table.heading = Some(heading);
        table.lane = lane.iter().any(|lane| *lane > 0).then_some(lane);
        table
    }
}
