//! What the summary says, and that it fits.

use gnp_data::Dataset;

use super::*;
use crate::manoeuvre::Manoeuvre;
use crate::score::ALL_SITES;

const MODELS: SummaryModels<'_> = SummaryModels {
    model: "gnp",
    label: "GNP",
    reference: "constant velocity",
    rules: &["constant velocity", "constant acceleration", "IDM along the lane"],
};

fn score(site: &str, model: &str, metric: &str, k: usize, horizon_s: f64, value: f64) -> Score {
    Score {
        dataset: Dataset::NGSIM,
        site: site.to_owned(),
        manoeuvre: None,
        model: model.to_owned(),
        seeds: 1,
        protocol: Protocol::Clean,
        metric: metric.to_owned(),
        k: Some(k),
        horizon_s,
        value,
        ci_low: Some(value - 0.25),
        ci_high: Some(value + 0.35),
        event_ci_low: None,
        event_ci_high: None,
        windows: 1234,
        vehicles: 56,
        events: 9,
        simulated: false,
        uses_future: false,
    }
}

/// RMSE and minFDE_6 at 5 s of the models; at 4 s all are better, and in another order.
fn scores(site: &str, values: &[(&str, f64)]) -> Vec<Score> {
    let of = |(model, value): &(&str, f64)| {
        [
            score(site, model, "rmse_at", 1, 5., *value),
            score(site, model, "min_fde", 6, 5., value / 2.),
            score(site, model, "rmse_at", 1, 4., 3. - value / 10.),
            Score { manoeuvre: Some(Manoeuvre::Left), ..score(site, model, "rmse_at", 1, 5., 0.1) },
            Score { protocol: Protocol::Literature, ..score(site, model, "rmse_at", 1, 5., 0.1) },
        ]
    };
    values.iter().flat_map(of).collect()
}

const US_101: [(&str, f64); 5] = [
    ("gnp", 5.5),
    ("goal head", 5.6),
    ("constant velocity", 6.8),
    ("constant acceleration", 9.25),
    ("IDM along the lane", 5.9),
];

fn comparison(site: &str, b: &str, verdict: Verdict) -> Comparison {
    Comparison {
        dataset: Dataset::NGSIM,
        site: site.to_owned(),
        protocol: Protocol::Clean,
        metric: "rmse_at".to_owned(),
        k: Some(1),
        horizon_s: 5.,
        a: "gnp".to_owned(),
        b: b.to_owned(),
        seeds: [1; 2],
        value: -0.4,
        ci_low: Some(-0.8),
        ci_high: Some(0.1),
        event_ci_low: None,
        event_ci_high: None,
        share_better: 0.9,
        verdict,
        windows: 1234,
        vehicles: 56,
        events: 9,
        simulated: false,
        uses_future: false,
    }
}

#[test]
fn the_best_rule_has_the_lowest_rmse_at_the_longest_horizon() {
    let differences = [("constant velocity", Verdict::Better), ("IDM along the lane", Verdict::Open)]
        .map(|(b, verdict)| comparison("us-101", b, verdict));
    let summary = Summary::of(&scores("us-101", &US_101), &differences, &MODELS).unwrap();
    let [site] = &summary.sites[..] else { panic!("{summary:?}") };
    assert_eq!((summary.horizon_s, site.windows, site.vehicles), (5., 1234, 56));
    let rows: Vec<(&str, f64, bool)> =
        site.rows.iter().map(|row| (row.name.as_str(), row.rmse.value, row.best_rule)).collect();
    // The goal head is better, but is no rule.
    assert_eq!(rows, [("GNP", 5.5, false), ("constant velocity", 6.8, false), ("IDM along the lane", 5.9, true)]);
    assert_eq!(site.rows[2].min_fde.unwrap().value, 2.95);
    assert_eq!(
        summary.sentence(),
        "On us-101, the prediction of GNP ends 5.5 m (5.2 to 5.8) from the truth after 5 s (RMSE), that of constant \
         velocity 6.8 m (6.5 to 7.1), that of the best rule, IDM along the lane, 5.9 m (5.7 to 6.2); GNP and the best \
         rule cannot be told apart."
    );
}

#[test]
fn a_reference_that_is_the_best_rule_stands_once() {
    let differences = [comparison("us-101", "constant velocity", Verdict::Worse)];
    let few = scores("us-101", &[("gnp", 7.), ("constant velocity", 6.8), ("constant acceleration", 9.)]);
    let summary = Summary::of(&few, &differences, &MODELS).unwrap();
    assert_eq!(summary.sites[0].rows.len(), 2);
    assert_eq!(summary.table().rows[1][0].text, "us-101: constant velocity (best rule)");
    let sentence = summary.sentence();
    assert!(sentence.contains("that of constant velocity, the best rule, 6.8 m"), "{sentence}");
    assert!(sentence.ends_with("; GNP is worse than the best rule beyond the interval."), "{sentence}");
}

#[test]
fn all_sites_come_last_and_give_the_sentence() {
    let mut all = scores(ALL_SITES, &US_101);
    all.extend(scores("i-80", &US_101));
    let one = Summary::of(&all, &[], &MODELS).unwrap();
    assert_eq!(one.sites.iter().map(|site| site.site.as_str()).collect::<Vec<_>>(), ["i-80"]);
    all.extend(scores("us-101", &US_101));
    let both = Summary::of(&all, &[comparison(ALL_SITES, "IDM along the lane", Verdict::Better)], &MODELS).unwrap();
    assert_eq!(both.sites.iter().map(|site| site.site.as_str()).collect::<Vec<_>>(), ["i-80", "us-101", ALL_SITES]);
    assert!(both.sentence().starts_with("On all sites, "), "{}", both.sentence());
    assert!(
        both.sentence().ends_with("; GNP is better than the best rule beyond the interval."),
        "{}",
        both.sentence()
    );
    assert_eq!(both.table().rows.len(), 9);
    assert!(!both.sentence_of(&both.sites[0]).contains(';'), "nothing was compared there");
}

#[test]
fn a_terminal_of_eighty_columns_holds_it() {
    let mut all = scores("us-101", &US_101.map(|(model, value)| (model, value + 10.)));
    all.extend(scores("a site of a long name", &[("gnp", 5.), ("a rule with a name that is far too long", 4.)]));
    let models = SummaryModels { reference: "a rule with a name that is far too long", ..MODELS };
    for models in [MODELS, models] {
        let text = Summary::of(&all, &[], &models).unwrap().terminal();
        let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 80, "{widest} columns:\n{text}");
        assert!(text.lines().any(|line| line.starts_with("us-101 (1234 windows of 56 drivers)")), "{text}");
    }
    let text = Summary::of(&scores("us-101", &US_101), &[], &MODELS).unwrap().terminal();
    assert!(text.contains("  best rule: IDM along the lane  5.90 (5.65 to 6.25)     2.95 (2.70 to 3.30)\n"), "{text}");
}

#[test]
fn the_note_says_what_a_verdict_rests_on() {
    let caption = Summary::of(&scores("us-101", &US_101), &[], &MODELS).unwrap().table().caption;
    assert!(caption.contains("leaves out zero and, with 3 events or more, that by event too."), "{caption}");
}

#[test]
fn simulated_is_said_everywhere() {
    let mut all = scores("highd-2", &US_101);
    all.iter_mut().for_each(|score| score.simulated = true);
    let summary = Summary::of(&all, &[], &MODELS).unwrap();
    for text in [summary.sentence(), summary.terminal(), summary.table().caption] {
        assert!(text.contains("simulated"), "{text}");
    }
}

#[test]
fn without_scores_of_the_model_there_is_no_summary() {
    let mut all = scores("us-101", &US_101);
    assert_eq!(Summary::of(&all, &[], &SummaryModels { model: "other", ..MODELS }), None);
    all.iter_mut().for_each(|score| score.protocol = Protocol::Paper);
    assert_eq!(Summary::of(&all, &[], &MODELS), None);
    // One vehicle gives no interval.
    let mut alone = scores("us-101", &US_101);
    alone.iter_mut().for_each(|score| (score.ci_low, score.ci_high) = (None, None));
    let summary = Summary::of(&alone, &[], &MODELS).unwrap();
    assert!(summary.sentence().contains("ends 5.5 m from the truth"), "{}", summary.sentence());
    let markdown = summary.table().markdown();
    assert!(markdown.contains("| us-101: GNP | 5.50 | 2.75 |"), "{markdown}");
}
