//! Matrix products of the sizes one window has: tens of rows and columns, all in the cache.
//!
//! A general library packs its operands first, which at these sizes costs as much as it gains. Here
//! the left operand is read as it lies, and the right one is row-major with its columns in vectors.

use pulp::{Arch, Simd, WithSimd};

/// A row-major matrix in a slice: its first value and the distance from one row to the next.
pub(crate) type Rows<'a> = (&'a [f32], usize);

/// As [`Rows`], to write to.
pub(crate) type RowsMut<'a> = (&'a mut [f32], usize);

/// What happens to the values already there.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Store {
    /// They are replaced.
    Set,
    /// They are added to.
    Add,
}

/// `c` `[m, n]` becomes, or is added, `a` `[m, k]` times `b` `[k, n]`; `sizes` is `[m, k, n]`.
pub(crate) fn product(arch: Arch, c: RowsMut<'_>, a: Rows<'_>, b: Rows<'_>, sizes: [usize; 3], store: Store) {
    arch.dispatch(Product::<false> { c, a, b, sizes, store });
}

/// `c` `[m, n]` becomes, or is added, the transpose of `a` `[k, m]` times `b` `[k, n]`; `sizes` is
/// `[m, k, n]`.
pub(crate) fn product_of_transpose(
    arch: Arch,
    c: RowsMut<'_>,
    a: Rows<'_>,
    b: Rows<'_>,
    sizes: [usize; 3],
    store: Store,
) {
    arch.dispatch(Product::<true> { c, a, b, sizes, store });
}

struct Product<'a, const TRANSPOSED: bool> {
    c: RowsMut<'a>,
    a: Rows<'a>,
    b: Rows<'a>,
    sizes: [usize; 3],
    store: Store,
}

impl<const TRANSPOSED: bool> WithSimd for Product<'_, TRANSPOSED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let lanes = S::F32_LANES;
        let n = self.sizes[2];
        let mut column = 0;
        while column + 2 * lanes <= n {
            self.strip::<S, 2>(simd, column, lanes);
            column += 2 * lanes;
        }
        while column < n {
            let last = lanes.min(n - column);
            self.strip::<S, 1>(simd, column, last);
            column += last;
        }
    }
}

impl<const TRANSPOSED: bool> Product<'_, TRANSPOSED> {
    /// `VECTORS` vectors of columns from `column`, of which the last holds `last` columns.
    #[inline(always)]
    fn strip<S: Simd, const VECTORS: usize>(&mut self, simd: S, column: usize, last: usize) {
        let m = self.sizes[0];
        let mut row = 0;
        // Eight rows of two vectors need more registers than narrower machines have.
        while S::F32_LANES >= 16 && row + 8 <= m {
            self.tile::<S, 8, VECTORS>(simd, row, column, last);
            row += 8;
        }
        while row + 4 <= m {
            self.tile::<S, 4, VECTORS>(simd, row, column, last);
            row += 4;
        }
        while row < m {
            self.tile::<S, 1, VECTORS>(simd, row, column, last);
            row += 1;
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const ROWS: usize, const VECTORS: usize>(
        &mut self,
        simd: S,
        row: usize,
        column: usize,
        last: usize,
    ) {
        let [_, k, _] = self.sizes;
        let (a, a_stride) = self.a;
        let (b, b_stride) = self.b;
        let width = (VECTORS - 1) * S::F32_LANES + last;
        let mut sums = [[simd.splat_f32s(0.); VECTORS]; ROWS];
        if TRANSPOSED {
            for i in 0..k {
                let right = load::<S, VECTORS>(simd, &b[i * b_stride + column..][..width]);
                let left = &a[i * a_stride + row..][..ROWS];
                for r in 0..ROWS {
                    accumulate(simd, &mut sums[r], left[r], &right);
                }
            }
        } else {
            let left: [&[f32]; ROWS] = std::array::from_fn(|r| &a[(row + r) * a_stride..][..k]);
            for i in 0..k {
                let right = load::<S, VECTORS>(simd, &b[i * b_stride + column..][..width]);
                for r in 0..ROWS {
                    accumulate(simd, &mut sums[r], left[r][i], &right);
                }
            }
        }
        let (c, c_stride) = (&mut *self.c.0, self.c.1);
        for (r, sums) in sums.iter().enumerate() {
            let target = &mut c[(row + r) * c_stride + column..][..width];
            let (whole, rest) = S::as_mut_simd_f32s(target);
            for (target, sum) in whole.iter_mut().zip(sums) {
                *target = if self.store == Store::Add { simd.add_f32s(*target, *sum) } else { *sum };
            }
            if !rest.is_empty() {
                let sum = sums[VECTORS - 1];
                let before = simd.partial_load_f32s(rest);
                let sum = if self.store == Store::Add { simd.add_f32s(before, sum) } else { sum };
                simd.partial_store_f32s(rest, sum);
            }
        }
    }
}

#[inline(always)]
fn load<S: Simd, const VECTORS: usize>(simd: S, row: &[f32]) -> [S::f32s; VECTORS] {
    let (whole, rest) = S::as_simd_f32s(row);
    if whole.len() == VECTORS {
        std::array::from_fn(|v| whole[v])
    } else {
        std::array::from_fn(|v| if v < whole.len() { whole[v] } else { simd.partial_load_f32s(rest) })
    }
}

#[inline(always)]
fn accumulate<S: Simd, const VECTORS: usize>(
    simd: S,
    sums: &mut [S::f32s; VECTORS],
    left: f32,
    right: &[S::f32s; VECTORS],
) {
    let left = simd.splat_f32s(left);
    for v in 0..VECTORS {
        sums[v] = simd.mul_add_e_f32s(left, right[v], sums[v]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Small whole numbers, so that every order of summation gives the same value.
    fn numbers(n: usize, seed: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7 + seed * 13) % 11) as f32 - 5.).collect()
    }

    #[test]
    fn products_of_all_small_sizes_are_those_of_the_definition() {
        for (m, k, n) in [(1, 1, 1), (3, 2, 5), (8, 4, 16), (13, 9, 33), (12, 16, 64), (5, 0, 3), (0, 3, 4), (9, 7, 40)]
        {
            let (a_stride, b_stride, c_stride) = (k.max(m) + 2, n + 1, n + 3);
            let a = numbers((m.max(k) + 1) * a_stride, 1);
            let b = numbers((k + 1) * b_stride, 2);
            let before = numbers((m + 1) * c_stride, 3);
            for transposed in [false, true] {
                for store in [Store::Set, Store::Add] {
                    let mut c = before.clone();
                    let run = if transposed { product_of_transpose } else { product };
                    run(Arch::new(), (&mut c, c_stride), (&a, a_stride), (&b, b_stride), [m, k, n], store);
                    let mut expected = before.clone();
                    for i in 0..m {
                        for j in 0..n {
                            let left = |l: usize| if transposed { a[l * a_stride + i] } else { a[i * a_stride + l] };
                            let sum: f32 = (0..k).map(|l| left(l) * b[l * b_stride + j]).sum();
                            let at = i * c_stride + j;
                            expected[at] = if store == Store::Add { expected[at] + sum } else { sum };
                        }
                    }
                    assert_eq!(c, expected, "{m} {k} {n} transposed {transposed}");
                }
            }
        }
    }
}
