//! Named weights behind candle's `VarBuilder`: drawn from a seed, or set from tensors.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use candle_core::{DType, Device, Result, Shape, Tensor, Var};
use candle_nn::var_builder::SimpleBackend;
use candle_nn::{Init, VarBuilder};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

type Named = BTreeMap<String, Var>;

/// The trainable weights of a network under their checkpoint names, in name order.
///
/// A weight that a network asks for and that is not there yet is drawn from a generator seeded by
/// `(seed, name)`; one that is there (see [`Weights::set`]) is returned as it is.
#[derive(Clone, Debug)]
pub struct Weights {
    seed: u64,
    device: Device,
    named: Arc<Mutex<Named>>,
}

impl Weights {
    /// An empty set whose weights will be drawn from `seed` as networks ask for them.
    #[must_use]
    pub fn seeded(seed: u64, device: &Device) -> Self {
        Self { seed, device: device.clone(), named: Arc::default() }
    }

    /// Puts `tensors` under their names, as after reading a checkpoint, before or after a network
    /// was built: a network that already holds a weight sees its new value.
    ///
    /// # Errors
    /// When a weight of this name exists with another shape; the message has both shapes.
    pub fn set<'a>(&self, tensors: impl IntoIterator<Item = (&'a str, &'a Tensor)>) -> Result<()> {
        let mut named = self.lock();
        for (name, tensor) in tensors {
            let tensor = tensor.to_device(&self.device)?.to_dtype(DType::F32)?;
            match named.get(name) {
                Some(var) if var.shape() != tensor.shape() => candle_core::bail!(
                    "weight `{name}` has shape {:?} in the network and {:?} in the file",
                    var.dims(),
                    tensor.dims()
                ),
                Some(var) => var.set(&tensor)?,
                None => {
                    named.insert(name.to_owned(), Var::from_tensor(&tensor)?);
                }
            }
        }
        Ok(())
    }

    /// The builder that networks are constructed from; `pp` names the parts.
    #[must_use]
    pub fn builder(&self) -> VarBuilder<'static> {
        VarBuilder::from_backend(Box::new(self.clone()), DType::F32, self.device.clone())
    }

    /// Every weight by name, in name order; the variables are shared, not copied.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, Var> {
        self.lock().clone()
    }

    /// Number of scalars over all weights.
    #[must_use]
    pub fn count(&self) -> usize {
        self.lock().values().map(|var| var.elem_count()).sum()
    }

    /// The device the weights live on.
    #[must_use]
    pub fn device(&self) -> &Device {
        &self.device
    }

    fn lock(&self) -> MutexGuard<'_, Named> {
        // A panic while the lock was held leaves a map that is still a map.
        self.named.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn draw(&self, shape: &Shape, name: &str, init: Init) -> Result<Tensor> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ fnv1a(name));
        let n = shape.elem_count();
        let values: Vec<f32> = match init {
            Init::Const(value) => vec![value as f32; n],
            Init::Uniform { lo, up } => (0..n).map(|_| rng.random_range(lo..up) as f32).collect(),
            other => candle_core::bail!("weight `{name}`: initialisation {other:?} is not seeded here"),
        };
        Tensor::from_vec(values, shape.clone(), &self.device)
    }
}

/// A fixed hash (FNV-1a), because the standard library's may change between releases.
fn fnv1a(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

impl SimpleBackend for Weights {
    fn get(&self, shape: Shape, name: &str, init: Init, _: DType, _: &Device) -> Result<Tensor> {
        if let Some(var) = self.lock().get(name) {
            if var.shape() != &shape {
                candle_core::bail!("weight `{name}` has shape {:?}, the network needs {:?}", var.dims(), shape.dims());
            }
            return Ok(var.as_tensor().clone());
        }
        let var = Var::from_tensor(&self.draw(&shape, name, init)?)?;
        let tensor = var.as_tensor().clone();
        self.lock().insert(name.to_owned(), var);
        Ok(tensor)
    }

    fn get_unchecked(&self, name: &str, _: DType, _: &Device) -> Result<Tensor> {
        match self.lock().get(name) {
            Some(var) => Ok(var.as_tensor().clone()),
            None => candle_core::bail!("no weight `{name}`"),
        }
    }

    fn contains_tensor(&self, name: &str) -> bool {
        self.lock().contains_key(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_depend_on_seed_and_name_only() -> Result<()> {
        let draw = |seed, names: [&str; 2]| -> Result<Vec<f32>> {
            let weights = Weights::seeded(seed, &Device::Cpu);
            let vb = weights.builder();
            for name in names {
                vb.get_with_hints((2, 3), name, Init::Uniform { lo: -1., up: 1. })?;
            }
            weights.named()["a"].as_tensor().flatten_all()?.to_vec1()
        };
        assert_eq!(draw(1, ["a", "b"])?, draw(1, ["b", "a"])?);
        assert_ne!(draw(1, ["a", "b"])?, draw(2, ["a", "b"])?);
        Ok(())
    }

    #[test]
    fn a_wrong_shape_is_refused_with_both_shapes() -> Result<()> {
        let weights = Weights::seeded(0, &Device::Cpu);
        weights.builder().get_with_hints((2, 3), "w", Init::Const(0.))?;
        let wrong = Tensor::zeros((3, 2), DType::F32, &Device::Cpu)?;
        let message = weights.set([("w", &wrong)]).unwrap_err().to_string();
        assert!(message.contains("[2, 3]") && message.contains("[3, 2]"), "{message}");
        Ok(())
    }

    #[test]
    fn a_network_sees_what_is_set_later() -> Result<()> {
        let weights = Weights::seeded(0, &Device::Cpu);
        let held = weights.builder().get_with_hints(2, "w", Init::Const(0.))?;
        weights.set([("w", &Tensor::new(&[4f32, 5.], &Device::Cpu)?)])?;
        assert_eq!(held.to_vec1::<f32>()?, [4., 5.]);
        Ok(())
    }
}
