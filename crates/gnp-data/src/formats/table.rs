//! Columns of a text table. polars reads at full speed and knows what kinds of columns are due;
//! whatever it rejects goes through [`diagnosis`], which repairs what may be repaired and
//! otherwise finds the line.

use std::io::Cursor;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use polars::prelude::{CsvReadOptions, DataFrame, DataType, PlSmallStr, PolarsResult, Schema, SerReader as _};

use self::gzip::{Block, Blocks};
use self::sniff::{Header, Separator};
use super::words::Words;
use crate::error::DataError;

mod checks;
mod diagnosis;
pub(super) mod gzip;
pub(super) mod sniff;

/// Most columns of a table. The widest that is read has 25.
const MAX_COLUMNS: usize = 1024;

/// Most different words of a column: sites and classes are a few.
const MAX_WORDS: usize = 256;

/// Most rows of a table; rows are numbered in 32 bits.
const MAX_ROWS: usize = u32::MAX as usize - 1;

/// Columns that a message lists, and characters of each.
const LISTED: usize = 30;

/// Latest time, ms, before or after 1970: some 30,000 years; differences of such times are far from overflow.
const MAX_TIME: f64 = 1e15;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Whole numbers of 32 bits.
    Whole,
    /// Whole numbers of 64 bits: times in ms.
    Time,
    /// Numbers.
    Real,
    /// Numbers in double precision.
    Double,
    /// The same; NaN where the field is empty.
    Sparse,
    /// A few different words.
    Word,
    /// Any number of different words.
    Name,
    /// The same, of which some may be empty.
    Label,
}

/// A table to be read: where, and how it is laid out.
#[derive(Clone, Debug)]
pub(super) struct Table {
    pub(super) file: PathBuf,
    /// Names as they are written; case tells no two apart.
    pub(super) columns: Vec<String>,
    pub(super) separator: Separator,
    pub(super) has_header: bool,
}

/// A column that is wanted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    /// Its place in the table.
    pub(super) index: usize,
    pub(super) kind: Kind,
}

/// The values of a column.
#[derive(Clone, Debug)]
pub(super) enum Values {
    Whole(Vec<i32>),
    Time(Vec<i64>),
    Real(Vec<f32>),
    Double(Vec<f64>),
    Names(Words),
    /// Codes into the list of different words.
    Word(Vec<u16>, Vec<String>),
}

impl Table {
    pub(super) fn new(file: &Path, header: Header) -> Self {
        Self { file: file.into(), columns: header.names, separator: header.separator, has_header: true }
    }

    /// The column that has one of these names, if there is one; two are one too many.
    pub(super) fn find(&self, names: &[&str], kind: Kind) -> Result<Option<Wanted>, DataError> {
        let named = |column: &str| names.iter().any(|name| column.eq_ignore_ascii_case(name));
        let mut places = self.columns.iter().enumerate().filter(|(_, column)| named(column)).map(|(place, _)| place);
        match (places.next(), places.next()) {
            (Some(first), Some(second)) => Err(DataError::DuplicateColumn {
                file: self.file.clone(),
                column: self.columns[second].clone(),
                first: first + 1,
                second: second + 1,
            }),
            (first, _) => Ok(first.map(|index| Wanted { index, kind })),
        }
    }

    /// The columns for a message; a file that is no table may have any number of them, of any length.
    fn listed(&self) -> String {
        let cut = |name: &String| name.chars().take(LISTED).collect();
        let listed = self.columns.iter().take(LISTED).map(cut).collect::<Vec<String>>().join(", ");
        match self.columns.len().checked_sub(LISTED + 1) {
            Some(more) => format!("{listed} and {} more", more + 1),
            None => listed,
        }
    }

    /// A column that must be there.
    pub(super) fn want(&self, name: &str, kind: Kind) -> Result<Wanted, DataError> {
        let missing =
            || DataError::MissingColumn { file: self.file.clone(), column: name.to_owned(), found: self.listed() };
        self.find(&[name], kind)?.ok_or_else(missing)
    }

    /// The wanted columns, in the order asked for.
    pub(super) fn read(&self, wanted: &[Wanted]) -> Result<Vec<Values>, DataError> {
        self.check_width()?;
        let (sorted, ordered) = by_place(wanted);
        let mut values: Vec<Values> = ordered.iter().map(|column| Values::empty(column.kind)).collect();

        let mut blocks = Blocks::open(&self.file)?;
        let mut block = blocks.next()?;
        if let Some(first) = &mut block {
            skip_head(first, self.has_header);
        }
        // The next block is read, and decompressed, while this one is parsed.
        while let Some(this) = block.take() {
            let (parsed, next) = rayon::join(|| self.append(&this, &ordered, &mut values), || blocks.next());
            parsed?;
            block = next?;
        }
        if values.first().is_none_or(|column| column.len() == 0) {
            return Err(DataError::Empty { file: self.file.clone() });
        }
        Ok(as_asked(values, &sorted))
    }

    /// Hands the wanted columns, in the order asked for, of every block of lines to `take`, until it breaks.
    ///
    /// # Errors
    /// As [`Table::read`]; what `take` returns.
    pub(super) fn read_blocks(
        &self,
        wanted: &[Wanted],
        take: &mut dyn FnMut(Vec<Values>) -> Result<ControlFlow<()>, DataError>,
    ) -> Result<(), DataError> {
        self.check_width()?;
        let (sorted, ordered) = by_place(wanted);
        let mut blocks = Blocks::open(&self.file)?;
        let mut has_header = self.has_header;
        let mut rows = 0;
        while let Some(mut block) = blocks.next()? {
            skip_head(&mut block, std::mem::take(&mut has_header));
            let mut values: Vec<Values> = ordered.iter().map(|column| Values::empty(column.kind)).collect();
            self.append(&block, &ordered, &mut values)?;
            rows += values.first().map_or(0, Values::len);
            if rows > MAX_ROWS {
                return Err(self.too_long());
            }
            if values.first().is_some_and(|column| column.len() > 0) && take(as_asked(values, &sorted))?.is_break() {
                break;
            }
        }
        if rows == 0 { Err(DataError::Empty { file: self.file.clone() }) } else { Ok(()) }
    }

    fn check_width(&self) -> Result<(), DataError> {
        if self.columns.len() <= MAX_COLUMNS {
            return Ok(());
        }
        let reason = format!("it has {} columns, more than {MAX_COLUMNS}", self.columns.len());
        Err(DataError::Table { file: self.file.clone(), reason })
    }

    fn too_long(&self) -> DataError {
        let reason = format!("it has more than {MAX_ROWS} rows: cut it into several");
        DataError::Table { file: self.file.clone(), reason }
    }

    /// Number of the line that holds data row `row`, the first line of the file being 1.
    pub(super) fn line_of(&self, row: usize) -> Result<u64, DataError> {
        line_of(&self.file, row + usize::from(self.has_header))
    }

    /// A value that cannot be, as an error that names its line and column.
    pub(super) fn bad_value(&self, row: usize, column: Wanted, value: impl ToString, reason: &str) -> DataError {
        match self.line_of(row) {
            Ok(line) => DataError::Value {
                file: self.file.clone(),
                line,
                column: self.columns[column.index].clone(),
                value: value.to_string(),
                reason: reason.to_owned(),
            },
            Err(e) => e,
        }
    }

    fn append(&self, block: &Block, wanted: &[Wanted], values: &mut [Values]) -> Result<(), DataError> {
        if block.bytes.iter().all(u8::is_ascii_whitespace) {
            return Ok(());
        }
        let fast = self.separator == Separator::Comma && self.is_even(&block.bytes);
        let fast = if fast { self.parse(&block.bytes, wanted, false).ok() } else { None };
        let read = fast.and_then(|frame| columns(&frame, wanted)).or_else(|| self.read_tidy(&block.bytes, wanted));
        if read.is_none_or(|read| extend(values, read).is_none()) {
            return Err(diagnosis::first_fault(self, block, wanted, values));
        }
        if values.first().is_some_and(|column| column.len() > MAX_ROWS) {
            return Err(self.too_long());
        }
        Ok(())
    }

    /// The wanted columns of lines that need repair: blank lines, blanks for commas or around values, thousands between
    /// quotes, `5.0` for `5`. `None` where they cannot be read.
    fn read_tidy(&self, bytes: &[u8], wanted: &[Wanted]) -> Option<Vec<Values>> {
        let tidy = diagnosis::tidy(bytes, self.separator);
        let frame = if self.is_even(&tidy) { self.parse(&tidy, wanted, true).ok()? } else { return None };
        columns(&frame, wanted)
    }

    /// Whether the number of commas is that of a table in which every line has all fields: polars
    /// does not look at fields after the last one wanted. Quotes are for [`diagnosis::tidy`].
    fn is_even(&self, bytes: &[u8]) -> bool {
        let (mut commas, mut lines, mut quotes) = (0, 0, 0);
        for chunk in bytes.chunks(1 << 12) {
            commas += chunk.iter().filter(|b| **b == b',').count();
            lines += chunk.iter().filter(|b| **b == b'\n').count();
            quotes += chunk.iter().filter(|b| **b == b'"').count();
        }
        lines += usize::from(bytes.last().is_some_and(|b| *b != b'\n'));
        quotes == 0 && commas == lines * (self.columns.len() - 1)
    }

    fn parse(&self, bytes: &[u8], wanted: &[Wanted], lenient: bool) -> PolarsResult<DataFrame> {
        let mut types = vec![DataType::Float32; self.columns.len()];
        for column in wanted {
            types[column.index] = match (column.kind, lenient) {
                (Kind::Whole, false) => DataType::Int32,
                (Kind::Time, false) => DataType::Int64,
                (Kind::Whole | Kind::Time, true) => DataType::Float64,
                (Kind::Real, _) => DataType::Float32,
                (Kind::Double | Kind::Sparse, _) => DataType::Float64,
                (Kind::Word | Kind::Name | Kind::Label, _) => DataType::String,
            };
        }
        let names = (0..types.len()).map(|i| PlSmallStr::from_string(format!("c{i}")));
        let schema: Schema = names.zip(types).collect();
        CsvReadOptions::default()
            .with_has_header(false)
            .with_schema(Some(Arc::new(schema)))
            .map_parse_options(|options| options.with_quote_char(None))
            .with_projection(Some(Arc::new(wanted.iter().map(|column| column.index).collect())))
            .into_reader_with_file_handle(Cursor::new(bytes))
            .finish()
    }
}

impl Values {
    fn empty(kind: Kind) -> Self {
        match kind {
            Kind::Whole => Self::Whole(Vec::new()),
            Kind::Time => Self::Time(Vec::new()),
            Kind::Real => Self::Real(Vec::new()),
            Kind::Double | Kind::Sparse => Self::Double(Vec::new()),
            Kind::Word => Self::Word(Vec::new(), Vec::new()),
            Kind::Name | Kind::Label => Self::Names(Words::default()),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Whole(v) => v.len(),
            Self::Time(v) => v.len(),
            Self::Real(v) => v.len(),
            Self::Double(v) => v.len(),
            Self::Word(v, _) => v.len(),
            Self::Names(words) => words.codes.len(),
        }
    }

    pub(super) fn whole(self) -> Vec<i32> {
        if let Self::Whole(v) = self { v } else { Vec::new() }
    }

    pub(super) fn time(self) -> Vec<i64> {
        if let Self::Time(v) = self { v } else { Vec::new() }
    }

    pub(super) fn real(self) -> Vec<f32> {
        if let Self::Real(v) = self { v } else { Vec::new() }
    }

    pub(super) fn double(self) -> Vec<f64> {
        if let Self::Double(v) = self { v } else { Vec::new() }
    }

    pub(super) fn names(self) -> Words {
        if let Self::Names(words) = self { words } else { Words::default() }
    }

    /// Codes and the words they stand for.
    pub(super) fn words(self) -> (Vec<u16>, Vec<String>) {
        if let Self::Word(codes, words) = self { (codes, words) } else { (Vec::new(), Vec::new()) }
    }
}

/// Number of the line that holds the `left`th line with anything in it, from 0; the first line of the file is 1.
pub(super) fn line_of(file: &Path, mut left: usize) -> Result<u64, DataError> {
    let mut blocks = Blocks::open(file)?;
    let mut last = 0;
    while let Some(block) = blocks.next()? {
        for (i, line) in block.bytes.split(|b| *b == b'\n').enumerate() {
            if line.trim_ascii().is_empty() {
                continue;
            }
            last = block.line + i as u64;
            if left == 0 {
                return Ok(last);
            }
            left -= 1;
        }
    }
    Ok(last)
}

/// Wanted columns by their place in the table, and which of those asked for each is.
fn by_place(wanted: &[Wanted]) -> (Vec<usize>, Vec<Wanted>) {
    let mut sorted: Vec<usize> = (0..wanted.len()).collect();
    sorted.sort_unstable_by_key(|i| wanted[*i].index);
    let ordered = sorted.iter().map(|i| wanted[*i]).collect();
    (sorted, ordered)
}

/// Columns by their place in the order asked for.
fn as_asked(values: Vec<Values>, sorted: &[usize]) -> Vec<Values> {
    let mut places: Vec<Option<Values>> = values.into_iter().map(Some).collect();
    let place = |i: usize| sorted.iter().position(|s| *s == i);
    (0..sorted.len()).filter_map(|i| places.get_mut(place(i)?)?.take()).collect()
}

/// Cuts a byte order mark and the header off the first block.
fn skip_head(block: &mut Block, has_header: bool) {
    let mut cut = if block.bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
    if has_header {
        // The header is the first line that is not blank.
        for line in block.bytes[cut..].split_inclusive(|b| *b == b'\n') {
            cut += line.len();
            block.line += 1;
            if !line.trim_ascii().is_empty() {
                break;
            }
        }
    }
    block.bytes.drain(..cut);
}

/// The wanted columns of a frame; `None` where a value is missing, not finite or not whole.
fn columns(frame: &DataFrame, wanted: &[Wanted]) -> Option<Vec<Values>> {
    let read = frame.columns().iter().zip(wanted).map(|(column, wanted)| {
        if column.null_count() > 0 && !matches!(wanted.kind, Kind::Sparse | Kind::Label) {
            return None;
        }
        let series = column.as_materialized_series();
        Some(match (wanted.kind, series.dtype()) {
            (Kind::Whole, DataType::Int32) => {
                Values::Whole(join(series.i32().ok()?.downcast_iter().map(|part| part.values().as_slice())))
            }
            (Kind::Time, DataType::Int64) => {
                let times: Vec<i64> = join(series.i64().ok()?.downcast_iter().map(|part| part.values().as_slice()));
                let known = times.iter().fold(true, |known, time| known & (time.unsigned_abs() <= MAX_TIME as u64));
                known.then_some(Values::Time(times))?
            }
            (Kind::Whole, _) => Values::Whole(
                series
                    .f64()
                    .ok()?
                    .into_no_null_iter()
                    .map(|v| whole(v, i32::MAX.into()).map(|v| v as i32))
                    .collect::<Option<_>>()?,
            ),
            (Kind::Time, _) => {
                Values::Time(series.f64().ok()?.into_no_null_iter().map(|v| whole(v, MAX_TIME)).collect::<Option<_>>()?)
            }
            (Kind::Real, _) => {
                let values: Vec<f32> = join(series.f32().ok()?.downcast_iter().map(|part| part.values().as_slice()));
                // Without a branch, so that it takes several values at a time.
                values.iter().fold(true, |finite, v| finite & v.is_finite()).then_some(Values::Real(values))?
            }
            (Kind::Double, _) => {
                let values: Vec<f64> = join(series.f64().ok()?.downcast_iter().map(|part| part.values().as_slice()));
                values.iter().fold(true, |finite, v| finite & v.is_finite()).then_some(Values::Double(values))?
            }
            (Kind::Sparse, _) => Values::Double(series.f64().ok()?.iter().map(|v| v.unwrap_or(f64::NAN)).collect()),
            (Kind::Name | Kind::Label, _) => {
                let mut words = Words::default();
                series.str().ok()?.iter().for_each(|word| words.push(word.unwrap_or("")));
                Values::Names(words)
            }
            (Kind::Word, _) => {
                let mut words: Vec<String> = Vec::new();
                let mut codes = Vec::with_capacity(series.len());
                for word in series.str().ok()?.iter().flatten() {
                    codes.push(code(&mut words, codes.last().copied(), word)?);
                }
                Values::Word(codes, words)
            }
        })
    });
    read.collect()
}

/// `value` if it is a whole number not beyond `limit`.
pub(super) fn whole(value: f64, limit: f64) -> Option<i64> {
    (value.fract() == 0. && value.abs() <= limit).then_some(value as i64)
}

/// Code of `word`, which is mostly that of the row before; `None` when there are too many.
fn code(words: &mut Vec<String>, last: Option<u16>, word: &str) -> Option<u16> {
    if let Some(last) = last
        && words.get(usize::from(last)).is_some_and(|have| have == word)
    {
        return Some(last);
    }
    let place = words.iter().position(|have| have == word).unwrap_or_else(|| {
        words.push(word.to_owned());
        words.len() - 1
    });
    u16::try_from(place).ok().filter(|_| words.len() <= MAX_WORDS)
}

fn join<'a, T: Copy + 'a>(parts: impl Iterator<Item = &'a [T]>) -> Vec<T> {
    let mut all = Vec::new();
    for part in parts {
        all.extend_from_slice(part);
    }
    all
}

/// Adds rows; `None` when a column has too many different words then.
fn extend(values: &mut [Values], read: Vec<Values>) -> Option<()> {
    for (all, more) in values.iter_mut().zip(read) {
        match (all, more) {
            (Values::Whole(all), Values::Whole(more)) => append(all, more),
            (Values::Time(all), Values::Time(more)) => append(all, more),
            (Values::Real(all), Values::Real(more)) => append(all, more),
            (Values::Double(all), Values::Double(more)) => append(all, more),
            (Values::Names(all), Values::Names(more)) => more.iter().for_each(|word| all.push(word)),
            (Values::Word(all, words), Values::Word(more, new)) => {
                let codes = new.iter().map(|word| code(words, None, word)).collect::<Option<Vec<u16>>>()?;
                all.extend(more.into_iter().filter_map(|c| codes.get(usize::from(c))));
            }
            _ => {}
        }
    }
    Some(())
}

fn append<T>(all: &mut Vec<T>, mut more: Vec<T>) {
    if all.is_empty() { *all = more } else { all.append(&mut more) }
}
