//! Measures the tracks of a CSV file and draws them:
//! `cargo run --example traffic -- TRACKS.csv RATE_HZ recorded|simulated OUT_FOLDER [CIRCUMFERENCE_M]`.
//!
//! Columns, in this order, under any header: vehicle, frame, x, y, vx, vy, lane, length, width, road (SI units, centre of the
//! box, y to the left). Writes tables, `summary.json` and figures of every carriageway.

use std::error::Error;
use std::fs;
use std::path::Path;

use gnp_data::{Dataset, Recording, RecordingMeta, Road, Rows, VehicleBody, VehicleClass};
use gnp_measures::{Bins, CellSize, Course, Settings, Summary, Traffic, cell_rows, detector_rows, event_rows};
use gnp_plot::{
    DetectorSeries, Figure, FlowDensity, Source, SpeedField, Trace, detector_series, flow_density, speed_field,
};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, rate, made, out, rest @ ..] = &arguments[..] else {
        return Err("give TRACKS.csv RATE_HZ recorded|simulated OUT_FOLDER [CIRCUMFERENCE_M]".into());
    };
    let recording = read(Path::new(file), rate.parse()?, made != "recorded")?;
    let course = match rest.first() {
        Some(circumference) => Course::Ring { circumference: circumference.parse()? },
        None => Course::Open,
    };
    let traffic = Traffic::new(&recording, course)?;
    let summary = Summary::of(&traffic, &Settings::default())?;
    let out = Path::new(out);
    fs::create_dir_all(out)?;
    fs::write(out.join("summary.json"), serde_json::to_string_pretty(&summary)?)?;
    let lines = |rows: Vec<String>| rows.join("\n") + "\n";
    fs::write(out.join("detectors.csv"), lines(detector_rows(&summary).collect()))?;
    fs::write(out.join("cells.csv"), lines(cell_rows(&summary).collect()))?;
    fs::write(out.join("events.csv"), lines(event_rows(&summary).collect()))?;
    for road in 0..recording.roads().len() as u16 {
        draw(&traffic, &summary, road, out)?;
    }
    for wave in &summary.waves {
        let lane = wave.lane.map_or_else(|| "all lanes".to_owned(), |lane| format!("lane {lane}"));
        match &wave.speed {
            Ok(it) => println!(
                "carriageway {}, {lane}: waves run upstream at {:.1} km/h (correlation {:.2}, {} pairs of places)",
                wave.road,
                it.speed * 3.6,
                it.correlation,
                it.pairs
            ),
            Err(reason) => println!("carriageway {}, {lane}: {reason}", wave.road),
        }
    }
    Ok(())
}

fn draw(traffic: &Traffic<'_>, summary: &Summary, road: u16, out: &Path) -> Result<(), Box<dyn Error>> {
    let Some(cells) = traffic.cells(road, CellSize { x: 20., t: 2. })? else { return Ok(()) };
    let source = Source { words: format!("{}, carriageway {road}", summary.recording), simulated: summary.simulated };
    let write = |figure: Figure| fs::write(out.join(format!("{}-{road}.svg", figure.name)), figure.svg);
    let edges = |bins: &Bins| (0..=bins.count).map(|i| bins.edge(i)).collect::<Vec<_>>();
    let busiest = traffic.lanes().iter().filter(|lane| lane.road == road).max_by_key(|lane| lane.rows);
    let lane = busiest.map(|lane| lane.number);
    let wave = summary.waves.iter().find(|it| it.road == road && it.lane == lane);
    let field = SpeedField {
        title: lane.map_or_else(String::new, |lane| format!("Lane {lane}, the busiest")),
        t: edges(cells.t()),
        x: edges(cells.x()),
        speed: cells.iter().filter(|cell| cell.lane == lane).map(|cell| cell.speed).collect(),
        traces: traces(traffic, road, lane),
        wave_speed: wave.and_then(|wave| wave.speed.as_ref().ok()).map(|speed| speed.speed),
    };
    write(speed_field(&field, &source))?;
    let Some(diagram) = summary.diagrams.iter().find(|it| it.road == road && it.lane.is_none()) else { return Ok(()) };
    let of_lane = |lane: &i16| {
        let points = diagram.points.iter().filter(|point| point.lane == *lane);
        (format!("lane {lane}"), points.map(|point| [point.density_veh_km, point.flow_veh_h]).collect())
    };
    let drawn = FlowDensity {
        title: "Cells of about 100 m and 30 s, each of one lane".to_owned(),
        lanes: cells.lanes().iter().map(of_lane).collect(),
        free_speed: diagram.free_speed.as_ref().ok().copied(),
        congested: diagram.congested.as_ref().ok().map(|it| [it.wave_speed, it.jam_density_veh_km]),
        capacity: diagram.capacity.as_ref().ok().map(|it| it.flow_veh_h),
    };
    write(flow_density(&drawn, &source))?;
    let Some(first) = summary.detectors.iter().find(|it| it.road == road) else { return Ok(()) };
    let intervals = traffic.station(road, first.x, 0.)?.intervals(10.)?;
    let series = |lane: Option<i16>| {
        let of = || intervals.iter().filter(|it| it.lane == lane);
        DetectorSeries {
            name: lane.map_or_else(|| "all lanes".to_owned(), |lane| format!("lane {lane}")),
            time: of().map(|it| (it.t[0] + it.t[1]) / 2.).collect(),
            flow: of().map(|it| it.flow_veh_h).collect(),
            speed: of().map(|it| it.speed).collect(),
        }
    };
    let detectors: Vec<DetectorSeries> = cells.lanes().iter().copied().map(Some).chain([None]).map(series).collect();
    write(detector_series(&format!("Detector at {:.0} m, by 10 s", first.x), &detectors, &source))?;
    Ok(())
}

/// Stays of vehicles in a lane; on a ring a new line begins at the seam.
fn traces(traffic: &Traffic<'_>, road: u16, lane: Option<i16>) -> Vec<Trace> {
    let mut traces: Vec<Trace> = Vec::new();
    for track in traffic.recording().tracks().iter().filter(|track| track.road == road) {
        let mut points: Vec<[f64; 2]> = Vec::new();
        for (row, frame) in track.rows.clone().zip(track.first_frame..) {
            let inside = traffic.lane(row).map(|lane| lane.number) == lane;
            let at = [traffic.time_s(frame), traffic.place(traffic.x(row))];
            if !inside || points.last().is_some_and(|last| at[1] < last[1] - 20.) {
                traces.push(Trace { points: std::mem::take(&mut points) });
            }
            if inside {
                points.push(at);
            }
        }
        traces.push(Trace { points });
    }
    traces.retain(|trace| trace.points.len() > 1);
    traces
}

fn read(file: &Path, rate_hz: f64, simulated: bool) -> Result<Recording, Box<dyn Error>> {
    let text = fs::read_to_string(file)?;
    let mut columns: [Vec<f32>; 10] = Default::default();
    for line in text.lines().skip(1) {
        for (column, field) in columns.iter_mut().zip(line.split(',')) {
            column.push(field.trim().parse()?);
        }
    }
    let [vehicle, frame, x, y, vx, vy, lane, length, width, road] = columns;
    let whole = |column: &[f32]| column.iter().map(|value| *value as u32).collect();
    let mut rows = Rows::new(whole(&vehicle), whole(&frame), x, y);
    rows.velocity = Some([vx, vy]);
    rows.lane = lane.iter().map(|lane| *lane as i16).collect();
    let body = |row: usize| VehicleBody {
        class: VehicleClass::Car,
        length: length[row],
        width: width[row],
        road: road[row] as u16,
    };
    let roads = road.iter().fold(0, |most: u16, road| most.max(*road as u16)) + 1;
    let name = file.file_stem().map_or_else(|| "tracks".to_owned(), |stem| stem.to_string_lossy().into_owned());
    let meta = RecordingMeta::new(Dataset::LIVE, "file", name, rate_hz).with_simulated(simulated);
    let none = Road { driving_direction: 2, lines: Vec::new(), fitted: false, axis: None };
    Ok(Recording::from_rows(meta, vec![none; roads.into()], rows, body)?.0)
}
