//! Prediction on the caller's thread, into memory that is used again.

use gnp_baselines::{ActingTerms, PlatoonRoom, PlatoonRule};
use gnp_data::{Observation, PredictError, Predictor, SLOTS, Slot, nearest_to_mean};
use gnp_goal::{GoalWorkspace, PackedGoalNet};
use gnp_traj::{Arity, Phase, RollOutWorkspace, RolledOut, SocialForce};

use crate::error::ModelError;
use crate::features::{Features, WindowInputs};
use crate::forecasts::Forecasts;
use crate::gnp::{Gnp, predict_error};
use crate::scene::{NeighbourFuture, line_values};
use crate::select::{Choice, Selection};
use crate::situation::{Following, Situation};

/// Rows (windows times goals) that are rolled out together: as many as use a weight often once it is fetched, and leave
/// their own values near.
const ROWS: usize = 96;

/// What [`Gnp::predict_into`] keeps from one call to the next: memory, no state. Any model may use it, though one alone
/// at a time; a change of the model makes it grow anew.
#[derive(Debug, Default)]
pub struct Workspace {
    lean: bool,
    following: Following,
    platoon: PlatoonRoom,
    inputs: WindowInputs,
    goal: GoalWorkspace,
    choice: Choice,
    /// Where the modes of a window end, m.
    ends: Vec<[f32; 2]>,
    /// How far a lateral motion has come to rest as each step sets out.
    settling: Vec<f64>,
    roll_out: RollOutWorkspace,
    of_windows: OfWindows,
}

/// What is kept of the windows that are rolled out together.
#[derive(Debug, Default)]
struct OfWindows {
    /// How far the moving frame is after each step, m, `[windows, steps]`.
    frames: Vec<f32>,
    /// What accelerates the platoon's target in each step, m/s², by term, `[windows, 3, steps]`; none without platoon.
    accelerations: Vec<f32>,
    /// Number of lane lines.
    lines: Vec<usize>,
}

impl OfWindows {
    fn clear(&mut self) {
        self.frames.clear();
        self.accelerations.clear();
        self.lines.clear();
    }
}

impl Workspace {
    /// Without any memory yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether the last call went without candle and without allocations, but for those that make the memory large
    /// enough: see [`Gnp::predict_into`].
    #[must_use]
    pub fn is_lean(&self) -> bool {
        self.lean
    }
}

/// The parts of a model that predicts without candle.
#[derive(Clone, Copy)]
struct Lean<'a> {
    gnp: &'a Gnp,
    features: &'a Features,
    goal: &'a PackedGoalNet,
    force: &'a SocialForce,
    phase: Phase,
}

impl Gnp {
    /// As [`Predictor::predict`], into `out`, on the caller's thread: the same forecasts but for rounding (below 0.01 mm on
    /// a path, where goals are not equally good but for that), whatever other windows are in the call.
    ///
    /// A model with physics on a CPU that chooses goals by medoids (all shipped configurations) allocates nothing here, once
    /// `workspace` and `out` have seen as many windows, with as many goals and lane lines. Another one, such as with joint neighbours,
    /// goes by way of [`Predictor::predict`]: [`Workspace::is_lean`] tells.
    ///
    /// # Errors
    /// As [`Predictor::predict`]; what `out` then holds is left open.
    pub fn predict_into(
        &self,
        observations: &[Observation<'_>],
        k: usize,
        workspace: &mut Workspace,
        out: &mut Forecasts,
    ) -> Result<(), PredictError> {
        let lean = self.lean();
        workspace.lean = lean.is_some();
        match lean {
            Some(lean) => lean.predict(observations, k, workspace, out).map_err(|e| predict_error(self.name, e)),
            None => {
                out.copy_from(&self.predict(observations, k)?);
                Ok(())
            }
        }
    }

    fn lean(&self) -> Option<Lean<'_>> {
        let trained = &*self.trained;
        let (goal, (force, phase)) = (trained.packed.as_deref()?, trained.force.as_ref()?);
        let served = force.is_packed()
            && self.neighbours != NeighbourFuture::Joint
            && matches!(self.selection, Selection::Medoids | Selection::Central);
        served.then_some(Lean { gnp: self, features: &trained.features, goal, force, phase: *phase })
    }
}

impl Lean<'_> {
    fn predict(
        self,
        observations: &[Observation<'_>],
        k: usize,
        workspace: &mut Workspace,
        out: &mut Forecasts,
    ) -> Result<(), ModelError> {
        let k = k.min(self.goal.modes()).max(1);
        out.reset([observations.len(), k, self.features.shape().t_pred], self.gnp.explain);
        workspace.settling.clear();
        workspace.settling.extend(self.features.settling());
        let together = (ROWS / k).max(1);
        for (i, some) in observations.chunks(together).enumerate() {
            self.set_out(some, k, workspace, (i * together, &mut *out))?;
            let rolled_out = self.force.roll_out_into(self.phase, self.gnp.explain, &mut workspace.roll_out)?;
            put_paths(&rolled_out, &workspace.of_windows, i * together, out)?;
            if self.gnp.explain {
                put_terms(&rolled_out, (&workspace.of_windows, self.gnp.acting), i * together, out);
            }
        }
        Ok(())
    }

    /// Fills the values of a roll-out of these windows, the first of which is number `first` of the call; goals and their
    /// probabilities go to `out`.
    fn set_out(
        self,
        observations: &[Observation<'_>],
        k: usize,
        workspace: &mut Workspace,
        (first, out): (usize, &mut Forecasts),
    ) -> Result<(), ModelError> {
        let (shape, windows) = (self.features.shape(), observations.len());
        let most_lines = observations.iter().map(|it| it.lines().len()).max().unwrap_or(0).max(1);
        let values = &mut workspace.roll_out.values;
        (values.windows, values.t_obs, values.goals_each) = (windows, shape.t_obs, k);
        (values.slots, values.most_lines, values.steps, values.dt) = (SLOTS, most_lines, shape.t_pred, shape.dt());
        for (values, len) in [
            (&mut values.observed, 0),
            (&mut values.goals, 0),
            (&mut values.neighbours, windows * shape.t_pred * SLOTS * 4),
            (&mut values.lines, windows * most_lines * 3),
        ] {
            values.clear();
            values.resize(len, 0.);
        }
        values.neighbour_present.clear();
        values.line_present.clear();
        values.line_present.resize(windows * most_lines, false);
        workspace.of_windows.clear();
        for (window, observation) in observations.iter().enumerate() {
            let following = std::mem::take(&mut workspace.following);
            let acting = self.gnp.acting;
            let situation = self.features.situation_in(*observation, acting, following, &mut workspace.platoon)?;
            let result = self.choose(&situation, k, workspace, (first + window, &mut *out));
            self.add_scene(&situation, window, workspace);
            workspace.following = situation.platoon.unwrap_or_default();
            result?;
        }
        Ok(())
    }

    /// The goals of one window, number `window` of the call, and their probabilities.
    fn choose(
        self,
        situation: &Situation<'_>,
        k: usize,
        workspace: &mut Workspace,
        (window, out): (usize, &mut Forecasts),
    ) -> Result<(), ModelError> {
        let Workspace { inputs, goal, choice, ends, roll_out, .. } = workspace;
        self.features.window_inputs(situation, inputs)?;
        let decoded = self.goal.predict(&inputs.observed, &inputs.neighbours, &inputs.present, goal)?;
        let scale = self.features.config().length_scale as f32;
        ends.clear();
        ends.extend(decoded.points.iter().map(|point| point.map(|value| value * scale)));
        self.gnp.shrink_ends(ends, decoded.probabilities);
        let central = self.gnp.selection == Selection::Central;
        let nearest = if central { nearest_to_mean(ends, decoded.probabilities) } else { None };
        choice.medoids(ends, decoded.probabilities, k, nearest);

        if let Some(velocity) = out.velocities.get_mut(window) {
            *velocity = situation.velocity();
        }
        let reference = self.features.reference_end(situation).map(f64::from);
        let [moved, _] = situation.frame(self.features.shape().t_pred);
        for (goal, (mode, probability)) in choice.picked.iter().enumerate() {
            let end = ends[*mode].map(f64::from);
            let end = [0, 1].map(|axis| (reference[axis] + end[axis]) as f32);
            roll_out.values.goals.extend([end[0] - moved, end[1]]);
            out.probabilities[window * k + goal] = *probability;
            if let Some(goal) = out.goals.get_mut(window * k + goal) {
                *goal = end;
            }
        }
        Ok(())
    }

    /// What of the scene is the window's, number `window` of those rolled out together.
    fn add_scene(self, situation: &Situation<'_>, window: usize, workspace: &mut Workspace) {
        let Workspace { roll_out, of_windows, settling, .. } = workspace;
        let (values, shape, seen) = (&mut roll_out.values, self.features.shape(), situation.view());
        self.features.observed_states(situation, &mut values.observed);
        values.neighbour_present.extend(Slot::ALL.map(|slot| seen.neighbour(slot).is_some()));
        let size = shape.t_pred * SLOTS * 4;
        let futures = &mut values.neighbours[window * size..(window + 1) * size];
        self.features.neighbour_futures(situation, self.gnp.neighbours, None, settling, futures);
        let entries = window * values.most_lines..(window + 1) * values.most_lines;
        let present = &mut values.line_present[entries.clone()];
        let lines = &mut values.lines[3 * entries.start..3 * entries.end];
        let mut count = 0;
        for ((line, to), present) in line_values(seen).zip(lines.chunks_exact_mut(3)).zip(present) {
            to.copy_from_slice(&line);
            *present = true;
            count += 1;
        }
        of_windows.lines.push(count);
        of_windows.frames.extend((1..=shape.t_pred).map(|step| situation.frame(step)[0]));
        if let Some(following) = &situation.platoon {
            for part in 0..3 {
                let acceleration = |step| following.motion.acceleration(step)[part] as f32;
                of_windows.accelerations.extend((0..shape.t_pred).map(acceleration));
            }
        }
    }
}

/// The paths of windows from number `first` of the call on.
fn put_paths(
    rolled_out: &RolledOut<'_>,
    of_windows: &OfWindows,
    first: usize,
    out: &mut Forecasts,
) -> Result<(), ModelError> {
    let size = out.modes * out.steps;
    let driven = rolled_out.path().as_chunks::<2>().0.chunks_exact(size);
    let ways = of_windows.frames.chunks_exact(out.steps);
    for ((i, (driven, way)), paths) in
        driven.zip(ways).enumerate().zip(out.paths[first * size..].chunks_exact_mut(size))
    {
        for (path, driven) in paths.chunks_exact_mut(out.steps).zip(driven.chunks_exact(out.steps)) {
            for ((point, [x, y]), way) in path.iter_mut().zip(driven).zip(way) {
                *point = [x + way, *y];
            }
        }
        let window = first + i;
        let probabilities = &out.probabilities[window * out.modes..][..out.modes];
        // Refuses what weights give that are finite and of no trained model.
        if !paths.as_flattened().iter().chain(probabilities).all(|value| value.is_finite()) {
            return Err(ModelError::NotFinite { window });
        }
    }
    Ok(())
}

/// The forces of windows from number `first` of the call on.
fn put_terms(
    rolled_out: &RolledOut<'_>,
    (of_windows, acting): (&OfWindows, ActingTerms),
    first: usize,
    out: &mut Forecasts,
) {
    let (windows, size, steps) = (of_windows.lines.len(), out.modes * out.steps, out.steps);
    let mut count = 0;
    for term in rolled_out.terms() {
        let totals = &mut out.totals_of(count, term.term)[first * size..][..windows * size];
        let forces = term.forces.as_chunks::<2>().0.chunks_exact(term.sources);
        for (i, (total, forces)) in totals.iter_mut().zip(forces).enumerate() {
            // Lines are padded to the most of any window, those that are there first.
            let there = if term.term.arity == Arity::PerLine { of_windows.lines[i / size] } else { term.sources };
            *total = match &forces[..there] {
                // Kept as it is, down to the sign of a zero.
                [one] => *one,
                all => all.iter().fold([0f32; 2], |sum, force| [sum[0] + force[0], sum[1] + force[1]]),
            };
        }
        count += 1;
    }
    if !of_windows.accelerations.is_empty() {
        let terms = PlatoonRule::terms();
        for (part, (term, _)) in terms.iter().zip(acting.flags()).enumerate().filter(|(_, (_, acts))| *acts) {
            let totals = out.totals_of(count, term)[first * size..].chunks_exact_mut(size);
            let of_part = of_windows.accelerations.chunks_exact(steps).skip(part).step_by(3);
            for (totals, values) in totals.zip(of_part) {
                for (total, value) in totals.iter_mut().zip(values.iter().cycle()) {
                    *total = [*value, 0.];
                }
            }
            count += 1;
        }
    }
    out.terms.truncate(count);
}
