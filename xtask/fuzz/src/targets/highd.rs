//! Recordings of highD: made-up traffic on two carriageways, and any three texts.

use arbitrary::{Arbitrary, Unstructured};
use gnp_data::Dataset;

use super::table_text::reads;
use crate::made::{Rarely, kind};
use crate::table::{Style, pack};
use crate::{Finding, Scratch, Target};

pub(super) const TARGET: Target = Target {
    name: "highd",
    about: "the three tables of a highD recording, to a recording and forecasts",
    run,
    seeds,
    words: &[
        "xVelocity",
        "precedingId",
        "laneId",
        "drivingDirection",
        "upperLaneMarkings",
        "frameRate",
        "Truck",
        "0.50;4.00",
    ],
};

/// What parts the three texts of an input.
const BETWEEN: &[u8] = b"---\n";

/// Names of the files, in the order of the format.
const FILES: [&str; 3] = ["case_tracks.csv", "case_tracksMeta.csv", "case_recordingMeta.csv"];

const TRACKS: [&str; 25] = [
    "frame",
    "id",
    "x",
    "y",
    "width",
    "height",
    "xVelocity",
    "yVelocity",
    "xAcceleration",
    "yAcceleration",
    "frontSightDistance",
    "backSightDistance",
    "dhw",
    "thw",
    "ttc",
    "precedingXVelocity",
    "precedingId",
    "followingId",
    "leftPrecedingId",
    "leftAlongsideId",
    "leftFollowingId",
    "rightPrecedingId",
    "rightAlongsideId",
    "rightFollowingId",
    "laneId",
];

const TRACKS_META: [&str; 16] = [
    "id",
    "width",
    "height",
    "initialFrame",
    "finalFrame",
    "numFrames",
    "class",
    "drivingDirection",
    "traveledDistance",
    "minXVelocity",
    "maxXVelocity",
    "meanXVelocity",
    "minDHW",
    "minTHW",
    "minTTC",
    "numLaneChanges",
];

const RECORDING_META: [&str; 15] = [
    "id",
    "frameRate",
    "locationId",
    "speedLimit",
    "month",
    "weekDay",
    "startTime",
    "duration",
    "totalDrivenDistance",
    "totalDrivenTime",
    "numVehicles",
    "numCars",
    "numTrucks",
    "upperLaneMarkings",
    "lowerLaneMarkings",
];

const CLASSES: [&str; 6] = ["Car", "Truck", "Van", "Bus", "Motorcycle", "Tram"];

/// A recording, and how its tables are written.
#[derive(Arbitrary, Clone, Debug, Default)]
struct Case {
    count: u8,
    vehicles: [Vehicle; 4],
    rate_hz: Rarely<f32>,
    markings: Rarely<[Vec<i8>; 2]>,
    styles: [Style; 3],
    absent: Rarely<u8>,
    repeated: Rarely<u8>,
}

/// A vehicle that keeps its lane: of the four, two on each carriageway.
#[derive(Arbitrary, Clone, Copy, Debug, Default)]
struct Vehicle {
    id: Rarely<u8>,
    first_frame: u8,
    frames: u8,
    from: u8,
    /// m a second.
    speed: u8,
    class: u8,
    direction: Rarely<u8>,
    lane: Rarely<u8>,
    gap: Rarely<u8>,
    named: Rarely<[i8; 8]>,
    size: Rarely<[i8; 2]>,
}

impl Case {
    fn tables(&self) -> [(&'static [&'static str], Vec<Vec<String>>); 3] {
        let count = 1 + usize::from(self.count) % self.vehicles.len();
        let vehicles = || self.vehicles[..count].iter().enumerate();
        let tracks = vehicles().flat_map(|(index, vehicle)| vehicle.rows(index)).collect();
        let mut bodies: Vec<Vec<String>> = vehicles().map(|(index, vehicle)| vehicle.body(index)).collect();
        if let Some(which) = self.repeated.0 {
            bodies.push(bodies[usize::from(which) % bodies.len()].clone());
        }
        [(&TRACKS, tracks), (&TRACKS_META, bodies), (&RECORDING_META, vec![self.meta(count)])]
    }

    fn meta(&self, vehicles: usize) -> Vec<String> {
        let marked = |given: &[i8]| given.iter().map(|at| format!("{:.2}", f32::from(*at) / 4.)).collect::<Vec<_>>();
        let markings = match &self.markings.0 {
            Some(given) => [marked(&given[0]).join(";"), marked(&given[1]).join(";")],
            None => ["0.50;4.00;7.50".to_owned(), "18.00;22.00;26.00".to_owned()],
        };
        let rate = self.rate_hz.or(25.);
        let [upper, lower] = markings;
        cells(&format!("1,{rate},4,-1.0,9.2017,Tue,08:38,90.0,1,1,{vehicles},3,1,{upper},{lower}"))
    }
}

impl Vehicle {
    fn id(&self, index: usize) -> u32 {
        self.id.0.map_or(index as u32 + 1, u32::from)
    }

    fn frames(&self) -> std::ops::Range<u32> {
        let first = u32::from(self.first_frame % 8);
        1 + first..2 + first + u32::from(self.frames) % 20
    }

    /// Length and width, m.
    fn size(&self) -> [f32; 2] {
        self.size.0.map_or([5., 2.], |size| size.map(|side| f32::from(side) / 4.))
    }

    /// Upwards in the image, and so to the left, on the upper carriageway.
    fn upper(index: usize) -> bool {
        index < 2
    }

    fn rows(&self, index: usize) -> Vec<Vec<String>> {
        let id = self.id(index);
        let (sign, lane) = if Self::upper(index) { (-1., 1 + index as u32) } else { (1., 3 + index as u32) };
        let y = [1., 4.5, 19., 23.][index % 4];
        let lane = self.lane.0.map_or(lane, u32::from);
        let speed = 5. + f32::from(self.speed % 50);
        let [length, width] = self.size();
        let named = self.named.0.unwrap_or_default().map(|id| id.to_string()).join(",");
        let row = |frame: u32| {
            let x = 100. + f32::from(self.from) + sign * speed / 25. * frame as f32;
            let velocity = sign * speed;
            cells(&format!(
                "{frame},{id},{x:.2},{y:.2},{length:.2},{width:.2},{velocity:.2},0,0,0,0,0,0,0,0,0,{named},{lane}"
            ))
        };
        let gone = self.gap.0.map(|gap| u32::from(gap % 24));
        self.frames().filter(|frame| Some(*frame) != gone).map(row).collect()
    }

    fn body(&self, index: usize) -> Vec<String> {
        let ([length, width], frames) = (self.size(), self.frames());
        let class = CLASSES[usize::from(self.class) % CLASSES.len()];
        let direction = self.direction.or(if Self::upper(index) { 1 } else { 2 });
        let (first, last) = (frames.start, frames.end - 1);
        let count = frames.len();
        let id = self.id(index);
        cells(&format!("{id},{length:.2},{width:.2},{first},{last},{count},{class},{direction},9,25,25,25,0,0,0,0"))
    }
}

fn cells(line: &str) -> Vec<String> {
    line.split(',').map(str::to_owned).collect()
}

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    if matches!(kind, b'a' | b'z') {
        for (name, text) in FILES.iter().zip(texts(rest)) {
            files.push(if kind == b'z' {
                (format!("{name}.gz"), pack(text)?)
            } else {
                ((*name).to_owned(), text.to_vec())
            });
        }
    } else {
        let Ok(case) = Case::arbitrary(&mut Unstructured::new(rest)) else { return Ok(()) };
        for ((name, (header, lines)), style) in FILES.iter().zip(case.tables()).zip(&case.styles) {
            files.push(style.write(name, header, &lines)?);
        }
        if let Some(absent) = case.absent.0 {
            files.remove(usize::from(absent) % files.len());
        }
    }
    let files: Vec<(&str, &[u8])> = files.iter().map(|(name, content)| (name.as_str(), &content[..])).collect();
    scratch.put(&files)?;
    reads(scratch, scratch.given(), Dataset::HIGHD)
}

/// Three texts, of which the last may be missing.
fn texts(mut all: &[u8]) -> Vec<&[u8]> {
    let mut parts = Vec::new();
    while parts.len() < 2 {
        let Some(at) = all.windows(BETWEEN.len()).position(|part| part == BETWEEN) else { break };
        parts.push(&all[..at]);
        all = &all[at + BETWEEN.len()..];
    }
    parts.push(all);
    parts
}

fn seeds(_: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let vehicle = Vehicle { frames: 7, speed: 20, ..Vehicle::default() };
    let vehicles = [0, 30, 60, 90].map(|from| Vehicle { from, ..vehicle });
    let case = Case { count: 3, vehicles, ..Case::default() };
    let texts = case.tables().into_iter().map(|(header, lines)| Style::default().write("", header, &lines));
    let texts: Vec<Vec<u8>> = texts.map(|written| written.map(|(_, text)| text)).collect::<Result<_, _>>()?;
    let joined = texts.join(BETWEEN);
    Ok(vec![[b"a", &joined[..]].concat(), [b"z", &joined[..]].concat()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::table_text::read_all;

    /// Changes of these get past the checks: each is read, with so many vehicles.
    #[test]
    fn accepted_inputs_are_accepted() {
        let scratch = Scratch::new().unwrap();
        for (name, vehicles) in [
            ("lane-change", 2),
            ("two-carriageways", 4),
            ("eleven-vehicles", 11),
            ("eleven-vehicles-one-left-out", 10),
            ("eleven-vehicles-one-with-a-gap", 11),
            ("without-frames-in-meta", 2),
        ] {
            let input = std::fs::read(TARGET.folder().join(name)).unwrap();
            let files: Vec<_> = FILES.into_iter().zip(texts(&input[1..])).collect();
            scratch.put(&files).unwrap();
            let read = read_all(scratch.given(), Dataset::HIGHD).unwrap();
            let mut found: Vec<u32> = read[0].0.tracks().iter().map(|track| track.vehicle).collect();
            found.dedup();
            assert_eq!((read.len(), found.len()), (1, vehicles), "{name}");
        }
    }
}
