//! Floating car data and vehicle types as XML, read element by element.

use std::io::{self, BufReader, Read};
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::vehicle::{Other, Vehicle};
use crate::error::DataError;
use crate::formats::table::gzip::Text;

/// Longest element, bytes: one of floating car data takes some 200.
const MAX_ELEMENT: usize = 1 << 16;

/// A text of XML and what went wrong in reading it.
struct Source {
    text: Text,
    /// Bytes since the last end of an element.
    open: usize,
    failed: Option<DataError>,
}

impl Read for Source {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = match self.text.read(buffer) {
            Ok(read) => read,
            Err(error) => {
                self.failed = Some(error);
                return Err(io::ErrorKind::Other.into());
            }
        };
        // What has no end would be kept in memory as a whole.
        self.open = buffer[..read].iter().rposition(|byte| *byte == b'>').map_or(self.open + read, |end| read - end);
        if self.open > MAX_ELEMENT + buffer.len() {
            return Err(io::Error::other(format!("an element is longer than {} KiB", MAX_ELEMENT >> 10)));
        }
        Ok(read)
    }
}

/// The elements of an XML file, from its start.
pub(super) struct Elements<'a> {
    file: &'a Path,
    reader: Reader<BufReader<Source>>,
}

impl<'a> Elements<'a> {
    pub(super) fn open(file: &'a Path) -> Result<Self, DataError> {
        let source = Source { text: Text::open(file)?, open: 0, failed: None };
        let mut reader = Reader::from_reader(BufReader::with_capacity(MAX_ELEMENT, source));
        reader.config_mut().check_end_names = true;
        Ok(Self { file, reader })
    }

    /// Hands every element that starts to `take`, until that says that it has seen enough.
    ///
    /// # Errors
    /// When the text cannot be read or is no XML; what `take` returns.
    pub(super) fn each(
        mut self,
        mut take: impl FnMut(&Element<'_>) -> Result<bool, DataError>,
    ) -> Result<(), DataError> {
        let (mut buffer, mut depth, mut line) = (Vec::new(), 0usize, 1);
        let broken = |line: u64, error: &dyn std::fmt::Display| DataError::Table {
            file: self.file.into(),
            // It may quote a name that never ends.
            reason: format!("line {line}: {}", gnp_file::excerpt(&error.to_string(), 160)),
        };
        loop {
            buffer.clear();
            let event = match self.reader.read_event_into(&mut buffer) {
                Ok(event) => event,
                Err(error) => {
                    let failed = self.reader.get_mut().get_mut().failed.take();
                    return Err(failed.unwrap_or_else(|| broken(line, &error)));
                }
            };
            let started = match &event {
                Event::Start(start) => {
                    depth += 1;
                    Some(start)
                }
                Event::Empty(start) => Some(start),
                Event::End(_) => {
                    depth = depth.saturating_sub(1);
                    None
                }
                Event::Eof if depth > 0 => return Err(broken(line, &"it ends within an element")),
                Event::Eof => return Ok(()),
                _ => None,
            };
            if let Some(start) = started
                && !take(&Element { file: self.file, line, start })?
            {
                return Ok(());
            }
            line += event.iter().filter(|byte| **byte == b'\n').count() as u64;
        }
    }
}

/// An element, its attributes unread.
pub(super) struct Element<'a> {
    file: &'a Path,
    /// Line that it begins on, the first being 1.
    pub(super) line: u64,
    start: &'a BytesStart<'a>,
}

impl Element<'_> {
    pub(super) fn is(&self, name: &str) -> bool {
        self.start.local_name().as_ref() == name.as_bytes()
    }

    /// The values of the attributes with these names, each `None` where there is none.
    pub(super) fn attributes<const N: usize>(&self, names: [&str; N]) -> Result<[Option<String>; N], DataError> {
        let mut values = [const { None }; N];
        for attribute in self.start.attributes() {
            let attribute = attribute.map_err(|error| self.error(format!("an attribute cannot be read ({error})")))?;
            let Some(place) = names.iter().position(|name| attribute.key.as_ref() == name.as_bytes()) else { continue };
            let text = std::str::from_utf8(&attribute.value);
            let text = text.map_err(|_| self.error(format!("attribute `{}` is not in UTF-8", names[place])))?;
            let text = quick_xml::escape::unescape(text)
                .map_err(|error| self.error(format!("attribute `{}` cannot be read ({error})", names[place])))?;
            values[place] = Some(text.into_owned());
        }
        Ok(values)
    }

    /// `text` of an attribute as a number.
    pub(super) fn number(&self, attribute: &str, text: &str) -> Result<f64, DataError> {
        number(text).ok_or_else(|| self.bad(attribute, text, "is not a number; repair it or write the file anew"))
    }

    pub(super) fn bad(&self, attribute: &str, value: &str, reason: &str) -> DataError {
        DataError::Value {
            file: self.file.into(),
            line: self.line,
            column: attribute.to_owned(),
            value: gnp_file::excerpt(value, 40),
            reason: reason.to_owned(),
        }
    }

    fn error(&self, reason: String) -> DataError {
        DataError::Table {
            file: self.file.into(),
            reason: format!("line {}: {}", self.line, gnp_file::excerpt(&reason, 160)),
        }
    }
}

/// A number that is finite.
pub(super) fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite())
}

/// A time, s: a number, or `[days:]hours:minutes:seconds`.
pub(super) fn time(text: &str) -> Option<f64> {
    if !text.contains(':') {
        return number(text);
    }
    let (mut seconds, mut unit) = (0., 1.);
    for (part, next) in text.rsplit(':').zip([60., 60., 24., 1.]) {
        seconds += unit * number(part)?;
        unit *= next;
    }
    (text.matches(':').count() <= 3).then_some(seconds)
}

/// Hands every vehicle of floating car data to `take`, in the order of the file, until that says that it has seen enough.
///
/// # Errors
/// When the file cannot be read, is no XML, or a vehicle lacks a number; what `take` returns.
pub(super) fn vehicles(
    file: &Path,
    other: &mut Other,
    take: &mut dyn FnMut(&Vehicle<'_>) -> Result<bool, DataError>,
) -> Result<(), DataError> {
    let mut now = None;
    Elements::open(file)?.each(|element| {
        if element.is("timestep") {
            let [text] = element.attributes(["time"])?;
            let text = text.ok_or_else(|| element.bad("time", "", "is missing from a time step"))?;
            now = Some(time(&text).ok_or_else(|| element.bad("time", &text, "is not a time; write the file anew"))?);
        } else if element.is("vehicle") {
            let time_s =
                now.ok_or_else(|| element.bad("time", "", "is missing: a vehicle stands before all time steps"))?;
            let names = ["id", "x", "y", "angle", "speed", "type", "lane"];
            let [id, x, y, angle, speed, kind, lane] = element.attributes(names)?;
            let missing = |name: &str| element.bad(name, "", "is missing; add it to SUMO's --fcd-output.attributes");
            let number = |name: &str, text: Option<String>| text.map(|text| element.number(name, &text)).transpose();
            return take(&Vehicle {
                place: element.line,
                time_s,
                id: &id.filter(|id| !id.is_empty()).ok_or_else(|| missing("id"))?,
                front: [number("x", x)?.ok_or_else(|| missing("x"))?, number("y", y)?.ok_or_else(|| missing("y"))?],
                angle: number("angle", angle)?.ok_or_else(|| missing("angle"))?,
                speed: number("speed", speed)?,
                kind: kind.as_deref().unwrap_or_default(),
                lane: lane.as_deref().unwrap_or_default(),
            });
        } else if element.is("person") || element.is("container") {
            other.persons += 1;
        }
        Ok(true)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_seconds_or_clock_times() {
        assert_eq!(time("12.50"), Some(12.5));
        assert_eq!(time("01:02:03.5"), Some(3723.5));
        assert_eq!(time("1:00:00:01"), Some(86401.));
        for text in ["", "nan", "1:2:3:4:5", "1:x"] {
            assert_eq!(time(text), None, "{text}");
        }
    }
}
