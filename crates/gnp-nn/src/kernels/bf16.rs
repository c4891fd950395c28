//! Products of values in bf16, summed in f32.
//!
//! bf16 is the first half of an f32: its range with 8 bits of precision. Where the processor has `VDPBF16PS`, which adds the
//! products of a pair of values to a sum, such a product takes little more than half the time of one in f32. Weights
//! are packed in that form once; what they are multiplied with is rounded at every call.
//!
//! What comes out is defined by [`add_pair`] and the same bits on every processor. One without the instruction follows the
//! definition, slowly: nobody should ask it to ([`multiplies_bf16`]).

use std::cell::RefCell;

use multiversion::multiversion;
use multiversion::target::match_target;

use super::aligned::LINE;
use super::matmul::{Rows, RowsMut, Start};

/// Pairs of values, the first of each in the low half, as many as a vector holds.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Line([u32; LINE]);

/// A matrix `[depth, width]` in bf16. Panels of two lines of columns, or one at the end, lie after each other; a panel has a
/// pair of rows after the other. An odd depth ends in a pair with 0.
#[derive(Debug)]
pub(super) struct Pairs {
    data: Vec<Line>,
    depth: usize,
    width: usize,
}

impl Pairs {
    /// Packs the matrix of these values by row and column; `width` is a multiple of [`LINE`].
    pub(super) fn pack(depth: usize, width: usize, value: impl Fn(usize, usize) -> f32) -> Self {
        let half = |i: usize, j: usize| if i < depth { round(value(i, j)) } else { 0 };
        let mut data = Vec::with_capacity(depth.div_ceil(2) * width / LINE);
        for from in (0..width).step_by(2 * LINE) {
            for i in (0..depth).step_by(2) {
                for j in (from..width.min(from + 2 * LINE)).step_by(LINE) {
                    data.push(Line(std::array::from_fn(|l| half(i, j + l) | half(i + 1, j + l) << 16)));
                }
            }
        }
        Self { data, depth, width }
    }

    /// Pairs of rows.
    fn count(&self) -> usize {
        self.depth.div_ceil(2)
    }

    /// The panel that begins with column `column`.
    #[inline(always)]
    fn from(&self, column: usize) -> &[Line] {
        &self.data[column / LINE * self.count()..]
    }
}

/// `x` rounded to bf16, half way to the even one, as the lower half of what is given. What is too small for a normal number
/// becomes 0.
fn round(x: f32) -> u32 {
    let bits = x.to_bits();
    if x.is_nan() {
        return bits >> 16 | 0x40;
    }
    if x.is_normal() { (bits + 0x7fff + (bits >> 16 & 1)) >> 16 } else { bits >> 16 & 0xff80 }
}

/// `sum` and the products of two pairs: those of the second halves are added first, each by one rounding. Numbers too small to
/// be normal are 0.
fn add_pair(sum: f32, a: u32, b: u32) -> f32 {
    let normal = |x: f32| if x.is_subnormal() { 0f32.copysign(x) } else { x };
    let [first, second] = [|pair: u32| f32::from_bits(pair << 16), |pair: u32| f32::from_bits(pair & 0xffff_0000)];
    let sum = normal(second(a).mul_add(second(b), normal(sum)));
    normal(first(a).mul_add(first(b), sum))
}

/// Whether this processor multiplies pairs of bf16 in one instruction.
#[multiversion(targets("x86_64+avx512f+avx512bf16"))]
#[must_use]
pub fn multiplies_bf16() -> bool {
    match_target! {
        "x86_64+avx512f+avx512bf16" => true,
        _ => false,
    }
}

/// `y` `[count, width]` = `start` + `x` `[count, depth]` times `weights`, with negative values set to 0 if `relu`.
pub(super) fn product(count: usize, x: Rows<'_>, weights: &Pairs, start: Start<'_>, relu: bool, y: RowsMut<'_>) {
    thread_local! {
        /// The rows of the latest product in bf16: kept, so that nothing is allocated for the next.
        static ROUNDED: RefCell<Vec<u32>> = const { RefCell::new(Vec::new()) };
    }
    ROUNDED.with_borrow_mut(|rounded| {
        let stride = weights.count().next_multiple_of(LINE);
        if rounded.len() < count * stride {
            rounded.resize(count * stride, 0);
        }
        let rounded = &mut rounded[..count * stride];
        run(&mut Product { count, x, rounded, stride, weights, start, relu, y });
    });
}

struct Product<'a> {
    count: usize,
    x: Rows<'a>,
    /// Room for `x` in pairs, `[count, stride]`.
    rounded: &'a mut [u32],
    stride: usize,
    weights: &'a Pairs,
    start: Start<'a>,
    relu: bool,
    y: RowsMut<'a>,
}

#[multiversion(targets("x86_64+avx512f+avx512bf16"))]
fn run(product: &mut Product<'_>) {
    match_target! {
        "x86_64+avx512f+avx512bf16" => {
            use std::arch::x86_64::{
                __m512, _CMP_LT_OQ, _mm512_add_ps, _mm512_cmp_ps_mask, _mm512_cvtne2ps_pbh, _mm512_dpbf16_ps,
                _mm512_mask_mov_ps, _mm512_set1_epi32, _mm512_setzero_ps,
            };

            use multiversion::inherit_target;
            use pulp::cast;

            /// Rounds the rows.
            #[inherit_target]
            fn narrow(product: &mut Product<'_>) {
                let (x, depth) = (product.x, product.weights.depth);
                for (row, to) in product.rounded.chunks_exact_mut(product.stride.max(1)).enumerate() {
                    let (whole, rest) = x.data[row * x.stride..][..depth].as_chunks::<{ 2 * LINE }>();
                    let mut last = [0f32; 2 * LINE];
                    last[..rest.len()].copy_from_slice(rest);
                    for (to, x) in to.as_chunks_mut::<LINE>().0.iter_mut().zip(whole.iter().chain([&last])) {
                        let halves = x.as_chunks::<LINE>().0;
                        *to = cast(_mm512_cvtne2ps_pbh(cast(halves[1]), cast(halves[0])));
                    }
                }
            }

            /// `V` vectors of columns from `column` on, for all rows.
            #[inherit_target]
            fn strip<const V: usize>(product: &mut Product<'_>, column: usize) {
                let weights = product.weights;
                let b = &weights.from(column).as_chunks::<V>().0[..weights.count()];
                let mut row = 0;
                while row < product.count {
                    let (most, left) = (12, product.count - row);
                    // Two tiles alike rather than a full one and one of a row or two.
                    let halved = left > most && left < most + most / 3;
                    let rows = if halved { left.div_ceil(2) } else { most.min(left) };
                    match rows {
                        12 => tile::<12, V>(product, b, row, column),
                        11 => tile::<11, V>(product, b, row, column),
                        10 => tile::<10, V>(product, b, row, column),
                        9 => tile::<9, V>(product, b, row, column),
                        8 => tile::<8, V>(product, b, row, column),
                        7 => tile::<7, V>(product, b, row, column),
                        6 => tile::<6, V>(product, b, row, column),
                        5 => tile::<5, V>(product, b, row, column),
                        4 => tile::<4, V>(product, b, row, column),
                        3 => tile::<3, V>(product, b, row, column),
                        2 => tile::<2, V>(product, b, row, column),
                        _ => tile::<1, V>(product, b, row, column),
                    }
                    row += rows;
                }
            }

            /// The first `V` vectors of `values`.
            #[inherit_target]
            #[inline]
            fn load<const V: usize>(values: &[f32]) -> [__m512; V] {
                let lines = values.as_chunks::<LINE>().0;
                std::array::from_fn(|v| cast(lines[v]))
            }

            /// `R` rows of a strip.
            #[inherit_target]
            #[inline]
            #[expect(clippy::needless_range_loop, reason = "sums that are indexed by constants alone stay in registers")]
            fn tile<const R: usize, const V: usize>(product: &mut Product<'_>, b: &[[Line; V]], row: usize, column: usize) {
                let stride = product.y.stride;
                let place = |r: usize| (row + r) * stride + column;
                let zero = _mm512_setzero_ps();
                let mut sums = [[zero; V]; R];
                match product.start {
                    Start::Zero | Start::Add => {}
                    Start::Bias(bias) => sums = [load(&bias[column..]); R],
                    Start::Sum => {
                        for r in 0..R {
                            sums[r] = load(&product.y.data[place(r)..]);
                        }
                    }
                }
                let a: [&[u32]; R] = std::array::from_fn(|r| &product.rounded[(row + r) * product.stride..][..b.len()]);
                for (i, b) in b.iter().enumerate() {
                    for r in 0..R {
                        let a = _mm512_set1_epi32(a[r][i].cast_signed());
                        for v in 0..V {
                            sums[r][v] = _mm512_dpbf16_ps(sums[r][v], cast(a), cast(b[v].0));
                        }
                    }
                }
                if let Start::Add = product.start {
                    for r in 0..R {
                        let before = load::<V>(&product.y.data[place(r)..]);
                        for v in 0..V {
                            sums[r][v] = _mm512_add_ps(before[v], sums[r][v]);
                        }
                    }
                }
                if product.relu {
                    for r in 0..R {
                        for v in 0..V {
                            // `max` would turn NaN into 0 and hide that a weight has gone bad.
                            let negative = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(sums[r][v], zero);
                            sums[r][v] = _mm512_mask_mov_ps(sums[r][v], negative, zero);
                        }
                    }
                }
                for r in 0..R {
                    let y = product.y.data[place(r)..].as_chunks_mut::<LINE>().0;
                    for v in 0..V {
                        y[v] = cast(sums[r][v]);
                    }
                }
            }

            narrow(product);
            let width = product.weights.width;
            for column in (0..width).step_by(2 * LINE) {
                if column + LINE < width {
                    strip::<2>(product, column);
                } else {
                    strip::<1>(product, column);
                }
            }
        }
        _ => definition(product),
    }
}

/// What every processor gives.
fn definition(product: &mut Product<'_>) {
    let Product { count, x, rounded, stride, weights, start, relu, y } = product;
    let (depth, pairs) = (weights.depth, weights.count());
    for row in 0..*count {
        let x = &x.data[row * x.stride..][..depth];
        let a = &mut rounded[row * *stride..][..pairs];
        for (to, pair) in a.iter_mut().zip(x.chunks(2)) {
            *to = round(pair[0]) | round(pair.get(1).copied().unwrap_or_default()) << 16;
        }
        for column in 0..weights.width {
            let y = &mut y.data[row * y.stride + column];
            let mut sum = match start {
                Start::Zero | Start::Add => 0.,
                Start::Bias(bias) => bias[column],
                Start::Sum => *y,
            };
            // Lines of the panel that has this column.
            let (panel, place) = (column / (2 * LINE) * 2 * LINE, column % (2 * LINE) / LINE);
            let lines = ((weights.width - panel) / LINE).min(2);
            for (b, a) in weights.from(panel).chunks(lines).zip(&*a) {
                sum = add_pair(sum, *a, b[place].0[column % LINE]);
            }
            if let Start::Add = start {
                sum += *y;
            }
            *y = if *relu && sum < 0. { 0. } else { sum };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(count: usize, seed: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 504. - 1.).collect()
    }

    /// `[count, width]` by the processor's way and by the definition.
    fn both(
        [count, depth, width]: [usize; 3],
        x: &[f32],
        matrix: &[f32],
        start: Start<'_>,
        relu: bool,
        before: &[f32],
    ) -> [Vec<f32>; 2] {
        let weights = Pairs::pack(depth, width, |i, j| matrix[i * width + j]);
        let x = Rows::new(x, depth + 3);
        let [mut found, mut defined] = [before.to_vec(), before.to_vec()];
        product(count, x, &weights, start, relu, RowsMut::new(&mut found, width + 1));
        let stride = depth.div_ceil(2);
        let (rounded, y) = (&mut vec![0; count * stride], RowsMut::new(&mut defined, width + 1));
        definition(&mut Product { count, x, rounded, stride, weights: &weights, start, relu, y });
        [found, defined]
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|value| value.to_bits()).collect()
    }

    #[test]
    fn values_are_rounded_to_the_nearest_and_half_way_to_the_even_one() {
        let one = 1f32.to_bits();
        for (bits, wanted) in [
            (one, 0x3f80),
            (one + 0x7fff, 0x3f80),
            (one + 0x8000, 0x3f80),
            (one + 0x8001, 0x3f81),
            (one + 0x1_8000, 0x3f82),
            (f32::MAX.to_bits(), 0x7f80),
            (f32::NEG_INFINITY.to_bits(), 0xff80),
            ((-0f32).to_bits(), 0x8000),
            (0x807f_ffff, 0x8000),
        ] {
            assert_eq!(round(f32::from_bits(bits)), wanted, "{bits:#x}");
        }
        assert!(f32::from_bits(round(f32::from_bits(0x7f80_0001)) << 16).is_nan());
    }

    #[test]
    fn a_product_is_that_of_the_definition_bit_by_bit() {
        for count in (0..30).chain([96]) {
            for (depth, width) in [(1, 16), (2, 32), (31, 48), (32, 64), (33, 16), (70, 80)] {
                let (x, matrix) = (values((count + 1) * (depth + 3), count), values(depth * width, 1));
                let (bias, before) = (values(width, 2), values((count + 1) * (width + 1), 3));
                for start in [Start::Zero, Start::Bias(&bias), Start::Sum, Start::Add] {
                    for relu in [false, true] {
                        let [found, defined] = both([count, depth, width], &x, &matrix, start, relu, &before);
                        assert_eq!(bits(&found), bits(&defined), "{count} {depth} {width} {start:?} {relu}");
                    }
                }
            }
        }
    }

    #[test]
    fn whole_numbers_are_multiplied_exactly_and_others_nearly() {
        let (depth, width, count) = (37, 48, 5);
        let number = |i: usize| ((i * 7) % 11) as f32 - 5.;
        let (x, matrix): (Vec<f32>, Vec<f32>) =
            ((0..count * (depth + 3)).map(number).collect(), (0..depth * width).map(number).collect());
        let before = vec![0.; count * (width + 1)];
        let sum = |x: &[f32], matrix: &[f32], row: usize, column: usize| -> f32 {
            (0..depth).map(|i| x[row * (depth + 3) + i] * matrix[i * width + column]).sum()
        };
        let [found, _] = both([count, depth, width], &x, &matrix, Start::Zero, false, &before);
        let (loose_x, loose) = (values(x.len(), 1), values(matrix.len(), 2));
        let [near, _] = both([count, depth, width], &loose_x, &loose, Start::Zero, false, &before);
        for row in 0..count {
            for column in 0..width {
                let at = row * (width + 1) + column;
                assert_eq!(found[at], sum(&x, &matrix, row, column));
                assert!((near[at] - sum(&loose_x, &loose, row, column)).abs() < 0.02 * (depth as f32).sqrt());
            }
        }
    }

    #[test]
    fn tiny_numbers_become_zero_and_large_ones_infinite_as_defined() {
        let extremes = [1e-38, -1e-38, 1e-20, -3e-20, 1e-39, 3e38, -3e38, 0., -0., 1., 1e-45, 2e-19];
        let (depth, width, count) = (6, 16, 200);
        let draw = |count: usize, seed: usize| -> Vec<f32> {
            (0..count).map(|i| extremes[(i * 7919 + seed * 104_729) % 1009 % extremes.len()]).collect()
        };
        let (x, matrix, before) = (draw(count * (depth + 3), 1), draw(depth * width, 2), draw(count * (width + 1), 3));
        for start in [Start::Zero, Start::Sum] {
            let [found, defined] = both([count, depth, width], &x, &matrix, start, false, &before);
            for (at, (found, defined)) in found.iter().zip(&defined).enumerate() {
                let same = found.to_bits() == defined.to_bits() || found.is_nan() && defined.is_nan();
                assert!(same, "{at}: {found:e}, defined {defined:e}");
            }
        }
    }

    #[test]
    fn bad_weights_show() {
        let [found, defined] = both([1, 1, 16], &[1.; 4], &[f32::NAN; 16], Start::Zero, true, &[0.; 17]);
        assert!(found[..16].iter().chain(&defined[..16]).all(|value| value.is_nan()));
    }
}
