//! Which recordings are read, and how that is said.

use std::path::{Path, PathBuf};

use gnp_data::{
    Copies, Dataset, Fingerprint, Format, Recording, Source, Taken, TrackOptions, format_of, read_with, survey,
};

use crate::config::RunConfig;
use crate::data::road::road_options;
use crate::error::{Result, bail};
use crate::machine::Machine;
use crate::run::folder::DataState;

/// Recordings that were found.
#[derive(Debug)]
pub(crate) struct Found {
    /// Where they are and what they are called in headings.
    pub(crate) data: DataState,
    /// The files, sorted by name.
    pub(crate) sources: Vec<Source>,
    /// Files that are there and are not read; a sentence each for the first.
    pub(crate) not_read: Vec<String>,
    /// What is known of the road.
    pub(crate) options: TrackOptions,
}

/// Finds the recordings of a run: those of `data_dir`, or those that come with the project.
///
/// # Errors
/// When there are none, or they are not what they seem; when the file of the road has none.
pub(crate) fn find(config: &RunConfig, data_dir: Option<&Path>) -> Result<Found> {
    let embedded = data_dir.is_none();
    let dir = match data_dir {
        Some(dir) => dir.to_owned(),
        None => embedded_folder(config.dataset)?,
    };
    let found = survey(&dir, config.dataset)?;
    let (not_read, mut sources) = (found.notes(), found.sources);
    if config.data.max_recordings > 0 {
        sources.truncate(config.data.max_recordings);
    }
    let simulated = sources.iter().any(|source| source.simulated);
    let description = description(format_of(config.dataset)?, embedded, simulated, &dir);
    let options = road_options(config.data.road.as_deref(), config.data.lane_lines.as_deref())?;
    let options = TrackOptions { rate_hz: Some(config.data.rate_hz), ..options };
    Ok(Found { data: DataState { dir, embedded, simulated, description }, sources, not_read, options })
}

/// All recordings of a folder, or those that come with the project, at whatever rate, without copies; what is not read or
/// left out is noted, and of a folder what was found in reading.
///
/// # Errors
/// When there are none, or one cannot be read, as where its tracks do not lie along the road that is given.
pub(crate) fn read_all(
    dataset: Dataset,
    data_dir: Option<&Path>,
    options: &TrackOptions,
    machine: &Machine,
) -> Result<Vec<Recording>> {
    let folder = data_dir.map_or_else(|| embedded_folder(dataset), |dir| Ok(dir.to_owned()))?;
    let found = survey(&folder, dataset)?;
    found.notes().iter().for_each(|note| machine.progress.note(note));
    let (mut copies, mut recordings) = (Copies::default(), Vec::<Recording>::new());
    for source in &found.sources {
        machine.stop.check()?;
        for (recording, report) in read_with(source, dataset, options)? {
            if data_dir.is_some() {
                let name = recording.meta().name.as_str();
                let remark = |remark: String| machine.progress.note(&format!("{name}: {remark}"));
                report.repeated_rows().into_iter().chain(report.remarks()).for_each(remark);
            }
            let left_out = match copies.take(Fingerprint::of(&recording))? {
                Taken::LeftOut(copy) => vec![copy],
                Taken::Kept(left_out) => {
                    recordings.retain(|earlier| left_out.iter().all(|copy| copy.recording != earlier.meta().name));
                    recordings.push(recording);
                    left_out
                }
            };
            left_out.iter().for_each(|copy| machine.progress.note(&copy.sentence()));
        }
    }
    Ok(recordings)
}

/// The folder of the recordings that come with the project's sources.
///
/// # Errors
/// [`Error::Recordings`](crate::Error::Recordings) where this crate was built outside of the project.
pub fn embedded_folder(dataset: Dataset) -> Result<PathBuf> {
    let fixtures = Path::new("fixtures").join(dataset.as_str());
    // Cargo says where the program that it runs comes from; compiled files outlive the checkout they were made in.
    let started = std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from);
    let places = started.into_iter().chain([PathBuf::from(env!("CARGO_MANIFEST_DIR"))]);
    let found = places.flat_map(|place| {
        let project = |above: &&Path| above.join("crates/gnp/Cargo.toml").is_file();
        place.ancestors().find(project).map(|above| above.join(&fixtures))
    });
    match found.into_iter().find(|folder| folder.is_dir()) {
        Some(folder) => Ok(folder),
        None => bail!(Recordings, "no recordings of {dataset} come with this program; give a folder of them"),
    }
}

fn description(format: &dyn Format, embedded: bool, simulated: bool, dir: &Path) -> String {
    let (title, of_sites) = (format.title(), format.sites().map_or_else(String::new, |sites| format!(" of {sites}")));
    match (embedded, simulated) {
        (true, false) => format!("real {title} scenes{of_sites} that come with the project"),
        (true, true) => format!(
            "*simulated* recordings in {title}'s file layout that come with the project; nothing measured on them is a \
             result about {title}"
        ),
        (false, true) => format!("*simulated* recordings in {}", dir.display()),
        (false, false) => format!("{title} recordings in {}", dir.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_is_always_said() {
        for format in gnp_data::FORMATS {
            for embedded in [true, false] {
                assert!(description(*format, embedded, true, Path::new("d")).contains("*simulated*"));
                assert!(!description(*format, embedded, false, Path::new("d")).contains("simulated"));
            }
        }
    }
}
