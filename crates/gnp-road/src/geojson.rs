//! The one line of a GeoJSON file.

use serde_json::Value;

use crate::file::{Content, Wrong};
use crate::plane::Vector;

/// Deepest nesting of geometries that is followed: a feature in a collection has a geometry.
const DEPTH: usize = 4;

pub(crate) fn content(text: &str) -> Result<Content, Wrong> {
    let value: Value = serde_json::from_str(text)
        .map_err(|e| Wrong { line: Some(e.line()), reason: format!("is no GeoJSON: {e}; write it anew") })?;
    let mut lines = Vec::new();
    collect(&value, None, DEPTH, &mut lines)?;
    match lines.pop() {
        Some(line) if lines.is_empty() => Ok(line),
        Some(_) => Err(Wrong::new(format!(
            "has {} lines; give a file with the one along which vehicles drive, and join its parts",
            lines.len() + 1
        ))),
        None => Err(Wrong::new("has no LineString; give the road's line as one")),
    }
}

fn collect(value: &Value, properties: Option<&Value>, depth: usize, lines: &mut Vec<Content>) -> Result<(), Wrong> {
    let Some(depth) = depth.checked_sub(1) else { return Ok(()) };
    let parts = |key: &str| value.get(key).and_then(Value::as_array).into_iter().flatten();
    match value.get("type").and_then(Value::as_str) {
        Some("FeatureCollection") => parts("features").try_for_each(|it| collect(it, None, depth, lines)),
        Some("GeometryCollection") => parts("geometries").try_for_each(|it| collect(it, properties, depth, lines)),
        Some("Feature") => {
            value.get("geometry").map_or(Ok(()), |geometry| collect(geometry, value.get("properties"), depth, lines))
        }
        Some("LineString") => {
            lines.push(line(value.get("coordinates"), properties)?);
            Ok(())
        }
        Some("MultiLineString") => parts("coordinates").try_for_each(|part| {
            lines.push(line(Some(part), properties)?);
            Ok(())
        }),
        Some(_) => Ok(()),
        None => Err(Wrong::new("is JSON without a `type`, hence no GeoJSON; give the road's line as a LineString")),
    }
}

fn line(coordinates: Option<&Value>, properties: Option<&Value>) -> Result<Content, Wrong> {
    let mut points = Vec::new();
    for (i, position) in coordinates.and_then(Value::as_array).into_iter().flatten().enumerate() {
        let at = |axis: usize| position.get(axis).and_then(Value::as_f64);
        let (Some(x), Some(y)) = (at(0), at(1)) else {
            return Err(Wrong::new(format!("position {} of the LineString is not two numbers", i + 1)));
        };
        points.push([x, y] as Vector);
    }
    let lane_lines = match properties.and_then(|properties| properties.get("lane_lines")) {
        None | Some(Value::Null) => None,
        Some(value) => {
            let offsets: Option<Vec<f64>> =
                value.as_array().and_then(|lines| lines.iter().map(Value::as_f64).collect());
            let reason = "the property `lane_lines` is no list of numbers, such as [-3.7, 0, 3.7]";
            Some(offsets.ok_or_else(|| Wrong::new(reason))?)
        }
    };
    Ok(Content { points, lane_lines, ..Content::default() })
}
