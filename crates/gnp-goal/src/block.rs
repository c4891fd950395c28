//! One layer of the transformer.

use candle_core::{Result, Tensor};
use candle_nn::{Linear, Module, VarBuilder};
use gnp_nn::{Dropout, DropoutMask, LayerNorm, layer_norm, linear};

use crate::attention::Attention;
use crate::fused::{self, FusedBlock};

/// A post-norm transformer layer: attention, then feed-forward with ReLU, each added to what came
/// in and normalised.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    attention: Attention,
    norm1: LayerNorm,
    norm2: LayerNorm,
    hidden: Linear,
    output: Linear,
}

/// Masks of a block: for what attention gives, and for what feed-forward gives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockMasks {
    pub(crate) attention: DropoutMask,
    pub(crate) feed_forward: DropoutMask,
}

impl BlockMasks {
    /// The next two masks of a training step, none for inference.
    pub(crate) fn draw(dropout: Option<&mut Dropout>) -> Self {
        match dropout {
            Some(dropout) => Self { attention: dropout.draw(), feed_forward: dropout.draw() },
            None => Self { attention: DropoutMask::NONE, feed_forward: DropoutMask::NONE },
        }
    }
}

impl Block {
    /// Named `attn`, `n1`, `n2`, `f1` and `f2` under `vb`.
    pub(crate) fn new(width: usize, heads: usize, feed_forward: usize, vb: VarBuilder) -> Result<Self> {
        Ok(Self {
            attention: Attention::new(width, heads, vb.pp("attn"))?,
            norm1: layer_norm(width, vb.pp("n1"))?,
            norm2: layer_norm(width, vb.pp("n2"))?,
            hidden: linear(width, feed_forward * width, vb.pp("f1"))?,
            output: linear(feed_forward * width, width, vb.pp("f2"))?,
        })
    }

    /// `x` `[batch, l, width]` attends to `keys` `[batch, m, width]` where `mask` `[batch, m]` is not
    /// 0 (see [`Attention::forward`]), or to all of itself; as one operation on the CPU.
    pub(crate) fn fused(&self, x: &Tensor, keys: Option<(&Tensor, &Tensor)>, masks: BlockMasks) -> Result<Tensor> {
        let present = keys.map(|(_, mask)| mask.flatten_all()?.to_vec1::<f32>()).transpose()?;
        let block = FusedBlock {
            heads: self.attention.heads,
            hidden: self.hidden.weight().dims()[0],
            masks,
            present: present.map(|mask| mask.into_iter().map(|m| m != 0.).collect()),
        };
        block.apply(x, keys.map(|(keys, _)| keys), &self.weights()?)
    }

    /// As [`Block::fused`], operation by operation.
    pub(crate) fn graph(&self, x: &Tensor, keys: Option<(&Tensor, &Tensor)>, masks: BlockMasks) -> Result<Tensor> {
        let (keys, mask) = keys.map_or((x, None), |(keys, mask)| (keys, Some(mask)));
        let gathered = masks.attention.apply(&self.attention.forward(x, keys, mask)?)?;
        let x = self.norm1.forward(&(x + gathered)?)?;
        let y = masks.feed_forward.apply(&self.output.forward(&self.hidden.forward(&x)?.relu()?)?)?;
        self.norm2.forward(&(x + y)?)
    }
    /// All weights as one vector, in the order of the fused operation.
    fn weights(&self) -> Result<Tensor> {
        let Attention { query, key, value, output, .. } = &self.attention;
        let maps = [query, key, value, output, &self.hidden, &self.output];
        let [bq, bk, bv, bo, bu, bd] = maps.map(Linear::bias);
        let (Some(bq), Some(bk), Some(bv), Some(bo), Some(bu), Some(bd)) = (bq, bk, bv, bo, bu, bd) else {
            candle_core::bail!("a block's maps have biases");
        };
        let [q, k, v, o, u, d] = maps.map(Linear::weight);
        let ((w1, b1), (w2, b2)) = (self.norm1.affine(), self.norm2.affine());
        fused::flatten(&[q, k, v, bq, bk, bv, o, bo, w1, b1, u, bu, d, bd, w2, b2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{DType, Device, Var};
    use gnp_nn::Weights;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn random(shape: &[usize], seed: u64) -> Var {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let values: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(-1. ..1.)).collect();
        Var::from_tensor(&Tensor::from_vec(values, shape, &Device::Cpu).unwrap()).unwrap()
    }

    fn values(x: &Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    struct Case {
        block: Block,
        weights: Weights,
        x: Var,
        keys: Option<(Var, Tensor)>,
        masks: BlockMasks,
    }

    impl Case {
        /// A block of `batch` windows with weights of which none is at its start value.
        fn new([batch, queries, keys, width, heads]: [usize; 5], cross: bool, rate: f32) -> Self {
            let weights = Weights::seeded(3, &Device::Cpu);
            let block = Block::new(width, heads, 3, weights.builder()).unwrap();
            for (i, (_, var)) in weights.named().iter().enumerate() {
                var.set(&(var.as_tensor() + (random(var.dims(), i as u64).as_tensor() * 0.3).unwrap()).unwrap())
                    .unwrap();
            }
            let mask = random(&[batch, keys], 5).gt(0.).unwrap().to_dtype(DType::F32).unwrap();
            // The last window has nobody.
            let some = Tensor::arange(0u32, batch as u32, &Device::Cpu).unwrap().lt((batch - 1) as u32).unwrap();
            let mask = mask.broadcast_mul(&some.to_dtype(DType::F32).unwrap().unsqueeze(1).unwrap()).unwrap();
            let mut dropout = Dropout::new(rate, 9);
            Self {
                block,
                weights,
                x: random(&[batch, queries, width], 6),
                keys: cross.then(|| (random(&[batch, keys, width], 7), mask)),
                masks: BlockMasks::draw(Some(&mut dropout)),
            }
        }

        /// Output, and the gradients of all that has one, by name.
        fn run(&self, fused: bool) -> Vec<(String, Vec<f32>)> {
            let keys = self.keys.as_ref().map(|(keys, mask)| (keys.as_tensor(), mask));
            let run = if fused { Block::fused } else { Block::graph };
            let out = run(&self.block, &self.x, keys, self.masks).unwrap();
            let weighed = (&out * random(out.dims(), 8).as_tensor()).unwrap();
            let grads = weighed.sum_all().unwrap().backward().unwrap();
            let mut vars: Vec<(String, Var)> = self.weights.named().into_iter().collect();
            vars.push(("x".to_owned(), self.x.clone()));
            vars.extend(self.keys.iter().map(|(keys, _)| ("keys".to_owned(), keys.clone())));
            let mut all = vec![("output".to_owned(), values(&out))];
            all.extend(vars.iter().map(|(name, var)| (name.clone(), values(grads.get(var).unwrap()))));
            all
        }
    }

    #[test]
    fn one_operation_gives_what_the_graph_gives() {
        for cross in [false, true] {
            for sizes in [[3, 7, 5, 12, 3], [18, 9, 4, 16, 4], [2, 37, 19, 32, 2], [1, 1, 1, 6, 1]] {
                for rate in [0., 0.3] {
                    let case = Case::new(sizes, cross, rate);
                    for ((name, fused), (_, graph)) in case.run(true).iter().zip(case.run(false)) {
                        let scale = graph.iter().fold(0.1f32, |scale, x| scale.max(x.abs()));
                        let worst = fused.iter().zip(&graph).fold(0f32, |worst, (f, g)| worst.max((f - g).abs()));
                        assert!(
                            fused.len() == graph.len() && worst < 3e-5 * scale,
                            "{sizes:?} {name}: {worst} of {scale}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn threads_do_not_reach_the_result() {
        for cross in [false, true] {
            let case = Case::new([37, 11, 6, 16, 4], cross, 0.2);
            let on = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| case.run(true))
            };
            let one = on(1);
            assert_eq!(one, on(2));
            assert_eq!(one, on(5));
        }
    }

    #[test]
    fn sizes_that_do_not_fit_are_refused() {
        let case = Case::new([3, 7, 5, 12, 3], true, 0.);
        let (keys, mask) = case.keys.as_ref().map(|(keys, mask)| (keys.narrow(1, 0, 4).unwrap(), mask)).unwrap();
        assert!(case.block.fused(&case.x, Some((&keys, mask)), case.masks).is_err());
        let narrow = case.x.narrow(2, 0, 9).unwrap();
        assert!(case.block.fused(&narrow, None, case.masks).is_err());
    }
}
