//! A road with a target and the vehicles ahead of it.

use gnp_data::{Columns, Dataset, Observation, Predictor, Recording, RecordingMeta, Road, SLOTS, Track, WindowShape};

pub(crate) const SHAPE: WindowShape = WindowShape { t_obs: 16, t_pred: 30, step: 1, rate_hz: 10. };

/// A vehicle of 4 m in the first frames, whose centre at time `t` (s; 0 in the last observed frame)
/// is `at(t)`, recorded from frame `from` on.
pub(crate) struct Car<'a> {
    pub(crate) from: usize,
    pub(crate) at: &'a dyn Fn(f64) -> [f64; 2],
}

/// `cars[0]` behind `cars[1]`, with `after` frames recorded after the last observed one.
pub(crate) fn road(shape: WindowShape, after: usize, cars: &[Car<'_>]) -> Recording {
    let mut columns = Columns::default();
    let mut tracks = Vec::new();
    for (number, car) in cars.iter().enumerate() {
        let first = columns.x.len();
        for frame in car.from..shape.t_obs + after {
            let [x, y] = (car.at)((frame as f64 + 1. - shape.t_obs as f64) * shape.dt());
            columns.x.push(x as f32);
            columns.y.push(y as f32);
            // Not to be used: a stored velocity may know the next row.
            columns.vx.push(-99.);
            columns.vy.push(99.);
            columns.lane.push(1);
            let mut neighbours = [u32::MAX; SLOTS];
            if number == 0 && cars.get(1).is_some_and(|ahead| frame >= ahead.from) {
                neighbours[0] = 1;
            }
            columns.neighbours.push(neighbours);
        }
        tracks.push(Track::new(number as u32 + 1, [4., 1.8], car.from as u32, first..columns.x.len()));
    }
    let meta = RecordingMeta::new(Dataset::NGSIM, "s", "a", shape.rate_hz).with_simulated(true);
    let road = Road { driving_direction: 2, lines: vec![], fitted: false, axis: None };
    Recording::from_parts(meta, vec![road], tracks, columns).unwrap()
}

/// The one path that `predictor` gives the target.
pub(crate) fn path(predictor: &dyn Predictor, shape: WindowShape, recording: &Recording) -> Vec<[f32; 2]> {
    let observation = Observation::new(recording, shape, 0, shape.t_obs - 1).unwrap();
    let mut forecasts = predictor.predict(&[observation], 6).unwrap();
    let mut modes = forecasts.pop().unwrap().modes;
    assert_eq!((modes.len(), modes[0].probability, modes[0].path.len()), (1, 1., shape.t_pred));
    modes.pop().unwrap().path
}
