//! Seeds made from seeds, so that every epoch and step has a stream of its own.

/// A seed for item `index` of the stream `seed` (two rounds of SplitMix64): epochs and steps that
/// differ by one get seeds that have nothing in common.
#[must_use]
pub fn derive_seed(seed: u64, index: u64) -> u64 {
    finalise(finalise(seed).wrapping_add(index.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

fn finalise(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::derive_seed;

    #[test]
    fn neighbouring_indices_and_seeds_share_no_stream() {
        let mut seeds: Vec<u64> = (0..30).flat_map(|seed| (0..40).map(move |index| derive_seed(seed, index))).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 30 * 40);
        assert_ne!(derive_seed(1, 2), derive_seed(2, 1));
    }
}
