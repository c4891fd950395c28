//! Tables of NGSIM: made-up traffic in every layout, and any text.

use arbitrary::{Arbitrary, Unstructured};
use gnp_data::Dataset;

use super::table_text::{as_table, reads};
use crate::made::{Rarely, kind};
use crate::table::Style;
use crate::{Finding, Scratch, Target};

pub(super) const TARGET: Target = Target {
    name: "ngsim",
    about: "tables of NGSIM in 18, 19 or 25 columns, to recordings and forecasts",
    run,
    seeds,
    words: &[
        "Vehicle_ID",
        "Local_Y",
        "Global_Time",
        "Lane_ID",
        "Preceding",
        "Location",
        "us-101",
        "i-80",
        "lankershim",
    ],
};

/// What comes before and after the 18 columns of a period.
#[derive(Arbitrary, Clone, Copy, Debug, PartialEq)]
enum Layout {
    Period,
    Located,
    Merged,
}

const COLUMNS: [&str; 18] = [
    "Vehicle_ID",
    "Frame_ID",
    "Total_Frames",
    "Global_Time",
    "Local_X",
    "Local_Y",
    "Global_X",
    "Global_Y",
    "v_Length",
    "v_Width",
    "v_Class",
    "v_Vel",
    "v_Acc",
    "Lane_ID",
    "Preceding",
    "Following",
    "Space_Headway",
    "Time_Headway",
];

const MERGED: [&str; 6] = ["O_Zone", "D_Zone", "Int_ID", "Section_ID", "Direction", "Movement"];

const SITES: [&str; 4] = ["us-101", "i-80", "lankershim", "US-101"];

/// Traffic, and how it is written.
#[derive(Arbitrary, Clone, Debug)]
struct Traffic {
    layout: Layout,
    count: u8,
    vehicles: [Vehicle; 4],
    style: Style,
}

/// A vehicle that keeps its lane.
#[derive(Arbitrary, Clone, Copy, Debug)]
struct Vehicle {
    id: u8,
    lane: u8,
    first_frame: u8,
    frames: u8,
    /// Local_Y of its first frame, in units of 4 ft.
    from: u8,
    /// ft a frame.
    step: u8,
    class: u8,
    length: u8,
    leader: Rarely<u8>,
    gap: Rarely<u8>,
    site: Rarely<u8>,
    /// Later by so many minutes.
    period: Rarely<u8>,
    /// Frames backwards.
    reversed: Rarely<bool>,
}

impl Traffic {
    /// Three vehicles on two lanes.
    fn plain(layout: Layout) -> Self {
        let vehicle = |id, lane, from| Vehicle {
            id,
            lane,
            first_frame: 3,
            frames: 8,
            from,
            step: 5,
            class: 1,
            length: 15,
            leader: Rarely(None),
            gap: Rarely(None),
            site: Rarely(None),
            period: Rarely(None),
            reversed: Rarely(None),
        };
        let vehicles = [vehicle(1, 0, 10), vehicle(2, 1, 20), vehicle(3, 1, 60), vehicle(4, 2, 9)];
        Self { layout, count: 2, vehicles, style: Style::default() }
    }

    fn lines(&self) -> Vec<Vec<String>> {
        let count = 1 + usize::from(self.count) % self.vehicles.len();
        self.vehicles[..count].iter().flat_map(|vehicle| vehicle.lines(self.layout)).collect()
    }

    fn header(&self) -> Vec<&'static str> {
        let mut header = COLUMNS.to_vec();
        if self.layout == Layout::Merged {
            header.splice(14..14, MERGED);
        }
        if self.layout != Layout::Period {
            header.push("Location");
        }
        header
    }
}

impl Vehicle {
    fn lines(&self, layout: Layout) -> Vec<Vec<String>> {
        let mut frames: Vec<u32> = (0..1 + u32::from(self.frames) % 20).collect();
        frames.retain(|frame| self.gap.0.is_none_or(|gap| *frame != u32::from(gap) % 20));
        if self.reversed.or(false) {
            frames.reverse();
        }
        frames.into_iter().map(|frame| self.line(frame, layout)).collect()
    }

    fn line(&self, since: u32, layout: Layout) -> Vec<String> {
        let frame = u32::from(self.first_frame) + since;
        let time = 1_118_846_980_000 + 100 * i64::from(frame) + 60_000 * i64::from(self.period.or(0));
        let lane = 1 + self.lane % 8;
        let x = 12. * f64::from(lane) - 6.;
        let y = 4. * f64::from(self.from) + f64::from(self.step % 12) * f64::from(since);
        let (length, class) = (5 + self.length % 60, 1 + self.class % 3);
        let (leader, headway) = self.leader.0.map_or((0, 0.), |leader| (u32::from(leader), 50.));
        let speed = 10. * f64::from(self.step % 12);
        let text = format!(
            "{},{frame},99,{time},{x:.3},{y:.3},6451137.641,1873344.962,{length}.0,6.6,{class},{speed},0.5,{lane},\
             {leader},0,{headway:.2},0",
            1 + u32::from(self.id)
        );
        let mut cells: Vec<String> = text.split(',').map(str::to_owned).collect();
        if layout == Layout::Merged {
            cells.splice(14..14, ["1", "2", "0", "0", "2", "1"].map(str::to_owned));
        }
        if layout != Layout::Period {
            cells.push(SITES[usize::from(self.site.or(0)) % SITES.len()].to_owned());
        }
        cells
    }
}

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    if matches!(kind, b'a' | b't' | b'z' | b'g') {
        let (name, content) = as_table(kind, rest)?;
        let file = scratch.only(name, &content)?;
        return reads(scratch, &file, Dataset::NGSIM);
    }
    let Ok(traffic) = Traffic::arbitrary(&mut Unstructured::new(rest)) else { return Ok(()) };
    let name = if kind.is_multiple_of(2) { "case.csv" } else { "case.txt" };
    let (name, content) = traffic.style.write(name, &traffic.header(), &traffic.lines())?;
    let file = scratch.only(&name, &content)?;
    reads(scratch, &file, Dataset::NGSIM)
}

/// Each layout as text.
fn seeds(_: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let seed = |layout| {
        let traffic = Traffic::plain(layout);
        let (_, text) = traffic.style.write("", &traffic.header(), &traffic.lines())?;
        Ok([b"a", &text[..]].concat())
    };
    [Layout::Period, Layout::Located, Layout::Merged].into_iter().map(seed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::table_text::read_all;

    #[test]
    fn one_vehicle_of_eleven_is_left_out() {
        let scratch = Scratch::new().unwrap();
        let input = std::fs::read(TARGET.folder().join("eleven-vehicles-one-left-out")).unwrap();
        let file = scratch.only("case.csv", &input[1..]).unwrap();
        let read = read_all(&file, Dataset::NGSIM).unwrap();
        assert_eq!((read.len(), read[0].0.tracks().len()), (1, 10));
    }
}
