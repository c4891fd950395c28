//! Files of a recording for other programs.
mod fcd;
mod table;

pub use self::{fcd::write_fcd, table::write_parquet};
