//! Which learned baseline.

use serde::{Deserialize, Serialize};

use crate::recipe::OutputForm;

/// A learned baseline. What it is called in tables says what it knew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NeuralBaseline {
    /// LSTMs with fully connected social pooling.
    SLstm,
    /// LSTMs with convolutional social pooling.
    CsLstm,
    /// The same with six manoeuvres.
    CsLstmM,
    /// PiP that is given the recorded future of a neighbour, the ego.
    PipInformed,
    /// PiP trained and used without any plan.
    PipNoPlan,
    /// The network of [`NeuralBaseline::PipInformed`] with a plan of constant velocity.
    PipSurrogate,
    /// Spatio-temporal dynamic attention.
    Stdan,
    /// The same with empty cells masked.
    StdanMasked,
}

impl NeuralBaseline {
    /// All of them, in the order of a table.
    pub const ALL: [Self; 8] = [
        Self::SLstm,
        Self::CsLstm,
        Self::CsLstmM,
        Self::PipNoPlan,
        Self::PipSurrogate,
        Self::PipInformed,
        Self::Stdan,
        Self::StdanMasked,
    ];

    /// Name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SLstm => "S-LSTM",
            Self::CsLstm => "CS-LSTM",
            Self::CsLstmM => "CS-LSTM(M)",
            Self::PipInformed => "PiP (ego future known)",
            Self::PipNoPlan => "PiP-noPlan",
            Self::PipSurrogate => "PiP (surrogate plan)",
            Self::Stdan => "STDAN",
            Self::StdanMasked => "STDAN-masked",
        }
    }

    /// Name in tables in a form of output.
    #[must_use]
    pub fn name_in(self, form: OutputForm) -> &'static str {
        match (form, self) {
            (OutputForm::Published, _) => self.name(),
            (OutputForm::Deviation, Self::SLstm) => "S-LSTM + platoon",
            (OutputForm::Deviation, Self::CsLstm) => "CS-LSTM + platoon",
            (OutputForm::Deviation, Self::CsLstmM) => "CS-LSTM(M) + platoon",
            (OutputForm::Deviation, Self::PipInformed) => "PiP (ego future known) + platoon",
            (OutputForm::Deviation, Self::PipNoPlan) => "PiP-noPlan + platoon",
            (OutputForm::Deviation, Self::PipSurrogate) => "PiP (surrogate plan) + platoon",
            (OutputForm::Deviation, Self::Stdan) => "STDAN + platoon",
            (OutputForm::Deviation, Self::StdanMasked) => "STDAN-masked + platoon",
        }
    }

    /// Stem of its files in a form of output; two that share a network share it.
    #[must_use]
    pub fn stem_in(self, form: OutputForm) -> &'static str {
        match (form, self) {
            (OutputForm::Published, _) => self.stem(),
            (OutputForm::Deviation, Self::SLstm) => "s_lstm_deviation",
            (OutputForm::Deviation, Self::CsLstm) => "cs_lstm_deviation",
            (OutputForm::Deviation, Self::CsLstmM) => "cs_lstm_m_deviation",
            (OutputForm::Deviation, Self::PipInformed | Self::PipSurrogate) => "pip_deviation",
            (OutputForm::Deviation, Self::PipNoPlan) => "pip_no_plan_deviation",
            (OutputForm::Deviation, Self::Stdan) => "stdan_deviation",
            (OutputForm::Deviation, Self::StdanMasked) => "stdan_masked_deviation",
        }
    }

    /// Its table in a file of recipes; two that share a network share it.
    #[must_use]
    pub fn stem(self) -> &'static str {
        match self {
            Self::SLstm => "s_lstm",
            Self::CsLstm => "cs_lstm",
            Self::CsLstmM => "cs_lstm_m",
            Self::PipInformed | Self::PipSurrogate => "pip",
            Self::PipNoPlan => "pip_no_plan",
            Self::Stdan => "stdan",
            Self::StdanMasked => "stdan_masked",
        }
    }

    /// The kind whose training gives its network.
    #[must_use]
    pub fn trained_as(self) -> Self {
        if self == Self::PipSurrogate { Self::PipInformed } else { self }
    }

    /// Whether it is handed recorded futures: every number made with it must be marked.
    #[must_use]
    pub fn uses_future(self) -> bool {
        self == Self::PipInformed
    }
}
