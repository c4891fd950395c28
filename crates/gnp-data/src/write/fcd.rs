//! SUMO's floating car data as XML, and the vehicle types that its names of types stand for.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::Path;

use super::{Written, to_file};
use crate::error::DataError;
use crate::recording::VehicleClass;
use crate::track_table::{DEFAULT_SIZES, LaneNumbers, TableVehicle, TrackTable};

/// Says in the file that its tracks were recorded, while all others of the layout were simulated.
pub(crate) const RECORDED: &str = "<!-- recorded traffic -->";

/// Writes tracks as floating car data, and the types of their vehicles to an additional file beside.
///
/// # Errors
/// When a file cannot be written.
pub(crate) fn write(table: &TrackTable, to: &Path) -> Result<Written, DataError> {
    let name = to.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = name.split_once(".xml").map_or(name.as_str(), |(stem, _)| stem);
    let types = to.with_file_name(format!("{stem}.add.xml"));
    to_file(to, |out| write_fcd(table, out))?;
    to_file(&types, |out| write_fcd_types(table, out))?;
    let (rows, vehicles) = (table.len() as u64, table.vehicles.len() as u64);
    let mut written = Written { files: vec![to.to_owned(), types], rows, vehicles, ..Written::default() };
    let unknown = |of: fn(&TableVehicle) -> bool| table.vehicles.iter().filter(|it| of(it)).count();
    written.lose(
        "vehicles without a length or width get those of their class",
        unknown(|it| it.length.is_none() || it.width.is_none()),
    );
    written.lose("vehicles without a class become cars", unknown(|it| it.class.is_none()));
    if table.velocity.is_none() && table.speed.is_none() {
        written.lose("rows without a speed get that of the way from the row before", table.len());
    } else if table.velocity.is_some() {
        written.lose("velocities become speeds in the direction of the vehicle, of rows", table.len());
    }
    Ok(written)
}

/// A table in the order and the words of the layout.
struct Export<'a> {
    table: &'a TrackTable,
    /// Rows by time, then by vehicle.
    rows: Vec<u32>,
    /// Velocity of each row, m/s.
    speed: Vec<f64>,
    /// Direction of each row, rad anticlockwise from x.
    heading: Vec<f64>,
    /// Type of each vehicle, length and width in m.
    types: Vec<(String, [f64; 2])>,
    /// Class of each vehicle.
    class: Vec<VehicleClass>,
    /// Direction of the road, rad.
    forward: f64,
    /// Largest lane number of the carriageway that drives forward, and of the other.
    lanes: [i16; 2],
}

/// Writes tracks as the XML that SUMO calls floating car data (`--fcd-output`): every vehicle in every frame, with the middle
/// of its front bumper, and angles clockwise from north, which is where y points.
///
/// Lanes are `section_0` and on from the right, as SUMO counts them, and `opposite_0` where vehicles drive the other way;
/// types are named by class and size, as [`write_fcd_types`] describes them. Where the tracks have no velocities these are
/// those of the way from the row before.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_fcd(table: &TrackTable, out: &mut dyn Write) -> io::Result<()> {
    let export = Export::of(table);
    writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>")?;
    if !table.simulated {
        writeln!(out, "{RECORDED}")?;
    }
    writeln!(out, "<fcd-export>")?;
    let begins = export.begins();
    for moment in export.rows.chunk_by(|a, b| table.time_s[*a as usize] == table.time_s[*b as usize]) {
        let Some(first) = moment.first() else { continue };
        writeln!(out, "  <timestep time=\"{}\">", seconds(table.time_s[*first as usize]))?;
        for row in moment {
            export.vehicle(*row as usize, begins, out)?;
        }
        writeln!(out, "  </timestep>")?;
    }
    writeln!(out, "</fcd-export>")
}

/// Writes the types of vehicles that [`write_fcd`] names, as an additional file of SUMO: floating car data themselves say
/// nothing of sizes.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_fcd_types(table: &TrackTable, out: &mut dyn Write) -> io::Result<()> {
    let export = Export::of(table);
    let types: BTreeSet<(&str, usize)> =
        export.types.iter().enumerate().map(|(i, (name, _))| (name.as_str(), i)).collect();
    let mut written = BTreeSet::new();
    writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<additional>")?;
    for (name, vehicle) in types {
        if !written.insert(name) {
            continue;
        }
        let class = match export.class[vehicle] {
            VehicleClass::Motorcycle => "motorcycle",
            VehicleClass::Car => "passenger",
            VehicleClass::Truck => "truck",
        };
        let [length, width] = export.types[vehicle].1;
        writeln!(
            out,
            "  <vType id=\"{}\" vClass=\"{class}\" length=\"{length:.2}\" width=\"{width:.2}\"/>",
            escape(name)
        )?;
    }
    writeln!(out, "</additional>")
}

impl<'a> Export<'a> {
    fn of(table: &'a TrackTable) -> Self {
        let rows = by_time(table);
        let (speed, heading) = motion(table, &rows);
        let size = |it: &TableVehicle| {
            let class = it.class.unwrap_or(VehicleClass::Car);
            let [length, width] =
                DEFAULT_SIZES.iter().find(|(of, _)| *of == class).map_or([4.5, 1.8], |(_, size)| *size);
            (class, [it.length.unwrap_or(length), it.width.unwrap_or(width)].map(f64::from))
        };
        let of_vehicles: Vec<(VehicleClass, [f64; 2])> = table.vehicles.iter().map(size).collect();
        let types = of_vehicles.iter().map(|(class, [length, width])| {
            let class = match class {
                VehicleClass::Truck => "truck",
                VehicleClass::Motorcycle => "motorcycle",
                VehicleClass::Car => "car",
            };
            (format!("{class}_{length:.2}x{width:.2}"), [*length, *width])
        });
        let (sin, cos) = heading.iter().fold((0., 0.), |(s, c), a: &f64| (s + (2. * a).sin(), c + (2. * a).cos()));
        // Along the road, whichever of its directions; the first vehicle drives forward.
        let axis = 0.5 * f64::atan2(sin, cos);
        let first = rows.first().map_or(0., |row| heading[*row as usize]);
        let forward = if (first - axis).cos() < 0. { axis + std::f64::consts::PI } else { axis };
        let mut export = Self {
            table,
            rows,
            speed,
            heading,
            types: types.collect(),
            class: of_vehicles.iter().map(|(class, _)| *class).collect(),
            forward,
            lanes: [0; 2],
        };
        for row in 0..table.len() {
            let side = export.side(row);
            export.lanes[side] = export.lanes[side].max(export.lane(row));
        }
        export
    }

    /// 0 for who drives forward along the road, 1 for the others.
    fn side(&self, row: usize) -> usize {
        usize::from((self.heading[row] - self.forward).cos() < 0.)
    }

    fn lane(&self, row: usize) -> i16 {
        self.table.lane.as_ref().map_or(0, |lane| lane[row])
    }

    fn front(&self, row: usize) -> [f64; 2] {
        let half = self.types[self.table.vehicle[row] as usize].1[0] / 2.;
        let (sin, cos) = self.heading[row].sin_cos();
        [self.table.x[row] + half * cos, self.table.y[row] + half * sin]
    }

    /// Distance along its carriageway, m, from the origin.
    fn along(&self, row: usize) -> f64 {
        let ([x, y], (sin, cos)) = (self.front(row), self.forward.sin_cos());
        let along = x * cos + y * sin;
        if self.side(row) == 0 { along } else { -along }
    }

    /// Where the carriageways begin: no position along them is below 0.
    fn begins(&self) -> [f64; 2] {
        let mut begins = [0f64; 2];
        for row in 0..self.table.len() {
            let begin = &mut begins[self.side(row)];
            *begin = begin.min(self.along(row));
        }
        begins
    }

    fn vehicle(&self, row: usize, begins: [f64; 2], out: &mut dyn Write) -> io::Result<()> {
        let (table, side) = (self.table, self.side(row));
        let vehicle = table.vehicle[row] as usize;
        let [x, y] = self.front(row);
        let angle = (90. - self.heading[row].to_degrees()).rem_euclid(360.);
        let edge = ["section", "opposite"][side];
        let index = match (self.lane(row), table.lane_numbers) {
            (..=0, _) => String::new(),
            (lane, LaneNumbers::FromLeft) => format!("{edge}_{}", self.lanes[side] - lane),
            (lane, LaneNumbers::FromRight) => format!("{edge}_{}", lane - 1),
        };
        writeln!(
            out,
            "    <vehicle id=\"{}\" x=\"{x:.3}\" y=\"{y:.3}\" angle=\"{angle:.2}\" type=\"{}\" speed=\"{:.3}\" \
             pos=\"{:.2}\" lane=\"{index}\" slope=\"0.00\"/>",
            escape(&table.vehicles[vehicle].name),
            escape(&self.types[vehicle].0),
            self.speed[row],
            self.along(row) - begins[side],
        )
    }
}

/// Rows by time, those of one moment by vehicle.
pub(super) fn by_time(table: &TrackTable) -> Vec<u32> {
    let mut rows: Vec<u32> = (0..table.len() as u32).collect();
    rows.sort_by(|a, b| {
        let key = |row: u32| (table.time_s[row as usize], table.vehicle[row as usize]);
        let ((s, a), (t, b)) = (key(*a), key(*b));
        s.total_cmp(&t).then(a.cmp(&b))
    });
    rows
}

/// Speed, m/s, and direction, rad, of every row: as the table has them, else from the way since the row before.
pub(super) fn motion(table: &TrackTable, by_time: &[u32]) -> (Vec<f64>, Vec<f64>) {
    let rows = table.len();
    let mut derived = vec![[f64::NAN; 2]; rows];
    let mut before: Vec<Option<usize>> = vec![None; table.vehicles.len()];
    for row in by_time.iter().map(|row| *row as usize) {
        let last = &mut before[table.vehicle[row] as usize];
        if let Some(last) = *last {
            let step = table.time_s[row] - table.time_s[last];
            let velocity = [table.x[row] - table.x[last], table.y[row] - table.y[last]].map(|way| way / step.max(1e-3));
            derived[row] = velocity;
            // Of a first row only the next one tells it.
            if derived[last][0].is_nan() {
                derived[last] = velocity;
            }
        }
        *last = Some(row);
    }
    let velocity = |row: usize| table.velocity.as_ref().map_or(derived[row], |[vx, vy]| [vx[row], vy[row]]);
    let given = |of: &Option<Vec<f64>>, row: usize| of.as_ref().map(|of| of[row]).filter(|value| value.is_finite());
    let or = |value: f64, other: f64| if value.is_finite() { value } else { other };
    let speed = |row| given(&table.speed, row).unwrap_or_else(|| or(velocity(row)[0].hypot(velocity(row)[1]), 0.));
    let heading = |row| {
        given(&table.heading, row).unwrap_or_else(|| {
            let [vx, vy] = velocity(row);
            or(vy.atan2(vx), 0.)
        })
    };
    ((0..rows).map(speed).collect(), (0..rows).map(heading).collect())
}

/// A time with as few decimals as it needs, from two to three.
fn seconds(time_s: f64) -> String {
    let hundredths = time_s * 100.;
    if (hundredths - hundredths.round()).abs() < 0.01 { format!("{time_s:.2}") } else { format!("{time_s:.3}") }
}

/// Text for an attribute.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            c if c.is_control() => escaped.push(' '),
            c => escaped.push(c),
        }
    }
    escaped
}
