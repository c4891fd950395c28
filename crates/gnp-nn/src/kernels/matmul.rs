//! Matrix products, at the widest vectors the processor has.
//!
//! [`product`] reads weights that were packed once for many calls, [`matmul`] and [`matmul_transposed`] read
//! matrices of tens of rows and columns as they lie, because packing them would cost what it gains. All go
//! through the same tiles: some rows by two vectors
//! of columns, whose sums stay in registers. Each value is one chain of multiply-adds in the order of the
//! depth, so that neither packing nor tiling reaches it.

use pulp::{Arch, Simd, WithSimd};

use super::aligned::Aligned;
use super::bf16::{self, Pairs};
use super::lanes::lanes;

/// Rows of a matrix: row `i` begins at `data[i * stride]`.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// Values from the first row on.
    pub data: &'a [f32],
    /// From the beginning of one row to that of the next.
    pub stride: usize,
}

impl<'a> Rows<'a> {
    /// Rows that begin `stride` values apart.
    #[must_use]
    pub fn new(data: &'a [f32], stride: usize) -> Self {
        Self { data, stride }
    }
}

/// Rows of a matrix to write.
#[derive(Debug)]
pub struct RowsMut<'a> {
    /// Values from the first row on.
    pub data: &'a mut [f32],
    /// From the beginning of one row to that of the next.
    pub stride: usize,
}

impl<'a> RowsMut<'a> {
    /// Rows that begin `stride` values apart.
    #[must_use]
    pub fn new(data: &'a mut [f32], stride: usize) -> Self {
        Self { data, stride }
    }
}

/// What a product starts from.
#[derive(Clone, Copy, Debug)]
pub enum Start<'a> {
    /// Nothing.
    Zero,
    /// One value a column, `[columns]`.
    Bias(&'a [f32]),
    /// What the result holds already.
    Sum,
    /// Nothing, and what the result holds already is added at the end.
    Add,
}

/// A matrix `[depth, width]` in panels: some columns of all rows after each other.
#[derive(Debug, Default)]
pub struct Panels {
    /// Nothing where there are `pairs`.
    data: Aligned,
    /// The values in bf16.
    pairs: Option<Pairs>,
    depth: usize,
    width: usize,
    /// Columns of a panel; the last may have fewer.
    panel: usize,
}

impl Panels {
    /// Packs `matrix` `[depth, width]`; `width` is a multiple of [`LINE`](super::LINE).
    #[must_use]
    pub fn pack(matrix: &[f32], depth: usize, width: usize) -> Self {
        let mut panels = Self::default();
        panels.fill(panel_width(), depth, width, |i, from, part| {
            part.copy_from_slice(&matrix[i * width + from..][..part.len()]);
        });
        panels
    }

    /// Packs the transpose of `matrix` `[width, stride]`, of which the first `depth` columns are used;
    /// `width` is a multiple of [`LINE`](super::LINE).
    #[must_use]
    pub fn pack_transposed(matrix: &[f32], stride: usize, depth: usize, width: usize) -> Self {
        let mut panels = Self::default();
        panels.fill(panel_width(), depth, width, |i, from, part| {
            for (o, value) in part.iter_mut().enumerate() {
                *value = matrix[(from + o) * stride + i];
            }
        });
        panels
    }

    /// The same matrix with its values rounded to bf16, which is multiplied with rows that are rounded so, too; sums stay f32.
    /// Slow where the processor does not [multiply bf16](super::multiplies_bf16).
    #[must_use]
    pub fn into_bf16(self) -> Self {
        if self.pairs.is_some() {
            return self;
        }
        let value = |i: usize, j: usize| {
            let first = j / self.panel * self.panel;
            let panel = self.from(first);
            panel.data[i * panel.stride + j - first]
        };
        let Self { depth, width, panel, .. } = self;
        let pairs = Some(Pairs::pack(depth, width, value));
        Self { data: Aligned::default(), pairs, depth, width, panel }
    }

    /// Packs into panels of `panel` columns; `fill(i, from, part)` writes what row `i` has from column
    /// `from` on. The memory is that of before, where it suffices.
    #[inline(always)]
    fn fill(&mut self, panel: usize, depth: usize, width: usize, fill: impl Fn(usize, usize, &mut [f32])) {
        if self.data.len() < depth * width {
            self.data = Aligned::zeros(depth * width);
        }
        for from in (0..width).step_by(panel) {
            let part = panel.min(width - from);
            for (i, part) in self.data[from * depth..(from + part) * depth].chunks_exact_mut(part).enumerate() {
                fill(i, from, part);
            }
        }
        (self.depth, self.width, self.panel) = (depth, width, panel);
    }

    /// Number of columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// The panel that begins with column `column`.
    #[inline(always)]
    fn from(&self, column: usize) -> Rows<'_> {
        Rows { data: &self.data[column * self.depth..], stride: self.panel.min(self.width - column) }
    }
}

/// `y` `[count, width]` = `start` + `x` `[count, depth]` times `weights` `[depth, width]`, with negative
/// values set to 0 if `relu`.
pub fn product(count: usize, x: Rows<'_>, weights: &Panels, start: Start<'_>, relu: bool, y: RowsMut<'_>) {
    if let Some(pairs) = &weights.pairs {
        return bf16::product(count, x, pairs, start, relu, y);
    }
    let sizes = [count, weights.depth, weights.width];
    Arch::new().dispatch(Product::<false> { sizes, a: x, b: Matrix::Panels(weights), start, relu, c: y });
}

/// `c` `[rows, columns]` = `start` + `a` `[rows, depth]` times `b` `[depth, columns]`; `sizes` is `[rows,
/// depth, columns]`.
pub fn matmul(sizes: [usize; 3], a: Rows<'_>, b: Rows<'_>, start: Start<'_>, c: RowsMut<'_>) {
    Arch::new().dispatch(Product::<false> { sizes, a, b: Matrix::Rows(b), start, relu: false, c });
}

/// `c` `[rows, columns]` = `start` + the transpose of `a` `[depth, rows]` times `b` `[depth, columns]`;
/// `sizes` is `[rows, depth, columns]`.
pub fn matmul_transposed(sizes: [usize; 3], a: Rows<'_>, b: Rows<'_>, start: Start<'_>, c: RowsMut<'_>) {
    Arch::new().dispatch(Product::<true> { sizes, a, b: Matrix::Rows(b), start, relu: false, c });
}

/// Two vectors.
fn panel_width() -> usize {
    2 * lanes()
}

/// Rows of a tile: as many as leave registers for two vectors of `b` and one value of `a`.
#[inline(always)]
fn tile_rows<S: Simd>() -> usize {
    if size_of::<S::f32s>() == 64 { 12 } else { 6 }
}

/// An operand as it lies or packed.
#[derive(Clone, Copy)]
enum Matrix<'a> {
    Rows(Rows<'a>),
    Panels(&'a Panels),
}

impl<'a> Matrix<'a> {
    /// What begins with column `column`: all columns after it, or a panel.
    #[inline(always)]
    fn from(self, column: usize) -> Rows<'a> {
        match self {
            Self::Rows(Rows { data, stride }) => Rows { data: data.get(column..).unwrap_or_default(), stride },
            Self::Panels(panels) => panels.from(column),
        }
    }
}

/// `c` = `start` + `a` `b`, or the transpose of `a` times `b`.
struct Product<'a, const TRANSPOSED: bool> {
    /// Rows, depth and columns.
    sizes: [usize; 3],
    a: Rows<'a>,
    b: Matrix<'a>,
    start: Start<'a>,
    relu: bool,
    c: RowsMut<'a>,
}

impl<const TRANSPOSED: bool> WithSimd for Product<'_, TRANSPOSED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (lanes, columns) = (S::F32_LANES, self.sizes[2]);
        let mut column = 0;
        while column + 2 * lanes <= columns {
            self.strip::<S, 2, true>(simd, column);
            column += 2 * lanes;
        }
        if column + lanes <= columns {
            self.strip::<S, 1, true>(simd, column);
            column += lanes;
        }
        if column < columns {
            self.strip::<S, 1, false>(simd, column);
        }
    }
}

impl<const TRANSPOSED: bool> Product<'_, TRANSPOSED> {
    /// `V` vectors of columns from `column` on, for all rows; the last may not be `WHOLE`.
    #[inline(always)]
    fn strip<S: Simd, const V: usize, const WHOLE: bool>(&mut self, simd: S, column: usize) {
        let mut row = 0;
        while row < self.sizes[0] {
            let (most, left) = (tile_rows::<S>(), self.sizes[0] - row);
            // Two tiles alike rather than a full one and one of a row or two.
            let halved = left > most && left < most + most / 3;
            let rows = if halved { left.div_ceil(2) } else { most.min(left) };
            match rows {
                12 => self.tile::<S, 12, V, WHOLE>(simd, row, column),
                11 => self.tile::<S, 11, V, WHOLE>(simd, row, column),
                10 => self.tile::<S, 10, V, WHOLE>(simd, row, column),
                9 => self.tile::<S, 9, V, WHOLE>(simd, row, column),
                8 => self.tile::<S, 8, V, WHOLE>(simd, row, column),
                7 => self.tile::<S, 7, V, WHOLE>(simd, row, column),
                6 => self.tile::<S, 6, V, WHOLE>(simd, row, column),
                5 => self.tile::<S, 5, V, WHOLE>(simd, row, column),
                4 => self.tile::<S, 4, V, WHOLE>(simd, row, column),
                3 => self.tile::<S, 3, V, WHOLE>(simd, row, column),
                2 => self.tile::<S, 2, V, WHOLE>(simd, row, column),
                _ => self.tile::<S, 1, V, WHOLE>(simd, row, column),
            }
            row += rows;
        }
    }

    /// `R` rows of a strip.
    #[expect(
        clippy::needless_range_loop,
        clippy::manual_memcpy,
        reason = "sums that are indexed by constants alone stay in registers"
    )]
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const V: usize, const WHOLE: bool>(&mut self, simd: S, row: usize, column: usize) {
        let [_, depth, columns] = self.sizes;
        let width = if WHOLE { V * S::F32_LANES } else { columns - column };
        let c_stride = self.c.stride;
        let place = |r: usize| (row + r) * c_stride + column;
        let zero = simd.splat_f32s(0.);
        // Only ever indexed by constants, so that the sums stay in registers.
        let mut sums: [[S::f32s; V]; R] = match self.start {
            Start::Zero | Start::Add => [[zero; V]; R],
            Start::Bias(bias) => [load::<S, V, WHOLE>(simd, &bias[column..][..width]); R],
            Start::Sum => std::array::from_fn(|r| load::<S, V, WHOLE>(simd, &self.c.data[place(r)..][..width])),
        };
        let b = self.b.from(column);
        let b = b.data.chunks(b.stride.max(1)).take(depth);
        if TRANSPOSED {
            let Rows { data, stride } = self.a;
            let rows = data.get(row..).unwrap_or_default().chunks(stride.max(1));
            for (b, a) in b.zip(rows) {
                let b = load::<S, V, WHOLE>(simd, &b[..width]);
                let a = &a[..R];
                for r in 0..R {
                    accumulate(simd, &mut sums[r], a[r], &b);
                }
            }
        } else {
            let Rows { data, stride } = self.a;
            let a: [&[f32]; R] = std::array::from_fn(|r| &data[(row + r) * stride..][..depth]);
            for (i, b) in b.enumerate() {
                let b = load::<S, V, WHOLE>(simd, &b[..width]);
                for r in 0..R {
                    accumulate(simd, &mut sums[r], a[r][i], &b);
                }
            }
        }
        // Three loops, each small enough to be unrolled: else the sums would be indexed in memory, above, too.
        if let Start::Add = self.start {
            for r in 0..R {
                let before = load::<S, V, WHOLE>(simd, &self.c.data[place(r)..][..width]);
                for v in 0..V {
                    sums[r][v] = simd.add_f32s(before[v], sums[r][v]);
                }
            }
        }
        if self.relu {
            for r in 0..R {
                for v in 0..V {
                    // `max` would turn NaN into 0 and hide that a weight has gone bad.
                    let negative = simd.less_than_f32s(sums[r][v], zero);
                    sums[r][v] = simd.select_f32s(negative, zero, sums[r][v]);
                }
            }
        }
        for r in 0..R {
            let c = &mut self.c.data[place(r)..][..width];
            if WHOLE {
                let c = S::as_mut_simd_f32s(c).0;
                for v in 0..V {
                    c[v] = sums[r][v];
                }
            } else {
                simd.partial_store_f32s(c, sums[r][0]);
            }
        }
    }
}

/// The first `V` vectors of `values`; one that is not `WHOLE` ends in zeros.
#[inline(always)]
fn load<S: Simd, const V: usize, const WHOLE: bool>(simd: S, values: &[f32]) -> [S::f32s; V] {
    if WHOLE {
        let vectors = S::as_simd_f32s(values).0;
        std::array::from_fn(|v| vectors[v])
    } else {
        [simd.partial_load_f32s(values); V]
    }
}

#[inline(always)]
fn accumulate<S: Simd, const V: usize>(simd: S, sums: &mut [S::f32s; V], a: f32, b: &[S::f32s; V]) {
    let a = simd.splat_f32s(a);
    for v in 0..V {
        sums[v] = simd.mul_add_e_f32s(a, b[v], sums[v]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Some values without a pattern.
    fn values(count: usize, seed: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 504. - 1.).collect()
    }

    /// Small whole numbers, so that every order of summation gives the same value.
    fn numbers(n: usize, seed: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7 + seed * 13) % 11) as f32 - 5.).collect()
    }

    fn assert_close(found: &[f32], wanted: &[f32]) {
        assert_eq!(found.len(), wanted.len());
        for (i, (a, b)) in found.iter().zip(wanted).enumerate() {
            assert!((a - b).abs() < 1e-4, "{i}: {a}, wanted {b}");
        }
    }

    /// An instruction set: the widest vectors, or none.
    #[derive(Clone, Copy, Debug)]
    enum Width {
        Widest,
        One,
    }

    impl Width {
        fn run(self, op: impl WithSimd) {
            match self {
                Self::Widest => drop(Arch::new().dispatch(op)),
                Self::One => drop(pulp::Scalar.vectorize(op)),
            }
        }

        fn panel(self) -> usize {
            match self {
                Self::Widest => panel_width(),
                Self::One => 2,
            }
        }
    }

    #[test]
    fn products_are_sums_of_products_for_every_number_of_rows() {
        let (depth, width, stride) = (37, 48, 40);
        let (matrix, bias) = (values(depth * width, 1), values(width, 2));
        for on in [Width::Widest, Width::One] {
            let mut weights = Panels::default();
            weights.fill(on.panel(), depth, width, |i, from, part| {
                part.copy_from_slice(&matrix[i * width + from..][..part.len()]);
            });
            for count in 0..20 {
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
                        on.run(Product::<false> {
                            sizes: [count, depth, width],
                            a: Rows::new(&x, stride),
                            b: Matrix::Panels(&weights),
                            start,
                            relu,
                            c: RowsMut::new(&mut y, width),
                        });
                        assert_close(&y, &sums(value, relu));
                    }
                }
            }
        }
    }

    #[test]
    fn products_of_all_small_sizes_are_those_of_the_definition() {
        for (m, k, n) in [(1, 1, 1), (3, 2, 5), (8, 4, 16), (13, 9, 33), (12, 16, 64), (5, 0, 3), (0, 3, 4), (9, 7, 40)]
        {
            let (a_stride, b_stride, c_stride) = (k.max(m) + 2, n + 1, n + 3);
            let a = numbers((m.max(k) + 1) * a_stride, 1);
            let b = numbers((k + 1) * b_stride, 2);
            let (before, bias) = (numbers((m + 1) * c_stride, 3), numbers(n, 4));
            for transposed in [false, true] {
                for start in [Start::Zero, Start::Bias(&bias), Start::Sum, Start::Add] {
                    let mut c = before.clone();
                    let run = if transposed { matmul_transposed } else { matmul };
                    let to = RowsMut::new(&mut c, c_stride);
                    run([m, k, n], Rows::new(&a, a_stride), Rows::new(&b, b_stride), start, to);
                    let mut expected = before.clone();
                    for i in 0..m {
                        for j in 0..n {
                            let left = |l: usize| if transposed { a[l * a_stride + i] } else { a[i * a_stride + l] };
                            let sum: f32 = (0..k).map(|l| left(l) * b[l * b_stride + j]).sum();
                            let at = i * c_stride + j;
                            expected[at] = sum
                                + match start {
                                    Start::Zero => 0.,
                                    Start::Bias(bias) => bias[j],
                                    Start::Sum | Start::Add => expected[at],
                                };
                        }
                    }
                    assert_eq!(c, expected, "{m} {k} {n} transposed {transposed} {start:?}");
                }
            }
        }
    }

    #[test]
    fn neither_packing_nor_tiling_reaches_a_bit() {
        let (depth, width) = (70, 80);
        let matrix = values(depth * width, 1);
        let packed = Panels::pack(&matrix, depth, width);
        let turned: Vec<f32> = (0..depth * width).map(|at| matrix[at % depth * width + at / depth]).collect();
        let transposed = Panels::pack_transposed(&turned, depth, depth, width);
        let x = values(23 * depth, 2);
        let by_itself: Vec<f32> = (0..23)
            .flat_map(|row| {
                let mut y = vec![0.; width];
                let (x, to) = (Rows::new(&x[row * depth..], depth), RowsMut::new(&mut y, width));
                matmul([1, depth, width], x, Rows::new(&matrix, width), Start::Zero, to);
                y
            })
            .collect();
        for weights in [&packed, &transposed] {
            let mut y = vec![0.; 23 * width];
            product(23, Rows::new(&x, depth), weights, Start::Zero, false, RowsMut::new(&mut y, width));
            assert_eq!(y, by_itself);
        }
    }

    #[test]
    fn bad_weights_show() {
        let weights = Panels::pack(&[f32::NAN; 16], 1, 16);
        let mut y = vec![0.; 16];
        product(1, Rows::new(&[1.], 1), &weights, Start::Zero, true, RowsMut::new(&mut y, 16));
        assert!(y.iter().all(|y| y.is_nan()));
    }
}
