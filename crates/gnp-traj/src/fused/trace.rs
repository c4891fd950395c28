//! Buffers for the values of each step of a roll-out.

use gnp_nn::kernels::{Aligned, Pool};

/// One buffer `[len]` for each of several steps: for all of them, or for the last few in turn.
#[derive(Debug, Default)]
pub(crate) struct Trace {
    data: Aligned,
    len: usize,
    kept: usize,
}

impl Trace {
    /// Room for the values of `kept` steps, in its memory where that suffices; step `i` takes the place of step `i - kept`.
    pub(crate) fn reset(&mut self, pool: &Pool, kept: usize, len: usize) {
        (self.len, self.kept) = (len, kept);
        if self.data.holds(kept * len) {
            self.data.resize(kept * len);
        } else {
            self.data = pool.take(kept * len);
        }
    }

    pub(crate) fn at(&self, step: usize) -> &[f32] {
        self.span(step, 1)
    }

    pub(crate) fn at_mut(&mut self, step: usize) -> &mut [f32] {
        let start = step % self.kept * self.len;
        &mut self.data[start..start + self.len]
    }

    /// The values of `count` steps on end, of a trace that keeps them all.
    pub(crate) fn span(&self, step: usize, count: usize) -> &[f32] {
        let start = step % self.kept * self.len;
        &self.data[start..start + count * self.len]
    }

    /// Copies the values of a step to the next.
    pub(crate) fn carry(&mut self, step: usize) {
        let (from, to) = (step % self.kept * self.len, (step + 1) % self.kept * self.len);
        self.data.copy_within(from..from + self.len, to);
    }

    pub(crate) fn into_buffer(self) -> Aligned {
        self.data
    }
}
