//! SHA-256 of bytes and of files.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

/// Bytes read at once.
const BUFFER: usize = 1 << 16;

/// What a file held when it was whole.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seal {
    /// Size in bytes.
    pub bytes: u64,
    /// SHA-256 in hexadecimal digits.
    pub sha256: String,
}

impl Seal {
    /// What the file at `path` holds now; read a piece at a time.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn of(path: &Path) -> io::Result<Self> {
        let mut file = File::open(path)?;
        let mut digest = Sha256::new();
        let mut buffer = vec![0; BUFFER];
        let mut bytes = 0;
        loop {
            match file.read(&mut buffer) {
                Ok(0) => return Ok(Self { bytes, sha256: hex(&digest.finalize()) }),
                Ok(count) => {
                    digest.update(&buffer[..count]);
                    bytes += count as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// What bytes in memory are.
    #[must_use]
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, sha256: sha256([bytes]) }
    }

    /// Whether the file at `path` holds this still. One of another size is not read.
    ///
    /// # Errors
    /// When it cannot be read; [`io::ErrorKind::NotFound`] when it is not there.
    pub fn fits(&self, path: &Path) -> io::Result<bool> {
        let found = std::fs::metadata(path)?;
        Ok(found.is_file() && found.len() == self.bytes && Self::of(path)?.sha256 == self.sha256)
    }
}

/// SHA-256 of the pieces one after the other, in hexadecimal digits.
#[must_use]
pub fn sha256<'a>(pieces: impl IntoIterator<Item = &'a [u8]>) -> String {
    let mut digest = Sha256::new();
    pieces.into_iter().for_each(|piece| digest.update(piece));
    hex(&digest.finalize())
}

fn hex(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 16] = b"0123456789abcdef";
    bytes.iter().flat_map(|byte| [byte >> 4, byte & 15]).map(|half| char::from(DIGITS[usize::from(half)])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_digest_is_the_published_one() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256([b"abc".as_slice()]), abc);
        assert_eq!(sha256([b"a".as_slice(), b"", b"bc"]), abc);
    }

    #[test]
    fn another_size_another_byte_and_a_folder_do_not_fit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, vec![7; BUFFER + 3]).unwrap();
        let seal = Seal::of(&path).unwrap();
        assert_eq!(seal, Seal::of_bytes(&vec![7; BUFFER + 3]));
        assert_eq!(seal.bytes, BUFFER as u64 + 3);
        assert!(seal.fits(&path).unwrap());
        for last in [b"\x07\x07".as_slice(), b"\x07\x07\x06"] {
            std::fs::write(&path, [&vec![7; BUFFER], last].concat()).unwrap();
            assert!(!seal.fits(&path).unwrap());
        }
        assert!(!seal.fits(folder.path()).unwrap());
        assert_eq!(seal.fits(&folder.path().join("b")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
