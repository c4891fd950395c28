//! Forecasts in flat arrays that keep their memory.

use std::sync::Arc;

use gnp_data::Forecast;
use gnp_force::TermDescriptor;

/// The forecasts of one call of [`Gnp::predict_into`](crate::Gnp::predict_into), in flat arrays whose memory the next
/// call uses again. Lengths in m, in the frame of each window; all windows have equally many modes, in the order of
/// [`Forecast::modes`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forecasts {
    pub(crate) windows: usize,
    pub(crate) modes: usize,
    pub(crate) steps: usize,
    /// `[windows, modes]`
    pub(crate) probabilities: Vec<f32>,
    /// `[windows, modes, steps]`
    pub(crate) paths: Vec<[f32; 2]>,
    /// `[windows, modes]`; empty without explanations.
    pub(crate) goals: Vec<[f32; 2]>,
    /// `[windows]`; empty without explanations.
    pub(crate) velocities: Vec<[f32; 2]>,
    /// None without explanations.
    pub(crate) terms: Vec<TermTotals>,
}

/// One term of the force, of all its sources together, in all steps of all forecasts of a call.
#[derive(Clone, Debug, PartialEq)]
pub struct TermTotals {
    /// What the term is called, and how it is drawn.
    pub term: Arc<TermDescriptor>,
    /// Acceleration in m/s² in each step, `[windows, modes, steps]`.
    pub totals: Vec<[f32; 2]>,
}

impl Forecasts {
    /// Number of windows.
    #[must_use]
    pub fn windows(&self) -> usize {
        self.windows
    }

    /// Modes of each window: as many as were asked for, or as the model has.
    #[must_use]
    pub fn modes(&self) -> usize {
        self.modes
    }

    /// Predicted frames.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Probability of every mode, 0 to 1, `[windows, modes]`; those of a window sum to 1.
    #[must_use]
    pub fn probabilities(&self) -> &[f32] {
        &self.probabilities
    }

    /// Centre in each predicted frame, m, window frame, `[windows, modes, steps]`.
    #[must_use]
    pub fn paths(&self) -> &[[f32; 2]] {
        &self.paths
    }

    /// The path of a mode of a window, `[steps]`; empty where there is no such window or mode.
    #[must_use]
    pub fn path(&self, window: usize, mode: usize) -> &[[f32; 2]] {
        self.row(&self.paths, window, mode)
    }

    /// Where each mode is drawn to, m, window frame, `[windows, modes]`; empty unless the model is
    /// [explaining](crate::Gnp::explaining).
    #[must_use]
    pub fn goals(&self) -> &[[f32; 2]] {
        &self.goals
    }

    /// The present velocity of each window's vehicle as the model takes it, m/s, of which the causes of a path are counted,
    /// `[windows]`; empty unless the model is [explaining](crate::Gnp::explaining).
    #[must_use]
    pub fn velocities(&self) -> &[[f32; 2]] {
        &self.velocities
    }

    /// The terms of the force that act, those of the platoon's path among them; none unless the model is
    /// [explaining](crate::Gnp::explaining). They add up to the acceleration of each step.
    #[must_use]
    pub fn terms(&self) -> &[TermTotals] {
        &self.terms
    }

    /// The force of a term, one of [`Forecasts::terms`], along the path of a mode of a window, m/s², `[steps]`; empty where
    /// there is no such term, window or mode.
    #[must_use]
    pub fn force(&self, term: usize, window: usize, mode: usize) -> &[[f32; 2]] {
        self.terms.get(term).map_or(&[], |term| self.row(&term.totals, window, mode))
    }

    fn row<'a>(&self, values: &'a [[f32; 2]], window: usize, mode: usize) -> &'a [[f32; 2]] {
        let first = (window * self.modes + mode) * self.steps;
        if mode < self.modes { values.get(first..first + self.steps).unwrap_or_default() } else { &[] }
    }

    /// Makes room for so many windows, modes and steps.
    pub(crate) fn reset(&mut self, [windows, modes, steps]: [usize; 3], explain: bool) {
        (self.windows, self.modes, self.steps) = (windows, modes, steps);
        self.probabilities.resize(windows * modes, 0.);
        self.paths.resize(windows * modes * steps, [0.; 2]);
        self.goals.resize(if explain { windows * modes } else { 0 }, [0.; 2]);
        self.velocities.resize(if explain { windows } else { 0 }, [0.; 2]);
        if explain {
            let totals = windows * modes * steps;
            self.terms.iter_mut().for_each(|term| term.totals.resize(totals, [0.; 2]));
        } else {
            self.terms.clear();
        }
    }

    /// The totals of term number `i`, which is this one; those before it are there.
    pub(crate) fn totals_of(&mut self, i: usize, term: &Arc<TermDescriptor>) -> &mut [[f32; 2]] {
        let size = self.windows * self.modes * self.steps;
        match self.terms.get_mut(i) {
            Some(known) if !Arc::ptr_eq(&known.term, term) => known.term = Arc::clone(term),
            Some(_) => {}
            None => self.terms.push(TermTotals { term: Arc::clone(term), totals: vec![[0.; 2]; size] }),
        }
        &mut self.terms[i].totals
    }

    /// Takes over what [`Predictor::predict`](gnp_data::Predictor::predict) gave.
    pub(crate) fn copy_from(&mut self, forecasts: &[Forecast]) {
        let modes = || forecasts.iter().flat_map(|forecast| &forecast.modes);
        self.windows = forecasts.len();
        self.modes = forecasts.first().map_or(0, |forecast| forecast.modes.len());
        self.steps = modes().next().map_or(0, |mode| mode.path.len());
        self.probabilities.clear();
        self.probabilities.extend(modes().map(|mode| mode.probability));
        self.paths.clear();
        self.paths.extend(modes().flat_map(|mode| &mode.path));
        let explanations = || modes().filter_map(|mode| mode.explanation.as_ref());
        self.goals.clear();
        self.goals.extend(explanations().map(|explanation| explanation.goal));
        self.velocities.clear();
        let firsts = forecasts.iter().filter_map(|forecast| forecast.modes.first()?.explanation.as_ref());
        self.velocities.extend(firsts.map(|explanation| explanation.velocity));
        // The same terms act on every path.
        self.terms.clear();
        let terms = explanations().next().map_or(&[][..], |explanation| &explanation.terms);
        self.terms.extend(terms.iter().enumerate().map(|(i, term)| TermTotals {
            term: Arc::new(term.term().clone()),
            totals: explanations().filter_map(|it| it.terms.get(i)).flat_map(|it| it.totals()).copied().collect(),
        }));
    }
}
