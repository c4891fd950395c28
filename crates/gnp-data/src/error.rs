//! What can be wrong with recordings, and what to do about it.

use std::path::PathBuf;

use crate::dataset::Dataset;
use crate::scene_edit::SceneEditError;
use crate::window_shape::WindowError;

/// What kind of fault tracks have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TrackProblem {
    /// Columns are missing, of another kind or of different lengths.
    Columns,
    /// There are no rows or no vehicles to read.
    Empty,
    /// A value that cannot be: not finite, too large.
    Value,
    /// Times that are not uniform, or too far apart.
    Time,
    /// A vehicle in two places at one time.
    Duplicate,
    /// Numbers that can only come from another unit.
    Unit,
    /// A road that is not straight, or not where the tracks are.
    Road,
    /// Columns that say things that cannot both be true.
    Contradiction,
}

/// Why recordings could not be found, read, checked, cut or kept. Every message names the file, the
/// line or the column where there is one, and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DataError {
    /// The file system refused.
    #[error("{}: cannot be read or written; check that the path exists and that you may", file.display())]
    Io {
        /// The file or folder.
        file: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
    /// A `.gz` that ends early or is not gzip.
    #[error("{}: the gzip stream is broken ({reason}); copy or download the file again", file.display())]
    Gzip {
        /// The file.
        file: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// A `.gz` out of which comes more than a recording could be packed to.
    #[error(
        "{}: more than {limit} bytes of text come out of a byte of gzip, which no recording does; take the original file, \
         or unpack it", file.display()
    )]
    Inflated {
        /// The file.
        file: PathBuf,
        /// Most bytes that a byte may stand for.
        limit: u64,
    },
    /// A pipe, a socket or a device, which is not opened: reading it may never end.
    #[error("{}: this is {what}, which is not opened; give a file or a folder", file.display())]
    NotAFile {
        /// The place.
        file: PathBuf,
        /// What it is, with its article.
        what: &'static str,
    },
    /// A file of another kind.
    #[error("{}: this is {what}; {remedy}", file.display())]
    Foreign {
        /// The file.
        file: PathBuf,
        /// What it is.
        what: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// A folder without anything to read.
    #[error("{}: no recordings found ({seen}); expected {expected}", folder.display())]
    NoRecordings {
        /// The folder or file that was searched.
        folder: PathBuf,
        /// What would have been accepted.
        expected: String,
        /// What was there instead.
        seen: String,
    },
    /// A dataset that no format is known for.
    #[error("there is no dataset `{dataset}`; known are: {known}")]
    UnknownDataset {
        /// The name.
        dataset: Dataset,
        /// Names that have a format, separated by commas.
        known: String,
    },
    /// A table without one of its columns.
    #[error("{}, line 1: column `{column}` is missing (the header has: {found}); restore the column from the original download", file.display())]
    MissingColumn {
        /// The table.
        file: PathBuf,
        /// The column that is not there.
        column: String,
        /// The columns that are.
        found: String,
    },
    /// Fields separated by the wrong character.
    #[error("{}, line 1: fields are separated by {found:?}; save the table with {expected}", file.display())]
    Delimiter {
        /// The table.
        file: PathBuf,
        /// What separates its fields.
        found: char,
        /// What should.
        expected: &'static str,
    },
    /// A line with too few or too many fields.
    #[error("{}, line {line}: {found} fields where {expected} are due; repair the line or download the file again", file.display())]
    FieldCount {
        /// The table.
        file: PathBuf,
        /// Line, the first being 1.
        line: u64,
        /// Fields on the line.
        found: usize,
        /// Fields every line must have.
        expected: usize,
    },
    /// A value that cannot be what its column says.
    #[error("{}, line {line}, column `{column}`: {value:?} {reason}", file.display())]
    Value {
        /// The table.
        file: PathBuf,
        /// Line, the first being 1.
        line: u64,
        /// Column.
        column: String,
        /// The text of the field.
        value: String,
        /// What is wrong with it and what to do.
        reason: String,
    },
    /// Frames of one vehicle run backwards.
    #[error(
        "{}, line {line}, column `{column}`: frame {frame} of vehicle {vehicle} comes after its frame {previous}; \
         sort the rows by vehicle and frame, or take the original file", file.display()
    )]
    FrameOrder {
        /// The table.
        file: PathBuf,
        /// Line of the earlier frame, the first line being 1.
        line: u64,
        /// The frame column.
        column: String,
        /// Vehicle.
        vehicle: u32,
        /// Frame of this line.
        frame: u32,
        /// Frame of the vehicle's row before it.
        previous: u32,
    },
    /// Lane markings that are not numbers separated by `;`.
    #[error(
        "{}, line {line}, column `{column}`: lane markings {value:?} {reason}; \
         they must be lateral positions in m, two or more, growing, separated by `;`", file.display()
    )]
    Markings {
        /// The recording's meta file.
        file: PathBuf,
        /// Line, the first being 1.
        line: u64,
        /// `upperLaneMarkings` or `lowerLaneMarkings`.
        column: String,
        /// The text of the field.
        value: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Numbers that can only come from another unit.
    #[error("{}, {place}: {what}; {remedy}", file.display())]
    Unit {
        /// The table.
        file: PathBuf,
        /// Line and column, as far as they are known.
        place: String,
        /// What cannot be, with its number.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Two columns of one name, of which only one can be meant.
    #[error(
        "{}, line 1: columns {first} and {second} are both named `{column}`; remove or rename the wrong one", file.display()
    )]
    DuplicateColumn {
        /// The table.
        file: PathBuf,
        /// The name.
        column: String,
        /// Place of the first, the leftmost column being 1.
        first: usize,
        /// Place of the second.
        second: usize,
    },
    /// A recording whose files say things that cannot both be true, of so much of it that nothing of it can be
    /// believed.
    #[error("{}, {place}: {what}; {remedy}", file.display())]
    Contradiction {
        /// The table.
        file: PathBuf,
        /// Line and column where it shows first, as far as they are known.
        place: String,
        /// What contradicts what, and how often.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Tracks of a table or a program that cannot be, or that contradict themselves.
    #[error("{place}: {what}; {remedy}")]
    Tracks {
        /// What kind of fault it is.
        problem: TrackProblem,
        /// Where it shows first: file, line or row, column, as far as they are known.
        place: String,
        /// The same as a row of the [`TrackTable`](crate::TrackTable), from 0, where one is at fault.
        row: Option<usize>,
        /// What is wrong, with its numbers.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// Tracks that a layout does not take.
    #[error("{recording} cannot be written as {layout}: {reason}")]
    Unwritable {
        /// Name of the recording.
        recording: String,
        /// Title of the layout's format.
        layout: String,
        /// What does not fit, and what to do.
        reason: String,
    },
    /// A recording sampled at another rate than the configuration expects.
    #[error(
        "{}: recording {recording} has {found_hz} frames per second, the configuration expects {expected_hz}; \
         change the expected rate or take other data", file.display()
    )]
    Rate {
        /// The file that states the rate.
        file: PathBuf,
        /// Name of the recording.
        recording: String,
        /// Rate of the recording, Hz.
        found_hz: f64,
        /// Rate the configuration expects, Hz.
        expected_hz: f64,
    },
    /// One of highD's three files is absent.
    #[error("{}: its {partner} file is not beside it; put the three files of a recording into one folder", file.display())]
    MissingPartner {
        /// A file of the recording that is there.
        file: PathBuf,
        /// The one that is not.
        partner: &'static str,
    },
    /// Rows of a vehicle the meta file does not list.
    #[error(
        "{}, line {line}, column `{column}`: vehicle {vehicle} is not in {}; take both files from one download",
        file.display(), meta.display()
    )]
    UnknownVehicle {
        /// The tracks file.
        file: PathBuf,
        /// First line of the vehicle.
        line: u64,
        /// The id column.
        column: String,
        /// Vehicle.
        vehicle: u32,
        /// The file that should list it.
        meta: PathBuf,
    },
    /// A table without rows.
    #[error("{}: the table has no rows; download the file again", file.display())]
    Empty {
        /// The table.
        file: PathBuf,
    },
    /// A table that is none, at a line that the reason names.
    #[error("{}: the table cannot be read ({reason}); compare it with the original download", file.display())]
    Table {
        /// The table.
        file: PathBuf,
        /// What the reader said.
        reason: String,
    },
    /// Parts that do not make a recording.
    #[error("recording {recording}: {reason}")]
    Parts {
        /// Name of the recording.
        recording: String,
        /// What does not fit, with track, row and column.
        reason: String,
    },
    /// A file that is not a whole, unchanged recording of this program.
    #[error("{}: {reason}; copy it back, or ingest the recordings again into a new run", file.display())]
    Cache {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A configuration value that cannot be.
    #[error("{key} = {value} {problem}")]
    BadValue {
        /// Key in the configuration.
        key: &'static str,
        /// What it is set to.
        value: String,
        /// What is wrong with it and what to do.
        problem: String,
    },
    /// Windows whose rate cannot be had from a recording by leaving out frames.
    #[error(
        "rate_hz = {window_hz} cannot be had from recordings of {recording_hz} Hz by leaving out frames; \
         set it to {recording_hz} divided by a whole number"
    )]
    WindowRate {
        /// Rate of the recording, Hz.
        recording_hz: f64,
        /// Rate asked for, Hz.
        window_hz: f64,
    },
    /// A window that a recording does not hold.
    #[error(transparent)]
    Window(#[from] WindowError),
    /// A change that a scene does not take.
    #[error(transparent)]
    SceneEdit(#[from] SceneEditError),
    /// Two recordings of one name, so that a window's name would not tell them apart.
    #[error("two recordings are named {recording}; rename a file or leave one out")]
    DuplicateRecording {
        /// The name.
        recording: String,
    },
    /// Recordings without a track as long as a window.
    #[error(
        "no track is long enough for a window: the longest lasts {longest_s:.1} s, observed_s and predicted_s \
         ask for {needed_s} s; shorten them or take longer recordings"
    )]
    NoWindow {
        /// Observed and predicted time, s.
        needed_s: f64,
        /// Time of the longest track, s.
        longest_s: f64,
    },
    /// A recording with more rows than a window's name can count.
    #[error("recording {recording} has {rows} rows; cut it into recordings of less than 4 billion rows")]
    TooManyRows {
        /// Name of the recording.
        recording: String,
        /// Its rows.
        rows: usize,
    },
    /// A split with a part that got no windows.
    #[error(
        "the {part} part of the split by {kind} is empty at {}; split by {instead}, give it a larger share \
         or take more recordings", sites.join(", ")
    )]
    EmptyPart {
        /// Name of the part.
        part: &'static str,
        /// Name of the split's kind.
        kind: &'static str,
        /// Sites that were split together.
        sites: Vec<String>,
        /// A kind that needs less.
        instead: &'static str,
    },
    /// A split that leaks.
    #[error(
        "vehicle {vehicle} of recording {recording} stands in two parts of the split (frame {frame}); \
         make the split anew"
    )]
    SharedFrame {
        /// Name of the recording.
        recording: String,
        /// Vehicle.
        vehicle: u32,
        /// First frame of a window in a part that it should not be in.
        frame: u32,
    },
    /// A split that leaks between recordings.
    #[error(
        "recordings {first} and {second} show the same vehicles and stand in two parts of the split; \
         make the split anew"
    )]
    SharedVehicles {
        /// Name of the first recording.
        first: String,
        /// Name of the second recording.
        second: String,
    },
    /// A driver of two recordings in two parts.
    #[error(
        "vehicle {vehicle} of {first} and vehicle {other} of {second} are one driver in two parts of the split, as could be before drivers were told across recordings; start a new run"
    )]
    SharedDriver {
        /// Name of the first recording.
        first: String,
        /// Number of the driver there.
        vehicle: u32,
        /// Name of the second recording.
        second: String,
        /// Number of the driver there.
        other: u32,
    },
    /// A split of other recordings.
    #[error("the split names windows that these recordings do not hold; take the recordings it was made of")]
    ForeignSplit,
    /// A file that is not a whole, unchanged split of these recordings.
    #[error("{}: {reason}; take the recordings and the configuration it was made of, or make the split anew", file.display())]
    SplitFile {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Features that cannot be standardised.
    #[error("features cannot be standardised: {reason}")]
    Features {
        /// What is wrong with them.
        reason: String,
    },
}
