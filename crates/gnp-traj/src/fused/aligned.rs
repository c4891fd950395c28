//! Buffers whose first value starts a cache line, so that no vector load straddles two.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Values that one cache line holds; every row of the fused roll-out is padded to a multiple of it,
/// which is also the widest vector.
pub(crate) const LINE: usize = 16;

/// `width` rounded up to whole cache lines.
pub(crate) fn padded(width: usize) -> usize {
    width.next_multiple_of(LINE)
}

/// Values that begin on a cache line.
#[derive(Debug, Default)]
pub(crate) struct Aligned {
    data: Vec<f32>,
    start: usize,
    len: usize,
}

impl Aligned {
    pub(crate) fn zeros(len: usize) -> Self {
        Self::over(vec![0.; len + LINE], len)
    }

    /// The first aligned `len` values of `data`, which holds at least [`LINE`] more.
    fn over(data: Vec<f32>, len: usize) -> Self {
        let start = data.as_ptr().align_offset(LINE * size_of::<f32>()).min(data.len() - len);
        Self { data, start, len }
    }
}

/// Buffers that wait for their next use: fresh memory costs a page fault for every 4 kB, which for the
/// activations of a batch is a good part of the time of a training step.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    idle: Mutex<Vec<Vec<f32>>>,
}

impl Pool {
    /// A buffer of `len` values; what they are is left open.
    pub(crate) fn take(&self, len: usize) -> Aligned {
        let mut idle = self.lock();
        let fits = idle.iter().enumerate().filter(|(_, data)| data.len() >= len + LINE);
        let data = match fits.min_by_key(|(_, data)| data.len()).map(|(i, _)| i) {
            Some(i) => idle.swap_remove(i),
            None => {
                // A little more, so that the next batch, with some more neighbours, fits as well.
                drop(idle);
                vec![0.; len + len / 8 + LINE]
            }
        };
        Aligned::over(data, len)
    }

    /// Takes buffers back, as long as all that wait hold no more than `limit` values.
    pub(crate) fn give(&self, buffers: impl IntoIterator<Item = Aligned>, limit: usize) {
        let mut idle = self.lock();
        let mut held: usize = idle.iter().map(Vec::len).sum();
        for buffer in buffers {
            held += buffer.data.len();
            if held > limit {
                break;
            }
            idle.push(buffer.data);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Vec<f32>>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One buffer `[len]` for each of several steps: for all of them, or for the last few in turn.
#[derive(Debug)]
pub(crate) struct Trace {
    data: Aligned,
    len: usize,
    kept: usize,
}

impl Trace {
    /// Room for the values of `kept` steps; step `i` takes the place of step `i - kept`.
    pub(crate) fn new(pool: &Pool, kept: usize, len: usize) -> Self {
        Self { data: pool.take(kept * len), len, kept }
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

impl Deref for Aligned {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.data[self.start..self.start + self.len]
    }
}

impl DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.data[self.start..self.start + self.len]
    }
}
