//! Kernels on the CPU: plain functions on slices of `f32`, from which fused networks are made.
//!
//! Matrices are row-major, `[rows, width]`, in a slice; [`Rows`] and [`RowsMut`] are rows that lie
//! `stride` values apart. Each kernel is compiled once for every instruction set and takes the widest
//! vectors that the processor has. An adjoint is named for its kernel: from the gradient of what the kernel gave
//! it makes that of what the kernel took. None of them starts a thread but [`sum_rows`], and none
//! depends on the number of threads.
//!
//! Sizes are the caller's to check: a slice that is shorter than the sizes say is an index out of bounds.

mod activation;
mod aligned;
mod attention;
mod bf16;
mod lanes;
mod lstm;
mod matmul;
mod outer_sum;
mod rows;
mod values;

pub use activation::{exp, sigmoid, tanh};
pub use aligned::{Aligned, LINE, Pool, padded};
pub use attention::Attention;
pub use bf16::multiplies_bf16;
pub use lanes::lanes;
pub use lstm::{lstm, lstm_adjoint};
pub use matmul::{Panels, Rows, RowsMut, Start, matmul, matmul_transposed, product};
pub use outer_sum::{Picked, Scratch, outer_sum};
pub(crate) use rows::NORM_EPSILON;
pub use rows::{
    Affine, add_rows, add_to_rows, affine_rows, drop_values, norm, norm_adjoint, relu, relu_adjoint, row_products,
    scale_rows, sum_rows, transpose,
};
pub use values::{read, values};
