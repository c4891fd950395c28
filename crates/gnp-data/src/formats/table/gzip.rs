//! Text of a file, plain or gzip, in blocks of whole lines.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use crate::error::DataError;

/// Text parsed at a time: large enough to keep all cores busy, small enough that memory does not
/// grow with the file.
const BLOCK: usize = 32 << 20;

/// The bytes of a file, decompressed where its first two bytes say gzip.
pub(in crate::formats) struct Text {
    file: PathBuf,
    inner: Box<dyn Read + Send>,
    gzip: bool,
}

impl Text {
    pub(in crate::formats) fn open(file: &Path) -> Result<Self, DataError> {
        let io = |source| DataError::Io { file: file.into(), source };
        let mut magic = Vec::with_capacity(2);
        File::open(file).and_then(|plain| plain.take(2).read_to_end(&mut magic)).map_err(io)?;
        let gzip = magic == [0x1f, 0x8b];
        let plain = File::open(file).map_err(io)?;
        let inner: Box<dyn Read + Send> = if gzip {
            Box::new(flate2::bufread::MultiGzDecoder::new(BufReader::with_capacity(1 << 18, plain)))
        } else {
            Box::new(plain)
        };
        Ok(Self { file: file.into(), inner, gzip })
    }

    /// Appends up to `bytes` bytes to `buffer`; fewer only at the end of the text.
    pub(in crate::formats) fn fill(&mut self, buffer: &mut Vec<u8>, bytes: usize) -> Result<usize, DataError> {
        match (&mut self.inner).take(bytes as u64).read_to_end(buffer) {
            Ok(read) => Ok(read),
            Err(e) if self.gzip => Err(DataError::Gzip { file: self.file.clone(), reason: e.to_string() }),
            Err(source) => Err(DataError::Io { file: self.file.clone(), source }),
        }
    }
}

/// Whole lines of a text.
pub(in crate::formats) struct Block {
    /// Lines, each ended by a newline but perhaps the last of the file.
    pub(in crate::formats) bytes: Vec<u8>,
    /// Number of the first line, the first of the file being 1.
    pub(in crate::formats) line: u64,
}

/// The blocks of a text, in order.
pub(in crate::formats) struct Blocks {
    text: Text,
    /// Start of a line whose end is not read yet.
    carry: Vec<u8>,
    line: u64,
    ended: bool,
}

impl Blocks {
    pub(in crate::formats) fn open(file: &Path) -> Result<Self, DataError> {
        Ok(Self { text: Text::open(file)?, carry: Vec::new(), line: 1, ended: false })
    }

    pub(in crate::formats) fn next(&mut self) -> Result<Option<Block>, DataError> {
        if self.ended {
            return Ok(None);
        }
        let mut bytes = Vec::with_capacity(BLOCK + self.carry.len());
        bytes.append(&mut self.carry);
        loop {
            self.ended = self.text.fill(&mut bytes, BLOCK)? < BLOCK;
            if self.ended {
                break;
            }
            // Without a newline in it the line is longer than a block: read on.
            if let Some(end) = bytes.iter().rposition(|b| *b == b'\n') {
                self.carry.extend_from_slice(&bytes[end + 1..]);
                bytes.truncate(end + 1);
                break;
            }
        }
        let line = self.line;
        self.line += bytes.iter().filter(|b| **b == b'\n').count() as u64;
        Ok((!bytes.is_empty()).then_some(Block { bytes, line }))
    }
}
