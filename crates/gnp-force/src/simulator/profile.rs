//! Velocities over time that a vehicle is given.
use crate::{
    error::{ForceError, require},
    scalar::lit,
};
use nalgebra::{RealField, Vector2};

/// Velocities at given times, linear between them and constant before and after; see
/// [`Drive::Follow`](crate::Drive::Follow).
///
/// Positions are the integral, so that a vehicle is exactly where the profile leads, whatever the step.
///
/// ```
/// use gnp_force::Profile;
/// // Brakes from 30 m/s to 10 m/s between 5 s and 10 s.
/// let profile = Profile::speeds(&[(5.0, 30.0), (10.0, 10.0)])?;
/// assert_eq!(profile.velocity_at(7.5).x, 20.0);
/// assert_eq!(profile.velocity_at(99.0).x, 10.0);
/// assert_eq!(profile.way(0.0, 10.0).x, 250.0);
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Vec<(T, Vector2<T>)>", into = "Vec<(T, Vector2<T>)>"))]
#[cfg_attr(
    feature = "serde",
    serde(bound(
        serialize = "T: RealField + Copy + serde::Serialize",
        deserialize = "T: RealField + Copy + serde::Deserialize<'de>"
    ))
)]
pub struct Profile<T: RealField> {
    knots: Vec<(T, Vector2<T>)>,
}

impl<T: RealField + Copy> Profile<T> {
    /// Pairs of time in s of the simulator's clock and velocity in m/s, in the order of time.
    ///
    /// # Errors
    /// Without a pair, when a number is not finite, or a time is not later than the one before.
    pub fn new(knots: Vec<(T, Vector2<T>)>) -> Result<Self, ForceError> {
        require(!knots.is_empty(), "profile", T::zero(), "one pair of time and velocity or more")?;
        for (time, velocity) in &knots {
            require(time.is_finite(), "profile.time", *time, "finite")?;
            require(velocity.norm().is_finite(), "profile.velocity", velocity.norm(), "finite in both numbers")?;
        }
        for pair in knots.windows(2) {
            require(pair[0].0 < pair[1].0, "profile.time", pair[1].0, "later than the time before")?;
        }
        Ok(Self { knots })
    }

    /// Speeds along the road, none across: pairs of time in s and speed in m/s.
    ///
    /// # Errors
    /// As [`Profile::new`].
    pub fn speeds(knots: &[(T, T)]) -> Result<Self, ForceError> {
        Self::new(knots.iter().map(|(time, speed)| (*time, Vector2::new(*speed, T::zero()))).collect())
    }

    /// The velocity at `time` s, in m/s.
    #[must_use]
    pub fn velocity_at(&self, time: T) -> Vector2<T> {
        let later = self.knots.partition_point(|(at, _)| *at <= time);
        match (later.checked_sub(1).and_then(|i| self.knots.get(i)), self.knots.get(later)) {
            (Some((t0, v0)), Some((t1, v1))) => v0 + (v1 - v0) * ((time - *t0) / (*t1 - *t0)),
            (Some((_, velocity)), None) | (None, Some((_, velocity))) => *velocity,
            (None, None) => Vector2::zeros(),
        }
    }

    /// The way from one time to a later one, in m: the integral of the velocity.
    #[must_use]
    pub fn way(&self, from: T, to: T) -> Vector2<T> {
        let first = self.knots.partition_point(|(time, _)| *time <= from);
        let between = self.knots[first..].iter().map(|(time, _)| *time).take_while(|time| *time < to);
        let (mut start, mut way) = (from, Vector2::zeros());
        for end in between.chain([to]) {
            way += (self.velocity_at(start) + self.velocity_at(end)) * ((end - start) * lit(0.5));
            start = end;
        }
        way
    }

    /// The greatest speed of the profile, in m/s.
    #[must_use]
    pub fn fastest(&self) -> T {
        self.knots.iter().fold(T::zero(), |fastest, (_, velocity)| fastest.max(velocity.norm()))
    }
}

impl<T: RealField + Copy> TryFrom<Vec<(T, Vector2<T>)>> for Profile<T> {
    type Error = ForceError;

    fn try_from(knots: Vec<(T, Vector2<T>)>) -> Result<Self, ForceError> {
        Self::new(knots)
    }
}

impl<T: RealField> From<Profile<T>> for Vec<(T, Vector2<T>)> {
    fn from(profile: Profile<T>) -> Self {
        profile.knots
    }
}
