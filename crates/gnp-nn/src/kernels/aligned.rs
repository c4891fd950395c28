//! Buffers whose first value starts a cache line, so that no vector load straddles two.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Values that one cache line holds, and the widest vector.
pub const LINE: usize = 16;

/// `width` rounded up to whole cache lines.
#[must_use]
pub fn padded(width: usize) -> usize {
    width.next_multiple_of(LINE)
}

/// Values that begin on a cache line.
#[derive(Debug, Default)]
pub struct Aligned {
    data: Vec<f32>,
    start: usize,
    len: usize,
}

impl Aligned {
    /// `len` zeros.
    #[must_use]
    pub fn zeros(len: usize) -> Self {
        Self::over(vec![0.; len + LINE], len)
    }

    /// Makes it `len` values long, where it has the memory; else with new memory. What the values are is left open.
    pub fn resize(&mut self, len: usize) {
        if self.holds(len) {
            self.len = len;
        } else {
            *self = Self::zeros(len);
        }
    }

    /// Whether it has the memory for `len` values.
    #[must_use]
    pub fn holds(&self, len: usize) -> bool {
        self.data.len() >= len + LINE
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
pub struct Pool {
    idle: Mutex<Vec<Vec<f32>>>,
}

impl Pool {
    /// A buffer of `len` values; what they are is left open.
    pub fn take(&self, len: usize) -> Aligned {
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

    /// Takes buffers back, but for empty ones, as long as all that wait hold no more than `limit` values.
    pub fn give(&self, buffers: impl IntoIterator<Item = Aligned>, limit: usize) {
        let mut idle = self.lock();
        let mut held: usize = idle.iter().map(Vec::len).sum();
        for buffer in buffers.into_iter().filter(|buffer| !buffer.data.is_empty()) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_begin_on_a_line_and_are_used_again_up_to_the_limit() {
        for len in [0, 1, 15, 16, 1000] {
            let buffer = Aligned::zeros(len);
            assert_eq!((buffer.len(), buffer.as_ptr().addr() % (LINE * size_of::<f32>())), (len, 0));
        }
        assert_eq!([0, 1, 16, 17].map(padded), [0, 16, 16, 32]);
        let mut buffer = Aligned::default();
        buffer.resize(40);
        let place = buffer.as_ptr();
        buffer[39] = 5.;
        buffer.resize(3);
        buffer.resize(40);
        assert_eq!((buffer.as_ptr(), buffer[39]), (place, 5.), "memory that suffices stays");
        buffer.resize(1000);
        assert_eq!((buffer.len(), buffer.as_ptr().addr() % (LINE * size_of::<f32>())), (1000, 0));
        let pool = Pool::default();
        let (mut first, second) = (pool.take(100), pool.take(90));
        first.fill(7.);
        pool.give([Aligned::default(), first, second], 150);
        assert_eq!(pool.lock().len(), 1, "the second would go beyond the limit");
        let again = pool.take(80);
        assert!(again.iter().all(|v| *v == 7.), "what it holds is left open");
        assert_eq!(pool.lock().len(), 0);
    }
}
