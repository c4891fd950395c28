//! A panel with axes: data to drawing, ticks, units.

use crate::palette::{GRID, INK};
use crate::svg::{Svg, number};

/// One axis: a range of data over a range of the drawing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    pub(crate) data: [f64; 2],
    pub(crate) log: bool,
}

impl Axis {
    /// From `from` to `to`; an empty range is widened.
    pub(crate) fn new(from: f64, to: f64) -> Self {
        let (from, to) = if from.is_finite() && to.is_finite() { (from, to) } else { (0., 1.) };
        let data = if to - from > 1e-9 { [from, to] } else { [from - 0.5, from + 0.5] };
        Self { data, log: false }
    }

    /// Logarithmic from `from` to `to`, both positive.
    pub(crate) fn log(from: f64, to: f64) -> Self {
        let from = if from.is_finite() && from > 0. { from } else { 1e-3 };
        let to = if to.is_finite() && to > from * 1.0001 { to } else { from * 10. };
        Self { data: [from, to], log: true }
    }

    /// Share of the axis, 0 at its start.
    fn share(&self, value: f64) -> f64 {
        let [from, to] = self.data;
        if self.log { (value / from).ln() / (to / from).ln() } else { (value - from) / (to - from) }
    }

    /// Round values for about `want` ticks.
    pub(crate) fn ticks(&self, want: usize) -> Vec<f64> {
        let [from, to] = self.data;
        if self.log {
            let decades = from.log10().floor() as i32..=to.log10().ceil() as i32;
            let ticks = |steps: &[f64]| -> Vec<f64> {
                let all = decades.clone().flat_map(|d| steps.iter().map(move |s| s * 10f64.powi(d)));
                all.filter(|v| *v >= from * 0.999 && *v <= to * 1.001).collect()
            };
            let few: &[f64] = &[1.];
            let steps = if (to / from).log10() > 2. { [few, &[1., 2., 5.]] } else { [&[1., 2., 5.], few] };
            if let Some(inside) = steps.map(ticks).into_iter().find(|inside| inside.len() >= 3) {
                return inside;
            }
            // Less than a decade: evenly spaced values say more.
        }
        let step = nice((to - from) / want.max(1) as f64);
        let first = (from / step - 1e-6).ceil() as i64;
        (first..).map(|i| i as f64 * step).take_while(|v| *v <= to + step * 1e-6).collect()
    }
}

/// The next of 1, 2 and 5 times a power of ten.
pub(crate) fn nice(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.) {
        return 1.;
    }
    let power = 10f64.powf(value.log10().floor());
    let factor = [1., 2., 5., 10.].into_iter().find(|f| f * power >= value * 0.999_999).unwrap_or(10.);
    factor * power
}

/// A rectangle of the drawing with an axis to the right and one upwards.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Panel {
    /// Left, top, width, height.
    pub(crate) place: [f64; 4],
    pub(crate) x: Axis,
    pub(crate) y: Axis,
}

impl Panel {
    /// Where a point of the data is drawn: larger y is higher.
    pub(crate) fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let [left, top, width, height] = self.place;
        [left + width * self.x.share(x), top + height * (1. - self.y.share(y))]
    }

    pub(crate) fn points(&self, points: &[[f32; 2]]) -> Vec<[f64; 2]> {
        points
            .iter()
            .filter(|p| p[0].is_finite() && p[1].is_finite())
            .map(|p| self.at(p[0].into(), p[1].into()))
            .collect()
    }

    /// Frame, ticks and labels; a grid behind charts.
    pub(crate) fn frame(&self, svg: &mut Svg, x_label: &str, y_label: &str, grid: bool) {
        let [left, top, width, height] = self.place;
        let small = format!("font-size=\"9\" fill=\"{INK}\"");
        svg.group("class=\"axes\"");
        self.below(svg, x_label, grid);
        for value in self.y.ticks((height / 26.).max(4.) as usize) {
            let [_, y] = self.at(self.x.data[0], value);
            if grid {
                svg.line([left, y], [left + width, y], &format!("stroke=\"{GRID}\" stroke-width=\"0.6\""));
            }
            svg.line([left - 3., y], [left, y], &format!("stroke=\"{INK}\" stroke-width=\"0.8\""));
            svg.text([left - 5., y + 3.2], &shown(value), &format!("text-anchor=\"end\" {small}"));
        }
        svg.rect(left, top, width, height, &format!("fill=\"none\" stroke=\"{INK}\" stroke-width=\"0.8\""));
        svg.text_up([left - 33., top + height / 2.], y_label, &small);
        svg.end();
    }

    /// Frame, and ticks and label of the axis below, over a grid.
    pub(crate) fn frame_below(&self, svg: &mut Svg, label: &str) {
        let [left, top, width, height] = self.place;
        svg.group("class=\"axes\"");
        self.below(svg, label, true);
        svg.rect(left, top, width, height, &format!("fill=\"none\" stroke=\"{INK}\" stroke-width=\"0.8\""));
        svg.end();
    }

    fn below(&self, svg: &mut Svg, label: &str, grid: bool) {
        let [left, top, width, height] = self.place;
        let small = format!("font-size=\"9\" fill=\"{INK}\" text-anchor=\"middle\"");
        for value in self.x.ticks((width / 38.) as usize) {
            let [x, _] = self.at(value, self.y.data[0]);
            if grid {
                svg.line([x, top], [x, top + height], &format!("stroke=\"{GRID}\" stroke-width=\"0.6\""));
            }
            svg.line([x, top + height], [x, top + height + 3.], &format!("stroke=\"{INK}\" stroke-width=\"0.8\""));
            svg.text([x, top + height + 12.], &shown(value), &small);
        }
        svg.text([left + width / 2., top + height + 24.], label, &small);
    }
}

/// A tick's value: no more digits than it needs, a true minus.
pub(crate) fn shown(value: f64) -> String {
    let text = if value.abs() >= 0.1 || value.abs() < 1e-9 { number(value) } else { format!("{value:.1e}") };
    let text = if value.abs() < 0.1 && value.abs() >= 0.001 { number3(value) } else { text };
    text.replace('-', "\u{2212}")
}

fn number3(value: f64) -> String {
    format!("{value:.3}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(Axis::new(-12., 31.).ticks(4), [0., 20.]);
        assert_eq!(Axis::new(0., 5.).ticks(5), [0., 1., 2., 3., 4., 5.]);
        assert_eq!(Axis::log(0.09, 3.).ticks(4), [0.1, 0.2, 0.5, 1., 2.]);
        assert_eq!(Axis::log(0.22, 25.).ticks(4), [0.5, 1., 2., 5., 10., 20.]);
        assert_eq!(Axis::log(0.62, 0.91).ticks(3), [0.7, 0.8, 0.9].map(|v: f64| (v * 10.).round() * 0.1));
        assert_eq!(Axis::new(2., 2.).data, [1.5, 2.5]);
    }

    #[test]
    fn right_is_more_and_up_is_more() {
        let panel = Panel { place: [40., 10., 200., 100.], x: Axis::new(-50., 150.), y: Axis::new(-5., 5.) };
        assert_eq!(panel.at(-50., -5.), [40., 110.]);
        assert_eq!(panel.at(0., 0.), [90., 60.]);
        assert_eq!(panel.at(0., 5.)[1], 10.);
    }
}
