//! What a stream gives for a frame.

use gnp_model::{Forecasts, TermTotals};

use crate::error::Reason;

/// What the forecast of a vehicle rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Validity {
    /// A past as long as the model's, with a sample in nearly every of its frames.
    Full,
    /// A shorter past: what is missing before it is filled at constant velocity.
    Filled {
        /// Time that it was seen for, s.
        observed_s: f64,
    },
    /// A full past with a gap of more than one and a half frames of the model, which is interpolated, or not yet ended.
    Interpolated {
        /// Largest time between two samples, s.
        gap_s: f64,
    },
    /// No forecast.
    Not(Reason),
}

/// A track that was not taken as it came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Problem {
    /// Id of the track.
    pub id: u64,
    /// Its place in the list of tracks.
    pub row: usize,
    /// What is wrong, and what was done.
    pub reason: Reason,
}

/// A vehicle of the output.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub(crate) id: u64,
    /// Its place among the vehicles remembered.
    pub(crate) place: usize,
    /// Centre now, road frame, m.
    pub(crate) road: [f64; 2],
    /// The same in the caller's coordinates.
    pub(crate) position: [f64; 2],
    pub(crate) age_s: f64,
    pub(crate) gap_s: f64,
    pub(crate) validity: Validity,
    /// Its place among the forecasts.
    pub(crate) window: Option<usize>,
}

/// The output of a frame, in memory that is used again.
#[derive(Debug, Default)]
pub(crate) struct Output {
    pub(crate) time_s: f64,
    pub(crate) model_s: f64,
    pub(crate) entries: Vec<Entry>,
    pub(crate) problems: Vec<Problem>,
    pub(crate) forecasts: Forecasts,
    /// In the caller's coordinates, m, `[windows, modes, steps]`.
    pub(crate) paths: Vec<[f64; 2]>,
}

/// The forecasts of a frame, borrowed from its stream until the next one.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    pub(crate) output: &'a Output,
}

impl<'a> Frame<'a> {
    /// Time of the frame, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.output.time_s
    }

    /// Time that the model took for it, s; the rest of a [`push`](crate::Stream::push) is the stream's own.
    #[must_use]
    pub fn model_s(&self) -> f64 {
        self.output.model_s
    }

    /// The vehicles: those of the tracks in their order, then those missing, by id.
    pub fn vehicles(&self) -> impl ExactSizeIterator<Item = Vehicle<'a>> + use<'a> {
        let output = self.output;
        output.entries.iter().map(move |entry| Vehicle { output, entry })
    }

    /// The vehicle of that id.
    #[must_use]
    pub fn get(&self, id: u64) -> Option<Vehicle<'a>> {
        self.vehicles().find(|vehicle| vehicle.id() == id)
    }

    /// Tracks that were not taken as they came.
    #[must_use]
    pub fn problems(&self) -> &'a [Problem] {
        &self.output.problems
    }

    /// Paths of each vehicle that is predicted.
    #[must_use]
    pub fn modes(&self) -> usize {
        self.output.forecasts.modes()
    }

    /// Points of each path; the first is one frame of the model after now.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.output.forecasts.steps()
    }

    /// All paths, m, in the coordinates of the tracks, `[predicted vehicles, modes, steps]`; [`Vehicle::window`] says
    /// where those of a vehicle are.
    #[must_use]
    pub fn paths(&self) -> &'a [[f64; 2]] {
        &self.output.paths
    }

    /// All probabilities, `[predicted vehicles, modes]`.
    #[must_use]
    pub fn probabilities(&self) -> &'a [f32] {
        self.output.forecasts.probabilities()
    }

    /// The terms of the force with their accelerations along all paths, m/s², along the road and to the left,
    /// `[predicted vehicles, modes, steps]`; none unless the model is [explaining](gnp_model::Gnp::explaining).
    #[must_use]
    pub fn terms(&self) -> &'a [TermTotals] {
        self.output.forecasts.terms()
    }
}

/// A vehicle of a [`Frame`].
#[derive(Clone, Copy, Debug)]
pub struct Vehicle<'a> {
    output: &'a Output,
    entry: &'a Entry,
}

impl<'a> Vehicle<'a> {
    /// Who it is.
    #[must_use]
    pub fn id(&self) -> u64 {
        self.entry.id
    }

    /// What its forecast rests on.
    #[must_use]
    pub fn validity(&self) -> Validity {
        self.entry.validity
    }

    /// Centre at the time of the frame, m: as given, or where it is taken to be while it is missing.
    #[must_use]
    pub fn position(&self) -> [f64; 2] {
        self.entry.position
    }

    /// Time since it was seen last, s; 0 if it is in the frame.
    #[must_use]
    pub fn age_s(&self) -> f64 {
        self.entry.age_s
    }

    /// Largest time between two of the samples that its past is made of, s; 0 of one sample.
    #[must_use]
    pub fn gap_s(&self) -> f64 {
        self.entry.gap_s
    }

    /// Its place among the forecasts of the frame; `None` without a forecast.
    #[must_use]
    pub fn window(&self) -> Option<usize> {
        self.entry.window
    }

    /// Probability of each path, `[modes]`, summing to 1; the first path is the prediction, the others follow by falling
    /// probability. Empty without a forecast.
    #[must_use]
    pub fn probabilities(&self) -> &'a [f32] {
        let forecasts = &self.output.forecasts;
        self.row(forecasts.probabilities(), 0, forecasts.modes())
    }

    /// One of its paths, m, in the coordinates of the tracks, `[steps]`. Empty where there is none.
    #[must_use]
    pub fn path(&self, mode: usize) -> &'a [[f64; 2]] {
        if mode < self.output.forecasts.modes() { self.row(&self.output.paths, mode, 1) } else { &[] }
    }

    /// Acceleration by one of [`Frame::terms`] along one of its paths, m/s², along the road and to the left, `[steps]`.
    /// Empty where there is none.
    #[must_use]
    pub fn force(&self, term: usize, mode: usize) -> &'a [[f32; 2]] {
        self.entry.window.map_or(&[], |window| self.output.forecasts.force(term, window, mode))
    }

    /// From `[windows, modes, ...]` the part of this vehicle from `mode` on: one path, or a number a mode.
    fn row<T>(&self, values: &'a [T], mode: usize, count: usize) -> &'a [T] {
        let (modes, windows) = (self.output.forecasts.modes(), self.output.forecasts.windows());
        let Some(window) = self.entry.window else { return &[] };
        let each = values.len() / (modes * windows).max(1);
        let first = (window * modes + mode) * each;
        values.get(first..first + count * each).unwrap_or_default()
    }
}
