//! Known sizes, gradients and symmetries of STDAN.

use candle_core::{D, DType, Device, Result, Tensor, Var};
use candle_nn::Module;
use gnp_data::{
    Columns, Dataset, Observation, Recording, RecordingMeta, Road, SLOTS, Track, VehicleClass, WindowShape,
};
use gnp_nn::Weights;

use super::*;
use crate::inputs::Inputs;
use crate::oriented_view::OrientedView;
use crate::time_grid::TimeGrid;

fn published() -> StdanSizes {
    StdanSizes::published(16, 25)
}

const SMALL: StdanSizes = StdanSizes { past: 4, future: 3, cells: 6, embedding: 7, hidden: 8, heads: 2, head: 5 };

fn net(sizes: StdanSizes, masked: bool) -> (Stdan, Weights) {
    let weights = Weights::seeded(11, &Device::Cpu);
    let net = Stdan::new(sizes, masked, &weights.builder()).unwrap();
    (net, weights)
}

fn paths(sizes: StdanSizes, rows: usize) -> Tensor {
    let values = (0..sizes.past * rows * FEATURES).map(|i| (1.3 * i as f32).sin()).collect();
    Tensor::from_vec(values, (sizes.past, rows, FEATURES), &Device::Cpu).unwrap()
}

/// Depends on everything that the network gives.
fn loss(output: &Said) -> Result<Tensor> {
    let classes = (output.classes.lateral.sqr()?.sum_all()? + output.classes.longitudinal.sqr()?.sum_all()?)?;
    output.raw.sqr()?.sum_all()? + classes
}

fn largest(a: &Tensor, b: &Tensor) -> f32 {
    assert_eq!(a.dims(), b.dims());
    (a - b).unwrap().abs().unwrap().flatten_all().unwrap().max(0).unwrap().to_scalar().unwrap()
}

#[test]
fn the_published_size_has_215_595_parameters() {
    for masked in [false, true] {
        assert_eq!(net(published(), masked).1.count(), 215_595);
    }
}

#[test]
fn gives_five_numbers_a_future_point_and_two_manoeuvres() {
    let (net, _) = net(published(), false);
    let output = net.say(&paths(published(), 3 + 2), &[19, 2 * 39 + 7]).unwrap();
    assert_eq!(output.raw.dims(), [3, 25, 5]);
    assert_eq!((output.classes.lateral.dims(), output.classes.longitudinal.dims()), (&[3, 3][..], &[3, 3][..]));
}

#[test]
fn every_weight_gets_a_gradient() {
    for masked in [false, true] {
        let (net, weights) = net(published(), masked);
        let output = net.say(&paths(published(), 2 + 3), &[3, 20, 39 + 8]).unwrap();
        let grads = loss(&output).unwrap().backward().unwrap();
        for (name, var) in weights.named() {
            let grad = grads.get(&var).unwrap_or_else(|| panic!("no gradient for {name}"));
            let grad = grad.abs().unwrap().flatten_all().unwrap().max(0).unwrap().to_scalar::<f32>().unwrap();
            assert!(grad.is_finite(), "{name}");
            // A softmax does not feel what is added to all its scores.
            assert!(grad > 1e-7 || name.ends_with("key.bias"), "{name}: {grad}");
        }
    }
}

#[test]
fn gradients_are_differences() {
    for masked in [false, true] {
        let (net, weights) = net(SMALL, masked);
        let index = [4u32, 6, 11];
        let input = Var::from_tensor(&paths(SMALL, 3 + 3)).unwrap();
        let value = || loss(&net.say(input.as_tensor(), &index).unwrap()).unwrap();
        let grads = value().backward().unwrap();
        let mut all: Vec<(String, Var)> = weights.named().into_iter().collect();
        all.push(("input".to_owned(), input.clone()));
        for (name, var) in all {
            let grad = grads.get(&var).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
            let held = var.flatten_all().unwrap().to_vec1::<f32>().unwrap();
            for i in (0..held.len()).step_by(1 + held.len() / 8) {
                let at = |delta: f32| {
                    let mut moved = held.clone();
                    moved[i] += delta;
                    var.set(&Tensor::from_vec(moved, var.shape(), &Device::Cpu).unwrap()).unwrap();
                    value().to_scalar::<f32>().unwrap()
                };
                let difference = (at(1e-2) - at(-1e-2)) / 2e-2;
                var.set(&Tensor::from_slice(&held, var.shape(), &Device::Cpu).unwrap()).unwrap();
                let off = (difference - grad[i]).abs();
                assert!(off < 5e-3 * (1. + grad[i].abs()), "{name}[{i}]: {} and {difference}", grad[i]);
            }
        }
    }
}

/// The social attention as published: every cell of the grid has a key and a value.
fn cell_by_cell(weights: &Weights, targets: &Tensor, neighbours: &Tensor, index: &[u32], sizes: StdanSizes) -> Tensor {
    let (past, batch, hidden) = targets.dims3().unwrap();
    let mut grid = Tensor::zeros((past, batch * sizes.cells, hidden), DType::F32, &Device::Cpu).unwrap();
    let rows = Tensor::from_slice(index, index.len(), &Device::Cpu).unwrap();
    grid = grid.index_add(&rows, neighbours, 1).unwrap();
    let layer = |name: &str| linear(hidden, sizes.heads * sizes.head, weights.builder().pp(name)).unwrap();
    let heads =
        |x: Tensor, rows: usize| x.reshape((past * batch, rows, sizes.heads, sizes.head)).unwrap().transpose(1, 2);
    let query = heads(layer("query").forward(targets).unwrap(), 1).unwrap().contiguous().unwrap();
    let key = heads(layer("key").forward(&grid).unwrap(), sizes.cells).unwrap().contiguous().unwrap();
    let value = heads(layer("value").forward(&grid).unwrap(), sizes.cells).unwrap().contiguous().unwrap();
    let scores = (query.matmul(&key.t().unwrap()).unwrap() * (sizes.hidden as f64).sqrt().recip()).unwrap();
    let seen = candle_nn::ops::softmax(&scores, D::Minus1).unwrap().matmul(&value).unwrap();
    seen.reshape((past, batch, sizes.heads * sizes.head)).unwrap()
}

#[test]
fn empty_cells_take_part_as_published() {
    let weights = Weights::seeded(4, &Device::Cpu);
    let social = Social::new(SMALL, false, weights.builder()).unwrap();
    let codes = |rows: usize, from: f32| {
        let values = (0..SMALL.past * rows * SMALL.hidden).map(|i| (from + 0.7 * i as f32).sin()).collect();
        Tensor::from_vec(values, (SMALL.past, rows, SMALL.hidden), &Device::Cpu).unwrap()
    };
    // Two vehicles around the first window, nobody around the second, all cells full around the third.
    let index = [5, 2, 12, 13, 14, 15, 16, 17];
    let (targets, neighbours) = (codes(3, 0.1), codes(index.len(), 2.));
    let crowd = Crowd::new(&index, 3, SMALL.cells, false);
    let seen = social.forward(&targets, &neighbours, &crowd).unwrap();
    assert!(largest(&seen, &cell_by_cell(&weights, &targets, &neighbours, &index, SMALL)) < 1e-5);
}

#[test]
fn masked_it_sees_vehicles_only() {
    let (full, weights) = net(SMALL, false);
    let masked = Stdan::new(SMALL, true, &weights.builder()).unwrap();
    let paths = paths(SMALL, 2 + 1);
    let of = |net: &Stdan, index: &[u32]| net.say(&paths, index).unwrap().raw;
    assert!(largest(&of(&full, &[4]), &of(&masked, &[4])) > 1e-4);
    // A wider grid has more empty cells, which matter only to the published form.
    let wide = StdanSizes { cells: 9, ..SMALL };
    let at = |masked: bool| Stdan::new(wide, masked, &weights.builder()).unwrap();
    assert!(largest(&of(&full, &[4]), &of(&at(false), &[4])) > 1e-5);
    assert_eq!(largest(&of(&masked, &[4]), &of(&at(true), &[4])), 0.);
    // Seeing nobody is seeing nothing: the values' bias does not come in.
    let alone = |net: &Stdan| net.say(&paths, &[]).unwrap().raw;
    let before = alone(&masked);
    let bias = &weights.named()["social.value.bias"];
    bias.set(&(bias.as_tensor() + 1.).unwrap()).unwrap();
    assert_eq!(largest(&before, &alone(&masked)), 0.);
    assert!(largest(&before, &alone(&full)) > 1e-4);
}

#[test]
fn the_order_of_the_neighbours_does_not_matter() {
    for masked in [false, true] {
        let (net, _) = net(published(), masked);
        let all = paths(published(), 2 + 4);
        let straight = net.say(&all, &[0, 38, 17, 39 + 5]).unwrap();
        let order = Tensor::new(&[0u32, 1, 4, 2, 5, 3], &Device::Cpu).unwrap();
        let turned = net.say(&all.index_select(&order, 1).unwrap(), &[17, 0, 39 + 5, 38]).unwrap();
        assert!(largest(&straight.raw, &turned.raw) < 1e-6);
        // But who is around whom does.
        let other = net.say(&all, &[0, 38, 17, 6]).unwrap();
        assert!(largest(&straight.raw, &other.raw) > 1e-5);
    }
}

#[test]
fn the_future_is_a_convex_mixture_of_the_past_chosen_by_the_likeliest_manoeuvre() {
    let weights = Weights::seeded(2, &Device::Cpu);
    let fusion = Fusion::new(SMALL, weights.builder()).unwrap();
    let logits = |lateral: [f32; 3], longitudinal: [f32; 3]| {
        [lateral, longitudinal].map(|logits| Tensor::new(&[logits], &Device::Cpu).unwrap())
    };
    let codes: Vec<f32> = (0..SMALL.past * SMALL.hidden).map(|i| (i as f32).cos()).collect();
    let codes = Tensor::from_vec(codes, (SMALL.past, 1, SMALL.hidden), &Device::Cpu).unwrap();
    let mixed = |logits| fusion.forward(&codes, &logits).unwrap();
    let kept = mixed(logits([2., 1., 0.], [0., 3., 1.]));
    assert_eq!(kept.dims(), [SMALL.future, 1, SMALL.hidden]);
    assert_eq!(largest(&kept, &mixed(logits([9., 1., 0.], [0., 3., 2.9]))), 0.);
    assert!(largest(&kept, &mixed(logits([0., 1., 0.], [0., 3., 1.]))) > 1e-3);

    // By hand: weights of `left` and of `brake`, added and put through a softmax over the past.
    let weight = weights.named()["weight"].as_tensor().to_vec3::<f32>().unwrap();
    let held = codes.to_vec3::<f32>().unwrap();
    let found = mixed(logits([0., 1., 0.], [0., 3., 1.])).to_vec3::<f32>().unwrap();
    for (j, found) in found.iter().enumerate() {
        let scores: Vec<f32> = weight.iter().map(|of| (of[j][1] + of[j][4]).exp()).collect();
        let whole: f32 = scores.iter().sum();
        for (unit, found) in found[0].iter().enumerate() {
            let wanted: f32 = scores.iter().zip(&held).map(|(score, code)| score / whole * code[0][unit]).sum();
            assert!((wanted - found).abs() < 1e-5, "{j} {unit}: {found} instead of {wanted}");
        }
    }
}

const SHAPE: WindowShape = WindowShape { t_obs: 31, t_pred: 50, step: 1, rate_hz: 10. };

/// Five vehicles on three lanes in 81 frames, listed in the order `order`, which gives the ids. After
/// the last observed frame they drive as `scrambled` says.
fn traffic(order: [usize; 5], scrambled: bool) -> Recording {
    let starts: [[f32; 2]; 5] = [[0., 0.], [17., 0.3], [-11., 3.6], [6., -3.4], [13., 3.9]];
    let mut columns = Columns::default();
    let mut tracks = Vec::new();
    for (i, car) in order.into_iter().enumerate() {
        let first = columns.x.len();
        for frame in 0..81 {
            let time = (frame as f32 - 30.) * 0.1;
            let odd = if scrambled && frame > 30 { 40. * (car as f32 + 3. * time).sin() } else { 0. };
            columns.x.push(starts[car][0] + (12. + car as f32) * time + (0.7 * time + car as f32).sin() + odd);
            columns.y.push(starts[car][1] + 0.1 * time + 0.1 * odd);
            columns.vx.push(10. + odd);
            columns.vy.push(odd);
            columns.lane.push(if odd == 0. { 1 } else { 2 });
            columns.neighbours.push([u32::MAX; SLOTS]);
        }
        let mut track = Track::new(i as u32 + 1, [4.5, 1.8], 7, first..columns.x.len());
        track.class = if car == 2 { VehicleClass::Truck } else { VehicleClass::Car };
        tracks.push(track);
    }
    let meta = RecordingMeta::new(Dataset::NGSIM, "s", "a", 10.).with_simulated(true);
    let road = Road { driving_direction: 2, lines: vec![], fitted: false, axis: None };
    Recording::from_parts(meta, vec![road], tracks, columns).unwrap()
}

/// Bits of the means for the vehicles 0 and 3 of `traffic`.
fn forecast(recording: &Recording, order: [usize; 5], masked: bool) -> Vec<u32> {
    let clock = TimeGrid::new(SHAPE).unwrap();
    let targets = [0, 3].map(|car| {
        let track = order.iter().position(|listed| *listed == car).unwrap();
        Observation::new(recording, SHAPE, track, track * 81 + 30).unwrap()
    });
    let past = Inputs { clock, unit_m: 0.3048 }
        .past(&targets.map(|target| OrientedView::recorded(&target)), true, &Device::Cpu)
        .unwrap();
    assert_eq!(past.cells.len(), 4 + 2, "two are two lanes away from the second target");
    let output = net(published(), masked).0.forward(&past, Ask::Predict).unwrap();
    assert_eq!(output.gaussians.mean.dims(), [2, 1, 25, 2]);
    let means = output.gaussians.mean.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    means.into_iter().map(f32::to_bits).collect()
}

#[test]
fn another_future_or_another_order_of_the_vehicles_changes_no_bit() {
    let straight = [0, 1, 2, 3, 4];
    for masked in [false, true] {
        let known = forecast(&traffic(straight, false), straight, masked);
        assert_eq!(known, forecast(&traffic(straight, true), straight, masked));
        let turned = [4, 2, 0, 3, 1];
        assert_eq!(known, forecast(&traffic(turned, false), turned, masked));
    }
}
