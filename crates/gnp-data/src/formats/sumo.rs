//! Floating car data of SUMO: XML, or tables of text or Parquet with the same columns; metres, the middle of the front
//! bumper, angles clockwise from north. The centre lies half a length behind.

use std::collections::{BTreeMap, HashMap};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use self::vehicle::{Kind, Other, Types, Vehicle};
use super::table::gzip::head;
use super::table::sniff::Head;
use crate::dataset::Dataset;
use crate::discover::FoundFiles;
use crate::error::{DataError, TrackProblem};
use crate::format::{Format, Source};
use crate::ingest_report::IngestReport;
use crate::recording::Recording;
use crate::schema::{Column, Schema, TableSchema};
use crate::track_options::TrackOptions;
use crate::track_table::{LaneNumbers, RowPlaces, TableVehicle, TrackTable};
use crate::tracks::{TrackFile, Tracks, whole};
use crate::write::fcd::RECORDED;
use crate::write::{self, Written};

mod csv;
mod parquet;
mod vehicle;
mod xml;

/// The format.
pub(super) struct Sumo;

/// Columns that are described.
const READ: [Column; 8] = [
    Column::new("timestep_time", "s", "time; also as hours:minutes:seconds"),
    Column::new("vehicle_id", "-", "name of the vehicle"),
    Column::new("vehicle_x", "m", "middle of the front bumper, to the east"),
    Column::new("vehicle_y", "m", "middle of the front bumper, to the north"),
    Column::new("vehicle_angle", "degrees", "direction of the vehicle, clockwise from north"),
    Column::new("vehicle_speed", "m/s", "speed, where the file has it"),
    Column::new(
        "vehicle_type",
        "-",
        "type: its vType, where a file beside has it, tells class and size; else its name does",
    ),
    Column::new("vehicle_lane", "-", "EDGE_INDEX, 0 the rightmost, where the file has it"),
];

/// Most bytes of a file beside that are searched for vehicle types.
const TYPES_WITHIN: usize = 1 << 16;

impl Format for Sumo {
    fn dataset(&self) -> Dataset {
        Dataset::SUMO
    }

    fn title(&self) -> &str {
        "SUMO FCD"
    }

    fn rate_hz(&self) -> f64 {
        10.
    }

    fn files(&self) -> &str {
        "SUMO's floating car data (--fcd-output): .xml or .csv, plain or .gz, or .parquet"
    }

    fn schema(&self) -> Schema {
        Schema::new(
            "SUMO FCD, floating car data: what `sumo --fcd-output FILE` writes, with FILE ending with .xml, .xml.gz, .csv, .csv.gz or \
             .parquet, or a table that SUMO's xml2csv made of one.\n\
             Rate: 1 / --step-length; run SUMO with --step-length 0.1 or 0.2.\n",
            vec![TableSchema::new("Columns read, which are the attributes `time`, `id`, `x`, ... in XML", &READ)],
            "The front becomes the centre, half a length back. Sizes are those of the vTypes in route and additional files (.xml) \
             of the same folder; else those that SUMO gives a vehicle of the class that the name of its type tells, a passenger \
             car where it tells none. Persons, bicycles, trains and ships are left out. Lanes are counted from the left of their \
             edge. Counts as simulated.\n",
        )
    }

    fn extensions(&self) -> &[&str] {
        &["xml", "csv", "parquet"]
    }

    fn recognise(&self, file: &Path) -> Result<bool, DataError> {
        Ok(Layout::of(file)?.is_some())
    }

    fn sources(&self, found: &FoundFiles) -> Result<Vec<Source>, DataError> {
        let mut sources = found.one_per_file(self)?;
        let mut types: BTreeMap<PathBuf, Vec<PathBuf>> = BTreeMap::new();
        for source in &mut sources {
            let file = source.file()?.to_owned();
            let recorded = head(&file)?.0.windows(RECORDED.len()).any(|at| at == RECORDED.as_bytes());
            source.simulated |= !recorded;
            let folder = file.parent().unwrap_or(Path::new("")).to_owned();
            let beside = || found.beside(&file).filter(|it| has_types(it)).map(Path::to_owned).collect();
            source.files.extend(types.entry(folder).or_insert_with(beside).iter().cloned());
        }
        Ok(sources)
    }

    fn read(&self, source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        self.read_with(source, &TrackOptions { rate_hz, ..TrackOptions::default() })
    }

    fn read_with(&self, source: &Source, options: &TrackOptions) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        whole(&Fcd::open(source)?, source)?.recordings(options)
    }

    fn track_file(&self, source: &Source) -> Result<Option<Box<dyn TrackFile>>, DataError> {
        Ok(Some(Box::new(Fcd::open(source)?)))
    }

    fn written_as(&self) -> &[&str] {
        &[".xml"]
    }

    fn write(&self, tracks: &Tracks, _: &TrackOptions, to: &Path) -> Result<Written, DataError> {
        write::fcd::write(&tracks.table(), to)
    }
}

/// How a file of floating car data is laid out.
enum Layout {
    Xml,
    Text(csv::Layout),
    Parquet(parquet::Layout),
}

impl Layout {
    fn of(file: &Path) -> Result<Option<Self>, DataError> {
        let (bytes, _) = head(file)?;
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes).trim_ascii_start();
        if text.starts_with(b"PAR1") {
            return Ok(parquet::recognise(file)?.map(Self::Parquet));
        }
        if text.starts_with(b"<") {
            return Ok(has(text, b"<fcd-export").then_some(Self::Xml));
        }
        let layout = Head::read(file)?.map(|head| csv::recognise(file, &head)).transpose()?.flatten();
        Ok(layout.map(Self::Text))
    }

    /// Hands every vehicle of `file` to `take`, in its order, until that says that it has seen enough.
    fn vehicles(
        &self,
        file: &Path,
        other: &mut Other,
        take: &mut dyn FnMut(&Vehicle<'_>) -> Result<bool, DataError>,
    ) -> Result<(), DataError> {
        match self {
            Self::Xml => xml::vehicles(file, other, take),
            Self::Text(layout) => csv::vehicles(file, layout, other, take),
            Self::Parquet(layout) => parquet::vehicles(file, layout, other, take),
        }
    }
}

fn has(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|at| at == word)
}

/// Whether a file describes vehicle types near its start.
fn has_types(file: &Path) -> bool {
    let xml = |bytes: &[u8]| bytes.trim_ascii_start().starts_with(b"<") && !has(bytes, b"<fcd-export");
    head(file).is_ok_and(|(bytes, _)| xml(&bytes) && has(&bytes[..bytes.len().min(TYPES_WITHIN)], b"<vType"))
}

/// A file of floating car data, looked through once.
struct Fcd {
    file: PathBuf,
    layout: Layout,
    /// Largest index of a lane by edge.
    edges: BTreeMap<String, i16>,
    /// Whether vehicles have speeds.
    speeds: bool,
    types: Types,
    site: String,
    name: String,
    simulated: bool,
    notes: Vec<String>,
}

impl Fcd {
    fn open(source: &Source) -> Result<Self, DataError> {
        let file = source.file()?.to_owned();
        let layout = Layout::of(&file)?.ok_or_else(|| DataError::NoRecordings {
            folder: file.clone(),
            expected: Sumo.files().to_owned(),
            seen: "a table or text of another kind".to_owned(),
        })?;
        let mut types = Types::default();
        for file in &source.files[1..] {
            types.read(file)?;
        }
        let (mut edges, mut degrees, mut speeds) = (BTreeMap::<String, i16>::new(), Degrees::default(), false);
        layout.vehicles(&file, &mut Other::default(), &mut |vehicle| {
            if let Some((edge, index)) = vehicle.edge() {
                match edges.get_mut(edge) {
                    Some(most) => *most = index.max(*most),
                    None => drop(edges.insert(edge.to_owned(), index)),
                }
            }
            degrees.see(vehicle);
            speeds |= vehicle.speed.is_some();
            Ok(true)
        })?;
        degrees.check(&file)?;
        let (site, name) = (source.site.clone().unwrap_or_else(|| "sumo".to_owned()), source.name.clone());
        Ok(Self {
            file,
            layout,
            edges,
            speeds,
            types,
            site,
            name,
            simulated: source.simulated,
            notes: source.notes.clone(),
        })
    }

    /// Lane of a vehicle, 1 the leftmost of its edge; 0 unknown.
    fn lane(&self, vehicle: &Vehicle<'_>) -> i16 {
        let place = vehicle.edge().and_then(|(edge, index)| Some((self.edges.get(edge)?, index)));
        place.map_or(0, |(most, index)| most - index + 1)
    }
}

impl TrackFile for Fcd {
    fn tables(
        &self,
        rows: usize,
        take: &mut dyn FnMut(TrackTable) -> Result<ControlFlow<()>, DataError>,
    ) -> Result<(), DataError> {
        let mut part = Part::of(self);
        let (mut other, mut stopped) = (Other::default(), false);
        self.layout.vehicles(&self.file, &mut other, &mut |vehicle| {
            part.add(vehicle);
            if part.table.len() >= rows {
                let full = std::mem::replace(&mut part, Part::of(self));
                stopped = take(full.finish())?.is_break();
            }
            Ok(!stopped)
        })?;
        if other.persons > 0 {
            part.table.skipped_rows.insert("persons and containers".to_owned(), other.persons);
        }
        if !stopped && (!part.table.is_empty() || other.persons > 0) {
            let _ = take(part.finish())?;
        }
        Ok(())
    }
}

/// Rows of a file on their way into a table.
struct Part<'a> {
    fcd: &'a Fcd,
    table: TrackTable,
    known: HashMap<String, (u32, f64)>,
    numbers: Vec<u64>,
    /// Speeds; NaN where a row has none.
    speed: Vec<f64>,
    heading: Vec<f64>,
    lane: Vec<i16>,
    /// Types that no file describes.
    guessed: BTreeMap<String, u64>,
}

impl<'a> Part<'a> {
    fn of(fcd: &'a Fcd) -> Self {
        let mut table = TrackTable::new(Dataset::SUMO, &fcd.site, &fcd.name);
        table.simulated = fcd.simulated;
        let (known, guessed) = (HashMap::new(), BTreeMap::new());
        Self {
            fcd,
            table,
            known,
            numbers: Vec::new(),
            speed: Vec::new(),
            heading: Vec::new(),
            lane: Vec::new(),
            guessed,
        }
    }

    fn add(&mut self, it: &Vehicle<'_>) {
        let (index, length) = match self.known.get(it.id) {
            Some(known) => *known,
            None => self.vehicle(it),
        };
        let (sin, cos) = it.heading().sin_cos();
        self.table.vehicle.push(index);
        self.table.time_s.push(it.time_s);
        self.table.x.push(it.front[0] - length / 2. * cos);
        self.table.y.push(it.front[1] - length / 2. * sin);
        self.numbers.push(it.place);
        self.speed.push(it.speed.unwrap_or(f64::NAN));
        self.heading.push(it.heading());
        self.lane.push(self.fcd.lane(it));
    }

    /// Index and length of a vehicle that is seen for the first time.
    fn vehicle(&mut self, it: &Vehicle<'_>) -> (u32, f64) {
        let Kind { class, size: [length, width], stated } = self.fcd.types.kind(it.kind);
        let mut vehicle = TableVehicle::named(it.id);
        (vehicle.class, vehicle.length, vehicle.width) = (class, Some(length), Some(width));
        if class.is_none() {
            vehicle.left_out = Some(format!("are of type {}", gnp_file::excerpt(it.kind, 40)));
        }
        if !stated {
            *self.guessed.entry(it.kind.to_owned()).or_default() += 1;
        }
        let known = (self.table.vehicles.len() as u32, f64::from(length));
        self.table.vehicles.push(vehicle);
        self.known.insert(it.id.to_owned(), known);
        known
    }

    fn finish(self) -> TrackTable {
        let Self { fcd, mut table, numbers, speed, heading, lane, guessed, .. } = self;
        let what = if matches!(fcd.layout, Layout::Parquet(_)) { "row" } else { "line" };
        table.places = RowPlaces::Numbers { file: fcd.file.clone(), what, numbers };
        table.speed = fcd.speeds.then_some(speed);
        table.heading = Some(heading);
        table.lane_numbers = LaneNumbers::FromLeft;
        table.lane = Some(lane);
        for (ours, theirs) in [("time", "time"), ("heading", "angle")] {
            table.columns.insert(ours, theirs.to_owned());
        }
        table.notes.extend(fcd.notes.iter().cloned());
        table.notes.extend(guessed.keys().map(|kind| {
            let [length, width] = fcd.types.kind(kind).size;
            format!(
                "type {} is described by no file beside: its vehicles are taken to be {length} m long and {width} m wide",
                gnp_file::excerpt(kind, 40)
            )
        }));
        table
    }
}

/// Whether positions are in degrees: vehicles then move less than a thousandth of what their speeds say.
#[derive(Default)]
struct Degrees {
    last: HashMap<String, (f64, [f64; 2])>,
    /// What vehicles moved, and what their speeds say, m.
    ways: [f64; 2],
}

impl Degrees {
    /// Beyond this way, m, it is clear.
    const ENOUGH: f64 = 1000.;

    fn see(&mut self, it: &Vehicle<'_>) {
        if self.ways[1] > Self::ENOUGH {
            return;
        }
        let now = (it.time_s, it.front);
        let Some(last) = self.last.get_mut(it.id) else {
            self.last.insert(it.id.to_owned(), now);
            return;
        };
        let (step, way) = (it.time_s - last.0, (it.front[0] - last.1[0]).hypot(it.front[1] - last.1[1]));
        self.ways[0] += way;
        self.ways[1] += it.speed.unwrap_or(0.).max(0.) * step.clamp(0., 1.);
        *last = now;
    }

    fn check(&self, file: &Path) -> Result<(), DataError> {
        let [way, driven] = self.ways;
        if driven < 1. || way > driven * 1e-3 {
            return Ok(());
        }
        Err(DataError::Tracks {
            problem: TrackProblem::Unit,
            place: file.display().to_string(),
            row: None,
            what: format!("vehicles move by {way:.5} where their speeds make {driven:.0} m: x and y are degrees"),
            remedy: "run SUMO without --fcd-output.geo".to_owned(),
        })
    }
}
