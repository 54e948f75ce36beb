//! The part that you write: a model as a table of variables, a start, and a step.

use std::borrow::Cow;
use std::fmt;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::clock::Clock;
use crate::input::{HIGHEST_ORDER, InputTrajectory};
use crate::log::{Digits, Log, Topic};
use crate::resources::Resources;
use crate::state::{HiddenState, write_to};
use crate::variable::{Causality, Row, Variability};

/// General information for the model description. Empty texts are left out.
///
/// ```
/// # use fmu_export::Info;
/// const INFO: Info = Info::new("VanDerPol", "Oscillator with nonlinear damping").experiment(20.0, 1e-2).author("B. van der Pol");
/// assert_eq!(INFO.stop_s, 20.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Info {
    /// Name of the model and of its FMU: letters, digits, and underscores.
    pub name: &'static str,
    /// The modelled object, as a phrase without a full stop.
    pub description: &'static str,
    /// Version of the model.
    pub version: &'static str,
    /// Name and organisation of the author.
    pub author: &'static str,
    /// Licence under which the model may be used.
    pub license: &'static str,
    /// Name and version of the tool that wrote the model description.
    pub tool: &'static str,
    /// Length of a typical run, in seconds.
    pub stop_s: f64,
    /// Communication step of such a run, in seconds.
    pub step_s: f64,
    /// Relative tolerance of such a run, which the model should meet: a tolerance set by an importer is ignored.
    pub tolerance: f64,
}

impl Info {
    /// A name and a description; a run of 1 s in steps of 1 ms, tolerance 1e-4; no version, author or licence.
    pub const fn new(name: &'static str, description: &'static str) -> Self {
        let tool = concat!("fmu-export ", env!("CARGO_PKG_VERSION"));
        let [version, author, license] = [""; 3];
        Self { name, description, version, author, license, tool, stop_s: 1.0, step_s: 1e-3, tolerance: 1e-4 }
    }

    /// Length and communication step of a typical run, in seconds.
    pub const fn experiment(mut self, stop_s: f64, step_s: f64) -> Self {
        (self.stop_s, self.step_s) = (stop_s, step_s);
        self
    }

    /// Relative tolerance of such a run.
    pub const fn tolerance(mut self, tolerance: f64) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Version of the model.
    pub const fn version(mut self, version: &'static str) -> Self {
        self.version = version;
        self
    }

    /// Name and organisation of the author.
    pub const fn author(mut self, author: &'static str) -> Self {
        self.author = author;
        self
    }

    /// Licence under which the model may be used.
    pub const fn license(mut self, license: &'static str) -> Self {
        self.license = license;
        self
    }

    /// Name and version of the tool that wrote the model description.
    pub const fn tool(mut self, tool: &'static str) -> Self {
        self.tool = tool;
        self
    }
}

/// Optional capabilities of a model.
///
/// ```
/// # use fmu_export::Capabilities;
/// const CAPABILITIES: Capabilities = Capabilities::NONE.directional_derivatives().output_derivatives(2);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Capabilities {
    /// Directional derivatives of outputs and of derivatives of states.
    pub directional_derivatives: bool,
    /// The highest order of time derivatives of outputs; 0 if there are none.
    pub output_derivative_order: usize,
    /// Whether steps follow the derivatives of inputs that importers set.
    pub interpolates_inputs: bool,
    /// Whether there are snapshots; this depends on the type of the state, see [`HiddenState::SAVED`].
    pub snapshots: bool,
}

impl Capabilities {
    /// Nothing beyond stepping, and snapshots.
    pub const NONE: Self = Self {
        directional_derivatives: false,
        output_derivative_order: 0,
        interpolates_inputs: false,
        snapshots: true,
    };

    /// The model implements [`Model::differentiate`].
    pub const fn directional_derivatives(mut self) -> Self {
        self.directional_derivatives = true;
        self
    }

    /// The model implements [`Model::output_derivatives`] up to that order.
    pub const fn output_derivatives(mut self, order: usize) -> Self {
        self.output_derivative_order = order;
        self
    }

    /// [`Model::step`] uses its [`InputTrajectory`]. Without this, derivatives of inputs are refused, because a model that holds its
    /// inputs over a step would ignore them. Sampled models always have it.
    pub const fn interpolates_inputs(mut self) -> Self {
        self.interpolates_inputs = true;
        self
    }
}

/// A refused value of a parameter or input, or a refused file, with the expected value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Invalid {
    /// Name of the variable, for instance `coil.R` or `alpha[2]`.
    pub name: Cow<'static, str>,
    /// The refused value, with its unit if it has one.
    pub value: String,
    /// The expected value, with the reason where it is not obvious.
    pub wanted: Cow<'static, str>,
}

impl Invalid {
    /// A refused value, and the expected one.
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

/// Lets `?` convert a single finding to a list.
impl From<Invalid> for Vec<Invalid> {
    fn from(finding: Invalid) -> Self {
        vec![finding]
    }
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {} is refused: expected {}", self.name, self.value, self.wanted)
    }
}

/// Reason why a step could not be completed, as a message for the user.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// The run cannot continue.
    #[error("{0}")]
    Failed(String),
    /// The model ends the simulation, as intended.
    #[error("the model ends the simulation at {time_s} s: {reason}")]
    Terminated {
        /// When, in seconds; the values are those of this instant.
        time_s: f64,
        /// Why.
        reason: String,
    },
}

impl StepError {
    /// An error that ends the run, from any error.
    pub fn of(error: impl fmt::Display) -> Self {
        Self::Failed(error.to_string())
    }

    /// The request to end the simulation at an instant within the step, with the values at that instant. Not an error: the
    /// importer is informed and may read all variables, but further steps are refused.
    ///
    /// ```
    /// # use fmu_export::{Step, StepError, Stepped};
    /// fn check(level_m: f64, step: Step) -> Stepped {
    ///     if level_m <= 0.0 { Err(StepError::terminate(step.end_s(), "the tank is empty")) } else { Ok(()) }
    /// }
    /// # assert!(check(0.0, Step { time_s: 0.0, length_s: 1.0 }).is_err());
    /// ```
    pub fn terminate(time_s: f64, reason: impl fmt::Display) -> Self {
        Self::Terminated { time_s, reason: reason.to_string() }
    }
}

/// Result of a step or a sample.
pub type Stepped = Result<(), StepError>;

/// A communication step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Start, in seconds.
    pub time_s: f64,
    /// Length, in seconds.
    pub length_s: f64,
}

impl Step {
    /// End, in seconds.
    pub fn end_s(&self) -> f64 {
        self.time_s + self.length_s
    }
}

/// A model with its own stepping. For one that acts at sample instants see [`SampledModel`].
///
/// A value of this type holds the constants of a run: validated parameters, coefficients, tables. All snapshots of a run share it.
/// Quantities that change during a run are in `Values`, which the variables access, and in the hidden `State`; `()` if there is none.
pub trait Model: Clone + Send + Sync + 'static {
    /// Name and description.
    const INFO: Info;

    /// Optional capabilities.
    const CAPABILITIES: Capabilities = Capabilities::NONE;

    /// The values of all variables.
    type Values: Clone + Default + Serialize + DeserializeOwned + Send + Sync + 'static;

    /// State that changes during a run besides the values.
    type State: HiddenState;

    /// The table of variables.
    fn table() -> Vec<Row<Self::Values>>;

    /// Validates the parameters among the values and constructs the model. Values outside the `min` and `max` of their rows are
    /// refused in addition. `resources` gives access to the files of the FMU. During a run, when a snapshot is read or a parameter changes,
    /// all other values are those of that time: what depends on a start value belongs to the state. During initialization this function and
    /// [`start`](Self::start) also run, on a copy of the values, each time an importer reads an output after it has set a variable: they must not
    /// have side effects, and should be fast.
    ///
    /// # Errors
    /// Every invalid parameter.
    fn new(values: &Self::Values, resources: &Resources) -> Result<Self, Vec<Invalid>>;

    /// Begins a run at a time, in seconds, and computes the outputs.
    fn start(&self, values: &mut Self::Values, start_s: f64) -> Self::State;

    /// Does one communication step and computes the outputs at its end. The inputs among the values are those at its start;
    /// `inputs` gives them over the step. The step may leave the inputs among the values at any instant.
    ///
    /// # Errors
    /// Why the run cannot continue. The values remain readable.
    fn step(
        &self,
        state: &mut Self::State,
        values: &mut Self::Values,
        step: Step,
        inputs: &InputTrajectory<'_, Self::Values>,
        log: &mut dyn Log,
    ) -> Stepped;

    /// The shortest internal step, in seconds. A communication step of more than [`MAX_BASE_STEPS`] of them is refused, because
    /// the model would seem to hang.
    ///
    /// [`MAX_BASE_STEPS`]: crate::instance::MAX_BASE_STEPS
    fn base_step_s(&self) -> f64 {
        f64::INFINITY
    }

    /// Applies changed tunable parameters; by default reconstructs the model and keeps the state. A model that keeps
    /// parameters in its state updates them here.
    ///
    /// # Errors
    /// Every invalid parameter; the run continues with the former ones, the former model, and the former state. A state in
    /// [`NotSaved`](crate::NotSaved) has no copy: check all parameters before you change it.
    fn retune(
        &mut self,
        state: &mut Self::State,
        values: &Self::Values,
        resources: &Resources,
    ) -> Result<(), Vec<Invalid>> {
        let _ = state;
        *self = Self::new(values, resources)?;
        Ok(())
    }

    /// Whether an external state is consistent: to continue at `time_s`, or only to be read if that is `None`. Its types
    /// have been checked, its numbers have not.
    ///
    /// # Errors
    /// Why it is not.
    fn accepts(&self, state: &Self::State, values: &Self::Values, time_s: Option<f64>) -> Result<(), String> {
        let _ = (state, values, time_s);
        Ok(())
    }

    /// Updates outputs with direct feedthrough.
    fn refresh(&self, state: &Self::State, values: &mut Self::Values, time_s: f64) {
        let _ = (state, values, time_s);
    }

    /// The directional derivative at an instant: `direction` holds the direction in place of the known variables and 0 in
    /// all others; the result holds the derivatives in place of the unknowns. `started` is true once the run has begun;
    /// before that, parameters are knowns too.
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
        let _ = (state, values, direction, time_s, started);
        panic!("CAPABILITIES promises directional derivatives, but `differentiate` is not implemented")
    }

    /// The time derivatives of that order of the outputs, in place of the outputs. `input_derivatives[j]` holds the derivatives
    /// of order j + 1 of the inputs, in place of the inputs.
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
        let _ = (state, values, input_derivatives, time_s, order);
        panic!("CAPABILITIES promises derivatives of outputs, but `output_derivatives` is not implemented")
    }
}

/// A model that acts at sample instants and holds its outputs in between; [`Sampled`] makes a [`Model`] of it.
///
/// Samples are taken at the start of the run plus whole multiples of the period, whatever the communication steps; see
/// [`Clock`].
pub trait SampledModel: Clone + Send + Sync + 'static {
    /// Name and description.
    const INFO: Info;

    /// The values of all variables.
    type Values: Clone + Default + Serialize + DeserializeOwned + Send + Sync + 'static;

    /// State that changes from sample to sample besides the values.
    type State: HiddenState;

    /// The table of variables.
    fn table() -> Vec<Row<Self::Values>>;

    /// As [`Model::new`].
    ///
    /// # Errors
    /// Every invalid parameter.
    fn new(values: &Self::Values, resources: &Resources) -> Result<Self, Vec<Invalid>>;

    /// Sample period, in seconds.
    fn period_s(&self) -> f64;

    /// As [`Model::start`]. The first sample is taken in the first step, at `start_s`.
    fn start(&self, values: &mut Self::Values, start_s: f64) -> Self::State;

    /// Takes the sample at an instant, with the inputs in the values, and computes the outputs.
    ///
    /// # Errors
    /// Why the run cannot continue.
    fn sample(&self, state: &mut Self::State, values: &mut Self::Values, instant_s: f64, log: &mut dyn Log) -> Stepped;

    /// Writes the outputs that the last sample computed for the instant of the next one; called when that instant is reached. A
    /// controller thus acts one sample later, whatever the communication steps. By default there are none.
    fn take_effect(&self, state: &mut Self::State, values: &mut Self::Values) {
        let _ = (state, values);
    }

    /// As [`Model::refresh`].
    fn refresh(&self, state: &Self::State, values: &mut Self::Values, time_s: f64) {
        let _ = (state, values, time_s);
    }

    /// As [`Model::retune`]. A changed period is refused, because the samples taken so far belong to the former one.
    ///
    /// # Errors
    /// Every invalid parameter. Before you change a state in [`NotSaved`](crate::NotSaved), compare the period too.
    fn retune(
        &mut self,
        state: &mut Self::State,
        values: &Self::Values,
        resources: &Resources,
    ) -> Result<(), Vec<Invalid>> {
        let _ = state;
        *self = Self::new(values, resources)?;
        Ok(())
    }

    /// Whether an external state is consistent.
    ///
    /// # Errors
    /// Why it is not.
    fn accepts(&self, state: &Self::State) -> Result<(), String> {
        let _ = state;
        Ok(())
    }
}

/// A sampled model as a [`Model`]; [`export_fmus!`](crate::export_fmus) wraps sampled models in it.
#[derive(Clone, Debug)]
pub struct Sampled<S>(S);

/// The state of a [`Sampled`] model: its own, and the samples taken.
#[derive(Debug, PartialEq)]
pub struct SampledState<T> {
    state: T,
    clock: Clock,
}

impl<T: HiddenState> HiddenState for SampledState<T> {
    const SAVED: bool = T::SAVED;

    fn copy(&self) -> Option<Self> {
        Some(Self { state: self.state.copy()?, clock: self.clock })
    }

    fn write(&self, bytes: &mut Vec<u8>) -> Option<()> {
        write_to(bytes, &self.clock)?;
        self.state.write(bytes)
    }

    fn read(bytes: &[u8]) -> Result<(Self, &[u8]), String> {
        let (clock, rest) = <Clock as HiddenState>::read(bytes)?;
        let (state, rest) = T::read(rest)?;
        Ok((Self { state, clock }, rest))
    }
}

/// Fraction of the period after the beginning of a communication step beyond which a sample has outdated inputs.
const LATE: f64 = 1e-3;

impl<S: SampledModel> Model for Sampled<S> {
    const INFO: Info = S::INFO;
    const CAPABILITIES: Capabilities = Capabilities::NONE.interpolates_inputs();
    type Values = S::Values;
    type State = SampledState<S::State>;

    fn table() -> Vec<Row<S::Values>> {
        // Outputs of a sample are constant until the next one, and depend on nothing in between.
        let mut rows = S::table();
        for Row { variable, .. } in &mut rows {
            let is_computed = matches!(variable.causality, Causality::Output | Causality::Local);
            if is_computed && variable.variability == Variability::Continuous {
                variable.variability = Variability::Discrete;
            }
            if variable.variability == Variability::Discrete {
                variable.depends_on.get_or_insert_default();
            }
        }
        rows
    }

    fn new(values: &S::Values, resources: &Resources) -> Result<Self, Vec<Invalid>> {
        let model = S::new(values, resources)?;
        let period_s = model.period_s();
        if !(period_s.is_finite() && period_s > 0.0) {
            return Err(Invalid::new("the sample period", format!("{period_s} s"), "a number above 0").into());
        }
        Ok(Self(model))
    }

    fn start(&self, values: &mut S::Values, start_s: f64) -> SampledState<S::State> {
        SampledState { state: self.0.start(values, start_s), clock: Clock::new(start_s, self.0.period_s()) }
    }

    fn step(
        &self,
        SampledState { state, clock }: &mut SampledState<S::State>,
        values: &mut S::Values,
        step: Step,
        inputs: &InputTrajectory<'_, S::Values>,
        log: &mut dyn Log,
    ) -> Stepped {
        let (before, mut last_s) = (clock.taken(), step.time_s);
        while let Some(instant_s) = clock.next_before(step.end_s()) {
            last_s = instant_s;
            self.0.take_effect(state, values);
            inputs.apply(values, instant_s);
            // Importers that add up their steps may start one slightly after the instant.
            self.0.sample(state, values, instant_s, log).map_err(|error| match error {
                StepError::Terminated { time_s, reason } if time_s == instant_s => {
                    StepError::terminate(time_s.max(step.time_s), reason)
                }
                error => error,
            })?;
        }
        if clock.is_due(step.end_s()) {
            self.0.take_effect(state, values);
        }
        let has_inputs = || inputs.table.variables.iter().any(|of| of.causality == Causality::Input);
        if inputs.is_held() && log.wants(Topic::Warning) && has_inputs() {
            let [length_s, period_s, begin_s, at_s] =
                [step.length_s, self.0.period_s(), step.time_s, last_s].map(Digits::<6>);
            match (before, clock.taken()) {
                (0, samples @ 2..) => log.message(
                    Topic::Warning,
                    format_args!(
                        "a communication step of {length_s} s holds {samples} samples, one every {period_s} s, of the same inputs"
                    ),
                ),
                (1, 2) if last_s - step.time_s > LATE * self.0.period_s() => log.message(
                    Topic::Warning,
                    format_args!(
                        "the sample at {at_s} s has the inputs from {begin_s} s: communication steps of {length_s} s do not divide \
                         the sample period of {period_s} s"
                    ),
                ),
                _ => (),
            }
        }
        Ok(())
    }

    fn refresh(&self, SampledState { state, .. }: &SampledState<S::State>, values: &mut S::Values, time_s: f64) {
        self.0.refresh(state, values, time_s);
    }

    fn base_step_s(&self) -> f64 {
        self.0.period_s()
    }

    fn retune(
        &mut self,
        SampledState { state, .. }: &mut SampledState<S::State>,
        values: &S::Values,
        resources: &Resources,
    ) -> Result<(), Vec<Invalid>> {
        let former_s = self.0.period_s();
        self.0.retune(state, values, resources)?;
        let period_s = self.0.period_s();
        if period_s != former_s {
            let wanted = format!("{former_s} s as before: samples have been taken with it");
            return Err(Invalid::new("the sample period", format!("{period_s} s"), wanted).into());
        }
        Ok(())
    }

    fn accepts(
        &self,
        SampledState { state, clock }: &SampledState<S::State>,
        _: &S::Values,
        time_s: Option<f64>,
    ) -> Result<(), String> {
        self.0.accepts(state)?;
        if time_s.is_some_and(|time_s| !clock.suits(self.0.period_s(), time_s)) {
            return Err("the number of samples taken does not match the time".into());
        }
        Ok(())
    }
}
