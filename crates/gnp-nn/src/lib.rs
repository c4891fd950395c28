//! What all networks share: seeded, named weights, layers whose gradients are tested, and the
//! [`kernels`] on the CPU that fused networks are made of.
//!
//! candle's own `layer_norm` and `softmax_last_dim` pass no gradient, and its CPU generator cannot
//! be seeded; the layers here pass every gradient, and [`Weights`] draws each weight from its own
//! stream of `(seed, name)`, so that neither the order of construction nor the number of threads
//! reaches a result.
//!
//! ```
//! use candle_core::{Device, Tensor};
//! let weights = gnp_nn::Weights::seeded(7, &Device::Cpu);
//! let layer = gnp_nn::linear(4, 3, weights.builder().pp("history"))?;
//! let y = candle_nn::Module::forward(&layer, &Tensor::zeros((2, 4), candle_core::DType::F32, &Device::Cpu)?)?;
//! assert_eq!(y.dims(), [2, 3]);
//! assert_eq!(weights.named().keys().collect::<Vec<_>>(), ["history.bias", "history.weight"]);
//! # Ok::<(), candle_core::Error>(())
//! ```

mod checkpoint;
mod dropout;
pub mod kernels;
mod launch;
mod layers;
mod lstm;
mod precision;
#[cfg(feature = "cuda")]
mod replay;
mod weights;

pub use crate::checkpoint::Checkpoint;
pub use crate::dropout::{Dropout, DropoutMask};
pub use crate::launch::{DeviceThread, LaunchCache};
pub use crate::layers::{LayerNorm, Linear, Mlp, layer_norm, linear};
pub use crate::lstm::{Lstm, LstmState};
pub use crate::precision::{Precision, PrecisionError};
#[cfg(feature = "cuda")]
pub use crate::replay::Replay;
pub use crate::weights::Weights;

// Only to switch on AVX-512 in the matrix products that candle makes.
use gemm as _;
