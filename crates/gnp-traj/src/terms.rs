//! The terms of the force: which there are and which act, and those that have fixed parameters.

use std::collections::BTreeMap;
use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp2, Device, Layout, Result, Shape, Tensor};
use gnp_force::na::{Point2, Vector2};
use gnp_force::{
    Arity, ForceTerm, GoalAttraction, LineRepulsion, MarkingKind, Side, Source, State, TermDescriptor, VehicleRepulsion,
};
use gnp_nn::LaunchCache;
use serde::{Deserialize, Serialize};

use crate::roll_out::Sizes;
use crate::{Phase, TrajConfig, TrajError};

/// A term of `gnp_force` that acts in every step, with fixed parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TermConfig {
    /// Its name in the table of `gnp_force`.
    pub name: String,
    /// The value of each of its parameters, by name.
    pub parameters: BTreeMap<String, f64>,
}

/// The terms of a network: those whose parameters it sets, then the others.
#[derive(Clone, Debug)]
pub(crate) struct Terms {
    pub(crate) goal: Arc<TermDescriptor>,
    pub(crate) neighbours: Arc<TermDescriptor>,
    pub(crate) lines: Arc<TermDescriptor>,
    fixed: Vec<FixedTerm>,
    /// Names of those that are switched off.
    off: Vec<String>,
}

impl Terms {
    pub(crate) fn new() -> Self {
        let described = |law: &dyn ForceTerm<f32>| Arc::new(law.descriptor().clone());
        Self {
            goal: described(&GoalAttraction),
            neighbours: described(&VehicleRepulsion),
            lines: described(&LineRepulsion),
            fixed: Vec::new(),
            off: Vec::new(),
        }
    }

    /// All that there are, in the order in which they are added up.
    pub(crate) fn all(&self, cfg: &TrajConfig) -> impl Iterator<Item = &Arc<TermDescriptor>> {
        let learned = [&self.goal, &self.neighbours].into_iter().chain(cfg.lines.then_some(&self.lines));
        learned.chain(self.fixed.iter().map(|term| &term.descriptor))
    }

    /// Whether the network's attraction, its repulsion of neighbours and that of lines act, as far as terms decide.
    pub(crate) fn learned(&self, cfg: &TrajConfig, phase: Phase) -> [bool; 3] {
        let repels = phase != Phase::Attraction;
        [self.is_on(&self.goal), repels && self.is_on(&self.neighbours), repels && cfg.lines && self.is_on(&self.lines)]
    }

    /// Those with fixed parameters that act.
    pub(crate) fn fixed(&self) -> impl Iterator<Item = &FixedTerm> {
        self.fixed.iter().filter(|term| self.is_on(&term.descriptor))
    }

    /// Whether a term with fixed parameters acts from sources of this kind.
    pub(crate) fn fixed_from(&self, arity: Arity) -> bool {
        self.fixed().any(|term| term.descriptor.arity == arity)
    }

    /// Whether any term acts from sources of this kind.
    pub(crate) fn act_from(&self, arity: Arity, cfg: &TrajConfig, phase: Phase) -> bool {
        let [goal, neighbours, lines] = self.learned(cfg, phase);
        let learned = match arity {
            Arity::One => goal,
            Arity::PerNeighbour => neighbours,
            Arity::PerLine => lines,
        };
        learned || self.fixed_from(arity)
    }

    /// Those that act in a batch of these sizes and how many sources each has, in the order in which they are added up.
    pub(crate) fn acting(&self, sizes: Sizes) -> impl Iterator<Item = (&Arc<TermDescriptor>, usize)> {
        let learned = [(&self.goal, sizes.pull), (&self.neighbours, sizes.k), (&self.lines, sizes.k_line)];
        let learned = learned.into_iter().filter(|(_, acts)| *acts).map(|(term, _)| term);
        let all = learned.chain(self.fixed().map(|term| &term.descriptor));
        all.map(move |term| (term, sizes.sources(term.arity))).filter(|(_, sources)| *sources > 0)
    }

    fn is_on(&self, term: &TermDescriptor) -> bool {
        !self.off.iter().any(|name| *name == term.name)
    }

    /// Switches terms off by name.
    pub(crate) fn switch_off(&mut self, names: &[&str], cfg: &TrajConfig) -> std::result::Result<(), TrajError> {
        for name in names {
            if self.all(cfg).all(|term| term.name != *name) {
                let known: Vec<&str> = self.all(cfg).map(|term| &*term.name).collect();
                let problem = format!("is no term of this network; there are {}", known.join(", "));
                return Err(TrajError::Term { name: (*name).to_owned(), problem });
            }
            self.off.push((*name).to_owned());
        }
        Ok(())
    }

    /// Adds a term unless there is one of its name.
    pub(crate) fn add(&mut self, term: FixedTerm, cfg: &TrajConfig) -> std::result::Result<(), TrajError> {
        let name = &term.descriptor.name;
        let published = [&self.goal, &self.neighbours, &self.lines];
        if published.iter().any(|other| other.name == *name && **other != term.descriptor) {
            let problem = "is the name of a published term; take another".to_owned();
            return Err(TrajError::Term { name: name.to_string(), problem });
        }
        if self.all(cfg).any(|other| other.name == *name) {
            let problem = "acts already; a name stands for one term".to_owned();
            return Err(TrajError::Term { name: name.to_string(), problem });
        }
        self.fixed.push(term);
        Ok(())
    }
}

/// A law and the parameters it acts with.
#[derive(Clone, Debug)]
pub(crate) struct FixedTerm {
    pub(crate) descriptor: Arc<TermDescriptor>,
    pub(crate) law: Arc<dyn ForceTerm<f32>>,
    pub(crate) parameters: Vec<f32>,
}

impl FixedTerm {
    pub(crate) fn new(law: Arc<dyn ForceTerm<f32>>, parameters: &[f64]) -> std::result::Result<Self, TrajError> {
        let descriptor = Arc::new(law.descriptor().clone());
        let refuse = |problem| Err(TrajError::Term { name: descriptor.name.to_string(), problem });
        if parameters.len() != descriptor.parameters.len() {
            let names: Vec<&str> = descriptor.parameters.iter().map(|parameter| &*parameter.name).collect();
            return refuse(format!("has the parameters {names:?}, {} values were given", parameters.len()));
        }
        if let Some(value) = parameters.iter().find(|value| !value.is_finite()) {
            return refuse(format!("a parameter is {value}; give finite numbers"));
        }
        let parameters = parameters.iter().map(|value| *value as f32).collect();
        Ok(Self { descriptor, law, parameters })
    }

    pub(crate) fn configured(config: &TermConfig) -> std::result::Result<Self, TrajError> {
        let refuse = |problem| TrajError::Term { name: config.name.clone(), problem };
        let law = gnp_force::term::<f32>(&config.name).ok_or_else(|| {
            let known = gnp_force::terms::<f32>().map(|term| term.descriptor().name.clone());
            refuse(format!("is no term; there are {}", known.join(", ")))
        })?;
        let known = &law.descriptor().parameters;
        if let Some(name) = config.parameters.keys().find(|name| known.iter().all(|known| known.name != **name)) {
            return Err(refuse(format!("has no parameter `{name}`")));
        }
        let value = |name: &str| {
            config.parameters.get(name).copied().ok_or_else(|| refuse(format!("needs a value of `{name}`")))
        };
        let values: Vec<f64> =
            known.iter().map(|parameter| value(&parameter.name)).collect::<std::result::Result<_, _>>()?;
        Self::new(Arc::new(law), &values)
    }

    /// The force of every source `[rows, sources, 2]` on rows at `state` `[rows, 4]`, with a gradient to both.
    ///
    /// `sources` `[rows, sources, ..]` are goals `(x, y)` with `time_left` s left, vehicles `(x, y, vx, vy)` or lines
    /// `(y, kind, side)`; where `present` `[rows, sources]` is 0 there is none.
    pub(crate) fn on_tensors(
        &self,
        state: &Tensor,
        sources: &Tensor,
        present: Option<&Tensor>,
        time_left: f64,
    ) -> Result<Tensor> {
        let present = present.map(|present| present.flatten_all()?.to_vec1::<f32>()).transpose()?;
        let act = Act { term: self.clone(), present, time_left: time_left as f32 };
        let cpu = |x: &Tensor| moved(x, &Device::Cpu);
        moved(&cpu(state)?.apply_op2(&cpu(sources)?, act)?, state.device())
    }
}

/// `x` on `device`, contiguous; what moves, and its gradient, is longer than what a launch cache would keep.
fn moved(x: &Tensor, device: &Device) -> Result<Tensor> {
    if x.device().same_device(device) {
        return x.contiguous();
    }
    let (flat, count) = (x.flatten_all()?, x.elem_count());
    let rest = (LaunchCache::KEPT / size_of::<f32>() + 1).saturating_sub(count);
    let long = if rest > 0 { flat.pad_with_zeros(0, 0, rest)? } else { flat };
    long.to_device(device)?.narrow(0, 0, count)?.reshape(x.shape())
}

/// A goal, a vehicle or a line from the numbers that stand for it in a tensor.
pub(crate) fn source(arity: Arity, slot: usize, values: &[f32], time_left: f32) -> Option<Source<f32>> {
    match (arity, values) {
        (Arity::One, &[x, y]) => Some(Source::Goal { goal: Point2::new(x, y), time_left }),
        (Arity::PerNeighbour, &[x, y, vx, vy]) => Some(Source::Vehicle { slot, state: State::new(x, y, vx, vy) }),
        (Arity::PerLine, &[y, kind, side]) => Some(line([y, kind, side])),
        _ => None,
    }
}

/// A line from `(y, kind, side)`.
pub(crate) fn line([y, kind, side]: [f32; 3]) -> Source<f32> {
    Source::Line {
        kind: if kind > 0.5 { MarkingKind::Boundary } else { MarkingKind::LaneDivider },
        y,
        road: if side < 0. { Side::Right } else { Side::Left },
    }
}

/// One step of a term as an operation on state and sources.
struct Act {
    term: FixedTerm,
    present: Option<Vec<f32>>,
    time_left: f32,
}

impl Act {
    /// Calls `f` with the index, the state and the source of every pair that is there.
    fn each(
        &self,
        states: &[f32],
        sources: &[f32],
        count: usize,
        width: usize,
        mut f: impl FnMut(usize, State<f32>, Source<f32>),
    ) {
        let arity = self.term.descriptor.arity;
        for (i, values) in sources.chunks_exact(width.max(1)).enumerate() {
            if self.present.as_ref().is_some_and(|present| present[i] == 0.) {
                continue;
            }
            let at = 4 * (i / count);
            let state = State::new(states[at], states[at + 1], states[at + 2], states[at + 3]);
            if let Some(source) = source(arity, i % count, values, self.time_left) {
                f(i, state, source);
            }
        }
    }
}

impl CustomOp2 for Act {
    fn name(&self) -> &'static str {
        "force-term"
    }

    fn cpu_fwd(
        &self,
        states: &CpuStorage,
        state_layout: &Layout,
        sources: &CpuStorage,
        source_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (rows, count, width) = source_layout.shape().dims3()?;
        let (Some(at), Some(of)) = (state_layout.contiguous_offsets(), source_layout.contiguous_offsets()) else {
            candle_core::bail!("states and sources of a force term are strided")
        };
        let (states, sources) = (&states.as_slice::<f32>()?[at.0..at.1], &sources.as_slice::<f32>()?[of.0..of.1]);
        let mut forces = vec![0.; rows * count * 2];
        self.each(states, sources, count, width, |i, state, source| {
            let force = self.term.law.force(&state, &source, &self.term.parameters);
            forces[2 * i..2 * i + 2].copy_from_slice(force.as_slice());
        });
        Ok((CpuStorage::F32(forces), (rows, count, 2).into()))
    }

    fn bwd(
        &self,
        states: &Tensor,
        sources: &Tensor,
        _forces: &Tensor,
        dforces: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (_, count, width) = sources.dims3()?;
        let flat = |x: &Tensor| x.flatten_all()?.to_vec1::<f32>();
        let (at, of, dforces) = (flat(states)?, flat(sources)?, flat(dforces)?);
        let (mut dstates, mut dsources) = (vec![0.; at.len()], vec![0.; of.len()]);
        let mut dparameters = vec![0.; self.term.parameters.len()];
        self.each(&at, &of, count, width, |i, state, source| {
            let dforce = Vector2::new(dforces[2 * i], dforces[2 * i + 1]);
            let vjp = self.term.law.vjp(&state, &source, &self.term.parameters, dforce, &mut dparameters);
            let row = &mut dstates[4 * (i / count)..][..4];
            for (sum, value) in row.iter_mut().zip(vjp.position.iter().chain(vjp.velocity.iter())) {
                *sum += value;
            }
            let (p, v) = (vjp.source_position, vjp.source_velocity);
            let gradient = match source {
                Source::Line { .. } => [p.y, 0., 0., 0.],
                _ => [p.x, p.y, v.x, v.y],
            };
            dsources[i * width..(i + 1) * width].copy_from_slice(&gradient[..width]);
        });
        let tensor = |values, like: &Tensor| Tensor::from_vec(values, like.shape(), like.device());
        Ok((Some(tensor(dstates, states)?), Some(tensor(dsources, sources)?)))
    }
}
