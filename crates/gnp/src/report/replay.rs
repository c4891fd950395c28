//! `replay`: the clip of the scene player, for the Rerun viewer.

use std::io::Write as _;
use std::path::Path;

use crate::error::{Context as _, Result, bail};
use gnp_replay::{Scene, SceneForecast, TimedState, Vehicle};

use crate::report::clip::{Clip, Shown};
use crate::run::Run;

/// What was written for the viewer.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Replayed {
    /// Recording, site and driving direction.
    pub heading: String,
    /// Vehicles in it.
    pub vehicles: usize,
    /// Forecasts in it.
    pub forecasts: usize,
    /// Version of the viewer that opens it.
    pub viewer: &'static str,
}

/// Whether this build can write files for the Rerun viewer.
///
/// # Errors
/// [`Error::Unavailable`](crate::Error::Unavailable) in a build without the feature `rerun`.
pub fn can_replay() -> Result<()> {
    if !gnp_replay::CAN_ENCODE {
        bail!(Unavailable, "this build cannot write Rerun files, which needs the feature `rerun`");
    }
    Ok(())
}

/// Writes the clip of the scene player of a finished run for the Rerun viewer. `vehicle` is shown first; without one,
/// of the test part the one that moves sideways most.
///
/// # Errors
/// As [`can_replay`]; when a file of the run cannot be used; when it has nothing to show, or not the vehicle asked
/// for; when the file cannot be written.
pub fn write_replay(run: &Run, path: &Path, vehicle: Option<u32>) -> Result<Replayed> {
    can_replay()?;
    // Before minutes of work are done for it.
    let mut file = place(path)?;
    let set = run.windows()?;
    let split = run.split(&set)?;
    let Some(clip) = Clip::of(run, &set, &split)? else {
        bail!(
            Folder,
            "{} has no test windows, so that there is nothing to replay; split it in another way",
            run.path().display()
        );
    };
    let mut scene = scene(clip);
    scene.picked = match vehicle {
        Some(id) if scene.vehicles.iter().all(|vehicle| vehicle.id != id) => {
            bail!(
                Recordings,
                "vehicle {id} is not in the minute that is replayed; leave --vehicle out, or take one of {}",
                ids(&scene)
            )
        }
        Some(id) => Some(id),
        None => scene.liveliest(),
    };
    let cannot = || format!("cannot write {}", path.display());
    file.write_all(&gnp_replay::encode(&scene)?).with_context(cannot)?;
    file.persist(path).map_err(|error| error.error).with_context(cannot)?;
    Ok(Replayed {
        heading: scene.heading(),
        vehicles: scene.vehicles.len(),
        forecasts: scene.vehicles.iter().map(|vehicle| vehicle.forecasts.len()).sum(),
        viewer: gnp_replay::VIEWER,
    })
}

/// A temporary file beside the one to be written.
fn place(path: &Path) -> Result<gnp_file::NamedTempFile> {
    if path.is_dir() {
        bail!(Folder, "--rrd {} is a folder; give the name of a file", path.display());
    }
    gnp_file::beside(path).with_context(|| {
        format!("cannot write {}; give --rrd a file in a folder that can be written to", path.display())
    })
}

/// Numbers of the vehicles that are forecast.
fn ids(scene: &Scene) -> String {
    let mut ids: Vec<u32> = scene.vehicles.iter().filter(|v| !v.forecasts.is_empty()).map(|v| v.id).collect();
    ids.sort_unstable();
    ids.dedup();
    ids.iter().map(u32::to_string).collect::<Vec<_>>().join(", ")
}

/// The clip as it is replayed, with nobody picked.
fn scene(mut clip: Clip<'_>) -> Scene {
    let forecasts = std::mem::take(&mut clip.forecasts);
    let (recording, meta) = (clip.recording, clip.recording.meta());
    let road = &recording.roads()[usize::from(clip.road)];
    let mut vehicles: Vec<Vehicle> = clip.vehicles.iter().map(|shown| vehicle(&clip, shown)).collect();
    for made in forecasts {
        let seen = made.seen;
        let [x0, y0] = seen.origin();
        let history = (0..clip.shape.t_obs).map(|i| seen.target(i)).map(|state| [x0 + state.x, y0 + state.y]);
        vehicles[made.vehicle].forecasts.push(SceneForecast {
            frame: seen.frame(),
            frame_step: clip.shape.step as u32,
            history: history.collect(),
            modes: made.forecast.modes,
        });
    }
    Scene {
        title: format!("{}, {}, driving direction {}", meta.name, meta.site, road.driving_direction),
        simulated: meta.simulated,
        rate_hz: meta.rate_hz,
        frame_step: clip.step,
        lines: road.lines.clone(),
        vehicles,
        picked: None,
    }
}

fn vehicle(clip: &Clip<'_>, shown: &Shown<'_>) -> Vehicle {
    let moment = |(frame, row): &(usize, usize)| {
        let state = clip.recording.state(*row);
        TimedState { frame: clip.recorded(*frame), centre: [state.x, state.y], velocity: [state.vx, state.vy] }
    };
    Vehicle {
        id: shown.track.vehicle,
        class: shown.track.class,
        test: shown.test,
        size: [shown.track.length, shown.track.width],
        moments: shown.rows.iter().map(moment).collect(),
        forecasts: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use gnp_data::{
        Columns, Dataset, Explanation, Forecast, LaneMarking, MarkingKind, Mode, Observation, Recording, RecordingMeta,
        Road, SLOTS, Track, VehicleClass, WindowShape,
    };

    use super::*;
    use crate::report::clip::Made;

    /// A car on the second of two roads, from recorded frame 40 on: `x` is a tenth of the frame, `y` the row.
    fn recording() -> Recording {
        let rows = 30;
        let meta = RecordingMeta {
            dataset: Dataset::HighD,
            site: "site 3".to_owned(),
            name: "recording 4".to_owned(),
            rate_hz: 25.,
            simulated: true,
        };
        let lines = |y| {
            [LaneMarking { kind: MarkingKind::Boundary, y }, LaneMarking { kind: MarkingKind::Boundary, y: y + 4. }]
                .to_vec()
        };
        let road = |driving_direction, y| Road { driving_direction, lines: lines(y), fitted: false };
        let track = Track {
            vehicle: 9,
            segment: 0,
            road: 1,
            class: VehicleClass::Truck,
            length: 11.,
            width: 2.5,
            first_frame: 40,
            rows: 0..rows,
        };
        let columns = Columns {
            x: (0..rows).map(|row| (row + 40) as f32 / 10.).collect(),
            y: (0..rows).map(|row| row as f32).collect(),
            vx: vec![2.5; rows],
            vy: (0..rows).map(|row| row as f32 / 4.).collect(),
            lane: vec![1; rows],
            neighbours: vec![[u32::MAX; SLOTS]; rows],
        };
        Recording::from_parts(meta, vec![road(1, 50.), road(2, 0.)], vec![track], columns).unwrap()
    }

    #[test]
    fn a_stretch_becomes_a_scene_in_the_road_frame() {
        let recording = recording();
        let shape = WindowShape { t_obs: 4, t_pred: 2, step: 2, rate_hz: 12.5 };
        let rows = [(2, 6), (3, 9), (5, 15)].to_vec(); // of frames 46, 49 and 55
        let forecast = Forecast {
            modes: vec![Mode {
                probability: 1.,
                path: vec![[1., 0.], [2., 0.5]],
                explanation: Some(Explanation { goal: [2., 0.5], terms: Vec::new() }),
            }],
        };
        let made = Made {
            vehicle: 0,
            frame: 3,
            seen: Observation::new(&recording, shape, 0, 9).unwrap(),
            neighbours: vec![-2; SLOTS],
            forecast: forecast.clone(),
        };
        let scene = scene(Clip {
            recording: &recording,
            road: 1,
            shape,
            step: 3,
            rate: 25. / 3.,
            frames: 7,
            first_frame: 40,
            vehicles: vec![Shown { track: &recording.tracks()[0], test: true, rows }],
            forecasts: vec![made],
        });
        assert_eq!(scene.heading(), "recording 4, site 3, driving direction 2 (simulated)");
        assert_eq!((scene.rate_hz, scene.frame_step, scene.picked), (25., 3, None));
        assert_eq!(scene.lines.iter().map(|line| line.y).collect::<Vec<_>>(), [0., 4.]);
        let [truck] = &scene.vehicles[..] else { panic!("{:?}", scene.vehicles) };
        assert_eq!((truck.id, truck.class, truck.test, truck.size), (9, VehicleClass::Truck, true, [11., 2.5]));
        assert_eq!(truck.moments.iter().map(|moment| moment.frame).collect::<Vec<_>>(), [46, 49, 55]);
        assert_eq!(truck.moments[2], TimedState { frame: 55, centre: [5.5, 15.], velocity: [2.5, 3.75] });
        let [found] = &truck.forecasts[..] else { panic!("{:?}", truck.forecasts) };
        assert_eq!((found.frame, found.frame_step), (49, 2));
        assert_eq!(found.history.iter().map(|point| point[1]).collect::<Vec<_>>(), [3., 5., 7., 9.]);
        assert!((found.history[3][0] - 4.9).abs() < 1e-6, "{:?}", found.history);
        assert_eq!(found.modes, forecast.modes);
        assert_eq!(ids(&scene), "9");
    }
}
