//! The work of a prediction, shared by several threads: each takes a piece of a recording, or reads the next file.

use std::cmp::Ordering;
use std::collections::{BTreeMap, VecDeque};
use std::ops::ControlFlow;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

use gnp_data::{
    IngestReport, Part as FormatPart, PartSize, Past, Recording, Source, TrackOptions, WindowKey, format_of,
};
use gnp_eval::{ForecastOf, ForecastWriter};
use gnp_model::Gnp;

use super::moments::{Asked, At, Moments, Unpredicted, forecasts};
use super::output::{Output, Part};
use super::{Counts, Input, predictor};
use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::progress::Work;

/// Vehicles at a moment in a piece, at least: what is written as a group of rows and done again after a kill.
const PIECE: usize = 512;
/// Remarks on what was left out in reading that are made, at most.
const REMARKS: usize = 24;
/// Rows of a part of a recording that is read in parts, at most: some 100 MB while it is read.
const PART_ROWS: usize = 1_000_000;
/// Time before what a model looks back on that a part holds as well, s: velocities of its first rows need it.
const BEFORE_S: f64 = 1.;
/// Pieces that wait, for each worker, before who reads helps with them: they hold recordings in memory.
const WAITING: usize = 2;

/// What is asked of which tracks.
pub(super) struct Queue<'a> {
    pub(super) input: &'a Input,
    pub(super) output: &'a Output,
    pub(super) tracks: &'a TrackOptions,
    pub(super) at: &'a At,
    pub(super) k: usize,
    pub(super) machine: &'a Machine,
}

/// A source that is worked on.
struct Open<'a> {
    source: &'a Source,
    state: Mutex<OpenState>,
}

#[derive(Default)]
struct OpenState {
    counts: Counts,
    /// By part of the source and piece.
    parts: BTreeMap<(usize, usize), Part>,
    /// Pieces that are not done, and one while it is read.
    pending: usize,
}

/// A piece of a recording.
struct Piece<'a> {
    open: Arc<Open<'a>>,
    recording: Arc<Recording>,
    /// Number of the part in its source, and of the piece in the part.
    number: (usize, usize),
    asked: Asked,
}

/// What the workers share.
struct Shared<'a> {
    state: Mutex<State<'a>>,
    changed: Condvar,
    progress: Mutex<Box<dyn Work>>,
}

#[derive(Default)]
struct State<'a> {
    next_source: usize,
    pieces: VecDeque<Piece<'a>>,
    /// Workers that read, and may add pieces.
    reading: usize,
    failed: Option<Error>,
    counts: Counts,
    /// What was left out or assumed in reading.
    remarks: usize,
    /// Forecasts, of sources that are not finished, too.
    made: u64,
    finished_sources: usize,
    finished_before: usize,
}

/// What a worker does next.
enum Next<'a> {
    Piece(Piece<'a>),
    Source(&'a Source),
    Nothing,
}

/// A panic of another worker is reported where the threads are joined.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<'a> Queue<'a> {
    /// Does everything with so many workers; returns what was predicted, and how many sources were finished before.
    ///
    /// # Errors
    /// The first thing that goes wrong; [`Error::Stopped`] with the place of what is done.
    pub(super) fn work(&'a self, gnp: &Gnp, jobs: usize) -> Result<(Counts, usize)> {
        let total = self.input.sources.len();
        let progress = Mutex::new(self.machine.work("predict", total, "files"));
        let shared = Shared { state: Mutex::default(), changed: Condvar::new(), progress };
        thread::scope(|scope| -> Result<()> {
            for _ in 1..jobs {
                let predictor = predictor(gnp, jobs)?;
                scope.spawn(|| self.worker(predictor, &shared, jobs));
            }
            self.worker(predictor(gnp, jobs)?, &shared, jobs);
            Ok(())
        })?;
        let state = shared.state.into_inner().unwrap_or_else(PoisonError::into_inner);
        match state.failed {
            Some(error) if error.is_stopped() => Err(Error::Stopped { kept: Some(self.output.kept()) }),
            Some(error) => Err(error),
            None => Ok((state.counts, state.finished_before)),
        }
    }

    fn worker(&'a self, gnp: Gnp, shared: &Shared<'a>, jobs: usize) {
        loop {
            let done = match self.next(shared) {
                Next::Piece(piece) => self.piece(piece, &gnp, shared),
                Next::Source(source) => {
                    let done = self.source(source, &gnp, shared, jobs);
                    locked(&shared.state).reading -= 1;
                    shared.changed.notify_all();
                    done
                }
                Next::Nothing => return,
            };
            if let Err(error) = done {
                locked(&shared.state).failed.get_or_insert(error);
                shared.changed.notify_all();
            }
        }
    }

    fn next(&'a self, shared: &Shared<'a>) -> Next<'a> {
        let mut state = locked(&shared.state);
        loop {
            if state.failed.is_none()
                && let Err(stopped) = self.machine.stop.check()
            {
                state.failed = Some(stopped);
            }
            if state.failed.is_some() {
                return Next::Nothing;
            }
            if let Some(piece) = state.pieces.pop_front() {
                return Next::Piece(piece);
            }
            if let Some(source) = self.input.sources.get(state.next_source) {
                state.next_source += 1;
                state.reading += 1;
                return Next::Source(source);
            }
            if state.reading == 0 {
                return Next::Nothing;
            }
            state = shared.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Reads a source and hands out its pieces.
    fn source(&'a self, source: &'a Source, gnp: &Gnp, shared: &Shared<'a>, jobs: usize) -> Result<()> {
        if let Some(counts) = self.output.begin_source(self.input, source)? {
            {
                let mut state = locked(&shared.state);
                state.finished_before += 1;
                state.made += counts.forecasts;
            }
            self.finished(&counts, &source.name, shared);
            return Ok(());
        }
        let open = OpenState { pending: 1, ..OpenState::default() };
        let open = Arc::new(Open { source, state: Mutex::new(open) });
        let mut reading = Reading { queue: self, gnp, shared, jobs, open: &open, number: 0, moments: None, held: None };
        let size = PartSize::new(PART_ROWS, gnp.shape().observed_s() + BEFORE_S);
        let mut failed = None;
        format_of(self.input.dataset)?.read_parts(
            source,
            self.tracks,
            &size,
            &mut |part| match reading.take(part) {
                Ok(()) => ControlFlow::Continue(()),
                Err(error) => {
                    failed = Some(error);
                    ControlFlow::Break(())
                }
            },
        )?;
        if let Some(error) = failed {
            return Err(error);
        }
        reading.end()?;
        self.one_less(&open, shared)
    }

    /// Predicts a piece, unless an earlier call did.
    fn piece(&self, piece: Piece<'a>, gnp: &Gnp, shared: &Shared<'a>) -> Result<()> {
        let Piece { open, recording, number, asked } = piece;
        let name = &recording.meta().name;
        let part = self.output.part(self.input, open.source, (number.0, name), number.1);
        let counts = match part.finished() {
            Some(counts) => counts,
            None => self.predict(&recording, &asked, gnp, &part)?,
        };
        let (done, made) = {
            let mut state = locked(&shared.state);
            state.made += counts.forecasts;
            (state.finished_sources, state.made)
        };
        locked(&shared.progress).at(done as u64, &format!("{name}, {made} forecasts"));
        {
            let mut state = locked(&open.state);
            state.counts.add(&counts);
            state.parts.insert(number, part);
        }
        self.one_less(&open, shared)
    }

    /// Writes a part.
    fn predict(&self, recording: &Recording, asked: &Asked, gnp: &Gnp, part: &Part) -> Result<Counts> {
        let mut writer = ForecastWriter::create(&part.path, &self.output.provenance)?;
        let mut counts = Counts::default();
        let left_out = forecasts(gnp, recording, asked, self.k, |made| {
            self.machine.stop.check()?;
            let seen = &made.observation;
            let key = WindowKey { t0: made.frame, ..seen.key() };
            let filled = made.past != Past::Full;
            let of = ForecastOf {
                vehicle_name: &recording.vehicle_name(seen.vehicle()),
                time_s: recording.meta().time_s(made.frame),
                past: if filled { "filled" } else { "full" },
                observed_s: made.observed_s,
                origin: seen.origin(),
                why: made.why(recording),
                key: &key,
            };
            let road = seen.road();
            writer.write(&of, &made.forecast, |at| recording.to_file_coordinates(road, at))?;
            counts.forecasts += 1;
            counts.filled += u64::from(filled);
            Ok(())
        })?;
        leave_out(&mut counts, &left_out);
        if counts.forecasts > 0 {
            writer.finish()?;
        }
        part.finish(&counts)?;
        Ok(counts)
    }

    /// One piece of a source less, or its reading: the last one finishes it.
    fn one_less(&self, open: &Open<'a>, shared: &Shared<'a>) -> Result<()> {
        let mut state = locked(&open.state);
        state.pending -= 1;
        if state.pending > 0 {
            return Ok(());
        }
        let OpenState { counts, parts, .. } = std::mem::take(&mut *state);
        let parts: Vec<Part> = parts.into_values().collect();
        self.output.finish_source(self.input, open.source, &parts, counts.clone())?;
        self.finished(&counts, &open.source.name, shared);
        Ok(())
    }

    /// Says what was left out or assumed in reading, of the first recordings.
    fn remark(&self, name: &str, report: &IngestReport, shared: &Shared<'a>) {
        for remark in report.repeated_rows().into_iter().chain(report.remarks()) {
            let said = {
                let mut state = locked(&shared.state);
                state.remarks += 1;
                state.remarks
            };
            match said.cmp(&REMARKS) {
                Ordering::Less => self.machine.progress.note(&format!("{name}: {remark}")),
                Ordering::Equal => self.machine.progress.note("more is left out or assumed in other recordings"),
                Ordering::Greater => {}
            }
        }
    }

    fn finished(&self, counts: &Counts, name: &str, shared: &Shared<'a>) {
        let (done, made) = {
            let mut state = locked(&shared.state);
            state.counts.add(counts);
            state.finished_sources += 1;
            (state.finished_sources, state.made)
        };
        locked(&shared.progress).at(done as u64, &format!("{name}, {made} forecasts"));
    }
}

/// A source while it is read: whole recordings, or one in parts.
struct Reading<'q, 'a> {
    queue: &'a Queue<'a>,
    gnp: &'q Gnp,
    shared: &'q Shared<'a>,
    jobs: usize,
    open: &'q Arc<Open<'a>>,
    /// Of the part that is read next.
    number: usize,
    /// Those of the recording whose parts are read, by its name.
    moments: Option<(String, Moments<'a>)>,
    /// The part before, of which is not known yet whether it is the last of its recording.
    held: Option<FormatPart>,
}

impl Reading<'_, '_> {
    /// Takes the next part, and hands out the one before.
    fn take(&mut self, part: FormatPart) -> Result<()> {
        self.queue.machine.stop.check()?;
        let same = self.held.as_ref().is_some_and(|held| held.recording.meta().name == part.recording.meta().name);
        self.hand_out(!same)?;
        self.held = Some(part);
        Ok(())
    }

    /// Hands out the last part.
    fn end(&mut self) -> Result<()> {
        self.hand_out(true)
    }

    fn hand_out(&mut self, last: bool) -> Result<()> {
        let Some(FormatPart { recording, report, asked, .. }) = self.held.take() else { return Ok(()) };
        let Queue { at, .. } = *self.queue;
        let name = recording.meta().name.clone();
        let (_, moments) = match &mut self.moments {
            Some(of) if of.0 == name => of,
            other => {
                locked(&self.open.state).counts.recordings += 1;
                self.queue.remark(&name, &report, self.shared);
                other.insert((name, Moments::new(at, self.gnp.shape())))
            }
        };
        let asked = moments.of(&recording, &asked, last)?;
        let outside = if last { moments.outside() } else { BTreeMap::new() };
        let pieces = asked.pieces(&recording, PIECE);
        {
            let mut state = locked(&self.open.state);
            state.pending += pieces.len();
            leave_out(&mut state.counts, asked.left_out());
            leave_out(&mut state.counts, &outside);
        }
        let recording = Arc::new(recording);
        for (piece, asked) in pieces.into_iter().enumerate() {
            let (open, recording) = (Arc::clone(self.open), Arc::clone(&recording));
            let mut state = locked(&self.shared.state);
            state.pieces.push_back(Piece { open, recording, number: (self.number, piece), asked });
            let help = if state.pieces.len() > WAITING * self.jobs { state.pieces.pop_front() } else { None };
            drop(state);
            self.shared.changed.notify_all();
            if let Some(piece) = help {
                self.queue.machine.stop.check()?;
                self.queue.piece(piece, self.gnp, self.shared)?;
            }
        }
        self.number += 1;
        if last {
            self.moments = None;
        }
        Ok(())
    }
}

fn leave_out(counts: &mut Counts, left_out: &BTreeMap<Unpredicted, u64>) {
    for (why, count) in left_out {
        *counts.left_out.entry(why.to_string()).or_default() += count;
    }
}
