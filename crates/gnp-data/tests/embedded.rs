//! Windows and splits of the embedded recordings.

#![allow(clippy::unwrap_used)] // also outside the test functions

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use gnp_data::{
    Dataset, Drivers, Expectation, Recording, Slot, Split, SplitConfig, SplitKind, Subset, WindowConfig, WindowId,
    WindowSet, discover, groups, overlaps, read,
};

fn embedded(folder: &str, dataset: Dataset) -> Vec<Recording> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(folder);
    let expect = Expectation { dataset, rate_hz: None };
    let sources = discover(&folder, dataset).unwrap();
    sources.iter().flat_map(|source| read(source, &expect).unwrap()).map(|(recording, _)| recording).collect()
}

fn split_config(kind: SplitKind, sites: BTreeMap<String, SplitKind>) -> SplitConfig {
    SplitConfig { kind, sites, train: 0.7, validation: 0.1, test: 0.2, seed: 1, folds: 1, fold: 1 }
}

#[test]
fn ngsim_scenes_are_held_out_whole_and_i_80_by_vehicle() {
    let recordings = embedded("ngsim", Dataset::NGSIM);
    let config = WindowConfig {
        observed_s: 3.,
        predicted_s: 5.,
        rate_hz: 10.,
        stride_s: 0.2,
        site_stride_s: Default::default(),
    };
    let (set, drops) = WindowSet::cut(&recordings, &config).unwrap();
    let total = drops.total();
    assert_eq!(total.candidates, set.len() + total.gap + total.track_too_short + total.past_track_end);
    let overlaps = overlaps(&recordings);
    assert!(!overlaps.is_empty(), "several scenes were cut from the same minutes");
    let sites = BTreeMap::from([("i-80".to_owned(), SplitKind::Vehicle)]);
    for seed in 0..5 {
        let config = SplitConfig { seed, ..split_config(SplitKind::Recording, sites.clone()) };
        let split = Split::new(&set, &config, &overlaps).unwrap();
        assert!(!split.leaks() && split.dropped_at_boundary().is_empty());
        let names = Subset::ALL.map(|part| {
            let windows = split.subset(part).iter().map(|id| set.get(*id).unwrap().key());
            let us_101 = windows.filter(|key| key.recording.starts_with("us101"));
            us_101.map(|key| (key.recording, key.vehicle)).collect::<BTreeSet<_>>()
        });
        // The shares are of vehicles. Ten scenes with the same drivers hold half of them, so that shares are met roughly.
        let counts = names.each_ref().map(BTreeSet::len);
        let total: usize = counts.iter().sum();
        for (count, share) in counts.into_iter().zip([0.7, 0.1, 0.2]) {
            let found = count as f64 / total as f64;
            assert!((found - share).abs() < 0.15, "seed {seed}: {counts:?} of {total}");
        }
        let scenes = names.map(|vehicles| BTreeSet::from_iter(vehicles.into_iter().map(|(scene, _)| scene)));
        for overlap in &overlaps {
            let parts = scenes.iter().filter(|s| s.contains(&overlap.first) || s.contains(&overlap.second)).count();
            assert_eq!(parts, 1, "seed {seed}: {overlap:?}");
        }
        let vehicles = Subset::ALL.map(|part| {
            let windows = split.subset(part).iter().map(|id| set.get(*id).unwrap());
            let i_80 = windows.filter(|window| window.observation().site() == "i-80");
            BTreeSet::from_iter(i_80.map(|window| window.key().vehicle)).len()
        });
        assert_eq!(vehicles, [70, 10, 20], "seed {seed}");
    }
}

#[test]
fn simulated_recordings_give_windows_of_a_full_three_seconds() {
    let recordings = embedded("highd", Dataset::HIGHD);
    assert!(recordings.iter().all(|recording| recording.meta().simulated));
    assert_eq!(overlaps(&recordings), [], "vehicles are numbered anew in each, and their sizes are few");
    let config =
        WindowConfig { observed_s: 3., predicted_s: 5., rate_hz: 25., stride_s: 1., site_stride_s: Default::default() };
    let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
    assert_eq!((set.shape().t_obs, set.shape().t_pred), (76, 125));
    for kind in [SplitKind::Recording, SplitKind::Vehicle, SplitKind::Time] {
        let split = Split::new(&set, &split_config(kind, BTreeMap::new()), &[]).unwrap();
        let count: usize = Subset::ALL.iter().map(|part| split.subset(*part).len()).sum();
        assert!(split.dropped_drivers().is_empty(), "{kind:?}: numbers mean other vehicles in each recording");
        assert_eq!(count + split.dropped_at_boundary().values().sum::<usize>(), set.len(), "{kind:?}");
    }
    // Everybody drives forward, on both carriageways.
    assert!(set.iter().all(|window| window.truth().goal()[0] > 0.));
}

#[test]
fn every_i_80_window_has_a_leader_and_most_are_named() {
    let recordings = embedded("ngsim", Dataset::NGSIM);
    let config =
        WindowConfig { observed_s: 3., predicted_s: 5., rate_hz: 10., stride_s: 1., site_stride_s: Default::default() };
    let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
    let i_80 = set.iter().map(|window| window.observation()).filter(|it| it.site() == "i-80");
    let leaders: Vec<_> = i_80.map(|it| (it.neighbour(Slot::Preceding), it.leader())).collect();
    let share = |count: usize| count as f64 / leaders.len() as f64;
    let recorded = share(leaders.iter().filter(|(slot, _)| slot.is_some()).count());
    let known: Vec<_> = leaders.iter().filter_map(|(_, leader)| *leader).collect();
    assert!((0.85..0.95).contains(&recorded) && share(known.len()) > 0.99, "{recorded}, {}", share(known.len()));
    // More than half of them are nearer than whoever is recorded.
    let named: Vec<_> = known.iter().filter(|leader| leader.recorded().is_none()).collect();
    assert!((0.5..0.6).contains(&share(named.len())), "{}", share(named.len()));
    // They drive as vehicles do: m, m/s.
    let (mut gaps, mut speeds): (Vec<f32>, Vec<f32>) = named.iter().map(|it| (it.now().x, it.now().vx)).unzip();
    let median = |values: &mut Vec<f32>| {
        values.sort_by(f32::total_cmp);
        values[values.len() / 2]
    };
    assert!((10. ..25.).contains(&median(&mut gaps)) && (6. ..12.).contains(&median(&mut speeds)));
}

#[test]
fn us_101_scenes_with_the_same_drivers_stay_together() {
    let recordings = embedded("ngsim", Dataset::NGSIM);
    let overlaps = overlaps(&recordings);
    let mut together: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    for (recording, group) in recordings.iter().zip(groups(&recordings, &overlaps)) {
        together.entry(group).or_default().push(scene_number(&recording.meta().name));
    }
    for numbers in together.values_mut() {
        numbers.sort_unstable();
    }
    let mut found: Vec<Vec<u32>> = together.into_values().collect();
    found.sort();
    // 0 is I-80.
    let expected: [&[u32]; 6] = [&[0], &[3, 4, 6, 7, 12, 15, 18, 19, 20, 28], &[10], &[13, 23, 24, 26], &[16], &[21]];
    assert_eq!(found, expected);
    let said: Vec<String> = overlaps.iter().map(ToString::to_string).collect();
    assert!(said.contains(&"us101-24_1 and us101-26_1 have 26 drivers in common".to_owned()), "{said:#?}");
}

#[test]
fn a_us_101_driver_is_the_same_in_every_scene() {
    let recordings = embedded("ngsim", Dataset::NGSIM);
    let overlaps = overlaps(&recordings);
    let drivers = Drivers::of(&recordings, &overlaps);
    let mut by_number: BTreeMap<(String, u32), BTreeSet<usize>> = BTreeMap::new();
    let mut numbers: BTreeMap<usize, BTreeSet<(String, u32)>> = BTreeMap::new();
    for (r, recording) in recordings.iter().enumerate() {
        for (t, track) in recording.tracks().iter().enumerate() {
            let (name, driver) = ((recording.meta().site.clone(), track.vehicle), drivers.driver(r, t).unwrap());
            by_number.entry(name.clone()).or_default().insert(driver);
            numbers.entry(driver).or_default().insert(name);
        }
    }
    // Also where two scenes share one driver, as 12 and 16.
    assert_eq!(by_number.keys().filter(|(site, _)| site == "us-101").count(), 327);
    assert!(by_number.values().all(|drivers| drivers.len() == 1), "a number is one driver");
    assert!(numbers.values().all(|numbers| numbers.len() == 1), "a driver has one number");
    let mut events: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    for (r, recording) in recordings.iter().enumerate() {
        for event in BTreeSet::from_iter((0..recording.tracks().len()).map(|track| drivers.event(r, track).unwrap())) {
            events.entry(event).or_default().push(scene_number(&recording.meta().name));
        }
    }
    let mut found: Vec<Vec<u32>> = events.into_values().collect();
    found.iter_mut().for_each(|numbers| numbers.sort_unstable());
    found.sort();
    // I-80 is ten minutes long, and its vehicles come in the first five.
    assert_eq!(found[..5], [[0]; 5]);
    let us_101: [&[u32]; 5] = [&[3, 4, 6, 7, 12, 15, 18, 19, 20, 28], &[10], &[13, 23, 24, 26], &[16], &[21]];
    assert_eq!(found[5..], us_101);
    assert_eq!((drivers.driver(99, 0), drivers.event(0, 10_000)), (None, None));
}

/// Number in the name of a scene of US-101, 0 for I-80.
fn scene_number(name: &str) -> u32 {
    name.trim_start_matches("us101-").trim_end_matches("_1").parse().unwrap_or(0)
}

#[test]
fn over_the_folds_no_driver_is_tested_twice_or_in_two_parts() {
    let recordings = embedded("ngsim", Dataset::NGSIM);
    let config =
        WindowConfig { observed_s: 3., predicted_s: 5., rate_hz: 10., stride_s: 1., site_stride_s: Default::default() };
    let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
    let overlaps = overlaps(&recordings);
    let sites = BTreeMap::from([("i-80".to_owned(), SplitKind::Vehicle)]);
    // By number and size, which is what they are known by on these sites.
    let driver = |id: &WindowId| {
        let recording = set.recording(*id).unwrap();
        let track = &recording.tracks()[id.track as usize];
        (recording.meta().site.clone(), track.vehicle, track.length.to_bits(), track.width.to_bits())
    };
    let mut tested = BTreeSet::new();
    let mut dropped = BTreeSet::new();
    for fold in 1..=3 {
        let config = SplitConfig { folds: 3, fold, ..split_config(SplitKind::Recording, sites.clone()) };
        let split = Split::new(&set, &config, &overlaps).unwrap();
        let parts = Subset::ALL.map(|part| split.subset(part).iter().map(driver).collect::<BTreeSet<_>>());
        assert!(parts[0].is_disjoint(&parts[1]) && parts[0].is_disjoint(&parts[2]) && parts[1].is_disjoint(&parts[2]));
        assert!(tested.is_disjoint(&parts[2]), "fold {fold}");
        tested.extend(parts[2].iter().cloned());
        dropped.insert(split.dropped_drivers().clone());
    }
    assert_eq!(tested, set.ids().iter().map(driver).collect(), "each driver is tested once");
    assert_eq!(
        dropped,
        BTreeSet::from([BTreeMap::from([("us101-15_1".to_owned(), 1)])]),
        "the same windows are left out of every fold"
    );
}
