//! Intention modes: where they lead, and how many futures each stands for.

use crate::axes::{Axis, Panel};
use crate::figure::{Figure, Sheet, Source};
use crate::palette::cividis;
use crate::road_view::{LEFT, SPAN, thinned};
use crate::svg::number;

/// Modes to be drawn, largest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Intentions {
    /// Centre of each mode, m; all of the same length.
    pub centres: Vec<Vec<[f32; 2]>>,
    /// Futures in each cluster.
    pub sizes: Vec<usize>,
    /// What the centres are deviations from, such as `constant velocity`; none where they are positions.
    pub deviation_from: Option<String>,
    /// Seconds that a centre spans.
    pub seconds: f64,
}

/// The modes as paths from the vehicle, coloured by the size of their cluster, and the sizes as bars.
#[must_use]
pub fn intentions(modes: &Intentions, source: &Source) -> Figure {
    let mut sheet = Sheet::new("modes", &format!("{} intention modes", modes.sizes.len()));
    let largest = modes.sizes.iter().copied().max().unwrap_or(1).max(1) as f64;
    // Sizes differ by orders of magnitude.
    let shade = |size: usize| cividis(1. - (1. + size as f64).ln() / (1. + largest).ln());
    let (mut x, mut y) = ([0f64, 0.], [0f64, 0.]);
    for p in modes.centres.iter().flatten().filter(|p| p[0].is_finite() && p[1].is_finite()) {
        x = [x[0].min(p[0].into()), x[1].max(p[0].into())];
        y = [y[0].min(p[1].into()), y[1].max(p[1].into())];
    }
    let pad = |r: [f64; 2]| [r[0] - 0.04 * (r[1] - r[0]) - 0.2, r[1] + 0.04 * (r[1] - r[0]) + 0.2];
    let (x, y) = (pad(x), pad(y));
    let stretch = (170. / (SPAN / (x[1] - x[0]) * (y[1] - y[0])) * 2.).floor().max(1.) / 2.;
    let height = (SPAN / (x[1] - x[0]) * (y[1] - y[0]) * stretch).min(220.);
    let stretch = height / (SPAN / (x[1] - x[0]) * (y[1] - y[0]));
    let panel = Panel { place: [LEFT, sheet.y + 8., SPAN, height], x: Axis::new(x[0], x[1]), y: Axis::new(y[0], y[1]) };
    let (forward, left) = match &modes.deviation_from {
        Some(reference) => (format!("forward of where {reference} leads (m)"), "left of it (m)"),
        None => ("forward of the vehicle (m)".to_owned(), "left (m)"),
    };
    let stretched = if (stretch - 1.).abs() > 0.01 {
        format!("{left}, stretched \u{d7}{}", number((stretch * 10.).round() / 10.))
    } else {
        left.to_owned()
    };
    panel.frame(&mut sheet.svg, &forward, &stretched, true);
    sheet.svg.group("class=\"modes\"");
    for (centre, size) in modes.centres.iter().zip(&modes.sizes).rev() {
        let mut points = vec![panel.at(0., 0.)];
        points.extend(panel.points(centre));
        let points = thinned(points, 26);
        let width = 0.8 + 1.6 * (*size as f64 / largest).sqrt();
        let colour = shade(*size);
        sheet
            .svg
            .path(&points, &format!("class=\"mode\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width:.2}\""));
        if let Some(end) = points.last() {
            sheet.svg.circle(*end, 1.2 + width / 2., &format!("fill=\"{colour}\""));
        }
    }
    sheet.svg.end();
    sheet.y += 8. + height + 30.;
    sheet.note("Cluster sizes, largest first, in the colours of the paths:");
    let count = modes.sizes.len().max(1) as f64;
    let bars = Panel {
        place: [LEFT, sheet.y + 4., SPAN, 80.],
        x: Axis::new(0.5, count + 0.5),
        y: Axis::new(0., largest * 1.05),
    };
    bars.frame(&mut sheet.svg, "mode", "training futures", true);
    sheet.svg.group("class=\"sizes\"");
    for (i, size) in modes.sizes.iter().enumerate() {
        let [left, top] = bars.at(i as f64 + 0.6, *size as f64);
        let [right, bottom] = bars.at(i as f64 + 1.4, 0.);
        sheet.svg.rect(left, top, right - left, bottom - top, &format!("fill=\"{}\"", shade(*size)));
    }
    sheet.svg.end();
    sheet.y += 84. + 28.;
    let caption = format!(
        "The intention modes: centres of the clusters of training futures over {:.0} s, {}; dark and thick where a \
         cluster is large.",
        modes.seconds,
        modes.deviation_from.as_ref().map_or("as positions".to_owned(), |from| format!("as deviations from {from}"))
    );
    sheet.finish(&caption, source)
}
