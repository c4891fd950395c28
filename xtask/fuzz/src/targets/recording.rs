//! Files of recordings (`.rec`): any bytes, any body under a right checksum, a changed header, made-up parts.

use arbitrary::{Arbitrary, Unstructured};
use gnp_data::{
    Columns, DataError, Dataset, LaneMarking, NamedLeader, Recording, RecordingMeta, Road, SLOTS, Track, VehicleClass,
    VelocitySource,
};
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use crate::made::{Number, Rarely, kind, road};
use crate::patch::{self, Patch};
use crate::{Finding, Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "recording",
    about: "files of recordings, and recordings of made-up parts",
    run,
    seeds,
    words: &[
        "GNPREC",
        "\"rows\":",
        "\"tracks\":",
        "\"first_frame\":4294967290",
        "\"named_leaders\":true",
        "\"lane_order\":null",
    ],
};

/// Magic and version; then comes the checksum of what follows it.
const BEGINNING: usize = 12;
const CHECKSUM: usize = 32;

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    match kind {
        b'a' => load(scratch, rest),
        b'c' => load(scratch, &with_checksum(&saved(scratch)?, rest)),
        b'h' => {
            let end = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
            let columns = rest.get(end + 1..).unwrap_or_default();
            load(scratch, &with_header(&saved(scratch)?, &rest[..end], columns))
        }
        _ if kind.is_multiple_of(2) => patched(scratch, rest),
        _ => parts(scratch, rest),
    }
}

/// A small recording as a file.
fn saved(scratch: &Scratch) -> Result<Vec<u8>, Finding> {
    let file = scratch.made("seed.rec");
    if !file.exists() {
        road("case")?.save(&file).map_err(Finding::case)?;
    }
    Ok(std::fs::read(file)?)
}

fn with_checksum(saved: &[u8], body: &[u8]) -> Vec<u8> {
    let beginning = &saved[..BEGINNING.min(saved.len())];
    [beginning, &Sha256::digest(body), body].concat()
}

fn with_header(saved: &[u8], header: &[u8], columns: &[u8]) -> Vec<u8> {
    let length = (header.len() as u64).to_le_bytes();
    with_checksum(saved, &[&length, header, columns].concat())
}

/// Header and columns of a file.
fn header_and_columns(saved: &[u8]) -> Option<(&[u8], &[u8])> {
    let body = saved.get(BEGINNING + CHECKSUM..)?;
    let length = u64::from_le_bytes(body.get(..8)?.try_into().ok()?);
    body[8..].split_at_checked(usize::try_from(length).ok()?)
}

fn load(scratch: &Scratch, bytes: &[u8]) -> Result<(), Finding> {
    let file = scratch.only("case.rec", bytes)?;
    match Recording::load(&file) {
        Ok(recording) => checks::recording(scratch, &recording),
        Err(error) => checks::refusal(&error, "case.rec"),
    }
}

/// A changed header and changed columns.
fn patched(scratch: &Scratch, bytes: &[u8]) -> Result<(), Finding> {
    let saved = saved(scratch)?;
    let Some((header, columns)) = header_and_columns(&saved) else {
        return Err(Finding::Case("the layout of recordings is another".to_owned()));
    };
    let mut header: Value = serde_json::from_slice(header).map_err(Finding::case)?;
    let mut columns = columns.to_vec();
    let mut bytes = Unstructured::new(bytes);
    let Ok((patches, spots)) = bytes.arbitrary::<(Vec<Patch>, Vec<(u16, [u8; 4])>)>() else { return Ok(()) };
    patch::apply(&mut header, &patches);
    for (at, value) in spots {
        let at = 4 * usize::from(at) % columns.len().max(4);
        if let Some(place) = columns.get_mut(at..at + 4) {
            place.copy_from_slice(&value);
        }
    }
    load(scratch, &with_header(&saved, header.to_string().as_bytes(), &columns))
}

/// A recording.
#[derive(Arbitrary, Debug)]
struct Made {
    rate_hz: Rarely<f64>,
    recorded: bool,
    lines: Rarely<Vec<Number>>,
    tracks: Vec<MadeTrack>,
    leaders: Rarely<[u8; 2]>,
    short: Rarely<u8>,
}

#[derive(Arbitrary, Debug)]
struct MadeTrack {
    vehicle: Rarely<u32>,
    segment: Rarely<u16>,
    road: Rarely<u16>,
    size: Rarely<[f32; 2]>,
    first_frame: Rarely<u32>,
    rows: u8,
    from: Number,
    step: Number,
    off: Rarely<[u8; 2]>,
    neighbour: Rarely<u8>,
    odd: Rarely<(u8, Number)>,
}

fn parts(scratch: &Scratch, bytes: &[u8]) -> Result<(), Finding> {
    let Ok(made) = Made::arbitrary(&mut Unstructured::new(bytes)) else { return Ok(()) };
    let source = if made.recorded { VelocitySource::Recorded } else { VelocitySource::Derived };
    let meta = RecordingMeta::new(Dataset::NGSIM, "us-101", "case", made.rate_hz.or(10.)).with_velocities(source);
    let lines = match &made.lines.0 {
        Some(lines) => lines.iter().map(|y| LaneMarking::new(y.0, false)).collect(),
        None => vec![LaneMarking::new(0., true), LaneMarking::new(3.5, true)],
    };
    let roads = vec![Road { driving_direction: 2, lines, fitted: true, axis: None }];
    let (tracks, mut columns) = rows(&made);
    if let Some([vehicle, headway]) = made.leaders.0 {
        let named = NamedLeader { vehicle: u32::from(vehicle), headway: f32::from(headway) };
        columns.named_leader = Some(vec![named; columns.x.len()]);
    }
    match made.short.0 {
        Some(0..=63) => drop(columns.y.pop()),
        Some(64..=127) => drop(columns.lane.pop()),
        Some(128..=191) => drop(columns.neighbours.pop()),
        Some(_) => columns.x.push(1.),
        None => {}
    }
    match Recording::from_parts(meta, roads, tracks, columns) {
        Ok(recording) => checks::recording(scratch, &recording),
        Err(error @ DataError::Parts { .. }) => checks::refusal(&error, "case"),
        Err(error) => Err(Finding::Believed(format!("another error than of parts: {error}"))),
    }
}

fn rows(made: &Made) -> (Vec<Track>, Columns) {
    let (mut tracks, mut columns) = (Vec::new(), Columns::default());
    for (index, track) in made.tracks.iter().enumerate() {
        let start = columns.x.len();
        let count = usize::from(track.rows % 16);
        for i in 0..count {
            columns.x.push(track.from.0 + track.step.0 / 16. * i as f32);
            columns.y.push(1.7);
            columns.vx.push(track.step.0);
            columns.vy.push(0.);
            columns.lane.push(1);
            let mut slots = [u32::MAX; SLOTS];
            slots[i % SLOTS] = track.neighbour.0.map_or(u32::MAX, u32::from);
            columns.neighbours.push(slots);
        }
        if let (Some((at, value)), 1..) = (track.odd.0, count) {
            let of = [&mut columns.x, &mut columns.y, &mut columns.vx, &mut columns.vy];
            of.into_iter().nth(usize::from(at) % 4).into_iter().for_each(|column| {
                column[start + usize::from(at) % count] = value.0;
            });
        }
        let [before, after] = track.off.0.unwrap_or_default().map(usize::from);
        let rows = start + before..columns.x.len() + after;
        let vehicle = track.vehicle.or(index as u32 + 1);
        let mut made = Track::new(vehicle, track.size.or([4.5, 1.8]), track.first_frame.or(7), rows);
        made.segment = track.segment.or(0);
        made.road = track.road.or(0);
        made.class = VehicleClass::Truck;
        tracks.push(made);
    }
    (tracks, columns)
}

/// Whole, from its checksum on, and as header and columns.
fn seeds(scratch: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let saved = saved(scratch)?;
    let missing = || Finding::Case("the layout of recordings is another".to_owned());
    let (header, columns) = header_and_columns(&saved).ok_or_else(missing)?;
    let body = &saved[BEGINNING + CHECKSUM..];
    Ok(vec![[b"a", &saved[..]].concat(), [b"c", body].concat(), [b"h", header, b"\n", columns].concat()])
}
