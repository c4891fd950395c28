//! A recording as a Parquet table.
use crate::error::SimulationError;
use gnp_data::{Recording, VehicleClass};
use parquet::{
    basic::Compression,
    data_type::{ByteArray, ByteArrayType, DoubleType, FloatType, Int32Type},
    errors::ParquetError,
    file::{properties::WriterProperties, writer::SerializedFileWriter},
    schema::parser::parse_message_type,
};
use std::{io::Write, sync::Arc};

/// Rows of a group.
const GROUP_ROWS: usize = 1 << 20;

const SCHEMA: &str = "message tracks {
    REQUIRED INT32 vehicle;
    REQUIRED INT32 frame;
    REQUIRED DOUBLE time_s;
    REQUIRED FLOAT x_m;
    REQUIRED FLOAT y_m;
    REQUIRED FLOAT vx_mps;
    REQUIRED FLOAT vy_mps;
    REQUIRED INT32 lane;
    REQUIRED FLOAT length_m;
    REQUIRED FLOAT width_m;
    REQUIRED BYTE_ARRAY class (UTF8);
}";

/// Writes a recording as a Parquet table, a row a vehicle and frame, by vehicle and then by frame: centres in m in the road
/// frame (x forward, y to the left), velocities in m/s, lanes numbered as in the recording.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_parquet(recording: &Recording, out: impl Write + Send) -> Result<(), SimulationError> {
    write(recording, out).map_err(|error| {
        let source = std::io::Error::other(error);
        SimulationError::Write { path: "table of tracks".into(), source }
    })
}

fn write(recording: &Recording, out: impl Write + Send) -> Result<(), ParquetError> {
    let schema = Arc::new(parse_message_type(SCHEMA)?);
    let properties = Arc::new(WriterProperties::builder().set_compression(Compression::SNAPPY).build());
    let mut file = SerializedFileWriter::new(out, schema, properties)?;
    let columns = recording.columns();
    let (rate, rows) = (recording.meta().rate_hz, columns.x.len());
    // What a track says of all of its rows, row by row.
    let mut of_track = vec![0; rows];
    for (index, track) in recording.tracks().iter().enumerate() {
        of_track[track.rows.clone()].fill(index);
    }
    for start in (0..rows).step_by(GROUP_ROWS) {
        let part = start..rows.min(start + GROUP_ROWS);
        let track = |row: usize| &recording.tracks()[of_track[row]];
        let frame = |row: usize| track(row).first_frame + (row - track(row).rows.start) as u32;
        let mut group = file.next_row_group()?;
        let mut number = 0;
        while let Some(mut column) = group.next_column()? {
            let floats = |of: &dyn Fn(usize) -> f32| part.clone().map(of).collect::<Vec<f32>>();
            let wholes = |of: &dyn Fn(usize) -> i32| part.clone().map(of).collect::<Vec<i32>>();
            match number {
                0 | 1 | 7 => {
                    let values = match number {
                        0 => wholes(&|row| track(row).vehicle as i32),
                        1 => wholes(&|row| frame(row) as i32),
                        _ => wholes(&|row| i32::from(columns.lane[row])),
                    };
                    column.typed::<Int32Type>().write_batch(&values, None, None)?;
                }
                2 => {
                    let values: Vec<f64> = part.clone().map(|row| f64::from(frame(row)) / rate).collect();
                    column.typed::<DoubleType>().write_batch(&values, None, None)?;
                }
                10 => {
                    let name = |row: usize| match track(row).class {
                        VehicleClass::Car => "car",
                        VehicleClass::Truck => "truck",
                        VehicleClass::Motorcycle => "motorcycle",
                    };
                    let values: Vec<ByteArray> = part.clone().map(|row| ByteArray::from(name(row))).collect();
                    column.typed::<ByteArrayType>().write_batch(&values, None, None)?;
                }
                _ => {
                    let values = match number {
                        3 => floats(&|row| columns.x[row]),
                        4 => floats(&|row| columns.y[row]),
                        5 => floats(&|row| columns.vx[row]),
                        6 => floats(&|row| columns.vy[row]),
                        8 => floats(&|row| track(row).length),
                        _ => floats(&|row| track(row).width),
                    };
                    column.typed::<FloatType>().write_batch(&values, None, None)?;
                }
            }
            column.close()?;
            number += 1;
        }
        group.close()?;
    }
    file.close()?;
    Ok(())
}
