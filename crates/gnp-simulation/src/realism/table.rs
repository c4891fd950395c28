//! Scores as a table: for people and for programs.
use super::{Estimate, Feature, Row};
use serde::Serialize;
use std::fmt::Write as _;

/// What systems make of replays, a row a site and system; what happened first.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Table {
    /// The rows.
    pub rows: Vec<Row>,
}

impl Table {
    /// As Markdown: by site one table of displacements and one of realism and distributions. *simulated* is said.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        for rows in self.rows.chunk_by(|a, b| (&a.site, a.simulated) == (&b.site, b.simulated)) {
            let Some(first) = rows.first() else { continue };
            let simulated = if first.simulated { " (*simulated*)" } else { "" };
            let (site, scenes, vehicles) = (&first.site, first.scenes, first.vehicles);
            let _ = writeln!(text, "## {site}{simulated}\n\n{scenes} scenes, {vehicles} scored vehicles\n");
            displacements(&mut text, rows);
            realism(&mut text, rows);
        }
        if self.rows.iter().any(|row| row.uses_future) {
            text.push_str("\\* made from what the scored vehicles did after the start: no forecast\n");
        }
        text
    }

    /// As CSV: a row a site and system, empty where nothing is known.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut horizons: Vec<f64> = self.rows.iter().flat_map(|row| &row.horizons).map(|it| it.horizon_s).collect();
        horizons.sort_by(f64::total_cmp);
        horizons.dedup();
        let mut text = String::from("site,simulated,system,uses_future,scenes,roll_outs,vehicles");
        for horizon in &horizons {
            for column in ["vehicles", "ade_m", "ade_low_m", "ade_high_m", "min_ade_m", "along_m", "bias_m", "across_m"]
            {
                let _ = write!(text, ",{column}_{horizon}s");
            }
        }
        text.push_str(",realism,realism_low,realism_high");
        for feature in Feature::ALL {
            let _ = write!(text, ",realism_{}", feature.name().to_lowercase().replace(' ', "_"));
        }
        text.push_str(
            ",w1_speed_mps,w1_acceleration_mps2,w1_gap_m,w1_ttc_s,lane_changes_per_vehicle_km,contacts_per_vehicle_h,\
             late,never,stood_in\n",
        );
        for row in &self.rows {
            let _ = write!(text, "{},{},", quoted(&row.site), row.simulated);
            let _ = write!(
                text,
                "{},{},{},{},{}",
                quoted(&row.system),
                row.uses_future,
                row.scenes,
                row.roll_outs,
                row.vehicles
            );
            for horizon in &horizons {
                match row.horizons.iter().find(|found| found.horizon_s == *horizon) {
                    Some(it) => {
                        let _ = write!(text, ",{}", it.vehicles);
                        for value in
                            [it.ade.mean, it.ade.low, it.ade.high, it.min_ade.mean, it.along, it.bias, it.across]
                        {
                            let _ = write!(text, ",{value:.4}");
                        }
                    }
                    None => text.push_str(&",".repeat(8)),
                }
            }
            let realism = row.realism.map_or([None; 3], |it| [it.mean, it.low, it.high].map(Some));
            let features = Feature::ALL.map(|feature| row.features.get(&feature).copied());
            let distances = [row.speed_distance, row.acceleration_distance, row.gap_distance, row.ttc_distance];
            let events = [row.lane_changes_per_vehicle_km, row.contacts_per_vehicle_h];
            let counts = [row.late_and_never[0], row.late_and_never[1], row.stood_in].map(Some);
            for value in realism.into_iter().chain(features).chain(distances).chain(events).chain(counts) {
                match value {
                    Some(value) => {
                        let _ = write!(text, ",{value:.4}");
                    }
                    None => text.push(','),
                }
            }
            text.push('\n');
        }
        text
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

fn name(row: &Row) -> String {
    format!("{}{}", row.system, if row.uses_future { " \\*" } else { "" })
}

/// One scene has no interval.
fn with_interval(estimate: &Estimate) -> String {
    if (estimate.high - estimate.low).abs() < 1e-9 * estimate.mean.abs() {
        return format!("{:.2}", estimate.mean);
    }
    format!("{:.2} ({:.2} to {:.2})", estimate.mean, estimate.low, estimate.high)
}

/// Only horizons for which somebody is recorded.
fn displacements(text: &mut String, rows: &[Row]) {
    let Some(first) = rows.first().filter(|row| !row.horizons.is_empty()) else { return };
    text.push_str("| m | roll-outs |");
    for it in &first.horizons {
        let _ = write!(text, " ADE {} s, n = {} | min ADE | along | bias | across |", it.horizon_s, it.vehicles);
    }
    let _ = writeln!(text, "\n|---|--:|{}", "--:|".repeat(5 * first.horizons.len()));
    for row in &rows[1..] {
        let _ = write!(text, "| {} | {} |", name(row), row.roll_outs);
        for it in &row.horizons {
            let _ = write!(
                text,
                " {} | {:.2} | {:.2} | {:+.2} | {:.2} |",
                with_interval(&it.ade),
                it.min_ade.mean,
                it.along,
                it.bias,
                it.across
            );
        }
        text.push('\n');
    }
    text.push('\n');
}

fn realism(text: &mut String, rows: &[Row]) {
    text.push_str("| | realism |");
    for feature in Feature::ALL {
        let _ = write!(text, " {} |", feature.name());
    }
    text.push_str(
        " W1 speed, m/s | W1 acceleration, m/s² | W1 gap, m | W1 TTC, s | lane changes/veh-km | contacts/veh-h | late | never \
         | stood in |\n",
    );
    let _ = writeln!(text, "|---|{}", "--:|".repeat(Feature::ALL.len() + 10));
    let cell = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2}"));
    for row in rows {
        let whole = row.realism.as_ref().map_or_else(|| "–".to_owned(), with_interval);
        let _ = write!(text, "| {} | {whole} |", name(row));
        let features = Feature::ALL.map(|feature| row.features.get(&feature).copied());
        let distances = [row.speed_distance, row.acceleration_distance, row.gap_distance, row.ttc_distance];
        let events = [row.lane_changes_per_vehicle_km, row.contacts_per_vehicle_h];
        for value in features.into_iter().chain(distances).chain(events) {
            let _ = write!(text, " {} |", cell(value));
        }
        let [late, never] = row.late_and_never;
        let _ = writeln!(text, " {late:.1} | {never:.1} | {:.0} % |", row.stood_in * 100.0);
    }
    text.push('\n');
}
