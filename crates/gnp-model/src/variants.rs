//! The same model with less than it has, or with more than may be known: what is scored beside it.

use gnp_data::{Forecast, Observation, OraclePredictor, PredictError, Predictor, Window};

use crate::gnp::{Gnp, finite, plain, predict_error};

/// The goal network's own futures, without physics: what the force adds is seen beside it.
#[derive(Clone, Debug)]
pub struct GoalHead {
    pub(crate) gnp: Gnp,
}

impl Predictor for GoalHead {
    fn name(&self) -> &str {
        "goal head"
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        if observations.is_empty() {
            return Ok(Vec::new());
        }
        let goals = || {
            let situations = self.gnp.situations(observations)?;
            self.gnp.trained.thread.run(|| self.gnp.goals(&situations, k))
        };
        self.gnp.on_threads(goals).map(plain).and_then(finite).map_err(|e| predict_error(self.name(), e))
    }
}

/// GNP with the recorded future of its neighbours.
#[derive(Clone, Debug)]
pub struct Oracle {
    pub(crate) gnp: Gnp,
}

impl OraclePredictor for Oracle {
    fn name(&self) -> &str {
        "gnp (oracle neighbours)"
    }

    fn predict_with_future(&self, windows: &[Window<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let observations: Vec<_> = windows.iter().map(Window::observation).collect();
        let truths: Vec<_> = windows.iter().map(Window::truth).collect();
        self.gnp.forecast(&observations, Some(&truths), k).map_err(|e| predict_error(self.name(), e))
    }
}

/// GNP with the recorded end of its target as its one goal.
#[derive(Clone, Debug)]
pub struct TrueGoal {
    pub(crate) gnp: Gnp,
}

impl OraclePredictor for TrueGoal {
    fn name(&self) -> &str {
        "gnp (true goal)"
    }

    fn predict_with_future(&self, windows: &[Window<'_>], _: usize) -> Result<Vec<Forecast>, PredictError> {
        let observations: Vec<_> = windows.iter().map(Window::observation).collect();
        let goals: Vec<_> = windows.iter().map(|window| vec![window.truth().goal()]).collect();
        self.gnp.predict_towards(&observations, &goals)
    }
}
