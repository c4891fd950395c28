//! The two matrix products of the roll-out, at the widest vectors the processor has.
//!
//! Weights are packed once a call into panels of two vectors' width: a product then reads them in
//! order, whatever the number of rows, and a few rows at a time stay in registers.

use pulp::{Arch, Simd, WithSimd};

use super::aligned::Aligned;

/// Rows of a sum over rows that are packed at once: their panel stays in the innermost cache.
const BLOCK: usize = 192;

/// A weight matrix `[depth, width]` in panels.
#[derive(Debug)]
pub(crate) struct Panels {
    data: Aligned,
    depth: usize,
    width: usize,
}

impl Panels {
    /// Packs `matrix` `[depth, width]`; `width` is a multiple of a cache line.
    pub(crate) fn pack(matrix: &[f32], depth: usize, width: usize) -> Self {
        Self::pack_in(panel_width(), depth, width, |i, from, part| {
            part.copy_from_slice(&matrix[i * width + from..][..part.len()]);
        })
    }

    /// Packs the transpose of `matrix` `[width, stride]`, of which the first `depth` columns are used.
    pub(crate) fn pack_transposed(matrix: &[f32], stride: usize, depth: usize, width: usize) -> Self {
        Self::pack_in(panel_width(), depth, width, |i, from, part| {
            for (o, value) in part.iter_mut().enumerate() {
                *value = matrix[(from + o) * stride + i];
            }
        })
    }

    /// Packs into panels of the width of two vectors; `fill(i, from, part)` writes what row `i` has from
    /// column `from` on.
    fn pack_in(panel: usize, depth: usize, width: usize, fill: impl Fn(usize, usize, &mut [f32])) -> Self {
        let mut data = Aligned::zeros(depth * width);
        for from in (0..width).step_by(panel) {
            let part = panel.min(width - from);
            for (i, part) in data[from * depth..(from + part) * depth].chunks_exact_mut(part).enumerate() {
                fill(i, from, part);
            }
        }
        Self { data, depth, width }
    }

    pub(crate) fn width(&self) -> usize {
        self.width
    }
}

/// What a product starts from.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Start<'a> {
    Zero,
    /// One value a column `[width]`.
    Bias(&'a [f32]),
    /// What the result holds already.
    Sum,
}

/// Rows of a matrix: row `i` begins at `data[i * stride]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows<'a> {
    pub(crate) data: &'a [f32],
    pub(crate) stride: usize,
}

/// Rows of a matrix to write.
#[derive(Debug)]
pub(crate) struct RowsMut<'a> {
    pub(crate) data: &'a mut [f32],
    pub(crate) stride: usize,
}

/// `y = start + x * weights` on `count` rows, negative values set to 0 if `relu`.
pub(crate) fn product(count: usize, x: Rows<'_>, weights: &Panels, start: Start<'_>, relu: bool, y: RowsMut<'_>) {
    if count > 0 {
        Arch::new().dispatch(Product { count, x, weights, start, relu, y });
    }
}

/// `sum[o, i] += dy[t, o] * x[t, i]` over the `count` rows `t`, and `bias[o] += dy[t, o]`.
///
/// `sum` is `[outputs, inputs]`, both multiples of a cache line; `scratch` is overwritten.
pub(crate) fn outer_sum(
    count: usize,
    dy: Rows<'_>,
    x: Rows<'_>,
    sum: &mut [f32],
    bias: &mut [f32],
    inputs: usize,
    scratch: &mut Scratch,
) {
    if count > 0 {
        Arch::new().dispatch(OuterSum { count, dy, x, sum, bias, inputs, scratch });
    }
}

/// Packed rows of one [`outer_sum`] at a time.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    dy: Aligned,
    x: Aligned,
}

/// Two vectors.
fn panel_width() -> usize {
    struct Lanes;
    impl WithSimd for Lanes {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> usize {
            S::F32_LANES
        }
    }
    2 * Arch::new().dispatch(Lanes)
}

struct Product<'a> {
    count: usize,
    x: Rows<'a>,
    weights: &'a Panels,
    start: Start<'a>,
    relu: bool,
    y: RowsMut<'a>,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (panel, width) = (2 * S::F32_LANES, self.weights.width);
        for column in (0..width).step_by(panel) {
            if width - column >= panel {
                self.panel::<S, 2>(simd, column);
            } else {
                self.panel::<S, 1>(simd, column);
            }
        }
    }
}

impl Product<'_> {
    /// The columns from `column` on, `V` vectors of them, for all rows.
    #[inline(always)]
    fn panel<S: Simd, const V: usize>(&mut self, simd: S, column: usize) {
        let depth = self.weights.depth;
        let weights = &self.weights.data[column * depth..(column + V * S::F32_LANES) * depth];
        let weights = S::as_simd_f32s(weights).0;
        // As many rows as leave registers for the weights and one value of `x`.
        let tile = if size_of::<S::f32s>() == 64 { 8 } else { 6 };
        let mut row = 0;
        while row < self.count {
            let left = self.count - row;
            match if left >= tile { tile } else { left } {
                12 => self.tile::<S, 12, V>(simd, row, column, weights),
                11 => self.tile::<S, 11, V>(simd, row, column, weights),
                10 => self.tile::<S, 10, V>(simd, row, column, weights),
                9 => self.tile::<S, 9, V>(simd, row, column, weights),
                8 => self.tile::<S, 8, V>(simd, row, column, weights),
                7 => self.tile::<S, 7, V>(simd, row, column, weights),
                6 => self.tile::<S, 6, V>(simd, row, column, weights),
                5 => self.tile::<S, 5, V>(simd, row, column, weights),
                4 => self.tile::<S, 4, V>(simd, row, column, weights),
                3 => self.tile::<S, 3, V>(simd, row, column, weights),
                2 => self.tile::<S, 2, V>(simd, row, column, weights),
                _ => self.tile::<S, 1, V>(simd, row, column, weights),
            }
            row += tile;
        }
    }

    /// `R` rows of one panel.
    #[expect(clippy::needless_range_loop, reason = "sums that are indexed by constants alone stay in registers")]
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const V: usize>(
        &mut self,
        simd: S,
        row: usize,
        column: usize,
        weights: &[S::f32s],
    ) {
        let depth = self.weights.depth;
        let y_stride = self.y.stride;
        let place = |r: usize| (row + r) * y_stride + column;
        let x: [&[f32]; R] = std::array::from_fn(|r| &self.x.data[(row + r) * self.x.stride..][..depth]);
        let zero = simd.splat_f32s(0.);
        // Only ever indexed by constants, so that the sums stay in registers.
        let mut sums: [[S::f32s; V]; R] = match self.start {
            Start::Zero => [[zero; V]; R],
            Start::Bias(bias) => [load::<S, V>(&bias[column..]); R],
            Start::Sum => std::array::from_fn(|r| load::<S, V>(&self.y.data[place(r)..])),
        };
        for (i, weights) in weights.chunks_exact(V).enumerate().take(depth) {
            let weights: [S::f32s; V] = std::array::from_fn(|v| weights[v]);
            for r in 0..R {
                let x = simd.splat_f32s(x[r][i]);
                for v in 0..V {
                    sums[r][v] = simd.mul_add_e_f32s(x, weights[v], sums[r][v]);
                }
            }
        }
        for r in 0..R {
            let y = S::as_mut_simd_f32s(&mut self.y.data[place(r)..][..V * S::F32_LANES]).0;
            for v in 0..V {
                // `max` would turn NaN into 0 and hide that a weight has gone bad.
                let negative = simd.less_than_f32s(sums[r][v], zero);
                y[v] = if self.relu { simd.select_f32s(negative, zero, sums[r][v]) } else { sums[r][v] };
            }
        }
    }
}

/// The first `V` vectors of `values`.
#[inline(always)]
fn load<S: Simd, const V: usize>(values: &[f32]) -> [S::f32s; V] {
    let vectors = S::as_simd_f32s(&values[..V * S::F32_LANES]).0;
    std::array::from_fn(|v| vectors[v])
}

struct OuterSum<'a> {
    count: usize,
    dy: Rows<'a>,
    x: Rows<'a>,
    sum: &'a mut [f32],
    bias: &'a mut [f32],
    inputs: usize,
    scratch: &'a mut Scratch,
}

impl WithSimd for OuterSum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // Accumulators of `R` outputs by two vectors of inputs.
        if size_of::<S::f32s>() == 64 { self.blocks::<S, 8>(simd) } else { self.blocks::<S, 4>(simd) }
    }
}

impl OuterSum<'_> {
    #[inline(always)]
    fn blocks<S: Simd, const R: usize>(&mut self, simd: S) {
        let (outputs, panel) = (self.bias.len(), 2 * S::F32_LANES);
        if self.scratch.dy.len() < BLOCK * outputs {
            self.scratch.dy = Aligned::zeros(BLOCK * outputs);
        }
        if self.scratch.x.len() < BLOCK * panel {
            self.scratch.x = Aligned::zeros(BLOCK * panel);
        }
        for first in (0..self.count).step_by(BLOCK) {
            let count = BLOCK.min(self.count - first);
            for t in 0..count {
                let dy = &self.dy.data[(first + t) * self.dy.stride..][..outputs];
                for (bias, &dy) in self.bias.iter_mut().zip(dy) {
                    *bias += dy;
                }
                for (tile, dy) in dy.as_chunks::<R>().0.iter().enumerate() {
                    self.scratch.dy[(tile * count + t) * R..][..R].copy_from_slice(dy);
                }
            }
            for column in (0..self.inputs).step_by(panel) {
                if self.inputs - column >= panel {
                    self.panel::<S, R, 2>(simd, first, count, column);
                } else {
                    self.panel::<S, R, 1>(simd, first, count, column);
                }
            }
        }
    }

    #[expect(
        clippy::needless_range_loop,
        clippy::manual_memcpy,
        reason = "sums that are indexed by constants alone stay in registers"
    )]
    #[inline(always)]
    fn panel<S: Simd, const R: usize, const V: usize>(&mut self, simd: S, first: usize, count: usize, column: usize) {
        let width = V * S::F32_LANES;
        for (t, packed) in self.scratch.x.chunks_exact_mut(width).enumerate().take(count) {
            packed.copy_from_slice(&self.x.data[(first + t) * self.x.stride + column..][..width]);
        }
        let x = S::as_simd_f32s(&self.scratch.x[..count * width]).0;
        for (tile, dy) in self.scratch.dy.chunks_exact(count * R).enumerate().take(self.bias.len() / R) {
            let place = |r: usize| (tile * R + r) * self.inputs + column;
            let mut sums: [[S::f32s; V]; R] = std::array::from_fn(|r| load::<S, V>(&self.sum[place(r)..]));
            for (x, dy) in x.chunks_exact(V).zip(dy.as_chunks::<R>().0) {
                let x: [S::f32s; V] = std::array::from_fn(|v| x[v]);
                for r in 0..R {
                    let dy = simd.splat_f32s(dy[r]);
                    for v in 0..V {
                        sums[r][v] = simd.mul_add_e_f32s(dy, x[v], sums[r][v]);
                    }
                }
            }
            for r in 0..R {
                let sum = S::as_mut_simd_f32s(&mut self.sum[place(r)..][..width]).0;
                for v in 0..V {
                    sum[v] = sums[r][v];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Some values without a pattern.
    fn values(count: usize, seed: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 504. - 1.).collect()
    }

    fn assert_close(found: &[f32], wanted: &[f32]) {
        assert_eq!(found.len(), wanted.len());
        for (i, (a, b)) in found.iter().zip(wanted).enumerate() {
            assert!((a - b).abs() < 1e-4, "{i}: {a}, wanted {b}");
        }
    }

    /// `run` with the widest vectors and with none.
    fn with_each_width(run: impl Fn(&dyn Fn(Product<'_>), &dyn Fn(OuterSum<'_>), usize)) {
        run(&|op| Arch::new().dispatch(op), &|op| Arch::new().dispatch(op), panel_width());
        run(&|op| pulp::Scalar.vectorize(op), &|op| pulp::Scalar.vectorize(op), 2);
    }

    #[test]
    fn products_are_sums_of_products_for_every_number_of_rows() {
        let (depth, width, stride) = (37, 48, 40);
        let (matrix, bias) = (values(depth * width, 1), values(width, 2));
        with_each_width(|product, _, panel| {
            let fill = |i: usize, from: usize, part: &mut [f32]| {
                part.copy_from_slice(&matrix[i * width + from..][..part.len()]);
            };
            let weights = Panels::pack_in(panel, depth, width, fill);
            for count in 1..20 {
                let x = values(count * stride, count);
                let sums = |start: &dyn Fn(usize) -> f32, relu: bool| -> Vec<f32> {
                    let term = |at: usize, i: usize| x[at / width * stride + i] * matrix[i * width + at % width];
                    let sum = |at: usize| start(at) + (0..depth).map(|i| term(at, i)).sum::<f32>();
                    (0..count * width).map(|at| if relu { sum(at).max(0.) } else { sum(at) }).collect()
                };
                let before = values(count * width, 3);
                let starts: [(Start<'_>, &dyn Fn(usize) -> f32); 3] = [
                    (Start::Zero, &|_| 0.),
                    (Start::Bias(&bias), &|at| bias[at % width]),
                    (Start::Sum, &|at| before[at]),
                ];
                for (start, value) in starts {
                    for relu in [false, true] {
                        let mut y = before.clone();
                        let (x, y_rows) = (Rows { data: &x, stride }, RowsMut { data: &mut y, stride: width });
                        product(Product { count, x, weights: &weights, start, relu, y: y_rows });
                        assert_close(&y, &sums(value, relu));
                    }
                }
            }
        });
    }

    #[test]
    fn gradients_add_up_over_more_rows_than_a_block() {
        let (inputs, outputs, count) = (48, 32, BLOCK + 5);
        let (x, dy) = (values(count * inputs, 4), values(count * outputs, 5));
        let before = values(outputs * inputs, 6);
        let term = |at: usize, t: usize| dy[t * outputs + at / inputs] * x[t * inputs + at % inputs];
        let wanted: Vec<f32> =
            (0..outputs * inputs).map(|at| before[at] + (0..count).map(|t| term(at, t)).sum::<f32>()).collect();
        let wanted_bias: Vec<f32> =
            (0..outputs).map(|o| (0..count).map(|t| dy[t * outputs + o]).sum::<f32>()).collect();
        with_each_width(|_, outer_sum, _| {
            let (mut sum, mut bias) = (before.clone(), vec![0.; outputs]);
            outer_sum(OuterSum {
                count,
                dy: Rows { data: &dy, stride: outputs },
                x: Rows { data: &x, stride: inputs },
                sum: &mut sum,
                bias: &mut bias,
                inputs,
                scratch: &mut Scratch::default(),
            });
            assert_close(&sum, &wanted);
            assert_close(&bias, &wanted_bias);
        });
    }

    #[test]
    fn bad_weights_show() {
        let weights = Panels::pack(&[f32::NAN; 16], 1, 16);
        let mut y = vec![0.; 16];
        product(1, Rows { data: &[1.], stride: 1 }, &weights, Start::Zero, true, RowsMut { data: &mut y, stride: 16 });
        assert!(y.iter().all(|y| y.is_nan()));
    }
}
