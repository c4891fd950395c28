//! Windows to the tensors that the networks take, and back.

use std::ops::Range;

use candle_core::{Device, Tensor};
use gnp_baselines::{ActingTerms, PlatoonRoom, PlatoonRule};
use gnp_data::{DataError, Observation, SLOTS, Slot, Standardiser, Window, WindowShape};
use gnp_goal::GoalShape;
use gnp_modes::{ModeFrame, Modes, Reference, from_mode_frame, to_mode_frame};
use serde::{Deserialize, Serialize};

use crate::augmented_view::{AugmentedNeighbour, AugmentedView};
use crate::error::ModelError;
use crate::rows::{SeenStates, neighbour_row, neighbour_width, observed_row};
use crate::situation::{Following, ReferencePath, Situation};

/// In which quantities the goal network sees motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Representation {
    /// Positions and velocities in the window's frame, as published.
    Position,
    /// Deviations: the past of the target from constant velocity, its futures and modes from the
    /// [`ReferencePath`]; neighbours relative to the target. Modes then describe manoeuvres instead of speeds.
    Deviation,
}

/// Which vehicles the goal network sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SeenNeighbours {
    /// Those in all eight slots, as published.
    All,
    /// Those ahead alone: who follows or drives beside says little of the next seconds, and from few windows a network
    /// learns it wrongly.
    Ahead,
}

/// How windows become numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeatureConfig {
    /// Quantities the goal network sees.
    pub representation: Representation,
    /// What futures and modes are deviations from.
    pub reference: ReferencePath,
    /// Unit of the futures and modes inside the goal network, m.
    pub length_scale: f64,
    /// Seconds of the past over which the velocity at the last observed frame is fitted; 0 takes
    /// one frame.
    pub velocity_window_s: f64,
    /// Seconds of the past that are averaged into one step of the history which the goal network
    /// sees, counted back from the last observed frame; what is left over at its beginning is not
    /// seen. 0 shows every frame, as published.
    pub history_block_s: f64,
    /// Vehicles that the goal network sees ahead in the target's lane and in those beside: 1 as published, the eight
    /// neighbours; with 2 also whom those ahead follow, and the leader where only the target's own rows name him.
    pub vehicles_ahead: usize,
    /// Which vehicles the goal network sees.
    pub neighbours: SeenNeighbours,
    /// Whether the goal network also gets how far the reference path is ahead of constant velocity after 1 to 5 s, or, where that is constant
    /// velocity, where a textbook driver (the Intelligent Driver Model) would be behind the leader; not published.
    pub car_following_features: bool,
}

impl FeatureConfig {
    /// Every number: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 4] = [
        ("length_scale", 1e-3, 1e4, "m"),
        ("velocity_window_s", 0., 60., "s (0: one frame)"),
        ("history_block_s", 0., 60., "s (0: every frame)"),
        ("vehicles_ahead", 1., 2., "vehicles"),
    ];

    /// Refuses values that cannot work.
    ///
    /// # Errors
    /// [`ModelError::Config`] with the key and the remedy.
    pub fn check(&self) -> Result<(), ModelError> {
        let values = [self.length_scale, self.velocity_window_s, self.history_block_s, self.vehicles_ahead as f64];
        let keys = [
            "features.length_scale",
            "features.velocity_window_s",
            "features.history_block_s",
            "features.vehicles_ahead",
        ];
        for ((key, (_, least, most, unit)), value) in keys.into_iter().zip(Self::RANGES).zip(values) {
            if !(least..=most).contains(&value) {
                let problem = format!("is {value}; give a number from {least} to {most} {unit}");
                return Err(ModelError::config(key, &problem));
            }
        }
        if self.reference == ReferencePath::Platoon && self.representation == Representation::Position {
            let problem = "is \"platoon\", from which positions are not deviations: set representation = \"deviation\"";
            return Err(ModelError::config("features.reference", problem));
        }
        Ok(())
    }

    /// The other vehicles that the goal network sees: those in the neighbour slots, then those ahead of the ones ahead.
    fn others<'a>(&self, seen: &AugmentedView<'a>) -> impl Iterator<Item = Option<AugmentedNeighbour<'a>>> + use<'a> {
        let looked_at = |slot: &Slot| self.neighbours == SeenNeighbours::All || AHEAD.contains(slot);
        let mut others = Slot::ALL.map(|slot| looked_at(&slot).then(|| seen.neighbour(slot)).flatten());
        let mut ahead = [None; AHEAD.len()];
        if self.vehicles_ahead > 1 {
            others[Slot::Preceding.index()] = seen.leader();
            ahead = AHEAD.map(|slot| seen.leader_of(slot));
        }
        others.into_iter().chain(ahead).take(self.slots())
    }

    /// Number of [`FeatureConfig::others`].
    fn slots(&self) -> usize {
        SLOTS + if self.vehicles_ahead > 1 { AHEAD.len() } else { 0 }
    }

    /// Frames of each step of the history, from the earliest; every one ends before the next begins.
    pub(crate) fn blocks(&self, shape: WindowShape) -> impl Iterator<Item = Range<usize>> + use<> {
        let frames = ((self.history_block_s * shape.rate_hz).round() as usize).clamp(1, shape.t_obs);
        let left_over = shape.t_obs % frames;
        (left_over..shape.t_obs).step_by(frames).map(move |from| from..from + frames)
    }
}

/// The slots ahead, whose leaders may be seen, too.
const AHEAD: [Slot; 3] = [Slot::Preceding, Slot::LeftPreceding, Slot::RightPreceding];

/// What the goal network takes.
#[derive(Clone, Debug)]
pub struct GoalInputs {
    /// `[batch, observed features]`.
    pub observed: Tensor,
    /// `[batch, slots, neighbour features]`; zeros where nobody is.
    pub neighbours: Tensor,
    /// `[batch, slots]`, 1 where somebody is at the last observed frame.
    pub mask: Tensor,
}

/// What the goal network takes of one window, in memory that the next window uses again.
#[derive(Debug, Default)]
pub(crate) struct WindowInputs {
    /// `[observed features]`
    pub(crate) observed: Vec<f32>,
    /// `[slots, neighbour features]`; zeros where nobody is.
    pub(crate) neighbours: Vec<f32>,
    /// `[slots]`
    pub(crate) present: Vec<bool>,
    row: Vec<f32>,
    states: SeenStates,
}

/// Turns windows into network inputs; holds the statistics of the training part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Features {
    config: FeatureConfig,
    shape: WindowShape,
    /// The car-following rule behind the reference path.
    platoon: Option<PlatoonRule>,
    observed: Standardiser,
    neighbour: Standardiser,
}

impl Features {
    /// Checks what comes from a file, where any number may stand.
    ///
    /// # Errors
    /// [`ModelError::Config`] for a bad configuration, [`ModelError::Data`] for a shape or a standardisation that cannot be.
    pub(crate) fn check(&self) -> Result<(), ModelError> {
        self.config.check()?;
        let WindowShape { t_obs, t_pred, step, rate_hz } = self.shape;
        WindowShape::new(t_obs, t_pred, step, rate_hz).map_err(DataError::from)?;
        self.observed.check()?;
        Ok(self.neighbour.check()?)
    }

    /// Fits the standardisation on `training` windows, which must be of the training part alone, as `platoon` must have
    /// been; it is used where the reference path is the platoon's.
    ///
    /// # Errors
    /// [`ModelError::Config`] for a bad configuration, [`ModelError::Data`] without any window.
    pub fn fit<'a>(
        config: &FeatureConfig,
        shape: WindowShape,
        platoon: Option<&PlatoonRule>,
        training: impl Iterator<Item = Observation<'a>> + Clone,
    ) -> Result<Self, ModelError> {
        config.check()?;
        let platoon = match (config.reference, platoon) {
            (ReferencePath::ConstantVelocity, _) => None,
            (ReferencePath::Platoon, Some(platoon)) => Some(platoon.clone()),
            (ReferencePath::Platoon, None) => {
                return Err(ModelError::config("features.reference", "is \"platoon\": fit the rule first"));
            }
        };
        let rows = |o: Observation<'a>| -> Result<_, ModelError> {
            let seen = AugmentedView::recorded(o);
            let situation = situation(config, shape, (platoon.as_ref(), ActingTerms::ALL), seen)?;
            let mut states = SeenStates::of_target(&situation);
            let (mut observed, mut neighbours) = (Vec::new(), Vec::new());
            observed_row(config, &situation, &states, &mut observed);
            for other in config.others(&situation.seen).flatten() {
                let mut row = Vec::new();
                neighbour_row(config, &situation, &other, &mut states, &mut row);
                neighbours.push(row);
            }
            Ok((observed, neighbours))
        };
        let (mut observed, mut neighbours) = (Vec::new(), Vec::new());
        for observation in training {
            let (target, others) = rows(observation)?;
            observed.push(target);
            neighbours.extend(others);
        }
        let observed = Standardiser::fit(observed)?;
        let neighbour = if !neighbours.is_empty() {
            Standardiser::fit(neighbours)?
        } else {
            // Nobody ever has a neighbour: one row of zeros leaves features as they are.
            Standardiser::fit([vec![0f32; neighbour_width(config, shape)]])?
        };
        Ok(Self { config: config.clone(), shape, platoon, observed, neighbour })
    }

    /// The window with what the traffic ahead makes of it.
    ///
    /// # Errors
    /// [`ModelError::Traffic`] for traffic that cannot be: positions or lengths that are not finite.
    pub fn situation<'a>(&self, seen: AugmentedView<'a>) -> Result<Situation<'a>, ModelError> {
        self.situation_with(seen, ActingTerms::ALL)
    }

    /// [`Features::situation`] of a target on which these terms of the platoon act.
    pub(crate) fn situation_with<'a>(
        &self,
        seen: AugmentedView<'a>,
        acting: ActingTerms,
    ) -> Result<Situation<'a>, ModelError> {
        situation(&self.config, self.shape, (self.platoon.as_ref(), acting), seen)
    }

    /// [`Features::situation_with`] in the memory of `following`, which the situation then holds where the reference path is the
    /// platoon's.
    pub(crate) fn situation_in<'a>(
        &self,
        observation: Observation<'a>,
        acting: ActingTerms,
        mut following: Following,
        room: &mut PlatoonRoom,
    ) -> Result<Situation<'a>, ModelError> {
        let seen = AugmentedView::recorded(observation);
        let [vx, vy] = seen.velocity(self.config.velocity_window_s);
        let Some(platoon) = &self.platoon else { return Ok(Situation { seen, velocity: [vx, vy], platoon: None }) };
        platoon.traffic_into(&observation, &mut following.traffic, room);
        following.roll_out(platoon, (observation.site(), &self.shape), acting, room)?;
        Ok(Situation::behind(following, seen, vy))
    }

    /// The same configuration and statistics with the drivers of another site or another time, where the reference path is
    /// the platoon's.
    #[must_use]
    pub fn with_platoon(self, platoon: &PlatoonRule) -> Self {
        let followed = self.platoon.map(|_| platoon.clone());
        Self { platoon: followed, ..self }
    }

    /// The car-following rule behind the reference path, where that is the platoon's.
    #[must_use]
    pub fn platoon(&self) -> Option<&PlatoonRule> {
        self.platoon.as_ref()
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &FeatureConfig {
        &self.config
    }

    /// The windows' shape.
    #[must_use]
    pub fn shape(&self) -> WindowShape {
        self.shape
    }

    /// The frame of modes and futures.
    #[must_use]
    pub fn mode_frame(&self) -> ModeFrame {
        match (self.config.representation, self.config.reference) {
            (Representation::Position, _) => ModeFrame::Position,
            (_, ReferencePath::ConstantVelocity) => ModeFrame::Deviation,
            (_, ReferencePath::Platoon) => ModeFrame::PlatoonDeviation,
        }
    }

    /// Sizes of the goal network's inputs and outputs.
    #[must_use]
    pub fn goal_shape(&self) -> GoalShape {
        GoalShape {
            observed: self.observed.features(),
            neighbour: self.neighbour.features(),
            slots: self.config.slots(),
            t_pred: self.shape.t_pred,
        }
    }

    /// Inputs of the goal network.
    ///
    /// # Errors
    /// [`ModelError::Shape`] when a window has another shape than these features, candle's errors.
    pub fn goal_inputs(&self, situations: &[Situation<'_>], device: &Device) -> Result<GoalInputs, ModelError> {
        let (fo, fn_, slots) = (self.observed.features(), self.neighbour.features(), self.config.slots());
        let b = situations.len();
        let mut observed = Vec::with_capacity(b * fo);
        let mut neighbours = Vec::with_capacity(b * slots * fn_);
        let mut mask = Vec::with_capacity(b * slots);
        let mut inputs = WindowInputs::default();
        for situation in situations {
            self.window_inputs(situation, &mut inputs)?;
            observed.extend_from_slice(&inputs.observed);
            neighbours.extend_from_slice(&inputs.neighbours);
            mask.extend(inputs.present.iter().map(|present| f32::from(*present)));
        }
        Ok(GoalInputs {
            observed: Tensor::from_vec(observed, (b, fo), device)?,
            neighbours: Tensor::from_vec(neighbours, (b, slots, fn_), device)?,
            mask: Tensor::from_vec(mask, (b, slots), device)?,
        })
    }

    /// The part of [`Features::goal_inputs`] that is of one window.
    pub(crate) fn window_inputs(&self, situation: &Situation<'_>, inputs: &mut WindowInputs) -> Result<(), ModelError> {
        self.check_shape(situation.seen.observation())?;
        let WindowInputs { observed, neighbours, present, row, states } = inputs;
        let (slots, width) = (self.config.slots(), self.neighbour.features());
        states.take_target(situation);
        observed.clear();
        observed_row(&self.config, situation, states, observed);
        self.observed.apply(observed)?;
        neighbours.clear();
        neighbours.resize(slots * width, 0.);
        present.clear();
        for (slot, other) in self.config.others(&situation.seen).enumerate() {
            present.push(other.is_some());
            if let Some(other) = other {
                row.clear();
                neighbour_row(&self.config, situation, &other, states, row);
                self.neighbour.apply(row)?;
                neighbours[slot * width..(slot + 1) * width].copy_from_slice(row);
            }
        }
        Ok(())
    }

    /// The true future of a window in the modes' frame, `[t_pred, 2]`, m.
    #[must_use]
    pub fn future(&self, situation: &Situation<'_>, window: &Window<'_>) -> Vec<f32> {
        let truth = window.truth();
        let path: Vec<f32> = (0..self.shape.t_pred)
            .flat_map(|j| {
                let state = situation.seen.true_target(&truth, j);
                [state.x, state.y]
            })
            .collect();
        to_mode_frame(&path, &self.reference(situation))
    }

    /// True futures in the modes' frame and in units of `length_scale`, `[batch, t_pred, 2]`.
    ///
    /// # Errors
    /// Those of candle.
    pub fn futures(
        &self,
        situations: &[Situation<'_>],
        windows: &[Window<'_>],
        device: &Device,
    ) -> Result<Tensor, ModelError> {
        let all: Vec<f32> = situations.iter().zip(windows).flat_map(|(it, window)| self.future(it, window)).collect();
        self.scaled(all, windows.len(), device)
    }

    /// Mode centres in units of `length_scale`, `[modes, t_pred, 2]`.
    ///
    /// # Errors
    /// Those of candle.
    pub fn centres(&self, modes: &Modes, device: &Device) -> Result<Tensor, ModelError> {
        self.scaled(modes.centres.clone(), modes.len(), device)
    }

    /// A path of the goal network, `[t_pred, 2]` in the modes' frame and m, in the window's frame.
    #[must_use]
    pub fn to_window_frame(&self, situation: &Situation<'_>, path: &[f32]) -> Vec<[f32; 2]> {
        let path = from_mode_frame(path, &self.reference(situation));
        path.chunks_exact(2).map(|p| [p[0], p[1]]).collect()
    }

    fn scaled(&self, values: Vec<f32>, n: usize, device: &Device) -> Result<Tensor, ModelError> {
        let tensor = Tensor::from_vec(values, (n, self.shape.t_pred, 2), device)?;
        Ok((tensor / self.config.length_scale)?)
    }

    /// Refuses a window whose frames are not those the features were fitted on.
    ///
    /// # Errors
    /// [`ModelError::Shape`] with both shapes.
    pub fn check_shape(&self, observation: &Observation<'_>) -> Result<(), ModelError> {
        let found = observation.shape();
        if self.shape.fits(&found) { Ok(()) } else { Err(ModelError::Shape { needs: self.shape, found }) }
    }

    /// What the modes' frame subtracts.
    pub(crate) fn reference(&self, situation: &Situation<'_>) -> Reference {
        let steps = self.shape.t_pred;
        let way = match self.mode_frame() {
            ModeFrame::Position => Vec::new(),
            ModeFrame::Deviation => Reference::constant_velocity(situation.velocity, self.shape.dt() as f32, steps),
            ModeFrame::PlatoonDeviation => (1..=steps).map(|step| situation.reference(step)).collect(),
        };
        Reference { origin: [0.; 2], heading: 0., way }
    }

    /// What the modes' frame subtracts at the end: the last point of [`Features::reference`], m.
    pub(crate) fn reference_end(&self, situation: &Situation<'_>) -> [f32; 2] {
        let steps = self.shape.t_pred;
        match self.mode_frame() {
            ModeFrame::Position => [0.; 2],
            ModeFrame::Deviation => Reference::after(situation.velocity, self.shape.dt() as f32, steps),
            ModeFrame::PlatoonDeviation => situation.reference(steps),
        }
    }
}

fn situation<'a>(
    config: &FeatureConfig,
    shape: WindowShape,
    (platoon, acting): (Option<&PlatoonRule>, ActingTerms),
    seen: AugmentedView<'a>,
) -> Result<Situation<'a>, ModelError> {
    let [vx, vy] = seen.velocity(config.velocity_window_s);
    let Some(platoon) = platoon else { return Ok(Situation { seen, velocity: [vx, vy], platoon: None }) };
    let observation = seen.observation();
    let traffic = platoon.traffic(observation).scaled(f64::from(seen.longitudinal_scale()));
    let following = Following::new(platoon, traffic, (observation.site(), &shape), acting)?;
    Ok(Situation::behind(following, seen, vy))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blocks(history_block_s: f64, t_obs: usize) -> Vec<Range<usize>> {
        let representation = Representation::Deviation;
        let config = FeatureConfig {
            representation,
            reference: ReferencePath::ConstantVelocity,
            length_scale: 5.,
            velocity_window_s: 0.5,
            history_block_s,
            vehicles_ahead: 1,
            neighbours: SeenNeighbours::All,
            car_following_features: false,
        };
        config.check().unwrap();
        config.blocks(WindowShape { t_obs, t_pred: 25, step: 1, rate_hz: 10. }).collect()
    }

    #[test]
    fn blocks_end_at_the_last_observed_frame() {
        assert_eq!(blocks(0., 4), [0..1, 1..2, 2..3, 3..4]);
        assert_eq!(blocks(0.3, 7), [1..4, 4..7], "the first frame is left over");
        assert_eq!(blocks(9., 7), vec![Range { start: 0, end: 7 }], "no longer than the past");
    }
}
