//! Neural social force: two networks set the parameters of the physics, and the roll-out integrates it.
//!
//! The attraction network (phi_1) turns a vehicle's history and its goal into the relaxation time
//! `tau`; the repulsion network (phi_2) gives each neighbour and each lane line a strength `k`. At
//! every step the forces of [`gnp_force`] with these parameters move the vehicle, and its new state
//! goes back into both networks (GNP paper, section on the neural social force).
//!
//! SI units in the window frame: x forward along the road, y to its left, the last observed position
//! is the origin. A vehicle's state is `(x, y, vx, vy)`.
//!
//! Start at [`SocialForce`] and [`RollOutBatch`]. Other terms of the force act beside the networks' own, with fixed
//! parameters: those of `gnp_force` by their name in [`TrajConfig::terms`], any other by [`SocialForce::with_term`].
//! [`SocialForce::without_terms`] switches terms off, whichever they are.
//!
//! ```
//! use candle_core::{DType, Device, Tensor};
//! use gnp_traj::{Phase, RollOutBatch, SocialForce, TrajConfig};
//! let weights = gnp_nn::Weights::seeded(1, &Device::Cpu);
//! let network = SocialForce::new(&TrajConfig::published(), weights.builder())?;
//! let batch = RollOutBatch {
//!     observed: Tensor::zeros((3, 31, 4), DType::F32, &Device::Cpu)?,
//!     goals: Tensor::new(&[[[100f32, 0.]], [[120., 3.6]], [[90., 0.]]], &Device::Cpu)?,
//!     neighbours: None,
//!     lines: None,
//!     dt: 0.1,
//!     steps: 5,
//! };
//! assert_eq!(network.roll_out(&batch, Phase::Attraction)?.dims(), [3, 1, 5, 2]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod config;
mod error;
mod fused;
mod graph;
mod laws;
mod network;
#[cfg(feature = "cuda")]
mod recorded;
mod roll_out;
mod terms;
mod weights;

pub use crate::config::{InputScale, TrajConfig};
pub use crate::error::TrajError;
pub use crate::fused::{RollOutValues, RollOutWorkspace, RolledOut, RolledOutTerm};
pub use crate::network::SocialForce;
pub use crate::roll_out::{Engine, Lines, NeighbourStates, Neighbours, Phase, RollOut, RollOutBatch, TermRollOut};
pub use crate::terms::TermConfig;
pub use gnp_force::{Arity, ForceTerm, Integrator};
