//! The physics of gnp-force on arrays: `gnp.force` broadcasts, this computes.

use gnp_force::na::{Point2, Vector2};
use gnp_force::{
    Driver, Extent, Follower, MarkingKind, Platoon, Side, box_force, following_acceleration, free_acceleration,
    goal_force, interaction, line_force, terms, vehicle_force,
};
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::ForceError;

type Array = PyBuffer<f64>;

/// Applies a law to rows of numbers: `inputs` are arrays of equal length, `output` has `width` numbers a row.
fn each<const N: usize, const M: usize>(
    py: Python<'_>,
    inputs: [&Array; N],
    output: &Array,
    law: impl Fn([f64; N]) -> [f64; M] + Send + Sync,
) -> PyResult<()> {
    let mut columns = Vec::with_capacity(N);
    for input in inputs {
        columns.push(input.to_vec(py)?);
    }
    let rows = columns.iter().map(Vec::len).min().unwrap_or_default();
    if columns.iter().any(|column| column.len() != rows) || output.item_count() != M * rows {
        return Err(PyValueError::new_err("arrays of different lengths"));
    }
    let results = py.detach(|| {
        let row = |row: usize| law(std::array::from_fn(|column| columns[column][row]));
        (0..rows).flat_map(row).collect::<Vec<f64>>()
    });
    output.copy_from_slice(py, &results)
}

/// Attraction by a goal; `out` is `[rows, 2]`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "an argument is a column")]
fn goal(
    py: Python<'_>,
    x: Array,
    y: Array,
    vx: Array,
    vy: Array,
    gx: Array,
    gy: Array,
    time: Array,
    tau: Array,
    out: Array,
) -> PyResult<()> {
    each(py, [&x, &y, &vx, &vy, &gx, &gy, &time, &tau], &out, |[x, y, vx, vy, gx, gy, time, tau]| {
        goal_force(Point2::new(x, y), Vector2::new(vx, vy), Point2::new(gx, gy), time, tau).into()
    })
}

/// Push away from a neighbour, both points; `out` is `[rows, 2]`.
#[pyfunction]
fn vehicle(py: Python<'_>, rx: Array, ry: Array, k: Array, r_col: Array, out: Array) -> PyResult<()> {
    each(py, [&rx, &ry, &k, &r_col], &out, |[rx, ry, k, r_col]| vehicle_force(Vector2::new(rx, ry), k, r_col).into())
}

/// Push away from a neighbour, both boxes; `out` is `[rows, 2]`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "an argument is a column")]
fn boxes(
    py: Python<'_>,
    rx: Array,
    ry: Array,
    length: Array,
    width: Array,
    other_length: Array,
    other_width: Array,
    k: Array,
    r_col: Array,
    out: Array,
) -> PyResult<()> {
    let inputs = [&rx, &ry, &length, &width, &other_length, &other_width, &k, &r_col];
    each(py, inputs, &out, |[rx, ry, length, width, other_length, other_width, k, r_col]| {
        let (own, other) = (Extent { length, width }, Extent { length: other_length, width: other_width });
        box_force(Vector2::new(rx, ry), own, other, k, r_col).into()
    })
}

/// Lateral push of a line of `kind` with the road on `road`'s side; `out` is `[rows]`.
#[pyfunction]
fn line(py: Python<'_>, kind: &str, road: &str, distance: Array, k: Array, out: Array) -> PyResult<()> {
    let kind = match kind {
        "boundary" => MarkingKind::Boundary,
        "divider" => MarkingKind::LaneDivider,
        other => return Err(PyValueError::new_err(format!("kind is '{other}', but must be 'boundary' or 'divider'"))),
    };
    let road = match road {
        "left" => Side::Left,
        "right" => Side::Right,
        other => return Err(PyValueError::new_err(format!("road is '{other}', but must be 'left' or 'right'"))),
    };
    each(py, [&distance, &k], &out, |[distance, k]| [line_force(kind, distance, k, road)])
}

/// Which part of car following.
#[derive(Clone, Copy)]
enum Part {
    Free,
    Interaction,
    Both,
}

/// A part of car following, `free`, `interaction` or `both`; `out` is `[rows]`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "an argument is a column")]
fn following(
    py: Python<'_>,
    part: &str,
    distance: Array,
    body: Array,
    speed: Array,
    leader_speed: Array,
    desired_speed: Array,
    time_gap: Array,
    standstill_gap: Array,
    acceleration: Array,
    braking: Array,
    out: Array,
) -> PyResult<()> {
    let part = match part {
        "free" => Part::Free,
        "interaction" => Part::Interaction,
        _ => Part::Both,
    };
    let inputs =
        [&distance, &body, &speed, &leader_speed, &desired_speed, &time_gap, &standstill_gap, &acceleration, &braking];
    each(
        py,
        inputs,
        &out,
        |[distance, body, speed, leader, desired_speed, time_gap, standstill_gap, acceleration, braking]| {
            let driver = Driver { desired_speed, time_gap, standstill_gap, acceleration, braking };
            [match part {
                Part::Free => free_acceleration(speed, &driver),
                Part::Interaction => interaction(distance, body, speed, leader, &driver),
                Part::Both => following_acceleration(distance, body, speed, leader, &driver),
            }]
        },
    )
}

/// Gap at which a driver keeps a speed behind a vehicle of that speed, NaN where there is none; `out` is `[rows]`.
#[pyfunction]
fn equilibrium_gap(
    py: Python<'_>,
    speed: Array,
    desired_speed: Array,
    time_gap: Array,
    standstill_gap: Array,
    out: Array,
) -> PyResult<()> {
    each(
        py,
        [&speed, &desired_speed, &time_gap, &standstill_gap],
        &out,
        |[speed, desired_speed, time_gap, standstill_gap]| {
            let driver = Driver { desired_speed, time_gap, standstill_gap, ..Driver::motorway() };
            [driver.equilibrium_gap(speed).unwrap_or(f64::NAN)]
        },
    )
}

/// Vehicles in a row, of which `leaders` says who follows whom (-1: nobody), for `steps` steps of `dt` s. Each of `outs` is
/// `[vehicles, steps]`: position, speed, and the parts of the acceleration by road, leader and habit.
#[pyfunction]
fn platoon(
    py: Python<'_>,
    columns: [Array; 9],
    leaders: Vec<i64>,
    dt: f64,
    steps: usize,
    decay: f64,
    outs: [Array; 5],
) -> PyResult<()> {
    let mut values = Vec::with_capacity(columns.len());
    for column in &columns {
        values.push(column.to_vec(py)?);
    }
    if values.iter().any(|column| column.len() != leaders.len()) {
        return Err(PyValueError::new_err("arrays of different lengths"));
    }
    let follower = |vehicle: usize| {
        let [position, speed, length, habit, desired_speed, time_gap, standstill_gap, acceleration, braking] =
            std::array::from_fn(|column| values[column][vehicle]);
        Follower {
            position,
            speed,
            length,
            // A number beyond every vehicle is refused with the others that name none.
            leader: (leaders[vehicle] != -1).then(|| usize::try_from(leaders[vehicle]).unwrap_or(usize::MAX)),
            driver: Driver { desired_speed, time_gap, standstill_gap, acceleration, braking },
            habit,
        }
    };
    let followers: Vec<Follower<f64>> = (0..leaders.len()).map(follower).collect();
    let rolled = py.detach(|| Platoon::roll_out(&followers, dt, steps, decay));
    let rolled = rolled.map_err(|error| ForceError::new_err(error.to_string()))?;
    let results = [rolled.positions(), rolled.speeds(), rolled.free(), rolled.interaction(), rolled.habit()];
    results.iter().zip(&outs).try_for_each(|(result, out)| out.copy_from_slice(py, result))
}

/// The terms of the force, as those who show them need to know: name, label, meaning, unit, colour, parameters.
#[pyfunction]
fn describe(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let describe = |term: &&dyn gnp_force::ForceTerm<f64>| {
        let descriptor = term.descriptor();
        let about = PyDict::new(py);
        about.set_item("name", &descriptor.name)?;
        about.set_item("label", &descriptor.label)?;
        about.set_item("meaning", &descriptor.meaning)?;
        about.set_item("unit", &descriptor.unit)?;
        about.set_item("colour", &descriptor.colour)?;
        let parameters = PyDict::new(py);
        for parameter in descriptor.parameters.iter() {
            parameters.set_item(&parameter.name, (&parameter.meaning, &parameter.unit))?;
        }
        about.set_item("parameters", parameters)?;
        Ok(about)
    };
    terms::<f64>().iter().map(describe).collect()
}

/// The module `gnp._gnp.force`.
pub(crate) fn module(py: Python<'_>) -> PyResult<Bound<'_, PyModule>> {
    let module = PyModule::new(py, "force")?;
    module.add_function(wrap_pyfunction!(goal, &module)?)?;
    module.add_function(wrap_pyfunction!(vehicle, &module)?)?;
    module.add_function(wrap_pyfunction!(boxes, &module)?)?;
    module.add_function(wrap_pyfunction!(line, &module)?)?;
    module.add_function(wrap_pyfunction!(following, &module)?)?;
    module.add_function(wrap_pyfunction!(equilibrium_gap, &module)?)?;
    module.add_function(wrap_pyfunction!(platoon, &module)?)?;
    module.add_function(wrap_pyfunction!(describe, &module)?)?;
    Ok(module)
}
