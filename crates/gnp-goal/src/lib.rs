//! Goal prediction: where a vehicle will be, among the places that intention modes lead to
//! (GNP paper, section on mode-level goal prediction).
//!
//! [`GoalNet`] is a transformer whose tokens are the modes: an encoder weighs them against the
//! observation, a decoder against the neighbours, one head gives each mode's probability, another
//! the whole future of the modes asked for, whose last point is the goal. Lengths in m.
//! [`GoalConfig`] chooses between the published form and the one that predicts better.
//!
//! ```
//! use candle_core::{DType, Device, Tensor};
//! use gnp_goal::{GoalConfig, GoalNet, GoalShape, ProbabilityHead, Regression};
//! let config = GoalConfig {
//!     width: 8,
//!     heads: 2,
//!     layers: 1,
//!     feed_forward: 2,
//!     dropout: 0.1,
//!     probability: ProbabilityHead::Decoder,
//!     regression: Regression::Residual,
//!     null_token: true,
//!     slot_embedding: true,
//!     zero_start: false,
//! };
//! let shape = GoalShape { observed: 12, neighbour: 10, slots: 3, t_pred: 5 };
//! let weights = gnp_nn::Weights::seeded(7, &Device::Cpu);
//! let net = GoalNet::new(&config, shape, weights.builder())?;
//! let zeros = |shape: &[usize]| Tensor::zeros(shape, DType::F32, &Device::Cpu);
//! let (observed, neighbours, mask) = (zeros(&[2, 12])?, zeros(&[2, 3, 10])?, zeros(&[2, 3])?);
//! let goals = net.predict(&observed, &neighbours, &mask, &zeros(&[6, 5, 2])?, 4)?;
//! assert_eq!(goals.futures.dims(), [2, 4, 5, 2]);
//! # Ok::<(), gnp_goal::GoalError>(())
//! ```

mod attention;
mod block;
mod config;
mod error;
mod fused;
mod loss;
mod net;
mod packed;
mod pick;

pub use crate::config::{GoalConfig, GoalShape, ProbabilityHead, Regression};
pub use crate::error::GoalError;
pub use crate::loss::{
    GoalLoss, LabelConfig, LabelDistance, Labels, LossWeights, goal_loss, label_distances, labels, soft_labels,
};
pub use crate::net::{GoalNet, GoalOutput, Goals};
pub use crate::packed::{EndPoints, GoalWorkspace, PackedGoalNet};
pub use crate::pick::Pick;
