//! Tables for people: the terminal and Markdown.

use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, presets};

use crate::metric::{Metric, MetricKind};
use crate::protocol::Protocol;
use crate::score::{ALL_SITES, Score};

/// Widest a terminal table gets, in columns.
const TERMINAL_WIDTH: u16 = 100;
/// Room that the models' names keep in it.
const NAME_WIDTH: u16 = 12;

/// What a table must say that its scores do not.
#[derive(Clone, Debug, PartialEq)]
pub struct TableHead {
    /// How the windows were parted, as `recording`, or `us-101 recording, i-80 vehicle`.
    pub split: String,
    /// Rate of the windows' frames, Hz.
    pub rate_hz: f64,
}

/// Models against metrics, on one site under one protocol.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Site, protocol, split, k, rate, windows, vehicles, and *simulated* where it applies.
    pub caption: String,
    /// Column titles, the first for the model.
    pub header: Vec<String>,
    /// One row a model.
    pub rows: Vec<Vec<TableCell>>,
}

/// A number as text, perhaps with its interval.
#[derive(Clone, Debug, PartialEq)]
pub struct TableCell {
    /// The value, or the model's name; a dash where there is none.
    pub text: String,
    /// `low to high`.
    pub interval: Option<String>,
}

/// A column: one metric, or several set as `a/b/c`.
struct Column {
    title: String,
    metrics: Vec<Metric>,
    interval: bool,
}

/// One table for each dataset, protocol and site among the scores, in the order in which they first
/// appear; rows in the order of the models. All sites together come last, and only where there are
/// several.
#[must_use]
pub fn tables(scores: &[Score], head: &TableHead) -> Vec<Table> {
    let mut tables = Vec::new();
    for kind in distinct(scores.iter().map(|score| (score.dataset, score.protocol))) {
        let of_kind = || scores.iter().filter(move |score| (score.dataset, score.protocol) == kind);
        let mut sites = distinct(of_kind().map(|score| score.site.as_str()));
        sites.sort_by_key(|site| *site == ALL_SITES);
        if let [_, ALL_SITES] = sites[..] {
            sites.pop();
        }
        for site in sites {
            let of_site: Vec<&Score> = of_kind().filter(|score| score.site == site).collect();
            tables.push(table(site, kind.1, &of_site, head));
        }
    }
    tables
}

/// Each item once, in the order of first appearance.
fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut seen = Vec::new();
    for item in items {
        if !seen.contains(&item) {
            seen.push(item);
        }
    }
    seen
}

fn table(site: &str, protocol: Protocol, scores: &[&Score], head: &TableHead) -> Table {
    let columns = columns(protocol, scores);
    let models = distinct(scores.iter().map(|score| (score.model.as_str(), score.future_input)));
    let row = |(model, future_input): &(&str, bool)| {
        let name = if *future_input { format!("{model} (future input)") } else { (*model).to_owned() };
        let own: Vec<&Score> =
            scores.iter().filter(|s| (s.model.as_str(), s.future_input) == (*model, *future_input)).copied().collect();
        let cells = columns.iter().map(|column| cell(column, &own));
        std::iter::once(TableCell { text: name, interval: None }).chain(cells).collect()
    };
    let site = if site == ALL_SITES { "all sites" } else { site };
    Table {
        caption: caption(site, protocol, scores, head),
        header: std::iter::once("model".to_owned()).chain(columns.iter().map(|c| c.title.clone())).collect(),
        rows: models.iter().map(row).collect(),
    }
}

fn columns(protocol: Protocol, scores: &[&Score]) -> Vec<Column> {
    use MetricKind as M;
    let mut seconds: Vec<f64> = scores.iter().map(|score| score.horizon_s).collect();
    seconds.sort_by(f64::total_cmp);
    seconds.dedup();
    let last = seconds.last().copied().unwrap_or_default();
    let single = |title: &str, metric, interval| Column { title: title.to_owned(), metrics: vec![metric], interval };
    let rmse = |second: &f64| single(&format!("RMSE {second} s"), Metric::top_1(M::RmseAt, *second), *second == last);
    let as_printed = |second: &f64| Column {
        title: format!("ADE/FDE/RMSE {second} s"),
        metrics: [M::MinAde, M::MinFde, M::RmseToPerCoordinate].map(|kind| Metric::best_of(kind, 20, *second)).into(),
        interval: false,
    };
    match protocol {
        Protocol::Paper => seconds.iter().map(as_printed).collect(),
        Protocol::Literature => seconds.iter().map(rmse).collect(),
        Protocol::Clean => {
            let rest = [
                single("ADE", Metric::top_1(M::Ade, last), false),
                single("FDE", Metric::top_1(M::Fde, last), false),
                single("minADE_6", Metric::best_of(M::MinAde, 6, last), false),
                single("minFDE_6", Metric::best_of(M::MinFde, 6, last), true),
                single("miss rate_6", Metric::best_of(M::MissRate, 6, last), false),
            ];
            seconds.iter().map(rmse).chain(rest).collect()
        }
    }
}

fn cell(column: &Column, scores: &[&Score]) -> TableCell {
    let find = |metric: &Metric| {
        let wanted = |s: &&&Score| s.metric == metric.kind.name() && s.k == metric.k && s.horizon_s == metric.horizon_s;
        scores.iter().find(wanted).copied()
    };
    let found: Vec<Option<&Score>> = column.metrics.iter().map(find).collect();
    let text = |score: &Option<&Score>| score.map_or_else(|| "-".to_owned(), |score| format!("{:.2}", score.value));
    let interval = |score: &Score| Some(format!("{:.2} to {:.2}", score.ci_low?, score.ci_high?));
    TableCell {
        text: found.iter().map(text).collect::<Vec<_>>().join("/"),
        interval: found.first().copied().flatten().filter(|_| column.interval).and_then(interval),
    }
}

fn caption(site: &str, protocol: Protocol, scores: &[&Score], head: &TableHead) -> String {
    let simulated = if scores.iter().any(|score| score.simulated) { ", *simulated*" } else { "" };
    let span = |counts: Vec<u64>| {
        let (least, most) = (counts.iter().min().copied().unwrap_or(0), counts.iter().max().copied().unwrap_or(0));
        if least == most { format!("{most}") } else { format!("{least} to {most}") }
    };
    // Off-road does not apply everywhere; the other metrics count the windows of a model.
    let counted: Vec<&&Score> = scores.iter().filter(|s| s.metric != MetricKind::OffRoad.name()).collect();
    let windows = span(counted.iter().map(|score| score.windows).collect());
    let vehicles = span(counted.iter().map(|score| score.vehicles as u64).collect());
    format!(
        "{site}{simulated}: protocol {} ({}), split by {}, {} Hz, {windows} windows, {vehicles} vehicles. \
         Lengths in m; intervals of 95 % by vehicle.",
        protocol.name(),
        protocol.summary(),
        head.split,
        head.rate_hz,
    )
}

impl Table {
    /// For a terminal: at most 100 columns wide, no colour, intervals below their values.
    #[must_use]
    pub fn terminal(&self) -> String {
        let mut table = comfy_table::Table::new();
        table.load_preset(presets::UTF8_HORIZONTAL_ONLY);
        table.set_content_arrangement(ContentArrangement::Dynamic).set_width(TERMINAL_WIDTH);
        // Titles break after the quantity: `RMSE` above `5 s`.
        table.set_header(self.header.iter().map(|title| title.replacen(' ', "\n", 1)));
        for row in &self.rows {
            table.add_row(row.iter().map(|cell| match &cell.interval {
                Some(interval) => format!("{}\n{interval}", cell.text),
                None => cell.text.clone(),
            }));
        }
        let widths = table.column_max_content_widths();
        let numbers: u16 = widths.iter().skip(1).map(|width| width + 1).sum();
        for column in table.column_iter_mut() {
            column.set_padding((0, 0)); // the empty rule between columns parts them
            if column.index == 0 {
                continue;
            }
            column.set_cell_alignment(CellAlignment::Right);
            // Only names wrap, unless the numbers leave them no room.
            if numbers + NAME_WIDTH <= TERMINAL_WIDTH {
                column.set_constraint(ColumnConstraint::ContentWidth);
            }
        }
        let mut text = String::new();
        for line in wrapped(&self.caption).iter().map(String::as_str).chain(table.to_string().lines()) {
            text += line.trim_end();
            text += "\n";
        }
        text
    }

    /// For a document: a Markdown table below its caption, intervals in brackets.
    #[must_use]
    pub fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let escaped = |text: &str| text.replace('|', "\\|");
        let mut text = format!("{}\n\n", self.caption);
        text += &line(self.header.iter().map(|title| escaped(title)).collect());
        text += &line((0..self.header.len()).map(|i| if i == 0 { "---" } else { "---:" }.to_owned()).collect());
        for row in &self.rows {
            let cell = |cell: &TableCell| match &cell.interval {
                Some(interval) => format!("{} ({interval})", cell.text),
                None => escaped(&cell.text),
            };
            text += &line(row.iter().map(cell).collect());
        }
        text
    }
}

/// Lines of at most [`TERMINAL_WIDTH`] characters, broken at spaces.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last().map_or(0, |line| line.chars().count());
        if line > 0 && line + 1 + word.chars().count() > usize::from(TERMINAL_WIDTH) {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use gnp_data::{Dataset, WindowShape};

    use super::*;

    /// A score for every metric of a protocol; values grow by metric.
    fn scores(protocol: Protocol, site: &str, model: &str, start: f64) -> Vec<Score> {
        let shape = WindowShape { observed: 31, predicted: 50, step: 1, rate_hz: 10. };
        let metrics = protocol.metrics(&shape).unwrap();
        let score = |(i, metric): (usize, &Metric)| Score {
            dataset: Dataset::Ngsim,
            site: site.to_owned(),
            model: model.to_owned(),
            protocol,
            metric: metric.kind.name().to_owned(),
            k: metric.k,
            horizon_s: metric.horizon_s,
            value: start + 0.01 * i as f64,
            ci_low: Some(start - 1.),
            ci_high: Some(start + 1.),
            windows: 1234,
            vehicles: 56,
            simulated: false,
            future_input: model.contains("oracle"),
        };
        metrics.iter().enumerate().map(score).collect()
    }

    fn head() -> TableHead {
        TableHead { split: "recording".to_owned(), rate_hz: 10. }
    }

    #[test]
    fn a_table_states_what_its_numbers_rest_on() {
        let table = &tables(&scores(Protocol::Clean, "us-101", "gnp", 5.), &head())[0];
        for text in [table.terminal(), table.markdown()] {
            let flat = text.replace('\n', " ");
            for stated in ["us-101", "clean", "split by recording", "k = 6", "10 Hz", "1234 windows", "56 vehicles"] {
                assert!(flat.contains(stated), "{stated}: {text}");
            }
            assert!(!text.contains("simulated"), "{text}");
        }
        assert_eq!(table.header[1..6], ["RMSE 1 s", "RMSE 2 s", "RMSE 3 s", "RMSE 4 s", "RMSE 5 s"]);
        assert_eq!(table.header[6..], ["ADE", "FDE", "minADE_6", "minFDE_6", "miss rate_6"]);
    }

    #[test]
    fn simulated_is_said_as_soon_as_one_recording_is() {
        let mut scores = scores(Protocol::Literature, "highd-2", "gnp", 5.);
        scores[3].simulated = true;
        let table = &tables(&scores, &head())[0];
        assert!(table.terminal().contains("*simulated*") && table.markdown().contains("*simulated*"));
    }

    #[test]
    fn terminal_tables_fit_a_hundred_columns() {
        for protocol in Protocol::ALL {
            let mut all = scores(protocol, "us-101", "gnp", 105.);
            all.extend(scores(protocol, "us-101", "constant acceleration of the last second", 10.));
            all.extend(scores(protocol, "us-101", "gnp, oracle neighbours", 5.));
            let text = tables(&all, &head())[0].terminal();
            let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
            assert!(widest <= 100, "{widest} columns:\n{text}");
        }
    }

    #[test]
    fn markdown_rows_hold_values_and_intervals() {
        let text = tables(&scores(Protocol::Literature, "i-80", "a|b", 2.), &head())[0].markdown();
        // rmse_at and rmse_at_by_vehicle alternate, so RMSE grows by 0.02 a second.
        assert!(text.contains("\n| a\\|b | 2.00 | 2.02 | 2.04 | 2.06 | 2.08 (1.00 to 3.00) |\n"), "{text}");
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
        assert_eq!(tables(&one, &head()).len(), 1);
        let mut two = scores(Protocol::Clean, "i-80", "gnp", 4.);
        two.extend(one);
        let captions: Vec<String> = tables(&two, &head()).into_iter().map(|table| table.caption).collect();
        let starts: Vec<&str> = captions.iter().map(|caption| caption.split(':').next().unwrap()).collect();
        assert_eq!(starts, ["i-80", "us-101", "all sites"]);
    }
}
