//! Small made-up roads, and a model that is easy to follow.

use gnp_data::{
    Columns, Dataset, Forecast, LaneMarking, MarkingKind, Mode, Observation, PredictError, Predictor, Recording,
    RecordingMeta, Road, Subset, Track, WindowConfig,
};
use gnp_eval::{Bootstrap, EvalConfig, Metric, Protocol, Score};

pub(crate) const RATE_HZ: f64 = 2.;
pub(crate) const FRAMES: u32 = 9;
/// A vehicle whose centre is at `(x0 + v t + a t²/2, y)`.
#[derive(Clone, Copy)]
pub(crate) struct Car {
    pub(crate) vehicle: u32,
    pub(crate) x0: f32,
    pub(crate) y: f32,
    pub(crate) v: f32,
    pub(crate) a: f32,
}

/// A straight road with lines at y = 0, 4 and 8 m; vehicles of 4 x 2 m.
pub(crate) fn recording(name: &str, site: &str, simulated: bool, cars: &[Car]) -> Recording {
    sized(name, site, simulated, cars, |_| [4., 2.])
}

/// The same with vehicles of other sizes.
pub(crate) fn sized(
    name: &str,
    site: &str,
    simulated: bool,
    cars: &[Car],
    size: impl Fn(&Car) -> [f32; 2],
) -> Recording {
    let mut columns = Columns::default();
    let mut tracks = Vec::new();
    for car in cars {
        let start = columns.x.len();
        for frame in 0..FRAMES {
            let t = frame as f32 / RATE_HZ as f32;
            columns.x.push(car.x0 + car.v * t + car.a * t * t / 2.);
            columns.y.push(car.y);
            columns.vx.push(car.v + car.a * t);
            columns.vy.push(0.);
            columns.lane.push(1);
            columns.neighbours.push([u32::MAX; 8]);
        }
        tracks.push(Track::new(car.vehicle, size(car), 100, start..columns.x.len()));
    }
    let kinds = [MarkingKind::Boundary, MarkingKind::LaneDivider, MarkingKind::Boundary];
    let lines = kinds.into_iter().zip([0., 4., 8.]).map(|(kind, y)| LaneMarking { kind, y }).collect();
    let meta = RecordingMeta::new(Dataset::NGSIM, site, name, RATE_HZ).with_simulated(simulated);
    Recording::from_parts(meta, vec![Road { driving_direction: 2, lines, fitted: true, axis: None }], tracks, columns)
        .unwrap()
}

/// Five observed and four predicted frames: one window a vehicle, 2 s ahead.
pub(crate) fn windows() -> WindowConfig {
    WindowConfig { observed_s: 2., predicted_s: 2., rate_hz: RATE_HZ, stride_s: 10., site_stride_s: Default::default() }
}

pub(crate) fn config(protocols: &[Protocol]) -> EvalConfig {
    EvalConfig {
        subset: Subset::Test,
        protocols: protocols.to_vec(),
        batch: 2,
        bootstrap: Bootstrap { resamples: 200, seed: 3 },
    }
}

/// Goes on with the last speed; `drift` m/s to the left are added, and further modes drift more.
pub(crate) struct Straight {
    pub(crate) name: &'static str,
    pub(crate) drift: f32,
}

impl Predictor for Straight {
    fn name(&self) -> &str {
        self.name
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let modes = k.min(3);
        let of_window = |seen: &Observation<'_>| {
            let shape = seen.shape();
            let vx = seen.target(shape.t_obs - 1).vx;
            let path = |m: usize| {
                let t = |j: usize| (j + 1) as f32 * shape.dt() as f32;
                (0..shape.t_pred).map(|j| [vx * t(j), (self.drift + m as f32) * t(j)]).collect()
            };
            let mode = |m| Mode { probability: 1. / modes as f32, path: path(m), explanation: None };
            Forecast { modes: (0..modes).map(mode).collect() }
        };
        Ok(observations.iter().map(of_window).collect())
    }
}

pub(crate) fn find<'a>(scores: &'a [Score], site: &str, metric: Metric) -> &'a Score {
    let is = |s: &&Score| {
        (s.site.as_str(), s.metric.as_str(), s.k, s.horizon_s) == (site, metric.kind.name(), metric.k, metric.horizon_s)
    };
    scores.iter().find(is).unwrap_or_else(|| panic!("{metric} on {site}"))
}
