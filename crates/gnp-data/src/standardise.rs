//! Features moved and scaled to mean 0 and standard deviation 1.

use serde::{Deserialize, Serialize};

use crate::error::DataError;

/// A standard deviation below this share of the mean's size is rounding in f32, not variation.
const CONSTANT: f64 = 2. * f32::EPSILON as f64;

/// Mean and standard deviation of each feature, fitted to the training part alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Standardiser {
    /// Mean of each feature, in the feature's unit.
    pub mean: Vec<f32>,
    /// Standard deviation of each feature (of the population), in the feature's unit; 1 for a
    /// feature that does not vary.
    pub std: Vec<f32>,
}

impl Standardiser {
    /// Fits to rows of features in one pass, in the order given (Welford's method, in f64).
    ///
    /// # Errors
    /// [`DataError::Features`] when there is no row, rows differ in length, or a value is not finite.
    pub fn fit<R: AsRef<[f32]>>(rows: impl IntoIterator<Item = R>) -> Result<Self, DataError> {
        let mut mean: Vec<f64> = Vec::new();
        let mut squares: Vec<f64> = Vec::new();
        let mut count = 0u64;
        for row in rows {
            let row = row.as_ref();
            if count == 0 {
                mean = vec![0.; row.len()];
                squares = vec![0.; row.len()];
            }
            if row.len() != mean.len() {
                let reason = format!("row {count} has {} features, those before it {}", row.len(), mean.len());
                return Err(DataError::Features { reason });
            }
            if let Some(feature) = row.iter().position(|value| !value.is_finite()) {
                let reason = format!("row {count}, feature {feature} is {}; it must be finite", row[feature]);
                return Err(DataError::Features { reason });
            }
            count += 1;
            for ((mean, squares), value) in mean.iter_mut().zip(&mut squares).zip(row) {
                let value = f64::from(*value);
                let before = value - *mean;
                *mean += before / count as f64;
                *squares += before * (value - *mean);
            }
        }
        if mean.is_empty() {
            return Err(DataError::Features { reason: "there is no row to fit to; the training part is empty".into() });
        }
        let std = mean.iter().zip(&squares).map(|(mean, squares)| {
            let std = (squares / count as f64).sqrt();
            if std <= CONSTANT * mean.abs() || std == 0. { 1. } else { std as f32 }
        });
        Ok(Self { std: std.collect(), mean: mean.into_iter().map(|mean| mean as f32).collect() })
    }

    /// Checks means and deviations that come from a file.
    ///
    /// # Errors
    /// [`DataError::Features`] when their numbers differ, one is not finite or a deviation is not positive.
    pub fn check(&self) -> Result<(), DataError> {
        let fail = |reason| Err(DataError::Features { reason });
        if self.mean.len() != self.std.len() {
            return fail(format!("{} means and {} standard deviations", self.mean.len(), self.std.len()));
        }
        let wrong = |(mean, std): (&f32, &f32)| !(mean.is_finite() && std.is_finite() && *std > 0.);
        match self.mean.iter().zip(&self.std).position(wrong) {
            Some(i) => fail(format!("feature {i} has mean {} and standard deviation {}", self.mean[i], self.std[i])),
            None => Ok(()),
        }
    }

    /// Number of features.
    #[must_use]
    pub fn features(&self) -> usize {
        self.mean.len()
    }

    /// Standardises one or several rows that lie end to end, in place.
    ///
    /// # Errors
    /// [`DataError::Features`] when the values are not whole rows.
    pub fn apply(&self, rows: &mut [f32]) -> Result<(), DataError> {
        self.each(rows, |value, mean, std| (value - mean) / std)
    }

    /// Undoes [`Standardiser::apply`], but for rounding.
    ///
    /// # Errors
    /// As [`Standardiser::apply`].
    pub fn undo(&self, rows: &mut [f32]) -> Result<(), DataError> {
        self.each(rows, |value, mean, std| value * std + mean)
    }

    fn each(&self, rows: &mut [f32], map: impl Fn(f32, f32, f32) -> f32) -> Result<(), DataError> {
        let features = self.features();
        if features == 0 || self.std.len() != features || !rows.len().is_multiple_of(features) {
            let reason = format!("{} values are not rows of {features} features", rows.len());
            return Err(DataError::Features { reason });
        }
        for row in rows.chunks_exact_mut(features) {
            for ((value, mean), std) in row.iter_mut().zip(&self.mean).zip(&self.std) {
                *value = map(*value, *mean, *std);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_mean_and_deviation() {
        let fitted = Standardiser::fit([[1f32, 10., 7.], [3., 10., 7.1], [5., 10., 7.3]]).unwrap();
        assert_eq!(fitted.mean[..2], [3., 10.]);
        assert!((fitted.std[0] - (8f32 / 3.).sqrt()).abs() < 1e-6);
        assert_eq!(fitted.std[1], 1., "a constant feature is not divided by 0");
    }

    #[test]
    fn what_no_fit_gives_is_refused() {
        let of = |mean: &[f32], std: &[f32]| Standardiser { mean: mean.to_vec(), std: std.to_vec() }.check();
        assert!(of(&[0., 1e3], &[1., 0.1]).is_ok());
        for (mean, std) in [(0., 0.), (0., -1.), (0., f32::INFINITY), (f32::NAN, 1.)] {
            assert!(of(&[mean], &[std]).unwrap_err().to_string().contains("feature 0"), "{mean} {std}");
        }
        assert!(of(&[0.], &[1., 1.]).is_err());
    }

    #[test]
    fn applied_rows_have_mean_0_and_deviation_1_and_come_back() {
        let rows: Vec<[f32; 2]> = (0..97u16).map(|i| [f32::from(i) * 3. + 1e4, f32::from(i % 7) - 2.]).collect();
        let fitted = Standardiser::fit(&rows).unwrap();
        let original = rows.as_flattened().to_vec();
        let mut values = original.clone();
        fitted.apply(&mut values).unwrap();
        for feature in 0..2 {
            let column: Vec<f32> = values.iter().skip(feature).step_by(2).copied().collect();
            let mean = column.iter().sum::<f32>() / 97.;
            let variance = column.iter().map(|v| v * v).sum::<f32>() / 97.;
            assert!(mean.abs() < 1e-4 && (variance - 1.).abs() < 1e-3, "{mean} {variance}");
        }
        fitted.undo(&mut values).unwrap();
        assert!(values.iter().zip(&original).all(|(a, b)| (a - b).abs() < 2e-3));
    }

    #[test]
    fn a_large_offset_does_not_drown_the_deviation() {
        // A sum of squares in f32 loses it all.
        let fitted = Standardiser::fit([[1e6f32 - 1.], [1e6], [1e6 + 1.]]).unwrap();
        assert!((fitted.std[0] - (2f32 / 3.).sqrt()).abs() < 1e-5);
    }

    #[test]
    fn says_what_is_wrong() {
        let none: [[f32; 2]; 0] = [];
        assert!(Standardiser::fit(none).unwrap_err().to_string().contains("training part is empty"));
        let ragged: [&[f32]; 2] = [&[1., 2.], &[3.]];
        assert!(Standardiser::fit(ragged).unwrap_err().to_string().contains("row 1 has 1 features"));
        let nan = Standardiser::fit([[0f32, 1.], [0., f32::NAN]]).unwrap_err().to_string();
        assert!(nan.contains("row 1, feature 1"), "{nan}");
        let fitted = Standardiser::fit([[0f32, 1.]]).unwrap();
        assert!(fitted.apply(&mut [1., 2., 3.]).is_err());
    }
}
