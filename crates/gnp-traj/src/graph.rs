//! The roll-out as a graph of candle operations: the reference for every other form of it.

use std::sync::Arc;

use candle_core::{Module, Result, Tensor};
use candle_nn::ops::sigmoid;
use gnp_force::{Arity, TermDescriptor};
use gnp_nn::{LaunchCache, Linear, Lstm, LstmState, Mlp};

use crate::network::{SocialForce, strength};
use crate::roll_out::Sizes;
use crate::weights::HistoryEncoder;
use crate::{Integrator, NeighbourStates, Phase, RollOut, RollOutBatch, TermRollOut, TrajConfig, laws};

/// Rows are windows times goals; every tensor below has them first.
pub(crate) fn roll_out(network: &SocialForce, batch: &RollOutBatch, sizes: Sizes, phase: Phase) -> Result<RollOut> {
    let _sent = LaunchCache::on(batch.observed.device());
    let (cfg, net, terms) = (&network.cfg, &network.net, &network.terms);
    let [encoder1, encoder2] = &net.history_encoders;
    let per_goal = |x: &Tensor| repeat(x, sizes.goals);
    let start = per_goal(&batch.observed.narrow(1, sizes.observed - 1, 1)?.squeeze(1)?)?;
    let (mut p, mut v) = (start.narrow(1, 0, 2)?.contiguous()?, start.narrow(1, 2, 2)?.contiguous()?);
    let goal = batch.goals.flatten(0, 1)?;
    let goal_latent = net.enc_goal.forward(&(&goal * cfg.input_scale.position)?)?;

    let history = |history_encoder: &HistoryEncoder<Linear, Lstm>| -> Result<Option<LstmState>> {
        let seen = observe(history_encoder, cfg, &batch.observed)?;
        Ok(Some(LstmState { h: per_goal(&seen.h)?, c: per_goal(&seen.c)? }))
    };
    let mut memory1 = if sizes.pull { history(encoder1)? } else { None };
    let mut memory2 = if sizes.k || sizes.k_line { history(encoder2)? } else { None };
    let neighbours = Slots::new(batch, sizes)?;
    let lines = LineRows::new(batch, sizes)?;

    let (mut tau, mut k, mut k_line) = (None, None, None);
    let mut record = Record::default();
    for step in 0..batch.steps {
        let around = neighbours.as_ref().map(|slots| slots.at(step, &p, &v)).transpose()?;
        let lateral = lines.as_ref().map(|lines| lines.distance(&p)).transpose()?;
        if step % cfg.network_period == 0 {
            if step > 0 {
                let state = Tensor::cat(&[(&p * cfg.input_scale.position)?, (&v * cfg.input_scale.velocity)?], 1)?;
                for (encoder, memory) in [(encoder1, &mut memory1), (encoder2, &mut memory2)] {
                    if let Some(seen) = memory {
                        *seen = encoder.step(&state, Some(seen))?;
                    }
                }
            }
            if let Some(memory) = &memory1 {
                let latent = Tensor::cat(&[encoder1.latent(memory)?, goal_latent.clone()], 1)?;
                let fresh = ((sigmoid(&net.tau.forward(&latent)?)? * cfg.tau_max)? + batch.dt)?;
                tau = Some(if phase == Phase::Repulsion { fresh.detach() } else { fresh });
            }
            if let Some(memory) = &memory2 {
                let latent = encoder2.latent(memory)?;
                if let (Some(slots), Some(around), true) = (&neighbours, &around, sizes.k) {
                    let seen = scaled(cfg, around)?;
                    k = Some(fresh(&net.enc_nei, &net.k, &latent, &seen, cfg.k_max, &slots.present)?);
                }
                if let (Some(lines), Some(d), true) = (&lines, &lateral, sizes.k_line) {
                    let seen = Tensor::stack(&[d, &lines.kind], 2)?;
                    k_line = Some(fresh(&net.enc_line, &net.k_line, &latent, &seen, cfg.k_max_line, &lines.present)?);
                }
            }
        }
        let left = (batch.steps - step) as f64 * batch.dt;
        let mut force = None;
        if let Some(tau) = &tau {
            let pull = laws::goal_force(&p, &v, &goal, left, tau)?;
            record.add(&terms.goal, pull.unsqueeze(1)?, vec![tau.clone()]);
            force = Some(pull);
        }
        let mut add = |push: Tensor| -> Result<()> {
            force = Some(match force.take() {
                Some(force) => (force + push)?,
                None => push,
            });
            Ok(())
        };
        if let (Some(around), Some(k)) = (&around, &k) {
            let r = p.unsqueeze(1)?.broadcast_sub(&around.narrow(2, 0, 2)?)?;
            let push = laws::vehicle_force(&r, k, cfg.r_col)?;
            add(push.sum(1)?)?;
            record.add(&terms.neighbours, push, vec![k.clone()]);
        }
        if let (Some(lines), Some(d), Some(k)) = (&lines, &lateral, &k_line) {
            let push = laws::line_force(&lines.kind, d, k, &lines.side)?;
            let y = push.sum_keepdim(1)?;
            add(Tensor::cat(&[y.zeros_like()?, y], 1)?)?;
            record.add(&terms.lines, Tensor::stack(&[push.zeros_like()?, push], 2)?, vec![k.clone()]);
        }
        for term in terms.fixed() {
            let (sources, present) = match (term.descriptor.arity, &around, &neighbours, &lines) {
                (Arity::One, ..) => (goal.unsqueeze(1)?, None),
                (Arity::PerNeighbour, Some(around), Some(slots), _) => (around.clone(), Some(&slots.present)),
                (Arity::PerLine, _, _, Some(lines)) => (lines.sources()?, Some(&lines.present)),
                _ => continue,
            };
            let push = term.on_tensors(&Tensor::cat(&[&p, &v], 1)?, &sources, present, left)?;
            add(push.sum(1)?)?;
            let (rows, count, _) = push.dims3()?;
            let varying = term.descriptor.parameters.iter().zip(&term.parameters).filter(|(known, _)| known.varies);
            let held = varying.map(|(_, value)| {
                let held = Tensor::full(*value, (rows, count), p.device())?;
                present.map_or(Ok(held.clone()), |present| held * present)
            });
            record.add(&term.descriptor, push, held.collect::<Result<_>>()?);
        }
        let faster = match force {
            Some(force) => (&v + (force * batch.dt)?)?,
            None => v.clone(),
        };
        p = match cfg.integrator {
            Integrator::ExplicitEuler => (&p + (&v * batch.dt)?)?,
            _ => (&p + (&faster * batch.dt)?)?,
        };
        v = faster;
        record.path.push(p.clone());
        record.velocity.push(v.clone());
    }
    record.finish(sizes)
}

/// `[windows, ..]` to `[windows * goals, ..]`, every window `goals` times in a row.
fn repeat(x: &Tensor, goals: usize) -> Result<Tensor> {
    if goals == 1 {
        return Ok(x.clone());
    }
    let mut shape = x.dims().to_vec();
    shape.insert(1, goals);
    x.unsqueeze(1)?.broadcast_as(shape)?.flatten(0, 1)
}

/// States `[.., 4]` as the networks see them.
fn scaled(cfg: &TrajConfig, states: &Tensor) -> Result<Tensor> {
    let (position, velocity) = (cfg.input_scale.position as f32, cfg.input_scale.velocity as f32);
    states.broadcast_mul(&Tensor::new(&[position, position, velocity, velocity], states.device())?)
}

/// The memory after every `network_period`-th observed frame, the last one included.
fn observe(history_encoder: &HistoryEncoder<Linear, Lstm>, cfg: &TrajConfig, observed: &Tensor) -> Result<LstmState> {
    let frames = observed.dim(1)?;
    let mut memory = None;
    for frame in ((frames - 1) % cfg.network_period..frames).step_by(cfg.network_period) {
        let states = scaled(cfg, &observed.narrow(1, frame, 1)?.squeeze(1)?)?;
        memory = Some(history_encoder.step(&states, memory.as_ref())?);
    }
    match memory {
        Some(memory) => Ok(memory),
        None => candle_core::bail!("no observed frame"),
    }
}

/// Strengths `[rows, slots]` of what is `seen` `[rows, slots, features]`, 0 where `present` is 0.
fn fresh(encoder: &Mlp, head: &Mlp, latent: &Tensor, seen: &Tensor, largest: f64, present: &Tensor) -> Result<Tensor> {
    let (rows, slots, features) = seen.dims3()?;
    let width = latent.dim(1)?;
    let seen = encoder.forward(&seen.reshape((rows * slots, features))?)?.reshape((rows, slots, width))?;
    let latent = latent.unsqueeze(1)?.broadcast_as((rows, slots, width))?;
    strength(head, &Tensor::cat(&[latent, seen], 2)?, largest)? * present
}

/// The neighbour slots by row.
struct Slots {
    goals: usize,
    /// `[rows, slots]`
    present: Tensor,
    source: Source,
}

/// Where the states of neighbours are read; zeros stand in empty slots.
enum Source {
    /// `[windows, steps, slots, 4]`
    Given(Tensor),
    /// Rows to look at `[windows * slots]` and what to add to their states `[windows, slots, 4]`.
    Joint { rows: Tensor, offset: Tensor },
}

impl Slots {
    fn new(batch: &RollOutBatch, sizes: Sizes) -> Result<Option<Self>> {
        let Some(neighbours) = batch.neighbours.as_ref().filter(|_| sizes.slots > 0) else { return Ok(None) };
        let mask = neighbours.present.ne(0f64)?;
        let source = match &neighbours.states {
            NeighbourStates::Given(states) => {
                let mask = mask.unsqueeze(1)?.unsqueeze(3)?.broadcast_as(states.shape())?;
                Source::Given(mask.where_cond(states, &states.zeros_like()?)?)
            }
            NeighbourStates::Joint { index, offset } => {
                let mask = mask.unsqueeze(2)?.broadcast_as(offset.shape())?;
                let offset = mask.where_cond(offset, &offset.zeros_like()?)?;
                let goals = Tensor::full(sizes.goals as u32, index.elem_count(), index.device())?;
                let rows = (index.flatten_all()? * goals)?;
                Source::Joint { rows, offset: Tensor::cat(&[&offset, &offset.zeros_like()?], 2)? }
            }
        };
        let present = repeat(&mask.to_dtype(neighbours.present.dtype())?, sizes.goals)?;
        Ok(Some(Self { goals: sizes.goals, present, source }))
    }

    /// The states `[rows, slots, 4]` that act in `step`, the rows being at `p` and `v`.
    fn at(&self, step: usize, p: &Tensor, v: &Tensor) -> Result<Tensor> {
        let states = match &self.source {
            Source::Given(states) => states.narrow(1, step, 1)?.squeeze(1)?,
            Source::Joint { rows, offset } => {
                let states = Tensor::cat(&[p, v], 1)?.index_select(rows, 0)?.reshape(offset.shape())?;
                (states + offset)?
            }
        };
        repeat(&states, self.goals)
    }
}

/// The lines by row, each `[rows, lines]`.
struct LineRows {
    y: Tensor,
    kind: Tensor,
    side: Tensor,
    present: Tensor,
}

impl LineRows {
    fn new(batch: &RollOutBatch, sizes: Sizes) -> Result<Option<Self>> {
        let Some(lines) = batch.lines.as_ref().filter(|_| sizes.lines > 0) else { return Ok(None) };
        let mask = lines.present.ne(0f64)?;
        let column = |i: usize| -> Result<Tensor> {
            let values = lines.lines.narrow(2, i, 1)?.squeeze(2)?.contiguous()?;
            repeat(&mask.where_cond(&values, &values.zeros_like()?)?, sizes.goals)
        };
        let present = repeat(&mask.to_dtype(lines.present.dtype())?, sizes.goals)?;
        Ok(Some(Self { y: column(0)?, kind: column(1)?, side: column(2)?, present }))
    }

    /// `(y, kind, side)` `[rows, lines, 3]`.
    fn sources(&self) -> Result<Tensor> {
        Tensor::stack(&[&self.y, &self.kind, &self.side], 2)
    }

    /// Signed distances `y - y_line` `[rows, lines]` of rows at `p`.
    fn distance(&self, p: &Tensor) -> Result<Tensor> {
        p.narrow(1, 1, 1)?.broadcast_sub(&self.y)
    }
}

/// What every step leaves behind, one entry a step.
#[derive(Default)]
struct Record {
    path: Vec<Tensor>,
    velocity: Vec<Tensor>,
    terms: Vec<TermSteps>,
}

/// A term in every step: forces `[rows, sources, 2]` and each parameter that varies, `rows * sources` values.
struct TermSteps {
    term: Arc<TermDescriptor>,
    forces: Vec<Tensor>,
    parameters: Vec<Vec<Tensor>>,
}

impl Record {
    /// A term in the next step.
    fn add(&mut self, term: &Arc<TermDescriptor>, forces: Tensor, parameters: Vec<Tensor>) {
        match self.terms.iter_mut().find(|steps| steps.term.name == term.name) {
            Some(steps) => {
                steps.forces.push(forces);
                steps.parameters.push(parameters);
            }
            None => {
                self.terms.push(TermSteps { term: term.clone(), forces: vec![forces], parameters: vec![parameters] })
            }
        }
    }

    fn finish(self, sizes: Sizes) -> Result<RollOut> {
        let stack = |steps: &[Tensor]| -> Result<Tensor> {
            let stacked = Tensor::stack(steps, 1)?;
            let mut shape = stacked.dims().to_vec();
            shape.splice(0..1, [sizes.batch, sizes.goals]);
            stacked.reshape(shape)
        };
        let term = |steps: TermSteps| -> Result<TermRollOut> {
            let parameter = |i: usize| {
                let values: Vec<Tensor> = steps.parameters.iter().filter_map(|values| values.get(i).cloned()).collect();
                stack(&values)
            };
            let count = steps.parameters.first().map_or(0, Vec::len);
            let parameters = (0..count).map(parameter).collect::<Result<_>>()?;
            Ok(TermRollOut { forces: stack(&steps.forces)?, parameters, term: steps.term })
        };
        Ok(RollOut {
            path: stack(&self.path)?,
            velocity: stack(&self.velocity)?,
            terms: self.terms.into_iter().map(term).collect::<Result<_>>()?,
        })
    }
}
