//! One window seen by the metrics: what happened, and a forecast compared with it.

use gnp_data::{Forecast, Mode, Window, WindowShape};

use crate::error::{EvalError, ForecastProblem};
use crate::metric::Footprint;
use crate::spreads::Spread;

/// What happened in the predicted frames of one window: the target's path, the road's edges and the
/// boxes of the other vehicles. Window frame, m.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    path: Vec<[f32; 2]>,
    rate_hz: f64,
    /// Present speed, m/s.
    speed: f64,
    size: [f32; 2],
    edges: Option<[f32; 2]>,
    /// Lateral positions of all lines, from right to left.
    lines: Vec<f32>,
    /// Lateral position of the target in the observed frames, 0 in the last.
    past_y: Vec<f32>,
    /// Lane numbers in the last observed and in each predicted frame; 0 where unknown.
    lanes: Vec<i16>,
    others: Vec<Vec<Footprint>>,
}

impl Reference {
    /// Everything that happened in a window.
    #[must_use]
    pub fn of(window: &Window<'_>) -> Self {
        let (seen, truth) = (window.observation(), window.truth());
        let t_pred = seen.shape().t_pred;
        let now = seen.target(seen.shape().t_obs.saturating_sub(1));
        let mut lines: Vec<f32> = seen.lines().map(|line| line.y).collect();
        lines.sort_by(f32::total_cmp);
        let edges = lines.first().zip(lines.last()).map(|(right, left)| [*right, *left]);
        let footprints = |j| truth.others(j).map(|(state, size)| Footprint::along_road([state.x, state.y], size));
        Self {
            path: (0..t_pred).map(|j| truth.target(j)).map(|state| [state.x, state.y]).collect(),
            rate_hz: seen.shape().rate_hz,
            speed: f64::from(now.vx).hypot(f64::from(now.vy)),
            size: seen.size(),
            edges: edges.filter(|[right, left]| right < left),
            lines,
            past_y: (0..seen.shape().t_obs).map(|i| seen.target(i).y).collect(),
            lanes: std::iter::once(seen.lane()).chain((0..t_pred).map(|j| truth.lane(j))).collect(),
            others: (0..t_pred).map(|j| footprints(j).collect()).collect(),
        }
    }

    /// A bare path on an empty plane: no lines, no other vehicle; the present speed is that of the
    /// first step.
    #[must_use]
    pub fn from_path(path: Vec<[f32; 2]>, rate_hz: f64) -> Self {
        let others = vec![Vec::new(); path.len()];
        let speed = path.first().map_or(0., |p| f64::from(p[0]).hypot(f64::from(p[1])) * rate_hz);
        let lanes = vec![0; path.len() + 1];
        Self { path, rate_hz, speed, size: [0.; 2], edges: None, lines: Vec::new(), past_y: vec![0.], lanes, others }
    }

    /// Centre of the target in each predicted frame, m.
    #[must_use]
    pub fn path(&self) -> &[[f32; 2]] {
        &self.path
    }

    /// Rate of the predicted frames, Hz.
    #[must_use]
    pub(crate) fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Speed at the last observed frame, m/s.
    #[must_use]
    pub(crate) fn speed(&self) -> f64 {
        self.speed
    }

    /// Length and width of the target, m.
    #[must_use]
    pub(crate) fn size(&self) -> [f32; 2] {
        self.size
    }

    /// Lateral positions of the rightmost and the leftmost line, m; `None` where fewer than two
    /// lines are known.
    #[must_use]
    pub(crate) fn edges(&self) -> Option<[f32; 2]> {
        self.edges
    }

    /// Lateral positions of the lines, from right to left, m.
    #[must_use]
    pub(crate) fn lines(&self) -> &[f32] {
        &self.lines
    }

    /// Lateral position of the target in the observed frames, m; 0 in the last.
    #[must_use]
    pub(crate) fn past_y(&self) -> &[f32] {
        &self.past_y
    }

    /// Lane numbers now and after `frames` predicted frames; 0 where unknown.
    #[must_use]
    pub(crate) fn lanes(&self, frames: usize) -> [i16; 2] {
        [self.lanes[0], self.lanes[frames]]
    }

    /// Footprints of the other vehicles in predicted frame `j`.
    #[must_use]
    pub(crate) fn others(&self, j: usize) -> &[Footprint] {
        &self.others[j]
    }

    /// Number of predicted frames up to `horizon_s`, the frame at that time included.
    ///
    /// # Errors
    /// When no predicted frame lies at that time.
    pub fn frames(&self, horizon_s: f64) -> Result<usize, EvalError> {
        frames_to(horizon_s, self.rate_hz, self.path.len())
    }
}

/// Number of frames up to `horizon_s`, if one of the `predicted` frames lies at that time.
pub(crate) fn frames_to(horizon_s: f64, rate_hz: f64, t_pred: usize) -> Result<usize, EvalError> {
    let exact = horizon_s * rate_hz;
    let frames = exact.round();
    let fits = frames >= 1. && frames <= t_pred as f64 && (exact - frames).abs() < 1e-6;
    if fits { Ok(frames as usize) } else { Err(EvalError::Horizon { horizon_s, rate_hz, t_pred }) }
}

/// Whole seconds up to the horizon at which the windows have a predicted frame: 1, 2, 3, 4, 5 at
/// 25, 10 or 5 Hz; only 2 and 4 at 12.5 Hz, where the others fall between two frames.
///
/// # Errors
/// When there is none.
pub(crate) fn whole_seconds(shape: &WindowShape) -> Result<Vec<f64>, EvalError> {
    let last = (shape.t_pred as f64 / shape.rate_hz + 1e-6).floor() as u32;
    let on_frame = |second: &f64| frames_to(*second, shape.rate_hz, shape.t_pred).is_ok();
    let seconds: Vec<f64> = (1..=last).map(f64::from).filter(on_frame).collect();
    if seconds.is_empty() {
        return Err(EvalError::Horizon { horizon_s: 1., rate_hz: shape.rate_hz, t_pred: shape.t_pred });
    }
    Ok(seconds)
}

/// A forecast compared with what happened: the squared displacement of every mode in every frame.
#[derive(Clone, Debug)]
pub struct ScoredWindow<'a> {
    reference: &'a Reference,
    modes: &'a [Mode],
    /// `[modes, frames]`, m².
    squared: Vec<f64>,
    /// By whole second; empty for a system without densities.
    spreads: &'a [Spread],
}

impl<'a> ScoredWindow<'a> {
    /// Holds a forecast that was asked for at most `asked` modes against what happened.
    ///
    /// # Errors
    /// When it has no mode or too many, a path of another length or with a value that is not
    /// finite, or probabilities that are not in order or do not sum to 1.
    pub fn new(reference: &'a Reference, forecast: &'a Forecast, asked: usize) -> Result<Self, ForecastProblem> {
        let modes = &forecast.modes[..];
        check(modes, reference.path.len(), asked)?;
        let squared = modes
            .iter()
            .flat_map(|mode| mode.path.iter().zip(&reference.path))
            .map(|(p, q)| (f64::from(p[0]) - f64::from(q[0])).powi(2) + (f64::from(p[1]) - f64::from(q[1])).powi(2))
            .collect();
        Ok(Self { reference, modes, squared, spreads: &[] })
    }

    /// The same with the spreads of the system on the window's site, without which it has no density.
    #[must_use]
    pub fn with_spreads(mut self, spreads: &'a [Spread]) -> Self {
        self.spreads = spreads;
        self
    }

    /// The spreads up to `horizon_s`, in order; none where they do not reach it.
    #[must_use]
    pub(crate) fn spreads_to(&self, horizon_s: f64) -> &'a [Spread] {
        let last = self.spreads.iter().position(|spread| (spread.horizon_s - horizon_s).abs() < 1e-6);
        last.map_or(&[], |last| &self.spreads[..=last])
    }

    /// What happened.
    #[must_use]
    pub fn reference(&self) -> &Reference {
        self.reference
    }

    /// The forecast's modes: the prediction, then the others by falling probability.
    #[must_use]
    pub fn modes(&self) -> &[Mode] {
        self.modes
    }

    /// Squared displacement of `mode` in each of the first `frames` predicted frames, m².
    #[must_use]
    pub(crate) fn squared(&self, mode: usize, frames: usize) -> &[f64] {
        let start = mode * self.reference.path.len();
        &self.squared[start..start + frames]
    }
}

fn check(modes: &[Mode], frames: usize, asked: usize) -> Result<(), ForecastProblem> {
    if modes.is_empty() {
        return Err(ForecastProblem::NoModes);
    }
    if modes.len() > asked {
        return Err(ForecastProblem::TooMany { asked, found: modes.len() });
    }
    let mut before = f32::INFINITY;
    for (mode, Mode { probability, path, .. }) in modes.iter().enumerate() {
        let probability = *probability;
        // The first is the prediction, whatever its probability.
        if mode == 1 {
            before = f32::INFINITY;
        }
        if path.len() != frames {
            return Err(ForecastProblem::Frames { mode, needs: frames, found: path.len() });
        }
        if let Some(j) = path.iter().position(|p| !(p[0].is_finite() && p[1].is_finite())) {
            return Err(ForecastProblem::NotFinite { mode, step: j + 1 });
        }
        if !(0. ..=1.).contains(&probability) {
            return Err(ForecastProblem::Probability { mode, probability });
        }
        if probability > before {
            return Err(ForecastProblem::Order { mode });
        }
        before = probability;
    }
    let sum: f64 = modes.iter().map(|mode| f64::from(mode.probability)).sum();
    // Single precision, and files with rounded probabilities, stay within this.
    if (sum - 1.).abs() > 1e-3 { Err(ForecastProblem::Sum { sum }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(probability: f32, path: &[[f32; 2]]) -> Mode {
        Mode { probability, path: path.to_vec(), explanation: None }
    }

    #[test]
    fn whole_seconds_fall_on_frames() {
        let five = vec![1., 2., 3., 4., 5.];
        let cases = [
            (25., 125, five.clone()),
            (10., 50, five.clone()),
            (5., 25, five),
            (10., 48, vec![1., 2., 3., 4.]),
            (12.5, 62, vec![2., 4.]),
            (25. / 3., 41, vec![3.]),
        ];
        for (rate_hz, t_pred, seconds) in cases {
            let shape = WindowShape { t_obs: 7, t_pred, step: 1, rate_hz };
            assert_eq!(whole_seconds(&shape).unwrap(), seconds, "{rate_hz} Hz");
        }
        assert_eq!(frames_to(3., 25. / 3., 41).unwrap(), 25);
        assert!(matches!(frames_to(1., 12.5, 62), Err(EvalError::Horizon { .. })));
        assert!(matches!(frames_to(6., 10., 50), Err(EvalError::Horizon { .. })));
    }

    #[test]
    fn a_horizon_below_one_second_is_refused() {
        let shape = WindowShape { t_obs: 7, t_pred: 9, step: 1, rate_hz: 10. };
        assert!(matches!(whole_seconds(&shape), Err(EvalError::Horizon { t_pred: 9, .. })));
    }

    #[test]
    fn what_cannot_be_scored_is_named() {
        let reference = Reference::from_path(vec![[1., 0.], [2., 0.]], 2.);
        let path = [[1., 0.], [2., 0.]];
        let asked = |modes: Vec<Mode>, asked| ScoredWindow::new(&reference, &Forecast { modes }, asked).err();
        let problem = |modes: Vec<Mode>| asked(modes, 2);
        assert_eq!(problem(vec![mode(1., &path)]), None);
        assert_eq!(problem(vec![]), Some(ForecastProblem::NoModes));
        let three = vec![mode(0.4, &path), mode(0.3, &path), mode(0.3, &path)];
        assert_eq!(problem(three), Some(ForecastProblem::TooMany { asked: 2, found: 3 }));
        let short = vec![mode(0.6, &path), mode(0.4, &path[..1])];
        assert_eq!(problem(short), Some(ForecastProblem::Frames { mode: 1, needs: 2, found: 1 }));
        let nan = vec![mode(1., &[[1., 0.], [f32::NAN, 0.]])];
        assert_eq!(problem(nan), Some(ForecastProblem::NotFinite { mode: 0, step: 2 }));
        // The first is the prediction, likeliest or not; the others are in order.
        assert_eq!(problem(vec![mode(0.4, &path), mode(0.6, &path)]), None);
        let unsorted = vec![mode(0.4, &path), mode(0.2, &path), mode(0.4, &path)];
        assert_eq!(asked(unsorted, 3), Some(ForecastProblem::Order { mode: 2 }));
        assert!(matches!(problem(vec![mode(0.7, &path), mode(0.2, &path)]), Some(ForecastProblem::Sum { .. })));
        let above = vec![mode(1.5, &path)];
        assert_eq!(problem(above), Some(ForecastProblem::Probability { mode: 0, probability: 1.5 }));
        assert!(matches!(problem(vec![mode(f32::NAN, &path)]), Some(ForecastProblem::Probability { .. })));
    }
}
