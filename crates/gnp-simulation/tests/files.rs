//! Files for other programs: what is written is read again.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_simulation::{Scene, Simulated, write_parquet};
use parquet::{
    file::reader::{FileReader, SerializedFileReader},
    record::RowAccessor,
};
use std::{fs::File, ops::ControlFlow};

fn simulated() -> Simulated {
    let text = r#"
        name = "few"
        duration_s = 20
        record_hz = 5
        [road]
        lanes = 2
        length_m = 2000
        [start]
        vehicles = 6
        speed_mps = 25
        [[drivers]]
        name = "lorry"
        length_m = 16.5
        width_m = 2.5
        desired_speed_mps = { mean = 25 }
    "#;
    Scene::parse(text).unwrap().run(0, &mut |_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn the_table_holds_every_row() {
    let simulated = simulated();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tracks.parquet");
    write_parquet(&simulated.recording, File::create(&path).unwrap()).unwrap();
    let reader = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
    let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
    let (recording, columns) = (&simulated.recording, simulated.recording.columns());
    assert_eq!(rows.len(), recording.len());
    for track in recording.tracks() {
        for row in track.rows.clone() {
            let frame = track.first_frame + (row - track.rows.start) as u32;
            let read = &rows[row];
            let whole = [0, 1, 7].map(|column| read.get_int(column).unwrap());
            assert_eq!(whole, [track.vehicle as i32, frame as i32, i32::from(columns.lane[row])]);
            assert!((read.get_double(2).unwrap() - f64::from(frame) / 5.0).abs() < 1e-9);
            let numbers = [3, 4, 5, 6, 8, 9].map(|column| read.get_float(column).unwrap());
            let state = recording.state(row);
            assert_eq!(numbers, [state.x, state.y, state.vx, state.vy, track.length, track.width]);
            assert_eq!(read.get_string(10).unwrap(), "truck");
        }
    }
}
