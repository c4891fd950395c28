//! Recordings from files, to look at and to predict from.

use std::path::PathBuf;

use gnp_data::{Dataset, Recording, TrackOptions, WindowShape, read_with};

use crate::data::source::embedded_folder;
use crate::error::{Context as _, Result, bail};
use crate::machine::Machine;
use crate::predict::{Input, wrong_rate};

/// Which recordings are read.
#[derive(Clone, Debug, Default)]
pub struct RecordingsRequest {
    /// A file of tracks, or a folder of such files; without it, the real scenes of NGSIM that come with the project.
    pub input: Option<PathBuf>,
    /// Format of the tracks; found out where it is not given.
    pub format: Option<Dataset>,
    /// What is known of the road, for formats whose tracks lie in any plane.
    pub tracks: TrackOptions,
    /// Name of the one that is wanted; without it, all.
    pub recording: Option<String>,
}

/// Reads recordings that a model of windows like `shape` can predict; those of another rate are left out and noted.
///
/// # Errors
/// When there are none, one cannot be read, none has the rate of the model or a whole multiple of it, or none the name
/// that is asked for; [`Error::Stopped`](crate::Error).
pub fn recordings(request: &RecordingsRequest, shape: WindowShape, machine: &Machine) -> Result<Vec<Recording>> {
    let (root, format) = match &request.input {
        Some(input) => (input.clone(), request.format),
        None => (embedded_folder(Dataset::NGSIM)?, Some(Dataset::NGSIM)),
    };
    let input = Input::find(&root, format)?;
    input.notes.iter().for_each(|note| machine.progress.note(note));
    let work = machine.work("reading", input.sources.len(), "files");
    let (mut wanted, mut others, mut unfit) = (Vec::new(), Vec::new(), None);
    for (i, source) in input.sources.iter().enumerate() {
        machine.stop.check()?;
        work.at(i as u64, &source.name);
        let read = read_with(source, input.dataset, &request.tracks).with_context(|| source.name.clone())?;
        for (recording, report) in read {
            let name = recording.meta().name.clone();
            if request.recording.as_ref().is_some_and(|asked| *asked != name) {
                others.push(name);
                continue;
            }
            if shape.at_rate(recording.meta().rate_hz).is_none() {
                let why = wrong_rate(&recording, shape);
                machine.progress.note(&format!("left out: {why}"));
                unfit.get_or_insert(why);
                continue;
            }
            if request.input.is_some() {
                let remark = |remark: String| machine.progress.note(&format!("{name}: {remark}"));
                report.repeated_rows().into_iter().chain(report.remarks()).for_each(remark);
            }
            wanted.push(recording);
        }
    }
    work.at(input.sources.len() as u64, "");
    match (wanted.is_empty(), unfit, &request.recording) {
        (false, ..) => Ok(wanted),
        (true, Some(why), _) => Err(why),
        (true, None, Some(name)) => {
            others.truncate(20);
            bail!(Recordings, "{}: there is no recording {name}; there are {}", root.display(), others.join(", "))
        }
        (true, None, None) => bail!(Recordings, "{} holds no recordings", root.display()),
    }
}
