//! SUMO's floating car data.
use crate::error::SimulationError;
use gnp_data::{Recording, VehicleClass};
use std::io::{self, Write};

/// Writes a recording as the XML that SUMO calls floating car data (`--fcd-output`): every vehicle in every frame, with the
/// middle of its front bumper, and angles clockwise from north, where x points east.
///
/// Lanes are `section_0` and on from the right, as SUMO counts them; carriageways are told apart by their index where there
/// are several: `section1_0`.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_fcd(recording: &Recording, out: &mut dyn Write) -> Result<(), SimulationError> {
    write(recording, out).map_err(|source| SimulationError::Write { path: "floating car data".into(), source })
}

fn write(recording: &Recording, out: &mut dyn Write) -> io::Result<()> {
    let columns = recording.columns();
    let rate = recording.meta().rate_hz;
    let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
    let last = recording.tracks().iter().map(|track| track.last_frame()).max().unwrap_or(0);
    let several = recording.roads().len() > 1;
    writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fcd-export>")?;
    for frame in first..=last {
        writeln!(out, "  <timestep time=\"{:.2}\">", f64::from(frame) / rate)?;
        for &index in recording.present(frame) {
            let track = &recording.tracks()[index as usize];
            let Some(row) = track.row_at(frame) else { continue };
            let (x, y, vx, vy) = (columns.x[row], columns.y[row], columns.vx[row], columns.vy[row]);
            let road = &recording.roads()[usize::from(track.road)];
            let lanes = road.lines.len().saturating_sub(1).max(1);
            let lane = road.lines.iter().filter(|line| line.y <= y).count().saturating_sub(1).min(lanes - 1);
            let section = if several { format!("section{}", track.road) } else { "section".to_owned() };
            let kind = match track.class {
                VehicleClass::Truck => "truck",
                VehicleClass::Motorcycle => "motorcycle",
                VehicleClass::Car => "car",
            };
            let (front, angle) = (x + track.length / 2., 90. - vy.atan2(vx).to_degrees());
            writeln!(
                out,
                "    <vehicle id=\"{}\" x=\"{front:.2}\" y=\"{y:.2}\" angle=\"{angle:.2}\" type=\"{kind}\" \
                 speed=\"{:.2}\" pos=\"{front:.2}\" lane=\"{section}_{lane}\" slope=\"0.00\"/>",
                track.vehicle,
                vx.hypot(vy),
            )?;
        }
        writeln!(out, "  </timestep>")?;
    }
    writeln!(out, "</fcd-export>")
}
