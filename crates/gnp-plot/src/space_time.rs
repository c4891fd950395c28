//! The time-space diagram of one lane, with forecasts in it.

use crate::axes::{Axis, Panel};
use crate::figure::{Figure, Legend, Sheet, Source};
use crate::palette::{BEST, INK, cividis};
use crate::road_view::{LEFT, SPAN};

/// A vehicle's stay in the lane.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Time, s, and distance along the road, m.
    pub points: Vec<[f64; 2]>,
}

/// A forecast made at the first point, of the prediction.
#[derive(Clone, Debug, PartialEq)]
pub struct LongitudinalForecast {
    /// Time, s, and distance along the road, m; the first is the last observed one.
    pub points: Vec<[f64; 2]>,
}

/// One lane of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct SpaceTime {
    /// Recording and lane.
    pub title: String,
    /// The vehicles.
    pub traces: Vec<Trace>,
    /// The forecasts.
    pub forecasts: Vec<LongitudinalForecast>,
}

/// Vehicles as lines coloured by speed, slopes are speeds; forecasts dark red on top.
#[must_use]
pub fn space_time(lane: &SpaceTime, source: &Source) -> Figure {
    let forecast = !lane.forecasts.is_empty();
    let title = if forecast { "Time and space in one lane, with forecasts" } else { "Time and space in one lane" };
    let mut sheet = Sheet::new("time-space", title);
    sheet.note(&lane.title);
    let all = || lane.traces.iter().flat_map(|t| &t.points).chain(lane.forecasts.iter().flat_map(|f| &f.points));
    let range =
        |axis: usize| all().fold([f64::INFINITY, f64::NEG_INFINITY], |r, p| [r[0].min(p[axis]), r[1].max(p[axis])]);
    let (t, x) = (range(0), range(1));
    let panel = Panel { place: [LEFT, sheet.y + 4., SPAN, 250.], x: Axis::new(t[0], t[1]), y: Axis::new(x[0], x[1]) };
    let speeds = || lane.traces.iter().flat_map(|trace| trace.points.windows(2)).filter_map(speed);
    let fastest = speeds().fold(0f64, f64::max).max(1.);
    let slowest = speeds().fold(fastest, f64::min).max(0.);
    let shade = |v: f64| cividis(((v - slowest) / (fastest - slowest).max(1e-6) * 10.).round() / 10. * 0.9);
    panel.frame(&mut sheet.svg, "time (s)", "along the road (m)", true);
    sheet.svg.clipped("time-space", panel.place);
    for trace in &lane.traces {
        sheet.svg.group("class=\"trace\"");
        let mut from = 0;
        while from + 1 < trace.points.len() {
            let colour = |i: usize| speed(&trace.points[i..i + 2]).map(shade).unwrap_or_default();
            let this = colour(from);
            let run = (from..trace.points.len() - 1).take_while(|i| colour(*i) == this).count().max(1);
            let points: Vec<_> = trace.points[from..=from + run].iter().map(|p| panel.at(p[0], p[1])).collect();
            sheet.svg.path(&points, &format!("fill=\"none\" stroke=\"{this}\" stroke-width=\"1.2\""));
            from += run;
        }
        sheet.svg.end();
    }
    for forecast in &lane.forecasts {
        let points: Vec<_> = forecast.points.iter().map(|p| panel.at(p[0], p[1])).collect();
        sheet.svg.path(&points, "fill=\"none\" stroke=\"#fff\" stroke-width=\"3\"");
        sheet.svg.path(&points, &format!("class=\"forecast\" fill=\"none\" stroke=\"{BEST}\" stroke-width=\"1.7\""));
        if let Some(start) = points.first() {
            sheet.svg.circle(*start, 2.2, &format!("fill=\"{BEST}\""));
        }
    }
    sheet.svg.end();
    sheet.y += 4. + 250. + 30.;
    legend(&mut sheet, slowest, fastest, forecast);
    let prediction = if forecast { "; dark red, from a dot at the last observed frame, the prediction" } else { "" };
    let caption = format!(
        "Vehicles of one lane as lines over time, steep where they are fast, coloured by speed{prediction}. Lines that \
         begin or end inside are lane changes or the ends of tracks."
    );
    sheet.finish(&caption, source)
}

fn speed(pair: &[[f64; 2]]) -> Option<f64> {
    let [a, b] = pair else { return None };
    (b[0] > a[0]).then(|| (b[1] - a[1]) / (b[0] - a[0]))
}

fn legend(sheet: &mut Sheet, slowest: f64, fastest: f64, forecast: bool) {
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let mut legend = Legend::under(sheet.y);
    let [x, y] = legend.place(109., "00 m/s");
    sheet.svg.text([x, y], &format!("{slowest:.0}"), &small);
    for i in 0..=10 {
        let colour = cividis(f64::from(i) / 10. * 0.9);
        sheet.svg.rect(x + 16. + 8. * f64::from(i), y - 7., 8.2, 8., &format!("fill=\"{colour}\""));
    }
    sheet.svg.text([x + 109., y], &format!("{fastest:.0} m/s"), &small);
    if forecast {
        let [x, y] = legend.place(29., "prediction");
        sheet.svg.line([x, y - 3.], [x + 24., y - 3.], &format!("stroke=\"{BEST}\" stroke-width=\"1.7\""));
        sheet.svg.circle([x, y - 3.], 2.2, &format!("fill=\"{BEST}\""));
        sheet.svg.text([x + 29., y], "prediction", &small);
    }
    sheet.y = legend.bottom();
}
