//! The recordings that are served: which there are, and who drove where.

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{MarkingKind, Recording, WindowShape};
use gnp_plot::class_name;
use serde::{Deserialize, Serialize};

use crate::error::ServerError;
use crate::problem::{Problem, ProblemKind};

/// Frames shown a second, at most.
const SHOWN_HZ: f64 = 12.5;
/// Longest span of tracks that is given at once, s.
const LONGEST_S: f64 = 120.;

/// The recordings that are served, by name.
#[derive(Debug)]
pub(crate) struct Recordings {
    all: Vec<Recording>,
    by_name: BTreeMap<String, usize>,
    /// What is said of them: it does not change.
    pub(crate) listed: Listed,
}

/// `GET /v1/recordings`
#[derive(Debug, Serialize)]
pub(crate) struct Listed {
    recordings: Vec<Described>,
}

#[derive(Debug, Serialize)]
struct Described {
    name: String,
    site: String,
    simulated: bool,
    rate_hz: f64,
    from_s: f64,
    to_s: f64,
    vehicles: usize,
    roads: Vec<DescribedRoad>,
}

#[derive(Debug, Serialize)]
struct DescribedRoad {
    index: usize,
    driving_direction: u8,
    lines: Vec<DescribedLine>,
    /// From the first to the last place where somebody was, m.
    x: [f64; 2],
}

#[derive(Debug, Serialize)]
struct DescribedLine {
    y: f64,
    kind: &'static str,
}

impl Recordings {
    /// # Errors
    /// Two of one name; one whose rate is not that of the model's windows or a whole multiple of it.
    pub(crate) fn new(all: Vec<Recording>, shape: WindowShape) -> Result<Self, ServerError> {
        let mut by_name = BTreeMap::new();
        for (i, recording) in all.iter().enumerate() {
            let meta = recording.meta();
            if shape.at_rate(meta.rate_hz).is_none() {
                let (recording, found_hz, model_hz) = (meta.name.clone(), meta.rate_hz, shape.rate_hz);
                return Err(ServerError::Rate { recording, found_hz, model_hz });
            }
            if by_name.insert(meta.name.clone(), i).is_some() {
                return Err(ServerError::SameName { name: meta.name.clone() });
            }
        }
        let listed = Listed { recordings: by_name.values().map(|i| described(&all[*i])).collect() };
        Ok(Self { all, by_name, listed })
    }

    /// The recording of a number that [`Recordings::named`] gave.
    ///
    /// # Errors
    /// [`ProblemKind::Internal`] for another one.
    pub(crate) fn number(&self, number: usize) -> Result<&Recording, Problem> {
        self.all.get(number).ok_or_else(|| Problem::new(ProblemKind::Internal, "a recording has gone"))
    }

    /// The recording of that name, and its number; `field` is where the request names it.
    ///
    /// # Errors
    /// [`ProblemKind::UnknownRecording`], with some names that there are.
    pub(crate) fn named(&self, name: &str, field: &str) -> Result<(usize, &Recording), Problem> {
        let found = self.by_name.get(name).and_then(|i| Some((*i, self.all.get(*i)?)));
        found.ok_or_else(|| {
            let some: Vec<&str> = self.by_name.keys().take(20).map(String::as_str).collect();
            let more = if self.by_name.len() > some.len() { " and others" } else { "" };
            let detail = if some.is_empty() {
                "no recordings are served".to_owned()
            } else {
                format!("there is no such recording; there are {}{more}", some.join(", "))
            };
            Problem::at(ProblemKind::UnknownRecording, field, detail)
        })
    }
}

/// First and last frame in which somebody is there.
pub(crate) fn ends(recording: &Recording) -> [u32; 2] {
    let tracks = recording.tracks();
    let first = tracks.iter().map(|track| track.first_frame).min().unwrap_or(0);
    let last = tracks.iter().map(gnp_data::Track::last_frame).max().unwrap_or(0);
    [first, last]
}

/// `boundary` or `divider`.
pub(crate) fn line_kind(kind: MarkingKind) -> &'static str {
    match kind {
        MarkingKind::Boundary => "boundary",
        MarkingKind::LaneDivider => "divider",
    }
}

/// To whole cm.
pub(crate) fn centimetres(metres: f32) -> f64 {
    (f64::from(metres) * 100.).round() / 100.
}

fn described(recording: &Recording) -> Described {
    let (meta, [first, last]) = (recording.meta(), ends(recording));
    let vehicles: BTreeSet<u32> = recording.tracks().iter().map(|track| track.vehicle).collect();
    let road = |(index, road): (usize, &gnp_data::Road)| {
        let rows = recording.tracks().iter().filter(|track| usize::from(track.road) == index);
        let places = rows.flat_map(|track| &recording.columns().x[track.rows.clone()]);
        let ends = places.fold([f32::INFINITY, f32::NEG_INFINITY], |[from, to], x| [from.min(*x), to.max(*x)]);
        let lines = road.lines.iter().map(|line| DescribedLine { y: centimetres(line.y), kind: line_kind(line.kind) });
        DescribedRoad {
            index,
            driving_direction: road.driving_direction,
            lines: lines.collect(),
            x: if ends[0] <= ends[1] { ends.map(centimetres) } else { [0.; 2] },
        }
    };
    Described {
        name: meta.name.clone(),
        site: meta.site.clone(),
        simulated: meta.simulated,
        rate_hz: meta.rate_hz,
        from_s: meta.time_s(first),
        to_s: meta.time_s(last),
        vehicles: vehicles.len(),
        roads: recording.roads().iter().enumerate().map(road).collect(),
    }
}

/// The query of `GET /v1/recordings/{name}/tracks`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Span {
    #[serde(default)]
    road: usize,
    from_s: Option<f64>,
    to_s: Option<f64>,
}

/// Tracks over a span of time, in shown frames.
#[derive(Debug, Serialize)]
pub(crate) struct Shown {
    rate_hz: f64,
    from_s: f64,
    frames: usize,
    vehicles: Vec<ShownVehicle>,
}

/// Where a vehicle is in consecutive shown frames from number `first` on, in whole cm: the first place, then differences.
#[derive(Debug, Serialize)]
struct ShownVehicle {
    id: String,
    class: &'static str,
    size: [f64; 2],
    first: usize,
    x: Vec<i32>,
    y: Vec<i32>,
}

impl Shown {
    /// # Errors
    /// A problem for a road that is not there and for a span that is none, longer than [`LONGEST_S`], or not recorded.
    pub(crate) fn of(recording: &Recording, span: Span) -> Result<Self, Problem> {
        let (meta, [first, last]) = (recording.meta(), ends(recording));
        let wrong = |field: &str, detail: String| Problem::at(ProblemKind::InvalidRequest, field, detail);
        road_is_there(recording, span.road, "road")?;
        let from_s = span.from_s.unwrap_or_else(|| meta.time_s(first));
        let to_s = span.to_s.unwrap_or_else(|| meta.time_s(last).min(from_s + LONGEST_S));
        // Not finite ones among them.
        if !(to_s - from_s >= 0. && to_s - from_s <= LONGEST_S + 1e-6) {
            let detail = format!("give from 0 to {LONGEST_S} s after from_s, which is {from_s}");
            return Err(wrong("to_s", detail));
        }
        if to_s < meta.time_s(first) || from_s > meta.time_s(last) {
            let detail = format!("the recording goes from {} to {} s", meta.time_s(first), meta.time_s(last));
            return Err(Problem::at(ProblemKind::OutsideRecording, "from_s", detail));
        }
        let step = (meta.rate_hz / SHOWN_HZ).ceil().max(1.);
        // Counted from the recording's first frame, so that spans that meet show the same frames.
        let shown = |time_s: f64| (time_s - meta.time_s(first)) * meta.rate_hz / step;
        let most = f64::from(last - first) / step;
        let [begin, end] = [(shown(from_s) - 1e-6).ceil(), (shown(to_s) + 1e-6).floor()].map(|it| it.clamp(0., most));
        let frame = |number: f64| first + (number.floor() * step) as u32;
        let frames = if end >= begin { (end.floor() - begin) as usize + 1 } else { 0 };
        let tracks = recording.tracks().iter().filter(|track| usize::from(track.road) == span.road);
        let vehicles = tracks.filter_map(|track| {
            let row = |number: usize| Some((number, track.row_at(frame(begin + number as f64))?));
            let rows: Vec<(usize, usize)> = (0..frames).filter_map(row).collect();
            let places = |column: &[f32]| differences(rows.iter().map(|(_, row)| (column[*row] * 100.).round() as i32));
            Some(ShownVehicle {
                id: recording.vehicle_name(track.vehicle).into_owned(),
                class: class_name(track.class),
                size: [track.length, track.width].map(centimetres),
                first: rows.first()?.0,
                x: places(&recording.columns().x),
                y: places(&recording.columns().y),
            })
        });
        Ok(Self {
            rate_hz: meta.rate_hz / step,
            from_s: meta.time_s(frame(begin)),
            frames,
            vehicles: vehicles.collect(),
        })
    }
}

/// # Errors
/// A problem in `field` where the recording has no such carriageway.
pub(crate) fn road_is_there(recording: &Recording, road: usize, field: &str) -> Result<(), Problem> {
    let roads = recording.roads().len();
    if road < roads {
        return Ok(());
    }
    let detail = format!("the recording has {roads} carriageways, counted from 0");
    Err(Problem::at(ProblemKind::InvalidRequest, field, detail))
}

/// The first value, then differences.
fn differences(values: impl Iterator<Item = i32>) -> Vec<i32> {
    let mut last = 0;
    values.map(|value| value - std::mem::replace(&mut last, value)).collect()
}
