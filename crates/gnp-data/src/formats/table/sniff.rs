//! What a table looks like from its first line.

use std::path::Path;

use super::gzip::head;
use crate::error::DataError;
use crate::foreign::{Foreign, no_text};

/// What separates fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::formats) enum Separator {
    /// A comma.
    Comma,
    /// A run of blanks or tabs.
    Blank,
    /// Another character, which no dataset uses.
    Other(char),
}

const SEPARATORS: [Separator; 4] = [Separator::Comma, Separator::Blank, Separator::Other(';'), Separator::Other('|')];

/// The first line of a table, split in every way that could make sense.
#[derive(Clone, Debug)]
pub(in crate::formats) struct Head {
    line: String,
}

/// Columns as the first line gives them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::formats) struct Header {
    pub(in crate::formats) separator: Separator,
    /// Names as they are written; case tells no two apart.
    pub(in crate::formats) names: Vec<String>,
}

impl Head {
    /// First line with anything in it; `None` for a file of blank lines.
    ///
    /// # Errors
    /// When the file cannot be read or is no text in lines.
    pub(in crate::formats) fn read(file: &Path) -> Result<Option<Self>, DataError> {
        let (bytes, whole) = head(file)?;
        if let Some(Foreign { what, remedy }) = no_text(&bytes, whole) {
            return Err(DataError::Foreign { file: file.into(), what, remedy });
        }
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
        let line = bytes.split(|b| *b == b'\n').map(<[u8]>::trim_ascii).find(|line| !line.is_empty());
        Ok(line.map(|line| Self { line: String::from_utf8_lossy(line).into_owned() }))
    }

    /// Names of the columns under the separator that finds most of `known`, and how many it finds.
    pub(in crate::formats) fn header(&self, known: &[&str]) -> (Header, usize) {
        let found = |separator: Separator| {
            let names = split(&self.line, separator).map(str::to_owned).collect::<Vec<_>>();
            let hits = known.iter().filter(|name| names.iter().any(|have| have.eq_ignore_ascii_case(name))).count();
            (Header { separator, names }, hits)
        };
        let mut best = found(SEPARATORS[0]);
        for separator in &SEPARATORS[1..] {
            let other = found(*separator);
            if other.1 > best.1 {
                best = other;
            }
        }
        best
    }

    /// Separator and number of fields, if the first line is numbers only.
    pub(in crate::formats) fn numbers(&self) -> Option<(Separator, usize)> {
        SEPARATORS.into_iter().find_map(|separator| {
            let fields: Vec<&str> = split(&self.line, separator).collect();
            let numbers = fields.iter().all(|field| field.replace(',', "").parse::<f64>().is_ok());
            (numbers && fields.len() > 1).then_some((separator, fields.len()))
        })
    }
}

/// Fields of a line, without quotes and blanks around them.
pub(in crate::formats) fn split(line: &str, separator: Separator) -> impl Iterator<Item = &str> {
    let mut rest = Some(line.trim());
    std::iter::from_fn(move || {
        let line = rest?;
        let end = match separator {
            Separator::Blank => line.find([' ', '\t']),
            Separator::Comma => outside_quotes(line, ','),
            Separator::Other(c) => outside_quotes(line, c),
        };
        let (field, after) = end.map_or((line, None), |end| (&line[..end], Some(&line[end + 1..])));
        rest = if separator == Separator::Blank { after.map(str::trim_start) } else { after };
        Some(field.trim().trim_matches('"').trim())
    })
}

/// Position of the first `c` that is not between quotes.
fn outside_quotes(line: &str, c: char) -> Option<usize> {
    let mut quoted = false;
    line.char_indices().find_map(|(i, have)| {
        quoted ^= have == '"';
        (!quoted && have == c).then_some(i)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(line: &str, separator: Separator) -> Vec<&str> {
        split(line, separator).collect()
    }

    #[test]
    fn splits_quotes_and_runs_of_blanks() {
        assert_eq!(fields("1,\"2,345\", x ,", Separator::Comma), ["1", "2,345", "x", ""]);
        assert_eq!(fields("  1   2\t3 ", Separator::Blank), ["1", "2", "3"]);
        assert_eq!(fields("1;;3", Separator::Other(';')), ["1", "", "3"]);
    }

    #[test]
    fn a_line_of_numbers_tells_its_separator() {
        let numbers = |line: &str| Head { line: line.to_owned() }.numbers();
        assert_eq!(numbers("1,2.5,-3e2"), Some((Separator::Comma, 3)));
        assert_eq!(numbers("1   2.5  4  5"), Some((Separator::Blank, 4)));
        assert_eq!(numbers("1;2"), Some((Separator::Other(';'), 2)));
        assert_eq!(numbers("frame,id"), None);
        assert_eq!(numbers("word"), None);
    }
}
