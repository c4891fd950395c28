//! Sizes, force limits and integrator of the neural social force.

use gnp_force::Integrator;
use serde::{Deserialize, Serialize};

use crate::terms::FixedTerm;
use crate::weights::Count;
use crate::{TermConfig, TrajError};

/// Sizes and physics of the neural social force; the published values are [`TrajConfig::published`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajConfig {
    /// Units of each LSTM.
    pub hidden: usize,
    /// Width of the embedded state that enters an LSTM.
    pub embedding: usize,
    /// Width of the codes of history, goal, neighbour and line that enter the heads.
    pub latent_dim: usize,
    /// Hidden widths of the encoders of goal, neighbour and line.
    pub encoder: Vec<usize>,
    /// Hidden widths of the heads of `tau` and of the strengths.
    pub decoder: Vec<usize>,
    /// Largest relaxation time beyond one frame, in s: `tau = tau_max * sigmoid + dt`. 1 is the
    /// published form, in which a vehicle takes up the speed its goal asks for within a second.
    pub tau_max: f64,
    /// Largest strength of a neighbour's push, in m/s² at zero distance.
    pub k_max: f64,
    /// Largest strength of a line's push: the `k` of the line laws of `gnp_force`.
    pub k_max_line: f64,
    /// Initial bias of the last layer of both strength heads. 0 is close to the published start, at
    /// which every neighbour pushes with half of `k_max`; around -6 training starts from nearly no
    /// repulsion.
    pub k_bias: f64,
    /// Distance over which a neighbour's push falls to 1/e, in m.
    pub r_col: f64,
    /// Whether lane lines push; if so, scenes of the repulsion phases must give lines.
    pub lines: bool,
    /// Factors on what enters the networks; the physics always sees metres and m/s.
    pub input_scale: InputScale,
    /// How a step is taken: `explicit` (the paper's expansion) or `semi_implicit` (the published code).
    pub integrator: Integrator,
    /// The networks see every n-th frame, observed or rolled out, counted from the last observed
    /// one; the physics runs at every frame with the last `tau` and `k`. 1 is the published form.
    pub network_period: usize,
    /// Terms of the force beside those whose parameters the networks set; none in the published form, nor in files from
    /// before there were any.
    #[serde(default)]
    pub terms: Vec<TermConfig>,
}

/// Factors that multiply states, goals and neighbours before they enter a network. The distances
/// to lines are not scaled: they are a few metres already.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputScale {
    /// Factor on positions, in 1/m; 1 is the published form.
    pub position: f64,
    /// Factor on velocities, in s/m; 1 is the published form.
    pub velocity: f64,
}

impl TrajConfig {
    /// The published sizes and constants; no line force, as in the published code.
    #[must_use]
    pub fn published() -> Self {
        Self {
            hidden: 256,
            embedding: 64,
            latent_dim: 16,
            encoder: vec![64, 256],
            decoder: vec![512, 256, 512],
            tau_max: 1.,
            k_max: 100.,
            k_max_line: 10.,
            k_bias: 0.,
            r_col: 26.,
            lines: false,
            input_scale: InputScale { position: 1., velocity: 1. },
            integrator: Integrator::SemiImplicitEuler,
            network_period: 1,
            terms: Vec::new(),
        }
    }

    /// Every number: key, least, most, unit. What is larger is a slip of the keyboard and would end in a failed
    /// allocation or in numbers that are none.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 13] = [
        ("hidden", 1., 8192., "units"),
        ("embedding", 1., 8192., "units"),
        ("latent_dim", 1., 8192., "units"),
        ("encoder", 1., 8192., "units a layer"),
        ("decoder", 1., 8192., "units a layer"),
        ("tau_max", 1e-3, 1e3, "s"),
        ("k_max", 1e-6, 1e4, "m/s²"),
        ("k_max_line", 1e-6, 1e4, ""),
        ("k_bias", -100., 100., ""),
        ("r_col", 1e-2, 1e4, "m"),
        ("input_scale.position", 1e-6, 1e3, "1/m"),
        ("input_scale.velocity", 1e-6, 1e3, "s/m"),
        ("network_period", 1., 1e4, "frames"),
    ];
    /// Range of the parameters of [`TrajConfig::terms`], whatever their units are; a law may know a closer one.
    pub const TERM_PARAMETERS: (&'static str, f64, f64, &'static str) = ("terms.parameters.*", -1e6, 1e6, "");
    /// Most layers of an encoder or a decoder.
    pub const MOST_LAYERS: usize = 32;

    /// Number of weights of both networks, which need not be built for it.
    #[must_use]
    pub fn weights(&self) -> u64 {
        Count::of(self)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// Names the first key out of range and what it must be.
    pub fn check(&self) -> Result<(), TrajError> {
        let refuse = |key, value: String, remedy| Err(TrajError::Config { key, value, remedy });
        for (key, widths) in [("encoder", &self.encoder), ("decoder", &self.decoder)] {
            if !(1..=Self::MOST_LAYERS).contains(&widths.len()) {
                let remedy = format!("give 1 to {} layers", Self::MOST_LAYERS);
                return refuse(key, format!("of {} layers", widths.len()), remedy);
            }
        }
        let one = |value: usize| vec![value as f64];
        let each = |widths: &[usize]| widths.iter().map(|width| *width as f64).collect();
        let values: [Vec<f64>; 13] = [
            one(self.hidden),
            one(self.embedding),
            one(self.latent_dim),
            each(&self.encoder),
            each(&self.decoder),
            vec![self.tau_max],
            vec![self.k_max],
            vec![self.k_max_line],
            vec![self.k_bias],
            vec![self.r_col],
            vec![self.input_scale.position],
            vec![self.input_scale.velocity],
            one(self.network_period),
        ];
        let parameters = self.terms.iter().flat_map(|term| term.parameters.values().copied()).collect();
        let ranges = Self::RANGES.into_iter().chain([Self::TERM_PARAMETERS]);
        for ((key, least, most, unit), values) in ranges.zip(values.into_iter().chain([parameters])) {
            if let Some(value) = values.iter().find(|value| !(least..=most).contains(*value)) {
                let remedy = format!("give a number from {least} to {most} {unit}").trim_end().to_owned();
                return refuse(key, value.to_string(), remedy);
            }
        }
        // Not only when the force is built, which is after the goal network's training.
        self.terms.iter().try_for_each(|term| FixedTerm::configured(term).map(drop))?;
        if self.integrator == Integrator::RungeKutta4 {
            let remedy = "give explicit or semi_implicit; the networks run once a step";
            return refuse("integrator", "runge_kutta4".to_owned(), remedy.to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_value_out_of_range_is_named() {
        let refused = |change: fn(&mut TrajConfig)| {
            let mut cfg = TrajConfig::published();
            change(&mut cfg);
            match cfg.check() {
                Err(TrajError::Config { key, .. }) => key,
                other => panic!("{other:?}"),
            }
        };
        assert!(TrajConfig::published().check().is_ok());
        assert_eq!(refused(|c| c.hidden = 0), "hidden");
        assert_eq!(refused(|c| c.hidden = 1_000_000), "hidden");
        assert_eq!(refused(|c| c.encoder = vec![100_000_000_000]), "encoder");
        assert_eq!(refused(|c| c.encoder = vec![1; 33]), "encoder");
        assert_eq!(refused(|c| c.encoder.clear()), "encoder");
        assert_eq!(refused(|c| c.decoder[1] = 0), "decoder");
        assert_eq!(refused(|c| c.r_col = 0.), "r_col");
        assert_eq!(refused(|c| c.k_max = f64::NAN), "k_max");
        assert_eq!(refused(|c| c.k_max_line = -1.), "k_max_line");
        assert_eq!(refused(|c| c.k_bias = f64::INFINITY), "k_bias");
        assert_eq!(refused(|c| c.input_scale.velocity = 0.), "input_scale.velocity");
        assert_eq!(refused(|c| c.network_period = 0), "network_period");
        assert_eq!(refused(|c| c.integrator = Integrator::RungeKutta4), "integrator");
    }

    #[test]
    fn unknown_keys_are_refused_and_values_survive_toml() {
        let text = toml::to_string(&TrajConfig::published()).unwrap();
        assert_eq!(toml::from_str::<TrajConfig>(&text).unwrap(), TrajConfig::published());
        assert!(toml::from_str::<TrajConfig>(&format!("hiden = 3\n{text}")).is_err());
        assert!(text.contains("integrator = \"semi_implicit\""), "{text}");
        let lines = TermConfig { name: "lines".to_owned(), parameters: [("k".to_owned(), 0.3)].into() };
        let cfg = TrajConfig { terms: vec![lines], ..TrajConfig::published() };
        assert_eq!(toml::from_str::<TrajConfig>(&toml::to_string(&cfg).unwrap()).unwrap(), cfg);
        let before = text.replace("terms = []\n", "");
        assert_eq!(toml::from_str::<TrajConfig>(&before).unwrap(), TrajConfig::published());
    }
}
