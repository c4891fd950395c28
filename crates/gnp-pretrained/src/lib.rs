//! Weights that come with the program, under half a megabyte: a predictor without a training.
//!
//! ```
//! use gnp_pretrained::ngsim;
//!
//! let gnp = ngsim()?;
//! assert_eq!(gnp.shape().rate_hz, 10.); // 3 s observed, 5 s predicted
//! # Ok::<(), gnp_model::ModelError>(())
//! ```
//!
//! [`folder`] has the card of a model: what it was trained on, how well it does, what it was not made for.

use gnp_model::{Device, Gnp, ModelError, ModelFolder};

/// A model in the program.
struct Embedded {
    name: &'static str,
    card: &'static [u8],
    files: [&'static [u8]; 3],
}

const EMBEDDED: [Embedded; 1] = [Embedded {
    name: "ngsim",
    card: include_bytes!("../models/ngsim/card.json"),
    files: [
        include_bytes!("../models/ngsim/modes.safetensors"),
        include_bytes!("../models/ngsim/goal.safetensors"),
        include_bytes!("../models/ngsim/repulsion.safetensors"),
    ],
}];

/// Names of the models.
pub const NAMES: [&str; 1] = [EMBEDDED[0].name];

/// The one that is taken where none is named.
pub const DEFAULT: &str = NAMES[0];

/// The model called `name` with its card; `None` where there is none of that name.
///
/// # Errors
/// When a file that was built in is not what its card says.
pub fn folder(name: &str) -> Result<Option<ModelFolder>, ModelError> {
    let found = EMBEDDED.iter().find(|model| model.name == name);
    found.map(|model| ModelFolder::embedded(model.name, model.card, model.files)).transpose()
}

/// The predictor of US-101 and I-80, on the processor.
///
/// # Errors
/// As [`folder`].
pub fn ngsim() -> Result<Gnp, ModelError> {
    let Embedded { name, card, files } = EMBEDDED[0];
    ModelFolder::embedded(name, card, files)?.model(&Device::Cpu)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_is_what_its_card_says_and_is_small() {
        for name in NAMES {
            let folder = folder(name).unwrap().unwrap();
            let card = folder.card();
            assert_eq!(card.name, name);
            assert!(!card.limits.is_empty() && !card.scores.rows.is_empty() && !card.data.simulated);
            assert!(card.files.values().map(|seal| seal.bytes).sum::<u64>() < 5_000_000);
            let gnp = folder.model(&Device::Cpu).unwrap();
            assert_eq!(gnp.shape().rate_hz, card.windows.rate_hz);
        }
        assert!(folder("none").unwrap().is_none());
    }

    #[test]
    fn the_text_of_the_card_stands_beside_it() {
        let text = include_str!("../models/ngsim/README.md");
        assert_eq!(folder(DEFAULT).unwrap().unwrap().card().text(), text);
    }
}
