//! Rows in temporary files, one for each stretch of time.

use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::row::{self, Row};
use crate::error::DataError;

/// Bytes that are kept in memory before they are written.
const KEPT: usize = 32 << 20;

/// Rows by stretch, in files that are gone when this is dropped.
pub(super) struct Spool {
    folder: TempDir,
    /// Rows of each stretch that are not in its file yet.
    pending: Vec<Vec<u8>>,
    bytes: usize,
}

impl Spool {
    pub(super) fn new(stretches: usize, folder: Option<&Path>) -> Result<Self, DataError> {
        let mut builder = tempfile::Builder::new();
        let builder = builder.prefix(".gnp-spool-");
        let made = folder.map_or_else(|| builder.tempdir(), |folder| builder.tempdir_in(folder));
        let place = || folder.map_or_else(std::env::temp_dir, PathBuf::from);
        let folder = made.map_err(|source| DataError::Io { file: place(), source })?;
        Ok(Self { folder, pending: vec![Vec::new(); stretches], bytes: 0 })
    }

    pub(super) fn add(&mut self, stretch: usize, row: &Row) -> Result<(), DataError> {
        row.write(&mut self.pending[stretch]);
        self.bytes += Row::BYTES;
        if self.bytes < KEPT {
            return Ok(());
        }
        for stretch in 0..self.pending.len() {
            let bytes = std::mem::take(&mut self.pending[stretch]);
            if !bytes.is_empty() {
                let place = self.place(stretch);
                // Opened anew each time: there may be more stretches than files that may be open.
                let append = || OpenOptions::new().create(true).append(true).open(&place)?.write_all(&bytes);
                append().map_err(|source| DataError::Io { file: place.clone(), source })?;
            }
        }
        self.bytes = 0;
        Ok(())
    }

    /// The rows of a stretch, in the order in which they were added; they are gone then.
    pub(super) fn take(&mut self, stretch: usize) -> Result<Vec<Row>, DataError> {
        let place = self.place(stretch);
        let mut bytes = Vec::new();
        let read = match File::open(&place) {
            Ok(mut file) => io::Read::read_to_end(&mut file, &mut bytes).map(drop),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            Err(error) => Err(error),
        };
        read.map_err(|source| DataError::Io { file: place.clone(), source })?;
        bytes.append(&mut self.pending[stretch]);
        // What cannot be removed now is with the folder.
        let _ = std::fs::remove_file(&place);
        row::rows(&bytes, &place)
    }

    fn place(&self, stretch: usize) -> PathBuf {
        self.folder.path().join(stretch.to_string())
    }
}
