//! Learning-rate schedules.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::config::within;
use crate::error::TrainError;

/// How the learning rate changes over training: a factor on the configured one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Schedule {
    /// The same all the time (the paper's, for both force networks).
    // Braces, because serde lets unknown keys of a unit variant pass.
    Constant {},
    /// Multiplied by `factor` after each of the numbers of `epochs`; the published goal network is
    /// halved after 60, 95 and 125.
    Step {
        /// What the rate is multiplied by each time.
        factor: f64,
        /// Finished epochs after which it is, growing.
        epochs: Vec<usize>,
    },
    /// From near 0 to the full rate in a straight line, then down to a share `floor` of it along
    /// half a cosine, which ends with the last epoch.
    Cosine {
        /// Length of the rise, in epochs; 0 starts at the full rate.
        warm_up: f64,
        /// Share of the full rate that is left at the end, 0 to 1.
        floor: f64,
    },
}

/// A mini-batch's place in training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// Epoch, from 0.
    pub epoch: usize,
    /// Epochs in all.
    pub epochs: usize,
    /// Mini-batch in the epoch, from 0.
    pub batch: usize,
    /// Mini-batches in an epoch.
    pub batches: usize,
}

impl Schedule {
    /// Factor on the learning rate at `at`.
    #[must_use]
    pub fn factor(&self, at: Position) -> f64 {
        match self {
            Self::Constant {} => 1.,
            Self::Step { factor, epochs } => {
                // The list is short and growing: its length cannot overflow an i32.
                factor.powi(epochs.iter().filter(|epoch| **epoch <= at.epoch).count() as i32)
            }
            Self::Cosine { warm_up, floor } => {
                let batches = at.batches.max(1) as f64;
                let begun = at.epoch as f64 + at.batch as f64 / batches;
                if begun < *warm_up {
                    // Counts the batch itself, so that the first step is not wasted on a rate of 0.
                    return ((begun + 1. / batches) / warm_up).min(1.);
                }
                let share = (begun - warm_up) / (at.epochs as f64 - warm_up);
                floor + (1. - floor) * 0.5 * (1. + (PI * share).cos())
            }
        }
    }

    /// Every number of every kind: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 4] = [
        ("schedule.factor", 1e-6, 10., "(0.5 halves the rate)"),
        ("schedule.epochs", 0., 1e6, "passes"),
        ("schedule.warm_up", 0., 1e6, "passes"),
        ("schedule.floor", 0., 1., "of the rate"),
    ];

    /// Whether it can be used over `epochs` epochs.
    ///
    /// # Errors
    /// [`TrainError::Config`] with the key and the remedy.
    pub fn check(&self, epochs: usize) -> Result<(), TrainError> {
        let refuse =
            |key, value: String, remedy: &str| Err(TrainError::Config { key, value, remedy: remedy.to_owned() });
        let [of_factor, of_epochs, of_warm_up, of_floor] = Self::RANGES;
        match self {
            Self::Constant {} => Ok(()),
            Self::Step { factor, epochs } => {
                within(&[of_factor], &[*factor])?;
                if !epochs.is_sorted_by(|a, b| a < b) {
                    return refuse("schedule.epochs", format!("{epochs:?}"), "give growing numbers of epochs");
                }
                // They grow: the last one is the largest.
                epochs.last().map_or(Ok(()), |last| within(&[of_epochs], &[*last as f64]))
            }
            Self::Cosine { warm_up, floor } => {
                within(&[of_warm_up, of_floor], &[*warm_up, *floor])?;
                if *warm_up >= epochs as f64 {
                    return refuse("schedule.warm_up", warm_up.to_string(), "give fewer passes than `epochs`");
                }
                Ok(())
            }
        }
    }

    /// Whether another number of epochs changes the factor of an epoch that both have.
    pub(crate) fn depends_on_epochs(&self) -> bool {
        matches!(self, Self::Cosine { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(epoch: usize, batch: usize) -> Position {
        Position { epoch, epochs: 10, batch, batches: 4 }
    }

    fn parse(text: &str) -> Result<Schedule, String> {
        #[derive(Deserialize)]
        struct Table {
            schedule: Schedule,
        }
        let table: Table = toml::from_str(&format!("schedule = {text}")).map_err(|e| e.to_string())?;
        table.schedule.check(10).map_err(|e| e.to_string())?;
        Ok(table.schedule)
    }

    #[test]
    fn the_published_steps_halve_after_60_95_and_125_epochs() {
        let schedule = Schedule::Step { factor: 0.5, epochs: vec![60, 95, 125] };
        let factor = |epoch| schedule.factor(Position { epoch, epochs: 150, batch: 3, batches: 7 });
        let expected = [(0, 1.), (59, 1.), (60, 0.5), (94, 0.5), (95, 0.25), (124, 0.25), (125, 0.125), (149, 0.125)];
        for (epoch, value) in expected {
            assert_eq!(factor(epoch), value, "epoch {epoch}");
        }
    }

    #[test]
    fn cosine_rises_in_a_line_then_falls_to_its_floor() {
        let schedule = Schedule::Cosine { warm_up: 2., floor: 0.2 };
        // Eight batches of rise: 1/8 in the first one, 1 in the last one.
        assert_eq!(schedule.factor(at(0, 0)), 0.125);
        assert_eq!(schedule.factor(at(1, 3)), 1.);
        assert_eq!(schedule.factor(at(2, 0)), 1.);
        // Half of the way from 2 to 10 epochs.
        assert!((schedule.factor(at(6, 0)) - 0.6).abs() < 1e-12);
        // One batch before the end.
        let expected = 0.2 + 0.8 * 0.5 * (1. + (PI * 31. / 32.).cos());
        assert!((schedule.factor(at(9, 3)) - expected).abs() < 1e-12);
    }

    #[test]
    fn constant_is_one_everywhere() {
        assert_eq!(Schedule::Constant {}.factor(at(9, 3)), 1.);
    }

    #[test]
    fn schedules_are_read_and_bad_ones_refused_by_key() {
        assert_eq!(parse("{ kind = 'constant' }"), Ok(Schedule::Constant {}));
        assert_eq!(
            parse("{ kind = 'step', factor = 0.5, epochs = [3, 4] }"),
            Ok(Schedule::Step { factor: 0.5, epochs: vec![3, 4] })
        );
        assert_eq!(
            parse("{ kind = 'cosine', warm_up = 1, floor = 0.1 }"),
            Ok(Schedule::Cosine { warm_up: 1., floor: 0.1 })
        );
        let bad = [
            ("{ kind = 'constant', factor = 0.5 }", "factor"),
            ("{ kind = 'linear' }", "linear"),
            ("{ kind = 'step', factor = -1.0, epochs = [3] }", "schedule.factor"),
            ("{ kind = 'step', factor = 0.5, epochs = [4, 3] }", "schedule.epochs"),
            ("{ kind = 'cosine', warm_up = 10, floor = 0.1 }", "schedule.warm_up"),
            ("{ kind = 'cosine', warm_up = 1, floor = 1.5 }", "schedule.floor"),
        ];
        for (text, key) in bad {
            let message = parse(text).expect_err(text);
            assert!(message.contains(key), "{text}: {message}");
        }
    }
}
