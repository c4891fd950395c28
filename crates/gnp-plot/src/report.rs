//! The report: one HTML file with everything about a run, and a player of scenes. No network needed.

use std::fmt::Write as _;

use gnp_data::{Explanation, TermForces};
use gnp_force::{Arity, TermDescriptor, TermParameter};
use serde::Serialize;

use crate::figure::Figure;
use crate::svg::escape;

const STYLE: &str = include_str!("report/style.css");
const PLAYER: &str = include_str!("report/player.js");

/// What a report says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Heading.
    pub title: String,
    /// Whether any data was made by a simulator; then it is said at the top.
    pub simulated: bool,
    /// What was run: names and values.
    pub facts: Vec<(String, String)>,
    /// Tables with their headings.
    pub tables: Vec<ReportTable>,
    /// Figures, shown inline.
    pub figures: Vec<Figure>,
    /// A stretch of a recording to be played.
    pub player: Option<PlayedRecording>,
}

/// A table of a report.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReportTable {
    /// Above it.
    pub title: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// Cells by row.
    pub rows: Vec<Vec<String>>,
    /// Remarks below it.
    pub notes: Vec<String>,
}

/// One carriageway of a recording over some time. Lengths are in cm, so that they are short as text.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlayedRecording {
    /// Made by a simulator.
    pub simulated: bool,
    /// Frames of the player a second.
    pub rate: f64,
    /// Number of frames.
    pub frames: usize,
    /// Observed time before a forecast, s.
    pub observed: f64,
    /// Time that a forecast spans, s.
    pub horizon: f64,
    /// Time between points and steps of a forecast, s.
    pub every: f64,
    /// The terms of the force, in the order of every step's.
    pub terms: Vec<PlayedTerm>,
    /// Lane lines.
    pub lines: Vec<PlayedLine>,
    /// Vehicles.
    pub vehicles: Vec<PlayedVehicle>,
    /// Forecasts, of any vehicle.
    pub forecasts: Vec<PlayedForecast>,
}

/// A lane line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlayedLine {
    /// Lateral position, cm, to the left.
    pub y: i32,
    /// Edge of the carriageway.
    pub boundary: bool,
}

/// A vehicle over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlayedVehicle {
    /// Vehicle of the file.
    pub id: u32,
    /// Kind of vehicle.
    pub class: String,
    /// Whether it is in the test part.
    pub test: bool,
    /// Length and width, cm.
    pub size: [i32; 2],
    /// First frame of the player in which it is there.
    pub first: usize,
    /// Forward position, cm: the first one, then differences.
    pub x: Vec<i32>,
    /// Position to the left, in the same way.
    pub y: Vec<i32>,
}

/// A forecast made at a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlayedForecast {
    /// Index of the vehicle.
    pub vehicle: usize,
    /// Frame of the player.
    pub frame: usize,
    /// Where the vehicle was then, cm, road frame.
    pub at: [i32; 2],
    /// Index of the vehicle in each neighbour slot; -1 where it is not among the vehicles, -2 where
    /// nobody is.
    pub neighbours: Vec<i32>,
    /// Futures, likeliest first.
    pub modes: Vec<PlayedMode>,
    /// What drives the likeliest future.
    pub steps: Vec<PlayedStep>,
}

/// A possible future.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlayedMode {
    /// Probability.
    pub p: f32,
    /// Forward and left of `at` by turns, cm.
    pub path: Vec<i32>,
}

/// A term of the force, as it is drawn.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlayedTerm {
    /// What it is called.
    pub label: String,
    /// Unit of the force.
    pub unit: String,
    /// Colour, `#rrggbb`.
    pub colour: String,
    /// Its parameters that are plotted over time, in the order of every step's.
    pub parameters: Vec<PlayedParameter>,
}

/// A parameter of a term: one number a step, or one for each neighbour slot.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlayedParameter {
    /// Its symbol.
    pub name: String,
    /// What it is and its unit.
    pub title: String,
    /// Its unit.
    pub unit: String,
    /// Whether each neighbour slot has its own.
    pub slots: bool,
}

/// What a step's forces are, by term.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlayedStep {
    /// Sum of each term, m/s².
    pub forces: Vec<[f32; 2]>,
    /// Values of each parameter of all terms in their order: one, or one a neighbour slot.
    pub parameters: Vec<Vec<f32>>,
}

impl PlayedTerm {
    /// The terms of an explanation; the parameters of lane lines differ in number from road to road and are not plotted.
    #[must_use]
    pub fn of(explanation: &Explanation) -> Vec<Self> {
        let parameter = |slots: bool, parameter: &TermParameter| PlayedParameter {
            name: parameter.name.to_string(),
            title: parameter.meaning.to_string(),
            unit: parameter.unit.to_string(),
            slots,
        };
        let term = |term: &TermDescriptor| Self {
            label: term.label.to_string(),
            unit: term.unit.to_string(),
            colour: term.colour.to_string(),
            parameters: match term.arity {
                Arity::PerLine => Vec::new(),
                arity => term.varying().map(|p| parameter(arity == Arity::PerNeighbour, p)).collect(),
            },
        };
        explanation.terms.iter().map(|forces| term(forces.term())).collect()
    }
}

impl PlayedStep {
    /// A step of an explanation, in the order of [`PlayedTerm::of`], its numbers as `short` makes them.
    #[must_use]
    pub fn of(explanation: &Explanation, step: usize, short: impl Fn(f32) -> f32) -> Self {
        let plotted = explanation.terms.iter().filter(|forces| forces.term().arity != Arity::PerLine);
        let values = |forces: &TermForces, i: usize| forces.parameter(i, step).iter().map(|v| short(*v)).collect();
        Self {
            forces: explanation.terms.iter().map(|forces| forces.total(step).map(&short)).collect(),
            parameters: plotted
                .flat_map(|forces| (0..forces.term().varying().count()).map(|i| values(forces, i)).collect::<Vec<_>>())
                .collect(),
        }
    }
}

impl Report {
    /// The HTML document.
    ///
    /// # Errors
    /// When a number of the played recording cannot be written as JSON.
    pub fn html(&self) -> Result<String, serde_json::Error> {
        let mut page = String::new();
        let title = escape(&self.title);
        let _ = write!(
            page,
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<link rel=\"icon\" href=\"data:,\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
        );
        if self.simulated {
            page.push_str("<p class=\"simulated\">Made from <em>simulated</em> data.</p>\n");
        }
        page.push_str("<h2>What was run</h2>\n<dl>\n");
        for (name, value) in &self.facts {
            let _ = writeln!(page, "<dt>{}</dt><dd>{}</dd>", escape(name), escape(value));
        }
        page.push_str("</dl>\n");
        if let Some(recording) = &self.player {
            page.push_str(CONTROLS);
            // Inside a script, `<` could end it.
            let json = serde_json::to_string(recording)?.replace('<', "\\u003c");
            let _ = writeln!(page, "<script type=\"application/json\" id=\"recording\">{json}</script>");
        }
        page.push_str("<h2>Tables</h2>\n");
        for table in &self.tables {
            page.push_str(&table.html());
        }
        page.push_str("<h2>Figures</h2>\n<div class=\"figures\">\n");
        for figure in &self.figures {
            let caption = escape(&figure.caption);
            let _ = writeln!(
                page,
                "<figure id=\"{}\">\n{}<figcaption>{caption}</figcaption>\n</figure>",
                escape(&figure.name),
                figure.svg
            );
        }
        let _ = write!(
            page,
            "</div>\n<p class=\"keys\" id=\"ready\"></p>\n<script>\n{PLAYER}</script>\n</body>\n</html>\n"
        );
        Ok(page)
    }
}

impl ReportTable {
    fn html(&self) -> String {
        let row = |cells: &[String], tag: &str| {
            let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
            format!("<tr>{cells}</tr>\n")
        };
        let rows: String = self.rows.iter().map(|cells| row(cells, "td")).collect();
        let notes: String = self.notes.iter().map(|note| format!("<p class=\"keys\">{}</p>\n", escape(note))).collect();
        let table = if self.rows.is_empty() {
            String::new()
        } else {
            format!(
                "<div class=\"wide\"><table>\n<thead>{}</thead>\n<tbody>\n{rows}</tbody></table></div>\n",
                row(&self.head, "th")
            )
        };
        format!("<h3>{}</h3>\n{table}{notes}", escape(&self.title))
    }
}

const CONTROLS: &str = r#"<h2>Scene player</h2>
<div id="player">
<canvas id="road" tabindex="0" role="img" aria-label="The road from above; forward is right, left is up"></canvas>
<div id="controls">
<button id="play">Play</button>
<input id="time" type="range" min="0" max="1" step="1" value="0" aria-label="Time">
<button id="next">Next vehicle</button>
<button id="forces" aria-pressed="true">Forces</button>
<button id="modes" aria-pressed="true">Futures</button>
<button id="neighbours" aria-pressed="true">Neighbours</button>
<button id="closer" aria-label="Zoom in">+</button>
<button id="farther" aria-label="Zoom out">−</button>
<button id="theme">Light or dark</button>
</div>
<div id="status" role="status"></div>
<canvas id="chart" role="img" aria-label="Relaxation time and strengths over the forecast"></canvas>
<div id="tip" hidden></div>
<p class="keys">Keys: space plays; arrows step, with shift by a second; N and P pick the next and the previous vehicle; F forces<span id="terms"></span>, M futures (likeliest dark red, others green), B neighbours; + and − zoom; Home and End.
A vehicle under the pointer shows its numbers. The dashed box is where the forecast has the vehicle now. An address that ends in <code>#t=12.5&amp;vehicle=7</code> opens that moment.</p>
</div>
"#;
