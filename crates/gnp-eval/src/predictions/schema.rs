//! The columns of a prediction file, their types and units.

use std::sync::Arc;

use gnp_data::{Dataset, Explanation, SLOTS, Slot, StepForces};
use parquet::basic::{ConvertedType, Repetition, Type as PhysicalType};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::schema::types::{Type, TypePtr};

/// Name and version of the schema in a file's key-value metadata.
const SCHEMA: &str = "gnp-predictions 1";
/// Columns that explain a step: goal, forces, relaxation time, strengths.
pub(super) const EXPLAINING: usize = 2 + 6 + 2 * SLOTS + 1 + SLOTS;

/// One column of a prediction file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColumnInfo {
    /// Name.
    pub name: String,
    /// Type: `text`, `whole number` or `number` (single precision).
    pub kind: &'static str,
    /// Unit; empty where there is none.
    pub unit: &'static str,
    /// Whether a file that is to be scored must have it.
    pub required: bool,
    /// What it holds.
    pub meaning: String,
}

/// Where a prediction file comes from; it goes into the file's key-value metadata.
#[derive(Clone, Debug, PartialEq)]
pub struct Provenance {
    /// Name of the model.
    pub model: String,
    /// The data family.
    pub dataset: Dataset,
    /// Rate of the predicted frames, Hz.
    pub rate_hz: f64,
    /// Whether any recording is simulated.
    pub simulated: bool,
    /// Whether the model is handed recorded futures.
    pub uses_future: bool,
}

/// The schema of a prediction file, in the order of its columns. Columns that are not required may
/// be missing or hold nulls; forces are accelerations.
#[must_use]
pub fn prediction_columns() -> Vec<ColumnInfo> {
    let column = |name: &str, kind, unit, required, meaning: &str| ColumnInfo {
        name: name.to_owned(),
        kind,
        unit,
        required,
        meaning: meaning.to_owned(),
    };
    let (text, whole, number) = ("text", "whole number", "number");
    let mut columns = vec![
        column("scene", text, "", true, "name of the recording (`recording` is read as well)"),
        column("vehicle", whole, "", true, "vehicle of the recording"),
        column("segment", whole, "", false, "gap-free stretch of that vehicle, from 0"),
        column("t0", whole, "frame", true, "frame number of the last observed frame"),
        column("mode", whole, "", true, "number of the mode, any distinct numbers"),
        column("probability", number, "", true, "of the mode, the same in all its rows; sums to 1 in a window"),
        column("step", whole, "", true, "predicted frame, from 1"),
        column("t_s", number, "s", false, "time after the last observed frame"),
        column("x", number, "m", true, "centre, forward from the last observed centre"),
        column("y", number, "m", true, "centre, to the left of the last observed centre"),
        column("origin_x", number, "m", false, "last observed centre in the road frame, forward"),
        column("origin_y", number, "m", false, "last observed centre in the road frame, to the left"),
    ];
    columns.extend(explaining_columns());
    columns
}

/// The columns that [`explaining_values`] fills, in its order.
fn explaining_columns() -> Vec<ColumnInfo> {
    let mut columns = Vec::with_capacity(EXPLAINING);
    let mut add = |name: String, unit, meaning: String| {
        columns.push(ColumnInfo { name, kind: "number", unit, required: false, meaning });
    };
    for (axis, way) in [("x", "forward"), ("y", "to the left")] {
        add(format!("goal_{axis}"), "m", format!("goal of the mode, window frame, {way}"));
    }
    let whole = [
        ("goal", "attraction of the goal"),
        ("neighbours", "repulsion of all neighbours"),
        ("lines", "repulsion of all lane lines"),
    ];
    let slots =
        Slot::ALL.map(|slot| (slot_name(slot), format!("repulsion of the neighbour in slot {}", slot_name(slot))));
    for (part, meaning) in whole.map(|(part, meaning)| (part, meaning.to_owned())).into_iter().chain(slots) {
        for (axis, way) in [("x", "forward"), ("y", "to the left")] {
            add(format!("force_{part}_{axis}"), "m/s2", format!("{meaning}, {way}"));
        }
    }
    add("tau".to_owned(), "s", "relaxation time".to_owned());
    for slot in Slot::ALL {
        let name = slot_name(slot);
        add(format!("k_{name}"), "m/s2", format!("strength of the neighbour in slot {name}; 0 where nobody is"));
    }
    columns
}

/// A step's explanation as the numbers of its columns. Strengths of single lane lines differ in
/// number from road to road and have no column.
pub(super) fn explaining_values(goal: [f32; 2], step: &StepForces) -> impl Iterator<Item = f32> {
    let forces = [step.goal, step.neighbours, step.lines].into_iter().chain(step.by_slot);
    std::iter::once(goal).chain(forces).flatten().chain([step.tau]).chain(step.k_slots)
}

/// The goal and the step that [`explaining_values`] gave these numbers for.
pub(super) fn explained(values: &[f32; EXPLAINING]) -> ([f32; 2], StepForces) {
    let pair = |i: usize| [values[2 * i], values[2 * i + 1]];
    let tau = 2 * (4 + SLOTS);
    let step = StepForces {
        goal: pair(1),
        neighbours: pair(2),
        lines: pair(3),
        by_slot: std::array::from_fn(|slot| pair(4 + slot)),
        tau: values[tau],
        k_slots: std::array::from_fn(|slot| values[tau + 1 + slot]),
        k_lines: Vec::new(),
    };
    (pair(0), step)
}

/// The numbers of step `j` of a mode, if it is explained.
pub(super) fn explanation_of(explanation: Option<&Explanation>, j: usize) -> Option<impl Iterator<Item = f32>> {
    let explanation = explanation?;
    Some(explaining_values(explanation.goal, explanation.steps.get(j)?))
}

fn slot_name(slot: Slot) -> &'static str {
    match slot {
        Slot::Preceding => "preceding",
        Slot::Following => "following",
        Slot::LeftPreceding => "left_preceding",
        Slot::LeftAlongside => "left_alongside",
        Slot::LeftFollowing => "left_following",
        Slot::RightPreceding => "right_preceding",
        Slot::RightAlongside => "right_alongside",
        Slot::RightFollowing => "right_following",
    }
}

/// The schema in Parquet's types.
pub(super) fn parquet_schema() -> Result<TypePtr, ParquetError> {
    let field = |column: ColumnInfo| {
        let builder = match column.kind {
            "text" => Type::primitive_type_builder(&column.name, PhysicalType::BYTE_ARRAY)
                .with_converted_type(ConvertedType::UTF8),
            "whole number" => Type::primitive_type_builder(&column.name, PhysicalType::INT32)
                .with_converted_type(ConvertedType::UINT_32),
            _ => Type::primitive_type_builder(&column.name, PhysicalType::FLOAT),
        };
        let explains = column.name.starts_with("goal_")
            || column.name.starts_with("force_")
            || column.name.starts_with("k_")
            || column.name == "tau";
        let repetition = if explains { Repetition::OPTIONAL } else { Repetition::REQUIRED };
        Ok(Arc::new(builder.with_repetition(repetition).build()?))
    };
    let fields = prediction_columns().into_iter().map(field).collect::<Result<Vec<_>, ParquetError>>()?;
    Ok(Arc::new(Type::group_type_builder("predictions").with_fields(fields).build()?))
}

impl Provenance {
    /// The file's key-value metadata: the provenance, the frame and the unit of every column.
    pub(super) fn key_values(&self) -> Vec<KeyValue> {
        let units = prediction_columns().into_iter().filter(|column| !column.unit.is_empty());
        let units: Vec<String> = units.map(|column| format!("{} {}", column.name, column.unit)).collect();
        let pairs = [
            ("schema", SCHEMA.to_owned()),
            ("model", self.model.clone()),
            ("dataset", self.dataset.to_string()),
            ("rate_hz", self.rate_hz.to_string()),
            ("simulated", self.simulated.to_string()),
            ("uses_future", self.uses_future.to_string()),
            ("frame", "x forward, y to the left, origin at the last observed centre of the box".to_owned()),
            ("units", units.join(", ")),
        ];
        pairs.into_iter().map(|(key, value)| KeyValue::new(key.to_owned(), value)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn explanations_fill_their_columns_in_order() {
        let names: Vec<String> = explaining_columns().into_iter().map(|column| column.name).collect();
        assert_eq!(names.len(), EXPLAINING);
        let values: [f32; EXPLAINING] = std::array::from_fn(|i| i as f32);
        let (goal, step) = explained(&values);
        let back: Vec<f32> = explaining_values(goal, &step).collect();
        assert_eq!(back, values);
        let at = |name: &str| values[names.iter().position(|n| n == name).unwrap()];
        assert_eq!(goal, [at("goal_x"), at("goal_y")]);
        assert_eq!(step.lines, [at("force_lines_x"), at("force_lines_y")]);
        let alongside = Slot::RightAlongside as usize;
        assert_eq!(step.by_slot[alongside], [at("force_right_alongside_x"), at("force_right_alongside_y")]);
        assert_eq!(step.tau, at("tau"));
        assert_eq!(step.k_slots[Slot::LeftFollowing as usize], at("k_left_following"));
    }

    #[test]
    fn lengths_and_times_have_units() {
        for column in prediction_columns() {
            let measured = ["x", "y", "t_s", "t0", "tau"].contains(&column.name.as_str()) || column.name.contains('_');
            assert_eq!(!column.unit.is_empty(), measured, "{}", column.name);
        }
    }
}
