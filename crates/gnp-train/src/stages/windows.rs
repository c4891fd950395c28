//! The windows of a part, and a mini-batch of them as the networks are to see it.

use gnp_data::{Window, WindowId, WindowSet};
use gnp_model::Seen;
use rand::Rng;

use crate::error::TrainError;

/// The windows of one part of a split, as names of views.
#[derive(Clone, Copy, Debug)]
pub struct Windows<'a> {
    set: &'a WindowSet<'a>,
    ids: &'a [WindowId],
}

impl<'a> Windows<'a> {
    /// The windows `ids` of `set`.
    #[must_use]
    pub fn new(set: &'a WindowSet<'a>, ids: &'a [WindowId]) -> Self {
        Self { set, ids }
    }

    /// Number of windows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Those at `indices`, a random share `mirror` of them with left and right exchanged.
    pub(crate) fn batch(
        &self,
        indices: &[usize],
        mirror: f64,
        rng: &mut impl Rng,
    ) -> Result<Vec<(Seen<'a>, Window<'a>)>, TrainError> {
        let view = |index: &usize| {
            let window = self.ids.get(*index).and_then(|id| self.set.get(*id));
            let window = window.ok_or(TrainError::Window { index: *index, windows: self.len() })?;
            // Drawn for every window, so that the share does not change what is drawn after it.
            let mirrored = rng.random::<f64>() < mirror;
            let observation = window.observation();
            let seen = if mirrored { Seen::mirrored(observation) } else { Seen::recorded(observation) };
            Ok((seen, window))
        };
        indices.iter().map(view).collect()
    }
}

/// Whether `mirror` is a share.
pub(crate) fn check_mirror(mirror: f64) -> Result<(), TrainError> {
    let remedy = "give a share between 0 (as published) and 1";
    let error = TrainError::Config { key: "mirror", value: mirror.to_string(), remedy };
    (0. ..=1.).contains(&mirror).then_some(()).ok_or(error)
}
