//! What every figure has: a title, where its data comes from, a name.

use crate::palette::INK;
use crate::svg::Svg;

/// Width of every figure, user units: in a column of 85 mm letters of 9 units have 6.4 points.
pub(crate) const WIDTH: f64 = 340.;
const FOOT: f64 = 20.;
/// Letters of a line at most: of small text, of bold small text, of a title.
const LETTERS: usize = 68;
const BOLD_LETTERS: usize = 60;
const TITLE_LETTERS: usize = 42;
/// Width of a small letter, user units, rather too large than too small.
pub(crate) const LETTER: f64 = 5.1;

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
        let mut y = 8.;
        for line in broken(title, TITLE_LETTERS) {
            svg.text([8., y + 8.], &line, &format!("font-size=\"12\" font-weight=\"bold\" fill=\"{INK}\""));
            y += 14.;
        }
        Self { svg, name: name.to_owned(), title: title.to_owned(), y: y + 2. }
    }

    /// A line of small text; long ones are broken between words.
    pub(crate) fn note(&mut self, text: &str) {
        for line in broken(text, LETTERS) {
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
        let (weight, letters) = if source.simulated { ("font-weight=\"bold\"", BOLD_LETTERS) } else { ("", LETTERS) };
        self.svg.group("class=\"source\"");
        let mut height = self.y + FOOT;
        for (i, line) in broken(&foot, letters).iter().enumerate() {
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

/// Entries of a legend, one behind the other, in as many lines as they need.
pub(crate) struct Legend {
    x: f64,
    y: f64,
}

impl Legend {
    pub(crate) fn under(y: f64) -> Self {
        Self { x: 10., y: y + 10. }
    }

    /// Left end of the base line of an entry: a sample of some width, then words.
    pub(crate) fn place(&mut self, sample: f64, words: &str) -> [f64; 2] {
        let wide = sample + LETTER * words.chars().count() as f64;
        if self.x + wide > WIDTH - 4. && self.x > 10. {
            (self.x, self.y) = (10., self.y + 14.);
        }
        let at = [self.x, self.y];
        self.x += wide + 10.;
        at
    }

    /// Where the next thing may be drawn.
    pub(crate) fn bottom(&self) -> f64 {
        self.y + 3.
    }
}

fn broken(text: &str, letters: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let Some(line) = lines.last_mut() else { break };
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= letters {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}
