//! Models and streams in the form that C takes: numbers in arrays that are used again.

use std::ffi::CString;
use std::path::Path;

use gnp_data::{LaneMarking, VehicleClass};
use gnp_model::{Device, Gnp};
use gnp_online::{Frame, Reason, StreamConfig, Tracked, Validity};
use gnp_road::ReferenceLine;

use crate::border::{
    GNP_HAS_SIZE, GNP_HAS_VELOCITY, GnpKind, GnpLine, GnpModelInfo, GnpPoint, GnpProblem, GnpReason, GnpStreamConfig,
    GnpTrack, GnpValidity, GnpVehicle,
};
use crate::failure::Failure;

/// A trained model.
#[derive(Debug)]
pub(crate) struct Model(Gnp);

impl Model {
    /// That of a model folder, or the one that is in the library.
    pub(crate) fn load(folder: Option<&str>) -> Result<Self, Failure> {
        let gnp = match folder {
            Some(folder) => Gnp::open(Path::new(folder), &Device::Cpu)?,
            None => gnp_pretrained::ngsim()?,
        };
        Ok(Self(gnp))
    }

    /// What it predicts.
    pub(crate) fn info(&self) -> GnpModelInfo {
        let shape = self.0.shape();
        GnpModelInfo {
            rate_hz: shape.rate_hz,
            observed_s: (shape.t_obs - 1) as f64 * shape.dt(),
            predicted_s: shape.t_pred as f64 * shape.dt(),
        }
    }
}

/// A stream with the arrays of its last result.
#[derive(Debug)]
pub(crate) struct Stream {
    stream: gnp_online::Stream,
    observed_s: f64,
    tracks: Vec<Tracked>,
    vehicles: Vec<GnpVehicle>,
    problems: Vec<GnpProblem>,
    /// Of the terms of the force, once they are known.
    term_names: Vec<CString>,
    /// Whether a call did not come to its end.
    broken: bool,
}

/// What a frame gave.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flat<'a> {
    pub(crate) frame: Frame<'a>,
    pub(crate) vehicles: &'a [GnpVehicle],
    pub(crate) problems: &'a [GnpProblem],
    /// Number of vehicles that are predicted.
    pub(crate) forecasts: usize,
    pub(crate) term_names: &'a [CString],
}

impl Stream {
    /// What a stream is by default.
    pub(crate) fn defaults() -> GnpStreamConfig {
        let StreamConfig { k, coast_s, bridge_s, max_vehicles, max_rate_hz, .. } = StreamConfig::default();
        GnpStreamConfig {
            lines: std::ptr::null(),
            line_count: 0,
            road: std::ptr::null(),
            road_count: 0,
            modes: k,
            max_vehicles,
            coast_s,
            bridge_s,
            max_rate_hz,
            forces: 0,
        }
    }

    /// A stream of the carriageway between `lines` on the line through `road`, or straight without points.
    pub(crate) fn new(
        model: &Model,
        config: &GnpStreamConfig,
        lines: &[GnpLine],
        road: &[GnpPoint],
    ) -> Result<Self, Failure> {
        let road: Vec<[f64; 2]> = road.iter().map(|point| [point.x, point.y]).collect();
        let road = if road.is_empty() { None } else { Some(ReferenceLine::from_points(&road)?) };
        let online = StreamConfig {
            k: config.modes,
            road,
            coast_s: config.coast_s,
            bridge_s: config.bridge_s,
            max_vehicles: config.max_vehicles,
            max_rate_hz: config.max_rate_hz,
            ..StreamConfig::default()
        };
        let explain = flag(config.forces).ok_or_else(|| Failure::value("config.forces", config.forces, "0 or 1"))?;
        let gnp = model.0.clone().explaining(explain);
        Ok(Self {
            stream: gnp_online::Stream::new(&gnp, markings(lines)?, online)?,
            observed_s: model.info().observed_s,
            tracks: Vec::new(),
            vehicles: Vec::new(),
            problems: Vec::new(),
            term_names: Vec::new(),
            broken: false,
        })
    }

    /// Moves the lane lines.
    pub(crate) fn set_lines(&mut self, lines: &[GnpLine]) -> Result<(), Failure> {
        let lines = markings(lines)?;
        self.whole(|this| Ok(this.stream.set_lines(lines)?))
    }

    /// Forgets vehicles and time.
    pub(crate) fn reset(&mut self) -> Result<(), Failure> {
        self.whole(|this| {
            this.stream.reset();
            Ok(())
        })
    }

    /// Takes a frame in.
    pub(crate) fn push(&mut self, time_s: f64, tracks: &[GnpTrack]) -> Result<Flat<'_>, Failure> {
        self.whole(|this| {
            this.tracks.clear();
            for (row, track) in tracks.iter().enumerate() {
                this.tracks.push(tracked(row, track)?);
            }
            let Self { stream, tracks, vehicles, problems, term_names, observed_s, .. } = this;
            let frame = stream.push(time_s, tracks)?;
            vehicles.clear();
            vehicles.extend(frame.vehicles().map(|it| vehicle(&it, *observed_s)));
            problems.clear();
            problems.extend(frame.problems().iter().map(|it| GnpProblem {
                id: it.id,
                row: it.row,
                reason: reason(&it.reason),
            }));
            // The same terms act in every frame.
            if term_names.len() != frame.terms().len() {
                let names = frame.terms().iter().map(|it| CString::new(it.term.name.as_bytes()).unwrap_or_default());
                *term_names = names.collect();
            }
            Ok(())
        })?;
        Ok(Flat {
            frame: self.stream.frame(),
            vehicles: &self.vehicles,
            problems: &self.problems,
            forecasts: self.vehicles.iter().filter(|it| it.forecast >= 0).count(),
            term_names: &self.term_names,
        })
    }

    /// Refuses a stream in which a panic may have left something half done.
    fn whole(&mut self, work: impl FnOnce(&mut Self) -> Result<(), Failure>) -> Result<(), Failure> {
        if std::mem::replace(&mut self.broken, true) {
            return Err(Failure::Broken);
        }
        let done = work(self);
        self.broken = false;
        done
    }
}

fn flag(number: u32) -> Option<bool> {
    [false, true].get(number as usize).copied()
}

fn markings(lines: &[GnpLine]) -> Result<Vec<LaneMarking>, Failure> {
    let edge = |line: &GnpLine| flag(line.edge).ok_or_else(|| Failure::value("edge of a line", line.edge, "0 or 1"));
    lines.iter().map(|line| Ok(LaneMarking::new(line.y, edge(line)?))).collect()
}

fn tracked(row: usize, track: &GnpTrack) -> Result<Tracked, Failure> {
    let kinds = [
        (GnpKind::Car, VehicleClass::Car),
        (GnpKind::Truck, VehicleClass::Truck),
        (GnpKind::Motorcycle, VehicleClass::Motorcycle),
    ];
    let kind = kinds.into_iter().find(|(kind, _)| *kind as u32 == track.kind);
    let (_, class) = kind.ok_or_else(|| Failure::of_track(row, "kind", track.kind, "one of GnpKind"))?;
    if track.known & !(GNP_HAS_VELOCITY | GNP_HAS_SIZE) != 0 {
        return Err(Failure::of_track(row, "known", track.known, "made of GNP_HAS_VELOCITY and GNP_HAS_SIZE"));
    }
    let has = |bit| track.known & bit != 0;
    let mut tracked = Tracked::new(track.id, [track.x, track.y]).with_class(class);
    tracked.velocity = has(GNP_HAS_VELOCITY).then_some([track.vx, track.vy]);
    tracked.size = has(GNP_HAS_SIZE).then_some([track.length, track.width]);
    Ok(tracked)
}

fn vehicle(vehicle: &gnp_online::Vehicle<'_>, of_model_s: f64) -> GnpVehicle {
    let [x, y] = vehicle.position();
    let (validity, observed_s, why) = match vehicle.validity() {
        Validity::Full => (GnpValidity::Full, of_model_s, GnpReason::None),
        Validity::Filled { observed_s } => (GnpValidity::Filled, observed_s, GnpReason::None),
        Validity::Interpolated { .. } => (GnpValidity::Interpolated, of_model_s, GnpReason::None),
        Validity::Not(why) => (GnpValidity::None, 0., reason(&why)),
        _ => (GnpValidity::None, 0., GnpReason::Other),
    };
    let forecast = vehicle.window().and_then(|window| i64::try_from(window).ok()).unwrap_or(-1);
    let (id, age_s, gap_s) = (vehicle.id(), vehicle.age_s(), vehicle.gap_s());
    GnpVehicle { id, x, y, age_s, observed_s, gap_s, validity, reason: why, forecast }
}

fn reason(reason: &Reason) -> GnpReason {
    match reason {
        Reason::Position => GnpReason::Position,
        Reason::OffRoad(_) => GnpReason::OffRoad,
        Reason::Duplicate => GnpReason::Duplicate,
        Reason::Capacity(_) => GnpReason::Capacity,
        Reason::Velocity => GnpReason::Velocity,
        Reason::Size => GnpReason::Size,
        Reason::NoVelocity => GnpReason::NoVelocity,
        Reason::NotFinite => GnpReason::NotFinite,
        _ => GnpReason::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::border::GnpStatus;
    use crate::failure::guard;

    const LINES: [GnpLine; 3] = [GnpLine { y: -3.7, edge: 1 }, GnpLine { y: 0., edge: 0 }, GnpLine { y: 3.7, edge: 1 }];

    fn frame(i: u8) -> [GnpTrack; 2] {
        let (bits, t) = (GNP_HAS_VELOCITY, 0.04 * f64::from(i));
        let track = |id, x, vx| GnpTrack { id, x, y: -1.8, vx, vy: 0., length: 0., width: 0., kind: 0, known: bits };
        [track(4, 25. * t, 25.), track(u64::MAX, 40. + 20. * t, 20.)]
    }

    #[test]
    fn arrays_are_what_the_stream_gives() {
        let model = Model::load(None).unwrap();
        let config = GnpStreamConfig { forces: 1, modes: 3, ..Stream::defaults() };
        let mut ours = Stream::new(&model, &config, &LINES, &[]).unwrap();
        let gnp = model.0.clone().explaining(true);
        let online = StreamConfig { k: 3, ..StreamConfig::default() };
        let mut theirs = gnp_online::Stream::new(&gnp, markings(&LINES).unwrap(), online).unwrap();
        for i in 0..=80 {
            let tracks: Vec<Tracked> = frame(i).iter().enumerate().map(|(i, it)| tracked(i, it).unwrap()).collect();
            let expected = theirs.push(0.04 * f64::from(i), &tracks).unwrap();
            let flat = ours.push(0.04 * f64::from(i), &frame(i)).unwrap();
            assert_eq!(flat.frame.paths(), expected.paths());
            assert_eq!((flat.forecasts, flat.vehicles.len()), (2, 2));
            for (it, other) in flat.vehicles.iter().zip(expected.vehicles()) {
                let position = [it.x, it.y];
                assert_eq!(
                    (it.id, position, it.forecast),
                    (other.id(), other.position(), other.window().unwrap() as i64)
                );
            }
            assert_eq!(flat.term_names.len(), expected.terms().len());
            assert!(!flat.term_names.is_empty());
        }
        assert_eq!(ours.vehicles[0].validity, GnpValidity::Full);
    }

    #[test]
    fn a_stream_that_met_a_defect_is_refused() {
        let mut stream = Stream::new(&Model::load(None).unwrap(), &Stream::defaults(), &LINES, &[]).unwrap();
        // What is wrong with the input breaks nothing.
        assert_eq!(guard(|| stream.push(f64::NAN, &[]).map(|_| ())), GnpStatus::Time);
        assert_eq!(guard(|| stream.push(0., &[]).map(|_| ())), GnpStatus::Ok);
        assert_eq!(guard(|| stream.whole(|_| panic!("half done"))), GnpStatus::Defect);
        assert!(matches!(stream.push(1., &[]), Err(Failure::Broken)));
        assert!(matches!(stream.reset(), Err(Failure::Broken)));
    }
}
