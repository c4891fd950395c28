//! Adam over named weights, with the norm of the gradient held down.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use candle_core::backprop::GradStore;
use candle_core::{CpuStorage, DType, Device, InplaceOp2, Layout, Tensor, Var};
use gnp_nn::kernels::{read, values};
use rayon::prelude::*;

use crate::error::TrainError;

mod flat;

use flat::Flat;

// Published defaults (Kingma and Ba 2015); both networks of the paper are trained with them.
const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Adam with decoupled weight decay (Loshchilov and Hutter 2019; 0 is plain Adam).
///
/// On the CPU weights are moved side by side, each by one thread in two passes: one for the norm, which adds up in name
/// order, and one for everything else, in place; so a step gives the same bits on every number of threads. On a GPU it
/// runs there, on all weights end to end, and the host waits for the gradient's norm alone.
#[derive(Debug)]
pub struct Adam {
    weights: BTreeMap<String, Moments>,
    /// The moments where they are not on the host; those of `weights` are empty then.
    flat: Option<Flat>,
    weight_decay: f64,
    clip_norm: f64,
    steps: u64,
}

#[derive(Debug)]
struct Moments {
    var: Var,
    first: Vec<f32>,
    second: Vec<f32>,
}

/// What one step met.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Euclidean norm of the whole gradient, before it was shortened.
    pub gradient_norm: f64,
    /// Weights that the loss does not reach; their gradient counts as 0.
    pub silent: Vec<String>,
}

impl Adam {
    /// Adam for `weights`, all of type f32, with moments of 0. `clip_norm` 0 leaves gradients as
    /// they are.
    ///
    /// # Errors
    /// When the device of the weights has no room for the moments.
    pub fn new(weights: BTreeMap<String, Var>, weight_decay: f64, clip_norm: f64) -> Result<Self, TrainError> {
        let on_host = weights.values().all(|var| var.device().is_cpu());
        let flat = if on_host { None } else { Some(Flat::new(weights.values())?) };
        let moments = |var: Var| {
            let zeros = vec![0.; if on_host { var.elem_count() } else { 0 }];
            Moments { var, first: zeros.clone(), second: zeros }
        };
        let weights = weights.into_iter().map(|(name, var)| (name, moments(var))).collect();
        Ok(Self { weights, flat, weight_decay, clip_norm, steps: 0 })
    }

    /// Steps taken.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Moves every weight by one step at learning rate `rate` along the sum of `gradients`, those of the parts of a
    /// mini-batch.
    ///
    /// # Errors
    /// [`TrainError::Gradient`] with the first weight whose gradient is not finite; then no weight
    /// has moved. [`TrainError::Tensor`] when a gradient cannot be read.
    pub fn step(&mut self, gradients: &[GradStore], rate: f64) -> Result<Step, TrainError> {
        let sum = |weight: &Moments| sum_of(gradients, &weight.var);
        let weights: Vec<&Moments> = self.weights.values().collect();
        // Each weight by itself, its parts in order, whoever adds them up.
        let sums: Vec<Option<Tensor>> = match self.flat {
            None => weights.into_par_iter().map(sum).collect::<candle_core::Result<_>>()?,
            Some(_) => weights.into_iter().map(sum).collect::<candle_core::Result<_>>()?,
        };
        let unreached = self.weights.keys().zip(&sums).filter(|(_, sum)| sum.is_none());
        let silent = unreached.map(|(name, _)| name.clone()).collect();
        let gradient_norm = match &mut self.flat {
            None => self.step_on_host(&sums, rate)?,
            Some(flat) => {
                let vars = || self.weights.values().map(|weight| &weight.var);
                let Some((gradient, norm)) = flat.gradient(vars().zip(&sums))? else {
                    return Err(self.not_finite(&sums)?);
                };
                self.steps += 1;
                let update = Update::new(self.steps, rate, self.weight_decay, scale(self.clip_norm, norm));
                flat.step(vars(), &gradient, &update)?;
                norm
            }
        };
        Ok(Step { gradient_norm, silent })
    }

    /// The error of the first weight whose gradient is not finite, or of the largest where only their norm is not.
    fn not_finite(&self, gradients: &[Option<Tensor>]) -> Result<TrainError, TrainError> {
        let mut largest = (0., String::new());
        for (name, gradient) in self.weights.keys().zip(gradients) {
            let Some(gradient) = gradient else { continue };
            let square: f64 = host(gradient)?.iter().map(|g| f64::from(*g) * f64::from(*g)).sum();
            if !square.is_finite() {
                return Ok(TrainError::Gradient { weight: name.clone() });
            }
            if square > largest.0 {
                largest = (square, name.clone());
            }
        }
        Ok(TrainError::Gradient { weight: largest.1 })
    }

    /// A step on the host; the norm of the gradient.
    fn step_on_host(&mut self, gradients: &[Option<Tensor>], rate: f64) -> Result<f64, TrainError> {
        let mut weights: Vec<(&String, &mut Moments)> = self.weights.iter_mut().collect();
        let found: Vec<Option<Tensor>> =
            gradients.iter().map(|of| of.as_ref().map(on_host).transpose()).collect::<candle_core::Result<_>>()?;
        let square = |gradient: &Option<Tensor>| -> candle_core::Result<f64> {
            let Some(gradient) = gradient else { return Ok(0.) };
            Ok(read(gradient)?.iter().map(|g| f64::from(*g) * f64::from(*g)).sum())
        };
        // Each weight by itself and then in name order, whoever worked them out.
        let squares: Vec<f64> = found.par_iter().map(square).collect::<candle_core::Result<_>>()?;
        // A sum of squares of f32 cannot overflow an f64: it is finite when every entry is.
        if let Some(((name, _), _)) = weights.iter().zip(&squares).find(|(_, square)| !square.is_finite()) {
            return Err(TrainError::Gradient { weight: (*name).clone() });
        }
        let gradient_norm = squares.iter().sum::<f64>().sqrt();
        self.steps += 1;
        let update = Update::new(self.steps, rate, self.weight_decay, scale(self.clip_norm, gradient_norm));
        weights.par_iter_mut().zip(&found).try_for_each(|((_, weight), gradient)| update.step(weight, gradient))?;
        Ok(gradient_norm)
    }

    /// The first moments, then the second ones, under the names and in the shapes of the weights;
    /// on the CPU.
    ///
    /// # Errors
    /// When candle cannot make a tensor.
    pub fn moments(&self) -> Result<[BTreeMap<String, Tensor>; 2], TrainError> {
        if let Some(flat) = &self.flat {
            let split = |of: Vec<Tensor>| self.weights.keys().cloned().zip(of).collect();
            return Ok(flat.moments(self.weights.values().map(|weight| &weight.var))?.map(split));
        }
        let collect = |of: fn(&Moments) -> &Vec<f32>| -> candle_core::Result<_> {
            let tensor = |weight: &Moments| Tensor::from_slice(of(weight), weight.var.shape(), &Device::Cpu);
            self.weights.iter().map(|(name, weight)| Ok((name.clone(), tensor(weight)?))).collect()
        };
        Ok([collect(|weight| &weight.first)?, collect(|weight| &weight.second)?])
    }

    /// Goes on from the moments of an earlier Adam after `steps` steps.
    ///
    /// # Errors
    /// A sentence naming the weight that has no moment or one of another shape.
    pub(crate) fn restore(&mut self, steps: u64, moments: [&BTreeMap<String, Tensor>; 2]) -> Result<(), String> {
        for (name, weight) in &mut self.weights {
            let read = |saved: &BTreeMap<String, Tensor>| matching(name, &weight.var, saved);
            let [first, second] = moments.map(read);
            (weight.first, weight.second) = (first?, second?);
        }
        if let Some(flat) = &mut self.flat {
            let mut take = |of: fn(&mut Moments) -> &mut Vec<f32>| -> Vec<f32> {
                self.weights.values_mut().flat_map(|weight| std::mem::take(of(weight))).collect()
            };
            let moments = [take(|weight| &mut weight.first), take(|weight| &mut weight.second)];
            flat.restore(moments).map_err(|error| format!("the moments: {error}"))?;
        }
        self.steps = steps;
        Ok(())
    }
}

/// The numbers of one step, the same for all weights.
#[derive(Clone, Copy, Debug)]
struct Update {
    /// What the gradient is multiplied with.
    scale: f32,
    size: f32,
    root: f32,
    /// What decay leaves of a weight.
    kept: f32,
}

impl Update {
    fn new(steps: u64, rate: f64, weight_decay: f64, scale: f32) -> Self {
        let bias = |beta: f32| 1. - f64::from(beta).powf(steps as f64);
        Self {
            scale,
            size: (rate / bias(BETA_1)) as f32,
            root: bias(BETA_2).sqrt() as f32,
            kept: (1. - rate * weight_decay) as f32,
        }
    }

    /// One weight; a missing gradient counts as 0.
    fn step(self, weight: &mut Moments, gradient: &Option<Tensor>) -> candle_core::Result<()> {
        let Moments { var, first, second } = weight;
        let zeros;
        let gradient = match gradient {
            Some(gradient) => gradient,
            None => {
                zeros = Tensor::zeros(var.shape(), DType::F32, &Device::Cpu)?;
                &zeros
            }
        };
        let moments = Mutex::new((first.as_mut_slice(), second.as_mut_slice()));
        let step = InPlace { update: self, moments };
        if var.device().is_cpu() && var.is_contiguous() {
            return var.inplace_op2(gradient, &step);
        }
        let values = on_host(var.as_tensor())?.copy()?;
        values.inplace_op2(gradient, &step)?;
        var.set(&values.to_device(var.device())?)
    }
}

/// A step of one weight on its own memory.
struct InPlace<'a> {
    update: Update,
    moments: Mutex<(&'a mut [f32], &'a mut [f32])>,
}

impl InplaceOp2 for InPlace<'_> {
    fn name(&self) -> &'static str {
        "adam"
    }

    fn cpu_fwd(
        &self,
        weight: &mut CpuStorage,
        weight_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> candle_core::Result<()> {
        let (CpuStorage::F32(weight), Some((start, end))) = (weight, weight_layout.contiguous_offsets()) else {
            candle_core::bail!("Adam moves contiguous f32");
        };
        let (gradient, weight) = (values(gradient, gradient_layout)?, &mut weight[start..end]);
        let mut moments = self.moments.lock().unwrap_or_else(PoisonError::into_inner);
        let Update { scale, size, root, kept } = self.update;
        let (first, second) = &mut *moments;
        for ((value, gradient), (first, second)) in
            weight.iter_mut().zip(gradient).zip(first.iter_mut().zip(second.iter_mut()))
        {
            let gradient = gradient * scale;
            *first = BETA_1 * *first + (1. - BETA_1) * gradient;
            *second = BETA_2 * *second + (1. - BETA_2) * gradient * gradient;
            *value = kept * *value - size * *first / (second.sqrt() / root + EPSILON);
        }
        Ok(())
    }
}

/// The sum of what `parts` have for `var`, in their order; nothing where none of them has anything.
fn sum_of(parts: &[GradStore], var: &Var) -> candle_core::Result<Option<Tensor>> {
    let mut found = parts.iter().filter_map(|part| part.get(var.as_tensor()));
    let Some(first) = found.next() else { return Ok(None) };
    found.try_fold(first.clone(), |sum, more| sum + more).map(Some)
}

/// What shortens a gradient of this norm to `clip_norm`, if that is above 0 and the gradient is longer.
fn scale(clip_norm: f64, gradient_norm: f64) -> f32 {
    if clip_norm > 0. && gradient_norm > clip_norm { (clip_norm / gradient_norm) as f32 } else { 1. }
}

/// The values of the tensor that `saved` has for the weight `var`, if it has its shape.
pub(crate) fn matching(name: &str, var: &Var, saved: &BTreeMap<String, Tensor>) -> Result<Vec<f32>, String> {
    let Some(tensor) = saved.get(name) else {
        return Err(format!("weight `{name}` is not in the checkpoint"));
    };
    if tensor.shape() != var.shape() {
        return Err(format!("weight `{name}` has shape {:?} and had {:?}", var.dims(), tensor.dims()));
    }
    host(tensor).map_err(|error| format!("weight `{name}`: {error}"))
}

/// `tensor` as f32 in row-major order on the CPU; itself where it is so.
fn on_host(tensor: &Tensor) -> candle_core::Result<Tensor> {
    tensor.to_device(&Device::Cpu)?.to_dtype(DType::F32)?.contiguous()
}

/// The values of `tensor` in row-major order.
pub(crate) fn host(tensor: &Tensor) -> candle_core::Result<Vec<f32>> {
    tensor.to_dtype(DType::F32)?.flatten_all()?.to_vec1()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn var(values: &[f32]) -> Var {
        Var::new(values, &Device::Cpu).unwrap()
    }

    /// Gradient of `sum(c * w)` is `c`.
    fn gradients(pairs: &[(&Var, &[f32])]) -> [GradStore; 1] {
        let term = |(var, c): &(&Var, &[f32])| {
            (var.as_tensor() * Tensor::new(*c, &Device::Cpu).unwrap()).unwrap().sum_all().unwrap()
        };
        let terms: Vec<Tensor> = pairs.iter().map(term).collect();
        [Tensor::stack(&terms, 0).unwrap().sum_all().unwrap().backward().unwrap()]
    }

    fn adam(named: &[(&str, &Var)], weight_decay: f64, clip_norm: f64) -> Adam {
        let weights = named.iter().map(|(name, var)| ((*name).to_owned(), (*var).clone())).collect();
        Adam::new(weights, weight_decay, clip_norm).unwrap()
    }

    fn assert_close(var: &Var, expected: &[f32]) {
        let values = host(var.as_tensor()).unwrap();
        for (value, expected) in values.iter().zip(expected) {
            assert!((value - expected).abs() < 1e-6, "{values:?}");
        }
    }

    #[test]
    fn two_steps_are_those_worked_out_by_hand() {
        // w = 1, rate 0.1, gradients 2 then -1.
        // Step 1: m = 0.2, v = 0.004; corrected 2 and 4; w = 1 - 0.1 * 2 / 2 = 0.9.
        // Step 2: m = 0.18 - 0.1 = 0.08, v = 0.003996 + 0.001 = 0.004996; corrected
        // 0.08 / 0.19 = 0.4210526 and 0.004996 / 0.001999 = 2.4992496; w = 0.9 - 0.1 * 0.4210526 / 1.5809015.
        let w = var(&[1.]);
        let mut adam = adam(&[("w", &w)], 0., 0.);
        adam.step(&gradients(&[(&w, &[2.])]), 0.1).unwrap();
        assert_close(&w, &[0.9]);
        adam.step(&gradients(&[(&w, &[-1.])]), 0.1).unwrap();
        assert_close(&w, &[0.9 - 0.026_633_7]);
        assert_eq!(adam.steps(), 2);
    }

    #[test]
    fn weight_decay_is_apart_from_the_gradient() {
        // 1 * (1 - 0.1 * 0.5) - 0.1: a decay inside the gradient would leave 0.9.
        let w = var(&[1.]);
        adam(&[("w", &w)], 0.5, 0.).step(&gradients(&[(&w, &[2.])]), 0.1).unwrap();
        assert_close(&w, &[0.85]);
    }

    #[test]
    fn a_long_gradient_is_shortened_over_all_weights_together() {
        // (3, 0) and (4) have norm 5; shortened to 0.5 they are a tenth: first moments 0.1 * g / 10.
        let (a, b) = (var(&[0., 0.]), var(&[0.]));
        let mut optimiser = adam(&[("a", &a), ("b", &b)], 0., 0.5);
        let step = optimiser.step(&gradients(&[(&a, &[3., 0.]), (&b, &[4.])]), 1e-3).unwrap();
        assert!((step.gradient_norm - 5.).abs() < 1e-12);
        let [first, _] = optimiser.moments().unwrap();
        assert_close(&Var::from_tensor(&first["a"]).unwrap(), &[0.03, 0.]);
        assert_close(&Var::from_tensor(&first["b"]).unwrap(), &[0.04]);
        // A short one is left as it is.
        let mut optimiser = adam(&[("a", &a)], 0., 9.);
        optimiser.step(&gradients(&[(&a, &[3., 0.])]), 1e-3).unwrap();
        assert_close(&Var::from_tensor(&optimiser.moments().unwrap()[0]["a"]).unwrap(), &[0.3, 0.]);
    }

    #[test]
    fn a_gradient_that_is_not_finite_names_its_weight_and_moves_nothing() {
        for bad in [f32::NAN, f32::INFINITY] {
            let (a, b) = (var(&[1.]), var(&[2., 3.]));
            let mut adam = adam(&[("a", &a), ("b", &b)], 0., 1.);
            let error = adam.step(&gradients(&[(&a, &[1.]), (&b, &[0., bad])]), 0.1).unwrap_err();
            assert!(matches!(&error, TrainError::Gradient { weight } if weight == "b"), "{error}");
            assert_close(&a, &[1.]);
            assert_eq!(adam.steps(), 0);
        }
    }

    #[test]
    fn parts_of_a_batch_add_up_and_a_weight_is_silent_if_no_part_reaches_it() {
        let moved = |parts: &[&[(usize, f32)]]| {
            let vars = [var(&[1.]), var(&[2.]), var(&[3.])];
            let gradient = |part: &&[(usize, f32)]| {
                let term = |(i, c): &(usize, f32)| (vars[*i].as_tensor() * f64::from(*c)).unwrap();
                let terms: Vec<Tensor> = part.iter().map(term).collect();
                Tensor::stack(&terms, 0).unwrap().sum_all().unwrap().backward().unwrap()
            };
            let gradients: Vec<GradStore> = parts.iter().map(gradient).collect();
            let names = [("a", &vars[0]), ("b", &vars[1]), ("c", &vars[2])];
            let step = adam(&names, 0., 1.).step(&gradients, 0.1).unwrap();
            (step, vars.map(|var| host(var.as_tensor()).unwrap()))
        };
        let (apart, values) = moved(&[&[(0, 1.), (1, -2.)], &[(1, 0.5)], &[(0, 2.)]]);
        let (together, same) = moved(&[&[(0, 3.), (1, -1.5)]]);
        assert_eq!((&apart, &values), (&together, &same));
        assert!((apart.gradient_norm - 11.25f64.sqrt()).abs() < 1e-12);
        assert_eq!((apart.silent, &values[2]), (vec!["c".to_owned()], &vec![3.]));
    }

    #[test]
    fn a_weight_out_of_reach_is_named_and_stays() {
        let (a, b) = (var(&[1.]), var(&[2.]));
        let step = adam(&[("a", &a), ("b", &b)], 0., 0.).step(&gradients(&[(&a, &[1.])]), 0.1).unwrap();
        assert_eq!(step.silent, ["b"]);
        assert_close(&b, &[2.]);
    }

    #[test]
    fn transposed_weights_get_their_own_entries() {
        // The gradient of `w.t()` times something is not contiguous in memory.
        let w = Var::from_vec(vec![0f32; 6], (2, 3), &Device::Cpu).unwrap();
        let c = Tensor::new(&[[1f32, -1.], [1., 1.], [-1., 1.]], &Device::Cpu).unwrap();
        let loss = (w.as_tensor().t().unwrap() * c).unwrap().sum_all().unwrap();
        adam(&[("w", &w)], 0., 0.).step(&[loss.backward().unwrap()], 0.1).unwrap();
        assert_close(&w, &[-0.1, -0.1, 0.1, 0.1, -0.1, -0.1]);
    }

    #[test]
    fn restored_moments_go_on_as_if_never_left() {
        let run = |interrupted: bool| {
            let w = var(&[1., -2.]);
            let mut optimiser = adam(&[("w", &w)], 0.1, 0.);
            for (i, c) in [[2f32, 1.], [-1., 3.], [0.5, 0.1]].iter().enumerate() {
                if interrupted && i == 2 {
                    let [first, second] = optimiser.moments().unwrap();
                    let steps = optimiser.steps();
                    optimiser = adam(&[("w", &w)], 0.1, 0.);
                    optimiser.restore(steps, [&first, &second]).unwrap();
                }
                optimiser.step(&gradients(&[(&w, c)]), 0.1).unwrap();
            }
            host(w.as_tensor()).unwrap()
        };
        assert_eq!(run(true), run(false));
    }
}
