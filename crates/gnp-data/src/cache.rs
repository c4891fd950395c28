//! Recordings kept in one file: a JSON header and raw little-endian columns, under a checksum.
//!
//! ```text
//! magic "GNPREC\r\n" | version u32 | sha256 of the rest, 32 bytes | header length u64 | header JSON | columns
//! ```
//! All numbers are little-endian. The columns are x, y, vx, vy (f32), lane (i16), the eight
//! neighbours (u32) and, where the header says so, vehicle (u32) and headway (f32) of named leaders,
//! one after the other; a row takes 50 or 58 bytes, about half of its line of CSV.

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::path::Path;

use gnp_file::Seal;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::error::DataError;
use crate::recording::{Columns, LaneOrder, NamedLeader, Recording, RecordingMeta, Road, Track};
use crate::slot::SLOTS;

const MAGIC: &[u8; 8] = b"GNPREC\r\n";
const VERSION: u32 = 3;
/// Bytes before the header: magic, version, checksum, header length.
const PREFIX: usize = 8 + 4 + 32 + 8;
const ROW: usize = 4 * 4 + 2 + SLOTS * 4;
/// Bytes that a row with a named leader takes besides.
const LEADER: usize = 4 + 4;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    meta: RecordingMeta,
    roads: Vec<Road>,
    tracks: Vec<Track>,
    rows: usize,
    named_leaders: bool,
    lane_order: Option<LaneOrder>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    names: BTreeMap<u32, String>,
}

impl Recording {
    /// Writes the recording to `path`, under a temporary name first.
    ///
    /// # Errors
    /// [`DataError::Io`] when the folder cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), DataError> {
        let io = |source| DataError::Io { file: path.into(), source };
        let header = Header {
            meta: self.meta.clone(),
            roads: self.roads.clone(),
            tracks: self.tracks.clone(),
            rows: self.len(),
            named_leaders: self.columns.named_leader.is_some(),
            lane_order: self.lane_order.clone(),
            names: self.names.clone(),
        };
        let header = serde_json::to_vec(&header).map_err(|e| io(e.into()))?;
        let mut body = Vec::with_capacity(8 + header.len() + (ROW + LEADER) * self.len());
        body.extend_from_slice(&(header.len() as u64).to_le_bytes());
        body.extend_from_slice(&header);
        let c = &self.columns;
        for column in [&c.x, &c.y, &c.vx, &c.vy] {
            body.extend(column.iter().flat_map(|value| value.to_le_bytes()));
        }
        body.extend(c.lane.iter().flat_map(|value| value.to_le_bytes()));
        body.extend(c.neighbours.iter().flatten().flat_map(|value| value.to_le_bytes()));
        let leaders = || c.named_leader.iter().flatten();
        body.extend(leaders().flat_map(|leader| leader.vehicle.to_le_bytes()));
        body.extend(leaders().flat_map(|leader| leader.headway.to_le_bytes()));

        let mut file = gnp_file::beside(path).map_err(io)?;
        file.write_all(MAGIC).map_err(io)?;
        file.write_all(&VERSION.to_le_bytes()).map_err(io)?;
        file.write_all(&Sha256::digest(&body)).map_err(io)?;
        file.write_all(&body).map_err(io)?;
        file.persist(path).map_err(io)
    }

    /// Size of the file at `path` and the checksum that its head gives of the rest, which [`Recording::load`] compares: what
    /// tells one kept recording from another without reading it all.
    ///
    /// # Errors
    /// [`DataError::Io`] when the file cannot be read, [`DataError::Cache`] when it is foreign, of another version or
    /// has no whole head.
    pub fn seal(path: &Path) -> Result<Seal, DataError> {
        let io = |source| DataError::Io { file: path.into(), source };
        let file = std::fs::File::open(path).map_err(io)?;
        let bytes = file.metadata().map_err(io)?.len();
        let mut head = Vec::with_capacity(PREFIX);
        file.take(PREFIX as u64).read_to_end(&mut head).map_err(io)?;
        let sha256 = checksum(&head).map_err(|reason| DataError::Cache { file: path.into(), reason })?;
        Ok(Seal { bytes, sha256: sha256.iter().map(|byte| format!("{byte:02x}")).collect() })
    }

    /// Reads a recording that [`Recording::save`] wrote.
    ///
    /// # Errors
    /// [`DataError::Io`] when the file cannot be read, [`DataError::Cache`] when it is foreign, of
    /// another version, truncated or changed.
    pub fn load(path: &Path) -> Result<Self, DataError> {
        let bytes = std::fs::read(path).map_err(|source| DataError::Io { file: path.into(), source })?;
        parse(&bytes).map_err(|reason| DataError::Cache { file: path.into(), reason })
    }
}

/// The checksum of what follows, as the head says it.
fn checksum(bytes: &[u8]) -> Result<[u8; 32], String> {
    if bytes.get(..8) != Some(MAGIC.as_slice()) {
        return Err("not a recording kept by this program".into());
    }
    if bytes.len() < PREFIX {
        return Err("the file is truncated".into());
    }
    let version = u32::from_le_bytes(array(&bytes[8..]));
    if version != VERSION {
        return Err(format!("the file has format version {version}, this program reads {VERSION}"));
    }
    Ok(array(&bytes[12..]))
}

fn parse(bytes: &[u8]) -> Result<Recording, String> {
    let checksum = checksum(bytes)?;
    let body = &bytes[44..];
    if Sha256::digest(body).as_slice() != checksum {
        return Err("the checksum does not fit: the file is truncated or changed".into());
    }
    let length = u64::from_le_bytes(array(body)) as usize;
    let rest = &body[8..];
    let header = rest.get(..length).ok_or("the header is longer than the file")?;
    let header: Header = serde_json::from_slice(header).map_err(|e| format!("the header cannot be read: {e}"))?;
    let data = &rest[length..];
    let row = if header.named_leaders { ROW + LEADER } else { ROW };
    if header.rows.checked_mul(row) != Some(data.len()) {
        return Err(format!("{} bytes of columns do not make {} rows", data.len(), header.rows));
    }
    let rows = header.rows;
    let (floats, data) = data.split_at(rows * 16);
    let (lanes, data) = data.split_at(rows * 2);
    let (neighbours, leaders) = data.split_at(rows * SLOTS * 4);
    let (vehicles, headways) = leaders.split_at(leaders.len() / 2);
    let leader = |(vehicle, headway): (&[u8], &[u8])| NamedLeader {
        vehicle: u32::from_le_bytes(array(vehicle)),
        headway: f32::from_le_bytes(array(headway)),
    };
    let float =
        |i: usize| floats[i * rows * 4..(i + 1) * rows * 4].chunks_exact(4).map(|b| f32::from_le_bytes(array(b)));
    let columns = Columns {
        x: float(0).collect(),
        y: float(1).collect(),
        vx: float(2).collect(),
        vy: float(3).collect(),
        lane: lanes.chunks_exact(2).map(|b| i16::from_le_bytes(array(b))).collect(),
        neighbours: neighbours
            .chunks_exact(SLOTS * 4)
            .map(|row| std::array::from_fn(|slot| u32::from_le_bytes(array(&row[slot * 4..]))))
            .collect(),
        named_leader: header
            .named_leaders
            .then(|| vehicles.chunks_exact(4).zip(headways.chunks_exact(4)).map(leader).collect()),
    };
    let recording = Recording::from_parts(header.meta, header.roads, header.tracks, columns);
    recording
        .map(|it| Recording { lane_order: header.lane_order, ..it }.with_vehicle_names(header.names))
        .map_err(|e| e.to_string())
}

/// The first `N` bytes of a slice that is at least as long.
fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
    std::array::from_fn(|i| bytes[i])
}
