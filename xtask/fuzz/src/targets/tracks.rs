//! Plain tracks as text and as Parquet, and scenarios of Argoverse 2: made-up traffic, damaged files, any bytes.

use std::sync::Arc;

use arbitrary::{Arbitrary, Unstructured};
use gnp_data::Dataset;
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use parquet::errors::ParquetError;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;

use super::table_text::{as_table, reads};
use crate::made::{Rarely, kind};
use crate::table::Style;
use crate::{Finding, Scratch, Target};

pub(super) const TARGET: Target = Target {
    name: "tracks",
    about: "plain tracks as text and Parquet, scenarios of Argoverse 2, to recordings and forecasts",
    run,
    seeds,
    words: &["id", "time", "heading_deg", "speed", "vx", "length", "lane", "class", "PAR1", "position_x", "timestep"],
};

/// What a table has besides id, time, x and y.
const OPTIONAL: [&str; 7] = ["heading", "speed", "vx", "vy", "length", "lane", "class"];

const CLASSES: [&str; 5] = ["car", "Truck", "motorcycle", "pedestrian", "sledge"];

/// Traffic on a road in any direction, and how it is written.
#[derive(Arbitrary, Clone, Debug)]
struct Traffic {
    /// Direction of the road, in 1/256 of a turn.
    heading: u8,
    /// Frames per second.
    rate: u8,
    /// Places of the origin, in km.
    far: Rarely<[i16; 2]>,
    /// Which of the optional columns there are, a bit each.
    columns: u8,
    vehicles: [Vehicle; 4],
    style: Style,
}

/// A vehicle that keeps its lane.
#[derive(Arbitrary, Clone, Copy, Debug)]
struct Vehicle {
    name: u8,
    lane: u8,
    /// m, in units of 4.
    from: u8,
    /// m/s.
    speed: i8,
    frames: u8,
    first: u8,
    gap: Rarely<u8>,
    length: u8,
    class: u8,
    /// rad/s to the left.
    turns: Rarely<i8>,
    named: Rarely<bool>,
}

impl Traffic {
    fn header(&self) -> Vec<&'static str> {
        let optional = OPTIONAL.iter().zip(0..).filter(|(_, bit)| self.columns >> bit & 1 == 1).map(|(name, _)| *name);
        ["id", "time", "x", "y"].into_iter().chain(optional).collect()
    }

    fn lines(&self) -> Vec<Vec<String>> {
        self.vehicles.iter().flat_map(|vehicle| self.course(vehicle)).collect()
    }

    fn course(&self, vehicle: &Vehicle) -> Vec<Vec<String>> {
        let rate = f64::from([5u8, 10, 25, 30][usize::from(self.rate) % 4]);
        let road = std::f64::consts::TAU * f64::from(self.heading) / 256.;
        let [x, y] = self.far.or([0; 2]).map(|km| 1000. * f64::from(km));
        let turns = f64::from(vehicle.turns.or(0)) / 50.;
        let speed = f64::from(vehicle.speed) / 2.;
        let [mut along, mut across] = [4. * f64::from(vehicle.from), 3.6 * f64::from(vehicle.lane % 4)];
        let mut lines = Vec::new();
        for frame in 0..1 + u32::from(vehicle.frames) % 20 {
            let heading = road + turns * f64::from(frame) / rate;
            along += speed / rate * (heading - road).cos();
            across += speed / rate * (heading - road).sin();
            if vehicle.gap.0.is_some_and(|gap| u32::from(gap) % 20 == frame) {
                continue;
            }
            let time = f64::from(u32::from(vehicle.first) + frame) / rate;
            let name = if vehicle.named.or(false) { format!("car {}", vehicle.name) } else { vehicle.name.to_string() };
            let position = [along * road.cos() - across * road.sin(), along * road.sin() + across * road.cos()];
            let mut line =
                vec![name, format!("{time:.4}"), format!("{:.3}", x + position[0]), format!("{:.3}", y + position[1])];
            let optional = [
                format!("{heading:.4}"),
                format!("{speed}"),
                format!("{:.4}", speed * heading.cos()),
                format!("{:.4}", speed * heading.sin()),
                format!("{}", vehicle.length % 24),
                format!("{}", 1 + vehicle.lane % 4),
                CLASSES[usize::from(vehicle.class) % CLASSES.len()].to_owned(),
            ];
            line.extend(
                optional.into_iter().zip(0..).filter(|(_, bit)| self.columns >> bit & 1 == 1).map(|(cell, _)| cell),
            );
            lines.push(line);
        }
        lines
    }
}

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    if kind == b'p' {
        let file = scratch.only("case.parquet", rest)?;
        reads(scratch, &file, Dataset::TRACKS)?;
        return reads(scratch, &file, Dataset::AV2);
    }
    if matches!(kind, b'a' | b't' | b'z' | b'g') {
        let (name, content) = as_table(kind, rest)?;
        let file = scratch.only(name, &content)?;
        return reads(scratch, &file, Dataset::TRACKS);
    }
    let Ok(traffic) = Traffic::arbitrary(&mut Unstructured::new(rest)) else { return Ok(()) };
    let (name, content) = traffic.style.write("case.csv", &traffic.header(), &traffic.lines())?;
    let file = scratch.only(&name, &content)?;
    reads(scratch, &file, Dataset::TRACKS)
}

/// A table as text, the same as Parquet, and a scenario.
fn seeds(_: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let vehicle = |name: u8, lane: u8, from: u8| Vehicle {
        name,
        lane,
        from,
        speed: 50,
        frames: 11,
        first: 0,
        gap: Rarely(None),
        length: 5,
        class: 0,
        turns: Rarely(None),
        named: Rarely(None),
    };
    let vehicles = [vehicle(1, 0, 10), vehicle(2, 1, 20), vehicle(3, 1, 60), vehicle(4, 2, 9)];
    let traffic =
        |columns| Traffic { heading: 20, rate: 1, far: Rarely(None), columns, vehicles, style: Style::default() };
    let text = |columns: u8| {
        let traffic = traffic(columns);
        let (_, text) = traffic.style.write("", &traffic.header(), &traffic.lines())?;
        Ok::<_, Finding>([b"a", &text[..]].concat())
    };
    let plain = packed(&["id", "time", "x", "y"], &traffic(0).lines()).map_err(Finding::case)?;
    let names = [
        "track_id",
        "timestep",
        "position_x",
        "position_y",
        "heading",
        "speed",
        "velocity_x",
        "velocity_y",
        "object_type",
    ];
    let scenario = |mut line: Vec<String>| {
        line[1] = line[1].parse().map(|time: f64| (10. * time).to_string()).unwrap_or_default();
        line.push("vehicle".to_owned());
        line
    };
    let scenario: Vec<Vec<String>> = traffic(0b1111).lines().into_iter().map(scenario).collect();
    let scenario = packed(&names, &scenario).map_err(Finding::case)?;
    Ok(vec![text(0)?, text(0b11)?, text(0b111_1100)?, [b"p", &plain[..]].concat(), [b"p", &scenario[..]].concat()])
}

/// Lines as Parquet: the first and, where it is called so, the last column as text.
fn packed(names: &[&str], lines: &[Vec<String>]) -> Result<Vec<u8>, ParquetError> {
    let is_text = |name: &str| matches!(name, "id" | "track_id" | "object_type");
    let declared = |name: &&str| {
        let of = if is_text(name) { ["binary", "(STRING)"] } else { ["double", ""] };
        format!("required {} {name} {};", of[0], of[1])
    };
    let columns: String = names.iter().map(declared).collect();
    let schema = Arc::new(parse_message_type(&format!("message schema {{ {columns} }}"))?);
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::default())?;
    let mut group = writer.next_row_group()?;
    for (i, name) in names.iter().enumerate() {
        let Some(mut column) = group.next_column()? else { continue };
        let cells = || lines.iter().map(|line| line.get(i).map_or("", String::as_str));
        if is_text(name) {
            let cells: Vec<ByteArray> = cells().map(ByteArray::from).collect();
            column.typed::<ByteArrayType>().write_batch(&cells, None, None)?;
        } else {
            let cells: Vec<f64> = cells().map(|cell| cell.parse().unwrap_or(0.)).collect();
            column.typed::<DoubleType>().write_batch(&cells, None, None)?;
        }
        column.close()?;
    }
    group.close()?;
    writer.into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::table_text::read_all;

    #[test]
    fn every_seed_is_read() {
        let scratch = Scratch::new().unwrap();
        for (i, seed) in seeds(&scratch).unwrap().iter().enumerate() {
            let (name, dataset) = match i {
                0..=2 => ("case.csv", Dataset::TRACKS),
                3 => ("case.parquet", Dataset::TRACKS),
                _ => ("case.parquet", Dataset::AV2),
            };
            let file = scratch.only(name, &seed[1..]).unwrap();
            let read = read_all(&file, dataset).unwrap();
            assert_eq!((read.len(), read[0].0.len()), (1, 48), "{i}");
        }
    }
}
