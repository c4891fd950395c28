//! How far paths are from each other.

/// Index of the centre `[k, dims]` nearest to `sample` and the squared distance to it.
pub(crate) fn nearest(sample: &[f32], centres: &[f32]) -> (usize, f32) {
    centres
        .chunks_exact(sample.len())
        .map(|centre| squared_distance(sample, centre))
        .enumerate()
        .fold((0, f32::INFINITY), |best, (i, distance)| if distance < best.1 { (i, distance) } else { best })
}

/// Squared Euclidean distance of two paths, m², summed in a fixed order that vectorises.
pub(crate) fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    let (a_whole, b_whole) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest = a_whole.remainder().iter().zip(b_whole.remainder()).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
    let mut sums = [0f32; LANES];
    for (a, b) in a_whole.zip(b_whole) {
        for i in 0..LANES {
            let d = a[i] - b[i];
            sums[i] += d * d;
        }
    }
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_the_definition() {
        let a: Vec<f32> = (0..37).map(|i| i as f32 * 0.5).collect();
        let b: Vec<f32> = (0..37).map(|i| (i % 5) as f32).collect();
        let plain: f32 = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum();
        assert!((squared_distance(&a, &b) - plain).abs() < 1e-5 * plain);
    }
}
