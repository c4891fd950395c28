//! How real closed-loop traffic is: what systems make of replayed scenes, beside what happened.
//!
//! Every system drives every scene as often as settings say, or once if it does not draw. [`compare`] then gives, by site:
//!
//! - **Displacement** from what happened, of those who were there from the start and are recorded for the whole horizon:
//!   the mean over time (ADE), that of the best roll-out of a scene (min ADE, one roll-out for all its vehicles), and at the
//!   horizon along and across the road.
//! - **Realism** in the form of Waymo's sim agents challenge (Montali et al. 2023): how likely what happened is among the
//!   roll-outs. For every scored vehicle and feature the roll-outs, all times together, make a histogram with 0.1 added to
//!   each bin; the score of a scene is the geometric mean of the probability of the bins in which the recording is, at most
//!   one. For contacts and lane changes, whether there is one, 0.001 is added. Features and ranges are those of straight roads
//!   ([`Feature`]), in three groups; the whole is the mean of the groups' means. It is not comparable with the challenge's
//!   own numbers. Of what happened itself it is below 1: the first row of a table says how much there is to be had.
//! - **Distributions**, all driven vehicles and times together: first Wasserstein distances.
//! - **Events**: lane changes a vehicle-kilometre, contacts a vehicle-hour, those who found no room.
//!
//! Intervals are those of 95 % by drawing scenes anew. The same drivers are in several scenes of US-101, so that they are
//! too narrow there.
mod bootstrap;
mod likelihood;
mod measured;
mod scores;
mod table;

pub use self::{
    likelihood::Feature,
    measured::{Measured, Moment, Touch},
    scores::{Estimate, Horizon, Row, compare},
    table::Table,
};

/// How often, and how far.
#[derive(Clone, Debug, PartialEq)]
pub struct RealismSettings {
    /// Roll-outs of a scene by a system that draws.
    pub roll_outs: usize,
    /// Horizons of the displacement, in s; a scene counts for those that are recorded.
    pub horizons_s: Vec<f64>,
}

impl Default for RealismSettings {
    /// 32 roll-outs; 5, 10, 20 and 30 s.
    fn default() -> Self {
        Self { roll_outs: 32, horizons_s: vec![5.0, 10.0, 20.0, 30.0] }
    }
}
