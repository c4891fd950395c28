//! What stands in which table.

use crate::bootstrap::Interval;
use crate::comparison::{Comparison, Verdict};
use crate::manoeuvre::Manoeuvre;
use crate::metric::{Metric, MetricKind};
use crate::protocol::Protocol;
use crate::score::{ALL_SITES, Score};
use crate::table::{Table, TableCell, TableHead};

/// A column: one metric, or several set as `a/b/c`.
struct Column {
    title: String,
    metrics: Vec<Metric>,
    shown: Shown,
}

/// What stands beside the value of a column.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shown {
    /// Nothing.
    Value,
    /// The interval by driver.
    Interval,
    /// The intervals by driver and by event.
    Both,
}

/// Tables of scores: one for each dataset, protocol and site among them, in the order in which they
/// first appear; rows in the order of the models. All sites together come last, and only where there
/// are several. Under `clean` a second table of each site is of several futures and of densities; details
/// are further metrics, densities by second and, where there are any, lane changes; and one table of all
/// sites has a row for each model and [`Manoeuvre`].
#[must_use]
pub fn tables(scores: &[Score], head: &TableHead) -> Vec<Table> {
    let mut tables = Vec::new();
    for kind in distinct(scores.iter().map(|score| (score.dataset, score.protocol))) {
        let of_kind = || scores.iter().filter(move |score| (score.dataset, score.protocol) == kind);
        let whole = || of_kind().filter(|score| score.manoeuvre.is_none());
        for site in sites(whole().map(|score| score.site.as_str())) {
            let of_site: Vec<&Score> = whole().filter(|score| score.site == site).collect();
            let last = horizons(&of_site).last().copied().unwrap_or_default();
            let part = Section { site, protocol: kind.1, scores: &of_site, head };
            tables.push(part.table("", false, columns(kind.1, &of_site)));
            if kind.1 == Protocol::Clean {
                tables.push(part.table(" futures", false, futures(last, part.has_densities())));
                tables.push(part.table(" further", true, further(last)));
                if part.has_densities() {
                    tables.push(part.table(" densities", true, densities(&horizons(&of_site))));
                }
                tables.extend(part.lane_changes(last));
            }
        }
        let parted: Vec<&Score> = of_kind().filter(|score| score.manoeuvre.is_some()).collect();
        if !parted.is_empty() {
            tables.push(by_manoeuvre(kind.1, &parted, head));
        }
    }
    tables
}

/// Tables of differences: one for each protocol and site, one row for each other model.
#[must_use]
pub fn comparison_tables(comparisons: &[Comparison], head: &TableHead) -> Vec<Table> {
    let mut tables = Vec::new();
    for kind in distinct(comparisons.iter().map(|row| (row.dataset, row.protocol, row.site.as_str(), row.a.as_str()))) {
        let of_kind: Vec<&Comparison> = comparisons
            .iter()
            .filter(|row| (row.dataset, row.protocol, row.site.as_str(), row.a.as_str()) == kind)
            .collect();
        let (_, protocol, site, model) = kind;
        let metrics = distinct(of_kind.iter().map(|row| (row.metric.as_str(), row.k, row.horizon_s)));
        let title = |(metric, k, horizon_s): &(&str, Option<usize>, f64)| match k {
            Some(k) => format!("{metric}_{k} {horizon_s} s"),
            None => format!("{metric} {horizon_s} s"),
        };
        let row = |other: &str, (uses_future, seeds): (bool, usize)| {
            let cells = metrics.iter().map(|metric| {
                let found =
                    of_kind.iter().find(|row| row.b == other && (row.metric.as_str(), row.k, row.horizon_s) == *metric);
                found.map_or_else(|| TableCell::plain("-"), |row| difference_cell(row))
            });
            std::iter::once(TableCell::plain(named(other, uses_future, seeds))).chain(cells).collect()
        };
        let others = distinct(of_kind.iter().map(|row| (row.b.as_str(), (row.uses_future, row.seeds[1]))));
        let seeds = if of_kind.iter().any(|row| row.seeds != [1; 2]) { " and seeds" } else { "" };
        let events = of_kind.iter().any(|row| row.event_ci_low.is_some());
        let who = if of_kind.iter().all(|row| row.events == 0) { "vehicles" } else { "drivers" };
        let drawn = match events {
            true => format!("of {who}{seeds}, and in square brackets of events{seeds}, both on the same draws) leave"),
            false => format!("of {who}{seeds}, both on the same draws) leaves"),
        };
        let interval = if events { "where both intervals" } else { "where the interval" };
        let one_seed = if of_kind.iter().any(|row| row.seeds.contains(&1)) { ONE_SEED } else { "" };
        let simulated = if of_kind.iter().any(|row| row.simulated) { ", *simulated*" } else { "" };
        let place = site_name(site);
        tables.push(Table {
            name: format!("{} {place} differences", protocol.name()),
            detail: true,
            caption: format!(
                "{place}{simulated}: protocol {}, {model} minus the model of the row on the same windows, split by {}, \
                 {} Hz. Below zero {model} is better; + and - mark {interval} (95 %, {drawn} out zero: + for {model}, \
                 - against it.{one_seed}",
                protocol.name(),
                head.split,
                head.rate_hz
            ),
            header: std::iter::once(format!("{model} minus")).chain(metrics.iter().map(title)).collect(),
            rows: others.iter().map(|(other, marks)| row(other, *marks)).collect(),
        });
    }
    tables
}

fn difference_cell(row: &Comparison) -> TableCell {
    let mark = match row.verdict {
        Verdict::Better => " +",
        Verdict::Worse => " -",
        Verdict::Open => "",
    };
    TableCell {
        text: format!("{:.2}{mark}", row.value),
        interval: interval(row.ci_low, row.ci_high),
        by_event: interval(row.event_ci_low, row.event_ci_high),
    }
}

fn interval(low: Option<f64>, high: Option<f64>) -> Option<Interval> {
    Some(Interval { low: low?, high: high? })
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

/// The sites in order, all of them together last and only where there are several.
pub(crate) fn sites<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut sites = distinct(names);
    sites.sort_by_key(|site| *site == ALL_SITES);
    if let [_, ALL_SITES] = sites[..] {
        sites.pop();
    }
    sites
}

/// The site as tables name it.
pub(crate) fn site_name(site: &str) -> &str {
    if site == ALL_SITES { "all sites" } else { site }
}

/// A model's name, with what must be known of its row.
fn named(model: &str, uses_future: bool, seeds: usize) -> String {
    let mut marks = Vec::new();
    if uses_future {
        marks.push("future input".to_owned());
    }
    if seeds > 1 {
        marks.push(format!("{seeds} seeds"));
    }
    if marks.is_empty() { model.to_owned() } else { format!("{model} ({})", marks.join(", ")) }
}

/// A row: a model, whether it is handed recorded futures, and its seeds.
type Row<'a> = (&'a str, bool, usize);

fn row_of(score: &Score) -> Row<'_> {
    (&score.model, score.uses_future, score.seeds)
}

/// The scores of one site under one protocol.
struct Section<'a> {
    site: &'a str,
    protocol: Protocol,
    scores: &'a [&'a Score],
    head: &'a TableHead,
}

impl Section<'_> {
    fn table(&self, part: &str, detail: bool, columns: Vec<Column>) -> Table {
        let site = site_name(self.site);
        let rows = self.rows(&columns);
        let mut caption = caption(site, self.protocol, self.scores, &rows, self.head);
        let shows = |kinds: &[MetricKind]| {
            columns.iter().flat_map(|column| &column.metrics).any(|metric| kinds.contains(&metric.kind))
        };
        if shows(&[MetricKind::Overlap]) {
            caption += &overlap_floor(self.scores);
        }
        if shows(&[MetricKind::NllAt, MetricKind::NllTo]) {
            caption += " NLL: nats, density per m², of modes as Gaussians whose spreads are fitted to other windows; \
                        within 50 and 90 %: share of windows in the central interval along the road.";
        }
        Table {
            name: format!("{} {site}{part}", self.protocol.name()),
            detail,
            caption,
            header: std::iter::once("model".to_owned()).chain(columns.iter().map(|c| c.title.clone())).collect(),
            rows,
        }
    }

    /// Whether any model has densities.
    fn has_densities(&self) -> bool {
        self.scores.iter().any(|score| score.metric == MetricKind::NllTo.name())
    }

    /// One row a model.
    fn rows(&self, columns: &[Column]) -> Vec<Vec<TableCell>> {
        let row = |(model, uses_future, seeds): Row<'_>| {
            let is_own = |s: &&&Score| row_of(s) == (model, uses_future, seeds);
            let own: Vec<&Score> = self.scores.iter().filter(is_own).copied().collect();
            let cells = columns.iter().map(|column| cell(column, &own));
            std::iter::once(TableCell::plain(named(model, uses_future, seeds))).chain(cells).collect()
        };
        distinct(self.scores.iter().map(|score| row_of(score))).into_iter().map(row).collect()
    }

    /// Which lane changes are among the futures; nothing where no vehicle changes lane.
    fn lane_changes(&self, last: f64) -> Option<Table> {
        let kinds = [
            (MetricKind::LaneChangeRecall, "begins", "that begin within the first second"),
            (MetricKind::LaneChangeRecallUnderWay, "under way", "under way when last observed"),
        ];
        let counted = |kind: MetricKind| self.scores.iter().find(|score| score.metric == kind.name());
        let there = kinds.iter().filter_map(|(kind, title, words)| Some((*kind, title, words, counted(*kind)?)));
        let (mut columns, mut counts) = (Vec::new(), Vec::new());
        let who = [who(self.scores), "s"].concat();
        for (kind, title, words, Score { windows, vehicles, .. }) in there {
            let of = |k| single(format!("{title}, k = {k}"), Metric::best_of(kind, k, last), Shown::Interval);
            columns.extend([1, 6].map(of));
            counts.push(format!("{words}: {windows} windows, {vehicles} {who}"));
        }
        let site = site_name(self.site);
        let simulated = if self.scores.iter().any(|score| score.simulated) { ", *simulated*" } else { "" };
        let rows = self.rows(&columns);
        (!columns.is_empty()).then(|| Table {
            name: format!("{} {site} lane changes", self.protocol.name()),
            detail: true,
            caption: format!(
                "{site}{simulated}: protocol {}, share of recorded lane changes for which one of k futures ends in the \
                 new lane, by the lines. Lane changes {}. Split by {}{}",
                self.protocol.name(),
                counts.join("; "),
                self.head.split,
                intervals(self.scores, &rows)
            ),
            header: std::iter::once("model".to_owned()).chain(columns.iter().map(|c| c.title.clone())).collect(),
            rows,
        })
    }
}

/// How often recorded boxes overlap: no forecast can be held to less.
fn overlap_floor(scores: &[&Score]) -> String {
    let floor = scores.iter().find(|score| score.metric == MetricKind::RecordedOverlap.name());
    floor.map_or_else(String::new, |score| {
        format!(" Recorded boxes overlap in {:.1} % of the windows: the floor under overlap.", 100. * score.value)
    })
}

/// One row a model and manoeuvre.
fn by_manoeuvre(protocol: Protocol, scores: &[&Score], head: &TableHead) -> Table {
    use MetricKind as M;
    let last = horizons(scores).last().copied().unwrap_or_default();
    let columns = [
        single(format!("RMSE {last} s"), Metric::top_1(M::RmseAt, last), Shown::Interval),
        single("lateral RMSE", Metric::top_1(M::LateralRmseAt, last), Shown::Value),
        single("longitudinal RMSE", Metric::top_1(M::LongitudinalRmseAt, last), Shown::Value),
        single("minADE_6", Metric::best_of(M::MinAde, 6, last), Shown::Value),
        single("minFDE_6", Metric::best_of(M::MinFde, 6, last), Shown::Interval),
        single("miss rate_6", Metric::best_of(M::MissRate, 6, last), Shown::Value),
    ];
    let mut rows = Vec::new();
    for manoeuvre in Manoeuvre::ALL {
        let of_group = || scores.iter().filter(move |score| score.manoeuvre == Some(manoeuvre)).copied();
        for (model, uses_future, seeds) in distinct(of_group().map(row_of)) {
            let own: Vec<&Score> = of_group().filter(|s| row_of(s) == (model, uses_future, seeds)).collect();
            let windows = own.first().map_or_else(|| "-".to_owned(), |score| score.windows.to_string());
            let name = TableCell::plain(format!("{}: {}", manoeuvre.name(), named(model, uses_future, seeds)));
            let cells = columns.iter().map(|column| cell(column, &own));
            rows.push([name, TableCell::plain(windows)].into_iter().chain(cells).collect());
        }
    }
    let titles = columns.iter().map(|column| column.title.clone());
    let caption = caption("all sites, by what the vehicle did", protocol, scores, &rows, head);
    Table {
        name: format!("{} all sites by manoeuvre", protocol.name()),
        detail: true,
        caption,
        header: ["manoeuvre: model".to_owned(), "windows".to_owned()].into_iter().chain(titles).collect(),
        rows,
    }
}

fn horizons(scores: &[&Score]) -> Vec<f64> {
    let mut seconds: Vec<f64> = scores.iter().map(|score| score.horizon_s).collect();
    seconds.sort_by(f64::total_cmp);
    seconds.dedup();
    seconds
}

fn single(title: impl Into<String>, metric: Metric, shown: Shown) -> Column {
    Column { title: title.into(), metrics: vec![metric], shown }
}

fn columns(protocol: Protocol, scores: &[&Score]) -> Vec<Column> {
    use MetricKind as M;
    use Shown::{Both, Interval, Value};
    let seconds = horizons(scores);
    let last = seconds.last().copied().unwrap_or_default();
    let rmse = |second: &f64| {
        let shown = if *second == last { Both } else { Value };
        single(format!("RMSE {second} s"), Metric::top_1(M::RmseAt, *second), shown)
    };
    let as_printed = |second: &f64| Column {
        title: format!("ADE/FDE/RMSE {second} s"),
        metrics: [M::MinAde, M::MinFde, M::RmseToPerCoordinate].map(|kind| Metric::best_of(kind, 20, *second)).into(),
        shown: Value,
    };
    let best = |title: &str, kind, k, shown| single(format!("{title}_{k}"), Metric::best_of(kind, k, last), shown);
    match protocol {
        Protocol::Paper => seconds.iter().map(as_printed).collect(),
        Protocol::Literature => seconds.iter().map(rmse).collect(),
        Protocol::Clean => {
            let rest = [
                single(format!("bias {last} s"), Metric::top_1(M::LongitudinalBiasAt, last), Value),
                single("mean RMSE", Metric::of_all(M::MixtureMeanRmseAt, last), Value),
                single("arg-max RMSE", Metric::of_all(M::LikeliestRmseAt, last), Value),
                best("minADE", M::MinAde, 6, Value),
                best("minFDE", M::MinFde, 6, Both),
            ];
            seconds.iter().map(rmse).chain(rest).collect()
        }
        Protocol::Argoverse2 => vec![
            best("minADE", M::MinAde, 1, Value),
            best("minFDE", M::MinFde, 1, Interval),
            best("miss rate", M::MissRate, 1, Value),
            best("minADE", M::MinAde, 6, Value),
            best("minFDE", M::MinFde, 6, Interval),
            best("miss rate", M::MissRate, 6, Value),
            best("brier-minFDE", M::BrierMinFde, 6, Value),
        ],
        Protocol::NuScenes => vec![
            best("minFDE", M::MinFde, 1, Interval),
            best("minADE", M::SampledMinAde, 5, Interval),
            best("minADE", M::SampledMinAde, 10, Value),
            best("miss rate", M::AnyPointMissRate, 5, Value),
            best("miss rate", M::AnyPointMissRate, 10, Value),
            best("off-road", M::OffRoad, 10, Value),
        ],
        Protocol::Waymo => seconds
            .iter()
            .flat_map(|second| {
                let at = |title: &str, kind, k| {
                    single(format!("{title} {second} s"), Metric::best_of(kind, k, *second), Value)
                };
                [
                    at("minADE", M::SampledMinAde, 6),
                    at("minFDE", M::MinFde, 6),
                    at("miss rate", M::BoxMissRate, 6),
                    at("overlap_1", M::Overlap, 1),
                ]
            })
            .collect(),
    }
}

/// The second table of `clean`: several futures, and densities where there are any.
fn futures(last: f64, densities: bool) -> Vec<Column> {
    use MetricKind as M;
    let best = |title: &str, kind, k| single(format!("{title}_{k}"), Metric::best_of(kind, k, last), Shown::Value);
    let mut columns =
        vec![best("minFDE", M::MinFde, 20), best("miss rate", M::MissRate, 6), best("overlap", M::Overlap, 1)];
    if densities {
        columns.extend([
            single(format!("NLL {last} s"), Metric::of_all(M::NllAt, last), Shown::Value),
            single("NLL mean", Metric::of_all(M::NllTo, last), Shown::Both),
            single("within 50 %", Metric::of_all(M::Coverage50At, last), Shown::Value),
            single("within 90 %", Metric::of_all(M::Coverage90At, last), Shown::Value),
        ]);
    }
    columns
}

/// What the first tables of `clean` have no room for.
fn further(last: f64) -> Vec<Column> {
    use MetricKind as M;
    let best = |title: &str, kind, k| single(format!("{title}_{k}"), Metric::best_of(kind, k, last), Shown::Value);
    let top = |title: &str, kind| single(title, Metric::top_1(kind, last), Shown::Value);
    vec![
        top("ADE", M::Ade),
        top("FDE", M::Fde),
        top("lateral RMSE", M::LateralRmseAt),
        top("longitudinal RMSE", M::LongitudinalRmseAt),
        best("minADE", M::MinAde, 20),
        best("brier-minFDE", M::BrierMinFde, 6),
        best("off-road", M::OffRoad, 6),
        best("overlap", M::Overlap, 6),
    ]
}

/// Bias and densities by second.
fn densities(seconds: &[f64]) -> Vec<Column> {
    use MetricKind as M;
    let value = |title: &str, metric: fn(f64) -> Metric| {
        let title = title.to_owned();
        seconds.iter().map(move |second| single(format!("{title} {second} s"), metric(*second), Shown::Value))
    };
    let within = |second: &f64| Column {
        title: format!("50/90 % {second} s"),
        metrics: [M::Coverage50At, M::Coverage90At].map(|kind| Metric::of_all(kind, *second)).into(),
        shown: Shown::Value,
    };
    value("bias", |second| Metric::top_1(M::LongitudinalBiasAt, second))
        .chain(value("NLL", |second| Metric::of_all(M::NllAt, second)))
        .chain(seconds.iter().map(within))
        .collect()
}

fn cell(column: &Column, scores: &[&Score]) -> TableCell {
    let find = |metric: &Metric| {
        let wanted = |s: &&&Score| s.metric == metric.kind.name() && s.k == metric.k && s.horizon_s == metric.horizon_s;
        scores.iter().find(wanted).copied()
    };
    let found: Vec<Option<&Score>> = column.metrics.iter().map(find).collect();
    let text = |score: &Option<&Score>| score.map_or_else(|| "-".to_owned(), |score| format!("{:.2}", score.value));
    let own = |shown: &[Shown]| found.first().copied().flatten().filter(|_| shown.contains(&column.shown));
    TableCell {
        text: found.iter().map(text).collect::<Vec<_>>().join("/"),
        interval: own(&[Shown::Interval, Shown::Both]).and_then(|score| interval(score.ci_low, score.ci_high)),
        by_event: own(&[Shown::Both]).and_then(|score| interval(score.event_ci_low, score.event_ci_high)),
    }
}

/// Said where intervals are of drivers alone.
const ONE_SEED: &str = " Differences between trainings of rows with one seed are not in the interval.";

/// Whom intervals are by: files from before drivers were known count vehicles, and no events.
fn who(scores: &[&Score]) -> &'static str {
    if scores.iter().all(|score| score.events == 0) { "vehicle" } else { "driver" }
}

/// The end of a caption: what the intervals in the cells are by; nothing but a full stop where there are none.
fn intervals(scores: &[&Score], rows: &[Vec<TableCell>]) -> String {
    let some = |has: fn(&TableCell) -> bool| rows.iter().flatten().any(has);
    let (inner, outer) = (some(|cell| cell.interval.is_some()), some(|cell| cell.by_event.is_some()));
    let seeds = if scores.iter().any(|score| score.seeds > 1) { " and seed" } else { "" };
    let one_seed = if scores.iter().any(|score| score.seeds == 1) { ONE_SEED } else { "" };
    let who = who(scores);
    match (inner, outer) {
        (true, true) => {
            format!("; intervals of 95 % by {who}{seeds}, in square brackets by event{seeds}.{one_seed}")
        }
        (true, false) => format!("; intervals of 95 % by {who}{seeds}.{one_seed}"),
        (false, true) => format!("; intervals of 95 % in square brackets by event{seeds}.{one_seed}"),
        (false, false) => ".".to_owned(),
    }
}

fn caption(site: &str, protocol: Protocol, scores: &[&Score], rows: &[Vec<TableCell>], head: &TableHead) -> String {
    let simulated = if scores.iter().any(|score| score.simulated) { ", *simulated*" } else { "" };
    let span = |counts: Vec<u64>| {
        let (least, most) = (counts.iter().min().copied().unwrap_or(0), counts.iter().max().copied().unwrap_or(0));
        if least == most { format!("{most}") } else { format!("{least} to {most}") }
    };
    let counted: Vec<&&Score> = scores.iter().filter(|s| MetricKind::is_of_all_windows(&s.metric)).collect();
    let windows = span(counted.iter().map(|score| score.windows).collect());
    let drivers = span(counted.iter().map(|score| score.vehicles as u64).collect());
    let who = who(scores);
    let events = match span(counted.iter().map(|score| score.events as u64).collect()) {
        _ if who == "vehicle" => String::new(),
        events => format!(", {events} events"),
    };
    format!(
        "{site}{simulated}: protocol {} ({}), split by {}, {} Hz, {windows} windows, {drivers} {who}s{events}. \
         Lengths in m{}",
        protocol.name(),
        protocol.summary(),
        head.split,
        head.rate_hz,
        intervals(scores, rows),
    )
}
