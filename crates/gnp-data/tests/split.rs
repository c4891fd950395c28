//! Parts of a split: complete, apart, seeded, and kept in a file.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod scene;

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{
    DataError, Overlap, Recording, SharedBy, Split, SplitConfig, SplitKind, Subset, WindowConfig, WindowId, WindowSet,
};
use scene::{recording, short_windows};

fn config(kind: SplitKind, seed: u64) -> SplitConfig {
    SplitConfig { kind, sites: BTreeMap::new(), train: 0.7, validation: 0.1, test: 0.2, seed, folds: 1, fold: 1 }
}

/// Seventeen recordings of unequal size; every third vehicle has two snippets.
fn scenes(site: &str) -> Vec<Recording> {
    let scene = |r: u32| {
        let mut snippets = Vec::new();
        for vehicle in 1..=10 + 3 * (r % 5) {
            snippets.push((vehicle, 0, vehicle, 30 + (vehicle as usize * 7) % 40));
            if vehicle % 3 == 0 {
                snippets.push((vehicle, 1, 200 + vehicle, 25));
            }
        }
        own_sizes(recording(&format!("{site}-{r}"), site, 10., &snippets), r)
    };
    (0..17).map(scene).collect()
}

/// Vehicles without end: 400 frames each.
fn long(name: &str, site: &str, vehicles: u32) -> Recording {
    let seed = name.bytes().map(u32::from).sum();
    own_sizes(recording(name, site, 10., &(1..=vehicles).map(|v| (v, 0, 0, 400)).collect::<Vec<_>>()), seed)
}

/// The same with sizes by number and `seed`: equal numbers of recordings with different seeds are different drivers.
fn own_sizes(recording: Recording, seed: u32) -> Recording {
    resized(recording, |vehicle| {
        4. + (vehicle.wrapping_add(seed * 1000).wrapping_mul(2_654_435_761) >> 20) as f32 / 1000.
    })
}

fn resized(recording: Recording, length: impl Fn(u32) -> f32) -> Recording {
    let mut tracks = recording.tracks().to_vec();
    tracks.iter_mut().for_each(|track| track.length = length(track.vehicle));
    Recording::from_parts(recording.meta().clone(), recording.roads().to_vec(), tracks, recording.columns().clone())
        .unwrap()
}

fn all(split: &Split) -> Vec<WindowId> {
    let mut ids: Vec<WindowId> = Subset::ALL.iter().flat_map(|part| split.subset(*part)).copied().collect();
    ids.sort_unstable();
    ids
}

#[test]
fn every_window_is_in_one_part_or_counted_as_straddling() {
    let recordings = [long("a", "s", 23), long("b", "s", 11), long("c", "t", 7)];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    for kind in [SplitKind::Recording, SplitKind::Vehicle, SplitKind::Time, SplitKind::Window] {
        let split = Split::new(&set, &config(kind, 5), &[]).unwrap();
        let ids = all(&split);
        let distinct = BTreeSet::from_iter(ids.iter().copied());
        let dropped_at_boundary: usize = split.dropped_at_boundary().values().sum();
        assert_eq!(distinct.len(), ids.len(), "{kind:?}");
        assert_eq!(ids.len() + dropped_at_boundary, set.len(), "{kind:?}");
        assert_eq!(dropped_at_boundary > 0, kind == SplitKind::Time, "{kind:?}");
        assert_eq!(split.leaks(), kind == SplitKind::Window, "{kind:?}");
        assert_eq!(split.seed(), 5);
    }
}

#[test]
fn the_same_seed_gives_the_same_hash_whatever_the_order_of_recordings() {
    let forwards = scenes("s");
    let mut backwards = forwards.clone();
    backwards.reverse();
    let (forwards, _) = WindowSet::cut(&forwards, &short_windows()).unwrap();
    let (backwards, _) = WindowSet::cut(&backwards, &short_windows()).unwrap();
    for kind in [SplitKind::Recording, SplitKind::Vehicle, SplitKind::Window] {
        let hash = |set, seed| Split::new(set, &config(kind, seed), &[]).unwrap().hash().to_owned();
        assert_eq!(hash(&forwards, 3), hash(&forwards, 3), "{kind:?}");
        assert_eq!(hash(&forwards, 3), hash(&backwards, 3), "{kind:?}");
        assert_ne!(hash(&forwards, 3), hash(&forwards, 4), "{kind:?}");
    }
}

#[test]
fn the_hash_is_of_a_stated_text() {
    let recordings = [recording("a", "s", 10., &[(7, 0, 100, 11)])];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    // Of "windows 4 5 10\n2 a 7 0 103\n2 a 7 0 105\n", by another program.
    let expected = "f7fdbadd0dd97686e33f19b57bd08504cf59a37bff4db05002e274a794336d43";
    assert_eq!(Split::all_test(&set).hash(), expected);
}

#[test]
fn by_vehicle_a_hundred_are_parted_70_10_20_and_stretches_stay_together() {
    let snippets: Vec<_> = (1..=100).flat_map(|v| [(v, 0, 0, 20), (v, 1, 30, 30)]).collect();
    let recordings = [recording("a", "s", 10., &snippets)];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let split = Split::new(&set, &config(SplitKind::Vehicle, 11), &[]).unwrap();
    let vehicles = Subset::ALL
        .map(|part| BTreeSet::from_iter(split.subset(part).iter().map(|id| set.get(*id).unwrap().key().vehicle)));
    assert_eq!(vehicles.each_ref().map(BTreeSet::len), [70, 10, 20]);
    assert!(vehicles[0].is_disjoint(&vehicles[1]) && vehicles[0].is_disjoint(&vehicles[2]));
    assert!(vehicles[1].is_disjoint(&vehicles[2]));
}

#[test]
fn a_vehicle_number_of_one_recording_says_nothing_about_another() {
    let recordings = scenes("s");
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let split = Split::new(&set, &config(SplitKind::Vehicle, 2), &[]).unwrap();
    // Adding a recording does not move what was drawn for the others.
    let (fewer, _) = WindowSet::cut(&recordings[..16], &short_windows()).unwrap();
    let smaller = Split::new(&fewer, &config(SplitKind::Vehicle, 2), &[]).unwrap();
    let kept: Vec<WindowId> = split.test().iter().copied().filter(|id| id.recording < 16).collect();
    assert_eq!(kept, smaller.test());
    // Few vehicles a recording, yet the shares hold over all of them.
    let share = |part| split.subset(part).len() as f64 / set.len() as f64;
    assert!((share(Subset::Train) - 0.7).abs() < 0.05 && (share(Subset::Validation) - 0.1).abs() < 0.04);
}

#[test]
fn by_recording_recordings_stay_whole_and_shares_come_near() {
    let recordings = scenes("s");
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    for seed in 0..20 {
        let split = Split::new(&set, &config(SplitKind::Recording, seed), &[]).unwrap();
        let recordings = Subset::ALL.map(|part| BTreeSet::from_iter(split.subset(part).iter().map(|id| id.recording)));
        assert_eq!(recordings.iter().map(BTreeSet::len).sum::<usize>(), 17);
        for (part, share) in Subset::ALL.into_iter().zip([0.7, 0.1, 0.2]) {
            let got = split.subset(part).len() as f64 / set.len() as f64;
            assert!((got - share).abs() < 0.02, "seed {seed}, {part:?}: {got}");
        }
    }
}

#[test]
fn three_recordings_suffice_and_two_are_too_few() {
    let recordings = [long("a", "s", 40), long("b", "s", 3), long("c", "s", 5)];
    for seed in 0..9 {
        let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
        Split::new(&set, &config(SplitKind::Recording, seed), &[]).unwrap();
    }
    let (set, _) = WindowSet::cut(&recordings[..2], &short_windows()).unwrap();
    let error = Split::new(&set, &config(SplitKind::Recording, 1), &[]).unwrap_err();
    let message = error.to_string();
    assert!(matches!(error, DataError::EmptyPart { .. }) && message.contains("split by vehicle"), "{message}");
}

#[test]
fn by_time_parts_follow_one_another_without_a_shared_frame() {
    let recordings = [long("a", "s", 3)];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let split = Split::new(&set, &config(SplitKind::Time, 0), &[]).unwrap();
    let t0 = |part| split.subset(part).iter().map(|id| set.get(*id).unwrap().key().t0);
    // Stretches 0..280, 280..320, 320..400; a window takes 3 frames before t0 and 5 after.
    assert_eq!(t0(Subset::Train).max(), Some(273));
    assert_eq!((t0(Subset::Validation).min(), t0(Subset::Validation).max()), (Some(283), Some(313)));
    assert_eq!(t0(Subset::Test).min(), Some(323));
    assert_eq!(split.dropped_at_boundary()["a"], 3 * (4 + 4), "t0 from 275 to 281, and from 315 to 321");
}

#[test]
fn sites_may_be_parted_in_different_ways() {
    let mut recordings = scenes("us-101");
    recordings.push(long("lanes", "i-80", 100));
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let sites = BTreeMap::from([("i-80".to_owned(), SplitKind::Vehicle)]);
    let split = Split::new(&set, &SplitConfig { sites, ..config(SplitKind::Recording, 8) }, &[]).unwrap();
    for part in Subset::ALL {
        let sites = BTreeSet::from_iter(split.subset(part).iter().map(|id| set.get(*id).unwrap().observation().site()));
        assert_eq!(sites, BTreeSet::from(["i-80", "us-101"]), "{part:?}");
    }
    assert_eq!(split.kinds()["i-80"], SplitKind::Vehicle);
    assert_eq!(split.kinds()["us-101"], SplitKind::Recording);
}

#[test]
fn a_saved_split_comes_back_for_recordings_in_another_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("split.json");
    let recordings = scenes("s");
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    for kind in [SplitKind::Recording, SplitKind::Vehicle, SplitKind::Window] {
        let split = Split::new(&set, &config(kind, 21), &[]).unwrap();
        split.save(&set, &path).unwrap();
        assert_eq!(Split::load(&set, &path).unwrap(), split);

        let mut others = recordings.clone();
        others.reverse();
        others.insert(4, long("new", "t", 3));
        let (others, _) = WindowSet::cut(&others, &short_windows()).unwrap();
        let back = Split::load(&others, &path).unwrap();
        assert_eq!(back.hash(), split.hash());
        let keys = |set: &WindowSet<'_>, split: &Split| {
            BTreeSet::from_iter(split.test().iter().map(|id| set.get(*id).unwrap().key()))
        };
        assert_eq!(keys(&others, &back), keys(&set, &split));
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
}

/// A changed file with its checksum taken anew.
fn sealed(text: &str) -> String {
    let members = text.split_once("\",").unwrap().1;
    let sum = gnp_file::sha256([members.trim_end_matches('\n').as_bytes()]);
    format!("{{\"sha256\":\"{sum}\",{members}")
}

#[test]
fn a_changed_foreign_or_broken_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("split.json");
    let recordings = scenes("s");
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    Split::new(&set, &config(SplitKind::Vehicle, 21), &[]).unwrap().save(&set, &path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let load = |text: &str, set: &WindowSet<'_>| {
        std::fs::write(&path, text).unwrap();
        Split::load(set, &path).unwrap_err().to_string()
    };

    // Somebody who knows the format can take the checksum anew; windows still have their hash.
    let moved = text.replacen("\"validation\":", "\"moved\":", 1).replacen("\"test\":", "\"validation\":", 1);
    let moved = moved.replacen("\"moved\":", "\"test\":", 1);
    let under_a_new_sum = load(&sealed(&moved), &set);
    assert!(under_a_new_sum.contains("was changed"), "{under_a_new_sum}");
    for changed in [&moved, &text.replacen("\"leaks\":false", "\"leaks\":true", 1)] {
        let changed = load(changed, &set);
        assert!(changed.contains("it differs from what was written"), "{changed}");
    }
    let truncated = load(&text[..text.len() / 2], &set);
    assert!(truncated.contains("split.json"), "{truncated}");
    let (fewer, _) = WindowSet::cut(&recordings[1..], &short_windows()).unwrap();
    let missing = load(&text, &fewer);
    assert!(missing.contains("recording s-0 is not there"), "{missing}");
    let longer = WindowConfig { predicted_s: 0.6, ..short_windows() };
    let (longer, _) = WindowSet::cut(&recordings, &longer).unwrap();
    let longer = load(&text, &longer);
    assert!(longer.contains("4 + 5 frames") && longer.contains("4 + 6 frames"), "{longer}");
    let newer = load(&sealed(&text.replacen("\"version\":3", "\"version\":4", 1)), &set);
    assert!(newer.contains("version 4"), "{newer}");
    std::fs::remove_file(&path).unwrap();
    assert!(matches!(Split::load(&set, &path), Err(DataError::Io { .. })));
}

#[test]
fn the_check_finds_windows_that_share_a_frame_across_parts() {
    // A split by window, relabelled as any kind that must not leak, has the right hash and is caught.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("split.json");
    let recordings = [long("a", "s", 3), long("b", "s", 3), long("c", "s", 3)];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let leaking = Split::new(&set, &config(SplitKind::Window, 1), &[]).unwrap();
    leaking.save(&set, &path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    for kind in ["recording", "vehicle", "time"] {
        std::fs::write(&path, sealed(&text.replace("\"s\":\"window\"", &format!("\"s\":\"{kind}\"")))).unwrap();
        let error = Split::load(&set, &path).unwrap_err();
        assert!(matches!(error, DataError::SharedFrame { .. }), "{kind}: {error}");
    }
    // By time is not by vehicle: frames are apart, but a vehicle stands in two parts.
    Split::new(&set, &config(SplitKind::Time, 1), &[]).unwrap().save(&set, &path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, sealed(&text.replace("\"s\":\"time\"", "\"s\":\"vehicle\""))).unwrap();
    assert!(matches!(Split::load(&set, &path), Err(DataError::SharedFrame { vehicle: 1, .. })));
    // By vehicle is not by recording.
    Split::new(&set, &config(SplitKind::Vehicle, 1), &[]).unwrap().save(&set, &path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, sealed(&text.replace("\"s\":\"vehicle\"", "\"s\":\"recording\""))).unwrap();
    assert!(matches!(Split::load(&set, &path), Err(DataError::SharedFrame { .. })));
    // And against other recordings it is refused.
    let other = [recording("a", "s", 10., &[(1, 0, 0, 9)])];
    let (other, _) = WindowSet::cut(&other, &short_windows()).unwrap();
    assert!(matches!(leaking.check(&other), Err(DataError::ForeignSplit)));
}

#[test]
fn all_test_has_every_window_and_nothing_to_learn_from() {
    let recordings = scenes("s");
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let split = Split::all_test(&set);
    assert_eq!((split.train().len(), split.validation().len()), (0, 0));
    assert_eq!(split.test(), set.ids());
    assert!(!split.leaks());
    split.check(&set).unwrap();
}

#[test]
fn shares_that_cannot_be_are_refused() {
    let good = config(SplitKind::Vehicle, 0);
    for (bad, key) in [
        (SplitConfig { train: 0.8, ..good.clone() }, "train"),
        (SplitConfig { validation: 0., test: 0.3, ..good.clone() }, "validation"),
        (SplitConfig { test: f64::NAN, ..good.clone() }, "test"),
        (SplitConfig { validation: 0.3, test: 0., folds: 3, ..good.clone() }, "test"),
        (SplitConfig { train: -0.7, ..good.clone() }, "train"),
        (SplitConfig { folds: 3, fold: 4, ..good.clone() }, "fold"),
        (SplitConfig { fold: 0, ..good.clone() }, "fold"),
        (SplitConfig { folds: 0, ..good.clone() }, "folds"),
        (SplitConfig { kind: SplitKind::Time, folds: 3, ..good.clone() }, "folds"),
    ] {
        let error = bad.check().unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
    good.check().unwrap();
}

#[test]
fn with_no_share_to_test_everything_trains_or_validates() {
    let recordings = scenes("s");
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    for kind in [SplitKind::Recording, SplitKind::Vehicle, SplitKind::Window] {
        let config = SplitConfig { train: 0.9, validation: 0.1, test: 0., ..config(kind, 3) };
        let split = Split::new(&set, &config, &[]).unwrap();
        assert!(split.test().is_empty() && !split.validation().is_empty(), "{kind:?}");
        assert_eq!(split.train().len() + split.validation().len(), set.len(), "{kind:?}");
        let share = split.train().len() as f64 / set.len() as f64;
        assert!((0.8..0.97).contains(&share), "{kind:?}: {share}");
    }
}

#[test]
fn over_the_folds_each_window_is_tested_once_and_overlapping_scenes_stay_together() {
    let mut recordings = scenes("s");
    recordings.push(long("t-0", "t", 12));
    let overlaps = [overlap(2, 9), overlap(9, 14)];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let sites = BTreeMap::from([("t".to_owned(), SplitKind::Vehicle)]);
    let mut tested = Vec::new();
    for fold in 1..=3 {
        let config = SplitConfig { sites: sites.clone(), folds: 3, fold, ..config(SplitKind::Recording, 3) };
        let split = Split::new(&set, &config, &overlaps).unwrap();
        assert_eq!(all(&split).len(), set.len());
        let group = split.test().iter().filter(|id| [2, 9, 14].contains(&id.recording)).count();
        let whole = set.ids().iter().filter(|id| [2, 9, 14].contains(&id.recording)).count();
        assert!(group == 0 || group == whole, "{group} of {whole}");
        tested.extend_from_slice(split.test());
    }
    tested.sort_unstable();
    let mut every = set.ids().to_vec();
    every.sort_unstable();
    assert_eq!(tested, every);
}

/// Recordings `s-first` and `s-second` show the same vehicles.
fn overlap(first: usize, second: usize) -> Overlap {
    let name = |index| format!("s-{index}");
    Overlap { first: name(first), second: name(second), site: "s".into(), vehicles: 3, found: SharedBy::Drivers }
}

#[test]
fn recordings_that_show_the_same_vehicles_stay_together() {
    let mut recordings = scenes("s");
    let overlaps = [overlap(2, 9), overlap(9, 14), overlap(3, 4)];
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let mut parted = 0;
    for seed in 0..20 {
        let part_of = |split: &Split, recording: u32| {
            Subset::ALL.into_iter().find(|part| split.subset(*part).iter().any(|id| id.recording == recording)).unwrap()
        };
        let split = Split::new(&set, &config(SplitKind::Recording, seed), &overlaps).unwrap();
        assert_eq!(part_of(&split, 2), part_of(&split, 9));
        assert_eq!(part_of(&split, 9), part_of(&split, 14));
        assert_eq!(part_of(&split, 3), part_of(&split, 4));
        assert!(!split.leaks());
        let unaware = Split::new(&set, &config(SplitKind::Recording, seed), &[]).unwrap();
        parted += usize::from(part_of(&unaware, 2) != part_of(&unaware, 9));
    }
    assert!(parted > 0, "told nothing, some seed parts them");

    let hash = Split::new(&set, &config(SplitKind::Recording, 6), &overlaps).unwrap().hash().to_owned();
    recordings.reverse();
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let split = Split::new(&set, &config(SplitKind::Recording, 6), &overlaps).unwrap();
    assert_eq!(split.hash(), hash, "whatever the order of recordings");
}

#[test]
fn an_overlap_that_is_not_kept_together_is_called_a_leak_and_kept_in_the_file() {
    let long = [long("s-0", "s", 23), long("s-1", "s", 11)];
    let (set, _) = WindowSet::cut(&long, &short_windows()).unwrap();
    let by_time = |overlaps: &[Overlap]| Split::new(&set, &config(SplitKind::Time, 1), overlaps).unwrap().leaks();
    assert_eq!((by_time(&[]), by_time(&[overlap(0, 1)])), (false, true));

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("split.json");
    let recordings = scenes("s");
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let split = Split::new(&set, &config(SplitKind::Vehicle, 1), &[overlap(2, 9)]).unwrap();
    assert!(!split.leaks(), "drivers are kept together");
    split.save(&set, &path).unwrap();
    let back = Split::load(&set, &path).unwrap();
    assert_eq!(back, split);
    assert_eq!(back.overlaps(), [overlap(2, 9)]);

    // A split by recording that was made without knowing of them does not pass once they are known.
    let parted = (0..20).find_map(|seed| {
        let split = Split::new(&set, &config(SplitKind::Recording, seed), &[]).unwrap();
        let apart = |id: &&WindowId| id.recording == 2 || id.recording == 9;
        (split.train().iter().find(apart).is_some() && split.test().iter().find(apart).is_some()).then_some(split)
    });
    parted.unwrap().save(&set, &path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let known = format!("\"overlaps\":[{}]", serde_json::to_string(&overlap(2, 9)).unwrap());
    std::fs::write(&path, sealed(&text.replace("\"overlaps\":[]", &known))).unwrap();
    let error = Split::load(&set, &path).unwrap_err();
    assert!(matches!(error, DataError::SharedVehicles { .. }), "{error}");
}

/// Twelve recordings of six drivers each, numbered through; driver 1 is in the first two as well, with more windows in the
/// second, driver 20 in the fourth and, as often, in the seventh.
fn with_shared_drivers() -> Vec<Recording> {
    let of = |r: u32| {
        let mut snippets: Vec<_> = (1..=6).map(|v| (6 * r + v, 0, 0, 40)).collect();
        match r {
            0 => snippets[0].3 = 20,
            1 => snippets.insert(0, (1, 0, 100, 40)),
            6 => snippets.insert(0, (20, 0, 100, 40)),
            _ => {}
        }
        resized(recording(&format!("s-{r:02}"), "s", 10., &snippets), |vehicle| 4. + vehicle as f32 / 16.)
    };
    (0..12).map(of).collect()
}

#[test]
fn a_driver_of_recordings_that_are_not_kept_together_stays_where_it_has_most_windows() {
    let recordings = with_shared_drivers();
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let windows = |recording: &str, vehicle: u32| {
        let of = |id: &&WindowId| {
            set.get(**id).map(|w| w.key()).is_some_and(|k| k.recording == recording && k.vehicle == vehicle)
        };
        set.ids().iter().filter(of).count()
    };
    let dropped = BTreeMap::from([("s-00".to_owned(), windows("s-00", 1)), ("s-06".to_owned(), windows("s-06", 20))]);
    assert!(dropped.values().all(|count| *count > 0) && windows("s-03", 20) == windows("s-06", 20));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("split.json");
    for seed in 0..5 {
        let mut tested = Vec::new();
        for fold in 1..=3 {
            let split =
                Split::new(&set, &SplitConfig { folds: 3, fold, ..config(SplitKind::Recording, seed) }, &[]).unwrap();
            assert_eq!(split.dropped_drivers(), &dropped, "the same for every fold");
            assert_eq!(all(&split).len() + dropped.values().sum::<usize>(), set.len());
            tested.extend_from_slice(split.test());
            split.save(&set, &path).unwrap();
            assert_eq!(Split::load(&set, &path).unwrap(), split);
        }
        let keys: BTreeSet<_> =
            tested.iter().filter_map(|id| set.get(*id).map(|w| (w.key().recording, w.key().vehicle))).collect();
        assert_eq!(keys.len(), 72, "each driver is tested once");
        assert!(keys.contains(&("s-01".to_owned(), 1)) && keys.contains(&("s-03".to_owned(), 20)));
    }
}

#[test]
fn by_vehicle_a_driver_of_two_recordings_is_drawn_once() {
    let recordings = with_shared_drivers();
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    for seed in 0..20 {
        let split = Split::new(&set, &config(SplitKind::Vehicle, seed), &[]).unwrap();
        assert_eq!(all(&split).len(), set.len(), "nothing is dropped");
        assert!(split.dropped_drivers().is_empty());
        for driver in [1, 20] {
            let parts = Subset::ALL
                .map(|part| split.subset(part).iter().any(|id| set.get(*id).unwrap().key().vehicle == driver));
            assert_eq!(parts.iter().filter(|part| **part).count(), 1, "seed {seed}");
        }
    }
}

#[test]
fn a_file_with_a_driver_in_two_parts_is_refused() {
    // Made while sizes told the drivers apart.
    let recordings = with_shared_drivers();
    let unlike: Vec<Recording> =
        recordings.iter().cloned().zip(0..).map(|(recording, r)| own_sizes(recording, r)).collect();
    let (set, _) = WindowSet::cut(&recordings, &short_windows()).unwrap();
    let (unaware, _) = WindowSet::cut(&unlike, &short_windows()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("split.json");
    let refused = (0..10).filter(|seed| {
        Split::new(&unaware, &config(SplitKind::Recording, *seed), &[]).unwrap().save(&unaware, &path).unwrap();
        match Split::load(&set, &path).map_err(|error| (error.to_string(), error)) {
            Ok(_) => false,
            Err((_, DataError::SharedDriver { vehicle, other, .. })) => {
                assert!(vehicle == other && [1, 20].contains(&vehicle), "{vehicle} {other}");
                true
            }
            Err((message, _)) => panic!("{message}"),
        }
    });
    assert!(refused.count() > 0);
}
