//! How much of what is learned is believed.

use std::fmt;

use gnp_data::Window;
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::augmented_view::AugmentedView;
use crate::error::ModelError;
use crate::gnp::Gnp;

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

impl Trust {
    /// Whether it can be used.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        match self {
            Self::Share(share) => (0. ..=1.).contains(share),
            Self::Fitted => true,
        }
    }
}

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
        let whole = self.clone().trusting(Trust::Share(1.))?;
        let (mut product, mut square) = (0., 0.);
        for windows in windows.chunks(BATCH) {
            let observations: Vec<_> = windows.iter().map(|(window, _)| window.observation()).collect();
            let situations = whole.situations(&observations)?;
            let expected = whole.expected(&situations)?;
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
            assert!(trust.is_valid() && text.contains(&trust.to_string()));
        }
        assert!(!Trust::Share(1.5).is_valid() && !Trust::Share(f64::NAN).is_valid());
    }
}
