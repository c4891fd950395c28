//! What a file is that holds no recording, by its first bytes, and what to do with it.

use std::fmt;
use std::path::Path;

/// Bytes that a file is told by; its first line must end within them.
pub(crate) const HEAD: usize = 1 << 16;

/// What a file is instead of a recording, and what to do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Foreign {
    pub(crate) what: &'static str,
    pub(crate) remedy: &'static str,
}

impl fmt::Display for Foreign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.what, self.remedy)
    }
}

const UNPACK: &str = "unpack it, and give the tables in it";
const AS_CSV: &str = "save the table in it as CSV";
const OTHER_ROADS: &str = "highD and NGSIM are read as they are; give tracks of other roads as plain tracks (id, time, x, y), with the line \
                           of the road where it curves (docs/data.md)";
const OTHER_LAYOUT: &str = "its layout is not read; give its rows as plain tracks: id, time, x, y (docs/data.md)";
const SUMO: &str = "choose the dataset sumo";

/// Files with a mark at a place, the place first.
const MARKS: [(usize, &[u8], &str, &str); 23] = [
    (30, b"[Content_Types].xml", "an Excel workbook or another file of Office", AS_CSV),
    (30, b"mimetypeapplication/vnd.oasis.opendocument", "an OpenDocument file", AS_CSV),
    (0, b"\xd0\xcf\x11\xe0", "an old Excel workbook or another file of Office", AS_CSV),
    (0, b"PK\x03\x04", "a zip archive", UNPACK),
    (0, b"PK\x05\x06", "an empty zip archive", "download it again"),
    (0, b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (0, b"Rar!\x1a\x07", "a RAR archive", UNPACK),
    (257, b"ustar", "a tar archive", UNPACK),
    (0, b"\xfd7zXZ\x00", "compressed with xz", "unpack it; only gzip is read as it is"),
    (0, b"BZh", "compressed with bzip2", "unpack it; only gzip is read as it is"),
    (0, b"\x28\xb5\x2f\xfd", "compressed with zstd", "unpack it; only gzip is read as it is"),
    (0, b"\x1f\x8b", "compressed with gzip", "unpack it"),
    (
        0,
        b"PAR1",
        "a Parquet file, as Argoverse 2 and forecasts of this program are",
        "the dataset `tracks` reads tables with id, time, x and y, `av2` scenarios of Argoverse 2; for another one save its \
         rows as CSV (docs/data.md)",
    ),
    (0, b"ARROW1", "an Arrow file", AS_CSV),
    (0, b"\x89HDF\r\n\x1a\n", "an HDF5 file", AS_CSV),
    (0, b"SQLite format 3\x00", "an SQLite database", AS_CSV),
    (0, b"MATLAB 5.0", "a MATLAB file", AS_CSV),
    (0, b"\x93NUMPY", "a NumPy array", AS_CSV),
    (0, b"%PDF", "a PDF document", "take the tables themselves"),
    (0, b"\x89PNG\r\n", "a picture", "take the tables themselves"),
    (0, b"\xff\xd8\xff", "a picture", "take the tables themselves"),
    (0, b"GNPREC\r\n", "a recording as a run keeps it", "give the files it was read from, or the run to `--run`"),
    (0, b"version https://git-lfs", "a pointer of Git LFS to a file", "fetch the file with `git lfs pull`"),
];

/// Text files with a word in them, in lower case; the first word is what it starts with. In this order.
const MARKUP: [(&[u8], &[u8], &str, &str); 9] = [
    (b"<!doctype html", b"", "a web page, perhaps of a failed download", "download the data again"),
    (b"<html", b"", "a web page, perhaps of a failed download", "download the data again"),
    (b"<", b"<fcd-export", "floating car data (FCD) of SUMO", SUMO),
    (b"<", b"<commonroad", "a CommonRoad scenario", OTHER_LAYOUT),
    (b"<", b"", "XML", OTHER_LAYOUT),
    (b"", b"\"road_segment_ids\"", "I-24 MOTION, as JSON", OTHER_LAYOUT),
    (b"", b"\"sample_token\"", "nuScenes, as JSON", OTHER_ROADS),
    (b"{", b"", "JSON", OTHER_LAYOUT),
    (b"[", b"", "JSON", OTHER_LAYOUT),
];

/// Tables of other datasets by columns that all must be there, in lower case.
const TABLES: [(&[&str], &str, &str); 9] = [
    (&["trackid", "xcenter", "laneletid"], "a table of exiD, which has ramps and curved roads", OTHER_ROADS),
    (&["trackid", "xcenter", "heading"], "a table of inD, rounD, uniD or exiD, which have curved roads", OTHER_ROADS),
    (&["trackid", "initialframe", "finalframe"], "a tracksMeta table of inD, rounD, uniD or exiD", OTHER_ROADS),
    (&["locationid", "xutmorigin", "orthopxtometer"], "a recordingMeta table of inD, rounD, uniD or exiD", OTHER_ROADS),
    (&["track_id", "type", "traveled_d"], "a table of pNEUMA, which is of streets with junctions", OTHER_ROADS),
    (&["timestamp", "track_id", "object_type", "city_name"], "a table of Argoverse, which is of streets", OTHER_ROADS),
    (&["track_id", "frame_id", "timestamp_ms", "agent_type"], "a table of INTERACTION", OTHER_ROADS),
    (&["road_segment_ids", "x_position", "y_position"], "a table of I-24 MOTION", OTHER_LAYOUT),
    (&["framenum", "carid", "carcenterx"], "a table of CitySim", OTHER_ROADS),
];

/// Why bytes that a file starts with are no text in lines, the whole file where `whole`.
pub(crate) fn no_text(head: &[u8], whole: bool) -> Option<Foreign> {
    let marked = |(at, mark, ..): &&(usize, &[u8], &str, &str)| head.get(*at..).is_some_and(|it| it.starts_with(mark));
    if let Some((_, _, what, remedy)) = MARKS.iter().find(marked) {
        return Some(Foreign { what, remedy });
    }
    let utf8 = "save it as UTF-8";
    if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") {
        return Some(Foreign { what: "text in UTF-16", remedy: utf8 });
    }
    let zeros = |from: usize| head.iter().skip(from).step_by(2).filter(|b| **b == 0).count();
    // Letters in UTF-16 have a zero on one side.
    let (even, odd) = (zeros(0), zeros(1));
    if even.max(odd) > head.len() / 4 && even.min(odd) == 0 {
        return Some(Foreign { what: "text in UTF-16 without its mark", remedy: utf8 });
    }
    let line_ends = head.contains(&b'\n');
    if !line_ends && head.trim_ascii().contains(&b'\r') {
        return Some(Foreign {
            what: "text whose lines end with a carriage return alone",
            remedy: "save it with line feeds (LF or CR LF)",
        });
    }
    if !line_ends && !whole && even + odd == 0 {
        return Some(Foreign {
            what: "without a line end in its first 64 KiB",
            remedy: "a table has a row a line: take the original file",
        });
    }
    let first = head.split(|b| *b == b'\n').map(<[u8]>::trim_ascii).find(|line| !line.is_empty())?;
    if first.contains(&0) {
        return Some(Foreign { what: "no text: it has NUL bytes", remedy: "copy or download it again" });
    }
    std::str::from_utf8(first).is_err().then_some(Foreign { what: "text that is not in UTF-8", remedy: utf8 })
}

/// What bytes are that a file starts with, where that is known and no table of this program.
pub(crate) fn known(head: &[u8], whole: bool) -> Option<Foreign> {
    let text = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head).trim_ascii_start();
    let has = |word: &[u8]| word.is_empty() || text.windows(word.len()).any(|at| at.eq_ignore_ascii_case(word));
    let starts = |word: &[u8]| text.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word));
    let binary = no_text(head, true);
    if binary.is_none()
        && let Some((_, _, what, remedy)) = MARKUP.iter().find(|(start, word, ..)| starts(start) && has(word))
    {
        return Some(Foreign { what, remedy });
    }
    if let Some(foreign) = no_text(head, whole) {
        return Some(foreign);
    }
    let header = std::str::from_utf8(text.split(|b| *b == b'\n').next()?).ok()?.to_ascii_lowercase();
    let names: Vec<&str> = header.split([',', ';', '\t']).map(|name| name.trim().trim_matches('"')).collect();
    let table = TABLES.iter().find(|(columns, ..)| columns.iter().all(|column| names.contains(column)));
    table.map(|(_, what, remedy)| Foreign { what, remedy })
}

/// A file with nothing but blanks in it; `None` also where it cannot be read.
pub(crate) fn empty(file: &Path) -> Option<Foreign> {
    let (head, whole) = crate::formats::head(file).ok()?;
    let text = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&head);
    let remedy = "download it again if it should be a recording";
    (whole && text.trim_ascii().is_empty()).then_some(Foreign { what: "an empty file", remedy })
}

/// What a file is by its first bytes and, where these do not tell, by its name; `None` also where it cannot be read.
pub(crate) fn of_file(file: &Path) -> Option<Foreign> {
    let (head, whole) = crate::formats::head(file).ok()?;
    let by_name = || {
        let waymo = file.file_name()?.to_string_lossy().to_ascii_lowercase().contains(".tfrecord");
        waymo.then_some(Foreign { what: "a TFRecord, as those of Waymo are", remedy: OTHER_ROADS })
    };
    by_name().or_else(|| known(&head, whole))
}
