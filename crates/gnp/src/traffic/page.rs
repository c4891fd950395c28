//! What was measured, in a few lines and as a page.

use std::collections::BTreeSet;

use gnp_data::{Recording, WindowShape};
use gnp_measures::{Distribution, Measure, Missing, Summary};
use gnp_plot::{Clip, ClipSpan, Evaluated, Figure, Report, ReportCell, ReportSection, ReportTable, Source};

use crate::error::Result;

/// Time that the player shows, s.
const PLAYED_S: f64 = 60.;
/// m/s to km/h.
const KMH: f64 = 3.6;

/// A few lines for the terminal.
pub(super) fn text(summary: &Summary, words: &str) -> String {
    let mut lines = vec![format!("{}: {}", summary.recording, extent(summary))];
    if !words.is_empty() {
        lines.push(format!("  {words}"));
    }
    lines.extend(facts(summary).into_iter().map(|(name, value)| format!("  {name}: {value}")));
    lines.join("\n")
}

/// How much traffic it is.
fn extent(summary: &Summary) -> String {
    let made = if summary.simulated { "simulated" } else { "recorded" };
    let (vehicles, km, seconds) = (summary.vehicles, summary.vehicle_km, summary.duration_s);
    format!("{vehicles} vehicles, {km:.1} vehicle-km in {seconds:.0} s, {made}")
}

/// The page: facts, figures, the player, tables.
pub(super) fn page(
    recording: &Recording,
    summary: &Summary,
    figures: Vec<Figure>,
    source: &Source,
    words: &str,
) -> Result<Report> {
    let mut report = Report::new(format!("Traffic: {}", source.words), source.simulated);
    let mut headline = vec![extent(summary)];
    headline.extend((!words.is_empty()).then(|| words.to_owned()));
    if summary.left_out.iter().any(|it| it.what.contains("sample of the traffic")) {
        headline.push("The file holds a sample of the traffic: flow and density are those of the sample".to_owned());
    }
    report.headline = headline.join(". ") + ".";
    let rows = facts(summary).into_iter().map(|(name, value)| vec![ReportCell::from(name), value.into()]).collect();
    let head = ["", "measured"].map(str::to_owned).to_vec();
    report.summary = Some(ReportTable { title: String::new(), head, rows, notes: Vec::new() });
    report.player = player(recording, summary)?;
    let mut drawn = ReportSection::new("Figures");
    drawn.figures = figures;
    let mut safety = ReportSection::new("How near to accidents");
    safety.tables.push(exposures(summary));
    let mut distributions = ReportSection::new("Distributions");
    distributions.tables.push(distribution_table(summary));
    let mut left_out = ReportSection::new("What could not be used").folded();
    left_out.facts =
        summary.left_out.iter().map(|it| (it.what.clone(), format!("{:.0} {}", it.amount, it.unit))).collect();
    report.sections = vec![drawn, safety, distributions];
    if !left_out.facts.is_empty() {
        report.sections.push(left_out);
    }
    Ok(report)
}

/// What most want to know, in words.
fn facts(summary: &Summary) -> Vec<(String, String)> {
    let mut facts = Vec::new();
    let mut add = |name: &str, value: String| facts.push((name.to_owned(), value));
    let roads: BTreeSet<u16> = summary.lanes.iter().map(|lane| lane.road).collect();
    for road in &roads {
        let of = if roads.len() > 1 { format!(", carriageway {road}") } else { String::new() };
        let diagram = summary.diagrams.iter().find(|it| it.road == *road && it.lane.is_none());
        if let Some(diagram) = diagram {
            let capacity = said(&diagram.capacity, |it| {
                format!("{:.0} veh/h and lane ({:.0} % of cells are below)", it.flow_veh_h, 100. * it.quantile)
            });
            add(&format!("greatest flow{of}"), capacity);
            add(&format!("free speed{of}"), said(&diagram.free_speed, |speed| format!("{:.0} km/h", speed * KMH)));
            let branch = said(&diagram.congested, |it| {
                format!("slope {:.0} km/h, jam density {:.0} veh/km", it.wave_speed * KMH, it.jam_density_veh_km)
            });
            add(&format!("congested branch{of}"), branch);
        }
        let waves = summary.waves.iter().find(|it| it.road == *road && it.lane.is_none());
        if let Some(waves) = waves {
            let mut speed = said(&waves.speed, |it| {
                format!("{:.1} km/h upstream (correlation {:.2})", it.speed * KMH, it.correlation)
            });
            if waves.speed.is_err() && diagram.is_some_and(|diagram| diagram.congested.is_ok()) {
                "not told apart over the whole section; see the congested branch".clone_into(&mut speed);
            }
            add(&format!("waves{of}"), speed);
        }
    }
    let changes = &summary.lane_changes;
    let rate = changes.per_vehicle_km.map_or_else(String::new, |rate| format!(", {rate:.2} a vehicle-km"));
    let [left, right] = changes.by_direction;
    add("lane changes", format!("{} ({left} left, {right} right){rate}", changes.changes.len()));
    add("contacts", summary.safety.contacts.len().to_string());
    facts
}

fn said<T>(found: &Result<T, Missing>, words: impl Fn(&T) -> String) -> String {
    match found {
        Ok(value) => words(value),
        Err(missing) => format!("not there: {missing}"),
    }
}

fn exposures(summary: &Summary) -> ReportTable {
    let head = ["", "share of vehicle-time", "events", "events in 1000 km"];
    let row = |it: &gnp_measures::Exposure| {
        let per_km = it.events_per_1000_km.map_or_else(String::new, |rate| format!("{rate:.1}"));
        let what = match it.measure {
            Measure::Ttc => format!("time to collision below {} s", it.threshold),
            Measure::Drac => format!("deceleration needed to avoid a collision above {} m/s²", it.threshold),
            Measure::TimeGap => format!("time gap below {} s", it.threshold),
        };
        let cells = [what, format!("{:.3} %", 100. * it.share), it.events.to_string(), per_km];
        cells.map(ReportCell::from).to_vec()
    };
    ReportTable {
        title: String::new(),
        head: head.map(str::to_owned).to_vec(),
        rows: summary.safety.exposures.iter().map(row).collect(),
        notes: Vec::new(),
    }
}

fn distribution_table(summary: &Summary) -> ReportTable {
    let of = &summary.distributions;
    let rows = [
        ("speed, m/s", &of.speed),
        ("acceleration, m/s²", &of.acceleration),
        ("gap, m", &of.gap),
        ("time gap, s", &of.time_gap),
        ("time to collision, s", &of.ttc),
        ("distance from the middle of the lane, m", &of.lateral_offset),
    ];
    let row = |(name, found): (&str, &Option<Distribution>)| {
        let it = found.as_ref()?;
        let numbers = [it.mean, it.deviation, it.quantile(0.05), it.quantile(0.5), it.quantile(0.95)];
        let cells = numbers.map(|value| ReportCell::from(format!("{value:.2}")));
        Some([vec![ReportCell::from(name)], cells.to_vec()].concat())
    };
    ReportTable {
        title: String::new(),
        head: ["", "mean", "deviation", "5 %", "median", "95 %"].map(str::to_owned).to_vec(),
        rows: rows.into_iter().filter_map(row).collect(),
        notes: Vec::new(),
    }
}

/// The busiest minute of the carriageway that is driven most.
fn player(recording: &Recording, summary: &Summary) -> Result<Option<Clip>> {
    let cells = summary.cells.iter().filter(|cell| cell.lane.is_none());
    let Some(busiest) = cells.max_by(|a, b| a.vehicle_s.total_cmp(&b.vehicle_s)) else { return Ok(None) };
    let rate = recording.meta().rate_hz;
    let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
    let start = (busiest.t[0] - PLAYED_S / 2.).min(summary.duration_s - PLAYED_S).max(0.);
    let span = ClipSpan { road: busiest.road, first_frame: first + (start * rate) as u32, seconds: PLAYED_S };
    let nobody = BTreeSet::new();
    let evaluated = Evaluated { subset: "", tracks: &nobody };
    let Ok(shape) = WindowShape::new(2, 1, 1, rate) else { return Ok(None) };
    Clip::cut(recording, shape, span, evaluated, |_| Ok(Vec::new())).map(Some)
}
