//! The windows of a part, and a mini-batch of them as the networks are to see it.

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{Window, WindowId, WindowSet};
use gnp_model::AugmentedView;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::config::within;
use crate::error::TrainError;
use crate::seed::derive_seed;
use crate::stage::Part;

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

    /// Site of each window as a number, in the order of the sites' names.
    #[must_use]
    pub fn sites(&self) -> Vec<u32> {
        let name = |id: &WindowId| self.set.recording(*id).map_or("", |recording| recording.meta().site.as_str());
        let names: BTreeSet<&str> = self.ids.iter().map(name).collect();
        let number: BTreeMap<&str, u32> = names.into_iter().zip(0..).collect();
        self.ids.iter().map(|id| number[name(id)]).collect()
    }

    /// Those of `part`, as `augment` has them seen.
    pub(crate) fn part(
        &self,
        part: Part<'_>,
        augment: Augment,
    ) -> Result<Vec<(AugmentedView<'a>, Window<'a>)>, TrainError> {
        let mut rng = ChaCha8Rng::seed_from_u64(derive_seed(part.seed, 0));
        let mut draw = || (rng.random::<f64>(), rng.random::<f64>());
        // What is drawn for those before them in the mini-batch.
        (0..part.first).for_each(|_| _ = draw());
        let view = |index: &usize| {
            let window = self.ids.get(*index).and_then(|id| self.set.get(*id));
            let window = window.ok_or(TrainError::Window { index: *index, windows: self.len() })?;
            // Drawn for every window, so that a setting does not change what is drawn after it.
            let (side, place) = draw();
            let mirrored = side < augment.mirror;
            let observation = window.observation();
            let seen =
                if mirrored { AugmentedView::mirrored(observation) } else { AugmentedView::recorded(observation) };
            let longitudinal_scale = augment.longitudinal_scale.powf(2. * place - 1.);
            Ok((seen.scaled_along_road(longitudinal_scale as f32), window))
        };
        part.windows.iter().map(view).collect()
    }
}

/// How training windows are varied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Augment {
    /// Share that is seen with left and right exchanged.
    pub(crate) mirror: f64,
    /// Largest factor by which lengths along the road are multiplied or divided; the factor's
    /// logarithm is drawn evenly.
    pub(crate) longitudinal_scale: f64,
}

impl Augment {
    /// Nothing is varied.
    pub(crate) const NONE: Self = Self { mirror: 0., longitudinal_scale: 1. };

    /// Its two numbers: key, least, most, unit.
    pub(crate) const RANGES: [(&'static str, f64, f64, &'static str); 2] = [
        ("mirror", 0., 1., "of the windows (0: as published)"),
        ("longitudinal_scale", 1., 4., "(1: as published, none)"),
    ];

    /// Whether both values can be used.
    pub(crate) fn check(self) -> Result<(), TrainError> {
        within(&Self::RANGES, &[self.mirror, self.longitudinal_scale])
    }
}
