//! Which tracks are present in a frame.

/// Tracks by frame, as offsets into one list.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FrameIndex {
    first: u32,
    /// `offsets[i]..offsets[i + 1]` of `tracks` are present in frame `first + i`.
    offsets: Vec<u32>,
    tracks: Vec<u32>,
}

impl FrameIndex {
    /// Index of tracks given as (first frame, last frame), both inclusive, in track order.
    pub(crate) fn new(spans: &[(u32, u32)]) -> Self {
        let Some(first) = spans.iter().map(|span| span.0).min() else { return Self::default() };
        let last = spans.iter().map(|span| span.1).max().unwrap_or(first);
        let mut counts = vec![0u32; (last - first) as usize + 2];
        for (from, to) in spans {
            for frame in *from..=*to {
                counts[(frame - first) as usize + 1] += 1;
            }
        }
        for i in 1..counts.len() {
            counts[i] += counts[i - 1];
        }
        let mut tracks = vec![0u32; counts.last().copied().unwrap_or(0) as usize];
        let mut next = counts.clone();
        for (track, (from, to)) in spans.iter().enumerate() {
            for frame in *from..=*to {
                let place = &mut next[(frame - first) as usize];
                tracks[*place as usize] = track as u32;
                *place += 1;
            }
        }
        Self { first, offsets: counts, tracks }
    }

    /// Makes it the index of a single frame, in which `tracks` are present.
    pub(crate) fn set_only(&mut self, frame: u32, tracks: impl Iterator<Item = u32>) {
        self.first = frame;
        self.tracks.clear();
        self.tracks.extend(tracks);
        self.offsets.clear();
        self.offsets.extend([0, self.tracks.len() as u32]);
    }

    /// Tracks present in `frame`, in track order.
    pub(crate) fn present(&self, frame: u32) -> &[u32] {
        let Some(i) = frame.checked_sub(self.first).map(|i| i as usize) else { return &[] };
        match (self.offsets.get(i), self.offsets.get(i + 1)) {
            (Some(from), Some(to)) => &self.tracks[*from as usize..*to as usize],
            _ => &[],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_who_is_there() {
        let index = FrameIndex::new(&[(5, 7), (6, 6), (7, 9)]);
        let at = |frame| index.present(frame).to_vec();
        assert_eq!(at(4), [0u32; 0]);
        assert_eq!(at(5), [0]);
        assert_eq!(at(6), [0, 1]);
        assert_eq!(at(7), [0, 2]);
        assert_eq!(at(9), [2]);
        assert_eq!(at(10), [0u32; 0]);
    }
}
