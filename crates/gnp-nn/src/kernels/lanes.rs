//! The instruction set that is chosen at run time.

use pulp::{Arch, Simd, WithSimd};

/// Values of `f32` in a vector of the widest instruction set that the processor has and the kernels use: 16 with
/// AVX-512, 8 with AVX2, 4 with NEON, 1 without any.
#[must_use]
pub fn lanes() -> usize {
    struct Lanes;
    impl WithSimd for Lanes {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> usize {
            S::F32_LANES
        }
    }
    Arch::new().dispatch(Lanes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_used_where_there_are_any() {
        #[cfg(target_arch = "aarch64")]
        assert_eq!(lanes(), 4);
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            assert!(lanes() >= 8);
        } else {
            assert_eq!(lanes(), 1);
        }
    }
}
