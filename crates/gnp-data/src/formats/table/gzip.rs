//! Text of a file, plain or gzip, in blocks of whole lines.

use std::fs::File;
use std::io::{BufReader, Read, Seek as _};
use std::path::{Path, PathBuf};

use flate2::bufread::MultiGzDecoder;

use crate::discover::only_a_file;
use crate::error::DataError;
use crate::foreign::HEAD;

/// Text parsed at a time: large enough to keep all cores busy, small enough that memory does not
/// grow with the file.
const BLOCK: usize = 32 << 20;

/// Longest line, bytes. A row takes some hundred; highD's markings of a carriageway a little more.
const MAX_LINE: usize = 1 << 16;

/// Most bytes of text that a byte of gzip may stand for, once [`FREE`] have come. Recordings reach 20; the same
/// row again and again reaches 250 and more, one byte 1000.
const MAX_RATIO: u64 = 100;

/// Bytes of text that are not compared with what they were packed in.
const FREE: u64 = 16 << 20;

/// The bytes of a file, decompressed where its first two bytes say gzip.
pub(in crate::formats) struct Text {
    file: PathBuf,
    inner: Inner,
    /// Bytes of text so far.
    read: u64,
}

enum Inner {
    Plain(File),
    Gzip(Box<MultiGzDecoder<BufReader<File>>>),
}

impl Text {
    pub(in crate::formats) fn open(file: &Path) -> Result<Self, DataError> {
        only_a_file(file)?;
        let io = |source| DataError::Io { file: file.into(), source };
        let mut magic = Vec::with_capacity(2);
        File::open(file).and_then(|plain| plain.take(2).read_to_end(&mut magic)).map_err(io)?;
        let plain = File::open(file).map_err(io)?;
        let inner = if magic == [0x1f, 0x8b] {
            Inner::Gzip(Box::new(MultiGzDecoder::new(BufReader::with_capacity(1 << 18, plain))))
        } else {
            Inner::Plain(plain)
        };
        Ok(Self { file: file.into(), inner, read: 0 })
    }

    /// Appends up to `bytes` bytes to `buffer`; fewer only at the end of the text.
    fn fill(&mut self, buffer: &mut Vec<u8>, bytes: usize) -> Result<usize, DataError> {
        let io = |source| DataError::Io { file: self.file.clone(), source };
        let read = match &mut self.inner {
            Inner::Plain(file) => file.take(bytes as u64).read_to_end(buffer).map_err(io)?,
            Inner::Gzip(decoder) => decoder
                .take(bytes as u64)
                .read_to_end(buffer)
                .map_err(|e| DataError::Gzip { file: self.file.clone(), reason: e.to_string() })?,
        };
        self.count(read)?;
        Ok(read)
    }

    /// Reads into `buffer`; 0 bytes at the end of the text.
    pub(in crate::formats) fn read(&mut self, buffer: &mut [u8]) -> Result<usize, DataError> {
        let io = |source| DataError::Io { file: self.file.clone(), source };
        let read = loop {
            let read = match &mut self.inner {
                Inner::Plain(file) => file.read(buffer),
                Inner::Gzip(decoder) => decoder.read(buffer),
            };
            match (read, &self.inner) {
                (Err(error), _) if error.kind() == std::io::ErrorKind::Interrupted => {}
                (Err(error), Inner::Plain(_)) => return Err(io(error)),
                (Err(error), Inner::Gzip(_)) => {
                    return Err(DataError::Gzip { file: self.file.clone(), reason: error.to_string() });
                }
                (Ok(read), _) => break read,
            }
        };
        self.count(read)?;
        Ok(read)
    }

    /// Counts bytes of text; refuses more of them than a recording could be packed to.
    fn count(&mut self, read: usize) -> Result<(), DataError> {
        self.read += read as u64;
        if let Inner::Gzip(decoder) = &self.inner
            && self.read > FREE
        {
            // Of what is read ahead of the decoder, 256 kB, nothing has been decompressed yet: that errs on the safe side.
            let packed = decoder.get_ref().get_ref().stream_position();
            let packed = packed.map_err(|source| DataError::Io { file: self.file.clone(), source })?;
            if self.read / MAX_RATIO > packed {
                return Err(DataError::Inflated { file: self.file.clone(), limit: MAX_RATIO });
            }
        }
        Ok(())
    }
}

/// The first bytes of a file, packed or not, and whether they are all of it.
pub(crate) fn head(file: &Path) -> Result<(Vec<u8>, bool), DataError> {
    let mut head = Vec::new();
    let read = Text::open(file)?.fill(&mut head, HEAD)?;
    Ok((head, read < HEAD))
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
        let before = bytes.len();
        self.ended = self.text.fill(&mut bytes, BLOCK)? < BLOCK;
        self.check(&bytes, before)?;
        if !self.ended
            && let Some(end) = bytes.iter().rposition(|b| *b == b'\n')
        {
            self.carry.extend_from_slice(&bytes[end + 1..]);
            bytes.truncate(end + 1);
        }
        let line = self.line;
        self.line += newlines(&bytes);
        Ok((!bytes.is_empty()).then_some(Block { bytes, line }))
    }

    /// Refuses what is no text in lines; the first `before` bytes were looked at with the block before.
    fn check(&self, bytes: &[u8], before: usize) -> Result<(), DataError> {
        let file = || self.text.file.clone();
        // `contains` looks at several bytes at a time.
        if bytes[before..].contains(&0) {
            let place = bytes[before..].iter().position(|b| *b == 0).unwrap_or(0);
            let line = self.line + newlines(&bytes[..before + place]);
            return Err(DataError::Table {
                file: file(),
                reason: format!("line {line} has NUL bytes, which no text has"),
            });
        }
        match long_line(bytes) {
            Some(start) => {
                let line = self.line + newlines(&bytes[..start]);
                Err(DataError::Table {
                    file: file(),
                    reason: format!("line {line} is longer than {} KiB", MAX_LINE >> 10),
                })
            }
            None => Ok(()),
        }
    }
}

fn newlines(bytes: &[u8]) -> u64 {
    bytes.iter().filter(|b| **b == b'\n').count() as u64
}

/// Start of a line longer than [`MAX_LINE`].
fn long_line(bytes: &[u8]) -> Option<usize> {
    let mut start = 0;
    while bytes.len() - start > MAX_LINE {
        // Only the last newline of each stretch is looked for, which is near its end in a table.
        match bytes[start..=start + MAX_LINE].iter().rposition(|b| *b == b'\n') {
            Some(end) => start += end + 1,
            None => return Some(start),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_found_wherever_it_is() {
        let line = |length: usize| [vec![b'1'; length], vec![b'\n']].concat();
        let short = line(90).repeat(3000);
        assert_eq!(long_line(&short), None);
        assert_eq!(long_line(&[short.clone(), line(MAX_LINE), short.clone()].concat()), None);
        for at in [0, 1, 2999] {
            let start = at * 91;
            let text = [&short[..start], &line(MAX_LINE + 1), &short[start..]].concat();
            assert_eq!(long_line(&text), Some(start), "after {at} lines");
        }
    }
}
