//! One window as it is drawn: road, vehicles, what was seen, what was forecast, what happened.

use gnp_data::{Forecast, LaneMarking, Mode, Observation, TrackState, Window};

/// A vehicle's box: centre, length and width, m, window frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleBox {
    /// Centre, forward and left, m.
    pub centre: [f32; 2],
    /// Length and width, m.
    pub size: [f32; 2],
}

/// Another vehicle of the carriageway.
#[derive(Clone, Debug, PartialEq)]
pub struct Other {
    /// At the last observed frame.
    pub now: VehicleBox,
    /// Its observed centres, m, oldest first.
    pub history: Vec<[f32; 2]>,
}

/// A window to be drawn. Positions in m in the window's frame: x forward, y left, the target's last
/// observed centre is the origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// What the window is, in a few words.
    pub title: String,
    /// Lane lines from right to left.
    pub lines: Vec<LaneMarking>,
    /// Length and width of the target, m.
    pub size: [f32; 2],
    /// Observed centres of the target, the origin last.
    pub history: Vec<[f32; 2]>,
    /// What happened, one point a predicted frame; empty where unknown.
    pub truth: Vec<[f32; 2]>,
    /// Where on the true path the lane number of the file changes.
    pub lane_changes: Vec<[f32; 2]>,
    /// The other vehicles.
    pub others: Vec<Other>,
    /// The forecast, the prediction first.
    pub modes: Vec<Mode>,
    /// Period of the frames, s.
    pub dt: f64,
}

impl Scene {
    /// Everything about a window and a forecast of it.
    #[must_use]
    pub fn of(window: &Window<'_>, forecast: Forecast, title: String) -> Self {
        let (seen, truth) = (window.observation(), window.truth());
        let steps = seen.shape().t_pred;
        let mut lane_changes = Vec::new();
        let mut lane = seen.lane();
        for j in 0..steps {
            let next = truth.lane(j);
            if next != lane && next != 0 && lane != 0 {
                lane_changes.push(point(truth.target(j)));
            }
            lane = next;
        }
        let truth = (0..steps).map(|j| point(truth.target(j))).collect();
        Self { truth, lane_changes, ..Self::seen(&seen, forecast, title) }
    }

    /// Everything about an observation and a forecast of it; what happened is not known.
    #[must_use]
    pub fn seen(seen: &Observation<'_>, forecast: Forecast, title: String) -> Self {
        let shape = seen.shape();
        let others = seen.others().map(|other| Other {
            now: VehicleBox { centre: point(other.now()), size: other.size() },
            history: (0..shape.t_obs).filter_map(|i| other.state(i).map(point)).collect(),
        });
        Self {
            title,
            lines: seen.lines().collect(),
            size: seen.size(),
            history: (0..shape.t_obs).map(|i| point(seen.target(i))).collect(),
            truth: Vec::new(),
            lane_changes: Vec::new(),
            others: others.collect(),
            modes: forecast.modes,
            dt: shape.dt(),
        }
    }

    /// The mode whose end is nearest to the truth's; the first where there is no truth.
    #[must_use]
    pub fn best(&self) -> usize {
        let Some(end) = self.truth.last() else { return 0 };
        let miss = |mode: &Mode| mode.path.last().map_or(f32::INFINITY, |p| (p[0] - end[0]).hypot(p[1] - end[1]));
        let all = self.modes.iter().map(miss).enumerate();
        all.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i)
    }
}

fn point(state: TrackState) -> [f32; 2] {
    [state.x, state.y]
}
