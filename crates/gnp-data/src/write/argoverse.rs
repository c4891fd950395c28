//! Argoverse 2's layout: scenarios of 11 s at 10 Hz, each a Parquet file.

use std::path::{Path, PathBuf};

use super::columns::{Cells, write_columns};
use super::plain::SIMULATED;
use super::{Written, atomically};
use crate::error::DataError;
use crate::recording::VehicleClass;
use crate::track_table::TrackTable;

/// Time between rows of the layout, s.
const STEP_S: f64 = 0.1;

/// Steps of a scenario, and those of them that are observed.
const STEPS: [i64; 2] = [110, 50];

/// Rows of one scenario.
struct Scenario {
    id: String,
    /// Rows of the table with their steps, by vehicle and step.
    rows: Vec<(u32, i64)>,
    /// Vehicle that the scenario is about: of those with most rows the one that comes first.
    focal: u32,
    /// Rows of each vehicle.
    count: Vec<u32>,
    start_s: f64,
}

/// Writes tracks as scenarios, one after another: `ID/scenario_ID.parquet` for each in the folder of `to`, whose name their
/// names begin with.
///
/// # Errors
/// [`DataError::Unwritable`] for tracks at another rate than 10 Hz; when a file cannot be written.
pub(crate) fn write(table: &TrackTable, to: &Path) -> Result<Written, DataError> {
    let name = to.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut written = Written { vehicles: table.vehicles.len() as u64, ..Written::default() };
    let velocity = velocities(table);
    for scenario in scenarios(table, &name)? {
        let folder = to.with_file_name(&scenario.id);
        let file: PathBuf = folder.join(format!("scenario_{}.parquet", scenario.id));
        atomically(&file, |out| write_columns(out, scenario.rows.len(), &scenario.cells(table, &velocity)))?;
        written.rows += scenario.rows.len() as u64;
        written.files.push(file);
    }
    written.lose(
        "lengths and widths are not in the layout, of vehicles",
        table.vehicles.iter().filter(|it| it.length.is_some()).count(),
    );
    written.lose("lane numbers are not in the layout, of rows", table.lane.as_ref().map_or(0, Vec::len));
    let trucks = table.vehicles.iter().filter(|it| it.class == Some(VehicleClass::Truck)).count();
    written.lose("trucks are not in the layout: they become buses", trucks);
    written.lose("tracks end where a scenario of 11 s does: scenarios", written.files.len().saturating_sub(1));
    if table.simulated {
        written.lose(SIMULATED, 1);
    }
    Ok(written)
}

fn scenarios(table: &TrackTable, name: &str) -> Result<Vec<Scenario>, DataError> {
    let first = table.time_s.iter().copied().fold(f64::INFINITY, f64::min);
    let step = |row: usize| ((table.time_s[row] - first) / STEP_S).round() as i64;
    let mut rows: Vec<(i64, u32, i64, u32)> = Vec::with_capacity(table.len());
    let (mut lone, mut last) = (true, None);
    for row in 0..table.len() {
        let step = step(row);
        if (first + step as f64 * STEP_S - table.time_s[row]).abs() > 2e-3 {
            return Err(other_rate(table));
        }
        // A lower rate would leave every second step empty.
        lone &= last.is_none_or(|last: i64| last == step || (step - last).abs() > 1);
        last = Some(step);
        rows.push((step.div_euclid(STEPS[0]), table.vehicle[row], step.rem_euclid(STEPS[0]), row as u32));
    }
    if lone && rows.iter().any(|row| row.2 != rows[0].2) {
        return Err(other_rate(table));
    }
    rows.sort_unstable();
    let scenarios = rows.chunk_by(|a, b| a.0 == b.0).map(|part| {
        let mut count = vec![0u32; table.vehicles.len()];
        part.iter().for_each(|row| count[row.1 as usize] += 1);
        let most = count.iter().max().copied().unwrap_or(0);
        Scenario {
            id: format!("{name}-{:03}", part[0].0),
            rows: part.iter().map(|row| (row.3, row.2)).collect(),
            focal: count.iter().position(|n| *n == most).unwrap_or(0) as u32,
            count,
            start_s: first + (part[0].0 * STEPS[0]) as f64 * STEP_S,
        }
    });
    Ok(scenarios.collect())
}

fn other_rate(table: &TrackTable) -> DataError {
    DataError::Unwritable {
        recording: table.name.clone(),
        layout: "Argoverse 2".to_owned(),
        reason: "its rows are not 0.1 s apart as the layout has them; write plain tracks instead".to_owned(),
    }
}

/// Velocity and direction of every row.
fn velocities(table: &TrackTable) -> Vec<[f64; 3]> {
    let rows = super::fcd::by_time(table);
    let (speed, heading) = super::fcd::motion(table, &rows);
    let given = |row: usize| table.velocity.as_ref().map(|[vx, vy]| [vx[row], vy[row]]);
    let of = |row: usize| {
        let (sin, cos) = heading[row].sin_cos();
        let [vx, vy] = given(row).unwrap_or([speed[row] * cos, speed[row] * sin]);
        [vx, vy, heading[row]]
    };
    (0..table.len()).map(of).collect()
}

impl Scenario {
    fn cells<'a>(&'a self, table: &'a TrackTable, velocity: &'a [[f64; 3]]) -> Vec<(&'static str, Cells<'a>)> {
        fn real<'b>(of: impl Fn(usize) -> f64 + 'b) -> Cells<'b> {
            Cells::Real(Box::new(of))
        }
        let row = |i: usize| self.rows[i].0 as usize;
        let vehicle = move |i: usize| table.vehicle[row(i)];
        let name = move |vehicle: u32| table.vehicles[vehicle as usize].name.as_str();
        let kind = move |i: usize| match table.vehicles[vehicle(i) as usize].class {
            Some(VehicleClass::Motorcycle) => "motorcyclist",
            Some(VehicleClass::Truck) => "bus",
            _ => "vehicle",
        };
        let category = move |i: usize| match vehicle(i) {
            focal if focal == self.focal => 3,
            other if i64::from(self.count[other as usize]) == STEPS[0] => 2,
            _ => 0,
        };
        let end_s = self.start_s + (STEPS[0] - 1) as f64 * STEP_S;
        vec![
            ("observed", Cells::Flag(Box::new(|i| self.rows[i].1 < STEPS[1]))),
            ("track_id", Cells::Text(Box::new(move |i| name(vehicle(i))))),
            ("object_type", Cells::Text(Box::new(kind))),
            ("object_category", Cells::Whole(Box::new(category))),
            ("timestep", Cells::Whole(Box::new(|i| self.rows[i].1))),
            ("position_x", real(move |i| table.x[row(i)])),
            ("position_y", real(move |i| table.y[row(i)])),
            ("heading", real(move |i| velocity[row(i)][2])),
            ("velocity_x", real(move |i| velocity[row(i)][0])),
            ("velocity_y", real(move |i| velocity[row(i)][1])),
            ("scenario_id", Cells::Text(Box::new(|_| self.id.as_str()))),
            ("start_timestamp", real(|_| self.start_s)),
            ("end_timestamp", real(move |_| end_s)),
            ("num_timestamps", Cells::Whole(Box::new(|_| STEPS[0]))),
            ("focal_track_id", Cells::Text(Box::new(move |_| name(self.focal)))),
            ("city", Cells::Text(Box::new(|_| table.site.as_str()))),
        ]
    }
}
