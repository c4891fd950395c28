//! Roll-outs on the caller's thread, one after the other in the same memory.

use std::sync::Arc;

use gnp_force::TermDescriptor;
use gnp_nn::kernels::Pool;

use super::batch::{ActiveSlots, Batch, Chunk};
use super::forward::{self, Detail, Outcome, Tape, Work};
use super::layout::{Net, Packed};
use super::values::RollOutValues;
use crate::roll_out::Sizes;
use crate::terms::Terms;
use crate::{Phase, SocialForce};

/// What [`SocialForce::roll_out_into`] keeps from one roll-out to the next: the values to roll out and memory, no state.
#[derive(Debug, Default)]
pub struct RollOutWorkspace {
    /// What is rolled out next; to be filled before each roll-out.
    pub values: RollOutValues,
    slots: [ActiveSlots; 2],
    tape: Tape,
    work: Work,
    outcome: Outcome,
    /// Where the tape takes its memory from; nothing waits in it.
    pool: Pool,
}

/// A roll-out in the memory of its [`RollOutWorkspace`].
#[derive(Clone, Copy, Debug)]
pub struct RolledOut<'a> {
    terms: &'a Terms,
    sizes: Sizes,
    outcome: &'a Outcome,
}

/// One term of the force in a [`RolledOut`].
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct RolledOutTerm<'a> {
    /// What it is called.
    pub term: &'a Arc<TermDescriptor>,
    /// Number of sources: 1, the neighbour slots or the entries for lines.
    pub sources: usize,
    /// Acceleration in m/s² at the start of each step, of each source `[windows, goals, steps, sources, 2]`; 0 in empty
    /// slots and entries.
    pub forces: &'a [f32],
}

impl<'a> RolledOut<'a> {
    /// Positions after each step `[windows, goals, steps, 2]`, in m.
    #[must_use]
    pub fn path(&self) -> &'a [f32] {
        &self.outcome.path
    }

    /// The terms that act, in the order in which they are added up; none where they are not explained.
    pub fn terms(&self) -> impl Iterator<Item = RolledOutTerm<'a>> + use<'a> {
        let records = self.outcome.record.iter().flat_map(|record| &record.terms);
        let acting = self.terms.acting(self.sizes);
        acting.zip(records).map(|((term, sources), record)| RolledOutTerm { term, sources, forces: &record.forces })
    }
}

impl RollOutWorkspace {
    /// Rolls its values out, whose sizes were checked.
    pub(crate) fn roll_out<'a>(
        &'a mut self,
        network: &'a SocialForce,
        net: &Net<Packed>,
        sizes: Sizes,
        phase: Phase,
        explain: bool,
    ) -> RolledOut<'a> {
        let batch = Batch::of(network, std::mem::take(&mut self.values), sizes, phase);
        for (active, slots) in self.slots.iter_mut().zip([sizes.slots, sizes.lines]) {
            active.reserve(sizes.batch, slots, sizes.goals);
        }
        let chunk = Chunk::in_memory(&batch, 0..sizes.batch, std::mem::take(&mut self.slots));
        let Self { tape, work, outcome, pool, .. } = self;
        let detail = if explain { Detail::Forces } else { Detail::Path };
        forward::roll_out_into(&chunk, net, pool, (false, detail), tape, work, outcome);
        self.slots = chunk.into_memory();
        self.values = batch.values;
        RolledOut { terms: &network.terms, sizes, outcome: &self.outcome }
    }
}
