//! A window as the networks see it, with the path that counts as doing nothing in particular.

use gnp_baselines::{ActingTerms, Motion, PlatoonRoom, PlatoonRule, Traffic, lateral};
use gnp_data::{Slot, TrackState, WindowShape};
use gnp_force::ForceError;
use serde::{Deserialize, Serialize};

use crate::augmented_view::AugmentedView;

/// What goals, modes and futures are deviations from, where they are deviations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReferencePath {
    /// The present velocity, kept.
    ConstantVelocity,
    /// The column ahead, rolled out together by the car-following rule as it was fitted to the training part; a lateral
    /// motion comes to rest.
    Platoon,
}

/// A window with what the traffic ahead makes of it.
#[derive(Clone, Debug)]
pub struct Situation<'a> {
    /// The window as recorded, or varied.
    pub(crate) seen: AugmentedView<'a>,
    /// Velocity of the target at the last observed frame, m/s.
    pub(crate) velocity: [f32; 2],
    pub(crate) platoon: Option<Following>,
}

/// The traffic ahead and how it moves if everybody follows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Following {
    pub(crate) traffic: Traffic,
    /// The target moved by the terms that act.
    pub(crate) motion: Motion,
    /// The target moved by all terms, where some are switched off.
    whole: Option<Motion>,
}

impl Following {
    pub(crate) fn new(
        platoon: &PlatoonRule,
        traffic: Traffic,
        (site, shape): (&str, &WindowShape),
        acting: ActingTerms,
    ) -> Result<Self, ForceError> {
        let motion = platoon.roll_out_with(site, &traffic, shape, acting)?;
        let whole = (acting != ActingTerms::ALL).then(|| platoon.roll_out(site, &traffic, shape)).transpose()?;
        Ok(Self { traffic, motion, whole })
    }

    /// Rolls its traffic out in its memory.
    pub(crate) fn roll_out(
        &mut self,
        platoon: &PlatoonRule,
        (site, shape): (&str, &WindowShape),
        acting: ActingTerms,
        room: &mut PlatoonRoom,
    ) -> Result<(), ForceError> {
        platoon.roll_out_into(site, &self.traffic, shape, acting, &mut self.motion, room)?;
        if acting == ActingTerms::ALL {
            self.whole = None;
            return Ok(());
        }
        let whole = self.whole.get_or_insert_default();
        platoon.roll_out_into(site, &self.traffic, shape, ActingTerms::ALL, whole, room)
    }

    /// How the target moves with all terms: what the networks are told, whichever act.
    pub(crate) fn whole(&self) -> &Motion {
        self.whole.as_ref().unwrap_or(&self.motion)
    }
}

impl<'a> Situation<'a> {
    /// The window of a target that follows, with the velocity `vy` across the road, m/s.
    pub(crate) fn behind(platoon: Following, seen: AugmentedView<'a>, vy: f32) -> Self {
        let velocity = [platoon.motion.speed(Traffic::TARGET, 0) as f32, vy];
        Self { seen, velocity, platoon: Some(platoon) }
    }

    /// The window as the networks see it.
    #[must_use]
    pub fn view(&self) -> &AugmentedView<'a> {
        &self.seen
    }

    /// Velocity of the target at the last observed frame, m/s.
    #[must_use]
    pub fn velocity(&self) -> [f32; 2] {
        self.velocity
    }

    fn dt(&self) -> f64 {
        self.seen.observation().shape().dt()
    }

    /// Where the reference path is after `step` steps, m, window frame; the platoon's without the terms that are switched
    /// off.
    #[must_use]
    pub fn reference(&self, step: usize) -> [f32; 2] {
        let time = step as f64 * self.dt();
        let [vx, vy] = self.velocity.map(f64::from);
        let at = match &self.platoon {
            None => [vx * time, vy * time],
            Some(platoon) => [platoon.motion.position(Traffic::TARGET, step), lateral(vy, time)],
        };
        at.map(|value| value as f32)
    }

    /// How far along the road, and at which speed, the frame in which the social force drives has moved after `step`
    /// steps, m and m/s: with the platoon, or not at all. Across the road it stays, as lane lines do.
    pub(crate) fn frame(&self, step: usize) -> [f32; 2] {
        match &self.platoon {
            None => [0.; 2],
            Some(Following { motion, .. }) => {
                [motion.position(Traffic::TARGET, step), motion.speed(Traffic::TARGET, step)].map(|value| value as f32)
            }
        }
    }

    /// Where the neighbour in `slot` is as each step sets out if it follows the column ahead of it, window frame; nothing
    /// where nobody is. `settling` is [`lateral`] of 1 m/s at these times.
    pub(crate) fn following_neighbour(
        &self,
        slot: Slot,
        settling: &[f64],
        window_s: f64,
    ) -> impl Iterator<Item = TrackState> {
        let following = self.platoon.as_ref().and_then(|Following { traffic, motion, .. }| {
            let place = traffic.place(self.seen.recorded_slot(slot))?;
            Some((motion, place, self.seen.neighbour(slot)?.now(window_s)))
        });
        following.into_iter().flat_map(move |(motion, place, now)| {
            settling.iter().enumerate().map(move |(step, settling)| TrackState {
                x: motion.position(place, step) as f32,
                y: now.y + (f64::from(now.vy) * settling) as f32,
                vx: motion.speed(place, step) as f32,
                vy: 0.,
            })
        })
    }
}
