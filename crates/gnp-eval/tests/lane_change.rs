//! Which lane changes count, and when one is among the futures.

#![allow(clippy::unwrap_used)] // also outside the test functions

use gnp_data::{
    Columns, Dataset, Forecast, LaneMarking, MarkingKind, Mode, Recording, RecordingMeta, Road, Track, WindowConfig,
    WindowSet,
};
use gnp_eval::{BEGUN_M, Metric, MetricKind, Reference, ScoredWindow};

const RATE_HZ: f64 = 5.;
/// Observed and predicted frames: 2 and 5 s.
const FRAMES: [usize; 2] = [11, 25];
const LANE_M: f32 = 3.7;

/// A vehicle in the middle lane of three (lines 3.7 m apart) that is `lateral(t)` m to the left of its middle
/// at `t` s after the last observed frame; its lane number is that of its place, or unknown.
fn recording(lateral: &dyn Fn(f32) -> f32, known: bool, lines: usize) -> Recording {
    let mut columns = Columns::default();
    for frame in 0..FRAMES.iter().sum() {
        let t = (frame as f32 - (FRAMES[0] - 1) as f32) / RATE_HZ as f32;
        let y = 1.5 * LANE_M + lateral(t);
        columns.x.push(20. * t);
        columns.y.push(y);
        columns.vx.push(20.);
        columns.vy.push(0.);
        columns.lane.push(if known { 3 - (y / LANE_M) as i16 } else { 0 });
        columns.neighbours.push([u32::MAX; 8]);
    }
    let kinds = [MarkingKind::Boundary, MarkingKind::LaneDivider, MarkingKind::LaneDivider, MarkingKind::Boundary];
    let lines = kinds.into_iter().zip(0..).take(lines).map(|(kind, i)| LaneMarking { kind, y: LANE_M * i as f32 });
    let road = Road { driving_direction: 2, lines: lines.collect(), fitted: true, axis: None };
    let track = Track::new(1, [4., 2.], 100, 0..columns.x.len());
    let meta = RecordingMeta::new(Dataset::NGSIM, "s", "a", RATE_HZ);
    Recording::from_parts(meta, vec![road], vec![track], columns).unwrap()
}

/// What the window adds: for changes that begin within the first second, and those under way; the futures end `ends` m
/// to the left.
fn found(recording: &Recording, k: usize, ends: &[f32]) -> [Option<f64>; 2] {
    let config = WindowConfig {
        observed_s: 2.,
        predicted_s: 5.,
        rate_hz: RATE_HZ,
        stride_s: 10.,
        site_stride_s: Default::default(),
    };
    let recordings = std::slice::from_ref(recording);
    let (set, _) = WindowSet::cut(recordings, &config).unwrap();
    let reference = Reference::of(&set.iter().next().unwrap());
    let mode = |end: &f32| Mode {
        probability: 1. / ends.len() as f32,
        path: (1..=FRAMES[1]).map(|j| [4. * j as f32, end * j as f32 / FRAMES[1] as f32]).collect(),
        explanation: None,
    };
    let forecast = Forecast { modes: ends.iter().map(mode).collect() };
    let case = ScoredWindow::new(&reference, &forecast, ends.len()).unwrap();
    [MetricKind::LaneChangeRecall, MetricKind::LaneChangeRecallUnderWay]
        .map(|kind| Metric::best_of(kind, k, 5.).contribution(&case).unwrap())
}

/// Sideways to `by` m from `start` s on, within 3 s.
fn change(start: f32, by: f32) -> impl Fn(f32) -> f32 {
    move |t| ((t - start) / 3.).clamp(0., 1.) * by
}

#[test]
fn a_change_that_begins_within_a_second_is_found_by_a_future_that_ends_in_its_lane() {
    let left = recording(&change(0.5, LANE_M), true, 4);
    // The new lane reaches from 1.85 m to 5.55 m to the left.
    for (ends, expected) in [
        (&[0., 3.7][..], 1.),
        (&[0., 2.], 1.),
        (&[0., 5.5], 1.),
        (&[0., 1.8], 0.),
        (&[0., 5.6], 0.),
        (&[0., -3.7], 0.),
        (&[0.], 0.),
    ] {
        assert_eq!(found(&left, 6, ends), [Some(expected), None], "{ends:?}");
    }
    assert_eq!(found(&left, 1, &[0., 3.7]), [Some(0.), None], "only the first");
    assert_eq!(found(&left, 1, &[3.7, 0.]), [Some(1.), None]);
    let right = recording(&change(0.5, -LANE_M), true, 4);
    assert_eq!(found(&right, 1, &[-3.7]), [Some(1.), None]);
    assert_eq!(found(&right, 1, &[3.7]), [Some(0.), None]);
}

#[test]
fn only_changes_that_begin_then_count() {
    let of = |lateral: &dyn Fn(f32) -> f32| found(&recording(lateral, true, 4), 1, &[LANE_M]);
    let (counts, none) = ([Some(1.), None], [None, None]);
    // 1.23 m/s from `start` on: 0.3 m are covered a quarter of a second later.
    assert_eq!(of(&change(0., LANE_M)), counts);
    assert_eq!(of(&change(0.7, LANE_M)), counts);
    assert_eq!(of(&change(0.8, LANE_M)), none, "begins later");
    assert_eq!(of(&change(1.9, LANE_M)), none);
    assert_eq!(of(&change(-0.5, LANE_M)), [None, Some(1.)], "under way");
    assert_eq!(of(&change(-0.2, LANE_M)), counts, "hardly moved yet");
    assert_eq!(of(&|_| 0.), none, "keeps its lane");
    assert_eq!(of(&change(0.2, 1.5)), none, "moves within its lane");
    let swings = |t: f32| if t < 2. { 0.5 * (t * 2.).sin().max(0.) } else { change(2., LANE_M)(t) };
    assert_eq!(of(&swings), none, "comes back before it goes");
    let back = |t: f32| change(0.2, LANE_M)(t) - change(2., LANE_M)(t);
    assert_eq!(of(&back), none, "ends where it was");
    const { assert!(BEGUN_M < LANE_M / 4.) };
}

#[test]
fn what_is_not_known_is_counted_out() {
    let lateral = change(0.5, LANE_M);
    assert_eq!(found(&recording(&lateral, true, 0), 1, &[3.7]), [None, None], "no lines");
    // Two lines: the new lane is beyond them.
    assert_eq!(found(&recording(&lateral, true, 2), 1, &[3.7]), [None, None]);
    // Without lane numbers motion and lines decide.
    assert_eq!(found(&recording(&lateral, false, 4), 1, &[3.7]), [Some(1.), None]);
}
