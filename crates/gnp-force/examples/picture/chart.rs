//! Line charts as SVG text, for the pictures that the examples draw of their own output.
use std::{error::Error, fmt::Write as _, path::PathBuf};

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 200.0;
/// Room left of the plot for the numbers and the axis name, and right of it for the legend.
const LEFT: f64 = 70.0;
const RIGHT: f64 = 150.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 46.0;
const COLOURS: [&str; 5] = ["#0b6e99", "#d1495b", "#4d8b31", "#8a5a9e", "#d58a00"];

/// One set of axes.
pub(crate) struct Panel {
    pub(crate) title: &'static str,
    pub(crate) x: &'static str,
    pub(crate) y: &'static str,
    pub(crate) curves: Vec<Curve>,
}

/// One line with its name in the legend; a curve without a name is not in the legend.
pub(crate) struct Curve {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
    /// Colour by number; `None` takes the next one.
    pub(crate) colour: Option<String>,
}

impl Curve {
    #[allow(dead_code, reason = "one example draws nameless curves only")]
    pub(crate) fn new(name: &str, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), points, colour: None }
    }
}

/// The file after `--svg` on the command line, and the other arguments.
pub(crate) fn arguments() -> Result<(Option<PathBuf>, Vec<String>), Box<dyn Error>> {
    let (mut svg, mut others) = (None, Vec::new());
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--svg" {
            svg = Some(arguments.next().ok_or("--svg needs the name of a file to write")?.into());
        } else {
            others.push(argument);
        }
    }
    Ok((svg, others))
}

/// The panels below each other.
pub(crate) fn draw(panels: &[Panel]) -> String {
    let step = TOP + HEIGHT + BOTTOM;
    let (width, height) = (LEFT + WIDTH + RIGHT, step * panels.len() as f64);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    for (i, panel) in panels.iter().enumerate() {
        let _ = writeln!(svg, "<g transform=\"translate({LEFT} {})\">", step * i as f64 + TOP);
        axes(&mut svg, panel);
        svg.push_str("</g>\n");
    }
    svg.push_str("</svg>\n");
    svg
}

fn axes(svg: &mut String, panel: &Panel) {
    let points = || panel.curves.iter().flat_map(|curve| &curve.points);
    let (x0, x1, x_step) = span(points().map(|point| point.0));
    let (y0, y1, y_step) = span(points().map(|point| point.1));
    let px = |x: f64| (x - x0) / (x1 - x0) * WIDTH;
    let py = |y: f64| HEIGHT - (y - y0) / (y1 - y0) * HEIGHT;
    let _ = writeln!(svg, "<text x=\"0\" y=\"-10\" font-weight=\"bold\">{}</text>", panel.title);
    for x in ticks(x0, x1, x_step) {
        let at = px(x);
        let _ = writeln!(svg, "<path d=\"M{at:.1} 0V{HEIGHT}\" stroke=\"#e4e4e4\"/>");
        let _ = writeln!(svg, "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>", HEIGHT + 16.0, round(x));
    }
    for y in ticks(y0, y1, y_step) {
        let at = py(y);
        let _ = writeln!(svg, "<path d=\"M0 {at:.1}H{WIDTH}\" stroke=\"#e4e4e4\"/>");
        let _ = writeln!(svg, "<text x=\"-6\" y=\"{:.1}\" text-anchor=\"end\">{}</text>", at + 4.0, round(y));
    }
    let _ = writeln!(svg, "<path d=\"M0 0V{HEIGHT}H{WIDTH}\" fill=\"none\" stroke=\"#444\"/>");
    let (middle, below) = (WIDTH / 2.0, HEIGHT + 34.0);
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{below}\" text-anchor=\"middle\">{}</text>", panel.x);
    let _ = writeln!(
        svg,
        "<text transform=\"translate(-50 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        HEIGHT / 2.0,
        panel.y
    );
    let mut named = 0;
    for curve in &panel.curves {
        let colour = curve.colour.as_deref().unwrap_or(COLOURS[named % COLOURS.len()]);
        let mut path = String::new();
        for (i, (x, y)) in curve.points.iter().enumerate() {
            let _ = write!(path, "{}{:.1} {:.1}", if i == 0 { "M" } else { "L" }, px(*x), py(*y));
        }
        let _ = writeln!(svg, "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\"/>");
        if !curve.name.is_empty() {
            let (x, y) = (WIDTH + 12.0, 12.0 + 20.0 * named as f64);
            let _ = writeln!(svg, "<path d=\"M{x} {y}h18\" stroke=\"{colour}\" stroke-width=\"3\"/>");
            let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\">{}</text>", x + 24.0, y + 4.0, curve.name);
            named += 1;
        }
    }
}

/// Ends of an axis and the distance of its ticks, all round numbers.
fn span(values: impl Iterator<Item = f64>) -> (f64, f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return (0.0, 1.0, 0.5);
    }
    let rough = ((high - low) / 5.0).max(1e-6);
    let power = 10.0_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(rough);
    let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
    (low, if high > low { high } else { low + step }, step)
}

fn ticks(low: f64, high: f64, step: f64) -> impl Iterator<Item = f64> {
    (0..=((high - low) / step).round() as u32).map(move |i| low + f64::from(i) * step)
}

/// A tick without the dust of floating point.
fn round(value: f64) -> f64 {
    let rounded = (value * 1e6).round() / 1e6;
    if rounded == 0.0 { 0.0 } else { rounded }
}
