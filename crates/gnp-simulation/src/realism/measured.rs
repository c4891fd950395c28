//! What is measured of a course, driven or recorded, in the same way.
use crate::replay::{Path, Scene, Trace};
use std::collections::BTreeMap;

/// Time between the moments at which a course is measured, and half the time over which speeds are differences, in s.
const SPAN_S: f64 = 0.5;
/// A change of lane counts if the new one is kept for this time, in s.
const KEPT_S: f64 = 1.0;
/// Boxes that overlap by less touch at most, in m.
const TOUCH_M: f64 = 1e-3;
/// A leader farther away is none, in m.
const FARTHEST_M: f64 = 150.0;

/// A vehicle at a moment. Speeds are differences of positions over 1 s, so that all sources are treated alike.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Moment {
    /// Along the road, in m/s.
    pub speed: f64,
    /// Across the road, to the left, in m/s.
    pub lateral_speed: f64,
    /// Along the road, from three positions 1 s apart, in m/s².
    pub acceleration: Option<f64>,
    /// To the next in the lane, bumper to bumper, in m.
    pub gap: Option<f64>,
    /// Time to collision with the next in the lane, in s; infinite where the gap does not close.
    pub ttc: Option<f64>,
}

/// Two vehicles begin to touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Frame.
    pub frame: usize,
    /// The actor behind; a system drives it.
    pub behind: usize,
    /// The one ahead.
    pub ahead: usize,
}

/// What is measured of a course.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Measured {
    /// By actor: its moments in the section; none of those who are moved as recorded.
    pub moments: Vec<Vec<Moment>>,
    /// By actor: changes of lane in the section.
    pub lane_changes: Vec<usize>,
    /// Contacts of which a driven vehicle is the one behind. Those who overlap when they come in do not count.
    pub touches: Vec<Touch>,
    /// Way of all driven vehicles in the section, in km.
    pub vehicle_km: f64,
    /// Time of all driven vehicles in the section, in h.
    pub vehicle_h: f64,
}

impl Measured {
    /// Measures a course of a scene.
    #[must_use]
    pub fn of(scene: &Scene, trace: &Trace) -> Self {
        let mut measured = Self {
            moments: vec![Vec::new(); scene.actors.len()],
            lane_changes: vec![0; scene.actors.len()],
            ..Self::default()
        };
        let half = (SPAN_S * scene.rate_hz).round().max(1.0) as usize;
        for frame in (half..=scene.frames).step_by(half) {
            measured.moment(scene, trace, frame, half);
        }
        for (index, path) in trace.paths.iter().enumerate().filter(|(index, _)| scene.actors[*index].is_driven()) {
            let end = scene.section[1];
            let inside = path.states.iter().take_while(|state| state.position.x <= end).count();
            let states = &path.states[..inside];
            if let (Some(first), Some(last)) = (states.first(), states.last()) {
                measured.vehicle_km += (last.position.x - first.position.x) / 1000.0;
                measured.vehicle_h += (inside - 1) as f64 * scene.dt() / 3600.0;
            }
            let lanes: Vec<usize> = states.iter().map(|state| scene.lane_at(state.position.y)).collect();
            measured.lane_changes[index] = changes(&lanes, (KEPT_S * scene.rate_hz).round() as usize);
        }
        measured.touches = touches(scene, trace);
        measured
    }

    fn moment(&mut self, scene: &Scene, trace: &Trace, frame: usize, half: usize) {
        let end = scene.section[1];
        let mut lanes: BTreeMap<usize, Vec<(f64, usize)>> = BTreeMap::new();
        for (index, path) in trace.paths.iter().enumerate() {
            if let Some(state) = path.at(frame).filter(|state| state.position.x <= end) {
                lanes.entry(scene.lane_at(state.position.y)).or_default().push((state.position.x, index));
            }
        }
        let dt = scene.dt() * half as f64;
        let speed = |path: &Path| {
            let (a, b) = (path.at(frame.checked_sub(half)?)?, path.at(frame + half)?);
            Some((b.position - a.position) / (2.0 * dt))
        };
        for lane in lanes.values_mut() {
            lane.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (place, (x, index)) in lane.iter().enumerate().filter(|(_, it)| scene.actors[it.1].is_driven()) {
                let path = &trace.paths[*index];
                let Some(velocity) = speed(path) else { continue };
                let mut moment =
                    Moment { speed: velocity.x, lateral_speed: velocity.y, acceleration: None, gap: None, ttc: None };
                let (before, after) = (frame.checked_sub(2 * half).and_then(|f| path.at(f)), path.at(frame + 2 * half));
                if let (Some(before), Some(after)) = (before, after) {
                    let bend = after.position.x - 2.0 * x + before.position.x;
                    moment.acceleration = Some(bend / (4.0 * dt * dt));
                }
                if let Some((ahead, other)) = lane.get(place + 1).filter(|(ahead, _)| ahead - x < FARTHEST_M) {
                    let lengths = scene.actors[*index].size[0] + scene.actors[*other].size[0];
                    let gap = ahead - x - f64::from(lengths) / 2.0;
                    let leader = &trace.paths[*other];
                    let leading = speed(leader).or_else(|| leader.at(frame).map(|state| state.velocity));
                    let closing = leading.map(|leading| velocity.x - leading.x);
                    moment.gap = Some(gap);
                    moment.ttc =
                        closing.map(|closing| if closing > 0.0 { gap.max(0.0) / closing } else { f64::INFINITY });
                }
                self.moments[*index].push(moment);
            }
        }
    }

    /// Whether a contact concerns an actor.
    #[must_use]
    pub fn is_touched(&self, actor: usize) -> bool {
        self.touches.iter().any(|touch| touch.behind == actor || touch.ahead == actor)
    }
}

/// Changes of lane that are kept for so many frames.
fn changes(lanes: &[usize], kept: usize) -> usize {
    let Some(mut lane) = lanes.first().copied() else { return 0 };
    let mut count = 0;
    for (at, new) in lanes.iter().enumerate() {
        let kept = lanes.get(at..at + kept).is_some_and(|next| next.iter().all(|next| next == new));
        if *new != lane && kept {
            (lane, count) = (*new, count + 1);
        }
    }
    count
}

/// See [`Measured::touches`].
fn touches(scene: &Scene, trace: &Trace) -> Vec<Touch> {
    let mut found = Vec::new();
    // Pairs that overlap, and whether they did so when one of them came in.
    let mut open: Vec<(usize, usize)> = Vec::new();
    for frame in 0..=scene.frames {
        let there: Vec<(usize, f64, f64)> = trace
            .paths
            .iter()
            .enumerate()
            .filter_map(|(index, path)| path.at(frame).map(|state| (index, state.position.x, state.position.y)))
            .filter(|(_, x, _)| *x <= scene.section[1])
            .collect();
        let mut now = Vec::new();
        for (place, &(a, xa, ya)) in there.iter().enumerate() {
            for &(b, xb, yb) in &there[place + 1..] {
                let [la, wa] = scene.actors[a].size.map(f64::from);
                let [lb, wb] = scene.actors[b].size.map(f64::from);
                if (xa - xb).abs() >= (la + lb) / 2.0 - TOUCH_M || (ya - yb).abs() >= (wa + wb) / 2.0 - TOUCH_M {
                    continue;
                }
                now.push((a, b));
                let came = trace.paths[a].first == frame || trace.paths[b].first == frame;
                let (behind, ahead) = if xa < xb { (a, b) } else { (b, a) };
                if !came && !open.contains(&(a, b)) && scene.actors[behind].is_driven() {
                    found.push(Touch { frame, behind, ahead });
                }
            }
        }
        open = now;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::changes;

    #[test]
    fn lane_changes_are_those_that_are_kept() {
        assert_eq!(changes(&[1, 1, 2, 2, 2, 2], 3), 1);
        assert_eq!(changes(&[1, 1, 2, 1, 1, 1], 3), 0, "a flip is none");
        assert_eq!(changes(&[1, 2, 2, 2, 1, 1, 1], 3), 2);
        assert_eq!(changes(&[1, 1, 1, 2], 3), 0, "too near the end to tell");
        assert_eq!(changes(&[], 3), 0);
    }
}
