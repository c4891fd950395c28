//! How much of what is learned is believed.

use std::fmt;

use gnp_data::Window;
use gnp_modes::ModeFrame;
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::augmented_view::AugmentedView;
use crate::error::ModelError;
use crate::gnp::{Gnp, Trained};
use crate::situation::Situation;

/// How much of what the goal network expects on average beyond the reference path is believed. What is learned from few
/// windows is right about the direction more often than about the size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trust {
    /// This share, 0 to 1.
    Share(f64),
    /// The share with the least squared error over the validation part, which is kept with the goal network:
    /// [`Header::trust`](crate::Header::trust).
    Fitted,
}

const FITTED: &str = "fitted";

impl fmt::Display for Trust {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Share(share) => write!(f, "{share}"),
            Self::Fitted => f.write_str(FITTED),
        }
    }
}

impl Serialize for Trust {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Share(share) => serializer.serialize_f64(*share),
            Self::Fitted => serializer.serialize_str(FITTED),
        }
    }
}

impl<'de> Deserialize<'de> for Trust {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OfTrust;
        impl Visitor<'_> for OfTrust {
            type Value = Trust;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a share between 0 and 1, or \"{FITTED}\"")
            }

            fn visit_f64<E: Error>(self, share: f64) -> Result<Trust, E> {
                Ok(Trust::Share(share))
            }

            fn visit_i64<E: Error>(self, share: i64) -> Result<Trust, E> {
                Ok(Trust::Share(share as f64))
            }

            fn visit_u64<E: Error>(self, share: u64) -> Result<Trust, E> {
                Ok(Trust::Share(share as f64))
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Trust, E> {
                if text == FITTED {
                    Ok(Trust::Fitted)
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Str(text), &self))
                }
            }
        }
        deserializer.deserialize_any(OfTrust)
    }
}

/// Windows whose goals are decoded at once.
const BATCH: usize = 256;

impl Gnp {
    /// How much of what the network expects on average beyond the reference path is believed; all of it unless
    /// set. The rest is left out of every future, so that they keep their distances to each other.
    ///
    /// # Errors
    /// [`ModelError::Config`] for a share that is none, for a fitted one where none is kept with the weights, or for less than
    /// all where futures are no deviations from a reference.
    pub fn trusting(self, trust: Trust) -> Result<Self, ModelError> {
        let refuse = |problem| Err(ModelError::config("predict.trust", problem));
        let share = match trust {
            Trust::Share(share) => share,
            Trust::Fitted => match self.trained.header.trust {
                Some(share) => share,
                None => return refuse("is \"fitted\", but no share is kept with these weights: give one, such as 1.0"),
            },
        };
        if !(0. ..=1.).contains(&share) {
            return refuse("must be between 0 and 1");
        }
        if share < 1. && !self.has_reference() {
            return refuse("is below 1, but futures are positions and have no reference: set it to 1.0");
        }
        let mut gnp = self;
        gnp.trust = share as f32;
        Ok(gnp)
    }

    /// Share of what the network expects on average beyond the reference path that is believed, 0 to 1.
    #[must_use]
    pub fn trust(&self) -> f32 {
        self.trust
    }

    /// Whether futures are deviations from a reference path.
    pub(crate) fn has_reference(&self) -> bool {
        self.trained.features.mode_frame() != ModeFrame::Position
    }

    /// The mean of all decoded futures of each window, in its frame, m: what is expected before any share of it is left out.
    fn expected(&self, situations: &[Situation<'_>]) -> Result<Vec<Vec<[f32; 2]>>, ModelError> {
        let Trained { features, modes, centres, goal, device, thread, .. } = &*self.trained;
        let decode = || -> Result<_, ModelError> {
            let inputs = features.goal_inputs(situations, device)?;
            let goals = goal.predict(&inputs.observed, &inputs.neighbours, &inputs.mask, centres, modes.len())?;
            let futures = (goals.futures * features.config().length_scale)?.flatten_all()?.to_vec1::<f32>()?;
            Ok((futures, goals.probabilities.to_vec2::<f32>()?))
        };
        let (futures, probabilities) = thread.run(decode)?;
        let by_window = futures.chunks_exact(2 * features.shape().t_pred * modes.len());
        let mean = |(situation, (paths, probabilities)): (&Situation<'_>, (&[f32], &Vec<f32>))| {
            features.to_window_frame(situation, &mean_path(paths, probabilities))
        };
        Ok(situations.iter().zip(by_window.zip(&probabilities)).map(mean).collect())
    }

    /// Takes from the `paths` `[modes, t_pred, 2]` of a window, deviations, what is not believed of their mean.
    pub(crate) fn shrink(&self, paths: &mut [f32], probabilities: &[f32]) {
        if self.trust >= 1. {
            return;
        }
        let mean = mean_path(paths, probabilities);
        for path in paths.chunks_exact_mut(mean.len().max(1)) {
            path.iter_mut().zip(&mean).for_each(|(value, mean)| *value -= (1. - self.trust) * mean);
        }
    }

    /// [`Gnp::shrink`] of last points alone.
    pub(crate) fn shrink_ends(&self, ends: &mut [[f32; 2]], probabilities: &[f32]) {
        if self.trust >= 1. {
            return;
        }
        let mut mean = [0f32; 2];
        for (end, probability) in ends.iter().zip(probabilities) {
            mean = [mean[0] + probability * end[0], mean[1] + probability * end[1]];
        }
        for end in ends {
            *end = [end[0] - (1. - self.trust) * mean[0], end[1] - (1. - self.trust) * mean[1]];
        }
    }

    /// The share of what the goal network expects on average beyond the reference path, 0 to 1, with the least squared
    /// error over all predicted frames of `windows`, each counted with its weight; `None` where futures are positions and
    /// have no reference. Windows of the validation part are those to ask for.
    ///
    /// # Errors
    /// When a window has another shape, or the network fails.
    pub fn fitted_trust(&self, windows: &[(Window<'_>, f64)]) -> Result<Option<f64>, ModelError> {
        if !self.has_reference() {
            return Ok(None);
        }
        let (mut product, mut square) = (0., 0.);
        for windows in windows.chunks(BATCH) {
            let observations: Vec<_> = windows.iter().map(|(window, _)| window.observation()).collect();
            let situations = self.situations(&observations)?;
            let expected = self.expected(&situations)?;
            for ((window, weight), (situation, mean)) in windows.iter().zip(situations.iter().zip(&expected)) {
                let (truth, seen) = (window.truth(), AugmentedView::recorded(window.observation()));
                for (j, mean) in mean.iter().enumerate() {
                    let (state, reference) = (seen.true_target(&truth, j), situation.reference(j + 1));
                    for (axis, recorded) in [state.x, state.y].into_iter().enumerate() {
                        let learned = f64::from(mean[axis] - reference[axis]);
                        product += weight * learned * f64::from(recorded - reference[axis]);
                        square += weight * learned * learned;
                    }
                }
            }
        }
        Ok(Some(if square > 0. { (product / square).clamp(0., 1.) } else { 0. }))
    }
}

/// Mean of `paths` `[modes, t_pred, 2]`, weighted by probability.
fn mean_path(paths: &[f32], probabilities: &[f32]) -> Vec<f32> {
    let values = paths.len() / probabilities.len().max(1);
    let mut mean = vec![0f32; values];
    for (path, probability) in paths.chunks_exact(values.max(1)).zip(probabilities) {
        mean.iter_mut().zip(path).for_each(|(mean, value)| *mean += probability * value);
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Deserialize, Serialize)]
    struct Of {
        trust: Trust,
    }

    #[test]
    fn a_share_or_the_word_and_nothing_else() {
        let read = |text: &str| toml::from_str::<Of>(&format!("trust = {text}")).map(|of| of.trust);
        assert_eq!(read("0.5").unwrap(), Trust::Share(0.5));
        assert_eq!(read("1").unwrap(), Trust::Share(1.));
        assert_eq!(read("\"fitted\"").unwrap(), Trust::Fitted);
        for bad in ["\"half\"", "true"] {
            let error = read(bad).unwrap_err().to_string();
            assert!(error.contains("between 0 and 1, or \"fitted\""), "{error}");
        }
        for trust in [Trust::Share(0.25), Trust::Fitted] {
            let text = toml::to_string(&Of { trust }).unwrap();
            assert_eq!(toml::from_str::<Of>(&text).unwrap().trust, trust);
            assert!(text.contains(&trust.to_string()));
        }
    }
}
