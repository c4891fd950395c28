//! The module `gnp._gnp`, on which the Python package `gnp` is built: tables by Arrow, models, the streaming predictor,
//! the physics on arrays. Users see python/gnp; here nothing is decided that can be decided there.

mod arrow;
mod error;
mod force;
mod table;

use pyo3::prelude::*;

/// The compiled part of gnp.
#[pymodule]
fn _gnp(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    error::register(module)?;
    module.add_class::<table::Columns>()?;
    module.add("force", force::module(module.py())?)?;
    Ok(())
}
