//! The roofline: what one core's arithmetic and caches allow, and how near to it our matrix product comes.
//!
//! A product of `rows` by weights does two operations a row for each weight, so its speed has two limits: the
//! arithmetic, and, where the weights come from a cache or from memory, `rows / 2` operations for each of their bytes.

use std::hint::black_box;
use std::time::{Duration, Instant};

use gnp::Progress as _;
use gnp_cli::Terminal;
use gnp_nn::Precision;
use gnp_nn::kernels::{Panels, Rows, RowsMut, Start, product};
use pulp::{Arch, Simd, WithSimd};

use super::{load, processor, table};

/// Sums that do not wait for each other: more than any processor has multiply-adds under way.
const SUMS: usize = 24;
/// Working sets that are read, KiB.
const SETS: [usize; 10] = [16, 32, 64, 256, 512, 1024, 2048, 4096, 16_384, 262_144];
/// Rows of a product.
const ROWS: [usize; 7] = [1, 4, 8, 16, 32, 96, 320];
/// What is multiplied: name, inputs, outputs, and how many weight matrices of that size in turn.
const PRODUCTS: [(&str, usize, usize, usize); 4] =
    [("map", 64, 64, 1), ("LSTM", 320, 1024, 1), ("4 LSTMs", 320, 1024, 4), ("10 heads", 512, 256, 10)];
/// Each figure is the fastest of repeats for this long.
const LONG: Duration = Duration::from_millis(60);

/// Prints the roofline of the core this runs on. A product in bf16 may have more than all of it: the share is of what f32 allows.
pub(super) fn run(terminal: &Terminal) {
    let load = load();
    terminal.note("bench: arithmetic and caches of one core");
    let peak = peak();
    let sets: Vec<Vec<String>> = SETS.iter().map(|kib| vec![size(*kib), format!("{:.0}", read(*kib) / 1e9)]).collect();
    terminal.note("bench: products");
    let products = |precision| -> Vec<Vec<String>> {
        let row = |rows: &usize| {
            let share = |(_, inputs, outputs, count): (_, usize, usize, usize)| {
                format!("{:.0} %", 100. * multiply([*rows, inputs, outputs], count, precision) / peak)
            };
            [vec![format!("{rows}, {precision}")], PRODUCTS.map(share).to_vec()].concat()
        };
        ROWS.iter().map(row).collect()
    };
    let here = Precision::ALL.into_iter().filter(|precision| precision.check().is_ok());
    let products: Vec<Vec<String>> = here.flat_map(products).collect();
    let name = |(name, inputs, outputs, count): (&str, usize, usize, usize)| {
        format!("{name}, {}", size(inputs * outputs * count / 256))
    };
    let header = ["rows".to_owned()].into_iter().chain(PRODUCTS.map(name)).collect();
    terminal.result(&format!(
        "One core of: {}; {} (load average {load}).\nMultiply-adds in registers: {:.0} GFLOP/s.\n\n{}\n\nOur product, as a \
         share of that, by rows and weights:\n{}",
        processor(),
        instructions(),
        peak / 1e9,
        table(["working set", "read, GB/s"].map(str::to_owned).to_vec(), sets),
        table(header, products)
    ));
}

fn size(kib: usize) -> String {
    if kib < 1024 { format!("{kib} KiB") } else { format!("{:.1} MiB", kib as f64 / 1024.) }
}

/// The instruction set that our kernels choose here.
fn instructions() -> String {
    struct Width;
    impl WithSimd for Width {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> usize {
            8 * size_of::<S::f32s>()
        }
    }
    format!("vectors of {} bits", Arch::new().dispatch(Width))
}

/// Seconds of the fastest repeat.
fn fastest(mut run: impl FnMut()) -> f64 {
    run();
    let (started, mut best) = (Instant::now(), f64::INFINITY);
    while started.elapsed() < LONG {
        let turn = Instant::now();
        run();
        best = best.min(turn.elapsed().as_secs_f64());
    }
    best
}

/// Operations a second without memory.
fn peak() -> f64 {
    const TURNS: usize = 20_000;
    struct Sums;
    impl WithSimd for Sums {
        type Output = (f32, usize);
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> (f32, usize) {
            let x = simd.splat_f32s(black_box(0.999));
            let mut sums = [simd.splat_f32s(black_box(1.)); SUMS];
            for _ in 0..TURNS {
                for sum in &mut sums {
                    *sum = simd.mul_add_e_f32s(x, *sum, x);
                }
            }
            let total = sums.into_iter().fold(simd.splat_f32s(0.), |total, sum| simd.add_f32s(total, sum));
            (simd.reduce_sum_f32s(total), S::F32_LANES)
        }
    }
    let (_, lanes) = Arch::new().dispatch(Sums);
    (2 * lanes * SUMS * TURNS) as f64
        / fastest(|| {
            black_box(Arch::new().dispatch(Sums));
        })
}

/// Bytes a second from a working set of so many KiB.
fn read(kib: usize) -> f64 {
    struct Read<'a>(&'a [f32]);
    impl WithSimd for Read<'_> {
        type Output = f32;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> f32 {
            let mut sums = [simd.splat_f32s(0.); 8];
            let (whole, _) = S::as_simd_f32s(self.0);
            for vectors in whole.as_chunks::<8>().0 {
                for (sum, vector) in sums.iter_mut().zip(vectors) {
                    *sum = simd.add_f32s(*sum, *vector);
                }
            }
            simd.reduce_sum_f32s(sums.into_iter().fold(simd.splat_f32s(0.), |total, sum| simd.add_f32s(total, sum)))
        }
    }
    let values = vec![1f32; kib * 256];
    let turns = (16_384 / kib).max(1);
    let seconds = fastest(|| {
        for _ in 0..turns {
            black_box(Arch::new().dispatch(Read(black_box(&values))));
        }
    });
    (turns * kib * 1024) as f64 / seconds
}

/// Operations a second of our product of `[rows, inputs, outputs]` by `count` weight matrices in turn.
fn multiply([rows, inputs, outputs]: [usize; 3], count: usize, precision: Precision) -> f64 {
    let values = |len: usize| (0..len).map(|i| (i % 17) as f32 / 17. - 0.5).collect::<Vec<_>>();
    let (x, matrix) = (values(rows * inputs), values(inputs * outputs));
    let pack = |_| {
        let panels = Panels::pack(&matrix, inputs, outputs);
        if precision == Precision::Bf16 { panels.into_bf16() } else { panels }
    };
    let weights: Vec<Panels> = (0..count).map(pack).collect();
    let mut y = vec![0.; rows * outputs];
    // Small products several times, so that a repeat is longer than the clock is fine.
    let turns = (20_000_000 / (rows * inputs * outputs * count)).max(1);
    let seconds = fastest(|| {
        for weights in (0..turns).flat_map(|_| &weights) {
            product(rows, Rows::new(&x, inputs), weights, Start::Zero, false, RowsMut::new(black_box(&mut y), outputs));
        }
    });
    2. * (rows * inputs * outputs * count * turns) as f64 / seconds
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn our_product_does_not_beat_the_arithmetic() {
        let share = multiply([8, 64, 64], 1, Precision::F32) / peak();
        assert!(share > 0. && share < 1.5, "{share}");
        assert!(read(16) > 0.);
    }
}
