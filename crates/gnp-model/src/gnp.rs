//! The predictor: goal network and social force behind one trait.

use std::path::Path;
use std::sync::Arc;

use candle_core::{DType, Device, Tensor};
use candle_nn::VarBuilder;
use gnp_baselines::ActingTerms;
use gnp_data::{
    Explanation, Forecast, Mode, Observation, PredictError, Predictor, TermForces, Truth, WindowShape, nearest_to_mean,
};
use gnp_goal::{GoalNet, PackedGoalNet};
use gnp_modes::{Modes, from_mode_frame};
use gnp_nn::DeviceThread;
use gnp_traj::{Arity, Phase, RollOut, RollOutBatch, SocialForce, TermRollOut};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::augmented_view::AugmentedView;
use crate::checkpoint::{Checkpoint, Component, Header};
use crate::contributions;
use crate::error::ModelError;
use crate::features::Features;
use crate::scene::NeighbourFuture;
use crate::select::{Selection, medoids};
use crate::situation::{ReferencePath, Situation};
use crate::variants::{GoalHead, Oracle, TrueGoal};

/// A trained GNP. A clone is cheap and shares the networks.
///
/// Calls from several threads are safe, but all share rayon's global pool: two plain threads that each
/// call [`predict`](Predictor::predict) wait for each other's work and take longer a call than one
/// alone. Give each a predictor with threads of its own by [`Gnp::with_threads`], or call [`Gnp::predict_into`], which
/// works on the caller's thread.
///
/// The number of threads and their timing never reach a result. The windows of one call do, by rounding: the
/// matrix products of the goal network sum in another order for another number of rows, so that a
/// window predicted alone and in a batch differs in the last bits (below 1 mm on a path). Where two goals
/// are equally good but for these bits, the other one may be chosen.
#[derive(Clone, Debug)]
pub struct Gnp {
    pub(crate) trained: Arc<Trained>,
    pub(crate) neighbours: NeighbourFuture,
    pub(crate) selection: Selection,
    pub(crate) trust: f32,
    pub(crate) explain: bool,
    /// The terms of the platoon that act; the force has its own.
    pub(crate) acting: ActingTerms,
    pool: Option<Arc<ThreadPool>>,
    pub(crate) name: &'static str,
}

/// What was trained.
#[derive(Clone, Debug)]
pub(crate) struct Trained {
    pub(crate) header: Header,
    pub(crate) features: Features,
    pub(crate) modes: Modes,
    /// Mode centres in units of `length_scale`, `[modes, t_pred, 2]`.
    pub(crate) centres: Tensor,
    pub(crate) goal: GoalNet,
    /// The same with the modes, on a CPU.
    pub(crate) packed: Option<Arc<PackedGoalNet>>,
    pub(crate) force: Option<(SocialForce, Phase)>,
    pub(crate) device: Device,
    pub(crate) thread: DeviceThread,
}

/// Goals and whole futures of the goal network, in the window's frame.
#[derive(Clone, Debug)]
pub(crate) struct Goals {
    /// By window; the prediction first, then the likeliest.
    pub(crate) futures: Vec<Vec<Vec<[f32; 2]>>>,
    /// Summing to 1 by window.
    pub(crate) probabilities: Vec<Vec<f32>>,
}

impl Gnp {
    /// Loads a run folder: `modes.safetensors`, `goal.safetensors` and `repulsion.safetensors`, which has the whole force.
    /// A model of less is made by [`Gnp::new`].
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] naming the file, also when the parts were not trained together.
    pub fn load(folder: &Path, neighbours: NeighbourFuture, device: &Device) -> Result<Self, ModelError> {
        let modes = Modes::load(&folder.join("modes.safetensors"))?;
        let path = folder.join("goal.safetensors");
        let goal = Checkpoint::load(&path)?;
        let force_path = folder.join("repulsion.safetensors");
        if !force_path.exists() {
            let problem = "is missing: train it (`gnp train --stage repulsion`), or make a model of less by `Gnp::new`";
            return Err(ModelError::checkpoint(&force_path, problem));
        }
        let force = Checkpoint::load(&force_path)?;
        Self::of_files((modes, goal, force), [&path, &force_path], neighbours, device)
    }

    /// The predictor of what files hold, which are named in messages: of the goal network and of the force.
    pub(crate) fn of_files(
        (modes, goal, force): (Modes, Checkpoint, Checkpoint),
        [path, force_path]: [&Path; 2],
        neighbours: NeighbourFuture,
        device: &Device,
    ) -> Result<Self, ModelError> {
        goal.header.expect(path, Component::Goal, None)?;
        force.header.expect(force_path, Component::Repulsion, Some(goal.header.shape))?;
        if force.header.split_hash != goal.header.split_hash {
            let problem = "was trained on another split than the goal network: train both on one split";
            return Err(ModelError::checkpoint(force_path, problem));
        }
        Self::new(modes, &goal, Some(&force), neighbours, device).map_err(|error| match error {
            ModelError::Weights { part, problem } => {
                let path = if part == Component::Goal { path } else { force_path };
                ModelError::checkpoint(path, format!("does not hold this network ({problem}): train again"))
            }
            other => other,
        })
    }

    /// The predictor of these modes and weights; without `force` the goal head's own futures.
    ///
    /// # Errors
    /// [`ModelError`] when the parts do not fit each other.
    pub fn new(
        modes: Modes,
        goal: &Checkpoint,
        force: Option<&Checkpoint>,
        neighbours: NeighbourFuture,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let header = goal.header.clone();
        let features = header.features.clone();
        features.check()?;
        let missing = |key| ModelError::config(key, "is missing in the checkpoint's header: train again");
        let platoon = features.config().reference == ReferencePath::Platoon;
        match neighbours {
            NeighbourFuture::Joint if platoon => {
                let problem = "is \"joint\": with features.reference = \"platoon\" vehicles follow each other already; \
                               take \"platoon\"";
                return Err(ModelError::config("predict.neighbours", problem));
            }
            NeighbourFuture::Platoon if !platoon => {
                let problem = "is \"platoon\": that needs features.reference = \"platoon\", in training too";
                return Err(ModelError::config("predict.neighbours", problem));
            }
            _ => {}
        }
        if modes.t_pred != header.shape.t_pred || modes.frame != features.mode_frame() {
            return Err(ModelError::config("modes", "do not have the goal network's frames: cluster and train again"));
        }
        let config = header.goal.as_ref().ok_or_else(|| missing("goal"))?;
        let net = GoalNet::new(config, features.goal_shape(), constants(goal, device))
            .map_err(|error| ModelError::weights(Component::Goal, &error))?;
        let force = match force {
            Some(checkpoint) => {
                if checkpoint.header.features.config().reference != features.config().reference {
                    let problem = "of the force is another than of the goal network: train both on one reference path";
                    return Err(ModelError::config("features.reference", problem));
                }
                let config = checkpoint.header.traj.as_ref().ok_or_else(|| missing("traj"))?;
                let phase =
                    if checkpoint.header.part == Component::Attraction { Phase::Attraction } else { Phase::Full };
                let force = SocialForce::new(config, constants(checkpoint, device))
                    .and_then(|force| force.frozen())
                    .map_err(|error| ModelError::weights(checkpoint.header.part, &error))?;
                Some((force, phase))
            }
            None => None,
        };
        let centres = features.centres(&modes, device)?;
        let packed = device.is_cpu().then(|| net.packed(&centres)).transpose()?.map(Arc::new);
        let name = match &force {
            None => "goal head",
            Some((_, Phase::Attraction)) => "gnp (attraction only)",
            Some(_) if neighbours == NeighbourFuture::Joint => "gnp (joint)",
            Some(_) => "gnp",
        };
        let (device, thread) = (device.clone(), DeviceThread::of(device)?);
        let trained = Arc::new(Trained { header, features, modes, centres, goal: net, packed, force, device, thread });
        let (selection, acting) = (Selection::Medoids, ActingTerms::ALL);
        Ok(Self { trained, neighbours, selection, trust: 1., explain: false, acting, pool: None, name })
    }

    /// How goals are chosen when fewer are asked for than there are modes; medoids unless set.
    #[must_use]
    pub fn selecting(self, selection: Selection) -> Self {
        Self { selection, ..self }
    }

    /// Whether forecasts carry the forces of every step.
    #[must_use]
    pub fn explaining(self, explain: bool) -> Self {
        Self { explain, ..self }
    }

    /// The same predictor on a pool of `threads` threads of its own, which its later clones share. The
    /// results are the same bits on any number of threads.
    ///
    /// ```no_run
    /// # use gnp_data::{Observation, PredictError, Predictor};
    /// # fn both(gnp: &gnp_model::Gnp, left: &[Observation<'_>], right: &[Observation<'_>]) -> Result<(), Box<dyn std::error::Error>> {
    /// let (a, b) = (gnp.clone().with_threads(1)?, gnp.clone().with_threads(1)?);
    /// std::thread::scope(|scope| {
    ///     let a = scope.spawn(|| a.predict(left, 6));
    ///     let b = scope.spawn(|| b.predict(right, 6));
    ///     (a.join(), b.join())
    /// });
    /// # Ok(()) }
    /// ```
    ///
    /// # Errors
    /// [`ModelError::Config`] for no thread at all, [`ModelError::Threads`] when the system refuses them.
    pub fn with_threads(self, threads: usize) -> Result<Self, ModelError> {
        if threads == 0 {
            return Err(ModelError::config("threads", "is 0: give 1 or more"));
        }
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|i| format!("gnp-{i}"))
            .build()
            .map_err(|source| ModelError::Threads { threads, source })?;
        Ok(Self { pool: Some(Arc::new(pool)), ..self })
    }

    /// The windows it was trained on.
    #[must_use]
    pub fn shape(&self) -> WindowShape {
        self.trained.features.shape()
    }

    /// Header of the goal network's checkpoint.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.trained.header
    }

    /// The intention modes.
    #[must_use]
    pub fn modes(&self) -> &Modes {
        &self.trained.modes
    }

    /// The goal head alone: its whole futures, without physics.
    #[must_use]
    pub fn goal_head(&self) -> GoalHead {
        GoalHead { gnp: self.clone() }
    }

    /// The same model with the recorded futures of the neighbours, as in the published evaluation.
    #[must_use]
    pub fn oracle(&self) -> Oracle {
        Oracle { gnp: self.clone() }
    }

    /// The same model driven to the recorded last position instead of predicted goals: what is left
    /// of the error is the path's own.
    #[must_use]
    pub fn true_goal(&self) -> TrueGoal {
        TrueGoal { gnp: self.clone() }
    }

    /// Paths to goals of the caller's choice instead of the network's: what the same traffic and forces make of them.
    /// `goals` has a list for each observation, all equally long, in m in the window's frame; each forecast has a future
    /// a goal, in their order and equally likely. Without physics the way to a goal is straight.
    ///
    /// # Errors
    /// [`PredictError`] where `goals` are not so, or are not finite; as [`Predictor::predict`].
    pub fn predict_towards(
        &self,
        observations: &[Observation<'_>],
        goals: &[Vec<[f32; 2]>],
    ) -> Result<Vec<Forecast>, PredictError> {
        let k = goals.first().map_or(0, Vec::len);
        let problem = if goals.len() != observations.len() {
            Some(format!("{} lists for {} windows; give one a window", goals.len(), observations.len()))
        } else if goals.iter().any(|list| list.len() != k || list.is_empty()) {
            Some("are not equally many for every window, and at least one".to_owned())
        } else if goals.iter().flatten().flatten().any(|value| !value.is_finite()) {
            Some("are not all finite".to_owned())
        } else {
            None
        };
        if let Some(problem) = problem {
            return Err(predict_error(self.name, ModelError::config("goals", &problem)));
        }
        if observations.is_empty() {
            return Ok(Vec::new());
        }
        // The force uses the last point alone; the way there matters without one.
        let steps = self.shape().t_pred;
        let share = |j: usize| j as f32 / steps as f32;
        let straight = |[x, y]: [f32; 2]| (1..=steps).map(|j| [x * share(j), y * share(j)]).collect();
        let goals = Goals {
            futures: goals.iter().map(|list| list.iter().copied().map(straight).collect()).collect(),
            probabilities: vec![vec![1. / k as f32; k]; observations.len()],
        };
        let drive = || {
            let situations = self.situations(observations)?;
            self.trained.thread.run(|| self.drive(&situations, &goals, None))
        };
        self.on_threads(drive).map_err(|e| predict_error(self.name, e))
    }

    pub(crate) fn goals(&self, situations: &[Situation<'_>], k: usize) -> Result<Goals, ModelError> {
        let Trained { features, modes, centres, goal, device, .. } = &*self.trained;
        let inputs = features.goal_inputs(situations, device)?;
        let k = k.min(modes.len()).max(1);
        let decoded = match self.selection {
            // What is believed of the mean needs all of which it is the mean.
            Selection::MostProbable if self.trust >= 1. => k,
            Selection::MostProbable => modes.len(),
            Selection::Medoids | Selection::Central => modes.len(),
        };
        let goals = goal.predict(&inputs.observed, &inputs.neighbours, &inputs.mask, centres, decoded)?;
        let scale = features.config().length_scale as f32;
        let mut futures = goals.futures.flatten_all()?.to_vec1::<f32>()?;
        futures.iter_mut().for_each(|value| *value *= scale);
        let mut out = Goals { futures: Vec::new(), probabilities: Vec::new() };
        let path = 2 * features.shape().t_pred;
        let probabilities = goals.probabilities.to_vec2::<f32>()?;
        for (paths, probabilities) in futures.chunks_exact_mut(path * decoded).zip(&probabilities) {
            self.shrink(paths, probabilities);
        }
        let by_window = futures.chunks_exact(path * decoded).zip(probabilities);
        for (situation, (paths, probabilities)) in situations.iter().zip(by_window) {
            let picked = match self.selection {
                Selection::MostProbable => {
                    let total: f32 = probabilities.iter().take(k).sum();
                    probabilities.into_iter().take(k).map(|p| p / total).enumerate().collect()
                }
                selection => {
                    let ends: Vec<_> =
                        paths.chunks_exact(path).map(|path| [path[path.len() - 2], path[path.len() - 1]]).collect();
                    let central = selection == Selection::Central;
                    let first = if central { nearest_to_mean(&ends, &probabilities) } else { None };
                    medoids(&ends, &probabilities, k, first)
                }
            };
            let reference = features.reference(situation);
            let future = |mode: usize| pairs(&from_mode_frame(&paths[mode * path..(mode + 1) * path], &reference));
            out.futures.push(picked.iter().map(|(mode, _)| future(*mode)).collect());
            out.probabilities.push(picked.into_iter().map(|(_, probability)| probability).collect());
        }
        Ok(out)
    }

    pub(crate) fn forecast(
        &self,
        observations: &[Observation<'_>],
        truths: Option<&[Truth<'_>]>,
        k: usize,
    ) -> Result<Vec<Forecast>, ModelError> {
        if observations.is_empty() {
            return Ok(Vec::new());
        }
        self.on_threads(|| {
            let situations = self.situations(observations)?;
            let forecasts =
                self.trained.thread.run(|| self.drive(&situations, &self.goals(&situations, k)?, truths))?;
            finite(forecasts)
        })
    }

    pub(crate) fn situations<'a>(&self, observations: &[Observation<'a>]) -> Result<Vec<Situation<'a>>, ModelError> {
        let features = &self.trained.features;
        let situation = |o: &Observation<'a>| features.situation_with(AugmentedView::recorded(*o), self.acting);
        observations.par_iter().map(situation).collect()
    }

    /// Does `work` on the predictor's own threads, where it has some.
    pub(crate) fn on_threads<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Paths to goals, with the forces of every step where they are asked for.
    fn drive(
        &self,
        situations: &[Situation<'_>],
        goals: &Goals,
        truths: Option<&[Truth<'_>]>,
    ) -> Result<Vec<Forecast>, ModelError> {
        let Trained { features, force, device, .. } = &*self.trained;
        let Some((force, phase)) = force else { return Ok(plain(goals.clone())) };
        let ends = end_points(goals, device)?;
        let scene = match (truths, self.neighbours) {
            (None, NeighbourFuture::Joint) => self.joint_scene(situations, ends)?,
            (_, neighbours) => features.scene(situations, ends, neighbours, truths, device)?,
        };
        if self.explain {
            let out = force.roll_out_explained(&scene, *phase)?;
            let path = features.to_road(situations, &out.path)?;
            let mut forecasts = explained(&path, &out, &scene, goals)?;
            let integrator = force.config().integrator;
            for (situation, forecast) in situations.iter().zip(&mut forecasts) {
                contributions::add(situation, (features.platoon(), self.acting), integrator, forecast)?;
            }
            Ok(forecasts)
        } else {
            let path = features.to_road(situations, &force.roll_out(&scene, *phase)?)?;
            let path = path.flatten_all()?.to_vec1::<f32>()?;
            let steps = scene.steps;
            let mut points = path.chunks_exact(2).map(|p| [p[0], p[1]]);
            Ok(goals
                .probabilities
                .iter()
                .map(|probabilities| Forecast {
                    modes: probabilities
                        .iter()
                        .map(|&probability| Mode {
                            probability,
                            path: points.by_ref().take(steps).collect(),
                            explanation: None,
                        })
                        .collect(),
                })
                .collect())
        }
    }
}

/// Weights of a checkpoint as constants: a forecast then keeps no record of its steps for gradients
/// that nobody asks for, which for a roll-out would take gigabytes. A weight that the file does not
/// have is an error, and so is one of another shape.
fn constants(checkpoint: &Checkpoint, device: &Device) -> VarBuilder<'static> {
    let tensors = checkpoint.tensors.iter().map(|(name, tensor)| (name.clone(), tensor.detach()));
    VarBuilder::from_tensors(tensors.collect(), DType::F32, device)
}

/// Last points of all futures, `[batch, k, 2]`.
pub(crate) fn end_points(goals: &Goals, device: &Device) -> Result<Tensor, ModelError> {
    let k = goals.futures.first().map_or(0, Vec::len);
    let ends: Vec<f32> =
        goals.futures.iter().flatten().flat_map(|path| path.last().copied().unwrap_or_default()).collect();
    Ok(Tensor::from_vec(ends, (goals.futures.len(), k, 2), device)?)
}

pub(crate) fn plain(goals: Goals) -> Vec<Forecast> {
    let windows = goals.futures.into_iter().zip(goals.probabilities);
    windows
        .map(|(paths, probabilities)| Forecast {
            modes: paths
                .into_iter()
                .zip(probabilities)
                .map(|(path, probability)| Mode { probability, path, explanation: None })
                .collect(),
        })
        .collect()
}

/// Forecasts with the forces of every step, from the roll-out's tensors.
fn explained(path: &Tensor, out: &RollOut, batch: &RollOutBatch, goals: &Goals) -> Result<Vec<Forecast>, ModelError> {
    let flat = |tensor: &Tensor| -> Result<Vec<f32>, ModelError> { Ok(tensor.flatten_all()?.to_vec1::<f32>()?) };
    let path: Vec<[f32; 2]> = pairs(&flat(path)?);
    let mut terms = Vec::with_capacity(out.terms.len());
    for TermRollOut { term, forces, parameters, .. } in &out.terms {
        let (forces, sources) = (pairs(&flat(forces)?), forces.dim(3)?);
        terms.push((term, sources, forces, parameters.iter().map(flat).collect::<Result<Vec<_>, _>>()?));
    }
    // Lines are padded to the most of any window, those that are there first.
    let lines: Option<Vec<usize>> = match &batch.lines {
        Some(lines) => {
            let present = lines.present.to_vec2::<f32>()?;
            Some(present.iter().map(|line| line.iter().filter(|there| **there > 0.).count()).collect())
        }
        None => None,
    };
    let mut forecasts = Vec::with_capacity(goals.probabilities.len());
    let mut first = 0;
    for (window, (probabilities, futures)) in goals.probabilities.iter().zip(&goals.futures).enumerate() {
        let mut modes = Vec::with_capacity(probabilities.len());
        for (&probability, future) in probabilities.iter().zip(futures) {
            let steps = first..first + batch.steps;
            first = steps.end;
            let terms = terms.iter().map(|(term, sources, forces, parameters)| {
                let there = match (term.arity, &lines) {
                    (Arity::PerLine, Some(lines)) => lines[window].min(*sources),
                    _ => *sources,
                };
                let entries = || steps.clone().flat_map(|step| step * sources..step * sources + there);
                let parameters = parameters.iter().map(|values| entries().map(|i| values[i]).collect()).collect();
                let forces =
                    TermForces::new(Arc::clone(term), there, entries().map(|i| forces[i]).collect(), parameters);
                // On a road without lines the term acts, and gives nothing.
                if there == 0 { forces.with_totals(vec![[0.; 2]; batch.steps]) } else { forces }
            });
            modes.push(Mode {
                probability,
                explanation: Some(Explanation {
                    goal: future.last().copied().unwrap_or_default(),
                    terms: terms.collect(),
                    ..Explanation::default()
                }),
                path: path[steps.clone()].to_vec(),
            });
        }
        forecasts.push(Forecast { modes });
    }
    Ok(forecasts)
}

fn pairs(values: &[f32]) -> Vec<[f32; 2]> {
    values.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect()
}

pub(crate) fn predict_error(model: &str, error: ModelError) -> PredictError {
    match error {
        ModelError::Shape { needs, found } => PredictError::shape(model, needs, found),
        other => PredictError::Model { model: model.to_owned(), source: Box::new(other) },
    }
}

/// Refuses what weights give that are finite and of no trained model.
pub(crate) fn finite(forecasts: Vec<Forecast>) -> Result<Vec<Forecast>, ModelError> {
    let wrong = |mode: &Mode| !mode.probability.is_finite() || mode.path.iter().flatten().any(|x| !x.is_finite());
    match forecasts.iter().position(|forecast| forecast.modes.iter().any(wrong)) {
        Some(window) => Err(ModelError::NotFinite { window }),
        None => Ok(forecasts),
    }
}

impl Predictor for Gnp {
    fn name(&self) -> &str {
        self.name
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        self.forecast(observations, None, k).map_err(|e| predict_error(self.name, e))
    }
}
