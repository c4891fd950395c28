//! CS-LSTM and CS-LSTM(M): convolutional social pooling (Deo and Trivedi 2018).

use candle_core::{Result, Tensor};
use candle_nn::{Linear, Module, VarBuilder};
use gnp_nn::linear;

use crate::conv::Conv;
use crate::encoder::{DYNAMICS, Decoder, ENCODED, PathEncoder, SLOPE, leaky};
use crate::grid::{LANE_CELLS, LANE_COLUMNS, LANE_ROWS};
use crate::inputs::Past;
use crate::network::{Ask, MANOEUVRE, ManoeuvreHeads, Means, Network, Output, decode};
use crate::pooling::{Window, max_pool};
use crate::slstm::{SOCIAL, encode};

/// The network: 191,829 weights, 194,954 with manoeuvres.
#[derive(Clone, Debug)]
pub(crate) struct CsLstm {
    encoder: PathEncoder,
    dynamics: Linear,
    wide: Conv,
    narrow: Conv,
    heads: Option<ManoeuvreHeads>,
    decoder: Decoder,
    points: usize,
}

impl CsLstm {
    /// A network that predicts `points` points, one future or, with `manoeuvres`, six.
    pub(crate) fn new(points: usize, manoeuvres: bool, vb: &VarBuilder) -> Result<Self> {
        let code = SOCIAL + DYNAMICS;
        let heads = manoeuvres.then(|| ManoeuvreHeads::new(code, vb)).transpose()?;
        Ok(Self {
            encoder: PathEncoder::new(2, vb)?,
            dynamics: linear(ENCODED, DYNAMICS, vb.pp("dynamics"))?,
            wide: Conv::new(ENCODED, 64, [3, 3], [0, 0], &vb.pp("social_3x3"))?,
            narrow: Conv::new(64, 16, [3, 1], [0, 0], &vb.pp("social_3x1"))?,
            heads,
            decoder: Decoder::new(if manoeuvres { code + MANOEUVRE } else { code }, vb)?,
            points,
        })
    }

    /// `[windows, 80]` from the codes of the neighbours `[occupied, 64]`.
    fn social(&self, neighbours: &Tensor, cells: &[u32], windows: usize) -> Result<Tensor> {
        // From columns of rows, as cells are counted, to rows of columns, as a kernel lies on them.
        let along_rows = |cell: &u32| {
            let (window, cell) = (*cell as usize / LANE_CELLS, *cell as usize % LANE_CELLS);
            let (column, row) = (cell / LANE_ROWS, cell % LANE_ROWS);
            (window * LANE_CELLS + row * LANE_COLUMNS + column) as u32
        };
        let cells: Vec<u32> = cells.iter().map(along_rows).collect();
        let wide = self.wide.forward_sparse(neighbours, &cells, windows, [LANE_ROWS, LANE_COLUMNS], SLOPE)?;
        let narrow = self.narrow.forward(&wide, SLOPE)?;
        let pooled = max_pool(&narrow, Window { padding: 1, ..Window::of(2) }, Window::of(1))?;
        // Channels first, as the published layers flatten them.
        pooled.permute((0, 3, 1, 2))?.contiguous()?.reshape((windows, SOCIAL))
    }
}

impl Network<Past> for CsLstm {
    fn forward(&self, past: &Past, ask: Ask<'_>) -> Result<Output> {
        let (target, neighbours) = encode(&self.encoder, past)?;
        let social = self.social(&neighbours, &past.cells, past.windows()?)?;
        let target = leaky(&self.dynamics.forward(&target)?)?;
        let codes = Tensor::cat(&[social, target], 1)?;
        decode(&codes, &self.decoder, self.heads.as_ref(), self.points, Means::Positions, ask)
    }
}
