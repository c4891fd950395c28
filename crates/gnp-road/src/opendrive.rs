//! The reference line and lane lines of roads of an OpenDRIVE file.
//!
//! Read are the plan view (line, arc, spiral, paramPoly3), and widths of lanes where they are the same all along. Heights,
//! banks, junctions and everything else are left.

use roxmltree::{Document, Node};

use crate::file::{Content, Wrong};
use crate::plane::{Vector, add, length, sub};
use crate::points::{MAX_LENGTH, MAX_POINTS};

/// Distance of points where the line bends, and where it is straight, m.
const STEP: [f64; 2] = [5., 20.];

/// Points nearer than this to the one before are left out, m.
const NEAR: f64 = 0.5;

/// Farthest that a road may begin from the end of the one before, m.
const GAP: f64 = 1.;

/// Most roads that a message names.
const NAMED: usize = 8;

/// Nodes and weights of Gauss and Legendre on [0, 1]: for the coordinates of a spiral, exact to rounding over [`STEP`].
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5. / 18.), (0.5, 8. / 18.), (0.887_298_334_620_741_7, 5. / 18.)];

/// Lanes on which vehicles drive.
const DRIVING: [&str; 13] = [
    "driving",
    "entry",
    "exit",
    "onRamp",
    "offRamp",
    "connectingRamp",
    "slipLane",
    "mwyEntry",
    "mwyExit",
    "bus",
    "taxi",
    "HOV",
    "bidirectional",
];

/// Roads `ids`, separated by commas, joined in this order; the only road outside of junctions where `None`.
pub(crate) fn content(text: &str, ids: Option<&str>) -> Result<Content, Wrong> {
    let document = Document::parse(text).map_err(|e| {
        // It may quote a name that never ends.
        let said: String = e.to_string().chars().take(160).collect();
        Wrong { line: Some(e.pos().row as usize), reason: format!("is no XML: {said}; write it anew") }
    })?;
    let root = document.root_element();
    if root.tag_name().name() != "OpenDRIVE" {
        return Err(Wrong::new("is XML, but not OpenDRIVE; give the road's line as CSV, GeoJSON or OpenDRIVE"));
    }
    let roads: Vec<Node<'_, '_>> = children(root, "road").collect();
    let chosen = match ids {
        Some(ids) => ids.split(',').map(|id| by_id(&roads, id.trim())).collect::<Result<Vec<_>, _>>()?,
        None => vec![only(&roads)?],
    };
    let mut parts = chosen.into_iter().map(Part::of);
    let Some(mut whole) = parts.next().transpose()? else { return Err(Wrong::new("has no roads")) };
    for part in parts {
        whole.join(part?)?;
    }
    if !whole.sides[0].driven && whole.sides[1].driven {
        whole.reverse();
    }
    let [along, _] = whole.sides;
    Ok(Content { points: whole.points, lane_lines: along.lines, ..Content::default() })
}

fn children<'a, 'b>(node: Node<'a, 'b>, name: &'static str) -> impl Iterator<Item = Node<'a, 'b>> {
    node.children().filter(move |child| child.tag_name().name() == name)
}

fn by_id<'a, 'b>(roads: &[Node<'a, 'b>], id: &str) -> Result<Node<'a, 'b>, Wrong> {
    let found = roads.iter().copied().find(|road| road.attribute("id") == Some(id));
    found.ok_or_else(|| Wrong::new(format!("has no road {id:?}; {}", listed(roads))))
}

fn only<'a, 'b>(roads: &[Node<'a, 'b>]) -> Result<Node<'a, 'b>, Wrong> {
    let mut outside = roads.iter().copied().filter(|road| road.attribute("junction").is_none_or(|id| id == "-1"));
    match (outside.next(), outside.next()) {
        (Some(road), None) => Ok(road),
        _ => Err(Wrong::new(format!(
            "{}; name the one to take, or several in the order of travel: FILE#ID or FILE#ID,ID",
            listed(roads)
        ))),
    }
}

/// The roads for a message, the longest first.
fn listed(roads: &[Node<'_, '_>]) -> String {
    let mut all: Vec<(f64, &str)> = roads
        .iter()
        .map(|road| (number(*road, "length").unwrap_or(0.), road.attribute("id").unwrap_or_default()))
        .collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let named: Vec<String> = all.iter().take(NAMED).map(|(length, id)| format!("{id} ({length:.0} m)")).collect();
    let more = if all.len() > NAMED { ", ..." } else { "" };
    format!("it has {} roads: {}{more}", all.len(), named.join(", "))
}

/// An attribute that must be a finite number.
fn number(node: Node<'_, '_>, name: &str) -> Result<f64, Wrong> {
    let value = node.attribute(name).and_then(|text| text.trim().parse::<f64>().ok()).filter(|value| value.is_finite());
    value.ok_or_else(|| wrong(node, &format!("attribute `{name}` is missing or no number")))
}

fn wrong(node: Node<'_, '_>, what: &str) -> Wrong {
    let line = node.document().text_pos_at(node.range().start).row;
    Wrong { line: Some(line as usize), reason: format!("element <{}>: {what}; write it anew", node.tag_name().name()) }
}

/// One road, or several joined.
struct Part {
    points: Vec<Vector>,
    /// The lanes of those who drive along the points, and against them.
    sides: [Side; 2],
}

/// The lanes of one direction of travel.
#[derive(Default)]
struct Side {
    /// Whether there are any.
    driven: bool,
    /// Their lines, m to the left of the points' order, from right to left; `None` where they are not the same all along.
    lines: Option<Vec<f64>>,
}

impl Part {
    fn of(road: Node<'_, '_>) -> Result<Self, Wrong> {
        let Some(view) = children(road, "planView").next() else { return Err(wrong(road, "there is no planView")) };
        let mut points = Vec::new();
        for geometry in children(view, "geometry") {
            for point in sampled(geometry)? {
                if points.last().is_none_or(|last| length(sub(point, *last)) >= NEAR) {
                    points.push(point);
                }
            }
            if points.len() > MAX_POINTS {
                return Err(wrong(geometry, "the road is longer than any"));
            }
        }
        Ok(Self { points, sides: lanes(road)? })
    }

    fn reverse(&mut self) {
        self.points.reverse();
        self.sides.reverse();
        for lines in self.sides.iter_mut().flat_map(|side| &mut side.lines) {
            lines.reverse();
            lines.iter_mut().for_each(|line| *line = -*line);
        }
    }

    /// Goes on with `next`, turned round where its end is the nearer one.
    fn join(&mut self, mut next: Self) -> Result<(), Wrong> {
        let ends = |part: &Self| part.points.first().copied().zip(part.points.last().copied());
        let (Some((start, end)), Some((first, last))) = (ends(self), ends(&next)) else {
            return Err(Wrong::new("has a road without geometry"));
        };
        let away = |a: Vector, b: Vector| length(sub(a, b));
        let gaps = [away(end, first), away(end, last), away(start, first), away(start, last)];
        // Of the first two either one may be against their order.
        if gaps[2].min(gaps[3]) < gaps[0].min(gaps[1]) {
            self.reverse();
        }
        let (Some((_, end)), Some((first, last))) = (ends(self), ends(&next)) else { return Ok(()) };
        if away(end, last) < away(end, first) {
            next.reverse();
        }
        let gap = next.points.first().map_or(0., |first| away(end, *first));
        if gap > GAP {
            let reason = format!("has {gap:.1} m between two of the roads; name roads that follow one another");
            return Err(Wrong::new(reason));
        }
        let skipped = usize::from(gap < NEAR);
        self.points.extend(next.points.into_iter().skip(skipped));
        for (side, next) in self.sides.iter_mut().zip(next.sides) {
            side.driven |= next.driven;
            side.lines = side.lines.take().filter(|lines| next.lines.as_ref() == Some(lines));
        }
        Ok(())
    }
}

/// Points of a piece of the plan view, its end among them.
fn sampled(geometry: Node<'_, '_>) -> Result<Vec<Vector>, Wrong> {
    let of = |name| number(geometry, name);
    let (start, heading, extent) = ([of("x")?, of("y")?], of("hdg")?, of("length")?);
    if !(0. ..=MAX_LENGTH).contains(&extent) {
        return Err(wrong(geometry, "its length is that of no road"));
    }
    let Some(shape) = geometry.children().find(|child| child.is_element() && child.tag_name().name() != "userData")
    else {
        return Err(wrong(geometry, "it has no shape"));
    };
    let curvatures = match shape.tag_name().name() {
        "line" => [0., 0.],
        "arc" => [number(shape, "curvature")?; 2],
        "spiral" => [number(shape, "curvStart")?, number(shape, "curvEnd")?],
        "paramPoly3" => return cubic(shape, start, heading, extent),
        other => return Err(wrong(shape, &format!("{other} is not read, only line, arc, spiral and paramPoly3"))),
    };
    let [first, last] = curvatures;
    let step = if curvatures == [0., 0.] { STEP[1] } else { STEP[0] };
    let count = (extent / step).ceil().max(1.) as usize;
    let h = extent / count as f64;
    let rate = if extent > 0. { (last - first) / extent } else { 0. };
    let direction = |u: f64| heading + u * (first + rate * u / 2.);
    let mut points = vec![start];
    let mut at = start;
    for i in 0..count {
        for (node, weight) in GAUSS {
            let (sin, cos) = direction(h * (i as f64 + node)).sin_cos();
            at = add(at, [h * weight * cos, h * weight * sin]);
        }
        points.push(at);
    }
    Ok(points)
}

fn cubic(shape: Node<'_, '_>, start: Vector, heading: f64, extent: f64) -> Result<Vec<Vector>, Wrong> {
    let of = |names: [&str; 4]| -> Result<[f64; 4], Wrong> {
        let mut values = [0.; 4];
        for (value, name) in values.iter_mut().zip(names) {
            *value = number(shape, name)?;
        }
        Ok(values)
    };
    let (u, v) = (of(["aU", "bU", "cU", "dU"])?, of(["aV", "bV", "cV", "dV"])?);
    let most = if shape.attribute("pRange") == Some("arcLength") { extent } else { 1. };
    let value = |[a, b, c, d]: [f64; 4], p: f64| a + p * (b + p * (c + p * d));
    let (sin, cos) = heading.sin_cos();
    let count = (extent / STEP[0]).ceil().max(1.) as usize;
    let at = |i: usize| {
        let p = most * i as f64 / count as f64;
        let (u, v) = (value(u, p), value(v, p));
        add(start, [u * cos - v * sin, u * sin + v * cos])
    };
    Ok((0..=count).map(at).collect())
}

/// Lanes that are driven along the road, and against it.
fn lanes(road: Node<'_, '_>) -> Result<[Side; 2], Wrong> {
    let mut sides = [Side::default(), Side::default()];
    let Some(lanes) = children(road, "lanes").next() else { return Ok(sides) };
    let sections: Vec<Node<'_, '_>> = children(lanes, "laneSection").collect();
    let offset = constant(children(lanes, "laneOffset"))?;
    let names = if road.attribute("rule") == Some("LHT") { ["left", "right"] } else { ["right", "left"] };
    for (side, name) in sides.iter_mut().zip(names) {
        side.driven = sections.iter().flat_map(|section| of_side(*section, name)).any(|(_, lane)| is_driven(lane));
        if let (Some(offset), [section]) = (offset, &sections[..]) {
            side.lines = lines(&of_side(*section, name), offset, if name == "right" { -1. } else { 1. })?;
        }
    }
    Ok(sides)
}

/// Lines of the driven lanes of one side, from right to left; `outwards` is 1 on the left.
fn lines(lanes: &[(i64, Node<'_, '_>)], offset: f64, outwards: f64) -> Result<Option<Vec<f64>>, Wrong> {
    let (mut lines, mut at) = (Vec::new(), offset);
    for (_, lane) in lanes {
        let Some(width) = constant(children(*lane, "width"))? else { return Ok(None) };
        let outer = at + outwards * width;
        match (is_driven(*lane), lines.is_empty()) {
            (true, true) => lines.extend([at, outer]),
            (true, false) => lines.push(outer),
            (false, false) => break,
            (false, true) => {}
        }
        at = outer;
    }
    lines.sort_by(f64::total_cmp);
    Ok(Some(lines).filter(|lines| !lines.is_empty()))
}

fn is_driven(lane: Node<'_, '_>) -> bool {
    lane.attribute("type").is_some_and(|kind| DRIVING.contains(&kind))
}

/// The lanes of one side, from the middle outwards, by their distance in numbers.
fn of_side<'a, 'b>(section: Node<'a, 'b>, side: &str) -> Vec<(i64, Node<'a, 'b>)> {
    let sides = section.children().filter(|child| child.tag_name().name() == side);
    let lanes = sides.flat_map(|side| children(side, "lane"));
    let numbered = lanes.filter_map(|lane| Some((lane.attribute("id")?.trim().parse::<i64>().ok()?.abs(), lane)));
    let mut all: Vec<(i64, Node<'a, 'b>)> = numbered.collect();
    all.sort_by_key(|(number, _)| *number);
    all
}

/// The value of cubics that are all the same number, 0 where there are none; `None` where it changes.
fn constant<'a, 'b: 'a>(cubics: impl Iterator<Item = Node<'a, 'b>>) -> Result<Option<f64>, Wrong> {
    let mut found = None;
    for cubic in cubics {
        let value = number(cubic, "a")?;
        let changes = ["b", "c", "d"].iter().any(|name| number(cubic, name).is_ok_and(|value| value != 0.));
        if changes || found.is_some_and(|before| before != value) {
            return Ok(None);
        }
        found = Some(value);
    }
    Ok(Some(found.unwrap_or(0.)))
}
