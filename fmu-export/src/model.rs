//! What a user writes: a model as a table of variables, a start, and a step.

use std::borrow::Cow;
use std::fmt;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::clock::Clock;
use crate::input::{HIGHEST_ORDER, InputTrajectory};
use crate::log::Log;
use crate::variable::Row;

/// What the model description says of a model as a whole. An empty text is left out.
///
/// ```
/// # use fmu_export::Info;
/// const INFO: Info = Info { stop_s: 20.0, ..Info::new("VanDerPol", "Oscillator with nonlinear damping") };
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Info {
    /// Name of the model, which is also that of its FMU: letters, digits, and underscores.
    pub name: &'static str,
    /// What it models, in a sentence without a full stop.
    pub description: &'static str,
    /// Version of the model.
    pub version: &'static str,
    /// Name and organisation of the author.
    pub author: &'static str,
    /// Licence under which the model may be used.
    pub license: &'static str,
    /// Name and version of the tool that wrote the model description.
    pub tool: &'static str,
    /// Length of a run that shows what the model is about, in seconds.
    pub stop_s: f64,
    /// Communication step of such a run, in seconds.
    pub step_s: f64,
    /// Relative tolerance of such a run, which the accuracy of the model should keep: what an importer asks for has no effect.
    pub tolerance: f64,
}

impl Info {
    /// A name and a description; a run of 1 s in steps of 1 ms, tolerance 1e-4; no version, author or licence.
    pub const fn new(name: &'static str, description: &'static str) -> Self {
        let tool = concat!("fmu-export ", env!("CARGO_PKG_VERSION"));
        let [version, author, license] = [""; 3];
        Self { name, description, version, author, license, tool, stop_s: 1.0, step_s: 1e-3, tolerance: 1e-4 }
    }
}

/// What a model can do beyond stepping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Directional derivatives of outputs and of derivatives of states.
    pub directional_derivatives: bool,
    /// The highest order of derivatives of outputs with respect to time; 0 if there are none.
    pub output_derivative_order: usize,
}

impl Capabilities {
    /// Nothing beyond stepping.
    pub const NONE: Self = Self { directional_derivatives: false, output_derivative_order: 0 };
}

/// One parameter that cannot be accepted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Invalid {
    /// Name of the variable, for instance `coil.R` or `alpha[2]`.
    pub name: Cow<'static, str>,
    /// The value refused, as text, with its unit where it has one.
    pub value: String,
    /// What would have been accepted, with the reason where it is not obvious.
    pub wanted: Cow<'static, str>,
}

impl Invalid {
    /// A value that is refused, and what is wanted instead.
    pub fn new(
        name: impl Into<Cow<'static, str>>,
        value: impl fmt::Display,
        wanted: impl Into<Cow<'static, str>>,
    ) -> Self {
        Self { name: name.into(), value: value.to_string(), wanted: wanted.into() }
    }

    /// All findings in one line.
    pub fn list(findings: &[Self]) -> String {
        findings.iter().map(Self::to_string).collect::<Vec<_>>().join("; ")
    }
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {} is refused: {} is wanted", self.name, self.value, self.wanted)
    }
}

/// A step that could not be completed, in words for the user.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct StepError(pub String);

impl StepError {
    /// The step error that any error describes.
    pub fn of(error: impl fmt::Display) -> Self {
        Self(error.to_string())
    }
}

/// How a step or a sample ends.
pub type Stepped = Result<(), StepError>;

/// A communication step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Where it begins, in seconds.
    pub time_s: f64,
    /// How long it is, in seconds.
    pub length_s: f64,
}

impl Step {
    /// Where it ends, in seconds.
    pub fn end_s(&self) -> f64 {
        self.time_s + self.length_s
    }
}

/// A model, which steps as it likes. For one that acts at sample instants see [`SampledModel`].
///
/// A value of this type is what follows from the parameters and stays as it is during a run: checked parameters,
/// coefficients, tables. All snapshots of a run share it. What changes during a run stands in `Values`, where variables
/// find it, and in `State`, which nobody sees from outside; `()` if there is no such state.
pub trait Model: Clone + Send + Sync + 'static {
    /// Name and description.
    const INFO: Info;

    /// What it can do beyond stepping.
    const CAPABILITIES: Capabilities = Capabilities::NONE;

    /// The values of all variables.
    type Values: Clone + Default + Serialize + DeserializeOwned + Send + Sync + 'static;

    /// What changes during a run beside the values.
    type State: Clone + Serialize + DeserializeOwned + Send + Sync + 'static;

    /// The table of variables.
    fn table() -> Vec<Row<Self::Values>>;

    /// Checks the parameters among the values and makes of them what a run needs.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted.
    fn new(values: &Self::Values) -> Result<Self, Vec<Invalid>>;

    /// Begins a run at a time, in seconds, and fills in the outputs.
    fn start(&self, values: &mut Self::Values, start_s: f64) -> Self::State;

    /// Does one communication step and fills in the outputs at its end. The inputs among the values are those at its
    /// beginning; `inputs` tells what becomes of them, and the values may be left with the inputs of any instant.
    ///
    /// # Errors
    /// Why the run cannot go on. What was computed before stays readable.
    fn step(
        &self,
        state: &mut Self::State,
        values: &mut Self::Values,
        step: Step,
        inputs: &InputTrajectory<'_, Self::Values>,
        log: &mut dyn Log,
    ) -> Stepped;

    /// The shortest step taken inside, in seconds. A communication step of more than [`MAX_BASE_STEPS`] of them is refused,
    /// because nobody could tell it from a model that hangs.
    ///
    /// [`MAX_BASE_STEPS`]: crate::instance::MAX_BASE_STEPS
    fn base_step_s(&self) -> f64 {
        f64::INFINITY
    }

    /// Takes over tunable parameters that were changed.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted; the run goes on with the former ones.
    fn retune(&mut self, state: &mut Self::State, values: &Self::Values) -> Result<(), Vec<Invalid>> {
        let _ = (state, values);
        Ok(())
    }

    /// Whether a run can go on with a state that comes from outside, at `time_s`, or only be looked at if there is no
    /// time. The form of the state was checked, its numbers were not.
    ///
    /// # Errors
    /// Why it cannot.
    fn accepts(&self, state: &Self::State, values: &Self::Values, time_s: Option<f64>) -> Result<(), String> {
        let _ = (state, values, time_s);
        Ok(())
    }

    /// Updates outputs that follow an input at the same instant.
    fn refresh(&self, state: &Self::State, values: &mut Self::Values, time_s: f64) {
        let _ = (state, values, time_s);
    }

    /// The directional derivative at an instant: `direction` holds the direction in the places of the variables that are
    /// known and 0 in all others; the answer holds the derivatives in the places of those that follow from them.
    /// `started` tells whether the run has begun; before, parameters are known as well.
    ///
    /// Called only if [`Model::CAPABILITIES`] promises it.
    fn differentiate(
        &self,
        state: &Self::State,
        values: &Self::Values,
        direction: &Self::Values,
        time_s: f64,
        started: bool,
    ) -> Self::Values {
        let _ = (state, values, time_s, started);
        direction.clone()
    }

    /// The derivatives of that order of the outputs with respect to time, in the places of the outputs.
    /// `input_derivatives[j]` holds the derivatives of order j + 1 of the inputs in their places.
    ///
    /// Called only for orders that [`Model::CAPABILITIES`] promises.
    fn output_derivatives(
        &self,
        state: &Self::State,
        values: &Self::Values,
        input_derivatives: &[Self::Values; HIGHEST_ORDER],
        time_s: f64,
        order: usize,
    ) -> Self::Values {
        let _ = (state, values, time_s, order);
        input_derivatives[0].clone()
    }
}

/// A model that acts at sample instants and holds its outputs in between. Every such type is a [`Model`].
///
/// Samples are at the start of the run plus whole multiples of the period, however the importer cuts time into steps; see
/// [`Clock`].
pub trait SampledModel: Clone + Send + Sync + 'static {
    /// Name and description.
    const INFO: Info;

    /// The values of all variables.
    type Values: Clone + Default + Serialize + DeserializeOwned + Send + Sync + 'static;

    /// What changes from sample to sample beside the values.
    type State: Clone + Serialize + DeserializeOwned + Send + Sync + 'static;

    /// The table of variables.
    fn table() -> Vec<Row<Self::Values>>;

    /// As [`Model::new`].
    ///
    /// # Errors
    /// Every parameter that cannot be accepted.
    fn new(values: &Self::Values) -> Result<Self, Vec<Invalid>>;

    /// Time between two samples, in seconds.
    fn period_s(&self) -> f64;

    /// As [`Model::start`]. The first sample is taken in the first step, at `start_s`.
    fn start(&self, values: &mut Self::Values, start_s: f64) -> Self::State;

    /// Takes the sample at an instant, for which the values hold the inputs, and fills in the outputs.
    ///
    /// # Errors
    /// Why the run cannot go on.
    fn sample(&self, state: &mut Self::State, values: &mut Self::Values, instant_s: f64, log: &mut dyn Log) -> Stepped;

    /// As [`Model::retune`].
    ///
    /// # Errors
    /// Every parameter that cannot be accepted.
    fn retune(&mut self, state: &mut Self::State, values: &Self::Values) -> Result<(), Vec<Invalid>> {
        let _ = (state, values);
        Ok(())
    }

    /// Whether the numbers of a state that comes from outside are such as occur.
    ///
    /// # Errors
    /// Why not.
    fn accepts(&self, state: &Self::State) -> Result<(), String> {
        let _ = state;
        Ok(())
    }
}

impl<S: SampledModel> Model for S {
    const INFO: Info = <S as SampledModel>::INFO;
    type Values = <S as SampledModel>::Values;
    type State = (<S as SampledModel>::State, Clock);

    fn table() -> Vec<Row<<S as SampledModel>::Values>> {
        <S as SampledModel>::table()
    }

    fn new(values: &<S as SampledModel>::Values) -> Result<Self, Vec<Invalid>> {
        <S as SampledModel>::new(values)
    }

    fn start(&self, values: &mut <S as SampledModel>::Values, start_s: f64) -> (<S as SampledModel>::State, Clock) {
        (SampledModel::start(self, values, start_s), Clock::new(start_s, self.period_s()))
    }

    fn step(
        &self,
        (state, clock): &mut (<S as SampledModel>::State, Clock),
        values: &mut <S as SampledModel>::Values,
        step: Step,
        inputs: &InputTrajectory<'_, <S as SampledModel>::Values>,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        while let Some(instant_s) = clock.next_before(step.end_s()) {
            inputs.apply(values, instant_s);
            self.sample(state, values, instant_s, log)?;
        }
        Ok(())
    }

    fn base_step_s(&self) -> f64 {
        self.period_s()
    }

    fn retune(
        &mut self,
        (state, _): &mut (<S as SampledModel>::State, Clock),
        values: &<S as SampledModel>::Values,
    ) -> Result<(), Vec<Invalid>> {
        SampledModel::retune(self, state, values)
    }

    fn accepts(
        &self,
        (state, clock): &(<S as SampledModel>::State, Clock),
        _: &<S as SampledModel>::Values,
        time_s: Option<f64>,
    ) -> Result<(), String> {
        SampledModel::accepts(self, state)?;
        if time_s.is_some_and(|time_s| !clock.suits(self.period_s(), time_s)) {
            return Err("the samples taken do not belong to the time".into());
        }
        Ok(())
    }
}
