//! A forecast of tracks explained: no run, no recorded future.

use std::path::PathBuf;

use gnp_data::{Dataset, Predictor as _, Recording, TrackOptions, WindowShape, read_with};
use gnp_plot::Source as Words;

use super::find::{self, leader_part};
use super::{Explained, WhatIf, pictures};
use crate::error::{Result, bail};
use crate::machine::Machine;
use crate::model::Model;
use crate::predict::{Asked, At, Input};
use crate::what_if::{Moment, ScenePredictor, alike_or_all, cut, of_recording};

/// Which vehicle of which tracks, when, by which model, and what is changed.
#[derive(Clone, Debug, Default)]
pub struct TracksQuestion {
    /// A file of tracks, or a folder of such files.
    pub input: PathBuf,
    /// Model folder, run folder or name of a model that comes with the program; without it, the one that does.
    pub model: Option<PathBuf>,
    /// Format of the tracks; found out where it is not given.
    pub format: Option<Dataset>,
    /// What is known of the road, for formats whose tracks lie in any plane.
    pub tracks: TrackOptions,
    /// Name of the recording; without it, the one that has the vehicle.
    pub recording: Option<String>,
    /// What the tracks call the vehicle; without it, one that its leader moves far.
    pub vehicle: Option<String>,
    /// Time on the clock of the tracks, s; without it, the last frame of the vehicle, or of the recording.
    pub at_s: Option<f64>,
    /// What is changed in the scene.
    pub what_if: WhatIf,
}

/// Explains the forecast of a vehicle of some tracks; where less than the model needs was seen of it, from a past that is
/// filled.
///
/// # Errors
/// When there are no tracks, or they cannot be read; when nothing fits the question, naming what there is; when the scene
/// cannot be changed so.
pub fn explain_tracks(question: &TracksQuestion, machine: &Machine) -> Result<Explained> {
    let model = Model::open(question.model.as_deref(), machine)?;
    let input = Input::find(&question.input, question.format)?;
    input.notes.iter().for_each(|note| machine.progress.note(note));
    let recording = recording(question, &input, machine)?;
    let frame = frame(question, &recording, model.gnp().shape())?;
    let moment = Moment::at_frame(&recording, frame, model.gnp().shape())?;
    let gnp = model.gnp().clone().explaining(true);
    let asked_for = asked_for(question, &recording);
    let asked = |vehicle: u32| asked_for.is_none_or(|asked| asked == Some(vehicle));
    let fitting: Vec<_> =
        moment.snapshot().vehicles().filter(|it| asked(it.vehicle())).filter_map(|it| it.observation()).collect();
    let best = if fitting.len() > 1 {
        let parts: Vec<f32> = gnp.predict(&fitting, 1)?.iter().map(leader_part).collect();
        (0..parts.len()).max_by(|a, b| parts[*a].total_cmp(&parts[*b]).then(b.cmp(a)))
    } else {
        Some(0)
    };
    let Some(observation) = best.and_then(|best| fitting.get(best)).copied() else {
        let vehicles = moment.snapshot().vehicles();
        let predictable = vehicles.filter(|it| it.observation().is_some()).map(|it| it.vehicle());
        let there = find::listed(predictable, |vehicle| moment.name(vehicle));
        let who = question.vehicle.as_deref().map_or_else(|| "no vehicle".to_owned(), |name| format!("vehicle {name}"));
        bail!(
            Recordings,
            "{who} can be predicted in frame {frame} of {}; those that can: {there}",
            recording.meta().name
        );
    };
    let meta = recording.meta();
    let simulated = meta.simulated || model.card().data.simulated;
    let words = Words { words: format!("{} by the model {}", meta.name, model.card().name), simulated };
    let vehicle = observation.vehicle();
    let (changes, watched) = question.what_if.around(vehicle, &moment)?;
    let predictor = ScenePredictor::of(gnp, model.card().data.simulated);
    let (mut explained, changed) = predictor.told(&moment, watched, &changes, model.card().predict.k)?;
    explained.figures = pictures(&explained, None, (&moment, &changed), &changes, &words)?;
    Ok(explained)
}

/// The number of the vehicle that is asked for; `None` where any is.
fn asked_for(question: &TracksQuestion, recording: &Recording) -> Option<Option<u32>> {
    Some(recording.vehicle_named(question.vehicle.as_deref()?.trim()))
}

/// The one recording that fits.
fn recording(question: &TracksQuestion, input: &Input, machine: &Machine) -> Result<Recording> {
    let (mut found, mut others): (Option<Recording>, Vec<String>) = (None, Vec::new());
    for source in &input.sources {
        machine.stop.check()?;
        for (recording, report) in read_with(source, input.dataset, &question.tracks)? {
            let name = &recording.meta().name;
            let fits = question.recording.as_ref().is_none_or(|asked| asked == name)
                && asked_for(question, &recording) != Some(None);
            match &found {
                _ if !fits => others.push(match question.vehicle.as_deref() {
                    Some(asked) => format!("{name} (vehicles {})", alike_or_all(asked, of_recording(&recording))),
                    None => name.clone(),
                }),
                Some(earlier) => bail!(
                    Recordings,
                    "recordings {} and {name} fit: say which by --recording{}",
                    earlier.meta().name,
                    if question.vehicle.is_none() { ", or name a vehicle" } else { "" }
                ),
                None => {
                    let remark = |remark: String| machine.progress.note(&format!("{name}: {remark}"));
                    report.repeated_rows().into_iter().chain(report.remarks()).for_each(remark);
                    found = Some(recording);
                }
            }
        }
    }
    match found {
        Some(found) => Ok(found),
        None => {
            let who =
                question.vehicle.as_deref().map_or_else(String::new, |name| format!(" with a vehicle {}", cut(name)));
            let what = question
                .recording
                .as_deref()
                .map_or_else(|| "recording".to_owned(), |name| format!("recording {name}"));
            others.truncate(20);
            bail!(Recordings, "{}: there is no {what}{who}; there are {}", input.root.display(), others.join(", "))
        }
    }
}

/// The frame that is asked for.
fn frame(question: &TracksQuestion, recording: &Recording, shape: WindowShape) -> Result<u32> {
    let asked_for = asked_for(question, recording);
    let asked = recording.tracks().iter().filter(|track| asked_for.is_none_or(|asked| asked == Some(track.vehicle)));
    let last = asked.map(|track| track.last_frame()).max().unwrap_or(0);
    let Some(at_s) = question.at_s else { return Ok(last) };
    match Asked::of(recording, &At::Times(vec![at_s]), shape)?.frames().first() {
        Some(frame) => Ok(*frame),
        None => {
            let [from, to] = crate::predict::span_s(recording);
            bail!(Recordings, "{at_s} s is outside of {}, which goes from {from} to {to} s", recording.meta().name)
        }
    }
}
