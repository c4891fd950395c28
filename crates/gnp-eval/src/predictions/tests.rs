//! Round trips, foreign files and files that cannot be used.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gnp_data::{Cause, Contribution, Dataset, Explanation, Mode, TermForces};
use gnp_force::{Arity, TermDescriptor, TermParameter};
use parquet::basic::Type as PhysicalType;
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;

use super::*;
use crate::error::{EvalError, PredictionProblem};

fn key(recording: &str, vehicle: u32, t0: u32) -> WindowKey {
    WindowKey { recording: recording.to_owned(), vehicle, segment: 3, t0 }
}

fn provenance() -> Provenance {
    Provenance { model: "gnp".to_owned(), dataset: Dataset::HIGHD, rate_hz: 5., simulated: true, uses_future: false }
}

/// A mode of `steps` steps whose every number differs.
fn mode(probability: f32, steps: usize, start: f32, explained: bool) -> Mode {
    Mode {
        probability,
        path: (0..steps).map(|j| [start + j as f32 / 3., -start - j as f32]).collect(),
        explanation: explained.then(|| explanation(steps, start, &schema::published())),
    }
}

/// These terms with a sum that is not that of the sources, so that it must come from the file; lane lines as a file has
/// them.
fn explanation(steps: usize, start: f32, terms: &[Arc<TermDescriptor>]) -> Explanation {
    let term = |(i, term): (usize, &Arc<TermDescriptor>)| {
        let base = |j: usize| start + 100. * j as f32 + i as f32;
        let sources = schema::sources_in_file(term.arity);
        let entries = || (0..steps).flat_map(|j| (0..sources).map(move |slot| base(j) + 10. * slot as f32));
        let forces = entries().map(|value| [value, -value]).collect();
        let parameters = (0..term.varying().count()).map(|p| entries().map(|value| value + 0.1 * p as f32).collect());
        let totals = (0..steps).map(|j| if sources == 1 { [base(j), -base(j)] } else { [base(j), 0.5] }).collect();
        TermForces::new(Arc::clone(term), sources, forces, parameters.collect()).with_totals(totals)
    };
    Explanation {
        goal: [start, 2. * start],
        terms: terms.iter().enumerate().map(term).collect(),
        ..Explanation::default()
    }
}

fn samples(explained: bool) -> Vec<Prediction> {
    let forecast = |modes: Vec<Mode>| Forecast { modes };
    vec![
        Prediction {
            key: key("us101-2", 4_000_000_000, 17),
            origin: Some([812.25, -3.5]),
            forecast: forecast(vec![
                mode(0.6, 5, 1.5, explained),
                mode(0.3, 5, 2.5, explained),
                mode(0.1, 5, 3.5, false),
            ]),
        },
        Prediction {
            key: key("us101-1", 7, 30),
            origin: Some([1., 2.]),
            forecast: forecast(vec![mode(1., 5, -4.5, explained)]),
        },
    ]
}

fn write(path: &Path, predictions: &[Prediction]) {
    let mut writer = PredictionWriter::create(path, &provenance()).unwrap();
    for prediction in predictions {
        writer.write(&prediction.key, prediction.origin.unwrap(), &prediction.forecast).unwrap();
    }
    writer.finish().unwrap();
}

fn sorted(mut predictions: Vec<Prediction>) -> Vec<Prediction> {
    predictions.sort_by(|a, b| a.key.cmp(&b.key));
    predictions
}

#[test]
fn predictions_come_back_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    for explained in [true, false] {
        let written = sorted(samples(explained));
        write(&path, &written);
        let read = read_predictions(&path, Detail::Explanations).unwrap();
        assert_eq!(read.iter().cloned().collect::<Vec<_>>(), written);
        assert_eq!((read.len(), read.name()), (2, "gnp"));
        assert_eq!(read.provenance()["simulated"], "true");
        assert_eq!(read.provenance()["rate_hz"], "5");
        assert!(read.provenance()["units"].contains("x m,"));
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
}

/// A mode with what moved it; the vehicle is too large for a single-precision number.
fn accounted(contributions: Vec<Contribution>) -> Mode {
    let mut mode = mode(1., 5, 1.5, true);
    let explanation = mode.explanation.as_mut().unwrap();
    explanation.velocity = [11.5, -0.25];
    explanation.contributions = contributions;
    mode.path = explanation.path(0.2);
    mode
}

fn moved(cause: Cause, by: f32) -> Contribution {
    Contribution { cause, displacement: (1..=5).map(|step| [by * step as f32, -0.5 * by]).collect() }
}

#[test]
fn what_moved_a_vehicle_comes_back_by_kind_of_cause_and_still_adds_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    let leader = |vehicle, place| Cause::Leader { vehicle, place };
    let term = |name: &str| Cause::Term(name.to_owned());
    let neighbour = |vehicle| Cause::Neighbour { vehicle };
    let written = accounted(vec![
        moved(Cause::FreeRoad, 0.5),
        moved(leader(4_000_000_001, 1), -2.),
        moved(leader(35, 2), 0.25),
        moved(leader(36, 3), -0.75),
        moved(Cause::Intention, 1.5),
        moved(neighbour(7), 0.125),
        moved(neighbour(8), -0.5),
        moved(term("lines"), 0.25),
        moved(term("drag"), -1.),
    ]);
    let alone = accounted(vec![moved(Cause::FreeRoad, 0.5), moved(Cause::Intention, -0.5)]);
    let predictions = [(3, written.clone()), (5, alone.clone())].map(|(vehicle, mode)| Prediction {
        key: key("a", vehicle, 1),
        origin: Some([0., 0.]),
        forecast: Forecast { modes: vec![mode] },
    });
    write(&path, &predictions);
    let read = read_predictions(&path, Detail::Explanations).unwrap();
    let explained = |vehicle| read.get(&key("a", vehicle, 1)).unwrap().forecast.modes[0].explanation.clone().unwrap();
    let found = explained(3);
    let expected = [
        moved(Cause::FreeRoad, 0.5),
        moved(leader(4_000_000_001, 1), -2.),
        moved(Cause::FartherLeaders, -0.5),
        moved(Cause::Intention, 1.5),
        moved(Cause::Neighbours, -0.375),
        moved(term("other"), -0.75),
    ];
    assert_eq!((&found.contributions[..], found.velocity), (&expected[..], [11.5, -0.25]));
    for (a, b) in found.path(0.2).iter().zip(&written.path) {
        assert!((a[0] - b[0]).abs() < 1e-5 && (a[1] - b[1]).abs() < 1e-5, "{a:?} {b:?}");
    }
    assert_eq!(explained(5), alone.explanation.unwrap(), "no leader, no neighbour: nothing is made up");
    // Written once more, nothing changes.
    let again = folder.path().join("again.parquet");
    write(&again, &read.iter().cloned().collect::<Vec<_>>());
    assert_eq!(
        read_predictions(&again, Detail::Explanations).unwrap().iter().collect::<Vec<_>>(),
        read.iter().collect::<Vec<_>>()
    );
}

#[test]
fn the_prediction_stays_first_where_a_file_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    let mut written = samples(false);
    written[0].forecast.modes.swap(0, 2);
    write(&path, &written);
    let read = read_predictions(&path, Detail::Paths).unwrap();
    let probabilities = |read: &Predictions| -> Vec<f32> {
        read.iter().last().unwrap().forecast.modes.iter().map(|mode| mode.probability).collect()
    };
    assert_eq!(probabilities(&read), [0.1, 0.3, 0.6]);
    // A foreign file that numbers the likeliest last does not say so: see `a_foreign_file_is_read`.
    assert_eq!(read.provenance()["mode_order"], "prediction_first");
}

/// Terms that this crate does not know, one of one source and one of every slot.
fn made_up() -> Vec<Arc<TermDescriptor>> {
    let drag = TermDescriptor::new("drag", Arity::One, "#7a5195").means("drag", "drag of the air");
    let parameters = vec![TermParameter::varying("gap", "m", "gap"), TermParameter::constant("c", "1/s", "a constant")];
    let following = TermDescriptor::new("following", Arity::PerNeighbour, "#7a5195").with(parameters);
    vec![Arc::new(drag), Arc::new(following)]
}

#[test]
fn terms_of_ones_own_have_columns_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    let terms = [schema::published(), made_up()].concat();
    let mut written = sorted(samples(false));
    // The first mode of all explains nothing, so that rows were there before the columns were settled.
    written[1].forecast.modes[1].explanation = Some(explanation(5, 2.5, &terms));
    write(&path, &written);
    let read = read_predictions(&path, Detail::Explanations).unwrap();
    assert_eq!(read.iter().cloned().collect::<Vec<_>>(), written);
    let parquet = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
    let schema = parquet.metadata().file_metadata().schema_descr();
    let found: Vec<String> = schema.columns().iter().map(|column| column.path().string()).collect();
    for name in
        ["drag_force_x", "following_force_y", "following_force_preceding_x", "following_gap_right_following", "tau"]
    {
        assert!(found.iter().any(|column| column == name), "{name} in {found:?}");
    }
    assert!(read.provenance()["units"].contains("following_gap_preceding m,"));
}

/// A term that does not act has nulls, and does not come back.
#[test]
fn a_term_that_does_not_act_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    let mut written = sorted(samples(false));
    written[0].forecast.modes[0].explanation = Some(explanation(5, 1., &schema::published()[..1]));
    write(&path, &written);
    let read = read_predictions(&path, Detail::Explanations).unwrap();
    assert_eq!(read.iter().cloned().collect::<Vec<_>>(), written);
}

#[test]
fn a_term_that_comes_too_late_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = PredictionWriter::create(&folder.path().join("predictions.parquet"), &provenance()).unwrap();
    let forecast = |terms: &[Arc<TermDescriptor>]| Forecast {
        modes: vec![Mode { probability: 1., path: vec![[1., 2.]], explanation: Some(explanation(1, 1., terms)) }],
    };
    writer.write(&key("a", 1, 1), [0., 0.], &forecast(&schema::published())).unwrap();
    let error = writer.write(&key("a", 2, 1), [0., 0.], &forecast(&made_up())).unwrap_err();
    assert!(matches!(&error, EvalError::Term { term, .. } if term == "drag"), "{error}");
}

#[test]
fn paths_can_be_read_without_explanations() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    write(&path, &samples(true));
    let read = read_predictions(&path, Detail::Paths).unwrap();
    let forecast = &read.get(&key("us101-2", 4_000_000_000, 17)).unwrap().forecast;
    assert!(forecast.modes.iter().all(|mode| mode.explanation.is_none()));
    assert_eq!(forecast.modes[1].path, samples(true)[0].forecast.modes[1].path);
}

/// More rows than one row group holds: nothing is lost or doubled where groups meet.
#[test]
fn row_groups_join_without_a_seam() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    let many: Vec<Prediction> = (0..700)
        .map(|i| Prediction {
            key: key("r", i, 5 * i),
            origin: Some([0., i as f32]),
            forecast: Forecast { modes: vec![mode(0.75, 100, i as f32, false), mode(0.25, 100, 0.5, false)] },
        })
        .collect();
    write(&path, &many);
    let parquet = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
    assert_eq!(parquet.num_row_groups(), 3);
    let read = read_predictions(&path, Detail::Paths).unwrap();
    assert_eq!(read.iter().cloned().collect::<Vec<_>>(), many);
}

#[test]
fn the_file_has_the_published_columns() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    write(&path, &samples(true));
    let parquet = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
    let schema = parquet.metadata().file_metadata().schema_descr();
    let found: Vec<String> = schema.columns().iter().map(|column| column.path().string()).collect();
    let published: Vec<String> = prediction_columns().into_iter().map(|column| column.name).collect();
    assert_eq!(found, published);
}

#[test]
fn an_unfinished_file_never_appears() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    let mut writer = PredictionWriter::create(&path, &provenance()).unwrap();
    writer.write(&key("r", 1, 2), [0.; 2], &samples(false)[1].forecast).unwrap();
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let missing = PredictionWriter::create(&folder.path().join("none/predictions.parquet"), &provenance());
    assert!(matches!(missing.err(), Some(EvalError::Io { .. })));
}

/// Somebody else's file: other widths, other order of columns and rows, no metadata.
struct Foreign {
    message: String,
    scene: Vec<&'static str>,
    /// vehicle, t0, mode, step.
    whole: [Vec<i64>; 4],
    /// probability, x, y; `None` is a null.
    number: [Vec<Option<f64>>; 3],
}

impl Foreign {
    /// One window, two modes, two steps, rows backwards.
    fn new() -> Self {
        let columns = "REQUIRED DOUBLE y; OPTIONAL DOUBLE x;".to_owned();
        Self {
            message: format!(
                "message m {{ REQUIRED INT64 step; {columns} REQUIRED DOUBLE probability; REQUIRED INT64 mode;
                 REQUIRED INT64 t0; REQUIRED INT64 vehicle; REQUIRED BYTE_ARRAY recording (UTF8); }}"
            ),
            scene: vec!["a"; 4],
            whole: [vec![9; 4], vec![40; 4], vec![5, 5, 2, 2], vec![2, 1, 2, 1]],
            number: [
                [0.7, 0.7, 0.3, 0.3].map(Some).to_vec(),
                [4., 3., 2., 1.].map(Some).to_vec(),
                [-4., -3., -2., -1.].map(Some).to_vec(),
            ],
        }
    }

    fn write(&self, folder: &Path) -> PathBuf {
        let path = folder.join("foreign.parquet");
        let schema = Arc::new(parse_message_type(&self.message).unwrap());
        let file = File::create(&path).unwrap();
        let mut writer =
            SerializedFileWriter::new(file, schema.clone(), Arc::new(WriterProperties::builder().build())).unwrap();
        let mut group = writer.next_row_group().unwrap();
        for field in schema.get_fields() {
            let mut column = group.next_column().unwrap().unwrap();
            let index = |names: &[&str]| names.iter().position(|name| *name == field.name());
            let double = field.get_physical_type() == PhysicalType::DOUBLE;
            if let Some(i) = index(&["vehicle", "t0", "mode", "step"]).filter(|_| double) {
                let values: Vec<f64> = self.whole[i].iter().map(|value| *value as f64).collect();
                column.typed::<DoubleType>().write_batch(&values, None, None).unwrap();
            } else if let Some(i) = index(&["vehicle", "t0", "mode", "step"]) {
                column.typed::<Int64Type>().write_batch(&self.whole[i], None, None).unwrap();
            } else if let Some(i) = index(&["probability", "x", "y"]) {
                let values: Vec<f64> = self.number[i].iter().flatten().copied().collect();
                let levels: Vec<i16> = self.number[i].iter().map(|value| i16::from(value.is_some())).collect();
                column.typed::<DoubleType>().write_batch(&values, Some(&levels), None).unwrap();
            } else {
                let scenes: Vec<ByteArray> =
                    self.scene.iter().map(|s| ByteArray::from(s.as_bytes().to_vec())).collect();
                column.typed::<ByteArrayType>().write_batch(&scenes, None, None).unwrap();
            }
            column.close().unwrap();
        }
        group.close().unwrap();
        writer.close().unwrap();
        path
    }

    fn problem(&self) -> PredictionProblem {
        let folder = tempfile::tempdir().unwrap();
        match read_predictions(&self.write(folder.path()), Detail::Explanations) {
            Err(EvalError::Predictions { problem, path }) => {
                assert!(path.ends_with("foreign.parquet"));
                problem
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_foreign_file_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let read = read_predictions(&Foreign::new().write(folder.path()), Detail::Explanations).unwrap();
    assert_eq!(read.name(), "foreign");
    let expected = Prediction {
        key: WindowKey { recording: "a".to_owned(), vehicle: 9, segment: 0, t0: 40 },
        origin: None,
        forecast: Forecast {
            modes: vec![
                Mode { probability: 0.7, path: vec![[3., -3.], [4., -4.]], explanation: None },
                Mode { probability: 0.3, path: vec![[1., -1.], [2., -2.]], explanation: None },
            ],
        },
    };
    assert_eq!(read.iter().collect::<Vec<_>>(), [&expected]);
}

#[test]
fn cells_without_a_usable_value_are_named() {
    let cell = |row, column: &str, problem: &str| PredictionProblem::Cell {
        row,
        column: column.to_owned(),
        problem: problem.to_owned(),
    };
    let with = |change: fn(&mut Foreign)| {
        let mut foreign = Foreign::new();
        change(&mut foreign);
        foreign.problem()
    };
    assert_eq!(with(|f| f.number[1][2] = None), cell(2, "x", "is null"));
    assert_eq!(with(|f| f.number[2][1] = Some(f64::NAN)), cell(1, "y", "is NaN, not finite"));
    assert_eq!(with(|f| f.number[2][1] = Some(1e300)), cell(1, "y", "is inf, not finite"));
    // Positions on the road, or nonsense: not in the frame of a window.
    for far in [1e30, -12_000., 10_001.] {
        let mut foreign = Foreign::new();
        foreign.number[1][2] = Some(far);
        let message = foreign.problem().to_string();
        assert!(message.contains("row 2, column `x`") && message.contains("farther than 10000 m"), "{message}");
    }
    assert_eq!(with(|f| f.whole[0][3] = -1), cell(3, "vehicle", "is -1, needed is 0 to 4294967295"));
    assert_eq!(with(|f| f.whole[3][0] = 0), cell(0, "step", "is 0, needed is 1 to 99999"));
}

#[test]
fn rows_that_make_no_path_are_named() {
    let with = |change: fn(&mut Foreign)| {
        let mut foreign = Foreign::new();
        change(&mut foreign);
        foreign.problem().to_string()
    };
    let doubled = with(|f| f.whole[3][0] = 1);
    assert!(doubled.contains("vehicle 9, frame 40, mode 5, row 1: step 1 where 2 was due"), "{doubled}");
    let skipped = with(|f| f.whole[3][2] = 3);
    assert!(skipped.contains("mode 2, row 2: step 3 where 2 was due"), "{skipped}");
    let unequal = with(|f| f.number[0][0] = Some(0.6));
    assert!(unequal.contains("mode 5, row 0: probability 0.6, 0.7 in the mode's first row"), "{unequal}");
}

#[test]
fn columns_that_are_missing_or_of_another_type_are_named() {
    let with = |from: &str, to: &str| {
        let mut foreign = Foreign::new();
        foreign.message = foreign.message.replace(from, to);
        foreign.problem()
    };
    assert_eq!(with("REQUIRED INT64 mode;", ""), PredictionProblem::MissingColumn { column: "mode" });
    let number = with("REQUIRED INT64 t0", "REQUIRED DOUBLE t0");
    assert!(matches!(&number, PredictionProblem::ColumnType { column, .. } if column == "t0"), "{number}");
}

#[test]
fn what_is_no_prediction_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("predictions.parquet");
    assert!(matches!(read_predictions(&path, Detail::Paths), Err(EvalError::Io { .. })));
    std::fs::write(&path, "scene,vehicle\n").unwrap();
    assert!(matches!(read_predictions(&path, Detail::Paths), Err(EvalError::Parquet { .. })));
    write(&path, &samples(true));
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    assert!(matches!(read_predictions(&path, Detail::Paths), Err(EvalError::Parquet { .. })));
    write(&path, &[]);
    let empty = read_predictions(&path, Detail::Paths).unwrap_err();
    assert!(matches!(empty, EvalError::Predictions { problem: PredictionProblem::Empty, .. }), "{empty}");
}

#[test]
fn fewer_modes_than_the_file_has_are_renormalised() {
    let two = first_modes(&samples(false)[0].forecast, 2);
    let probabilities: Vec<f32> = two.modes.iter().map(|mode| mode.probability).collect();
    assert!((probabilities[0] - 2. / 3.).abs() < 1e-6 && (probabilities[1] - 1. / 3.).abs() < 1e-6);
    assert_eq!(first_modes(&two, 20), two);
}
