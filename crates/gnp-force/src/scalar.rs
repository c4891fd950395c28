//! Numbers written in the source, in the precision of the caller.
use nalgebra::RealField;

/// `value` in the caller's scalar type.
#[inline(always)]
pub(crate) fn lit<T: RealField>(value: f64) -> T {
    nalgebra::convert(value)
}
