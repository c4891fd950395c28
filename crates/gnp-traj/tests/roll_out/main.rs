//! What the roll-out promises, one module a promise.

mod bad_input;
mod force_parity;
mod fused;
mod golden;
mod gradients;
mod into;
mod padding;
mod physics;
mod precision;
mod scenes;
mod terms;
