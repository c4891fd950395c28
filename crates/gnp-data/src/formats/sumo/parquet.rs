//! Floating car data as Parquet.
use std::path::Path;

use super::vehicle::{Other, Vehicle};
use crate::error::DataError;

pub(super) struct Layout;

pub(super) fn recognise(_file: &Path) -> Result<Option<Layout>, DataError> {
    Ok(None)
}

pub(super) fn vehicles(
    _file: &Path,
    _layout: &Layout,
    _other: &mut Other,
    _take: &mut dyn FnMut(&Vehicle<'_>) -> Result<bool, DataError>,
) -> Result<(), DataError> {
    Ok(())
}
