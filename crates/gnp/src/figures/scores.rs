//! Figures of a table: errors against horizon of all its systems, or what its variants change.

use std::path::Path;

use crate::error::Result;
use gnp_eval::{ALL_SITES, Comparison, Protocol, Score};
use gnp_plot::{Dot, DotPanel, DotRow, DotScaling, Figure, Source, dot_note, dot_rows};

/// What a figure of a table is made of.
pub(crate) struct Scored<'a> {
    /// The full model.
    pub(crate) ours: &'a str,
    /// All systems in the order of the rows.
    pub(crate) systems: &'a [&'a str],
    pub(crate) scores: &'a [Score],
    /// The full model against each other system.
    pub(crate) differences: &'a [Comparison],
    pub(crate) source: Source,
}

/// A quantity of one panel.
#[derive(Clone, Copy)]
struct Quantity {
    protocol: Protocol,
    metric: &'static str,
    k: usize,
    title: &'static str,
    axis: &'static str,
}

impl Quantity {
    fn title(self, at: &str) -> String {
        format!("{}, {at}, protocol {}", self.title, self.protocol.name())
    }
}

const PREDICTION: Quantity = Quantity {
    protocol: Protocol::Literature,
    metric: "rmse_at",
    k: 1,
    title: "RMSE of the prediction",
    axis: "RMSE, top-1 (m)",
};
const BEST_OF_6: Quantity = Quantity {
    protocol: Protocol::Clean,
    metric: "min_fde",
    k: 6,
    title: "Error of the nearest of 6 futures",
    axis: "error, best of 6 (m)",
};
const OVERLAP: Quantity = Quantity {
    protocol: Protocol::Clean,
    metric: "overlap",
    k: 1,
    title: "Prediction through another's recorded box",
    axis: "windows (%)",
};

/// Draws the figures of `table1` or `table2` into its folder: one a site, and one of all sites together.
///
/// # Errors
/// When a figure cannot be painted or written.
pub(crate) fn save(stem: &str, scored: &Scored<'_>, folder: &Path) -> Result<()> {
    super::save(&figures(stem, scored), folder)
}

fn figures(stem: &str, scored: &Scored<'_>) -> Vec<Figure> {
    let mut sites: Vec<&str> = Vec::new();
    for score in scored.scores {
        if !sites.contains(&score.site.as_str()) {
            sites.push(&score.site);
        }
    }
    let one = sites.len() == 1;
    let draw = |site: &&str| {
        let scores: Vec<&Score> =
            scored.scores.iter().filter(|score| score.site == *site && score.manoeuvre.is_none()).collect();
        let (name, title) = match stem {
            "table2" => ("table2-ablation", "What the parts of GNP do"),
            _ => ("table1-error-by-horizon", "Error against horizon"),
        };
        let (name, title) = match *site {
            _ if one => (name.to_owned(), title.to_owned()),
            ALL_SITES => (name.to_owned(), format!("{title}, all sites")),
            site => (format!("{name}-{site}"), format!("{title}, {site}")),
        };
        let (panels, caption) =
            if stem == "table2" { ablation(scored, &scores, site) } else { by_horizon(scored, &scores) };
        dot_rows(&name, &title, &format!("{caption} {}", counts(&scores)), &panels, &scored.source)
    };
    sites.iter().map(draw).collect()
}

fn counts(scores: &[&Score]) -> String {
    let most = scores.iter().max_by_key(|score| score.windows);
    let seeds = scores.iter().map(|score| score.seeds).max().unwrap_or(1);
    let seeds = match seeds {
        1 => String::new(),
        seeds => {
            format!(" Rows of several trainings (up to {seeds} seeds) are means over them; bars hold how these differ.")
        }
    };
    most.map_or_else(String::new, |score| format!("{} windows of {} drivers.{seeds}", score.windows, score.vehicles))
}

fn of<'a>(scores: &[&'a Score], quantity: Quantity, system: &str, horizon: f64) -> Option<&'a Score> {
    let fits = |score: &&&'a Score| {
        (score.protocol, score.metric.as_str(), score.k) == (quantity.protocol, quantity.metric, Some(quantity.k))
            && score.model == system
            && (score.horizon_s - horizon).abs() < 1e-6
    };
    scores.iter().find(fits).copied()
}

fn dot(score: &Score) -> Dot {
    Dot { value: score.value, interval: score.ci_low.zip(score.ci_high).map(|(low, high)| [low, high]) }
}

fn percent(dot: Dot) -> Dot {
    Dot { value: 100. * dot.value, interval: dot.interval.map(|ends| ends.map(|end| 100. * end)) }
}

fn uses_future(scored: &Scored<'_>, system: &str) -> bool {
    scored.scores.iter().any(|score| score.model == system && score.uses_future)
}

/// Horizons at which a quantity was measured, s.
fn horizons(scores: &[&Score], quantity: Quantity) -> Vec<f64> {
    let mut found: Vec<f64> = Vec::new();
    for score in scores.iter().filter(|s| (s.protocol, s.metric.as_str()) == (quantity.protocol, quantity.metric)) {
        if !found.contains(&score.horizon_s) {
            found.push(score.horizon_s);
        }
    }
    found.sort_by(f64::total_cmp);
    found
}

fn by_horizon(scored: &Scored<'_>, scores: &[&Score]) -> (Vec<DotPanel>, String) {
    let panel = |quantity: Quantity| {
        let horizons = horizons(scores, quantity);
        let rows = scored.systems.iter().map(|system| {
            let found: Vec<Option<&Score>> = horizons.iter().map(|h| of(scores, quantity, system, *h)).collect();
            DotRow {
                name: (*system).to_owned(),
                uses_future: uses_future(scored, system),
                note: found.last().copied().flatten().map_or_else(String::new, |score| dot_note(score.value)),
                dots: found.into_iter().map(|score| score.map(dot)).collect(),
            }
        });
        DotPanel {
            title: match (horizons.first(), horizons.last()) {
                (Some(first), Some(last)) if first < last => quantity.title(&format!("{first} to {last} s")),
                _ => quantity.title(&horizons.first().map_or_else(String::new, |h| format!("{h} s"))),
            },
            axis: quantity.axis.to_owned(),
            scaling: DotScaling::Log,
            columns: horizons.iter().map(f64::to_string).collect(),
            notes: horizons.last().map_or_else(String::new, |h| format!("{h} s")),
            rows: rows.filter(|row| row.dots.iter().any(Option::is_some)).collect(),
        }
    };
    let caption = "Each row is a system, each dot its error at one horizon, bars are 95 % intervals from a bootstrap \
                   over drivers; dashed lines carry the first row down. Systems without a network have one future. \
                   Hollow: handed recorded futures, which no system on a road has.";
    (
        [PREDICTION, BEST_OF_6].map(panel).into_iter().filter(|panel| !panel.rows.is_empty()).collect(),
        caption.to_owned(),
    )
}

fn ablation(scored: &Scored<'_>, scores: &[&Score], site: &str) -> (Vec<DotPanel>, String) {
    let against = |quantity: Quantity| {
        let last = horizons(scores, quantity).last().copied().unwrap_or_default();
        let rows = scored.systems.iter().filter(|system| **system != scored.ours).filter_map(|system| {
            let score = of(scores, quantity, system, last)?;
            let difference = scored.differences.iter().find(|d| {
                (d.protocol, d.metric.as_str(), d.k) == (quantity.protocol, quantity.metric, Some(quantity.k))
                    && d.site == site
                    && d.b == *system
            })?;
            // The file has the full model minus the other.
            let interval = difference.ci_low.zip(difference.ci_high).map(|(low, high)| [-high, -low]);
            Some(DotRow {
                name: (*system).to_owned(),
                uses_future: uses_future(scored, system),
                dots: vec![Some(Dot { value: -difference.value, interval })],
                note: dot_note(score.value),
            })
        });
        let full = of(scores, quantity, scored.ours, last);
        let row = full.map(|score| DotRow {
            name: scored.ours.to_owned(),
            uses_future: false,
            dots: vec![Some(Dot { value: 0., interval: None })],
            note: dot_note(score.value),
        });
        DotPanel {
            title: quantity.title(&format!("{last} s")),
            axis: "difference to the full model (m)".to_owned(),
            scaling: DotScaling::Difference,
            columns: Vec::new(),
            notes: "m".to_owned(),
            rows: row.into_iter().chain(rows).collect(),
        }
    };
    let overlap = || {
        let last = horizons(scores, OVERLAP).last().copied().unwrap_or_default();
        let row = |system: &&str| {
            let score = of(scores, OVERLAP, system, last)?;
            Some(DotRow {
                name: (*system).to_owned(),
                uses_future: uses_future(scored, system),
                dots: vec![Some(percent(dot(score)))],
                note: format!("{:.1}", 100. * score.value),
            })
        };
        DotPanel {
            title: OVERLAP.title(&format!("{last} s")),
            axis: OVERLAP.axis.to_owned(),
            scaling: DotScaling::FromZero,
            columns: Vec::new(),
            notes: "%".to_owned(),
            rows: scored.systems.iter().filter_map(row).collect(),
        }
    };
    let caption = "Each row changes one thing in the full model. Above, how much larger the error becomes, with the \
                   95 % interval of that difference from a bootstrap over drivers, both models on the same draws: \
                   right of zero the part helps. Numbers on the right are the values themselves. Hollow: handed \
                   recorded futures, a triangle where the value lies beyond the axis; such rows have no place \
                   under protocol clean.";
    let panels = [against(PREDICTION), against(BEST_OF_6), overlap()];
    (panels.into_iter().filter(|panel| !panel.rows.is_empty()).collect(), caption.to_owned())
}

#[cfg(test)]
mod tests {
    use gnp_data::Dataset;
    use gnp_eval::Verdict;

    use super::*;

    fn score(model: &str, quantity: Quantity, horizon_s: f64, value: f64) -> Score {
        Score {
            dataset: Dataset::NGSIM,
            site: "us-101".to_owned(),
            manoeuvre: None,
            model: model.to_owned(),
            seeds: 1,
            protocol: quantity.protocol,
            metric: quantity.metric.to_owned(),
            k: Some(quantity.k),
            horizon_s,
            value,
            ci_low: Some(value * 0.9),
            ci_high: Some(value * 1.1),
            event_ci_low: None,
            event_ci_high: None,
            windows: 85,
            vehicles: 80,
            events: 1,
            simulated: false,
            uses_future: model == "uses_future",
        }
    }

    fn scored<'a>(scores: &'a [Score], differences: &'a [Comparison]) -> Scored<'a> {
        let source = Source { words: "made up".to_owned(), simulated: false };
        Scored { ours: "gnp", systems: &["gnp", "other", "uses_future"], scores, differences, source }
    }

    fn scores() -> Vec<Score> {
        let value = |model: &str| if model == "gnp" { 1. } else { 1.5 };
        let mut all = Vec::new();
        for model in ["gnp", "other", "uses_future"] {
            all.extend([1., 5.].map(|h| score(model, PREDICTION, h, h * value(model))));
            if model != "uses_future" {
                all.push(score(model, BEST_OF_6, 5., value(model)));
                all.push(score(model, OVERLAP, 5., 0.1 * value(model)));
            }
        }
        all
    }

    fn difference(quantity: Quantity, b: &str) -> Comparison {
        Comparison {
            dataset: Dataset::NGSIM,
            site: "us-101".to_owned(),
            protocol: quantity.protocol,
            metric: quantity.metric.to_owned(),
            k: Some(quantity.k),
            horizon_s: 5.,
            a: "gnp".to_owned(),
            b: b.to_owned(),
            seeds: [1; 2],
            value: -2.5,
            ci_low: Some(-3.),
            ci_high: Some(-1.),
            event_ci_low: None,
            event_ci_high: None,
            share_better: 1.,
            verdict: Verdict::Better,
            windows: 85,
            vehicles: 80,
            events: 1,
            simulated: false,
            uses_future: b == "uses_future",
        }
    }

    #[test]
    fn every_system_has_a_row_and_the_told_one_is_marked() {
        let scores = scores();
        let scored = scored(&scores, &[]);
        let of_site: Vec<&Score> = scores.iter().collect();
        let (panels, _) = by_horizon(&scored, &of_site);
        assert_eq!(panels[0].rows.iter().map(|row| row.uses_future).collect::<Vec<_>>(), [false, false, true]);
        assert_eq!(panels[0].columns, ["1", "5"]);
        assert_eq!(panels[0].rows[1].dots[1].unwrap().value, 7.5);
        // Under a protocol without future input there is no such row.
        assert_eq!(panels[1].rows.iter().map(|row| row.name.as_str()).collect::<Vec<_>>(), ["gnp", "other"]);
        let figures = figures("table1", &scored);
        assert_eq!(figures[0].name, "table1-error-by-horizon");
        assert!(figures[0].svg.contains("future input") && figures[0].caption.contains("85 windows of 80 drivers"));
        assert!(!figures[0].caption.contains("seeds"));
    }

    #[test]
    fn several_seeds_are_said() {
        let mut scores = scores();
        scores.iter_mut().filter(|score| score.model == "gnp").for_each(|score| score.seeds = 3);
        for stem in ["table1", "table2"] {
            let figures = figures(stem, &scored(&scores, &[]));
            assert!(figures[0].caption.contains("(up to 3 seeds) are means"), "{}", figures[0].caption);
        }
    }

    /// The file has "full minus other"; the figure shows what the change adds.
    #[test]
    fn a_worse_variant_lies_right_of_zero() {
        let scores = scores();
        let differences =
            [difference(PREDICTION, "other"), difference(PREDICTION, "uses_future"), difference(BEST_OF_6, "other")];
        let scored = scored(&scores, &differences);
        let of_site: Vec<&Score> = scores.iter().collect();
        let (panels, _) = ablation(&scored, &of_site, "us-101");
        let row = &panels[0].rows[1];
        assert_eq!((row.name.as_str(), row.note.as_str()), ("other", "7.50"));
        assert_eq!(row.dots[0], Some(Dot { value: 2.5, interval: Some([1., 3.]) }));
        assert_eq!(panels.iter().map(|panel| panel.rows.len()).collect::<Vec<_>>(), [3, 2, 2]);
        assert_eq!(figures("table2", &scored)[0].name, "table2-ablation");
    }
}
