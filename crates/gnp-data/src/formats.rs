//! The formats of this crate, one a file.

#[cfg(not(feature = "readers"))]
use std::path::Path;

#[cfg(not(feature = "readers"))]
use crate::error::DataError;
use crate::format::Format;

#[cfg(feature = "readers")]
mod argoverse;
#[cfg(feature = "readers")]
pub(crate) mod findings;
#[cfg(feature = "readers")]
mod highd;
#[cfg(feature = "readers")]
pub(crate) mod motion;
#[cfg(feature = "readers")]
mod ngsim;
#[cfg(feature = "readers")]
mod parquet_columns;
#[cfg(feature = "readers")]
mod periods;
#[cfg(feature = "readers")]
mod plain;
#[cfg(feature = "readers")]
mod sumo;
#[cfg(feature = "readers")]
mod table;
#[cfg(feature = "readers")]
mod words;

#[cfg(feature = "readers")]
pub(crate) use self::ngsim::COLUMNS as NGSIM_COLUMNS;
#[cfg(feature = "readers")]
pub(crate) use self::table::gzip::head;

/// Line of data row `row`, from 0, of a table of text with a header; the first line is 1.
#[cfg(feature = "readers")]
pub(crate) fn line_of(file: &std::path::Path, row: usize) -> Result<u64, crate::error::DataError> {
    self::table::line_of(file, row + 1)
}

/// All of them, in the order in which they are described.
#[cfg(feature = "readers")]
pub(crate) const ALL: &[&dyn Format] =
    &[&ngsim::Ngsim, &highd::HighD, &plain::Plain, &argoverse::Argoverse, &sumo::Sumo];

/// None: reading needs the feature `readers`.
#[cfg(not(feature = "readers"))]
pub(crate) const ALL: &[&dyn Format] = &[];

/// The first bytes of a file, packed or not, and whether they are all of it.
#[cfg(not(feature = "readers"))]
pub(crate) fn head(file: &Path) -> Result<(Vec<u8>, bool), DataError> {
    use std::io::Read as _;

    crate::discover::only_a_file(file)?;
    let io = |source| DataError::Io { file: file.into(), source };
    let mut head = Vec::new();
    let opened = std::fs::File::open(file).map_err(io)?;
    let read = opened.take(crate::foreign::HEAD as u64).read_to_end(&mut head).map_err(io)?;
    Ok((head, read < crate::foreign::HEAD))
}
