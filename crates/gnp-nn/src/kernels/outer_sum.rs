//! Sums of outer products over many rows: the gradients of weights.
//!
//! A block of rows at a time is packed so that a tile of the sum reads on end what it needs, from the innermost
//! cache; the tile stays in registers meanwhile. Each value is one chain of multiply-adds in the order of the rows, so
//! that blocks and tiles do not reach it.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::aligned::{Aligned, LINE};
use super::matmul::Rows;

/// Rows that are packed at once: two lines of each fill half of the innermost cache.
const BLOCK: usize = 192;

/// The same rows of several blocks of rows on end, block by block.
#[derive(Clone, Debug)]
pub struct Picked {
    /// Which rows of a block.
    pub rows: Range<usize>,
    /// Rows of a block.
    pub of: usize,
    /// Number of blocks.
    pub blocks: usize,
}

impl Picked {
    /// Where the rows that are picked lie, in their order.
    fn places(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.blocks).flat_map(move |block| self.rows.clone().map(move |row| block * self.of + row))
    }
}

/// Packed rows of one [`outer_sum`] at a time.
#[derive(Debug, Default)]
pub struct Scratch {
    places: Vec<usize>,
    /// Lines of all rows after each other, `[outputs / LINE, rows, LINE]`.
    dy: Aligned,
    /// Some columns of all rows, `[rows, columns]`.
    x: Aligned,
}

/// `sum[o, i] += dy[t, o] * x[t, i]` and `bias[o] += dy[t, o]` over the rows `t` that are `picked`: the gradients
/// of an affine map, from those of what it gave and from what it took.
///
/// `sum` is `[outputs, inputs]`, `bias` `[outputs]`, both numbers multiples of [`LINE`]; `scratch` is overwritten.
pub fn outer_sum(
    picked: &Picked,
    dy: Rows<'_>,
    x: Rows<'_>,
    sum: &mut [f32],
    bias: &mut [f32],
    inputs: usize,
    scratch: &mut Scratch,
) {
    Arch::new().dispatch(OuterSum { picked, dy, x, sum, bias, inputs, scratch });
}

struct OuterSum<'a> {
    picked: &'a Picked,
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
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { picked, dy, x, sum, bias, inputs, scratch } = self;
        let Scratch { places, dy: packed_dy, x: packed_x } = scratch;
        let outputs = bias.len();
        // Two vectors of columns, or as many as fill a line.
        let columns = (2 * S::F32_LANES).max(LINE);
        places.clear();
        places.extend(picked.places());
        make_room(packed_dy, BLOCK * outputs);
        make_room(packed_x, BLOCK * columns);
        for block in places.chunks(BLOCK) {
            let count = block.len();
            for (t, place) in block.iter().enumerate() {
                let row = &dy.data[place * dy.stride..][..outputs];
                for (bias, dy) in bias.iter_mut().zip(row) {
                    *bias += dy;
                }
                for (line, dy) in row.as_chunks::<LINE>().0.iter().enumerate() {
                    packed_dy.as_chunks_mut::<LINE>().0[line * count + t] = *dy;
                }
            }
            for column in (0..inputs).step_by(columns) {
                let width = columns.min(inputs - column);
                let to = packed_x.as_chunks_mut::<LINE>().0.chunks_exact_mut(width / LINE);
                for (place, to) in block.iter().zip(to) {
                    let from = &x.data[place * x.stride + column..][..width];
                    to.copy_from_slice(from.as_chunks().0);
                }
                let mut strip = Strip {
                    dy: packed_dy,
                    x: &packed_x[..count * width],
                    count,
                    width,
                    sum: &mut sum[column..],
                    inputs,
                };
                for row in (0..outputs).step_by(LINE) {
                    strip.line(simd, row);
                }
            }
        }
    }
}

/// At least so many values; what they were does not matter.
fn make_room(buffer: &mut Aligned, values: usize) {
    if buffer.len() < values {
        *buffer = Aligned::zeros(values);
    }
}

/// Some columns of the sum and what is packed for them.
struct Strip<'a> {
    dy: &'a [f32],
    x: &'a [f32],
    /// Rows that are packed.
    count: usize,
    /// Columns.
    width: usize,
    /// From the first of the columns on.
    sum: &'a mut [f32],
    inputs: usize,
}

impl Strip<'_> {
    /// [`LINE`] rows of the sum from `row` on, in tiles that fit the registers.
    #[inline(always)]
    fn line<S: Simd>(&mut self, simd: S, row: usize) {
        let vectors = self.width / S::F32_LANES;
        for within in (0..LINE).step_by(if size_of::<S::f32s>() == 64 { 8 } else { 4 }) {
            let at = (row, within);
            match (size_of::<S::f32s>(), vectors) {
                (64, 2) => self.tile::<S, 8, 2>(simd, at, 0),
                (64, _) => self.tile::<S, 8, 1>(simd, at, 0),
                _ => (0..vectors / 2).for_each(|pair| self.tile::<S, 4, 2>(simd, at, pair * 2 * S::F32_LANES)),
            }
        }
    }

    /// `R` rows from `row + within` on by `V` vectors of columns from `column` on.
    #[expect(
        clippy::needless_range_loop,
        clippy::manual_memcpy,
        reason = "sums that are indexed by constants alone stay in registers"
    )]
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const V: usize>(&mut self, simd: S, (row, within): (usize, usize), column: usize) {
        let place = |r: usize| (row + within + r) * self.inputs + column;
        let columns = V * S::F32_LANES;
        let mut sums: [[S::f32s; V]; R] = std::array::from_fn(|r| {
            let vectors = S::as_simd_f32s(&self.sum[place(r)..][..columns]).0;
            std::array::from_fn(|v| vectors[v])
        });
        let dy = self.dy[row * self.count..][..self.count * LINE].as_chunks::<LINE>().0;
        for (dy, x) in dy.iter().zip(self.x.chunks_exact(self.width)) {
            let x = S::as_simd_f32s(&x[column..][..columns]).0;
            let x: [S::f32s; V] = std::array::from_fn(|v| x[v]);
            let dy = &dy[within..][..R];
            for r in 0..R {
                let dy = simd.splat_f32s(dy[r]);
                for v in 0..V {
                    sums[r][v] = simd.mul_add_e_f32s(dy, x[v], sums[r][v]);
                }
            }
        }
        for r in 0..R {
            let to = S::as_mut_simd_f32s(&mut self.sum[place(r)..][..columns]).0;
            for v in 0..V {
                to[v] = sums[r][v];
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

    #[test]
    fn gradients_add_up_over_the_rows_that_are_picked_and_more_than_a_block_of_them() {
        let (inputs, outputs) = (5 * LINE, 2 * LINE);
        let whole = Picked { rows: 0..BLOCK + 5, of: BLOCK + 5, blocks: 1 };
        let some = Picked { rows: 3..10, of: 11, blocks: BLOCK / 7 + 2 };
        let mut scratch = Scratch::default();
        for picked in [whole, some, Picked { rows: 4..4, of: 9, blocks: 3 }] {
            // Rows of each lie among other values.
            let (x_stride, dy_stride) = (inputs + 3, outputs + 1);
            let count = picked.of * picked.blocks;
            let (x, dy) = (values(count * x_stride, 4), values(count * dy_stride, 5));
            let (before, before_bias) = (values(outputs * inputs, 6), values(outputs, 7));
            let over = |term: &dyn Fn(usize) -> f32| {
                let rows = (0..count).filter(|row| picked.rows.contains(&(row % picked.of)));
                rows.map(term).sum::<f32>()
            };
            let wanted: Vec<f32> = (0..outputs * inputs)
                .map(|at| before[at] + over(&|t| dy[t * dy_stride + at / inputs] * x[t * x_stride + at % inputs]))
                .collect();
            let wanted_bias: Vec<f32> =
                (0..outputs).map(|o| before_bias[o] + over(&|t| dy[t * dy_stride + o])).collect();
            for widest in [true, false] {
                let (mut sum, mut bias) = (before.clone(), before_bias.clone());
                let run = OuterSum {
                    picked: &picked,
                    dy: Rows::new(&dy, dy_stride),
                    x: Rows::new(&x, x_stride),
                    sum: &mut sum,
                    bias: &mut bias,
                    inputs,
                    scratch: &mut scratch,
                };
                if widest {
                    Arch::new().dispatch(run)
                } else {
                    pulp::Scalar.vectorize(run)
                }
                assert_close(&sum, &wanted);
                assert_close(&bias, &wanted_bias);
            }
        }
    }
}
