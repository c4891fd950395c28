//! Reading prediction files, ours and anyone's.

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use gnp_data::{Contribution, Explanation, Forecast, Mode, TermForces, WindowKey};
use parquet::errors::ParquetError;
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::{FileReader, SerializedFileReader};

use crate::error::{EvalError, PredictionProblem};
use crate::predictions::forecasts::{SCHEMA as FORECASTS, WINDOW_FRAME};
use crate::predictions::schema::{MODE_ORDER, PREDICTION_FIRST, Part, SCHEMA, TERMS, sources_in_file};
use crate::predictions::shares::Share;
use crate::predictions::{Prediction, Predictions};

mod columns;

use columns::{Columns, Explained, GroupRows};

/// Longest path that is believed, steps: beyond it a step number is taken for a mistake.
const MAX_STEPS: i64 = 100_000;

/// Farthest position that is believed, m from the window's origin: nobody drives there within a window, and
/// positions on the road instead of in the window's frame are mostly farther.
pub const FARTHEST_M: f32 = 10_000.;

/// How much of a prediction file to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Paths and probabilities: all that scoring needs.
    Paths,
    /// Goals, forces and strengths as well, where the file has them.
    Explanations,
}

/// One row of the file. Explanations stand apart: most readers do without.
struct Row {
    scene: u32,
    vehicle: u32,
    t0: u32,
    mode: i64,
    step: u32,
    segment: u16,
    probability: f32,
    at: [f32; 2],
    origin: Option<[f32; 2]>,
    /// Index of the row's explanation.
    explanation: Option<u32>,
    /// The vehicle ahead.
    leader: Option<u32>,
    /// Row of the file, from 0.
    row: u64,
}

/// Reads a Parquet file of predictions; rows may come in any order. Modes are sorted likeliest
/// first, equally likely ones by their number; in a file whose metadata says `mode_order =
/// prediction_first`, as ours do, they keep the order of their numbers, because the prediction need
/// not be the likeliest. The model's name is the one in the file's metadata, or the file's own.
///
/// What moved a vehicle comes back by kind of cause, as the file has it: farther leaders together, neighbours together,
/// other terms together.
///
/// # Errors
/// When the file is not Parquet (uncompressed or snappy), a required column is missing or of another
/// type, a value is missing or no usable number, a position is farther than 10 km from its window's origin, a mode's steps are not 1, 2, 3, ... once each, its
/// rows differ in probability, or there is no row. Whether probabilities sum to 1 and paths have the
/// length of their windows shows when they are scored.
pub fn read_predictions(path: &Path, detail: Detail) -> Result<Predictions, EvalError> {
    let file = File::open(path).map_err(|source| EvalError::Io { path: path.into(), source })?;
    // parquet refuses most damaged files and panics at some.
    catch_unwind(AssertUnwindSafe(|| read(file, detail)))
        .unwrap_or_else(|_| Err(PredictionProblem::Damaged.into()))
        .map(|(provenance, predictions)| {
            let stem = || path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
            let name = provenance.get("model").cloned().unwrap_or_else(stem);
            Predictions { provenance, ..Predictions::new(&name, predictions) }
        })
        .map_err(|failure| match failure {
            Failure::Parquet(source) => EvalError::Parquet { path: path.into(), source },
            Failure::Problem(problem) => EvalError::Predictions { path: path.into(), problem },
        })
}

/// Why reading failed, before the file's name is known.
enum Failure {
    Parquet(ParquetError),
    Problem(PredictionProblem),
}

impl From<ParquetError> for Failure {
    fn from(source: ParquetError) -> Self {
        Self::Parquet(source)
    }
}

impl From<PredictionProblem> for Failure {
    fn from(problem: PredictionProblem) -> Self {
        Self::Problem(problem)
    }
}

type Provenance = BTreeMap<String, String>;

fn read(file: File, detail: Detail) -> Result<(Provenance, Vec<Prediction>), Failure> {
    let reader = SerializedFileReader::new(file)?;
    let metadata = reader.metadata().file_metadata();
    let key_values = metadata.key_value_metadata().into_iter().flatten();
    let provenance: Provenance = key_values.filter_map(|kv| Some((kv.key.clone(), kv.value.clone()?))).collect();
    let terms = provenance.get(TERMS).and_then(|text| serde_json::from_str(text).ok());
    let forecasts = provenance.get(SCHEMA).is_some_and(|schema| schema == FORECASTS);
    let positions = if forecasts { WINDOW_FRAME } else { ["x", "y"] };
    let columns = Columns::find(metadata.schema_descr(), positions, terms, detail)?;
    let sorted = provenance.get(MODE_ORDER).is_none_or(|order| order != PREDICTION_FIRST);
    let mut content = Content { by_probability: sorted, ..Content::default() };
    for group in 0..reader.num_row_groups() {
        check_places(reader.metadata().row_group(group))?;
        let rows = columns.read(reader.get_row_group(group)?.as_ref(), content.rows.len() as u64)?;
        content.add(rows)?;
    }
    Ok((provenance, content.predictions(&columns.explained)?))
}

/// Refuses a group whose columns begin before the file or have a negative length: parquet panics at one.
fn check_places(group: &RowGroupMetaData) -> Result<(), ParquetError> {
    let bad = group.columns().iter().find(|column| {
        let start = column.dictionary_page_offset().unwrap_or(column.data_page_offset());
        start < 0 || column.compressed_size() < 0
    });
    match bad {
        Some(column) => {
            Err(ParquetError::General(format!("column {} has no place in the file", column.column_path().string())))
        }
        None => Ok(()),
    }
}

/// All rows of a file.
#[derive(Default)]
struct Content {
    /// Whether the numbers of modes mean nothing.
    by_probability: bool,
    scenes: Vec<String>,
    index: BTreeMap<String, u32>,
    rows: Vec<Row>,
    /// The explaining numbers of each row that has some.
    explanations: Vec<f32>,
    explained: u32,
}

impl Content {
    fn add(&mut self, group: GroupRows) -> Result<(), PredictionProblem> {
        for i in 0..group.len() {
            let scene = self.scene(group.scene(i)?);
            let explanation = group.explanation(i, &mut self.explanations).then(|| {
                self.explained += 1;
                self.explained - 1
            });
            self.rows.push(Row {
                scene,
                vehicle: group.whole(i, "vehicle", 0..1 << 32)? as u32,
                t0: group.whole(i, "t0", 0..1 << 32)? as u32,
                mode: group.whole(i, "mode", i64::MIN..i64::MAX)?,
                step: group.whole(i, "step", 1..MAX_STEPS)? as u32,
                segment: group.segment(i)?,
                probability: group.probability(i)?,
                at: [group.position(i, "x")?, group.position(i, "y")?],
                origin: group.origin(i),
                explanation,
                leader: group.leader(i),
                row: group.row(i),
            });
        }
        Ok(())
    }

    fn scene(&mut self, name: &str) -> u32 {
        // Rows of one scene mostly follow one another.
        if let Some(last) = self.rows.last().filter(|row| self.scenes[row.scene as usize] == name) {
            return last.scene;
        }
        if let Some(scene) = self.index.get(name) {
            return *scene;
        }
        let scene = self.scenes.len() as u32;
        self.scenes.push(name.to_owned());
        self.index.insert(name.to_owned(), scene);
        scene
    }

    fn predictions(mut self, explained: &Explained) -> Result<Vec<Prediction>, PredictionProblem> {
        if self.rows.is_empty() {
            return Err(PredictionProblem::Empty);
        }
        self.rows.sort_unstable_by_key(|row| (row.scene, row.vehicle, row.t0, row.mode, row.step, row.row));
        let windows = self.rows.chunk_by(|a, b| (a.scene, a.vehicle, a.t0) == (b.scene, b.vehicle, b.t0));
        windows.map(|rows| self.prediction(rows, explained)).collect()
    }

    /// The prediction made of the rows of one window, sorted by mode and step.
    fn prediction(&self, rows: &[Row], explained: &Explained) -> Result<Prediction, PredictionProblem> {
        let first = &rows[0];
        let key = WindowKey {
            recording: self.scenes[first.scene as usize].clone(),
            vehicle: first.vehicle,
            segment: first.segment,
            t0: first.t0,
        };
        let modes = rows.chunk_by(|a, b| a.mode == b.mode).map(|rows| self.mode(&key, rows, explained));
        let mut modes = modes.collect::<Result<Vec<_>, _>>()?;
        if self.by_probability {
            modes.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        }
        Ok(Prediction { key, origin: first.origin, forecast: Forecast { modes } })
    }

    /// The mode made of its rows, sorted by step.
    fn mode(&self, window: &WindowKey, rows: &[Row], explained: &Explained) -> Result<Mode, PredictionProblem> {
        let fail = |row: &Row, problem| PredictionProblem::Rows {
            window: window.clone(),
            mode: row.mode,
            row: row.row,
            problem,
        };
        let probability = rows[0].probability;
        for (row, expected) in rows.iter().zip(1..) {
            if row.step != expected {
                let problem = format!("step {} where {expected} was due; each step from 1 stands once", row.step);
                return Err(fail(row, problem));
            }
            if row.probability != probability {
                let problem = format!("probability {}, {probability} in the mode's first row", row.probability);
                return Err(fail(row, problem));
            }
        }
        let path = rows.iter().map(|row| row.at).collect();
        Ok(Mode { probability, path, explanation: self.explanation(rows, explained) })
    }

    /// What explains a mode, if every row of it is explained: the terms that have a number in every row.
    fn explanation(&self, rows: &[Row], explained: &Explained) -> Option<Explanation> {
        let width = explained.columns.len();
        let row = |row: &Row| {
            let at = row.explanation? as usize * width;
            self.explanations.get(at..at + width)
        };
        let steps = rows.iter().map(row).collect::<Option<Vec<_>>>().filter(|_| width > 0)?;
        let parts: Vec<Part> = explained.columns.iter().map(|column| column.part).collect();
        // The numbers of a part over the steps; the columns of a term follow its sources and axes in order.
        let of = |wanted: &dyn Fn(Part) -> bool| -> Vec<f32> {
            let columns: Vec<usize> = (0..width).filter(|i| wanted(parts[*i])).collect();
            steps.iter().flat_map(|values| columns.iter().map(|i| values[*i])).collect()
        };
        let pairs = |values: Vec<f32>| -> Vec<[f32; 2]> { values.chunks_exact(2).map(|p| [p[0], p[1]]).collect() };
        let mut terms = Vec::new();
        for (term, descriptor) in explained.terms.iter().enumerate() {
            if of(&|part| part.term() == Some(term)).iter().any(|value| value.is_nan()) {
                continue;
            }
            let totals = pairs(of(&|part| matches!(part, Part::Total { term: t, .. } if t == term)));
            let sources = sources_in_file(descriptor.arity);
            let forces = match sources {
                1 => totals.clone(),
                _ => pairs(of(&|part| matches!(part, Part::Source { term: t, .. } if t == term))),
            };
            let parameter = |i: usize| {
                of(&|part| matches!(part, Part::Parameter { term: t, index, .. } if t == term && index == i))
            };
            let parameters = (0..descriptor.varying().count()).map(parameter).collect();
            terms.push(TermForces::new(Arc::clone(descriptor), sources, forces, parameters).with_totals(totals));
        }
        // What moved the vehicle, by kind; a kind that has a null in a row is not there.
        let share = |share: Share| {
            let values = of(&|part| matches!(part, Part::Share { share: s, .. } if s == share));
            let there = !values.is_empty() && values.iter().all(|value| !value.is_nan());
            there.then(|| Contribution { cause: share.cause(rows[0].leader), displacement: pairs(values) })
        };
        let contributions: Vec<_> = Share::ALL.into_iter().filter_map(share).collect();
        let first = |values: Vec<f32>| pairs(values).first().copied().unwrap_or_default();
        let goal = first(of(&|part| matches!(part, Part::Goal { .. })));
        let velocity = first(of(&|part| matches!(part, Part::Velocity { .. })));
        let velocity = if contributions.is_empty() { [0.; 2] } else { velocity };
        (!terms.is_empty()).then_some(Explanation { goal, terms, velocity, contributions })
    }
}

/// Whether a whole number lies in a range, and what to say if not.
fn within(value: i64, range: &Range<i64>) -> Result<i64, String> {
    if range.contains(&value) {
        return Ok(value);
    }
    Err(format!("is {value}, needed is {} to {}", range.start, range.end - 1))
}
