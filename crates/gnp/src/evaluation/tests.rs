//! Which windows densities are fitted to.

use std::collections::BTreeMap;

use gnp_data::{Columns, Dataset, Recording, RecordingMeta, Road, SLOTS, SplitKind, Track, WindowConfig};

use super::*;

const RATE_HZ: f64 = 2.;

/// Twenty vehicles at 20 m/s, 50 m apart and of different sizes, for 4 s.
pub(super) fn recording(name: &str) -> Recording {
    let mut columns = Columns::default();
    let mut tracks = Vec::new();
    for vehicle in 1..=20u32 {
        let start = columns.x.len();
        for frame in 0..9 {
            columns.x.push(50. * vehicle as f32 + 10. * frame as f32);
            columns.y.push(2.);
            columns.vx.push(20.);
            columns.vy.push(0.);
            columns.lane.push(1);
            columns.neighbours.push([u32::MAX; SLOTS]);
        }
        let size = [4. + 0.1 * vehicle as f32, 1.8 + 0.01 * vehicle as f32];
        tracks.push(Track::new(vehicle, size, 100, start..columns.x.len()));
    }
    let meta = RecordingMeta::new(Dataset::NGSIM, "site", name, RATE_HZ);
    let road = Road { driving_direction: 2, lines: Vec::new(), fitted: true, axis: None };
    Recording::from_parts(meta, vec![road], tracks, columns).unwrap()
}

/// One window a vehicle.
pub(super) fn windows() -> WindowConfig {
    WindowConfig { observed_s: 2., predicted_s: 2., rate_hz: RATE_HZ, stride_s: 10., site_stride_s: BTreeMap::new() }
}

#[test]
fn densities_are_fitted_to_the_validation_part_unless_it_is_scored() {
    let recordings = [recording("a")];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let config = SplitConfig {
        kind: SplitKind::Vehicle,
        sites: BTreeMap::new(),
        train: 0.5,
        validation: 0.25,
        test: 0.25,
        seed: 1,
        folds: 1,
        fold: 1,
    };
    let split = Split::new(&set, &config, &[]).unwrap();
    assert!(!split.validation().is_empty());
    for scored in [Subset::Test, Subset::Train] {
        assert_eq!(fitting(&set, &split, scored).map(|(_, ids)| ids), Some(split.validation()));
    }
    assert!(fitting(&set, &split, Subset::Validation).is_none());
    assert!(fitting(&set, &Split::all_test(&set), Subset::Test).is_none(), "there is no validation part");
}
