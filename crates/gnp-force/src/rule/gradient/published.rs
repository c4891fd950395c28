//! Gradients of the law between points.
use super::{DifferentiableRule, PushGradient, exactly};
use crate::{
    error::ForceError,
    rule::{Ego, Other, PairRule, Published},
    vehicle::vehicle_force_vjp,
};
use nalgebra::{RealField, Vector2};

impl<T: RealField + Copy> DifferentiableRule<T> for Published<T> {
    fn names(&self) -> &'static [&'static str] {
        &["k", "r_col"]
    }

    fn parameters(&self) -> Vec<T> {
        vec![self.k, self.r_col]
    }

    fn with_parameters(&self, parameters: &[T]) -> Result<Self, ForceError> {
        let [k, r_col] = exactly(parameters)?;
        let rule = Self { k, r_col };
        PairRule::<T>::check(&rule).map(|()| rule)
    }

    #[inline]
    fn push_vjp(&self, me: &Ego<T>, other: &Other<T>, cotangent: Vector2<T>, d: &mut [T]) -> PushGradient<T> {
        let vjp = vehicle_force_vjp(me.state.position - other.state.position, self.k, self.r_col, cotangent);
        if let [k, r_col] = d {
            *k += vjp.k;
            *r_col += vjp.r_col;
        }
        PushGradient::between(vjp.r)
    }
}
