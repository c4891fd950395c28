//! How a text table is written: separators, ends of lines, quotes, packing; and single cells spoilt.

use std::io::{self, Write as _};

use arbitrary::Arbitrary;
use flate2::Compression;
use flate2::write::GzEncoder;

use crate::made::Rarely;

/// What stands between fields.
#[derive(Arbitrary, Clone, Copy, Debug)]
enum Separator {
    Comma,
    Blank,
    Tab,
    Semicolon,
    Padded,
}

/// What ends a line.
#[derive(Arbitrary, Clone, Copy, Debug)]
enum Ending {
    Unix,
    Windows,
    OldMac,
}

/// How a table is written.
#[derive(Arbitrary, Clone, Debug, Default)]
pub(crate) struct Style {
    separator: Rarely<Separator>,
    ending: Rarely<Ending>,
    header: Rarely<bool>,
    quoted: Rarely<bool>,
    mark: Rarely<bool>,
    packed: Rarely<bool>,
    blank_line: Rarely<u8>,
    without_last_end: bool,
    cells: Vec<Edit>,
    bytes: Rarely<Spot>,
}

/// A cell with another content.
#[derive(Arbitrary, Clone, Copy, Debug)]
struct Edit {
    line: u8,
    column: u8,
    cell: Cell,
}

#[derive(Arbitrary, Clone, Copy, Debug)]
enum Cell {
    Word(u8),
    Whole(i32),
    Small(i8),
    Real(f32),
    Time(i64),
    /// That of another column.
    Other(u8),
    /// No cell at all, so that the line is one short.
    Gone,
}

/// A byte replaced, by its place from the end of the table.
#[derive(Arbitrary, Clone, Copy, Debug)]
struct Spot {
    at: u16,
    byte: u8,
}

/// What a cell should not hold.
const WORDS: [&str; 16] = [
    "NaN", "inf", "", "-", "n/a", " 12.5 ", "\"7\"", "1,5", "1;5", "1e308", "5.0", "0x1F", "99", "-0", "us-101", "Car",
];

impl Style {
    /// The table of `header` and `lines`, the name of its file being `name`, with `.gz` where it is packed.
    ///
    /// # Errors
    /// When it cannot be packed, which memory alone could bring about.
    pub(crate) fn write(&self, name: &str, header: &[&str], lines: &[Vec<String>]) -> io::Result<(String, Vec<u8>)> {
        let mut cells: Vec<Vec<String>> = Vec::with_capacity(lines.len() + 1);
        if self.header.or(true) {
            cells.push(header.iter().map(|&name| name.to_owned()).collect());
        }
        cells.extend_from_slice(lines);
        self.cells.iter().for_each(|edit| spoil(&mut cells, edit));
        let text = self.text(&cells);
        Ok(if self.packed.or(false) { (format!("{name}.gz"), pack(&text)?) } else { (name.to_owned(), text) })
    }

    fn text(&self, cells: &[Vec<String>]) -> Vec<u8> {
        let separator = match self.separator.or(Separator::Comma) {
            Separator::Comma => ",",
            Separator::Blank => " ",
            Separator::Tab => "\t",
            Separator::Semicolon => ";",
            Separator::Padded => " , ",
        };
        let end = match self.ending.or(Ending::Unix) {
            Ending::Unix => "\n",
            Ending::Windows => "\r\n",
            Ending::OldMac => "\r",
        };
        let mut text = if self.mark.or(false) { "\u{feff}".to_owned() } else { String::new() };
        for (number, line) in cells.iter().enumerate() {
            if self.blank_line.0 == Some(number as u8) {
                text.push_str(end);
            }
            let quoted = self.quoted.or(false);
            let line: Vec<String> =
                line.iter().map(|cell| if quoted { format!("\"{cell}\"") } else { cell.clone() }).collect();
            text.push_str(&line.join(separator));
            text.push_str(end);
        }
        if self.without_last_end {
            text.truncate(text.len().saturating_sub(end.len()));
        }
        let mut text = text.into_bytes();
        if let Some(Spot { at, byte }) = self.bytes.0 {
            let length = text.len().max(1);
            if let Some(place) = text.get_mut(length - 1 - usize::from(at) % length) {
                *place = byte;
            }
        }
        text
    }
}

fn spoil(cells: &mut [Vec<String>], edit: &Edit) {
    let count = cells.len().max(1);
    let Some(line) = cells.get_mut(usize::from(edit.line) % count) else { return };
    let columns = line.len().max(1);
    let column = usize::from(edit.column) % columns;
    let value = match edit.cell {
        Cell::Word(which) => WORDS[usize::from(which) % WORDS.len()].to_owned(),
        Cell::Whole(number) => number.to_string(),
        Cell::Small(number) => number.to_string(),
        Cell::Real(number) => number.to_string(),
        Cell::Time(number) => number.to_string(),
        Cell::Other(other) => line.get(usize::from(other) % columns).cloned().unwrap_or_default(),
        Cell::Gone => {
            if column < line.len() {
                line.remove(column);
            }
            return;
        }
    };
    if let Some(cell) = line.get_mut(column) {
        *cell = value;
    }
}

/// Packed by gzip.
///
/// # Errors
/// When the encoder fails.
pub(crate) fn pack(text: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(text)?;
    encoder.finish()
}
