//! Chance that depends on nothing but its key: the same seed, vehicle and time give the same number.

/// A number in (0, 1) for a key, by the output function of SplitMix64 (Steele, Lea and Flood 2014).
pub(crate) fn uniform(key: &[u64]) -> f64 {
    let bits = key.iter().fold(0, |mixed, part| mix(mixed ^ part));
    ((bits >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

/// One of `count` things; 0 where there is none.
pub(crate) fn choice(key: &[u64], count: usize) -> usize {
    ((uniform(key) * count as f64) as usize).min(count.saturating_sub(1))
}

/// The finaliser of SplitMix64: a random number for each value.
pub(crate) fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
