//! The floor: how long the operations of a network take at the speed of large matrix products here.
//!
//! Counted are the multiplications and additions of every product; absent neighbours are skipped, the
//! history is taken in once a window, and activations, forces and memory cost nothing. A training
//! step is three times the forward pass: products for the values, for the gradients of inputs and for
//! those of weights.

use anyhow::Result;
use candle_core::{Device, Tensor};
use gnp_traj::TrajConfig;

use super::clock;
use super::networks::Lengths;

/// Side of the square product that is timed.
const SIDE: usize = 2048;
/// Width, hidden units of the goal network's dense layers, encoder layers: as published.
const GOAL: [usize; 3] = [64, 128, 2];

/// Operations a second of a large f32 product on the threads of the present pool.
///
/// # Errors
/// Those of candle.
pub(super) fn rate() -> Result<f64> {
    let matrix = || -> Result<Tensor> {
        let values: Vec<f32> = (0..SIDE * SIDE).map(|i| (i % 17) as f32 / 17. - 0.5).collect();
        Ok(Tensor::from_vec(values, (SIDE, SIDE), &Device::Cpu)?)
    };
    let (a, b) = (matrix()?, matrix()?);
    let product = || {
        a.matmul(&b)?;
        Ok(())
    };
    // The fastest, not the median: a floor is what the machine can do.
    Ok(2. * (SIDE as f64).powi(3) / clock::sample(9, &product)?.quantile(0.))
}

/// Operations of a product of one row by `inputs * outputs` weights.
fn dense(inputs: usize, outputs: usize) -> f64 {
    2. * inputs as f64 * outputs as f64
}

/// Operations of dense layers of these widths.
fn layers(widths: &[usize]) -> f64 {
    widths.windows(2).map(|pair| dense(pair[0], pair[1])).sum()
}

/// Operations to roll one window with `taken` neighbours out to `goals` goals.
pub(super) fn traj(lengths: Lengths, taken: f64, goals: usize) -> f64 {
    let cfg = TrajConfig::published();
    let encoder = |inputs: usize| layers(&[&[inputs], &cfg.encoder[..], &[cfg.latent_dim]].concat());
    let head = layers(&[&[2 * cfg.latent_dim], &cfg.decoder[..], &[1]].concat());
    let front = dense(4, cfg.embedding) + dense(cfg.embedding + cfg.hidden, 4 * cfg.hidden);
    let (observed, predicted, goals) = (lengths.observed as f64, lengths.predicted as f64, goals as f64);
    // The first predicted step starts from the history's last state.
    let fronts = 2. * front * (observed + goals * (predicted - 1.));
    let codes = goals * (encoder(2) + predicted * 2. * dense(cfg.hidden, cfg.latent_dim));
    let heads = goals * predicted * head * (1. + taken);
    fronts + codes + heads + predicted * taken * encoder(4)
}

/// Operations of the goal network for one window with `taken` neighbours, of which `goals` goals are decoded.
pub(super) fn goal(lengths: Lengths, taken: f64, goals: usize) -> f64 {
    let [width, hidden, blocks] = GOAL;
    let Lengths { observed, predicted, modes, .. } = lengths;
    let (tokens, picked) = (modes as f64, goals as f64);
    let map = dense(width, width);
    // Scores and weighted values of every query against every key.
    let attend = |queries: f64, keys: f64| 2. * queries * keys * 2. * width as f64;
    let feed = layers(&[width, hidden, width]);
    let encoder = blocks as f64 * (tokens * (4. * map + feed) + attend(tokens, tokens));
    let decoder = picked * (2. * map + feed) + taken * 2. * map + attend(picked, taken);
    let inputs = (1. + taken) * dense(4 * observed, width);
    inputs + encoder + decoder + tokens * dense(width, 1) + picked * dense(width, 2 * predicted)
}

#[cfg(test)]
mod tests {
    use super::super::networks::{HIGHD, NGSIM};
    use super::*;

    #[test]
    fn operations_of_the_roll_out_are_those_counted_by_hand() {
        // A step: two LSTMs of 320 by 1024, heads of 279 040 weights for tau and 5.2 neighbours.
        let step = 2. * 2. * (320. * 1024. + 4. * 64.) + 6.2 * 2. * 279_040. + 5.2 * 2. * 20_736. + 2. * 2. * 4096.;
        let whole = 50. * step + 29. * 4. * (320. * 1024. + 4. * 64.);
        assert!((traj(NGSIM, 5.2, 1) / whole - 1.).abs() < 0.001, "{} {whole}", traj(NGSIM, 5.2, 1));
    }

    #[test]
    fn more_goals_share_the_history() {
        let (one, twenty) = (traj(HIGHD, 5.2, 1), traj(HIGHD, 5.2, 20));
        assert!(twenty < 20. * one && twenty > 15. * one);
        assert!(goal(NGSIM, 5.2, 20) < 1.2 * goal(NGSIM, 5.2, 1), "the encoder, the larger part, is the same");
    }

    #[test]
    fn longer_windows_and_more_modes_cost_more() {
        assert!(traj(HIGHD, 5.2, 1) > 2. * traj(NGSIM, 5.2, 1));
        assert!(goal(HIGHD, 5.2, 1) > 2. * goal(NGSIM, 5.2, 1));
    }
}
