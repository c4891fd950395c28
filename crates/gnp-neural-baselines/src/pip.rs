//! PiP: planning-informed prediction (Song et al. 2020), with or without a plan and with or without
//! its fusion of targets.
//!
//! The fusion gathers each target from its own cell, as the paper means it. The published code reads
//! the first cells of the batch instead.

mod fusion;
mod scene;

use candle_core::{Result, Tensor};
use candle_nn::{Linear, Module, VarBuilder};
use gnp_nn::{Lstm, linear};

use crate::conv::Conv;
use crate::encoder::{DYNAMICS, Decoder, EMBEDDED, ENCODED, SLOPE, leaky, read};
use crate::grid::{PLACE_COLUMNS, PLACE_ROWS};
use crate::network::{Ask, MANOEUVRE, ManoeuvreHeads, Means, Network, Output, decode};
use crate::pooling::{Window, max_pool};
use crate::slstm::SOCIAL;

pub(crate) use fusion::Fusion;
pub(crate) use scene::{Plan, Scenes};

/// Width of a target's code.
const CODE: usize = SOCIAL + DYNAMICS;

/// The network: 2,579,034 weights; 2,513,930 without plan, 260,186 without fusion, 195,082 without both.
#[derive(Clone, Debug)]
pub(crate) struct Pip {
    embed: Linear,
    history: Lstm,
    dynamics: Linear,
    around: Around,
    plan: Option<(Lstm, Around)>,
    fusion: Option<Fusion>,
    heads: ManoeuvreHeads,
    decoder: Decoder,
    points: usize,
}

/// Convolutions over a grid by position: `[grids, 9, 1, 16]` from the codes in its cells.
#[derive(Clone, Debug)]
struct Around {
    wide: Conv,
    narrow: Conv,
}

impl Around {
    fn new(vb: &VarBuilder) -> Result<Self> {
        Ok(Self {
            wide: Conv::new(ENCODED, 64, [3, 3], [0, 0], &vb.pp("3x3"))?,
            narrow: Conv::new(64, 16, [3, 1], [0, 0], &vb.pp("3x1"))?,
        })
    }

    fn forward(&self, codes: &Tensor, cells: &[u32], grids: usize) -> Result<Tensor> {
        let overlapping = Window { kernel: 3, stride: 2, padding: 0, ceil: false };
        let wide = self.wide.forward_sparse(codes, cells, grids, [PLACE_ROWS, PLACE_COLUMNS], SLOPE)?;
        self.narrow.forward(&max_pool(&wide, overlapping, overlapping)?, SLOPE)
    }
}

impl Pip {
    /// A network that predicts `points` points.
    pub(crate) fn new(points: usize, plan: bool, fusion: bool, vb: &VarBuilder) -> Result<Self> {
        let plan = plan
            .then(|| {
                let reader = Lstm::new(EMBEDDED, ENCODED, vb.pp("plan"))?;
                Ok::<_, candle_core::Error>((reader, Around::new(&vb.pp("plan_grid"))?))
            })
            .transpose()?;
        let code = if fusion { 2 * CODE } else { CODE };
        Ok(Self {
            // A convolution over three points of a path is a linear layer on the three side by side.
            embed: linear(6, EMBEDDED, vb.pp("embed"))?,
            history: Lstm::new(EMBEDDED, ENCODED, vb.pp("encoder"))?,
            dynamics: linear(ENCODED, DYNAMICS, vb.pp("dynamics"))?,
            around: Around::new(&vb.pp("history_grid"))?,
            plan,
            fusion: fusion.then(|| Fusion::new(CODE, &vb.pp("fusion"))).transpose()?,
            heads: ManoeuvreHeads::new(code, vb)?,
            decoder: Decoder::new(code + MANOEUVRE, vb)?,
            points,
        })
    }

    /// `[targets, 80]` from the paths around each target, and the plan where the network takes one.
    fn social(&self, neighbours: &Tensor, scenes: &Scenes) -> Result<Tensor> {
        let targets = scenes.target_cells.len();
        let along = Window { padding: 1, ..Window::of(2) };
        let history = self.around.forward(neighbours, &scenes.cells, targets)?;
        let pooled = match &self.plan {
            Some((reader, around)) => {
                let plans = read(&self.embed, reader, &scenes.plans)?;
                let plans = around.forward(&plans, &scenes.plan_cells, targets)?;
                max_pool(&Tensor::cat(&[history, plans], 2)?, along, Window::of(2))?
            }
            None => max_pool(&history, along, Window::of(1))?,
        };
        pooled.permute((0, 3, 1, 2))?.contiguous()?.reshape((targets, SOCIAL))
    }
}

impl Network<Scenes> for Pip {
    fn forward(&self, scenes: &Scenes, ask: Ask<'_>) -> Result<Output> {
        let targets = scenes.target_cells.len();
        let paths = Tensor::cat(&[&scenes.targets, &scenes.neighbours], 1)?;
        let codes = read(&self.embed, &self.history, &paths)?;
        let own = leaky(&self.dynamics.forward(&codes.narrow(0, 0, targets)?)?)?;
        let neighbours = codes.narrow(0, targets, scenes.cells.len())?;
        let codes = Tensor::cat(&[self.social(&neighbours, scenes)?, own], 1)?;
        let scored = codes.index_select(&Tensor::new(scenes.scored.as_slice(), codes.device())?, 0)?;
        let scored = match &self.fusion {
            Some(fusion) => {
                let cells: Vec<u32> = scenes.scored.iter().map(|n| scenes.target_cells[*n as usize]).collect();
                let training = matches!(ask, Ask::Train(_));
                let fused = fusion.forward(&codes, &scenes.target_cells, &cells, scenes.windows, training)?;
                Tensor::cat(&[scored, fused], 1)?
            }
            None => scored,
        };
        decode(&scored, &self.decoder, Some(&self.heads), self.points, Means::Steps, ask)
    }
}
