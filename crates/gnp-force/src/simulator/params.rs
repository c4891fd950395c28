//! Every knob of the simulator, with what it means.
use crate::{
    error::{ForceError, require, require_positive},
    integrator::Integrator,
    scalar::lit,
    simulator::repulsion::{MotorwayRule, Repulsion},
};
use nalgebra::RealField;

/// What a [`Simulator`](crate::Simulator) needs to know besides the road and the vehicles.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct SimulatorParams<T> {
    /// Length of a step, in s. At most the relaxation time of every vehicle.
    pub dt: T,
    /// How a step is taken.
    pub integrator: Integrator,
    /// How vehicles push each other.
    pub repulsion: Repulsion<T>,
    /// How vehicles with a desired speed drive.
    pub cruise: CruiseParams<T>,
    /// Most that all neighbours together can push a vehicle, in m/s²: what tyres can do. A longer sum is shortened to
    /// it and keeps its direction.
    pub grip: T,
    /// Highest speed that a vehicle may want, in m/s. A goal that asks for more is approached at this speed, late.
    pub max_speed: T,
    /// Which vehicles push.
    pub search: NeighbourSearch<T>,
}

/// How a vehicle with a desired speed and a lane drives: towards a goal that stays `preview` seconds ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct CruiseParams<T> {
    /// Most that the goal pulls forward, in m/s².
    pub acceleration: T,
    /// Time in which a lateral deviation is to be closed, in s. At 4 times tau or more the approach does not overshoot.
    pub preview: T,
    /// Highest lateral speed wanted, in m/s.
    pub lateral_speed: T,
}

/// Which neighbours push: in the vehicle's lane and the two beside it, the nearest ahead and behind.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct NeighbourSearch<T> {
    /// How many ahead and how many behind in each of the three lanes.
    pub per_lane: usize,
    /// How far along the road between centres, in m.
    pub range: T,
}

impl<T: RealField + Copy> SimulatorParams<T> {
    /// Motorway traffic in steps of `dt` s: [`MotorwayRule::standard`], semi-implicit Euler.
    #[must_use]
    pub fn motorway(dt: T) -> Self {
        Self {
            dt,
            integrator: Integrator::SemiImplicitEuler,
            repulsion: Repulsion::Motorway(MotorwayRule::standard()),
            cruise: CruiseParams { acceleration: lit(1.5), preview: lit(4.0), lateral_speed: lit(1.2) },
            grip: lit(9.0),
            max_speed: lit(70.0),
            search: NeighbourSearch { per_lane: 2, range: lit(300.0) },
        }
    }

    /// The published law, one strength for everybody, in steps of `dt` s: k = 9 m/s² and r_col = 26 m.
    ///
    /// In the paper a network chooses k for every neighbour and moment; with one k the law is too coarse for dense
    /// traffic in several lanes, where it pushes vehicles beside each other off the road. It suits joint roll-outs of a
    /// few seconds, comparisons and symmetric test scenes. In one lane, cars that close in at up to 10 m/s from 20 m or
    /// more, and wish to go no faster, do not touch.
    #[must_use]
    pub fn published(dt: T) -> Self {
        Self { repulsion: Repulsion::Published { k: lit(9.0), r_col: lit(26.0) }, ..Self::motorway(dt) }
    }

    /// Whether the physics allows these numbers.
    ///
    /// # Errors
    /// Names the first number out of range and what it must be.
    pub fn check(&self) -> Result<(), ForceError> {
        require_positive("dt", self.dt)?;
        self.repulsion.check()?;
        require_positive("cruise.acceleration", self.cruise.acceleration)?;
        require_positive("cruise.preview", self.cruise.preview)?;
        require_positive("cruise.lateral_speed", self.cruise.lateral_speed)?;
        require_positive("grip", self.grip)?;
        require_positive("max_speed", self.max_speed)?;
        require(self.search.per_lane > 0, "search.per_lane", T::zero(), "at least 1")?;
        require_positive("search.range", self.search.range)
    }
}
