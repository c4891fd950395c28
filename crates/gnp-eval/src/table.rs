//! Tables for people and spreadsheets: the terminal, Markdown, CSV.

mod content;

use std::ops::Range;

use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, presets};

pub use crate::table::content::{comparison_tables, tables};
pub(crate) use crate::table::content::{site_name, sites};

use crate::bootstrap::Interval;

/// Widest a terminal table gets, in columns.
pub(crate) const TERMINAL_WIDTH: usize = 80;
/// Room that the models' names keep in it, if they are as long; longer ones wrap.
const NAME_WIDTH: usize = 24;

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
    /// Names it among others, as `clean us-101`.
    pub name: String,
    /// Whether it adds to a table that comes before: a terminal may leave it out.
    pub detail: bool,
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
    /// Interval of the value by driver.
    pub interval: Option<Interval>,
    /// Interval of the value by event, set in square brackets.
    pub by_event: Option<Interval>,
}

impl TableCell {
    /// A name, or a number without interval.
    pub(crate) fn plain(text: impl Into<String>) -> Self {
        Self { text: text.into(), interval: None, by_event: None }
    }

    /// On one line: the value, and its intervals in brackets.
    pub(crate) fn with_interval(&self) -> String {
        let intervals = self.interval_text().map(|text| format!(" {text}"));
        format!("{}{}", self.text, intervals.unwrap_or_default())
    }

    /// The intervals in their brackets, as `(5.20 to 5.80) [4.90 to 6.10]`: the second by event. `None` without any.
    #[must_use]
    pub fn interval_text(&self) -> Option<String> {
        let inner = self.interval.map(|interval| format!("({})", ends(interval)));
        let outer = self.by_event.map(|interval| format!("[{}]", ends(interval)));
        let both: Vec<String> = inner.into_iter().chain(outer).collect();
        (!both.is_empty()).then(|| both.join(" "))
    }
}

fn ends(interval: Interval) -> String {
    format!("{:.2} to {:.2}", interval.low, interval.high)
}

impl Table {
    /// For a terminal: at most 80 columns wide, no colour, intervals below their values. Columns that do not fit beside
    /// each other follow below, under the names again.
    #[must_use]
    pub fn terminal(&self) -> String {
        // Titles break after the quantity: `RMSE` above `5 s`.
        let head: Vec<String> = self.header.iter().map(|title| title.replacen(' ', "\n", 1)).collect();
        let cell = |cell: &TableCell| {
            let inner = cell.interval.map(|interval| format!("\n{}", ends(interval)));
            let outer = cell.by_event.map(|interval| format!("\n[{}]", ends(interval)));
            format!("{}{}{}", cell.text, inner.unwrap_or_default(), outer.unwrap_or_default())
        };
        let rows: Vec<Vec<String>> = self.rows.iter().map(|row| row.iter().map(cell).collect()).collect();
        let mut lines = wrapped(&self.caption, TERMINAL_WIDTH);
        for band in bands(&head, &rows) {
            lines.extend(beside(&head, &rows, &band).to_string().lines().map(|line| line.trim_end().to_owned()));
        }
        lines.join("\n") + "\n"
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
            text += &line(row.iter().map(|cell| escaped(&cell.with_interval())).collect());
        }
        text
    }
}

/// Columns after the first in runs that fit beside it.
fn bands(head: &[String], rows: &[Vec<String>]) -> Vec<Range<usize>> {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column)).chain(head.get(column));
        cells.flat_map(|text| text.lines()).map(|line| line.chars().count()).max().unwrap_or(0)
    };
    let room = TERMINAL_WIDTH - width(0).min(NAME_WIDTH);
    let (mut bands, mut used) = (Vec::new(), 0);
    for column in 1..head.len() {
        used += width(column) + 1;
        match bands.last_mut() {
            Some(Range { end, .. }) if used <= room => *end = column + 1,
            _ => {
                bands.push(column..column + 1);
                used = width(column) + 1;
            }
        }
    }
    bands
}

/// The first column and those of a band.
fn beside(head: &[String], rows: &[Vec<String>], band: &Range<usize>) -> comfy_table::Table {
    let of = |row: &[String]| row.iter().take(1).chain(row.get(band.clone()).unwrap_or_default()).cloned().collect();
    let mut table = comfy_table::Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY);
    table.set_content_arrangement(ContentArrangement::Dynamic).set_width(TERMINAL_WIDTH as u16);
    let (head, rows): (Vec<String>, Vec<Vec<String>>) = (of(head), rows.iter().map(|row| of(row)).collect());
    table.set_header(head);
    table.add_rows(rows);
    for column in table.column_iter_mut() {
        column.set_padding((0, 0)); // the empty rule between columns parts them
        if column.index > 0 {
            // Only names wrap.
            column.set_cell_alignment(CellAlignment::Right);
            column.set_constraint(ColumnConstraint::ContentWidth);
        }
    }
    table
}

/// All tables as one CSV text (RFC 4180): one line a cell, with the columns `table`, `row`, `column`,
/// `value`, `low`, `high`, `event_low` and `event_high`: the ends of the intervals by driver and by event, empty where
/// a value has none.
#[must_use]
pub fn csv(tables: &[Table]) -> String {
    let mut text = String::from("table,row,column,value,low,high,event_low,event_high\n");
    for table in tables {
        for row in &table.rows {
            let Some((name, cells)) = row.split_first() else { continue };
            for (title, cell) in table.header.iter().skip(1).zip(cells) {
                let [[low, high], [event_low, event_high]] = [cell.interval, cell.by_event].map(|interval| {
                    let ends = interval.map(|it| [it.low, it.high].map(|end| format!("{end:.4}")));
                    ends.unwrap_or_default()
                });
                let fields = [&table.name, &name.text, title, &cell.text, &low, &high, &event_low, &event_high];
                text += &fields.map(|field| quoted(field)).join(",");
                text += "\n";
            }
        }
    }
    text
}

/// A CSV field, in quotes where it needs them.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

/// Lines of at most `width` characters, broken at spaces.
pub(crate) fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last().map_or(0, |line| line.chars().count());
        if line > 0 && line + 1 + word.chars().count() > width {
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
mod tests;
