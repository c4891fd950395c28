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
//! Start at [`SocialForce`] and [`Scene`].
//!
//! ```
//! use candle_core::{DType, Device, Tensor};
//! use gnp_traj::{Phase, Scene, SocialForce, TrajConfig};
//! let weights = gnp_nn::Weights::seeded(1, &Device::Cpu);
//! let network = SocialForce::new(&TrajConfig::published(), weights.builder())?;
//! let scene = Scene {
//!     observed: Tensor::zeros((3, 31, 4), DType::F32, &Device::Cpu)?,
//!     goals: Tensor::new(&[[[100f32, 0.]], [[120., 3.6]], [[90., 0.]]], &Device::Cpu)?,
//!     neighbours: None,
//!     lines: None,
//!     dt: 0.1,
//!     steps: 5,
//! };
//! assert_eq!(network.roll_out(&scene, Phase::Attraction)?.dims(), [3, 1, 5, 2]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod config;
mod error;
mod fused;
mod graph;
mod laws;
mod network;
mod scene;

pub use crate::config::{InputScale, Integrator, TrajConfig};
pub use crate::error::TrajError;
pub use crate::network::SocialForce;
pub use crate::scene::{Engine, Lines, NeighbourStates, Neighbours, Phase, RollOut, Scene};
