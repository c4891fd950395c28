//! What tables say, and that they fit.

use gnp_data::{Dataset, WindowShape};

use super::*;
use crate::comparison::{Comparison, Verdict};
use crate::manoeuvre::Manoeuvre;
use crate::metric::Metric;
use crate::protocol::Protocol;
use crate::score::{ALL_SITES, Score};

/// A score for every metric of a protocol; values grow by metric.
fn scores(protocol: Protocol, site: &str, model: &str, start: f64) -> Vec<Score> {
    let shape = WindowShape { t_obs: 31, t_pred: 50, step: 1, rate_hz: 10. };
    let metrics = protocol.metrics(&shape).unwrap();
    let score = |(i, metric): (usize, &Metric)| Score {
        dataset: Dataset::NGSIM,
        site: site.to_owned(),
        manoeuvre: None,
        model: model.to_owned(),
        seeds: 1,
        protocol,
        metric: metric.kind.name().to_owned(),
        k: metric.k,
        horizon_s: metric.horizon_s,
        value: start + 0.01 * i as f64,
        ci_low: Some(start - 1.),
        ci_high: Some(start + 1.),
        event_ci_low: Some(start - 2.),
        event_ci_high: Some(start + 2.),
        windows: 1234,
        vehicles: 56,
        events: 9,
        simulated: false,
        uses_future: model.contains("oracle"),
    };
    metrics.iter().enumerate().map(score).collect()
}

/// Scores of one manoeuvre on all sites.
fn parted(model: &str, manoeuvre: Manoeuvre) -> Vec<Score> {
    let mut scores = scores(Protocol::Clean, ALL_SITES, model, 3.);
    for score in &mut scores {
        (score.manoeuvre, score.windows) = (Some(manoeuvre), 71);
    }
    scores
}

fn head() -> TableHead {
    TableHead { split: "recording".to_owned(), rate_hz: 10. }
}

#[test]
fn a_table_states_what_its_numbers_rest_on() {
    let table = &tables(&scores(Protocol::Clean, "us-101", "gnp", 5.), &head())[0];
    for text in [table.terminal(), table.markdown()] {
        let flat = text.replace('\n', " ");
        for stated in [
            "us-101",
            "clean",
            "split by recording",
            "k = 6",
            "10 Hz",
            "1234 windows",
            "56 drivers",
            "9 events",
            "by driver",
            "by event",
        ] {
            assert!(flat.contains(stated), "{stated}: {text}");
        }
        assert!(!text.contains("simulated"), "{text}");
    }
    assert_eq!(table.header[1..6], ["RMSE 1 s", "RMSE 2 s", "RMSE 3 s", "RMSE 4 s", "RMSE 5 s"]);
    assert_eq!(table.header[6..], ["bias 5 s", "mean RMSE", "arg-max RMSE", "minADE_6", "minFDE_6"]);
}

#[test]
fn simulated_is_said_as_soon_as_one_recording_is() {
    let mut scores = scores(Protocol::Literature, "highd-2", "gnp", 5.);
    scores[3].simulated = true;
    let table = &tables(&scores, &head())[0];
    assert!(table.terminal().contains("*simulated*") && table.markdown().contains("*simulated*"));
}

#[test]
fn terminal_tables_fit_eighty_columns() {
    for protocol in Protocol::ALL {
        let mut all = scores(protocol, "us-101", "gnp", 105.);
        all.extend(scores(protocol, "us-101", "constant acceleration of the last second", 10.));
        all.extend(scores(protocol, "us-101", "gnp, oracle neighbours", 5.));
        all.extend(parted("gnp, oracle neighbours", Manoeuvre::Right));
        for table in tables(&all, &head()) {
            let text = table.terminal();
            let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
            assert!(widest <= 80, "{widest} columns:\n{text}");
            // All columns are there, in whole: no number is broken.
            for title in table.header.iter().skip(1) {
                let (quantity, rest) = title.split_once(' ').unwrap_or((title, ""));
                assert!(text.contains(quantity) && text.contains(rest), "{title}:\n{text}");
            }
            for cell in table.rows.iter().flatten().filter(|cell| cell.interval.is_some()) {
                assert!(text.contains(&cell.text), "{}:\n{text}", cell.text);
            }
        }
    }
}

#[test]
fn markdown_rows_hold_values_and_intervals() {
    let text = tables(&scores(Protocol::Literature, "i-80", "a|b", 2.), &head())[0].markdown();
    // rmse_at and rmse_at_by_vehicle alternate, so RMSE grows by 0.02 a second.
    assert!(text.contains("\n| a\\|b | 2.00 | 2.02 | 2.04 | 2.06 | 2.08 (1.00 to 3.00) [0.00 to 4.00] |\n"), "{text}");
    assert!(text.contains("\n| --- | ---: | ---: | ---: | ---: | ---: |\n"), "{text}");
}

#[test]
fn the_papers_column_is_set_as_printed() {
    let table = &tables(&scores(Protocol::Paper, "i-80", "gnp", 1.), &head())[0];
    // min_ade, min_fde, rmse_to, rmse_to_per_coordinate at 1 s.
    assert_eq!(table.rows[0][1].text, "1.00/1.01/1.03");
}

#[test]
fn future_input_is_marked_and_missing_numbers_are_dashes() {
    let mut all = scores(Protocol::Literature, "i-80", "oracle", 2.);
    all.retain(|score| score.horizon_s != 3.);
    all.extend(scores(Protocol::Literature, "i-80", "gnp", 2.));
    let table = &tables(&all, &head())[0];
    assert_eq!(table.rows[0][0].text, "oracle (future input)");
    assert_eq!(table.rows[0][3].text, "-");
    assert_eq!(table.rows[1][0].text, "gnp");
}

#[test]
fn all_sites_get_a_table_only_when_there_are_several() {
    let mut one = scores(Protocol::Clean, "us-101", "gnp", 5.);
    one.extend(scores(Protocol::Clean, ALL_SITES, "gnp", 5.));
    let main = |scores: &[Score]| {
        let is_first = |table: &Table| !table.detail && !table.name.ends_with("futures");
        tables(scores, &head()).into_iter().filter(is_first).collect::<Vec<_>>()
    };
    assert_eq!(main(&one).len(), 1);
    let mut two = scores(Protocol::Clean, "i-80", "gnp", 4.);
    two.extend(one);
    let captions: Vec<String> = main(&two).into_iter().map(|table| table.caption).collect();
    let starts: Vec<&str> = captions.iter().map(|caption| caption.split(':').next().unwrap()).collect();
    assert_eq!(starts, ["i-80", "us-101", "all sites"]);
}

#[test]
fn manoeuvres_are_rows_of_one_table() {
    let mut all = scores(Protocol::Clean, "us-101", "gnp", 5.);
    all.extend(parted("gnp", Manoeuvre::Brake));
    all.extend(parted("gnp", Manoeuvre::Left));
    let tables = tables(&all, &head());
    let names: Vec<&str> = tables.iter().map(|table| table.name.as_str()).collect();
    let of_site = ["", " futures", " further", " densities", " lane changes"].map(|part| format!("clean us-101{part}"));
    assert_eq!(names[..5], of_site);
    assert_eq!(names[5..], ["clean all sites by manoeuvre"]);
    let rows: Vec<[&str; 2]> = tables[5].rows.iter().map(|row| [row[0].text.as_str(), row[1].text.as_str()]).collect();
    assert_eq!(rows, [["left: gnp", "71"], ["brake: gnp", "71"]]);
    assert_eq!(tables[0].rows.len(), 1, "manoeuvres stay out of the other tables");
}

#[test]
fn lane_changes_have_a_table_with_their_own_counts() {
    let mut all = scores(Protocol::Clean, "us-101", "gnp", 0.5);
    for score in all.iter_mut().filter(|score| score.metric == "lane_change_recall") {
        (score.windows, score.vehicles) = (23, 9);
    }
    let find =
        |scores: &[Score]| tables(scores, &head()).into_iter().find(|table| table.name.ends_with("lane changes"));
    let table = find(&all).unwrap();
    assert!(table.caption.contains("first second: 23 windows, 9 drivers; under way"), "{}", table.caption);
    assert_eq!(table.header, ["model", "begins, k = 1", "begins, k = 6", "under way, k = 1", "under way, k = 6"]);
    assert!(table.rows[0][1].interval.is_some());
    let main = &tables(&all, &head())[0];
    assert!(main.caption.contains("1234 windows, 56 drivers"), "{}", main.caption);
    all.retain(|score| !score.metric.starts_with("lane_change"));
    assert_eq!(find(&all), None);
}

#[test]
fn a_row_says_how_many_seeds_it_is_the_mean_of() {
    let mut all = scores(Protocol::Clean, "us-101", "gnp", 5.);
    all.extend(parted("gnp", Manoeuvre::Left));
    all.iter_mut().for_each(|score| score.seeds = 3);
    all.extend(scores(Protocol::Clean, "us-101", "IDM", 6.));
    let tables = tables(&all, &head());
    let names: Vec<&str> = tables[0].rows.iter().map(|row| row[0].text.as_str()).collect();
    assert_eq!(names, ["gnp (3 seeds)", "IDM"]);
    let words =
        "by driver and seed, in square brackets by event and seed. Differences between trainings of rows with one";
    assert!(tables[0].caption.contains(words), "{}", tables[0].caption);
    let lane_changes = tables.iter().find(|table| table.name.ends_with("lane changes")).unwrap();
    assert!(lane_changes.caption.contains("intervals of 95 % by driver and seed."), "{}", lane_changes.caption);
    assert!(tables.iter().any(|table| table.rows[0][0].text == "left: gnp (3 seeds)"));
}

/// A caption speaks of intervals where there are some, and of brackets where a cell has them: of every table, with
/// events and without, with drivers and without, and of files that know no events.
#[test]
fn captions_speak_of_what_the_cells_have() {
    let without_events = |score: &mut Score| (score.event_ci_low, score.event_ci_high) = (None, None);
    let without_drivers = |score: &mut Score| {
        without_events(score);
        (score.ci_low, score.ci_high) = (None, None);
    };
    let before = |score: &mut Score| {
        without_events(score);
        score.events = 0;
    };
    let (mut brackets, mut intervals) = ([0; 2], [0; 2]);
    for protocol in Protocol::ALL {
        let changes: [&dyn Fn(&mut Score); 4] = [&|_| (), &without_events, &without_drivers, &before];
        for (change, whom) in changes.into_iter().zip(["driver", "driver", "driver", "vehicle"]) {
            let mut all = scores(protocol, "us-101", "gnp", 5.);
            all.extend(parted("gnp", Manoeuvre::Left));
            all.iter_mut().for_each(change);
            for table in tables(&all, &head()) {
                let caption = &table.caption;
                let some = |has: fn(&TableCell) -> bool| table.rows.iter().flatten().any(has);
                let (inner, outer) = (some(|cell| cell.interval.is_some()), some(|cell| cell.by_event.is_some()));
                assert_eq!(caption.contains("square brackets"), outer, "{}: {caption}", table.name);
                assert_eq!(caption.contains(&format!("95 % by {whom}")), inner, "{}: {caption}", table.name);
                assert_eq!(caption.contains("Differences between trainings"), inner, "{}: {caption}", table.name);
                assert!(caption.contains(&format!(" {whom}s")), "{}: {caption}", table.name);
                if whom == "vehicle" {
                    assert!(!caption.contains("event") && !caption.contains("driver"), "{}: {caption}", table.name);
                }
                brackets[usize::from(outer)] += 1;
                intervals[usize::from(inner)] += 1;
            }
        }
    }
    assert!(brackets.iter().chain(&intervals).all(|count| *count > 0), "{brackets:?} {intervals:?}");
}

#[test]
fn the_floor_under_overlap_is_said() {
    let mut all = scores(Protocol::Clean, "us-101", "gnp", 5.);
    for score in all.iter_mut().filter(|score| score.metric == "recorded_overlap") {
        score.value = 0.0621;
    }
    let futures = &tables(&all, &head())[1];
    assert!(futures.caption.contains("in 6.2 % of the windows"), "{}", futures.caption);
}

#[test]
fn csv_has_a_line_a_cell() {
    let table = Table {
        name: "clean us-101, \"all\"".to_owned(),
        detail: false,
        caption: String::new(),
        header: ["model", "RMSE 5 s", "ADE"].map(str::to_owned).into(),
        rows: vec![vec![
            TableCell::plain("gnp"),
            TableCell {
                text: "5.12".to_owned(),
                interval: Some(Interval { low: 4.5, high: 6. }),
                by_event: Some(Interval { low: 4., high: 7. }),
            },
            TableCell::plain("-"),
        ]],
    };
    let expected = "table,row,column,value,low,high,event_low,event_high\n\
        \"clean us-101, \"\"all\"\"\",gnp,RMSE 5 s,5.12,4.5000,6.0000,4.0000,7.0000\n\
        \"clean us-101, \"\"all\"\"\",gnp,ADE,-,,,,\n";
    assert_eq!(csv(&[table]), expected);
}

#[test]
fn differences_say_who_is_better() {
    let comparison = |b: &str, value, verdict, uses_future| Comparison {
        dataset: Dataset::NGSIM,
        site: "us-101".to_owned(),
        protocol: Protocol::Literature,
        metric: "rmse_at".to_owned(),
        k: Some(1),
        horizon_s: 5.,
        a: "gnp".to_owned(),
        b: b.to_owned(),
        seeds: [1; 2],
        value,
        ci_low: Some(value - 0.5),
        ci_high: Some(value + 0.5),
        event_ci_low: Some(value - 0.75),
        event_ci_high: Some(value + 0.75),
        share_better: 0.9,
        verdict,
        windows: 1234,
        vehicles: 56,
        events: 9,
        simulated: false,
        uses_future,
    };
    let rows = [comparison("cv", -1.2, Verdict::Better, false), comparison("pip", 0.8, Verdict::Worse, true)];
    let text = comparison_tables(&rows, &head())[0].markdown();
    assert!(text.contains("| gnp minus | rmse_at_1 5 s |"), "{text}");
    assert!(text.contains("| cv | -1.20 + (-1.70 to -0.70) [-1.95 to -0.45] |"), "{text}");
    assert!(text.contains("| pip (future input) | 0.80 - (0.30 to 1.30) [0.05 to 1.55] |"), "{text}");
    assert!(text.contains("mark where both intervals (95 %, of drivers, and in square brackets of events,"), "{text}");
    let alone = rows.map(|row| Comparison { event_ci_low: None, event_ci_high: None, ..row });
    let text = comparison_tables(&alone, &head())[0].markdown();
    assert!(text.contains("mark where the interval (95 %, of drivers, both"), "{text}");
    assert!(text.contains("| cv | -1.20 + (-1.70 to -0.70) |"), "{text}");
}

/// A system whose spreads nobody fitted has no density: a dash beside others, and no column where none has.
#[test]
fn densities_are_shown_where_there_are_any() {
    let of_density = |score: &Score| score.metric.starts_with("nll") || score.metric.starts_with("coverage");
    let mut without = scores(Protocol::Clean, "us-101", "theirs", 5.);
    without.retain(|score| !of_density(score));
    let found = tables(&without, &head());
    assert_eq!(found[1].header, ["model", "minFDE_20", "miss rate_6", "overlap_1"]);
    assert!(!found.iter().any(|table| table.name.ends_with("densities")));
    let mut both = scores(Protocol::Clean, "us-101", "gnp", 5.);
    both.extend(without);
    let found = tables(&both, &head());
    assert_eq!(found[1].header[4..], ["NLL 5 s", "NLL mean", "within 50 %", "within 90 %"]);
    assert_eq!(found[1].rows[1][4].text, "-");
    assert!(found[1].rows[0][5].by_event.is_some() && found[0].rows[1][10].by_event.is_some());
}
