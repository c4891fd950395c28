//! The one table of weights: which layers there are, what they are called, how wide they are, and in which order.
//!
//! [`Net::build`] is the table. The graph's modules, the flat vector of the fused roll-out and with it the names in
//! checkpoints are what different [`Builder`]s make of it.

use std::convert::Infallible;

use rayon::prelude::*;

use crate::TrajConfig;

/// Both networks; `L` is a linear layer, `C` an LSTM cell, `M` linear layers with ReLU between them.
#[derive(Clone, Debug)]
pub(crate) struct Net<L, C = L, M = Vec<L>> {
    /// Of phi_1 and of phi_2.
    pub(crate) history_encoders: [HistoryEncoder<L, C>; 2],
    pub(crate) enc_goal: M,
    pub(crate) tau: M,
    pub(crate) enc_nei: M,
    pub(crate) k: M,
    /// No layer without lines.
    pub(crate) enc_line: M,
    pub(crate) k_line: M,
}

/// Embedding, LSTM and latent of a history, observed or predicted.
#[derive(Clone, Debug)]
pub(crate) struct HistoryEncoder<L, C = L> {
    pub(crate) emb: L,
    pub(crate) cell: C,
    pub(crate) out: L,
}

/// What makes something of each layer of the table.
pub(crate) trait Builder {
    type Linear;
    type Cell;
    type Mlp;
    type Error;

    /// `[inputs]` to `[outputs]`.
    fn linear(&mut self, name: &str, inputs: usize, outputs: usize) -> Result<Self::Linear, Self::Error>;

    /// An LSTM cell.
    fn cell(&mut self, name: &str, inputs: usize, hidden: usize) -> Result<Self::Cell, Self::Error>;

    /// Linear layers between `widths`; the inputs of the first one come in `parts`, and the last bias starts at `bias`
    /// where that is given.
    fn mlp(
        &mut self,
        name: &str,
        widths: &[usize],
        parts: &[usize],
        bias: Option<f64>,
    ) -> Result<Self::Mlp, Self::Error>;

    /// Called before the first layer of phi_2.
    fn phi_2(&mut self) {}
}

impl<L, C, M> Net<L, C, M> {
    /// Every layer of both networks, phi_1 first.
    pub(crate) fn build<B>(cfg: &TrajConfig, builder: &mut B) -> Result<Self, B::Error>
    where
        B: Builder<Linear = L, Cell = C, Mlp = M>,
    {
        let encoder = |inputs: usize| [&[inputs], &cfg.encoder[..], &[cfg.latent_dim]].concat();
        let head = [&[2 * cfg.latent_dim], &cfg.decoder[..], &[1]].concat();
        let latents = [cfg.latent_dim, cfg.latent_dim];
        let strength = Some(cfg.k_bias);
        // A single width makes no layer.
        let line = |widths: Vec<usize>| if cfg.lines { widths } else { widths[..1].to_vec() };

        let first = HistoryEncoder::build(cfg, ["emb1", "cell1", "out1"], builder)?;
        let enc_goal = builder.mlp("enc_goal", &encoder(2), &[2], None)?;
        let tau = builder.mlp("tau", &head, &latents, None)?;
        builder.phi_2();
        let second = HistoryEncoder::build(cfg, ["emb2", "cell2", "out2"], builder)?;
        let enc_nei = builder.mlp("enc_nei", &encoder(4), &[4], None)?;
        let k = builder.mlp("k", &head, &latents, strength)?;
        let enc_line = builder.mlp("enc_line", &line(encoder(2)), &[2], None)?;
        let k_line = builder.mlp("k_line", &line(head), &latents, strength)?;
        Ok(Self { history_encoders: [first, second], enc_goal, tau, enc_nei, k, enc_line, k_line })
    }
}

impl<L, C> HistoryEncoder<L, C> {
    fn build<B>(cfg: &TrajConfig, [emb, cell, out]: [&str; 3], builder: &mut B) -> Result<Self, B::Error>
    where
        B: Builder<Linear = L, Cell = C>,
    {
        Ok(Self {
            emb: builder.linear(emb, 4, cfg.embedding)?,
            cell: builder.cell(cell, cfg.embedding, cfg.hidden)?,
            out: builder.linear(out, cfg.hidden, cfg.latent_dim)?,
        })
    }
}

impl<T> Net<T> {
    pub(crate) fn map<U>(&self, f: impl Fn(&T) -> U) -> Net<U> {
        let history_encoder =
            |x: &HistoryEncoder<T>| HistoryEncoder { emb: f(&x.emb), cell: f(&x.cell), out: f(&x.out) };
        let list = |x: &[T]| x.iter().map(&f).collect();
        Net {
            history_encoders: [history_encoder(&self.history_encoders[0]), history_encoder(&self.history_encoders[1])],
            enc_goal: list(&self.enc_goal),
            tau: list(&self.tau),
            enc_nei: list(&self.enc_nei),
            k: list(&self.k),
            enc_line: list(&self.enc_line),
            k_line: list(&self.k_line),
        }
    }

    /// [`Net::map`] with layers side by side on all threads.
    pub(crate) fn par_map<U: Send>(&self, f: impl Fn(&T) -> U + Sync) -> Net<U>
    where
        T: Sync,
    {
        let history_encoder = |x: &HistoryEncoder<T>| {
            let (cell, [emb, out]) = rayon::join(|| f(&x.cell), || [&x.emb, &x.out].map(&f));
            HistoryEncoder { emb, cell, out }
        };
        let list = |x: &[T]| x.par_iter().map(&f).collect();
        let [first, second] = &self.history_encoders;
        let ((first, second), ((enc_goal, tau), (enc_nei, k), (enc_line, k_line))) = rayon::join(
            || rayon::join(|| history_encoder(first), || history_encoder(second)),
            || {
                let pair = |a: &[T], b: &[T]| rayon::join(|| list(a), || list(b));
                (pair(&self.enc_goal, &self.tau), pair(&self.enc_nei, &self.k), pair(&self.enc_line, &self.k_line))
            },
        );
        Net { history_encoders: [first, second], enc_goal, tau, enc_nei, k, enc_line, k_line }
    }

    /// Every layer, in one fixed order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> {
        let lists = [&self.enc_goal, &self.tau, &self.enc_nei, &self.k, &self.enc_line, &self.k_line];
        self.history_encoders.iter().flat_map(|x| [&x.emb, &x.cell, &x.out]).chain(lists.into_iter().flatten())
    }
}

/// Counts the scalars of the layers.
pub(crate) struct Count(u64);

impl Count {
    /// All of both networks.
    pub(crate) fn of(cfg: &TrajConfig) -> u64 {
        let mut count = Self(0);
        let Ok(_) = Net::build(cfg, &mut count);
        count.0
    }

    fn add(&mut self, inputs: usize, outputs: usize, biases: u64) {
        self.0 += (inputs as u64 + biases) * outputs as u64;
    }
}

impl Builder for Count {
    type Linear = ();
    type Cell = ();
    type Mlp = ();
    type Error = Infallible;

    fn linear(&mut self, _: &str, inputs: usize, outputs: usize) -> Result<(), Infallible> {
        self.add(inputs, outputs, 1);
        Ok(())
    }

    fn cell(&mut self, _: &str, inputs: usize, hidden: usize) -> Result<(), Infallible> {
        self.add(inputs + hidden, 4 * hidden, 2);
        Ok(())
    }

    fn mlp(&mut self, _: &str, widths: &[usize], _: &[usize], _: Option<f64>) -> Result<(), Infallible> {
        widths.windows(2).for_each(|pair| self.add(pair[0], pair[1], 1));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_counted_without_being_made() {
        let published = TrajConfig::published();
        let small = TrajConfig { hidden: 6, embedding: 5, encoder: vec![7], decoder: vec![9, 8], ..published.clone() };
        for cfg in [TrajConfig { lines: true, ..small.clone() }, small, published] {
            let weights = gnp_nn::Weights::seeded(1, &candle_core::Device::Cpu);
            crate::SocialForce::new(&cfg, weights.builder()).unwrap();
            assert_eq!(Count::of(&cfg), weights.count() as u64);
        }
    }
}
