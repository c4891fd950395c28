//! A scene as plain numbers, cut into chunks of windows.

use std::ops::Range;

use candle_core::{DType, Result, Tensor};
use gnp_force::{LineKind, Side};

use super::layout::{HistoryEncoder, Net, Packed};
use crate::scene::Sizes;
use crate::{Integrator, NeighbourStates, Phase, Scene, TrajConfig};

/// Windows that one thread carries through all steps. A fixed number, so that sums come in the same
/// order on any number of threads; 8 to 32 take the same time within a few per cent.
const WINDOWS: usize = 16;

/// The whole scene.
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
    /// Factors on `(x, y, vx, vy)` before they enter a network.
    pub(crate) scale: [f32; 4],
    observed: Vec<f32>,
    goals: Vec<f32>,
    states: Vec<f32>,
    present: Vec<bool>,
    lines: Vec<f32>,
    line_present: Vec<bool>,
}

impl Batch {
    /// Reads the tensors of a checked scene whose neighbours, if any act, are given.
    pub(crate) fn new(cfg: &TrajConfig, scene: &Scene, sizes: Sizes, phase: Phase) -> Result<Self> {
        let (mut states, mut present, mut lines, mut line_present) = (vec![], vec![], vec![], vec![]);
        if let Some(neighbours) = scene.neighbours.as_ref().filter(|_| sizes.slots > 0) {
            match &neighbours.states {
                NeighbourStates::Given(given) => states = values(given)?,
                NeighbourStates::Joint { .. } => candle_core::bail!("joint neighbours are rolled out by the graph"),
            }
            present = values(&neighbours.present)?.into_iter().map(|v| v != 0.).collect();
        }
        if let Some(given) = scene.lines.as_ref().filter(|_| sizes.lines > 0) {
            lines = values(&given.lines)?;
            line_present = values(&given.present)?.into_iter().map(|v| v != 0.).collect();
        }
        let (position, velocity) = (cfg.input_scale.position as f32, cfg.input_scale.velocity as f32);
        Ok(Self {
            sizes,
            phase,
            steps: scene.steps,
            period: cfg.network_period,
            dt: scene.dt as f32,
            r_col: cfg.r_col as f32,
            tau_max: cfg.tau_max as f32,
            k_max: cfg.k_max as f32,
            k_max_line: cfg.k_max_line as f32,
            integrator: cfg.integrator,
            scale: [position, position, velocity, velocity],
            observed: values(&scene.observed)?,
            goals: values(&scene.goals)?,
            states,
            present,
            lines,
            line_present,
        })
    }

    /// The windows in chunks.
    pub(crate) fn chunks(&self) -> Vec<Chunk<'_>> {
        let starts = (0..self.sizes.batch).step_by(WINDOWS);
        starts.map(|start| Chunk::new(self, start..(start + WINDOWS).min(self.sizes.batch))).collect()
    }

    /// Times the networks run during the roll-out.
    pub(crate) fn runs(&self) -> usize {
        self.steps.div_ceil(self.period)
    }

    /// About how many values the tape of a full chunk holds, were all slots occupied.
    pub(crate) fn tape_values(&self, net: &Net<Packed>) -> usize {
        let history_encoder =
            |history_encoder: &HistoryEncoder<Packed>| 2 * history_encoder.cell.inputs + history_encoder.cell.outputs();
        let head = |layers: &[Packed]| layers.iter().skip(1).map(|layer| layer.inputs).sum::<usize>();
        let Sizes { goals, slots, lines, .. } = self.sizes;
        let history_encoders: usize = net.history_encoders.iter().map(history_encoder).sum();
        let heads = head(&net.tau) + slots * head(&net.k) + lines * head(&net.k_line);
        WINDOWS * (self.seen() * history_encoders + goals * self.runs() * (history_encoders + heads))
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

/// The slots that are occupied, and by which rows they are pairs.
#[derive(Debug, Default)]
pub(crate) struct ActiveSlots {
    /// Window of the chunk and slot of each that is present.
    pub(crate) occupied: Vec<(usize, usize)>,
    /// Row and index into `occupied`, for every row in order.
    pub(crate) pairs: Vec<(usize, usize)>,
}

impl ActiveSlots {
    fn new(windows: Range<usize>, slots: usize, goals: usize, present: &[bool]) -> Self {
        let mut active = Self::default();
        for (window, global) in windows.enumerate() {
            let first = active.occupied.len();
            let there = (0..slots).filter(|slot| present[global * slots + slot]);
            active.occupied.extend(there.map(|slot| (window, slot)));
            for goal in 0..goals {
                active.pairs.extend((first..active.occupied.len()).map(|i| (window * goals + goal, i)));
            }
        }
        active
    }
}

impl<'a> Chunk<'a> {
    fn new(batch: &'a Batch, windows: Range<usize>) -> Self {
        let Sizes { goals, slots, lines, .. } = batch.sizes;
        Self {
            batch,
            neighbours: ActiveSlots::new(windows.clone(), slots, goals, &batch.present),
            lines: ActiveSlots::new(windows.clone(), lines, goals, &batch.line_present),
            windows,
        }
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
        let frame = (frames - 1) % self.batch.period + seen * self.batch.period;
        quad(&self.batch.observed, (self.windows.start + window) * frames + frame)
    }

    /// The goal of a row.
    pub(crate) fn goal(&self, row: usize) -> [f32; 2] {
        let at = 2 * (self.windows.start * self.batch.sizes.goals + row);
        [self.batch.goals[at], self.batch.goals[at + 1]]
    }

    /// The state of a occupied slot in a step.
    pub(crate) fn neighbour(&self, step: usize, occupied: usize) -> [f32; 4] {
        let (window, slot) = self.neighbours.occupied[occupied];
        let at = (self.windows.start + window) * self.batch.steps + step;
        quad(&self.batch.states, at * self.batch.sizes.slots + slot)
    }

    /// A line that is there.
    pub(crate) fn line(&self, occupied: usize) -> Line {
        let (window, slot) = self.lines.occupied[occupied];
        let at = 3 * ((self.windows.start + window) * self.batch.sizes.lines + slot);
        let kind = self.batch.lines[at + 1];
        Line {
            y: self.batch.lines[at],
            feature: kind,
            kind: if kind > 0.5 { LineKind::Boundary } else { LineKind::LaneDivider },
            side: if self.batch.lines[at + 2] < 0. { Side::Right } else { Side::Left },
        }
    }
}

/// A lane line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    pub(crate) y: f32,
    /// The kind as the network sees it.
    pub(crate) feature: f32,
    pub(crate) kind: LineKind,
    pub(crate) side: Side,
}

fn quad(values: &[f32], index: usize) -> [f32; 4] {
    let at = 4 * index;
    [values[at], values[at + 1], values[at + 2], values[at + 3]]
}
