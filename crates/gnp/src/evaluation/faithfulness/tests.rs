//! Made-up models whose explanations are true, too small or about somebody else.

use gnp_data::{
    Columns, Contribution, Dataset, Explanation, Forecast, Mode, PredictError, Recording, RecordingMeta, Road, SLOTS,
    Slot, Track, WindowConfig, WindowSet,
};

use super::*;

const RATE_HZ: f64 = 2.;
/// Distance between a leader's centre and that of its follower, m.
const GAPS: [f32; 4] = [10., 20., 30., 40.];
/// Beyond that a leader changes nothing, m.
const REACH_M: f32 = 50.;

/// Four followers (1, 3, 5, 7) with a leader each (2, 4, 6, 8), 500 m from pair to pair, all at 20 m/s.
fn recording(site: &str) -> Recording {
    let mut columns = Columns::default();
    let mut tracks = Vec::new();
    let cars = GAPS.iter().enumerate().flat_map(|(i, gap)| {
        let (x0, ahead) = (500. * i as f32, 2 * i as u32 + 1);
        [(ahead, x0, Some(ahead)), (ahead + 1, x0 + gap, None)]
    });
    for (vehicle, x0, ahead) in cars {
        let start = columns.x.len();
        for frame in 0..9 {
            columns.x.push(x0 + 10. * frame as f32);
            columns.y.push(2.);
            columns.vx.push(20.);
            columns.vy.push(0.);
            columns.lane.push(1);
            let mut slots = [u32::MAX; SLOTS];
            slots[Slot::Preceding.index()] = ahead.unwrap_or(u32::MAX);
            columns.neighbours.push(slots);
        }
        tracks.push(Track::new(vehicle, [4., 2.], 100, start..columns.x.len()));
    }
    let meta = RecordingMeta::new(Dataset::NGSIM, site, site, RATE_HZ);
    let road = Road { driving_direction: 2, lines: Vec::new(), fitted: true, axis: None };
    Recording::from_parts(meta, vec![road], tracks, columns).unwrap()
}

/// Drives 2 m farther than at its present speed, 1 m farther by intention, and is held back by a leader by a tenth of
/// what is missing to 50 m; gives the leader `told` of that, and intention the rest.
struct Told {
    told: f32,
    /// Added to the number of the leader in the explanation.
    other: u32,
    explains: bool,
}

const TRUE: Told = Told { told: 1., other: 0, explains: true };

impl Predictor for Told {
    fn name(&self) -> &str {
        "told"
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        assert_eq!((observations.len(), k), (1, 1), "a scene at a time");
        let seen = &observations[0];
        let leader = seen.leader().map(|leader| (leader.vehicle(), leader.now().x));
        let held = leader.map_or(0., |(_, gap)| -(REACH_M - gap).max(0.) / 10.);
        let parts = [
            (Cause::FreeRoad, 2.),
            (
                Cause::Leader { vehicle: leader.map_or(0, |(vehicle, _)| vehicle) + self.other, place: 1 },
                self.told * held,
            ),
            (Cause::Intention, 1. + (1. - self.told) * held),
        ];
        let steps = seen.shape().t_pred;
        let grown = |by: f32| (1..=steps).map(|step| [by * step as f32 / steps as f32, 0.]).collect::<Vec<_>>();
        let contributions = parts.map(|(cause, by)| Contribution { cause, displacement: grown(by) }).into();
        let explanation = Explanation { velocity: [20., 0.], contributions, ..Explanation::default() };
        let path = grown(40. + 3. + held);
        let mode = Mode { probability: 1., path, explanation: self.explains.then_some(explanation) };
        Ok(vec![Forecast { modes: vec![mode] }])
    }
}

fn bootstrap() -> Bootstrap {
    Bootstrap { resamples: 100, seed: 1 }
}

fn config() -> WindowConfig {
    WindowConfig { observed_s: 2., predicted_s: 2., rate_hz: RATE_HZ, stride_s: 10., site_stride_s: BTreeMap::new() }
}

fn rows(model: &Told, sites: &[&str]) -> Vec<Faithfulness> {
    let recordings: Vec<Recording> = sites.iter().map(|site| recording(site)).collect();
    let (set, _) = WindowSet::cut(&recordings, &config()).unwrap();
    let seen: Vec<Observation<'_>> = set.iter().map(|window| window.observation()).collect();
    assert_eq!(seen.len(), 8 * sites.len());
    faithfulness(model, &seen, &bootstrap()).unwrap()
}

fn near(found: Option<Estimate>, expected: f64) -> bool {
    found.is_some_and(|found| (found.value - expected).abs() < 1e-4)
}

/// Held back by 4, 3, 2 and 1 m; physical causes 2 m less that: -2, -1, 0 and 1 m; learned 1 m; the whole -1 to 2 m.
#[test]
fn a_true_explanation_has_correlation_and_slope_1() {
    let [row] = &rows(&TRUE, &["s"])[..] else { panic!("one site") };
    assert_eq!((row.windows, row.vehicles, row.horizon_s), (4, 4, 2.));
    assert!(near(row.correlation, 1.) && near(row.slope, 1.), "{row:?}");
    assert!((row.effect_m - 2.5).abs() < 1e-4 && (row.part_m - 2.5).abs() < 1e-4);
    assert!(near(row.physical_share, 0.5), "{row:?}");
    assert!(near(row.physical_share_of_squares, 1. - 4. / 6.), "{row:?}");
    let share = row.physical_share.unwrap();
    assert!(share.ci_low.unwrap() < 0.5 && 0.5 < share.ci_high.unwrap());
}

#[test]
fn an_explanation_that_gives_the_leader_half_has_slope_2() {
    let [row] = &rows(&Told { told: 0.5, ..TRUE }, &["s"])[..] else { panic!("one site") };
    assert!(near(row.correlation, 1.) && near(row.slope, 2.), "{row:?}");
    assert!((row.part_m - 1.25).abs() < 1e-4);
    // Learned -1, -0.5, 0, 0.5 m; physical 0, 0.5, 1, 1.5 m.
    assert!(near(row.physical_share, 3. / 5.), "{row:?}");
}

#[test]
fn what_another_vehicle_is_given_does_not_count() {
    let [row] = &rows(&Told { other: 100, ..TRUE }, &["s"])[..] else { panic!("one site") };
    assert_eq!((row.correlation, row.slope, row.part_m), (None, None, 0.));
    assert!((row.effect_m - 2.5).abs() < 1e-4);
}

#[test]
fn a_model_that_does_not_explain_itself_has_no_row() {
    let found = rows(&Told { explains: false, ..TRUE }, &["s"]);
    assert_eq!(found, []);
    assert!(table(&found, &TableHead { split: "vehicle".to_owned(), rate_hz: RATE_HZ }).is_none());
}

#[test]
fn sites_have_rows_of_their_own_and_one_together() {
    let found = rows(&TRUE, &["b", "a"]);
    let sites: Vec<(&str, u64)> = found.iter().map(|row| (row.site.as_str(), row.windows)).collect();
    assert_eq!(sites, [("a", 4), ("b", 4), (ALL_SITES, 8)]);
    assert!(near(found[2].slope, 1.) && near(found[2].physical_share, 0.5));
    let table = table(&found, &TableHead { split: "vehicle".to_owned(), rate_hz: RATE_HZ }).unwrap();
    let first: Vec<&str> = table.rows.iter().map(|row| row[0].text.as_str()).collect();
    assert_eq!(first, ["a: told", "b: told", "all sites: told"]);
    assert!(table.rows[0][5].interval.is_some() && table.caption.contains("at 2 s"));
    assert!(table.terminal().lines().all(|line| line.chars().count() <= 100), "{}", table.terminal());

    let text = serde_json::to_string(&found).unwrap();
    // A last digit may change on the way.
    let back: Vec<Faithfulness> = serde_json::from_str(&text).unwrap();
    assert_eq!(back.len(), found.len());
    for (back, row) in back.iter().zip(&found) {
        assert_eq!((&back.model, &back.site, back.windows), (&row.model, &row.site, row.windows));
        let [ours, theirs] = [row, back].map(|row| row.physical_share.and_then(|share| share.ci_low));
        assert!((ours.unwrap() - theirs.unwrap()).abs() < 1e-12, "{back:?}");
    }
}

#[test]
fn folds_pool_to_what_all_windows_give() {
    let recordings = ["a", "b"].map(recording);
    let (set, _) = WindowSet::cut(&recordings, &config()).unwrap();
    let seen = chosen(&set.iter().map(|window| window.observation()).collect::<Vec<_>>());
    let of = |seen: &[Observation<'_>]| {
        let mut measured = Measured::default();
        measured.add("told", &TRUE, seen, &|vehicle| vehicle, &mut |_| Ok(())).unwrap();
        measured
    };
    let pooled = of(&seen[..3]).pooled(of(&seen[3..]));
    assert_eq!(pooled.rows(&bootstrap()), of(&seen).rows(&bootstrap()));
    let stop = &mut |_: usize| Err(crate::Error::Stopped { kept: None });
    let stopped = Measured::default().add("told", &TRUE, &seen, &|vehicle| vehicle, stop);
    assert!(stopped.unwrap_err().is_stopped());
}

/// Vehicles of two recordings that are one driver are drawn together.
#[test]
fn drivers_are_counted_not_vehicles() {
    let recordings = ["a", "b"].map(recording);
    let (set, _) = WindowSet::cut(&recordings, &config()).unwrap();
    let seen = chosen(&set.iter().map(|window| window.observation()).collect::<Vec<_>>());
    let drivers = |driver: &dyn Fn(VehicleId) -> VehicleId| {
        let mut measured = Measured::default();
        measured.add("told", &TRUE, &seen, driver, &mut |_| Ok(())).unwrap();
        let rows = measured.rows(&bootstrap());
        let all = rows.last().unwrap();
        (all.windows, all.vehicles)
    };
    assert_eq!(drivers(&|vehicle| vehicle), (8, 8));
    assert_eq!(drivers(&|vehicle| VehicleId { recording: "a".to_owned(), ..vehicle }), (8, 4));
}

#[test]
fn of_many_windows_every_nth_is_asked() {
    let recordings = [recording("a")];
    let (set, _) = WindowSet::cut(&recordings, &config()).unwrap();
    let leading = set.iter().map(|window| window.observation()).find(|seen| seen.leader().is_some()).unwrap();
    assert_eq!(chosen(&vec![leading; MOST]).len(), MOST);
    assert_eq!(chosen(&vec![leading; 2 * MOST + 1]).len(), (2 * MOST + 1).div_ceil(3));
}
