//! highD's layout: three tables a recording, metres, the upper-left corner of the box in an image whose y points down.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::{Written, frame, frames_since_zero, neighbour, renamed, to_file};
use crate::error::DataError;
use crate::lanes::lane_at;
use crate::limits::MAX_LANE_WIDTH;
use crate::recording::{Recording, Track, VehicleClass};
use crate::slot::Slot;

/// Width of the lane of a carriageway that only the layout demands, m, and how far it lies beside the other.
const MADE_UP: (f64, f64) = (3.75, 10.);

/// A recording on its way into the layout.
struct Layout<'a> {
    recording: &'a Recording,
    /// Index of the carriageway that drives towards smaller x, the upper one in the image, and of the other.
    roads: [Option<usize>; 2],
    /// What is added to frames.
    since: u32,
    /// y of the markings of each, m, downwards in the image, growing.
    markings: [Vec<f64>; 2],
}

/// Writes a recording as `NAME_tracks.csv`, `NAME_tracksMeta.csv` and `NAME_recordingMeta.csv`, where `to` ends with `NAME`.
///
/// # Errors
/// [`DataError::Unwritable`] without lane lines, with lanes wider than a lane can be or with carriageways that are not two of
/// opposite directions; when a file cannot be written.
pub(crate) fn write(recording: &Recording, to: &Path) -> Result<Written, DataError> {
    let layout = Layout::of(recording)?;
    let place = |table: &str| -> PathBuf {
        let name = to.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        to.with_file_name(format!("{name}_{table}.csv"))
    };
    let files = vec![place("tracks"), place("tracksMeta"), place("recordingMeta")];
    to_file(&files[0], |out| layout.tracks(out))?;
    to_file(&files[1], |out| layout.vehicles(out))?;
    to_file(&files[2], |out| layout.recording(out))?;
    let tracks = recording.tracks();
    let vehicles = tracks.chunk_by(|a, b| a.vehicle == b.vehicle).count();
    let mut written = Written { files, rows: recording.len() as u64, vehicles: vehicles as u64, ..Written::default() };
    written.lose("names of vehicles become numbers", renamed(recording));
    let start = frames_since_zero(recording).is_none();
    written.lose("times become frames: that of frame 0 is not in the layout", usize::from(start));
    let bent = recording.roads().iter().filter(|road| road.axis.as_ref().is_some_and(|axis| axis.length().is_finite()));
    written.lose("curved carriageways are straightened: x is the distance along them", bent.count());
    let made_up = layout.roads.iter().filter(|road| road.is_none()).count();
    written.lose("carriageways are added without vehicles: the layout has two", made_up);
    Ok(written)
}

impl<'a> Layout<'a> {
    fn of(recording: &'a Recording) -> Result<Self, DataError> {
        let fail = |reason: String| {
            let recording = recording.meta().name.clone();
            DataError::Unwritable { recording, layout: "highD".to_owned(), reason }
        };
        let used = |road: &usize| recording.tracks().iter().any(|track| usize::from(track.road) == *road);
        let mut roads = [None; 2];
        for road in (0..recording.roads().len()).filter(used) {
            let place = &mut roads[usize::from(recording.roads()[road].driving_direction != 1)];
            if place.is_some() {
                return Err(fail("it has two carriageways of one direction; write plain tracks instead".into()));
            }
            *place = Some(road);
        }
        let since = frames_since_zero(recording).unwrap_or(0);
        let mut layout = Self { recording, roads, since, markings: Default::default() };
        for (side, road) in roads.iter().enumerate() {
            let Some(road) = road else { continue };
            let lines = &recording.roads()[*road].lines;
            if lines.len() < 2 {
                return Err(fail("it has no lane lines; give them, or write plain tracks instead".into()));
            }
            if lines.windows(2).any(|pair| pair[1].y - pair[0].y > MAX_LANE_WIDTH) {
                return Err(fail(format!(
                    "a lane is wider than {MAX_LANE_WIDTH} m; give its lines, or write plain tracks"
                )));
            }
            let down = |y: f32| -f64::from(y) * if side == 0 { -1. } else { 1. };
            layout.markings[side] = lines.iter().map(|line| down(line.y)).collect();
            layout.markings[side].sort_by(f64::total_cmp);
        }
        let (width, apart) = MADE_UP;
        match &mut layout.markings {
            [upper, lower] if upper.is_empty() => {
                let below = lower.first().copied().unwrap_or(0.) - apart;
                *upper = vec![below - width, below];
            }
            [upper, lower] if lower.is_empty() => {
                let above = upper.last().copied().unwrap_or(0.) + apart;
                *lower = vec![above, above + width];
            }
            [upper, lower] if upper.last() > lower.first() => {
                return Err(fail("its carriageways overlap or drive on the left; write plain tracks instead".into()));
            }
            _ => {}
        }
        Ok(layout)
    }

    /// Side of a track's carriageway: 0 the upper.
    fn side(&self, track: &Track) -> usize {
        usize::from(self.roads[0] != Some(usize::from(track.road)))
    }

    /// Number of the lane of a row: from 2 downwards in the image, as highD has them.
    fn lane(&self, track: &Track, y: f32) -> usize {
        let road = &self.recording.roads()[usize::from(track.road)];
        let lanes = road.lines.len() - 1;
        let from_left = match lane_at(&road.lines, y) {
            // Beside the road: the nearest.
            0 if road.lines.last().is_some_and(|left| y >= left.y) => 1,
            0 => lanes,
            lane => usize::from(lane.cast_unsigned()),
        };
        match self.side(track) {
            0 => 2 + lanes - from_left,
            _ => 2 + self.markings[0].len() + from_left - 1,
        }
    }

    fn tracks(&self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(
            out,
            "frame,id,x,y,width,height,xVelocity,yVelocity,precedingId,followingId,leftPrecedingId,leftAlongsideId,\
             leftFollowingId,rightPrecedingId,rightAlongsideId,rightFollowingId,laneId"
        )?;
        let c = self.recording.columns();
        for track in self.recording.tracks() {
            // The upper carriageway is rotated by pi in the road frame; in the image y points down.
            let (along, down) = if self.side(track) == 0 { (-1., 1.) } else { (1., -1.) };
            let [length, width] = [f64::from(track.length), f64::from(track.width)];
            for row in track.rows.clone() {
                let (x, y) = (along * f64::from(c.x[row]), down * f64::from(c.y[row]));
                write!(
                    out,
                    "{},{},{:.3},{:.3},{length:.3},{width:.3},{:.3},{:.3}",
                    self.since + frame(track, row),
                    track.vehicle,
                    x - length / 2.,
                    y - width / 2.,
                    along * f64::from(c.vx[row]),
                    down * f64::from(c.vy[row]),
                )?;
                for slot in Slot::ALL {
                    write!(out, ",{}", neighbour(self.recording, row, slot))?;
                }
                writeln!(out, ",{}", self.lane(track, c.y[row]))?;
            }
        }
        Ok(())
    }

    fn vehicles(&self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection")?;
        for runs in self.recording.tracks().chunk_by(|a, b| a.vehicle == b.vehicle) {
            let (Some(first), Some(last)) = (runs.first(), runs.last()) else { continue };
            let class = match first.class {
                VehicleClass::Car => "Car",
                VehicleClass::Truck => "Truck",
                VehicleClass::Motorcycle => "Motorcycle",
            };
            writeln!(
                out,
                "{},{:.3},{:.3},{},{},{},{class},{}",
                first.vehicle,
                first.length,
                first.width,
                self.since + first.first_frame,
                self.since + last.last_frame(),
                runs.iter().map(|track| track.rows.len()).sum::<usize>(),
                self.side(first) + 1,
            )?;
        }
        Ok(())
    }

    fn recording(&self, out: &mut dyn Write) -> io::Result<()> {
        let meta = self.recording.meta();
        let mut classes: BTreeMap<VehicleClass, usize> = BTreeMap::new();
        for runs in self.recording.tracks().chunk_by(|a, b| a.vehicle == b.vehicle) {
            *classes.entry(runs[0].class).or_default() += 1;
        }
        let count = |class: VehicleClass| classes.get(&class).copied().unwrap_or(0);
        let vehicles: usize = classes.values().sum();
        let markings = |side: usize| -> String {
            self.markings[side].iter().map(|y| format!("{y:.3}")).collect::<Vec<_>>().join(";")
        };
        let first = self.recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
        let last = self.recording.tracks().iter().map(Track::last_frame).max().unwrap_or(0);
        let site = meta.site.strip_prefix("highd-").unwrap_or(&meta.site).replace([',', '"', ';'], " ");
        writeln!(
            out,
            "frameRate,locationId,duration,numVehicles,numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings"
        )?;
        writeln!(
            out,
            "{},{site},{:.2},{vehicles},{},{},{},{}",
            meta.rate_hz,
            f64::from(last - first + 1) / meta.rate_hz,
            count(VehicleClass::Car),
            count(VehicleClass::Truck),
            markings(0),
            markings(1),
        )
    }
}
