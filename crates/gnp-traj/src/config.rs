//! Sizes, force limits and integrator of the neural social force.

use gnp_force::Integrator;
use serde::{Deserialize, Serialize};

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

    /// Checks every value.
    ///
    /// # Errors
    /// Names the first key out of range and what it must be.
    pub fn check(&self) -> Result<(), TrajError> {
        let refuse = |key, value: String, remedy| Err(TrajError::Config { key, value, remedy });
        for (key, width) in [("hidden", self.hidden), ("embedding", self.embedding), ("latent_dim", self.latent_dim)] {
            if width == 0 {
                return refuse(key, width.to_string(), "give at least 1 unit");
            }
        }
        for (key, widths) in [("encoder", &self.encoder), ("decoder", &self.decoder)] {
            if widths.is_empty() || widths.contains(&0) {
                return refuse(key, format!("{widths:?}"), "give at least one layer, each of at least 1 unit");
            }
        }
        let positive = [
            ("tau_max", self.tau_max),
            ("k_max", self.k_max),
            ("k_max_line", self.k_max_line),
            ("r_col", self.r_col),
            ("input_scale.position", self.input_scale.position),
            ("input_scale.velocity", self.input_scale.velocity),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.) {
                return refuse(key, value.to_string(), "give a positive number");
            }
        }
        if !self.k_bias.is_finite() {
            return refuse("k_bias", self.k_bias.to_string(), "give a finite number");
        }
        if self.integrator == Integrator::RungeKutta4 {
            let remedy = "give explicit or semi_implicit; the networks run once a step";
            return refuse("integrator", "runge_kutta4".to_owned(), remedy);
        }
        if self.network_period == 0 {
            return refuse("network_period", "0".to_owned(), "give 1 to run the networks at every step");
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
