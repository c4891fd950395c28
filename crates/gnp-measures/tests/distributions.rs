//! Distributions and their distances; the summary of everything.

#![allow(clippy::unwrap_used)] // tests

mod road;

use gnp_measures::{Course, SafetySettings, Sample, Settings, Summary, Traffic, cell_rows, detector_rows, event_rows};
use road::{Row, drive, near, recording};

fn sample(values: &[f64]) -> Sample {
    Sample::new(values.iter().copied())
}

#[test]
fn distances_have_their_known_values() {
    let cases: [(&[f64], &[f64], f64, f64); 7] = [
        (&[3., 1., 2.], &[1., 2., 3.], 0., 0.),
        (&[0., 1., 3.], &[5., 6., 8.], 5., 1.),
        (&[0.], &[0., 0., 0., 8.], 2., 0.25),
        (&[0., 2.], &[1.], 1., 0.5),
        (&[1., 5., 5.], &[1.], 8. / 3., 2. / 3.),
        // One is above the other by 1/3 on [1, 2), equal on [2, 3), above by 1/3 on [3, 4).
        (&[1., 2., 3.], &[2., 2., 2., 2., 4., 4.], 2. / 3., 1. / 3.),
        (&[0., 10.], &[2., 4., 6., 8.], 2. * 0.5 + 2. * 0.25 + 2. * 0.25 + 2. * 0.5, 0.5),
    ];
    for (a, b, wasserstein, ks) in cases {
        for (a, b) in [(a, b), (b, a)] {
            near(sample(a).wasserstein(&sample(b)).unwrap(), wasserstein, 1e-12);
            near(sample(a).kolmogorov_smirnov(&sample(b)).unwrap(), ks, 1e-12);
        }
    }
    assert_eq!(sample(&[]).wasserstein(&sample(&[1.])), None);
    assert_eq!(sample(&[1.]).kolmogorov_smirnov(&sample(&[])), None);
}

#[test]
fn a_distribution_has_its_moments_quantiles_and_counts() {
    let values = (0..=1000).map(f64::from).chain([f64::NAN, f64::INFINITY]);
    let sample = Sample::new(values);
    assert_eq!((sample.not_finite(), sample.values().len()), (2, 1001));
    let of = sample.distribution().unwrap();
    near(of.mean, 500., 1e-9);
    near(of.deviation, (1001f64.powi(2) / 12. - 1. / 12.).sqrt(), 1e-6);
    assert_eq!((of.min, of.max, of.quantile(0.95)), (0., 1000., 950.));
    let histogram = of.histogram;
    assert_eq!((histogram.below, histogram.above), (5, 5));
    assert_eq!(histogram.counts.iter().sum::<u64>(), 991);
    assert!(histogram.counts.iter().all(|count| (23..=27).contains(count)), "{:?}", histogram.counts);
    assert!(Sample::default().distribution().is_none());
}

/// One car 30 m behind another, braking at 2 m/s² from 20 m/s for 5 s; one row of a third has no lane.
fn braking() -> Vec<Row> {
    let mut rows = drive(1, 1, 0..51, |t| (35. + 20. * t - t * t, 20. - 2. * t));
    rows.extend(drive(2, 1, 0..51, |t| (20. * t - t * t, 20. - 2. * t)));
    rows.push((3, 5, 500., 0., 9., 0));
    rows
}

#[test]
fn samples_are_of_the_rows_that_have_them_and_the_others_are_counted() {
    let recording = recording(&braking());
    let samples = Traffic::new(&recording, Course::Open).unwrap().samples(1.);
    assert_eq!(samples.speed.values().len(), 103);
    // Half a second at either end has none.
    assert_eq!(samples.acceleration.values().len(), 2 * 41);
    samples.acceleration.values().iter().for_each(|value| near(*value, -2., 1e-4));
    samples.gap.values().iter().for_each(|value| near(*value, 30., 1e-3));
    samples.lateral_offset.values().iter().for_each(|value| near(*value, 0., 1e-5));
    assert_eq!(samples.left_out["acceleration: near the end of a track"], 2 * 10 + 1);
    assert_eq!(samples.left_out["gap: no lane"], 1);
    assert_eq!(samples.left_out["gap: nobody ahead in the lane"], 51);
    assert!(samples.distances(&samples).iter().all(|it| it.wasserstein == 0. && it.kolmogorov_smirnov == 0.));
    assert_eq!(samples.distances(&samples).len(), 5, "nothing closes in: no time to collision");
}

#[test]
fn a_summary_is_json_and_its_tables_have_a_field_for_every_column() {
    let mut rows = braking();
    // Changes lane, and runs into the first car.
    rows.extend((0..51).map(|f| {
        let t = f64::from(f) / 10.;
        let (lane, y) = if f < 25 { (2, -5.6) } else { (1, -1.9) };
        (4, f, 34. + 20. * t - t * t, y, 25., lane)
    }));
    let recording = recording(&rows);
    let traffic = Traffic::new(&recording, Course::Open).unwrap();
    let safety = SafetySettings { time_gap: vec![2.], ..SafetySettings::default() };
    let settings = Settings { detectors: vec![60., 900.], interval_s: 2., safety, ..Settings::default() };
    let summary = Summary::of(&traffic, &settings).unwrap();
    assert!(summary.simulated);
    assert_eq!((summary.vehicles, summary.rows, summary.extents.len()), (4, 154, 2));
    assert_eq!(summary.extents[1], None);
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["simulated"], true);
    assert_eq!(json["dataset"], "live");
    assert!(json["diagrams"][0]["congested"]["Err"].as_str().unwrap().contains("of congested traffic"));
    assert!(!summary.safety.contacts.is_empty() && !summary.lane_changes.changes.is_empty());
    assert!(summary.left_out.iter().any(|it| it.what == "carriageway 0: detectors beyond the measured stretch"));

    // The name of the recording has a comma in it, in quotes.
    let fields = |row: &String| row.replace("\"by, hand\"", "name").split(',').count();
    let tables: [Vec<String>; 3] =
        [detector_rows(&summary).collect(), cell_rows(&summary).collect(), event_rows(&summary).collect()];
    for table in &tables {
        assert!(table.len() > 2);
        assert!(table.iter().all(|row| fields(row) == fields(&table[0])), "{table:#?}");
        assert!(table[1..].iter().all(|row| row.starts_with("\"by, hand\",true,")));
    }
    assert_eq!(tables[0].len(), 1 + 3 * 3); // lanes 1, 2 and all; 5 s in intervals of 2, 2 and 1 s
    for kind in ["lane_change", "time_gap", "contact"] {
        assert!(tables[2].iter().any(|row| row.contains(&format!(",{kind},"))), "{kind}");
    }
    let again: Settings = serde_json::from_value(serde_json::to_value(&settings).unwrap()).unwrap();
    assert_eq!(again, settings);
    assert!(serde_json::from_str::<Settings>("{\"cell\": 3}").is_err());
}
