//! Causes as they are drawn: names, colours, and bars that lead from one place to another.

use gnp_data::{Account, Cause};
use gnp_force::{CarFollowing, ForceTerm, FreeRoad, GoalAttraction, VehicleRepulsion};

use crate::axes::{Axis, Panel};
use crate::figure::{Sheet, WIDTH};
use crate::palette::{BEST, GRID, INK, rim};

/// Height of a row, user units.
const ROW: f64 = 13.;
/// Right edge of the names, and left edge of the numbers behind a row.
const NAMES: f64 = 120.;
const NUMBERS: f64 = WIDTH - 40.;
/// Rows of causes at most; smaller parts share the last one.
const MOST: usize = 8;
/// Parts that nowhere reach this share the last row, m.
const SEEN: f32 = 0.05;
/// A part that is not worth a row at all, m.
const NOTHING: f32 = 0.005;
/// What several small parts share.
const SMALL: &str = "#9aa0a8";

/// A cause, or several small ones together.
#[derive(Clone, Debug)]
pub(crate) struct DrawnPart {
    pub(crate) name: String,
    pub(crate) colour: String,
    /// After each step, m.
    pub(crate) displacement: Vec<[f32; 2]>,
}

impl DrawnPart {
    pub(crate) fn end(&self) -> [f32; 2] {
        self.displacement.last().copied().unwrap_or_default()
    }
}

/// The parts of an account in its order, small ones together at the end; what is left out is below what a number shows.
pub(crate) fn drawn(account: &Account) -> Vec<DrawnPart> {
    let steps = account.steps();
    let reach: Vec<f32> = account
        .parts
        .iter()
        .map(|part| part.displacement.iter().flatten().fold(0f32, |most, value| most.max(value.abs())))
        .collect();
    let mut order: Vec<usize> = (0..reach.len()).collect();
    order.sort_by(|a, b| reach[*b].total_cmp(&reach[*a]));
    let mut small: Vec<usize> =
        order.iter().enumerate().filter(|(rank, i)| *rank >= MOST - 1 || reach[**i] < SEEN).map(|(_, i)| *i).collect();
    // One alone may have its name.
    if small.len() == 1 {
        small.clear();
    }
    let part = |i: usize| {
        let part = &account.parts[i];
        let displacement = (1..=steps).map(|step| part.after(step)).collect();
        DrawnPart { name: account.cause_name(&part.cause), colour: colour(&part.cause), displacement }
    };
    let mut parts: Vec<DrawnPart> = (0..reach.len()).filter(|i| !small.contains(i)).map(part).collect();
    if !small.is_empty() {
        let sum = |step: usize| {
            let parts = small.iter().map(|i| account.parts[*i].after(step));
            parts.fold([0.; 2], |sum: [f32; 2], part| [sum[0] + part[0], sum[1] + part[1]])
        };
        let displacement: Vec<[f32; 2]> = (1..=steps).map(sum).collect();
        if displacement.iter().flatten().any(|value| value.abs() >= NOTHING) {
            let name = format!("{} others together", small.len());
            parts.push(DrawnPart { name, colour: SMALL.to_owned(), displacement });
        }
    }
    parts
}

/// The colour of the force that a cause acts by; vehicles farther ahead are paler.
fn colour(cause: &Cause) -> String {
    let of = |law: &dyn ForceTerm<f32>| law.descriptor().colour.to_string();
    match cause {
        Cause::FreeRoad => of(&FreeRoad),
        Cause::Leader { place, .. } => paler(&of(&CarFollowing), 0.35 * (place.saturating_sub(1)).min(2) as f64),
        Cause::FartherLeaders => paler(&of(&CarFollowing), 0.35),
        Cause::Intention => of(&GoalAttraction),
        Cause::Neighbour { .. } | Cause::Neighbours => of(&VehicleRepulsion),
        Cause::Term(name) => gnp_force::term::<f32>(name).map_or_else(|| SMALL.to_owned(), of),
        _ => SMALL.to_owned(),
    }
}

/// A colour `#rrggbb` mixed with `share` of white.
fn paler(colour: &str, share: f64) -> String {
    let part = |i: usize| colour.get(i..i + 2).and_then(|text| u8::from_str_radix(text, 16).ok()).map(f64::from);
    let (Some(r), Some(g), Some(b)) = (part(1), part(3), part(5)) else { return colour.to_owned() };
    let mixed = |c: f64| (c + (255. - c) * share).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mixed(r), mixed(g), mixed(b))
}

/// A row of bars.
pub(crate) struct Bar<'a> {
    pub(crate) name: &'a str,
    pub(crate) colour: &'a str,
    /// How far it leads on, m.
    pub(crate) length: f64,
    /// Whether it is the sum: drawn from zero, in bold.
    pub(crate) sum: bool,
}

/// The bars of some parts along one axis (0 forward, 1 left), and their sum.
pub(crate) fn bars_of<'a>(parts: &'a [DrawnPart], axis: usize, sum: &'a str) -> Vec<Bar<'a>> {
    let length = |part: &DrawnPart| f64::from(part.end()[axis]);
    let whole = parts.iter().map(length).sum();
    let bar = |part: &'a DrawnPart| Bar { name: &part.name, colour: &part.colour, length: length(part), sum: false };
    parts.iter().map(bar).chain([Bar { name: sum, colour: BEST, length: whole, sum: true }]).collect()
}

/// Bars under each other, each beginning where the last one ends, with their lengths behind them.
pub(crate) fn bars(sheet: &mut Sheet, bars: &[Bar<'_>], axis: &str) {
    let mut ends = vec![0f64];
    let mut at = 0.;
    for bar in bars.iter().filter(|bar| bar.length.is_finite()) {
        at = if bar.sum { bar.length } else { at + bar.length };
        ends.push(at);
    }
    let low = ends.iter().copied().fold(0., f64::min);
    let high = ends.iter().copied().fold(0., f64::max);
    let margin = ((high - low) * 0.05).max(0.05);
    let top = sheet.y + 3.;
    let height = ROW * bars.len().max(1) as f64 + 4.;
    let place = [NAMES + 6., top, NUMBERS - NAMES - 12., height];
    let panel = Panel { place, x: Axis::new(low - margin, high + margin), y: Axis::new(0., 1.) };
    let small = format!("font-size=\"9\" fill=\"{INK}\"");
    let svg = &mut sheet.svg;
    svg.group("class=\"bars\"");
    panel.frame_below(svg, axis);
    let zero = panel.at(0., 0.)[0];
    svg.line([zero, top], [zero, top + height], &format!("class=\"zero\" stroke=\"{INK}\" stroke-width=\"0.9\""));
    let mut from = 0.;
    for (i, bar) in bars.iter().enumerate() {
        let y = top + 2. + ROW * i as f64;
        let (start, end) = if bar.sum { (0., bar.length) } else { (from, from + bar.length) };
        let [a, b] = [start, end].map(|value| panel.at(value, 0.)[0]);
        let weight = if bar.sum { "font-weight=\"bold\"" } else { "" };
        svg.group(&format!("class=\"row{}\"", if bar.sum { " sum" } else { "" }));
        let style = format!("class=\"name\" text-anchor=\"end\" {weight} {small}");
        svg.text([NAMES, y + ROW / 2. + 3.2], bar.name, &style);
        let rim = rim(bar.colour).unwrap_or_else(|| bar.colour.to_owned());
        let style = format!("class=\"bar\" fill=\"{}\" stroke=\"{rim}\" stroke-width=\"0.6\"", bar.colour);
        svg.rect(a.min(b), y + 1.5, (a - b).abs(), ROW - 3., &style);
        if !bar.sum {
            let style = format!("class=\"on\" stroke=\"{GRID}\" stroke-width=\"0.8\"");
            svg.line([b, y + ROW - 1.5], [b, y + ROW + 1.5], &style);
        }
        svg.text([NUMBERS, y + ROW / 2. + 3.2], &number(bar.length), &format!("class=\"number\" {weight} {small}"));
        svg.end();
        from = end;
    }
    svg.end();
    sheet.y = top + height + 27.;
}

/// A length in m with its sign, a true minus, and one or two decimals.
fn number(value: f64) -> String {
    let text = if value.abs() < 9.995 { format!("{value:+.2}") } else { format!("{value:+.1}") };
    match text.trim_start_matches(['+', '-']) {
        "0.00" => "0".to_owned(),
        _ => text.replace('-', "\u{2212}"),
    }
}
