//! A batch as plain numbers, cut into chunks of windows.

use std::ops::Range;
use std::sync::Arc;

use candle_core::{DType, Result, Tensor};
use gnp_force::{Arity, Source, State, TermDescriptor};

use super::cuts::{Cuts, GROUP};
use super::layout::{HistoryEncoder, Net, Packed};
use super::values::RollOutValues;
use crate::network::SocialForce;
use crate::roll_out::Sizes;
use crate::terms::{Terms, line};
use crate::{Integrator, NeighbourStates, Phase, RollOutBatch};

/// Rows that one thread carries through all steps, at most: as many as use a weight often once it is fetched
/// (weights of the published size, 5 MB, come from the third cache at every step), and leave their own values near.
const ROWS: usize = 96;

/// Rows whose weight gradients are summed at once, at least: fewer would fetch the sums from memory for
/// too little work.
const GATHER: usize = 192;

/// The whole batch.
#[derive(Debug)]
pub(crate) struct Batch {
    pub(crate) sizes: Sizes,
    pub(crate) phase: Phase,
    pub(crate) steps: usize,
    /// The networks run at every `period`-th step.
    pub(crate) period: usize,
    pub(crate) dt: f32,
    pub(crate) r_col: f32,
    pub(crate) tau_max: f32,
    pub(crate) k_max: f32,
    pub(crate) k_max_line: f32,
    pub(crate) integrator: Integrator,
    pub(crate) terms: Arc<Terms>,
    /// Factors on `(x, y, vx, vy)` before they enter a network.
    pub(crate) scale: [f32; 4],
    pub(crate) values: RollOutValues,
    pub(crate) gather: Gather,
}

/// Steps whose weight gradients are summed at once: of windows, of rows, and of pairs with neighbours and with lines.
/// The largest group of the batch decides, so that it does not matter which groups a thread takes together.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gather {
    pub(crate) windows: usize,
    pub(crate) rows: usize,
    pub(crate) neighbours: usize,
    pub(crate) lines: usize,
}

impl Gather {
    fn new(sizes: Sizes, present: &[bool], line_present: &[bool]) -> Self {
        let steps = |rows: usize| GATHER.div_ceil(rows.max(1));
        let pairs = |present: &[bool], slots: usize| {
            let groups = present.chunks(GROUP * slots.max(1));
            let largest = groups.map(|group| group.iter().filter(|there| **there).count()).max();
            steps(largest.unwrap_or_default() * sizes.goals)
        };
        let windows = sizes.batch.min(GROUP);
        Self {
            windows: steps(windows),
            rows: steps(windows * sizes.goals),
            neighbours: pairs(present, sizes.slots),
            lines: pairs(line_present, sizes.lines),
        }
    }
}

impl Batch {
    /// Reads the tensors of a checked batch whose neighbours, if any act, are given.
    pub(crate) fn new(network: &SocialForce, batch: &RollOutBatch, sizes: Sizes, phase: Phase) -> Result<Self> {
        let mut read = RollOutValues {
            windows: sizes.batch,
            t_obs: sizes.observed,
            goals_each: sizes.goals,
            slots: sizes.slots,
            most_lines: sizes.lines,
            steps: batch.steps,
            dt: batch.dt,
            observed: values(&batch.observed)?,
            goals: values(&batch.goals)?,
            ..RollOutValues::default()
        };
        if let Some(neighbours) = batch.neighbours.as_ref().filter(|_| sizes.slots > 0) {
            match &neighbours.states {
                NeighbourStates::Given(given) => read.neighbours = values(given)?,
                NeighbourStates::Joint { .. } => candle_core::bail!("joint neighbours are rolled out by the graph"),
            }
            read.neighbour_present = values(&neighbours.present)?.into_iter().map(|v| v != 0.).collect();
        }
        if let Some(given) = batch.lines.as_ref().filter(|_| sizes.lines > 0) {
            read.lines = values(&given.lines)?;
            read.line_present = values(&given.present)?.into_iter().map(|v| v != 0.).collect();
        }
        Ok(Self::of(network, read, sizes, phase))
    }

    /// A batch of checked values.
    pub(crate) fn of(network: &SocialForce, values: RollOutValues, sizes: Sizes, phase: Phase) -> Self {
        let cfg = &network.cfg;
        let (position, velocity) = (cfg.input_scale.position as f32, cfg.input_scale.velocity as f32);
        Self {
            sizes,
            phase,
            steps: values.steps,
            period: cfg.network_period,
            dt: values.dt as f32,
            r_col: cfg.r_col as f32,
            tau_max: cfg.tau_max as f32,
            k_max: cfg.k_max as f32,
            k_max_line: cfg.k_max_line as f32,
            integrator: cfg.integrator,
            terms: Arc::clone(&network.terms),
            scale: [position, position, velocity, velocity],
            gather: Gather::new(sizes, &values.neighbour_present, &values.line_present),
            values,
        }
    }

    /// The windows in chunks for so many threads; chunks of whole groups, if gradients are to be summed. What comes
    /// out of a window does not depend on the others of its chunk, and gradients are summed by group.
    pub(crate) fn chunks(&self, threads: usize, in_groups: bool) -> Vec<Chunk<'_>> {
        let Sizes { batch, goals, .. } = self.sizes;
        let unit = if in_groups { GROUP } else { 1 };
        let units = batch.div_ceil(unit);
        let most = (ROWS / (unit * goals.max(1))).max(1);
        // A multiple of the threads, so that none waits for another's last chunk.
        let chunks = units.div_ceil(most).next_multiple_of(threads.max(1));
        let each = unit * units.div_ceil(chunks).max(1);
        (0..batch).step_by(each).map(|start| Chunk::new(self, start..(start + each).min(batch))).collect()
    }

    /// Times the networks run during the roll-out.
    pub(crate) fn runs(&self) -> usize {
        self.steps.div_ceil(self.period)
    }

    /// About how many values a tape holds for each window, were all slots occupied.
    pub(crate) fn tape_values_a_window(&self, net: &Net<Packed>) -> usize {
        let history_encoder =
            |history_encoder: &HistoryEncoder<Packed>| 2 * history_encoder.cell.inputs + history_encoder.cell.outputs();
        let head = |layers: &[Packed]| layers.iter().skip(1).map(|layer| layer.inputs).sum::<usize>();
        let Sizes { goals, slots, lines, .. } = self.sizes;
        let history_encoders: usize = net.history_encoders.iter().map(history_encoder).sum();
        let heads = head(&net.tau) + slots * head(&net.k) + lines * head(&net.k_line);
        self.seen() * history_encoders + goals * self.runs() * (history_encoders + heads)
    }

    /// The terms that act and how many sources each has, in the order in which they are added up.
    pub(crate) fn acting(&self) -> impl Iterator<Item = (&Arc<TermDescriptor>, usize)> {
        self.terms.acting(self.sizes)
    }

    /// The observed frame that is the `seen`-th one the networks see.
    pub(crate) fn frame(&self, seen: usize) -> usize {
        (self.sizes.observed - 1) % self.period + seen * self.period
    }

    /// Observed frames that the networks see.
    pub(crate) fn seen(&self) -> usize {
        self.sizes.observed.div_ceil(self.period)
    }
}

fn values(x: &Tensor) -> Result<Vec<f32>> {
    x.to_dtype(DType::F32)?.flatten_all()?.to_vec1()
}

/// Some windows of a batch. Rows are windows times goals.
#[derive(Debug)]
pub(crate) struct Chunk<'a> {
    pub(crate) batch: &'a Batch,
    pub(crate) windows: Range<usize>,
    pub(crate) neighbours: ActiveSlots,
    pub(crate) lines: ActiveSlots,
}

/// The occupied slots, and the pairs of a row and a slot in which they act.
#[derive(Debug, Default)]
pub(crate) struct ActiveSlots {
    /// Window of the chunk and slot of each that is present.
    pub(crate) occupied: Vec<(usize, usize)>,
    /// Row and index into `occupied`, for every row in order.
    pub(crate) pairs: Vec<(usize, usize)>,
    /// The pairs of the first row of each window, which are as many as `occupied`.
    first_rows: Vec<(usize, usize)>,
}

impl ActiveSlots {
    /// Makes room for so many entries, were all of them present.
    pub(crate) fn reserve(&mut self, windows: usize, slots: usize, goals: usize) {
        for (entries, count) in [(&mut self.occupied, 1), (&mut self.first_rows, 1), (&mut self.pairs, goals)] {
            entries.clear();
            entries.reserve(windows * slots * count);
        }
    }

    /// The entries of `windows` that are `present` `[windows, slots]`, in the memory of this one.
    fn filled(mut self, windows: Range<usize>, slots: usize, goals: usize, present: &[bool]) -> Self {
        let active = &mut self;
        for entries in [&mut active.occupied, &mut active.first_rows, &mut active.pairs] {
            entries.clear();
        }
        for (window, global) in windows.enumerate() {
            let first = active.occupied.len();
            let there = (0..slots).filter(|slot| present[global * slots + slot]);
            active.occupied.extend(there.map(|slot| (window, slot)));
            active.first_rows.extend((first..active.occupied.len()).map(|i| (window * goals, i)));
            for goal in 0..goals {
                active.pairs.extend((first..active.occupied.len()).map(|i| (window * goals + goal, i)));
            }
        }
        self
    }

    /// The pairs, or where the rows of a window are `alike` those of the first.
    pub(crate) fn distinct(&self, alike: bool) -> &[(usize, usize)] {
        if alike { &self.first_rows } else { &self.pairs }
    }
}

impl<'a> Chunk<'a> {
    fn new(batch: &'a Batch, windows: Range<usize>) -> Self {
        Self::in_memory(batch, windows, Default::default())
    }

    /// The chunk with its active neighbours and lines in this memory.
    pub(crate) fn in_memory(batch: &'a Batch, windows: Range<usize>, [neighbours, of_lines]: [ActiveSlots; 2]) -> Self {
        let (Sizes { goals, slots, lines, .. }, values) = (batch.sizes, &batch.values);
        Self {
            batch,
            neighbours: neighbours.filled(windows.clone(), slots, goals, &values.neighbour_present),
            lines: of_lines.filled(windows.clone(), lines, goals, &values.line_present),
            windows,
        }
    }

    /// The memory of its active neighbours and lines.
    pub(crate) fn into_memory(self) -> [ActiveSlots; 2] {
        [self.neighbours, self.lines]
    }

    /// Pairs of a row and a neighbour, and of a row and a line, whose strength the network sets.
    pub(crate) fn learned_pairs(&self) -> (usize, usize) {
        let Sizes { k, k_line, .. } = self.batch.sizes;
        let count = |acts: bool, slots: &ActiveSlots| if acts { slots.pairs.len() } else { 0 };
        (count(k, &self.neighbours), count(k_line, &self.lines))
    }

    /// Number of groups.
    pub(crate) fn groups(&self) -> usize {
        self.count().div_ceil(GROUP)
    }

    /// Where groups begin among the windows, and among the rows.
    pub(crate) fn cuts(&self) -> [Cuts; 2] {
        [1, self.batch.sizes.goals].map(|each| Cuts::of_windows(self.count(), each))
    }

    /// Where groups begin among occupied slots, and among their pairs with rows.
    pub(crate) fn cuts_of(&self, slots: &ActiveSlots) -> [Cuts; 2] {
        let goals = self.batch.sizes.goals.max(1);
        let occupied = slots.occupied.iter().map(|(window, _)| *window);
        let pairs = slots.pairs.iter().map(|(row, _)| row / goals);
        [Cuts::of_entries(self.count(), occupied), Cuts::of_entries(self.count(), pairs)]
    }

    /// Number of windows.
    pub(crate) fn count(&self) -> usize {
        self.windows.len()
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.count() * self.batch.sizes.goals
    }

    /// The state of a window at the `seen`-th frame that the networks see.
    pub(crate) fn observed(&self, window: usize, seen: usize) -> [f32; 4] {
        let frames = self.batch.sizes.observed;
        quad(&self.batch.values.observed, (self.windows.start + window) * frames + self.batch.frame(seen))
    }

    /// The goal of a row.
    pub(crate) fn goal(&self, row: usize) -> [f32; 2] {
        let at = 2 * (self.windows.start * self.batch.sizes.goals + row);
        [self.batch.values.goals[at], self.batch.values.goals[at + 1]]
    }

    /// The state of an occupied slot in a step.
    pub(crate) fn neighbour(&self, step: usize, occupied: usize) -> [f32; 4] {
        let (window, slot) = self.neighbours.occupied[occupied];
        let at = (self.windows.start + window) * self.batch.steps + step;
        quad(&self.batch.values.neighbours, at * self.batch.sizes.slots + slot)
    }

    /// `(y, kind, side)` of a line that is there.
    pub(crate) fn line(&self, occupied: usize) -> [f32; 3] {
        let (window, slot) = self.lines.occupied[occupied];
        let at = 3 * ((self.windows.start + window) * self.batch.sizes.lines + slot);
        let lines = &self.batch.values.lines;
        [lines[at], lines[at + 1], lines[at + 2]]
    }

    /// What a term of that arity acts from in a step: the goal of every row, or every occupied slot.
    pub(crate) fn sources(&self, arity: Arity, step: usize) -> impl Iterator<Item = Source<f32>> {
        let time_left = (self.batch.steps - step) as f32 * self.batch.dt;
        let (slots, rows) = match arity {
            Arity::One => (&[][..], self.rows()),
            Arity::PerNeighbour => (&self.neighbours.occupied[..], 0),
            Arity::PerLine => (&self.lines.occupied[..], 0),
        };
        let goals = (0..rows).map(move |row| Source::Goal { goal: self.goal(row).into(), time_left });
        let others = slots.iter().enumerate().map(move |(occupied, &(_, slot))| match arity {
            Arity::PerLine => line(self.line(occupied)),
            _ => {
                let [x, y, vx, vy] = self.neighbour(step, occupied);
                Source::Vehicle { slot, state: State::new(x, y, vx, vy) }
            }
        });
        goals.chain(others)
    }

    /// Every row with each of the [`sources`](Self::sources) of a term of that arity that acts on it, row by row.
    pub(crate) fn pairs<'s>(&self, arity: Arity, sources: &'s [Source<f32>]) -> impl Iterator<Item = Pair<'s>> {
        let (slots, goals) = match arity {
            Arity::One => (None, sources),
            Arity::PerNeighbour => (Some(&self.neighbours), &[][..]),
            Arity::PerLine => (Some(&self.lines), &[][..]),
        };
        let goals = goals.iter().enumerate().map(|(row, from)| Pair { row, slot: 0, from });
        let others = slots.into_iter().flat_map(move |slots| {
            let pair = |&(row, i): &(usize, usize)| Pair { row, slot: slots.occupied[i].1, from: &sources[i] };
            slots.pairs.iter().map(pair)
        });
        goals.chain(others)
    }
}

/// A row and what a term acts from on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair<'a> {
    pub(crate) row: usize,
    /// Neighbour slot or entry of a line; 0 for the goal.
    pub(crate) slot: usize,
    pub(crate) from: &'a Source<f32>,
}

fn quad(values: &[f32], index: usize) -> [f32; 4] {
    let at = 4 * index;
    [values[at], values[at + 1], values[at + 2], values[at + 3]]
}
