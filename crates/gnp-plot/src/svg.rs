//! Writing SVG: elements with numbers of two decimals, text escaped.

use std::fmt::Write as _;

use crate::png::FAMILY;

/// An SVG drawing under construction, in user units; y grows downwards.
#[derive(Debug)]
pub(crate) struct Svg {
    body: String,
    open: usize,
    clips: usize,
}

impl Svg {
    pub(crate) fn new() -> Self {
        Self { body: String::new(), open: 0, clips: 0 }
    }

    /// The whole document.
    pub(crate) fn finish(mut self, width: f64, height: f64, title: &str, description: &str) -> String {
        while self.open > 0 {
            self.end();
        }
        let (w, h) = (number(width), number(height));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
             font-family=\"'{FAMILY}', Verdana, Arial, sans-serif\" font-size=\"10\">\n<title>{}</title>\n\
             <desc>{}</desc>\n<rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>\n{}</svg>\n",
            escape(title),
            escape(description),
            self.body
        )
    }

    /// Opens a group with raw attributes, such as `class="lane"`.
    pub(crate) fn group(&mut self, attributes: &str) {
        let _ = writeln!(self.body, "<g {attributes}>");
        self.open += 1;
    }

    /// Closes the last group.
    pub(crate) fn end(&mut self) {
        self.body.push_str("</g>\n");
        self.open = self.open.saturating_sub(1);
    }

    /// Opens a group that shows only what lies in a rectangle. `name` tells drawings apart that are
    /// put into one page.
    pub(crate) fn clipped(&mut self, name: &str, [x, y, w, h]: [f64; 4]) {
        self.clips += 1;
        let id = format!("{}-{}", name.replace(|c: char| !c.is_ascii_alphanumeric(), "-"), self.clips);
        let _ = write!(self.body, "<clipPath id=\"{id}\">");
        self.rect(x, y, w, h, "");
        let _ = writeln!(self.body, "</clipPath>");
        self.group(&format!("clip-path=\"url(#{id})\""));
    }

    pub(crate) fn rect(&mut self, x: f64, y: f64, w: f64, h: f64, attributes: &str) {
        let [x, y, w, h] = [x, y, w, h].map(number);
        let _ = writeln!(self.body, "<rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" {attributes}/>");
    }

    pub(crate) fn line(&mut self, from: [f64; 2], to: [f64; 2], attributes: &str) {
        let [x1, y1, x2, y2] = [from[0], from[1], to[0], to[1]].map(number);
        let _ = writeln!(self.body, "<line x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\" {attributes}/>");
    }

    pub(crate) fn circle(&mut self, at: [f64; 2], r: f64, attributes: &str) {
        let [x, y, r] = [at[0], at[1], r].map(number);
        let _ = writeln!(self.body, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\" {attributes}/>");
    }

    /// A path through points; nothing with fewer than two.
    pub(crate) fn path(&mut self, points: &[[f64; 2]], attributes: &str) {
        if points.len() >= 2 {
            let _ = writeln!(self.body, "<path d=\"{}\" {attributes}/>", moves(points));
        }
    }

    /// Several paths as one element.
    pub(crate) fn paths(&mut self, paths: &[Vec<[f64; 2]>], attributes: &str) {
        let all: Vec<String> = paths.iter().filter(|path| path.len() >= 2).map(|path| moves(path)).collect();
        if !all.is_empty() {
            let _ = writeln!(self.body, "<path d=\"{}\" {attributes}/>", all.join(""));
        }
    }

    /// A closed area.
    pub(crate) fn area(&mut self, points: &[[f64; 2]], attributes: &str) {
        if points.len() >= 3 {
            let _ = writeln!(self.body, "<path d=\"{}Z\" {attributes}/>", moves(points));
        }
    }

    pub(crate) fn text(&mut self, at: [f64; 2], text: &str, attributes: &str) {
        let [x, y] = at.map(number);
        let _ = writeln!(self.body, "<text x=\"{x}\" y=\"{y}\" {attributes}>{}</text>", escape(text));
    }

    /// Text that reads upwards, centred on `at`.
    pub(crate) fn text_up(&mut self, at: [f64; 2], text: &str, attributes: &str) {
        let [x, y] = at.map(number);
        let text = escape(text);
        let _ = writeln!(
            self.body,
            "<text x=\"{x}\" y=\"{y}\" transform=\"rotate(-90 {x} {y})\" text-anchor=\"middle\" {attributes}>{text}</text>"
        );
    }
}

fn moves(points: &[[f64; 2]]) -> String {
    let mut text = String::new();
    for (i, [x, y]) in points.iter().enumerate() {
        let command = if i == 0 { 'M' } else { 'L' };
        let _ = write!(text, "{command}{} {}", number(*x), number(*y));
    }
    text
}

/// At most two decimals; what is not finite is 0, because a drawing must not break on it.
pub(crate) fn number(value: f64) -> String {
    if !value.is_finite() {
        return "0".to_owned();
    }
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Text as content or attribute of an element. Control characters, which XML does not allow at all, become U+FFFD.
pub(crate) fn escape(text: &str) -> String {
    let allowed = |c: char| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}') || matches!(c, '\t' | '\n' | '\r');
    let text: String = text.chars().map(|c| if allowed(c) { c } else { char::REPLACEMENT_CHARACTER }).collect();
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Figure, Painter};

    #[test]
    fn numbers_are_short_and_finite() {
        let shown = [1., -0.001, 2.5, 1234.567, f64::NAN, f64::INFINITY].map(number);
        assert_eq!(shown, ["1", "0", "2.5", "1234.57", "0", "0"]);
    }

    #[test]
    fn text_cannot_break_out() {
        let mut svg = Svg::new();
        svg.text([1., 2.], "a < b & \"c\"", "");
        let text = svg.finish(10., 20., "<t>", "d");
        assert!(text.contains("a &lt; b &amp; &quot;c&quot;") && text.contains("<title>&lt;t&gt;</title>"), "{text}");
    }

    /// A recording may be called so, and a figure that names it must be painted nevertheless.
    #[test]
    fn control_characters_do_not_spoil_the_picture() {
        let mut svg = Svg::new();
        svg.text([1., 2.], "a\u{1b}[2Jb\0\u{ffff}", "");
        let figure = Figure { name: "f".into(), caption: String::new(), svg: svg.finish(10., 20., "t\u{7}", "d") };
        assert!(Painter::new().png(&figure).is_ok(), "{}", figure.svg);
    }
}
