//! The module `gnp._gnp`, on which the Python package `gnp` is built: tables by Arrow, models, the streaming predictor,
//! the physics on arrays, the program. Users see python/gnp; here nothing is decided that can be decided there.

#![expect(clippy::result_large_err, reason = "the library's error, which it asks for")]

mod arrow;
mod column;
mod error;
mod evaluate;
mod explain;
mod force;
mod model;
mod online;
mod predict;
mod program;
mod remarks;
mod table;
mod tracks;
mod watch;

use pyo3::prelude::*;

/// The compiled part of gnp.
#[pymodule]
fn _gnp(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    error::register(module)?;
    module.add_class::<table::Columns>()?;
    module.add_class::<model::PyModel>()?;
    module.add_class::<online::PyStream>()?;
    module.add_class::<online::PyFrame>()?;
    module.add_function(wrap_pyfunction!(evaluate::score, module)?)?;
    module.add_function(wrap_pyfunction!(program::main, module)?)?;
    module.add("force", force::module(module.py())?)?;
    Ok(())
}
