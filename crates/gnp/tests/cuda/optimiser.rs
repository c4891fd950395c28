//! Adam on a GPU.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};
use gnp_train::Adam;

use crate::{close, gpu, values};

#[test]
fn weights_and_moments_move_as_on_the_cpu() {
    let run = |device: &Device| {
        let var = |count: usize, shape: (usize, usize)| {
            let values: Vec<f32> = (0..count).map(|i| (i as f32 * 0.7).sin()).collect();
            Var::from_tensor(&Tensor::from_vec(values, shape, device).unwrap()).unwrap()
        };
        let vars: BTreeMap<String, Var> =
            [("a".to_owned(), var(4000, (40, 100))), ("b".to_owned(), var(6, (2, 3)))].into();
        let mut adam = Adam::new(vars.clone(), 0.1, 0.7).unwrap();
        let mut norms = Vec::new();
        for step in 0..4 {
            let part =
                |name: &str| (vars[name].as_tensor() + f64::from(step)).unwrap().sqr().unwrap().mean_all().unwrap();
            let loss = (part("a") + part("b")).unwrap();
            norms.push(adam.step(&loss.backward().unwrap(), 0.01).unwrap().gradient_norm as f32);
        }
        let [first, second] = adam.moments().unwrap();
        let all = vars.values().map(Var::as_tensor).chain(first.values()).chain(second.values());
        let mut all: Vec<Vec<f32>> = all.map(values).collect();
        all.push(norms);
        all
    };
    for (found, wanted) in run(gpu()).iter().zip(&run(&Device::Cpu)) {
        close("weights, moments, norms", found, wanted, 1e-5);
    }
}
