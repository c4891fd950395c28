//! What moved a vehicle by kind of cause, as a prediction file has it.

use gnp_data::{Cause, Contribution, Explanation};

/// A kind of cause with columns of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Share {
    FreeRoad,
    Leader,
    Column,
    Intention,
    Neighbours,
    Other,
}

impl Share {
    /// All of them, in the order of the file.
    pub(super) const ALL: [Self; 6] =
        [Self::FreeRoad, Self::Leader, Self::Column, Self::Intention, Self::Neighbours, Self::Other];

    /// The columns' name without the axis.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::FreeRoad => "free_road",
            Self::Leader => "leader",
            Self::Column => "column",
            Self::Intention => "intention",
            Self::Neighbours => "neighbours",
            Self::Other => "other",
        }
    }

    pub(super) fn meaning(self) -> &'static str {
        match self {
            Self::FreeRoad => "what the driver alone moved it from constant velocity",
            Self::Leader => "what the nearest vehicle ahead moved it",
            Self::Column => "what the vehicles farther ahead moved it",
            Self::Intention => "what the network expects beyond that moved it",
            Self::Neighbours => "what the repulsion of neighbours moved it",
            Self::Other => "what other terms of the force, such as lane lines, moved it",
        }
    }

    fn of(cause: &Cause) -> Self {
        match cause {
            Cause::FreeRoad => Self::FreeRoad,
            Cause::Leader { place: 1, .. } => Self::Leader,
            Cause::Leader { .. } | Cause::FartherLeaders => Self::Column,
            Cause::Intention => Self::Intention,
            Cause::Neighbour { .. } | Cause::Neighbours => Self::Neighbours,
            // What there will be besides, too.
            _ => Self::Other,
        }
    }

    /// The cause that stands for it where a file is read; `leader` is the nearest vehicle ahead.
    pub(super) fn cause(self, leader: Option<u32>) -> Cause {
        match self {
            Self::FreeRoad => Cause::FreeRoad,
            Self::Leader => Cause::Leader { vehicle: leader.unwrap_or_default(), place: 1 },
            Self::Column => Cause::FartherLeaders,
            Self::Intention => Cause::Intention,
            Self::Neighbours => Cause::Neighbours,
            Self::Other => Cause::Term(self.name().to_owned()),
        }
    }
}

/// The contributions of one path, those of a kind together.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Shares {
    /// Velocity that they are counted from, m/s; none where nothing is explained so.
    pub(super) velocity: Option<[f32; 2]>,
    /// Number of the nearest vehicle ahead.
    pub(super) leader: Option<u32>,
    /// By kind, after each step, m.
    displacements: [Option<Vec<[f32; 2]>>; 6],
}

impl Shares {
    pub(super) fn of(explanation: &Explanation) -> Self {
        let mut shares = Self::default();
        for Contribution { cause, displacement } in &explanation.contributions {
            shares.velocity = Some(explanation.velocity);
            if let Cause::Leader { vehicle, place: 1 } = cause {
                shares.leader = Some(*vehicle);
            }
            match &mut shares.displacements[Share::of(cause) as usize] {
                Some(sum) => sum.iter_mut().zip(displacement).for_each(|(sum, more)| {
                    sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
                }),
                none => *none = Some(displacement.clone()),
            }
        }
        shares
    }

    /// Displacement along one axis in a step; none where there is no such cause.
    pub(super) fn displacement(&self, share: Share, step: usize, axis: usize) -> Option<f32> {
        Some(self.displacements[share as usize].as_ref()?.get(step)?[axis])
    }
}
