//! TensorBoard event files: scalars only, written as training goes.
//!
//! A file is a sequence of frames: length (u64, little-endian), masked CRC-32C of the length,
//! an `Event` message, masked CRC-32C of the message (TensorFlow's `record_writer`). The messages
//! are the parts of `event.proto` and `summary.proto` that scalars need.

use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use prost::Message;

use crate::error::TrainError;
use crate::observer::{BatchReport, EpochReport, Observer, Plan};

#[derive(Clone, PartialEq, Message)]
struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(oneof = "What", tags = "3, 5")]
    what: Option<What>,
}

#[derive(Clone, PartialEq, prost::Oneof)]
enum What {
    #[prost(string, tag = "3")]
    FileVersion(String),
    #[prost(message, tag = "5")]
    Summary(Summary),
}

#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<Scalar>,
}

#[derive(Clone, PartialEq, Message)]
struct Scalar {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, tag = "2")]
    simple_value: f32,
}

/// Writes scalars to a new event file; as an [`Observer`] it writes a run's curves under the name
/// of its stage.
#[derive(Debug)]
pub struct EventWriter {
    path: PathBuf,
    file: BufWriter<File>,
    stage: &'static str,
}

impl EventWriter {
    /// A new file in `folder`, which is made if it is not there. A resumed run gets a file of its
    /// own; TensorBoard joins them by step.
    ///
    /// # Errors
    /// [`TrainError::File`] when the folder or the file cannot be made.
    pub fn create(folder: &Path) -> Result<Self, TrainError> {
        fs::create_dir_all(folder).map_err(|source| TrainError::File { path: folder.to_owned(), source })?;
        let seconds = now() as u64;
        let mut copy = 0;
        let (path, file) = loop {
            // TensorBoard reads every file with `tfevents` in its name, in the order of the names.
            let path = folder.join(format!("events.out.tfevents.{seconds:010}.gnp.{copy}"));
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => break (path, file),
                Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => copy += 1,
                Err(source) => return Err(TrainError::File { path, source }),
            }
        };
        let mut writer = Self { path, file: BufWriter::new(file), stage: "" };
        writer.write(0, What::FileVersion("brain.Event:2".to_owned()))?;
        writer.flush()?;
        Ok(writer)
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes scalars of one step.
    ///
    /// # Errors
    /// [`TrainError::File`] when the file cannot be written.
    pub fn scalars<'a>(
        &mut self,
        step: u64,
        scalars: impl IntoIterator<Item = (&'a str, f32)>,
    ) -> Result<(), TrainError> {
        let scalar = |(tag, simple_value): (&str, f32)| Scalar { tag: format!("{}{tag}", self.stage), simple_value };
        let value = scalars.into_iter().map(scalar).collect();
        self.write(step, What::Summary(Summary { value }))
    }

    /// Hands everything to the operating system.
    ///
    /// # Errors
    /// [`TrainError::File`] when it cannot be written.
    pub fn flush(&mut self) -> Result<(), TrainError> {
        self.file.flush().map_err(|source| TrainError::File { path: self.path.clone(), source })
    }

    fn write(&mut self, step: u64, what: What) -> Result<(), TrainError> {
        let step = i64::try_from(step).unwrap_or(i64::MAX);
        let event = Event { wall_time: now(), step, what: Some(what) }.encode_to_vec();
        let length = (event.len() as u64).to_le_bytes();
        let frame = [&length[..], &masked_crc(&length), &event, &masked_crc(&event)].concat();
        self.file.write_all(&frame).map_err(|source| TrainError::File { path: self.path.clone(), source })
    }
}

impl Observer for EventWriter {
    fn on_start(&mut self, plan: &Plan) -> Result<(), TrainError> {
        self.stage = plan.stage;
        Ok(())
    }

    fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
        let scalars = [
            ("/batch/loss", report.loss),
            ("/batch/gradient_norm", report.gradient_norm as f32),
            ("/batch/learning_rate", report.learning_rate as f32),
        ];
        self.scalars(report.steps, scalars)
    }

    fn on_epoch(&mut self, report: &EpochReport<'_>) -> Result<(), TrainError> {
        let record = report.record;
        let tags: Vec<String> = record.validation.iter().map(|score| format!("/validation/{}", score.name)).collect();
        let validation = tags.iter().zip(&record.validation).map(|(tag, score)| (tag.as_str(), score.value));
        let train = [
            ("/train/loss", record.train_loss),
            ("/train/learning_rate", record.learning_rate),
            ("/train/windows_per_second", report.windows_per_second as f32),
        ];
        self.scalars(record.epoch as u64, train.into_iter().chain(validation))?;
        self.flush()
    }
}

/// Seconds since 1970; 0 on a clock set before.
fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0., |duration| duration.as_secs_f64())
}

/// CRC-32C, rotated and shifted by a constant: the CRC of data that hold CRCs is weak without it.
fn masked_crc(bytes: &[u8]) -> [u8; 4] {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::{EpochRecord, ValidationScore};

    fn read(path: &Path) -> Vec<Event> {
        let bytes = fs::read(path).unwrap();
        let mut rest = &bytes[..];
        let mut take = |n: usize| {
            let (head, tail) = rest.split_at(n);
            rest = tail;
            head.to_vec()
        };
        let mut events = Vec::new();
        let mut left = bytes.len();
        while left > 0 {
            let length = take(8);
            assert_eq!(take(4), masked_crc(&length));
            let n = u64::from_le_bytes(length.try_into().unwrap()) as usize;
            let event = take(n);
            assert_eq!(take(4), masked_crc(&event));
            events.push(Event::decode(&event[..]).unwrap());
            left -= 16 + n;
        }
        events
    }

    fn scalars(event: &Event) -> Vec<(&str, f32)> {
        match &event.what {
            Some(What::Summary(summary)) => summary.value.iter().map(|s| (s.tag.as_str(), s.simple_value)).collect(),
            _ => Vec::new(),
        }
    }

    #[test]
    fn the_mask_is_that_of_the_format() {
        // The version event at time 0, framed byte by byte as TensorFlow 2 writes it: the frame of
        // 24 bytes begins with the length and its CRC.
        assert_eq!(crc32c::crc32c(b"123456789"), 0xe306_9283);
        assert_eq!(masked_crc(&24u64.to_le_bytes()), [0xa3, 0x7f, 0x4b, 0x22]);
    }

    #[test]
    fn frames_read_back_with_their_checks() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = EventWriter::create(&folder.path().join("logs")).unwrap();
        let plan = Plan { stage: "goal", epochs: 3, batches: 2, windows: 7, validation_windows: 5, done: 0 };
        writer.on_start(&plan).unwrap();
        let batch = BatchReport {
            epoch: 1,
            batch: 2,
            steps: 41,
            windows: 3,
            loss: 0.5,
            gradient_norm: 2.,
            learning_rate: 0.25,
        };
        writer.on_batch(&batch).unwrap();
        let validation = vec![
            ValidationScore { name: "loss".into(), value: 1.5 },
            ValidationScore { name: "fde".into(), value: 6. },
        ];
        let record = EpochRecord { epoch: 1, steps: 41, learning_rate: 0.25, train_loss: 0.75, validation };
        let report = EpochReport { record: &record, best: true, seconds: 2., windows_per_second: 3.5 };
        writer.on_epoch(&report).unwrap();

        let events = read(writer.path());
        assert_eq!(events[0].what, Some(What::FileVersion("brain.Event:2".into())));
        assert!(events[0].wall_time > 1.7e9);
        assert_eq!(events[1].step, 41);
        let expected = [("goal/batch/loss", 0.5), ("goal/batch/gradient_norm", 2.), ("goal/batch/learning_rate", 0.25)];
        assert_eq!(scalars(&events[1]), expected);
        assert_eq!(events[2].step, 1);
        let expected = [
            ("goal/train/loss", 0.75),
            ("goal/train/learning_rate", 0.25),
            ("goal/train/windows_per_second", 3.5),
            ("goal/validation/loss", 1.5),
            ("goal/validation/fde", 6.),
        ];
        assert_eq!(scalars(&events[2]), expected);
        assert_eq!(events.len(), 3);
    }

    #[test]
    fn two_writers_in_one_second_have_two_files() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (EventWriter::create(folder.path()).unwrap(), EventWriter::create(folder.path()).unwrap());
        assert_ne!(a.path(), b.path());
    }
}
