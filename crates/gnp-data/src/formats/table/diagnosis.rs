//! The slow way through a text: repairs that keep every value, and the first fault with its line.

use super::gzip::Block;
use super::sniff::{Separator, split};
use super::{Kind, Table, Wanted, whole};
use crate::error::DataError;

/// The block as plain comma-separated lines: no blank lines, one comma for a run of blanks in a
/// blank-separated text, no quotes, no thousands separators between quotes.
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
            let mut quoted = false;
            for b in line {
                match b {
                    b'"' => quoted = !quoted,
                    b',' if quoted => {}
                    _ => tidy.push(*b),
                }
            }
        }
        tidy.push(b'\n');
    }
    tidy
}

/// The first thing wrong in a block that could not be read.
pub(in crate::formats) fn first_fault(table: &Table, block: &Block, wanted: &[Wanted]) -> DataError {
    for (i, bytes) in block.bytes.split(|b| *b == b'\n').enumerate() {
        let line = block.line + i as u64;
        let Ok(text) = std::str::from_utf8(bytes) else {
            return DataError::Table { file: table.file.clone(), reason: format!("line {line} is not UTF-8 text") };
        };
        if text.trim().is_empty() {
            continue;
        }
        let fields: Vec<&str> = split(text, table.separator).collect();
        if fields.len() != table.columns.len() {
            let other = [';', '|'].into_iter().find(|c| text.matches(*c).count() + 1 == table.columns.len());
            if let Some(found) = other.filter(|_| fields.len() == 1) {
                return DataError::Delimiter { file: table.file.clone(), found, expected: "commas" };
            }
            return DataError::FieldCount {
                file: table.file.clone(),
                line,
                found: fields.len(),
                expected: table.columns.len(),
            };
        }
        for column in wanted {
            let value = fields[column.index];
            if let Err(reason) = check(value, column.kind) {
                return DataError::Value {
                    file: table.file.clone(),
                    line,
                    column: table.columns[column.index].clone(),
                    value: value.to_owned(),
                    reason: reason.to_owned(),
                };
            }
        }
    }
    DataError::Table { file: table.file.clone(), reason: "polars rejects it".into() }
}

fn check(value: &str, kind: Kind) -> Result<(), &'static str> {
    if value.is_empty() {
        return Err("is empty; fill it in or remove the row");
    }
    if kind == Kind::Word {
        return Ok(());
    }
    let Ok(number) = value.replace(',', "").parse::<f64>() else {
        return Err("is not a number; repair the value or remove the row");
    };
    if !number.is_finite() {
        return Err("is not finite; repair the value or remove the row");
    }
    match kind {
        Kind::Whole if whole(number, i32::MAX.into()).is_none() => Err("is not a whole number of 32 bits; repair it"),
        Kind::Time if whole(number, 1e15).is_none() => Err("is not a whole number of ms; repair it"),
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
    }
}
