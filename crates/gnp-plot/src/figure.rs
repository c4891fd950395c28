//! What every figure has: a title, where its data comes from, a name.

use crate::palette::INK;
use crate::svg::Svg;

/// Width of every figure, user units.
pub(crate) const WIDTH: f64 = 420.;
const HEAD: f64 = 24.;
const FOOT: f64 = 20.;
/// Letters of a line of small text, at most.
const LETTERS: usize = 78;

/// A finished figure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Figure {
    /// File name without ending, such as `error-by-horizon`.
    pub name: String,
    /// What is seen, in words.
    pub caption: String,
    /// The SVG document.
    pub svg: String,
}

/// Where the data of a figure comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// The data in a few words, such as `NGSIM, test part`.
    pub words: String,
    /// Whether any of it was made by a simulator; then every figure says so.
    pub simulated: bool,
}

/// A figure being drawn: head and foot are its own, what is between belongs to the drawing.
pub(crate) struct Sheet {
    pub(crate) svg: Svg,
    pub(crate) name: String,
    title: String,
    /// Where the next thing may be drawn.
    pub(crate) y: f64,
}

impl Sheet {
    pub(crate) fn new(name: &str, title: &str) -> Self {
        let mut svg = Svg::new();
        svg.text([8., 16.], title, &format!("font-size=\"12\" font-weight=\"bold\" fill=\"{INK}\""));
        Self { svg, name: name.to_owned(), title: title.to_owned(), y: HEAD }
    }

    /// A line of small text; long ones are broken between words.
    pub(crate) fn note(&mut self, text: &str) {
        for line in broken(text) {
            self.y += 12.;
            self.svg.text([8., self.y], &line, &format!("font-size=\"9\" fill=\"{INK}\""));
        }
        self.y += 3.;
    }

    /// Closes the figure under its source.
    pub(crate) fn finish(mut self, caption: &str, source: &Source) -> Figure {
        let simulated = if source.simulated { "simulated data: " } else { "" };
        let words = source.words.replace("*simulated*", "simulated");
        let foot = format!("{simulated}{words}");
        let weight = if source.simulated { "font-weight=\"bold\"" } else { "" };
        self.svg.group("class=\"source\"");
        let mut height = self.y + FOOT;
        for (i, line) in broken(&foot).iter().enumerate() {
            let y = self.y + 13. + 11. * i as f64;
            self.svg.text([8., y], line, &format!("font-size=\"9\" fill=\"{INK}\" {weight}"));
            height = y + 7.;
        }
        self.svg.end();
        let caption = if source.simulated { format!("{caption} Simulated data.") } else { caption.to_owned() };
        let svg = self.svg.finish(WIDTH, height, &self.title, &caption);
        Figure { name: self.name, caption, svg }
    }
}

fn broken(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let Some(line) = lines.last_mut() else { break };
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= LETTERS {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}
