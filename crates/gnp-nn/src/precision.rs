//! The numbers that the products of networks which no longer learn are made in.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::kernels::multiplies_bf16;

/// The numbers in which networks that no longer learn multiply. States, positions, forces, attention, softmax and every sum are f32
/// in any case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// 24 bits of weights and values.
    #[default]
    F32,
    /// 8 bits of weights and of what is multiplied with them, summed in f32: faster where the processor multiplies bf16.
    Bf16,
}

/// Why products cannot be made in the precision asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PrecisionError {
    /// The processor has no instruction for it; without one it would be slower than f32.
    #[error(
        "this processor does not multiply bf16 (that is AVX512-BF16: AMD since Zen 4, Intel Xeon since Sapphire Rapids): \
         take precision f32"
    )]
    NoInstruction,
    /// No such precision.
    #[error("there are the precisions f32 and bf16")]
    Unknown,
}

impl Precision {
    /// All there are.
    pub const ALL: [Self; 2] = [Self::F32, Self::Bf16];

    /// Name in configurations and options.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::Bf16 => "bf16",
        }
    }

    /// Whether it is f32.
    #[must_use]
    pub fn is_f32(&self) -> bool {
        *self == Self::F32
    }

    /// Whether this processor multiplies in it.
    ///
    /// # Errors
    /// [`PrecisionError::NoInstruction`] where it does not.
    pub fn check(self) -> Result<(), PrecisionError> {
        match self {
            Self::Bf16 if !multiplies_bf16() => Err(PrecisionError::NoInstruction),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Precision {
    type Err = PrecisionError;

    fn from_str(name: &str) -> Result<Self, PrecisionError> {
        Self::ALL.into_iter().find(|precision| precision.name() == name).ok_or(PrecisionError::Unknown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_precision_has_one_name_and_f32_is_there_everywhere() {
        for precision in Precision::ALL {
            assert_eq!(precision.to_string().parse(), Ok(precision));
        }
        assert_eq!("f16".parse::<Precision>(), Err(PrecisionError::Unknown));
        assert_eq!(Precision::default().check(), Ok(()));
        assert_eq!(Precision::Bf16.check().is_ok(), multiplies_bf16());
    }
}
