//! The short summary of a run: one sentence and one small table that a person reads in five seconds.

use crate::bootstrap::Interval;
use crate::comparison::{Comparison, Verdict};
use crate::metric::{Metric, MetricKind};
use crate::protocol::Protocol;
use crate::score::Score;
use crate::table::{TERMINAL_WIDTH, Table, TableCell, site_name, sites, wrapped};

/// Futures that the second column chooses from.
const K: usize = 6;
/// Room for the names of models in it.
const NAME_WIDTH: usize = 31;

/// Which of the scored models a summary shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SummaryModels<'a> {
    /// Name of the model that the run is about.
    pub model: &'a str,
    /// What it is called in the summary, such as `GNP`.
    pub label: &'a str,
    /// Name of the rule that is always shown, such as `constant velocity`.
    pub reference: &'a str,
    /// Names of all rule-based predictors, the reference among them or not.
    pub rules: &'a [&'a str],
}

/// The model, the reference and the best rule under [`Protocol::Clean`], by site.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Summary {
    /// What the model is called.
    pub label: String,
    /// Time at which it was measured: the longest whole second that was scored, s.
    pub horizon_s: f64,
    /// Whether any recording that was scored is simulated.
    pub simulated: bool,
    /// By site; all sites together come last, and only where there are several.
    pub sites: Vec<SiteSummary>,
}

/// What a summary says of one site.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SiteSummary {
    /// The site, or [`ALL_SITES`](crate::ALL_SITES).
    pub site: String,
    /// Windows that were scored.
    pub windows: u64,
    /// Drivers that were scored.
    pub vehicles: usize,
    /// The model, the reference and the best rule; two rows where the reference is the best rule.
    pub rows: Vec<SummaryRow>,
    /// Whether the model is better than the best rule by RMSE, drivers and, where there are 3 or more, events
    /// resampled for both together; `None` where they were not compared.
    pub verdict: Option<Verdict>,
}

/// One model on one site.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SummaryRow {
    /// Name, or the label of the model.
    pub name: String,
    /// Whether it is the rule with the lowest RMSE on the site.
    pub best_rule: bool,
    /// RMSE of the prediction at the horizon, m.
    pub rmse: SummaryValue,
    /// Error at the horizon of the nearest of 6 futures, m; `None` where it was not scored.
    pub min_fde: Option<SummaryValue>,
}

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SummaryValue {
    /// The value, m.
    pub value: f64,
    /// Interval by driver; `None` with fewer than two drivers.
    pub interval: Option<Interval>,
}

impl SummaryValue {
    fn of(score: &Score) -> Self {
        let interval = score.ci_low.zip(score.ci_high).map(|(low, high)| Interval { low, high });
        Self { value: score.value, interval }
    }

    /// `5.5 m (5.2 to 5.8)`.
    fn metres(&self) -> String {
        let interval = self.interval.map(|ends| format!(" ({:.1} to {:.1})", ends.low, ends.high));
        format!("{:.1} m{}", self.value, interval.unwrap_or_default())
    }

    fn cell(&self) -> TableCell {
        TableCell { text: format!("{:.2}", self.value), interval: self.interval, by_event: None }
    }
}

impl SummaryRow {
    /// Name in a table, where it is the `only` rule or not.
    fn title(&self, only: bool) -> String {
        match (self.best_rule, only) {
            (true, true) => format!("{} (best rule)", self.name),
            (true, false) => format!("best rule: {}", self.name),
            (false, _) => self.name.clone(),
        }
    }

    fn cells(&self) -> [TableCell; 2] {
        let missing = || TableCell::plain("-");
        [self.rmse.cell(), self.min_fde.as_ref().map_or_else(missing, SummaryValue::cell)]
    }
}

impl Summary {
    /// The summary of scores; `None` where the model was not scored under [`Protocol::Clean`].
    #[must_use]
    pub fn of(scores: &[Score], comparisons: &[Comparison], models: &SummaryModels<'_>) -> Option<Self> {
        let clean: Vec<&Score> =
            scores.iter().filter(|s| s.protocol == Protocol::Clean && s.manoeuvre.is_none()).collect();
        let own = |score: &&&Score| score.model == models.model && score.metric == MetricKind::RmseAt.name();
        let horizon_s = clean.iter().filter(own).map(|score| score.horizon_s).max_by(f64::total_cmp)?;
        let of_site = |site: &str| site_summary(site, horizon_s, &clean, comparisons, models);
        Some(Self {
            label: models.label.to_owned(),
            horizon_s,
            simulated: clean.iter().any(|score| score.simulated),
            sites: sites(clean.iter().map(|score| score.site.as_str())).into_iter().filter_map(of_site).collect(),
        })
    }

    /// One sentence: of all sites together where there are several.
    #[must_use]
    pub fn sentence(&self) -> String {
        self.sites.last().map_or_else(String::new, |site| self.sentence_of(site))
    }

    /// One sentence on one site.
    #[must_use]
    pub fn sentence_of(&self, site: &SiteSummary) -> String {
        let Some((own, rules)) = site.rows.split_first() else { return String::new() };
        let simulated = if self.simulated { " (simulated data)" } else { "" };
        let mut text = format!(
            "On {}{simulated}, the prediction of {} ends {} from the truth after {} s (RMSE)",
            site_name(&site.site),
            self.label,
            own.rmse.metres(),
            self.horizon_s,
        );
        for rule in rules {
            text += &match (rule.best_rule, rules.len()) {
                (true, 1) => format!(", that of {}, the best rule, {}", rule.name, rule.rmse.metres()),
                (true, _) => format!(", that of the best rule, {}, {}", rule.name, rule.rmse.metres()),
                (false, _) => format!(", that of {} {}", rule.name, rule.rmse.metres()),
            };
        }
        if rules.iter().any(|rule| rule.best_rule) {
            let label = &self.label;
            text += &match site.verdict {
                Some(Verdict::Better) => format!("; {label} is better than the best rule beyond the interval"),
                Some(Verdict::Worse) => format!("; {label} is worse than the best rule beyond the interval"),
                Some(Verdict::Open) => format!("; {label} and the best rule cannot be told apart"),
                None => String::new(),
            };
        }
        text + "."
    }

    /// The short table: three rows a site.
    #[must_use]
    pub fn table(&self) -> Table {
        let row = |site: &SiteSummary, row: &SummaryRow, title: String| {
            let name = TableCell::plain(format!("{}: {title}", site_name(&site.site)));
            std::iter::once(name).chain(row.cells()).collect()
        };
        let rows = self.sites.iter().flat_map(|site| titled(site).map(move |(model, title)| row(site, model, title)));
        let [rmse, min_fde] = self.columns();
        Table {
            name: "summary".to_owned(),
            detail: false,
            caption: self.note(),
            header: vec!["site: model".to_owned(), format!("{rmse} (m)"), format!("{min_fde} (m)")],
            rows: rows.collect(),
        }
    }

    /// The short table for a terminal, at most 80 columns wide, with the sentence above it.
    #[must_use]
    pub fn terminal(&self) -> String {
        let mut lines = wrapped(&self.sentence(), TERMINAL_WIDTH);
        let line = |name: &str, cells: [String; 2]| {
            let [rmse, min_fde] = cells;
            let text = format!("{name:NAME_WIDTH$}  {rmse:<22}  {min_fde}");
            text.trim_end().to_owned()
        };
        lines.push(String::new());
        lines.push(line("", self.columns().map(|title| format!("{title}, m"))));
        for site in &self.sites {
            let SiteSummary { windows, vehicles, .. } = site;
            lines.push(format!("{} ({windows} windows of {vehicles} drivers)", site_name(&site.site)));
            for (row, title) in titled(site) {
                let name = format!("  {title}");
                let cells = row.cells().map(|cell| cell.with_interval());
                if name.chars().count() > NAME_WIDTH {
                    lines.push(name);
                    lines.push(line("", cells));
                } else {
                    lines.push(line(&name, cells));
                }
            }
        }
        lines.extend(wrapped(&self.note(), TERMINAL_WIDTH));
        lines.join("\n") + "\n"
    }

    fn columns(&self) -> [String; 2] {
        [format!("RMSE at {} s", self.horizon_s), format!("minFDE_{K} at {} s", self.horizon_s)]
    }

    fn note(&self) -> String {
        let simulated = if self.simulated { "Data: *simulated*. " } else { "" };
        format!(
            "{simulated}Protocol clean: no future input. Intervals: 95 %, by driver; better or worse is said where \
             that of the difference leaves out zero and, with 3 events or more, that by event too. minFDE_{K} is the \
             nearest of {K} futures; a rule gives one. Best rule: the lowest RMSE of the rules on the site."
        )
    }
}

/// The rows of a site with their names in a table.
fn titled(site: &SiteSummary) -> impl Iterator<Item = (&SummaryRow, String)> {
    site.rows.iter().map(|row| (row, row.title(site.rows.len() == 2)))
}

fn site_summary(
    site: &str,
    horizon_s: f64,
    clean: &[&Score],
    comparisons: &[Comparison],
    models: &SummaryModels<'_>,
) -> Option<SiteSummary> {
    let find = |model: &str, metric: Metric| {
        let fits = |s: &&&Score| {
            (s.site.as_str(), s.model.as_str(), s.uses_future) == (site, model, false)
                && (s.metric.as_str(), s.k, s.horizon_s) == (metric.kind.name(), metric.k, metric.horizon_s)
        };
        clean.iter().find(fits).copied()
    };
    let rmse = |model: &str| find(model, Metric::top_1(MetricKind::RmseAt, horizon_s));
    let row = |name: &str, model: &str, best_rule: bool| {
        Some(SummaryRow {
            name: name.to_owned(),
            best_rule,
            rmse: SummaryValue::of(rmse(model)?),
            min_fde: find(model, Metric::best_of(MetricKind::MinFde, K, horizon_s)).map(SummaryValue::of),
        })
    };
    let own = rmse(models.model)?;
    let rules = models.rules.iter().copied().filter_map(|rule| Some((rule, rmse(rule)?.value)));
    let best = rules.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(rule, _)| rule);
    let verdict = comparisons.iter().find(|row| {
        (row.protocol, row.site.as_str(), row.metric.as_str()) == (Protocol::Clean, site, MetricKind::RmseAt.name())
            && (row.a.as_str(), Some(row.b.as_str()), row.horizon_s) == (models.model, best, horizon_s)
    });
    let other = best.filter(|rule| *rule != models.reference);
    let rows = [
        row(models.label, models.model, false),
        row(models.reference, models.reference, best == Some(models.reference)),
        other.and_then(|rule| row(rule, rule, true)),
    ];
    Some(SiteSummary {
        site: site.to_owned(),
        windows: own.windows,
        vehicles: own.vehicles,
        rows: rows.into_iter().flatten().collect(),
        verdict: verdict.map(|row| row.verdict),
    })
}

#[cfg(test)]
mod tests;
