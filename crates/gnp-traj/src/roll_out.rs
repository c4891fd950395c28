//! What a roll-out is given and what it returns.

use std::sync::Arc;

use candle_core::{DType, Tensor};
use gnp_force::{Arity, TermDescriptor};

use crate::terms::Terms;
use crate::{TrajConfig, TrajError};

/// A batch of windows to roll out; tensors are `f32` unless said otherwise, in the window frame.
#[derive(Clone, Debug)]
pub struct RollOutBatch {
    /// Observed states `(x, y, vx, vy)` `[batch, t_obs, 4]`; the last one is where the roll-out starts.
    pub observed: Tensor,
    /// Goals `[batch, goals, 2]` in m, to be reached after the last step; training gives one a window.
    pub goals: Tensor,
    /// Who may push; ignored in [`Phase::Attraction`] unless a term of the caller's acts from neighbours.
    pub neighbours: Option<Neighbours>,
    /// Lane lines; ignored in [`Phase::Attraction`] and by a network configured without lines, unless a term of the
    /// caller's acts from lines.
    pub lines: Option<Lines>,
    /// Frame period, in s.
    pub dt: f64,
    /// Number of frames to predict.
    pub steps: usize,
}

/// The neighbour slots of every window.
#[derive(Clone, Debug)]
pub struct Neighbours {
    /// Where the neighbours are.
    pub states: NeighbourStates,
    /// 1 where the slot is taken, 0 where it is empty `[batch, slots]`; what stands in an empty slot
    /// has no effect.
    pub present: Tensor,
}

/// Where the neighbours are during the roll-out.
#[derive(Clone, Debug)]
pub enum NeighbourStates {
    /// States `(x, y, vx, vy)` `[batch, steps, slots, 4]` in the frame of the window they belong to.
    /// Entry `j` acts in step `j`, which leads from frame `j` to frame `j + 1` after the last observed.
    Given(Tensor),
    /// Every neighbour is itself a window of this batch and all are rolled out together. Each moves
    /// towards the first of its goals, whichever goal of the window it pushes is looked at.
    Joint {
        /// Row of the neighbour in this batch `[batch, slots]`, `u32`; any valid row in an empty slot.
        index: Tensor,
        /// What takes a position from the neighbour's frame to this window's, in m `[batch, slots, 2]`.
        offset: Tensor,
    },
}

/// The lane lines of every window, each parallel to x.
#[derive(Clone, Debug)]
pub struct Lines {
    /// `(y, kind, side)` `[batch, lines, 3]`: lateral position in m; 0 for a line between lanes, 1 for a
    /// road boundary; for a boundary +1 if the road lies to its left (greater y), -1 otherwise.
    pub lines: Tensor,
    /// 1 where there is a line, 0 where the entry is empty `[batch, lines]`; what stands in an empty
    /// entry has no effect.
    pub present: Tensor,
}

/// Which of the networks' forces act, and which weights a gradient reaches. Terms of the caller's own act in all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// The goal alone attracts; gradients reach phi_1.
    Attraction,
    /// All forces act; `tau` is taken as a constant, so that gradients reach phi_2 alone.
    Repulsion,
    /// All forces act; gradients reach all weights.
    Full,
}

/// How the roll-out is computed; both give the same path, and the same gradients to weights, goals and observations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// One operation with a hand-derived adjoint, for CPUs and neighbours that are given. It passes its gradient back once,
    /// and refuses neighbours or lines that ask for one.
    Fused,
    /// A graph of candle operations, for every device and for [`NeighbourStates::Joint`].
    Graph,
}

/// A roll-out with what led to it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RollOut {
    /// Positions after each step `[batch, goals, steps, 2]`, in m.
    pub path: Tensor,
    /// Velocities after each step `[batch, goals, steps, 2]`, in m/s.
    pub velocity: Tensor,
    /// The terms of the force that act, in the order in which they are added up.
    pub terms: Vec<TermRollOut>,
}

/// One term of the force in a roll-out.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TermRollOut {
    /// What it is called.
    pub term: Arc<TermDescriptor>,
    /// Acceleration in m/s² at the start of each step, of each source `[batch, goals, steps, sources, 2]`; 0 in empty slots
    /// and entries. Sources are 1, the neighbour slots or the lines.
    pub forces: Tensor,
    /// Each parameter that varies, as [`TermDescriptor::varying`] lists them, as many values as forces
    /// `[batch, goals, steps, sources]`; 0 in empty slots.
    pub parameters: Vec<Tensor>,
}

impl RollOut {
    /// The term of that name, if it acts.
    #[must_use]
    pub fn term(&self, name: &str) -> Option<&TermRollOut> {
        self.terms.iter().find(|term| term.term.name == name)
    }
}

impl TermRollOut {
    /// The parameter of that name, if it varies.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<&Tensor> {
        self.term.varying().position(|parameter| parameter.name == name).and_then(|i| self.parameters.get(i))
    }
}

/// The sizes of a checked batch, and what of it acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    pub(crate) batch: usize,
    pub(crate) observed: usize,
    pub(crate) goals: usize,
    /// Neighbour slots and lines that any term acts from.
    pub(crate) slots: usize,
    pub(crate) lines: usize,
    /// Whether the network's attraction, and its repulsion of neighbours and of lines act.
    pub(crate) pull: bool,
    pub(crate) k: bool,
    pub(crate) k_line: bool,
}

impl Sizes {
    /// Sources of a term.
    pub(crate) fn sources(&self, arity: Arity) -> usize {
        match arity {
            Arity::One => 1,
            Arity::PerNeighbour => self.slots,
            Arity::PerLine => self.lines,
        }
    }
}

impl RollOutBatch {
    /// The same numbers without a gradient to them.
    pub(crate) fn detached(&self) -> Self {
        let neighbours = self.neighbours.as_ref().map(|neighbours| {
            let states = match &neighbours.states {
                NeighbourStates::Given(states) => NeighbourStates::Given(states.detach()),
                joint @ NeighbourStates::Joint { .. } => joint.clone(),
            };
            Neighbours { states, present: neighbours.present.clone() }
        });
        let lines = |lines: &Lines| Lines { lines: lines.lines.detach(), present: lines.present.clone() };
        Self {
            observed: self.observed.detach(),
            goals: self.goals.detach(),
            neighbours,
            lines: self.lines.as_ref().map(lines),
            ..*self
        }
    }

    /// Takes the sizes apart; `slots` and `lines` are 0 where no term acts from them.
    pub(crate) fn check(&self, cfg: &TrajConfig, terms: &Terms, phase: Phase) -> Result<Sizes, TrajError> {
        let [batch, observed, _] = shape("observed", &self.observed, ["batch", "t_obs", "4"], [None, None, Some(4)])?;
        let [_, goals, _] = shape("goals", &self.goals, ["batch", "goals", "2"], [Some(batch), None, Some(2)])?;
        for (name, value) in [("observed", batch), ("observed", observed), ("goals", goals), ("steps", self.steps)] {
            if value == 0 {
                let problem = "is empty; give at least one window, frame, goal and step".to_owned();
                return Err(TrajError::Batch { name, problem });
            }
        }
        if !(self.dt.is_finite() && self.dt > 0.) {
            let problem = format!("is {} s; give the frame period, a positive number", self.dt);
            return Err(TrajError::Batch { name: "dt", problem });
        }
        let wanted = |arity| terms.fixed_from(arity);
        let [pull, repels, learned] = terms.learned(cfg, phase);
        let mut sizes = Sizes { batch, observed, goals, slots: 0, lines: 0, pull, k: false, k_line: false };
        if let Some(neighbours) = self.neighbours.as_ref().filter(|_| repels || wanted(Arity::PerNeighbour)) {
            sizes.slots = neighbours.check(batch, self.steps)?;
            sizes.k = repels && sizes.slots > 0;
        }
        if self.neighbours.is_none() && wanted(Arity::PerNeighbour) {
            let problem =
                "missing; a term acts from them, so give them, with none present if there are none".to_owned();
            return Err(TrajError::Batch { name: "neighbours", problem });
        }
        match &self.lines {
            Some(lines) if learned || wanted(Arity::PerLine) => {
                sizes.lines = lines.check(batch)?;
                sizes.k_line = learned && sizes.lines > 0;
            }
            None if wanted(Arity::PerLine) => {
                let problem = "missing; a term acts from them, so give the lane lines or leave the term out".to_owned();
                return Err(TrajError::Batch { name: "lines", problem });
            }
            None if learned => {
                let problem = "missing; give the lane lines or set traj.lines = false".to_owned();
                return Err(TrajError::Batch { name: "lines", problem });
            }
            _ => {}
        }
        Ok(sizes)
    }
}

impl Neighbours {
    fn check(&self, batch: usize, steps: usize) -> Result<usize, TrajError> {
        let [_, slots] = shape("neighbours.present", &self.present, ["batch", "slots"], [Some(batch), None])?;
        let (b, n) = (Some(batch), Some(slots));
        match &self.states {
            NeighbourStates::Given(states) => {
                let names = ["batch", "steps", "slots", "4"];
                shape("neighbours.states", states, names, [b, Some(steps), n, Some(4)])?;
            }
            NeighbourStates::Joint { index, offset } => {
                if index.dtype() != DType::U32 {
                    let problem = format!("holds {:?}; give row numbers as u32", index.dtype());
                    return Err(TrajError::Batch { name: "neighbours.index", problem });
                }
                shape("neighbours.index", index, ["batch", "slots"], [b, n])?;
                shape("neighbours.offset", offset, ["batch", "slots", "2"], [b, n, Some(2)])?;
                let highest = index.flatten_all()?.to_vec1::<u32>()?.into_iter().max();
                if let Some(highest) = highest.filter(|&row| row as usize >= batch) {
                    let problem = format!("names row {highest} of a batch of {batch}; rows count from 0");
                    return Err(TrajError::Batch { name: "neighbours.index", problem });
                }
            }
        }
        Ok(slots)
    }
}

impl Lines {
    fn check(&self, batch: usize) -> Result<usize, TrajError> {
        let [_, lines, _] = shape("lines.lines", &self.lines, ["batch", "lines", "3"], [Some(batch), None, Some(3)])?;
        shape("lines.present", &self.present, ["batch", "lines"], [Some(batch), Some(lines)])?;
        Ok(lines)
    }
}

/// The dimensions of `tensor`, or an error naming every expected one.
fn shape<const D: usize>(
    name: &'static str,
    tensor: &Tensor,
    names: [&str; D],
    wanted: [Option<usize>; D],
) -> Result<[usize; D], TrajError> {
    let found: Option<[usize; D]> = tensor.dims().try_into().ok();
    match found {
        Some(found) if found.iter().zip(wanted).all(|(&have, want)| want.is_none_or(|want| want == have)) => Ok(found),
        _ => {
            let sizes = names.iter().zip(wanted).map(|(name, want)| match want {
                Some(want) if name.parse::<usize>().is_err() => format!("{name} = {want}"),
                _ => (*name).to_owned(),
            });
            let expected = format!("[{}]", sizes.collect::<Vec<_>>().join(", "));
            Err(TrajError::Shape { name, found: tensor.dims().to_vec(), expected })
        }
    }
}
