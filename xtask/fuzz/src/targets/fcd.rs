//! Floating car data of SUMO as XML and as a table of text, and the types beside them: any bytes.

use gnp_data::Dataset;

use super::table_text::reads;
use crate::made::kind;
use crate::table::pack;
use crate::{Finding, Scratch, Target};

pub(super) const TARGET: Target = Target {
    name: "fcd",
    about: "floating car data of SUMO as XML or text, or their vehicle types, to recordings and forecasts",
    run,
    seeds: |_| Ok(vec![xml(12).into_bytes(), [b"c", csv(12).as_bytes()].concat(), [b"t", TYPES.as_bytes()].concat()]),
    words: &[
        "<timestep time=\"",
        "<vehicle id=\"",
        "angle=\"",
        "lane=\"",
        "/>",
        "&amp;",
        "vType",
        "timestep_time",
        "vehicle_x",
    ],
};

/// Types beside [`xml`].
const TYPES: &str = "<additional>\n<vType id=\"car\" length=\"4.5\" width=\"1.8\"/>\n</additional>\n";

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    match kind {
        b'c' => drop(scratch.only("case.csv", rest)?),
        b'z' => drop(scratch.only("case.xml.gz", &pack(rest)?)?),
        b't' => {
            scratch.only("case.xml", xml(3).as_bytes())?;
            std::fs::write(scratch.given().join("case.add.xml"), rest)?;
        }
        // A seed of XML is its own first byte.
        _ => drop(scratch.only("case.xml", input)?),
    }
    reads(scratch, scratch.given(), Dataset::SUMO)
}

/// Three vehicles on two lanes at 10 Hz: name, front, speed, lane.
fn vehicles(frame: u32) -> [(&'static str, f64, f64, f64, u32); 3] {
    let t = 0.1 * f64::from(frame);
    [("a", 30. * t, 1.6, 30., 1), ("b.0", 20. + 24. * t, -1.6, 24., 0), ("c", 60. + 25. * t, -1.6, 25., 0)]
}

fn xml(frames: u32) -> String {
    let vehicle = |(id, x, y, speed, lane): (&str, f64, f64, f64, u32)| {
        format!(
            "<vehicle id=\"{id}\" x=\"{x:.2}\" y=\"{y:.2}\" angle=\"90\" type=\"car\" speed=\"{speed}\" lane=\"e_{lane}\"/>\n"
        )
    };
    let step = |frame: u32| {
        let all: String = vehicles(frame).into_iter().map(vehicle).collect();
        format!("<timestep time=\"{:.2}\">\n{all}</timestep>\n", 0.1 * f64::from(frame))
    };
    format!("<fcd-export>\n{}</fcd-export>\n", (0..frames).map(step).collect::<String>())
}

fn csv(frames: u32) -> String {
    let line = |frame: u32| {
        let row = move |(id, x, y, speed, lane): (&str, f64, f64, f64, u32)| {
            format!("{:.2};{id};{x:.2};{y:.2};90;car;{speed};e_{lane}\n", 0.1 * f64::from(frame))
        };
        vehicles(frame).into_iter().map(row).collect::<String>()
    };
    let header = "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle;vehicle_type;vehicle_speed;vehicle_lane\n";
    header.to_owned() + &(0..frames).map(line).collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::table_text::read_all;

    #[test]
    fn every_seed_is_read() {
        let scratch = Scratch::new().unwrap();
        for (name, content) in [("case.xml", xml(12)), ("case.csv", csv(12))] {
            scratch.only(name, content.as_bytes()).unwrap();
            std::fs::write(scratch.given().join("case.add.xml"), TYPES).unwrap();
            let read = read_all(scratch.given(), Dataset::SUMO).unwrap();
            assert_eq!((read.len(), read[0].0.len()), (1, 36), "{name}");
            assert!((read[0].0.tracks()[0].length - 4.5).abs() < 1e-6, "{name}");
        }
    }
}
