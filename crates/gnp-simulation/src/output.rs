//! Files of a recording for other programs.
mod table;

pub use self::table::write_parquet;
