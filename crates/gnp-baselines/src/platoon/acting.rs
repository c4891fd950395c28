//! The terms of the platoon by name, and which of them act on the target.

use std::sync::{Arc, OnceLock};

use gnp_force::{Arity, CarFollowing, ForceTerm, FreeRoad, TermDescriptor};

use super::PlatoonRule;

/// Which of [`PlatoonRule::terms`] act on the target of a roll-out; on all other vehicles all of them do.
///
/// Without `car_following` the target drives as if nobody were ahead, so that the free road, which acts behind a leader
/// alone, is silent as well; without `free_road` it only ever brakes for a leader; without `habit` nothing of its present
/// acceleration goes on. Without any it keeps its speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActingTerms([bool; 3]);

impl Default for ActingTerms {
    fn default() -> Self {
        Self::ALL
    }
}

impl ActingTerms {
    /// All of them.
    pub const ALL: Self = Self([true; 3]);

    /// The same without the term of that name; `None` where the platoon has none of that name.
    #[must_use]
    pub fn without(mut self, name: &str) -> Option<Self> {
        let place = PlatoonRule::terms().iter().position(|term| term.name == name)?;
        self.0[place] = false;
        Some(self)
    }

    /// Whether free road, car following and habit act, in the order of [`PlatoonRule::terms`].
    #[must_use]
    pub fn flags(self) -> [bool; 3] {
        self.0
    }
}

impl PlatoonRule {
    /// The terms of [`Motion::acceleration`](super::Motion::acceleration), in its order.
    #[must_use]
    pub fn terms() -> [Arc<TermDescriptor>; 3] {
        static TERMS: OnceLock<[Arc<TermDescriptor>; 3]> = OnceLock::new();
        let terms = TERMS.get_or_init(|| {
            let (free, following): (&dyn ForceTerm<f64>, &dyn ForceTerm<f64>) = (&FreeRoad, &CarFollowing);
            let habit = TermDescriptor::new("habit", Arity::One, "#8c6d31")
                .means("habit", "what the driver does now beyond car following, dying away");
            [free.descriptor().clone(), following.descriptor().clone(), habit].map(Arc::new)
        });
        terms.clone()
    }
}
