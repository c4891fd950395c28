//! Adam where the weights live: all of them end to end in one vector, so that a step is a few operations on that and not a
//! few on each weight.

use candle_core::{DType, Device, Result, Tensor, Var};

use super::{BETA_1, BETA_2, EPSILON, Update};

/// Values that are added up together first; one sum over all of them would keep most of a GPU idle.
const ROW: usize = 1024;

/// Both moments, each `[rows, ROW]`; zeros stand behind the last weight.
#[derive(Debug)]
pub(super) struct Flat {
    first: Tensor,
    second: Tensor,
    /// What fills the last row.
    rest: Tensor,
}

impl Flat {
    /// Moments of 0 for `vars`, which are of one device.
    pub(super) fn new<'a>(vars: impl Iterator<Item = &'a Var>) -> Result<Self> {
        let (mut count, mut device) = (0, Device::Cpu);
        for var in vars {
            count += var.elem_count();
            device = var.device().clone();
        }
        let rows = count.div_ceil(ROW);
        let zeros = Tensor::zeros((rows, ROW), DType::F32, &device)?;
        let rest = Tensor::zeros(rows * ROW - count, DType::F32, &device)?;
        Ok(Self { first: zeros.clone(), second: zeros, rest })
    }

    /// The gradient of all variables `[rows, ROW]`, 0 where there is none, and its norm, for which the host waits; nothing
    /// when that is not finite.
    pub(super) fn gradient<'a>(
        &self,
        gradients: impl Iterator<Item = (&'a Var, &'a Option<Tensor>)>,
    ) -> Result<Option<(Tensor, f64)>> {
        let of = |(var, gradient): (&Var, &Option<Tensor>)| match gradient {
            Some(gradient) => gradient.detach().to_dtype(DType::F32)?.flatten_all(),
            None => var.as_tensor().zeros_like()?.flatten_all(),
        };
        let gradient = self.together(gradients.map(of))?;
        let squares = gradient.sqr()?.sum(1)?.to_dtype(DType::F32)?.sum(0)?;
        let norm = f64::from(squares.to_scalar::<f32>()?).sqrt();
        Ok(norm.is_finite().then_some((gradient, norm)))
    }

    /// Moves `vars` along `gradient` `[rows, ROW]`.
    pub(super) fn step<'a>(
        &mut self,
        vars: impl Iterator<Item = &'a Var> + Clone,
        gradient: &Tensor,
        update: &Update,
    ) -> Result<()> {
        let Update { scale, size, root, kept } = *update;
        let times = |x: &Tensor, factor: f32| x.affine(f64::from(factor), 0.);
        let gradient = if scale == 1. { gradient.clone() } else { times(gradient, scale)? };
        self.first = (times(&self.first, BETA_1)? + times(&gradient, 1. - BETA_1)?)?;
        self.second = (times(&self.second, BETA_2)? + times(&gradient.sqr()?, 1. - BETA_2)?)?;
        let divisor = self.second.sqrt()?.affine(f64::from(1. / root), f64::from(EPSILON))?;
        let values = self.together(vars.clone().map(|var| var.as_tensor().detach().flatten_all()))?;
        let values = (times(&values, kept)? - times(&self.first, size)?.div(&divisor)?)?.flatten_all()?;
        split(&values, vars, |var, part| var.set(&part))
    }

    /// The first and the second moment of each of `vars` in its shape, on the CPU.
    pub(super) fn moments<'a>(&self, vars: impl Iterator<Item = &'a Var> + Clone) -> Result<[Vec<Tensor>; 2]> {
        let read = |of: &Tensor| {
            let mut all = Vec::new();
            let host = of.to_device(&Device::Cpu)?.flatten_all()?;
            split(&host, vars.clone(), |_, part| {
                all.push(part.copy()?);
                Ok(())
            })?;
            Result::Ok(all)
        };
        Ok([read(&self.first)?, read(&self.second)?])
    }

    /// Takes over the first and the second moments of all weights, end to end.
    pub(super) fn restore(&mut self, [first, second]: [Vec<f32>; 2]) -> Result<()> {
        let put = |mut values: Vec<f32>| {
            values.resize(self.first.elem_count(), 0.);
            Tensor::from_vec(values, self.first.shape(), self.first.device())
        };
        let moments = (put(first)?, put(second)?);
        (self.first, self.second) = moments;
        Ok(())
    }

    /// Vectors end to end, `[rows, ROW]`.
    fn together(&self, parts: impl Iterator<Item = Result<Tensor>>) -> Result<Tensor> {
        let mut parts = parts.collect::<Result<Vec<_>>>()?;
        if self.rest.elem_count() > 0 {
            parts.push(self.rest.clone());
        }
        Tensor::cat(&parts, 0)?.reshape(self.first.shape())
    }
}

/// Calls `f` with each of `vars` and its part of `values`, in its shape.
fn split<'a>(
    values: &Tensor,
    vars: impl Iterator<Item = &'a Var>,
    mut f: impl FnMut(&Var, Tensor) -> Result<()>,
) -> Result<()> {
    let mut first = 0;
    for var in vars {
        f(var, values.narrow(0, first, var.elem_count())?.reshape(var.shape())?)?;
        first += var.elem_count();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use candle_core::backprop::GradStore;

    use super::super::{Adam, host};
    use super::*;

    const CLIP_NORM: f64 = 0.05;

    /// An optimiser of these weights, on the host or as on a GPU.
    fn adam(vars: &BTreeMap<String, Var>, flat: bool) -> Adam {
        let mut adam = Adam::new(vars.clone(), 0.1, CLIP_NORM).unwrap();
        adam.flat = flat.then(|| Flat::new(vars.values()).unwrap());
        adam
    }

    fn vars() -> BTreeMap<String, Var> {
        let values = |n: usize| (0..n).map(|i| (i as f32 * 0.7).sin()).collect::<Vec<_>>();
        let var = |shape: (usize, usize)| Var::from_vec(values(shape.0 * shape.1), shape, &Device::Cpu).unwrap();
        let named = [("a", var((3, 5))), ("b", var((40, 41))), ("unreached", var((2, 2)))];
        named.map(|(name, var)| (name.to_owned(), var)).into()
    }

    fn gradients(vars: &BTreeMap<String, Var>, step: f64) -> [GradStore; 1] {
        let part = |name: &str| (vars[name].as_tensor() + step).unwrap().sqr().unwrap().t().unwrap().sum_all().unwrap();
        [(part("a") * 0.01).unwrap().add(&(part("b") * 1e-3).unwrap()).unwrap().backward().unwrap()]
    }

    fn values(vars: &BTreeMap<String, Var>) -> Vec<f32> {
        vars.values().flat_map(|var| host(var.as_tensor()).unwrap()).collect()
    }

    #[test]
    fn all_weights_at_once_move_as_one_after_the_other() {
        let run = |flat: bool| {
            let vars = vars();
            let mut optimiser = adam(&vars, flat);
            let mut steps = Vec::new();
            for step in 0..5 {
                if step == 3 {
                    // As a run that is interrupted and goes on.
                    let [first, second] = optimiser.moments().unwrap();
                    optimiser = adam(&vars, flat);
                    optimiser.restore(3, [&first, &second]).unwrap();
                }
                steps.push(optimiser.step(&gradients(&vars, f64::from(step)), 0.01).unwrap());
            }
            let [first, second] = optimiser.moments().unwrap();
            let moments = first.values().chain(second.values()).flat_map(|moment| host(moment).unwrap());
            (values(&vars), moments.collect::<Vec<f32>>(), steps)
        };
        let ((weights, moments, steps), (wanted, wanted_moments, wanted_steps)) = (run(true), run(false));
        for (found, wanted) in weights.iter().chain(&moments).zip(wanted.iter().chain(&wanted_moments)) {
            assert!((found - wanted).abs() < 1e-6 * (1. + wanted.abs()), "{found} instead of {wanted}");
        }
        for (found, wanted) in steps.iter().zip(&wanted_steps) {
            assert!((found.gradient_norm / wanted.gradient_norm - 1.).abs() < 1e-6);
            assert_eq!(found.silent, ["unreached"]);
        }
        assert!(wanted_steps.iter().any(|step| step.gradient_norm > CLIP_NORM), "no gradient was shortened");
    }

    #[test]
    fn a_gradient_that_is_not_finite_names_its_weight_and_moves_nothing() {
        let vars = vars();
        let before = values(&vars);
        let mut optimiser = adam(&vars, true);
        let bad = (vars["b"].as_tensor() * f64::INFINITY).unwrap().sum_all().unwrap().backward().unwrap();
        let error = optimiser.step(&[bad], 0.1).unwrap_err();
        assert!(error.to_string().contains("`b`"), "{error}");
        assert_eq!((values(&vars), optimiser.steps()), (before, 0));
    }
}
