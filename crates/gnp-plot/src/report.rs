//! The report: one HTML file about a run, with a player of scenes. No network needed.
//!
//! It opens with what a person wants to know: a sentence, a short table, a figure, the player. Sections
//! follow, some of them folded away.

mod player;

use std::fmt::Write as _;

use crate::clip::Clip;
use crate::figure::Figure;
use crate::svg::escape;

/// How scenes are drawn, as a classic script that defines `gnpScene`: the report's player and the live page use it.
pub const SCENE_SCRIPT: &str = include_str!("report/scene.js");
/// The colours of light and dark that go with [`SCENE_SCRIPT`].
pub const SCENE_STYLE: &str = include_str!("report/theme.css");
const STYLE: &str = include_str!("report/style.css");
const PLAYER: &str = include_str!("report/player.js");

/// What a report says, in the order of the page.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Report {
    /// Heading.
    pub title: String,
    /// Whether any data was made by a simulator; then it is said at the top.
    pub simulated: bool,
    /// What the run found, in a sentence.
    pub headline: String,
    /// The short table.
    pub summary: Option<ReportTable>,
    /// Figures that stand below the short table.
    pub figures: Vec<Figure>,
    /// A clip to be played.
    pub player: Option<Clip>,
    /// Everything else.
    pub sections: Vec<ReportSection>,
}

/// A section of a report: facts, then tables, then figures.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ReportSection {
    /// Heading.
    pub title: String,
    /// Whether it is folded away until it is asked for.
    pub folded: bool,
    /// Names and values.
    pub facts: Vec<(String, String)>,
    /// Tables with their headings.
    pub tables: Vec<ReportTable>,
    /// Figures, shown inline.
    pub figures: Vec<Figure>,
}

/// A table of a report.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReportTable {
    /// Above it.
    pub title: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// Cells by row, the first one naming the row.
    pub rows: Vec<Vec<ReportCell>>,
    /// Remarks below it.
    pub notes: Vec<String>,
}

/// A cell of a table.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReportCell {
    /// A name or a number.
    pub text: String,
    /// The intervals of a number in their brackets, as `(5.2 to 5.8) [4.9 to 6.1]`.
    pub interval: Option<String>,
}

impl<T: Into<String>> From<T> for ReportCell {
    fn from(text: T) -> Self {
        Self { text: text.into(), interval: None }
    }
}

impl Report {
    /// A report with nothing but its heading.
    #[must_use]
    pub fn new(title: impl Into<String>, simulated: bool) -> Self {
        Self { title: title.into(), simulated, ..Self::default() }
    }

    /// The HTML document.
    ///
    /// # Errors
    /// When a number of the clip cannot be written as JSON.
    pub fn html(&self) -> Result<String, serde_json::Error> {
        let mut page = String::new();
        let title = escape(&self.title);
        let _ = write!(
            page,
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n\
             <style>\n{SCENE_STYLE}{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n"
        );
        if self.simulated {
            page.push_str("<p class=\"simulated\">Made from <em>simulated</em> data.</p>\n");
        }
        if !self.headline.is_empty() {
            let _ = writeln!(page, "<p class=\"headline\">{}</p>", escape(&self.headline));
        }
        // Beside each other where there is room.
        page.push_str("<div class=\"opening\">\n");
        if let Some(summary) = &self.summary {
            let _ = write!(page, "<div class=\"summary\">\n{}</div>\n", summary.html());
        }
        page.push_str(&figures_html(&self.figures));
        page.push_str("</div>\n");
        if let Some(clip) = &self.player {
            page.push_str(CONTROLS);
            // Inside a script, `<` could end it.
            let json = serde_json::to_string(&player::json(clip))?.replace('<', "\\u003c");
            let _ = writeln!(page, "<script type=\"application/json\" id=\"recording\">{json}</script>");
        }
        for section in &self.sections {
            page.push_str(&section.html());
        }
        let _ = write!(
            page,
            "<p class=\"keys\" id=\"ready\"></p>\n</main>\n<script>\n{SCENE_SCRIPT}{PLAYER}</script>\n</body>\n</html>\n"
        );
        Ok(page)
    }
}

impl ReportSection {
    /// A section with nothing but its heading.
    #[must_use]
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// The same, folded away until it is asked for.
    #[must_use]
    pub fn folded(self) -> Self {
        Self { folded: true, ..self }
    }

    fn html(&self) -> String {
        let title = escape(&self.title);
        let mut page = if self.folded {
            format!("<details>\n<summary><h2>{title}</h2></summary>\n")
        } else {
            format!("<section>\n<h2>{title}</h2>\n")
        };
        if !self.facts.is_empty() {
            page.push_str("<dl>\n");
            for (name, value) in &self.facts {
                let _ = writeln!(page, "<dt>{}</dt><dd>{}</dd>", escape(name), escape(value));
            }
            page.push_str("</dl>\n");
        }
        self.tables.iter().for_each(|table| page.push_str(&table.html()));
        page.push_str(&figures_html(&self.figures));
        page.push_str(if self.folded { "</details>\n" } else { "</section>\n" });
        page
    }
}

fn figures_html(figures: &[Figure]) -> String {
    if figures.is_empty() {
        return String::new();
    }
    let mut page = String::from("<div class=\"figures\">\n");
    for figure in figures {
        let (name, caption) = (escape(&figure.name), escape(&figure.caption));
        let svg = &figure.svg;
        let _ = writeln!(page, "<figure id=\"figure-{name}\">\n{svg}<figcaption>{caption}</figcaption>\n</figure>");
    }
    page.push_str("</div>\n");
    page
}

impl ReportTable {
    fn html(&self) -> String {
        let cell = |cell: &ReportCell| {
            let interval = cell.interval.as_ref().map(|text| format!(" <small>{}</small>", escape(text)));
            format!("{}{}", escape(&cell.text), interval.unwrap_or_default())
        };
        let row = |cells: &Vec<ReportCell>| {
            let mut text = String::from("<tr>");
            for (i, content) in cells.iter().map(cell).enumerate() {
                text +=
                    &if i == 0 { format!("<th scope=\"row\">{content}</th>") } else { format!("<td>{content}</td>") };
            }
            text + "</tr>\n"
        };
        let head: String = self.head.iter().map(|name| format!("<th scope=\"col\">{}</th>", escape(name))).collect();
        let rows: String = self.rows.iter().map(row).collect();
        let notes: String = self.notes.iter().map(|note| format!("<p class=\"keys\">{}</p>\n", escape(note))).collect();
        let title = escape(&self.title);
        let heading = if title.is_empty() { String::new() } else { format!("<h3>{title}</h3>\n") };
        if self.rows.is_empty() {
            return heading + &notes;
        }
        // What is wider than the page scrolls by itself, by keyboard too.
        format!(
            "{heading}<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"{}\"><table>\n\
             <thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n{notes}",
            if title.is_empty() { "Table" } else { &title }
        )
    }
}

const CONTROLS: &str = r#"<section>
<h2>Scene player</h2>
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
<canvas id="chart" role="img" aria-label="Parameters of the forces over the forecast"></canvas>
<div id="tip" hidden></div>
<p class="keys">Keys: space plays; arrows step, with shift by a second; N and P pick the next and the previous
vehicle; <span class="forecast">F forces<span id="terms"></span>, M futures (the prediction dark red, others green), B
neighbours; </span>+ and − zoom; Home and End.
A vehicle under the pointer shows its numbers. <span class="forecast">The dashed box is where the forecast has the
vehicle now. </span>An address that ends in <code>#t=12.5&amp;vehicle=7</code> opens that moment.</p>
</div>
</section>
"#;
