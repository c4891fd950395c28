//! The slow way through a text: repairs that keep every value, and the first fault with its line.

use std::collections::BTreeSet;

use super::gzip::Block;
use super::sniff::{Separator, split};
use super::{Kind, MAX_TIME, MAX_WORDS, Table, Values, Wanted, whole};
use crate::error::DataError;

/// The block as plain comma-separated lines: no blank lines, one comma for a run of blanks in a
/// blank-separated text, no blanks around values, no quotes, no thousands separators between quotes.
pub(in crate::formats) fn tidy(bytes: &[u8], separator: Separator) -> Vec<u8> {
    let mut tidy = Vec::with_capacity(bytes.len());
    for line in bytes.split(|b| *b == b'\n') {
        let line = line.trim_ascii();
        if line.is_empty() {
            continue;
        }
        if separator == Separator::Blank {
            let mut blank = false;
            for b in line {
                if matches!(b, b' ' | b'\t') {
                    blank = true;
                    continue;
                }
                if std::mem::take(&mut blank) {
                    tidy.push(b',');
                }
                tidy.push(*b);
            }
        } else {
            fields(line, &mut tidy);
        }
        tidy.push(b'\n');
    }
    tidy
}

/// Appends the fields of a comma-separated line without quotes, blanks around them and commas between thousands.
fn fields(line: &[u8], tidy: &mut Vec<u8>) {
    let (mut quoted, mut field) = (false, tidy.len());
    for (i, b) in line.iter().enumerate() {
        match b {
            b'"' => quoted = !quoted,
            b',' if quoted && !is_decimal(line, i) => {}
            b',' => {
                trim_end(tidy, field);
                tidy.push(b',');
                field = tidy.len();
            }
            b' ' | b'\t' if tidy.len() == field => {}
            _ => tidy.push(*b),
        }
    }
    trim_end(tidy, field);
}

/// Whether the comma at `i` stands between digits but not before a group of three, so that it is no thousands separator.
fn is_decimal(line: &[u8], i: usize) -> bool {
    let before = i > 0 && line[i - 1].is_ascii_digit();
    let after = line[i + 1..].iter().take_while(|b| b.is_ascii_digit()).count();
    before && after > 0 && after != 3
}

fn trim_end(tidy: &mut Vec<u8>, field: usize) {
    while tidy.len() > field && tidy.last().is_some_and(u8::is_ascii_whitespace) {
        tidy.pop();
    }
}

/// The first thing wrong in a block that could not be read after the rows in `before`: always with its line.
pub(in crate::formats) fn first_fault(table: &Table, block: &Block, wanted: &[Wanted], before: &[Values]) -> DataError {
    // Different words of each column so far; the last that came in `before` may be those of this block already.
    let mut words: Vec<BTreeSet<String>> = before.iter().map(words_of).collect();
    for (line, bytes) in (block.line..).zip(block.bytes.split(|b| *b == b'\n')) {
        if let Err(fault) = fault_of(table, line, bytes, wanted, &mut words) {
            return fault;
        }
    }
    let reason = format!("line {} cannot be read as the lines before", rejected(table, block, wanted));
    DataError::Table { file: table.file.clone(), reason }
}

fn words_of(values: &Values) -> BTreeSet<String> {
    match values {
        Values::Word(_, words) => words.iter().take(MAX_WORDS).cloned().collect(),
        _ => BTreeSet::new(),
    }
}

/// What is wrong with a line as the reader sees it.
fn fault_of(
    table: &Table,
    line: u64,
    bytes: &[u8],
    wanted: &[Wanted],
    words: &mut [BTreeSet<String>],
) -> Result<(), DataError> {
    let file = || table.file.clone();
    let Ok(text) = std::str::from_utf8(bytes) else {
        return Err(DataError::Table { file: file(), reason: format!("line {line} is not UTF-8 text") });
    };
    let tidy = tidy(bytes, table.separator);
    let Ok(tidy) = std::str::from_utf8(&tidy) else {
        return Err(DataError::Table { file: file(), reason: format!("line {line} is not UTF-8 text") });
    };
    let Some(tidy) = tidy.strip_suffix('\n') else { return Ok(()) };
    let bad = |column: usize, value: &str, reason: &str| DataError::Value {
        file: file(),
        line,
        column: table.columns.get(column).cloned().unwrap_or_default(),
        value: value.to_owned(),
        reason: reason.to_owned(),
    };
    let fields: Vec<&str> = tidy.split(',').collect();
    let due = table.columns.len();
    if fields.len() != due {
        let found = split(text, table.separator).collect::<Vec<_>>();
        let comma = found.iter().position(|value| value.contains(','));
        if let Some(column) = comma.filter(|_| found.len() == due) {
            return Err(bad(
                column,
                found[column],
                "has a comma in it; write a point before decimals and nothing between thousands",
            ));
        }
        let other = [';', '|'].into_iter().find(|c| text.matches(*c).count() + 1 == due);
        if let Some(found) = other.filter(|_| fields.len() == 1) {
            return Err(DataError::Delimiter { file: file(), found, expected: "commas" });
        }
        return Err(DataError::FieldCount { file: file(), line, found: fields.len(), expected: due });
    }
    for (column, words) in wanted.iter().zip(words) {
        let value = fields[column.index];
        check(value, column.kind).map_err(|reason| bad(column.index, value, reason))?;
        if column.kind == Kind::Word && !words.contains(value) {
            words.insert(value.to_owned());
            if words.len() > MAX_WORDS {
                return Err(bad(column.index, value, "is one of too many different words of its column; repair it"));
            }
        }
    }
    Ok(())
}

/// The line with which reading a block fails, where no rule tells what is wrong with it.
fn rejected(table: &Table, block: &Block, wanted: &[Wanted]) -> u64 {
    let mut end = 0;
    let ends: Vec<usize> = block
        .bytes
        .split_inclusive(|b| *b == b'\n')
        .map(|line| {
            end += line.len();
            end
        })
        .collect();
    let reads = |lines: usize| {
        let start = &block.bytes[..ends[lines - 1]];
        start.iter().all(u8::is_ascii_whitespace) || table.read_tidy(start, wanted).is_some()
    };
    // The first `good` lines are read, the first `bad` are not.
    let (mut good, mut bad) = (0, ends.len());
    while good + 1 < bad {
        let middle = usize::midpoint(good, bad);
        if reads(middle) { good = middle } else { bad = middle }
    }
    block.line + bad.saturating_sub(1) as u64
}

fn check(value: &str, kind: Kind) -> Result<(), &'static str> {
    if kind == Kind::Label || (kind == Kind::Sparse && value.is_empty()) {
        return Ok(());
    }
    if value.is_empty() {
        return Err("is empty; fill it in or remove the row");
    }
    if matches!(kind, Kind::Word | Kind::Name) {
        return Ok(());
    }
    let Ok(number) = value.parse::<f64>() else {
        return Err("is not a number; repair the value or remove the row");
    };
    if kind != Kind::Sparse && !number.is_finite() {
        return Err("is not finite; repair the value or remove the row");
    }
    match kind {
        Kind::Whole if whole(number, i32::MAX.into()).is_none() => Err("is not a whole number of 32 bits; repair it"),
        Kind::Time if whole(number, MAX_TIME).is_none() => {
            Err("is no time in ms: a whole number below 1e15; repair it")
        }
        Kind::Real if !(number as f32).is_finite() => Err("is too large; repair it"),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tidies_without_changing_a_value() {
        assert_eq!(tidy(b"  1   2\t3 \r\n\n4 5  6", Separator::Blank), b"1,2,3\n4,5,6\n");
        assert_eq!(tidy(b"1,\"1,118,846\",us-101\r\n\r\n", Separator::Comma), b"1,1118846,us-101\n");
        assert_eq!(tidy(b" 1 ,\t12.5 , \" 7 \",St. Louis ,, \n", Separator::Comma), b"1,12.5,7,St. Louis,,\n");
        assert_eq!(tidy(b"\"1,234.5\",\"12,5\",\"Paris, TX\"", Separator::Comma), b"1234.5,12,5,Paris TX\n");
    }
}
