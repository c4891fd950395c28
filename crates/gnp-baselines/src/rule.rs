//! What the registry holds: a predictor without a network, by name.

use gnp_data::{Predictor, Window};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::motion::BaselineError;

/// Parameters of a rule, as they are kept in files; `null` where it has none.
pub type Parameters = serde_json::Value;

/// Fits parameters to windows.
type Fit = fn(&[Window<'_>]) -> Result<Parameters, BaselineError>;

/// Makes a predictor of parameters.
type Load = fn(&Parameters) -> Result<Box<dyn Predictor>, BaselineError>;

/// A predictor without a network under the one name it has in tables and files: how its parameters
/// are found in training windows, and how it is made of them.
///
/// [`RULES`](crate::RULES) lists those of this crate. Another one is made in the same way, in any
/// crate, and works wherever a rule is taken:
///
/// ```
/// use gnp_baselines::{ConstantVelocity, Parameters, Rule};
///
/// const LAST_STEP: Rule = Rule::new(
///     "last step",
///     "The speed between the last two frames, kept.",
///     |_training| Ok(Parameters::Null),
///     |_parameters| Ok(Box::new(ConstantVelocity::new(0.1)?)),
/// );
/// let predictor = LAST_STEP.load(&LAST_STEP.fit(&[])?)?;
/// # assert_eq!(predictor.name(), "constant velocity");
/// # Ok::<(), gnp_baselines::BaselineError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Rule {
    name: &'static str,
    description: &'static str,
    fit: Fit,
    load: Load,
}

impl Rule {
    /// A rule; see the getters for what each argument is.
    #[must_use]
    pub const fn new(name: &'static str, description: &'static str, fit: Fit, load: Load) -> Self {
        Self { name, description, fit, load }
    }

    /// Name in tables and files, such as `constant velocity`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// What it assumes, in a sentence.
    #[must_use]
    pub fn description(&self) -> &'static str {
        self.description
    }

    /// The parameters for `training`, windows of the training part; a rule that has nothing to fit
    /// does not look at them. The same windows give the same parameters.
    ///
    /// # Errors
    /// When the windows do not suffice, as the rule says.
    pub fn fit(&self, training: &[Window<'_>]) -> Result<Parameters, BaselineError> {
        (self.fit)(training)
    }

    /// The predictor with the parameters that [`Rule::fit`] gave.
    ///
    /// # Errors
    /// When they are not parameters of this rule, or out of range.
    pub fn load(&self, parameters: &Parameters) -> Result<Box<dyn Predictor>, BaselineError> {
        (self.load)(parameters)
    }
}

/// `of` as parameters of `rule`.
pub(crate) fn parameters(rule: &str, of: &impl Serialize) -> Result<Parameters, BaselineError> {
    serde_json::to_value(of).map_err(|source| failed(rule, source))
}

/// What `parameters` of `rule` say.
pub(crate) fn parsed<T: DeserializeOwned>(rule: &str, parameters: &Parameters) -> Result<T, BaselineError> {
    T::deserialize(parameters).map_err(|source| failed(rule, source))
}

fn failed(rule: &str, source: serde_json::Error) -> BaselineError {
    BaselineError::Rule { rule: rule.to_owned(), source: source.into() }
}
