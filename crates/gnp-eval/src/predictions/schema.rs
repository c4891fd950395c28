//! The one table of the columns of a prediction file: the writer, the reader and the documentation come from it.
//!
//! Columns that explain a step are made from the descriptors of the terms of the force. Those of the published terms
//! have plain names (`tau`, `k_preceding`); those of any other term carry its name.

use std::sync::Arc;

use gnp_data::{Dataset, SLOTS, Slot, TermForces, WindowKey};
use gnp_force::{Arity, ForceTerm, GoalAttraction, LineRepulsion, TermDescriptor, VehicleRepulsion};
use parquet::basic::{ConvertedType, Repetition, Type as PhysicalType};
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::schema::types::{Type, TypePtr};

use crate::predictions::shares::{Share, Shares};

/// The key of the metadata under which the name and version of the schema stand.
pub(super) const SCHEMA: &str = "schema";
/// The key of the metadata under which the descriptors of the terms stand, as JSON.
pub(super) const TERMS: &str = "terms";
/// The key under which a file says in which order the numbers of its modes stand.
pub(super) const MODE_ORDER: &str = "mode_order";
/// The first mode is the prediction, which need not be the likeliest; the others follow by falling probability.
pub(super) const PREDICTION_FIRST: &str = "prediction_first";
/// The column of the vehicle whose share stands in `leader_dx`.
pub(super) const LEADER: &str = "leader";

/// One column of a prediction file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColumnInfo {
    /// Name.
    pub name: String,
    /// Type: `text`, `whole number` or `number` (single precision).
    pub kind: &'static str,
    /// Unit; empty where there is none.
    pub unit: String,
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

/// One kind of file: what it is called, and the columns that every row has a value in.
pub(super) struct Layout {
    /// Name and version of the schema.
    pub(super) schema: &'static str,
    /// The frame of its positions, in words.
    pub(super) frame: &'static str,
    /// The columns, in the order of the file.
    pub(super) columns: &'static [Column],
    /// Whether the last column has a sentence on each forecast.
    pub(super) why: bool,
}

/// Files of predictions that are scored.
pub(super) static PREDICTIONS: Layout = Layout {
    schema: "gnp-predictions 1",
    frame: "x forward, y to the left, origin at the last observed centre of the box",
    columns: &COLUMNS,
    why: false,
};

/// The column of the sentence on a forecast.
pub(super) const WHY: &str = "why";

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Text,
    Whole,
    Number,
    Double,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Text => "text",
            Self::Whole => "whole number",
            Self::Number => "number",
            Self::Double => "double",
        }
    }
}

/// A column that every row has a value in.
pub(super) struct Column {
    pub(super) name: &'static str,
    /// Another name under which it is read.
    pub(super) also: Option<&'static str>,
    pub(super) kind: Kind,
    pub(super) unit: &'static str,
    pub(super) required: bool,
    /// Whether a reader wants it.
    pub(super) read: bool,
    pub(super) meaning: &'static str,
    /// What the writer puts there.
    pub(super) cell: fn(&Row<'_>) -> Cell,
}

/// One predicted step of one mode of one window, as it is written.
pub(super) struct Row<'a> {
    pub(super) scene: &'a ByteArray,
    pub(super) key: &'a WindowKey,
    /// Number of the mode, from 0.
    pub(super) mode: usize,
    pub(super) probability: f32,
    /// Predicted frame, from 1.
    pub(super) step: usize,
    pub(super) t_s: f32,
    pub(super) at: [f32; 2],
    pub(super) origin: [f32; 2],
    /// What else is known of the vehicle and the moment.
    pub(super) moment: &'a Moment,
    /// The place in the file's coordinates and that along and across the road, m.
    pub(super) places: [[f64; 2]; 2],
}

/// A vehicle at a moment, as a file of forecasts has it.
#[derive(Clone, Default)]
pub(super) struct Moment {
    pub(super) name: ByteArray,
    pub(super) model: ByteArray,
    pub(super) past: ByteArray,
    pub(super) observed_s: f32,
    pub(super) time_s: f64,
}

/// A value of a column.
pub(super) enum Cell {
    Text(ByteArray),
    Whole(u32),
    Number(f32),
    Double(f64),
}

impl Column {
    /// A column that a file to be scored must have.
    pub(super) const fn new(
        name: &'static str,
        kind: Kind,
        unit: &'static str,
        meaning: &'static str,
        cell: fn(&Row<'_>) -> Cell,
    ) -> Self {
        Self { name, also: None, kind, unit, required: true, read: true, meaning, cell }
    }
}

/// The columns that every row has a value in, in the order of the file.
pub(super) static COLUMNS: [Column; 12] = {
    /// A column that a foreign file may lack.
    const fn optional(column: Column) -> Column {
        Column { required: false, ..column }
    }
    use Kind::{Number, Text, Whole};
    let scene = Column::new("scene", Text, "", "name of the recording (`recording` is read as well)", |row| {
        Cell::Text(row.scene.clone())
    });
    let t_s = Column::new("t_s", Number, "s", "time after the last observed frame", |row| Cell::Number(row.t_s));
    let forward = "last observed centre in the road frame, forward";
    let left = "last observed centre in the road frame, to the left";
    let share = "of the mode, the same in all its rows; sums to 1 in a window";
    [
        Column { also: Some("recording"), ..scene },
        Column::new("vehicle", Whole, "", "vehicle of the recording", |row| Cell::Whole(row.key.vehicle)),
        optional(Column::new("segment", Whole, "", "gap-free stretch of that vehicle, from 0", |row| {
            Cell::Whole(u32::from(row.key.segment))
        })),
        Column::new("t0", Whole, "frame", "frame number of the last observed frame", |row| Cell::Whole(row.key.t0)),
        Column::new("mode", Whole, "", "number of the mode, any distinct numbers", |row| Cell::Whole(row.mode as u32)),
        Column::new("probability", Number, "", share, |row| Cell::Number(row.probability)),
        Column::new("step", Whole, "", "predicted frame, from 1", |row| Cell::Whole(row.step as u32)),
        Column { required: false, read: false, ..t_s },
        Column::new("x", Number, "m", "centre, forward from the last observed centre", |row| Cell::Number(row.at[0])),
        Column::new("y", Number, "m", "centre, to the left of the last observed centre", |row| Cell::Number(row.at[1])),
        optional(Column::new("origin_x", Number, "m", forward, |row| Cell::Number(row.origin[0]))),
        optional(Column::new("origin_y", Number, "m", left, |row| Cell::Number(row.origin[1]))),
    ]
};

/// A column that explains a step; null where there is nothing to explain, or where the term does not act.
pub(super) struct Explaining {
    pub(super) info: ColumnInfo,
    pub(super) part: Part,
}

/// The number of a step's explanation that stands in a column; terms are counted as in the list the columns are made
/// from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Goal { axis: usize },
    Total { term: usize, axis: usize },
    Source { term: usize, slot: usize, axis: usize },
    Parameter { term: usize, index: usize, slot: usize },
    Velocity { axis: usize },
    Share { share: Share, axis: usize },
}

impl Part {
    /// The term it belongs to, if it is that of a term.
    pub(super) fn term(self) -> Option<usize> {
        match self {
            Self::Goal { .. } | Self::Velocity { .. } | Self::Share { .. } => None,
            Self::Total { term, .. } | Self::Source { term, .. } | Self::Parameter { term, .. } => Some(term),
        }
    }

    /// Whether it belongs to what moved the vehicle by kind of cause.
    pub(super) fn is_share(self) -> bool {
        matches!(self, Self::Velocity { .. } | Self::Share { .. })
    }

    /// The number in a step.
    pub(super) fn value(self, explained: &ExplainedMode<'_>, step: usize) -> Option<f32> {
        let ExplainedMode { goal, terms, shares } = explained;
        let of = |term: usize| terms.get(term).copied().flatten().filter(|term| step < term.totals().len());
        match self {
            Self::Goal { axis } => Some(goal[axis]),
            Self::Velocity { axis } => Some(shares.velocity?[axis]),
            Self::Share { share, axis } => shares.displacement(share, step, axis),
            Self::Total { term, axis } => of(term).map(|term| term.total(step)[axis]),
            Self::Source { term, slot, axis } => {
                of(term).map(|term| term.forces(step).get(slot).map_or(0., |force| force[axis]))
            }
            Self::Parameter { term, index, slot } => {
                of(term).map(|term| term.parameter(index, step).get(slot).copied().unwrap_or(0.))
            }
        }
    }
}

/// What explains one mode, ready to be written.
pub(super) struct ExplainedMode<'a> {
    pub(super) goal: [f32; 2],
    /// As in the list that the columns are made from; none for a term that does not act.
    pub(super) terms: Vec<Option<&'a TermForces>>,
    pub(super) shares: Shares,
}

/// The terms whose columns every file has: those of the published force.
pub(super) fn published() -> Vec<Arc<TermDescriptor>> {
    let laws: [&dyn ForceTerm<f32>; 3] = [&GoalAttraction, &VehicleRepulsion, &LineRepulsion];
    laws.map(|law| Arc::new(law.descriptor().clone())).to_vec()
}

/// The columns that explain a step by these terms: the goal, the sum of each term, single sources, parameters, and what
/// moved the vehicle by kind of cause. Single lane lines differ in number from road to road and have no column.
pub(super) fn explaining(terms: &[Arc<TermDescriptor>]) -> Vec<Explaining> {
    let published = published();
    let mut columns = Vec::new();
    let mut add = |name: String, unit: &str, meaning: String, part| {
        let unit = unit.replace('²', "2").replace('⁴', "4");
        columns.push(Explaining { info: ColumnInfo { name, kind: "number", unit, required: false, meaning }, part });
    };
    let ways = [("x", "forward"), ("y", "to the left")];
    for (axis, (letter, way)) in ways.into_iter().enumerate() {
        let meaning = format!("goal of the mode, window frame, {way}");
        add(format!("goal_{letter}"), "m", meaning, Part::Goal { axis });
    }
    // Columns of another term start with its name, so that one called like a slot meets no other.
    let own = |of: &TermDescriptor| published.iter().all(|term| term.name != of.name);
    let prefix = |of: &TermDescriptor| if own(of) { format!("{}_", of.name) } else { String::new() };
    for (term, of) in terms.iter().enumerate() {
        let name = if own(of) { format!("{}_force", of.name) } else { format!("force_{}", of.name) };
        for (axis, (letter, way)) in ways.into_iter().enumerate() {
            let meaning = format!("{}, {way}", of.meaning);
            add(format!("{name}_{letter}"), &of.unit, meaning, Part::Total { term, axis });
        }
    }
    for (term, of) in terms.iter().enumerate().filter(|(_, of)| of.arity == Arity::PerNeighbour) {
        for slot in Slot::ALL {
            for (axis, (letter, way)) in ways.into_iter().enumerate() {
                let name = format!("{}force_{}_{letter}", prefix(of), slot_name(slot));
                let meaning = format!("{}: only that in slot {}, {way}", of.meaning, slot_name(slot));
                add(name, &of.unit, meaning, Part::Source { term, slot: slot as usize, axis });
            }
        }
    }
    for (term, of) in terms.iter().enumerate() {
        for (index, parameter) in of.varying().enumerate() {
            let name = format!("{}{}", prefix(of), parameter.name);
            match of.arity {
                Arity::One => {
                    let meaning = parameter.meaning.to_string();
                    add(name, &parameter.unit, meaning, Part::Parameter { term, index, slot: 0 });
                }
                Arity::PerNeighbour => {
                    for slot in Slot::ALL {
                        let meaning = format!(
                            "{} of the neighbour in slot {}; 0 in an empty slot",
                            parameter.meaning,
                            slot_name(slot)
                        );
                        let part = Part::Parameter { term, index, slot: slot as usize };
                        add(format!("{name}_{}", slot_name(slot)), &parameter.unit, meaning, part);
                    }
                }
                Arity::PerLine => {}
            }
        }
    }
    for (axis, (letter, way)) in ways.into_iter().enumerate() {
        let meaning = format!("velocity that the displacements by cause are counted from, {way}");
        add(format!("velocity_{letter}"), "m/s", meaning, Part::Velocity { axis });
    }
    for share in Share::ALL {
        for (axis, (letter, way)) in ways.into_iter().enumerate() {
            let meaning = format!("{}, {way}; null without such a cause", share.meaning());
            add(format!("{}_d{letter}", share.name()), "m", meaning, Part::Share { share, axis });
        }
    }
    columns
}

/// Sources of a term that have columns, and so come back from a file.
pub(super) fn sources_in_file(arity: Arity) -> usize {
    match arity {
        Arity::One => 1,
        Arity::PerNeighbour => SLOTS,
        Arity::PerLine => 0,
    }
}

/// The schema of a prediction file with the published terms of the force, in the order of its columns. Columns that are
/// not required may be missing or hold nulls; forces are accelerations. Another term adds columns of its own:
/// `NAME_force_x` and `_y`, by slot `NAME_force_SLOT_x`, and for its parameters `NAME_PARAMETER`. `velocity` times the
/// time and all `_dx` and `_dy` columns add up to `x` and `y`.
#[must_use]
pub fn prediction_columns() -> Vec<ColumnInfo> {
    all_columns(&PREDICTIONS, &published())
}

pub(super) fn all_columns(layout: &Layout, terms: &[Arc<TermDescriptor>]) -> Vec<ColumnInfo> {
    let always = layout.columns.iter().map(|column| ColumnInfo {
        name: column.name.to_owned(),
        kind: column.kind.name(),
        unit: column.unit.to_owned(),
        required: column.required,
        meaning: column.meaning.to_owned(),
    });
    let leader = ColumnInfo {
        name: LEADER.to_owned(),
        kind: Kind::Whole.name(),
        unit: String::new(),
        required: false,
        meaning: "vehicle of the recording that is nearest ahead in the lane; null without one".to_owned(),
    };
    let why = layout.why.then(|| ColumnInfo {
        name: WHY.to_owned(),
        kind: Kind::Text.name(),
        unit: String::new(),
        required: false,
        meaning: "a sentence on what moves the vehicle, in the last row of mode 0; null in all others".to_owned(),
    });
    always.chain(explaining(terms).into_iter().map(|column| column.info)).chain([leader]).chain(why).collect()
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
pub(super) fn parquet_schema(layout: &Layout, explaining: &[Explaining]) -> Result<TypePtr, ParquetError> {
    let field = |name: &str, kind: Kind, repetition: Repetition| {
        let builder = match kind {
            Kind::Text => {
                Type::primitive_type_builder(name, PhysicalType::BYTE_ARRAY).with_converted_type(ConvertedType::UTF8)
            }
            Kind::Whole => {
                Type::primitive_type_builder(name, PhysicalType::INT32).with_converted_type(ConvertedType::UINT_32)
            }
            Kind::Number => Type::primitive_type_builder(name, PhysicalType::FLOAT),
            Kind::Double => Type::primitive_type_builder(name, PhysicalType::DOUBLE),
        };
        Ok(Arc::new(builder.with_repetition(repetition).build()?))
    };
    let always = layout.columns.iter().map(|column| field(column.name, column.kind, Repetition::REQUIRED));
    let explaining = explaining.iter().map(|column| field(&column.info.name, Kind::Number, Repetition::OPTIONAL));
    let leader = field(LEADER, Kind::Whole, Repetition::OPTIONAL);
    let why = layout.why.then(|| field(WHY, Kind::Text, Repetition::OPTIONAL));
    let fields = always.chain(explaining).chain([leader]).chain(why).collect::<Result<Vec<_>, ParquetError>>()?;
    Ok(Arc::new(Type::group_type_builder("predictions").with_fields(fields).build()?))
}

impl Provenance {
    /// The file's key-value metadata: the provenance, the frame, the terms and the unit of every column.
    pub(super) fn key_values(&self, layout: &Layout, terms: &[Arc<TermDescriptor>]) -> Vec<KeyValue> {
        let units = all_columns(layout, terms).into_iter().filter(|column| !column.unit.is_empty());
        let units: Vec<String> = units.map(|column| format!("{} {}", column.name, column.unit)).collect();
        let described: Vec<&TermDescriptor> = terms.iter().map(AsRef::as_ref).collect();
        let pairs = [
            (SCHEMA, layout.schema.to_owned()),
            ("model", self.model.clone()),
            ("dataset", self.dataset.to_string()),
            ("rate_hz", self.rate_hz.to_string()),
            ("simulated", self.simulated.to_string()),
            ("uses_future", self.uses_future.to_string()),
            ("frame", layout.frame.to_owned()),
            ("units", units.join(", ")),
            (MODE_ORDER, PREDICTION_FIRST.to_owned()),
            (TERMS, serde_json::to_string(&described).unwrap_or_default()),
        ];
        pairs.into_iter().map(|(key, value)| KeyValue::new(key.to_owned(), value)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names that files had before there were descriptors, and that others read.
    #[test]
    fn the_published_terms_keep_their_columns() {
        let names: Vec<String> = explaining(&published()).into_iter().map(|column| column.info.name).collect();
        let slots = Slot::ALL.map(slot_name);
        let xy = |part: String| [format!("{part}_x"), format!("{part}_y")];
        let mut expected: Vec<String> = ["goal", "force_goal", "force_neighbours", "force_lines"]
            .into_iter()
            .flat_map(|part| xy(part.to_owned()))
            .collect();
        expected.extend(slots.into_iter().flat_map(|slot| xy(format!("force_{slot}"))));
        expected.push("tau".to_owned());
        expected.extend(slots.map(|slot| format!("k_{slot}")));
        expected.extend(xy("velocity".to_owned()));
        for cause in ["free_road", "leader", "column", "intention", "neighbours", "other"] {
            expected.extend([format!("{cause}_dx"), format!("{cause}_dy")]);
        }
        assert_eq!(names, expected);
    }

    #[test]
    fn lengths_and_times_have_units() {
        for column in prediction_columns() {
            let measured = ["x", "y", "t_s", "t0", "tau"].contains(&column.name.as_str()) || column.name.contains('_');
            assert_eq!(!column.unit.is_empty(), measured, "{}", column.name);
            assert!(column.unit.is_ascii(), "{}", column.unit);
        }
    }
}
