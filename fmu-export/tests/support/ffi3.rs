//! An importer of FMI 3.0 within the test: calls the exported C functions through pointers of the types in the C header.
//!
//! [`Fmu3`] makes calls like an importer and keeps every message of its instance.

use std::ffi::{CStr, CString};
use std::ptr::{null, null_mut};
use std::sync::{Arc, Mutex};

use fmu_export::fmi3::bindings::*;
use fmu_export::variable::{Type, Variable};
use fmu_export::{ModelType, Standard};

use super::ffi::text;
use super::library::FMUS;

/// Calls a function of the C interface through the pointer type of the header; unsafe, because the caller is responsible for the
/// arguments.
#[macro_export]
macro_rules! call3 {
    ($name:ident: $type:ident ($($argument:expr),* $(,)?)) => {{
        let function: fmu_export::fmi3::bindings::$type = Some($crate::support::library::fmi3::$name);
        (function.expect("the function is there"))($($argument),*)
    }};
}

/// A message of an instance, as its importer receives it.
#[derive(Clone, Debug, PartialEq)]
pub struct Message3 {
    /// Status of the message.
    pub status: fmi3Status,
    /// Category, as the model description declares it.
    pub category: String,
    /// The message itself.
    pub text: String,
}

/// The messages of one instance; its address is the environment.
type Messages = Mutex<Vec<Message3>>;

unsafe extern "C" fn take_message(
    environment: fmi3InstanceEnvironment,
    status: fmi3Status,
    category: fmi3String,
    message: fmi3String,
) {
    // SAFETY: the environment is the address of the `Messages` of the instance, which outlive it; both texts end with a zero byte.
    let (messages, category, text) =
        unsafe { (&*environment.cast::<Messages>(), CStr::from_ptr(category), CStr::from_ptr(message)) };
    let words = |text: &CStr| text.to_str().expect("texts are UTF-8").to_owned();
    let message = Message3 { status, category: words(category), text: words(text) };
    messages.lock().expect("no test panics while it holds the messages").push(message);
}

/// An importer's arguments for a new instance; valid by default.
pub struct Request3 {
    /// Name of the instance; `None` is a null pointer.
    pub name: Option<CString>,
    /// Instantiation token; `None` is a null pointer.
    pub token: Option<CString>,
    /// Path of the resources; `None` is a null pointer.
    pub resources: Option<CString>,
    /// Whether messages are wanted.
    pub logging: bool,
    /// Whether there is a logger.
    pub logger: bool,
    /// Whether event mode is used.
    pub event_mode: bool,
    /// Whether a step may end early.
    pub early_return: bool,
}

impl Request3 {
    /// A valid request for an instance of a model, without logging, event mode and early return.
    pub fn of(model: &str, arrays: bool) -> Self {
        Self {
            name: Some(text("instance")),
            token: Some(text(&token(model, arrays))),
            resources: Some(text("/a/folder/resources/")),
            logging: false,
            logger: true,
            event_mode: false,
            early_return: false,
        }
    }

    /// Makes the instance; returns the messages if it is refused.
    pub fn instantiate(self, model: &str, arrays: bool) -> Result<Fmu3, Vec<Message3>> {
        let messages: Box<Messages> = Box::default();
        let pointer = |text: &Option<CString>| text.as_ref().map_or(null(), |text| text.as_ptr());
        // SAFETY: the texts are alive during the call; the messages live as long as the instance.
        let instance = unsafe {
            call3!(fmi3InstantiateCoSimulation: fmi3InstantiateCoSimulationTYPE(
                pointer(&self.name),
                pointer(&self.token),
                pointer(&self.resources),
                0,
                self.logging.into(),
                self.event_mode.into(),
                self.early_return.into(),
                null(),
                0,
                (&raw const *messages).cast_mut().cast(),
                if self.logger { Some(take_message) } else { None },
                None,
            ))
        };
        if instance.is_null() {
            return Err(messages.into_inner().expect("no test panics while it holds the messages"));
        }
        let model = FMUS.find(model).expect("an instance of a model");
        Ok(Fmu3 { instance, model, arrays, messages })
    }
}

/// The instantiation token of a model.
pub fn token(model: &str, arrays: bool) -> String {
    let model = FMUS.find(model).unwrap_or_else(|| panic!("there is no model {model}"));
    model.description(Standard::Fmi3 { arrays }).token.clone()
}

/// One instance, freed when it goes out of scope.
pub struct Fmu3 {
    instance: fmi3Instance,
    model: Arc<ModelType>,
    arrays: bool,
    messages: Box<Messages>,
}

impl Drop for Fmu3 {
    fn drop(&mut self) {
        // SAFETY: the instance is live and is not used again.
        unsafe { call3!(fmi3FreeInstance: fmi3FreeInstanceTYPE(self.instance)) }
    }
}

/// Results of a step besides its status.
#[derive(Debug, PartialEq)]
pub struct Stepped3 {
    /// Whether event handling is needed, the simulation should end, the step ended early.
    pub flags: [fmi3Boolean; 3],
    /// Time of the end of the step.
    pub time: f64,
}

impl Fmu3 {
    /// An instance of a model, with logging on.
    pub fn new(model: &str, arrays: bool) -> Self {
        let request = Request3 { logging: true, ..Request3::of(model, arrays) };
        request.instantiate(model, arrays).unwrap_or_else(|messages| panic!("{model} was refused: {messages:?}"))
    }

    /// An instance in step mode at 0 s, with parameters.
    pub fn started(model: &str, parameters: &[(&str, f64)]) -> Self {
        let fmu = Self::new(model, false);
        for (name, value) in parameters {
            fmu.ok(fmu.set(name, *value));
        }
        fmu.start(0.0);
        fmu
    }

    /// Initializes.
    pub fn start(&self, start: f64) {
        self.ok(self.enter_initialization(start, None));
        self.ok(self.exit_initialization());
    }

    /// The pointer that the functions take.
    pub fn instance(&self) -> fmi3Instance {
        self.instance
    }

    /// Whether the variables are arrays.
    pub fn arrays(&self) -> bool {
        self.arrays
    }

    /// The rows of the table.
    pub fn variables(&self) -> &[Variable] {
        self.model.variables()
    }

    /// The value reference of a variable; `time` has the one after the last row.
    pub fn reference(&self, name: &str) -> u32 {
        let variables = self.variables();
        let found = variables.iter().position(|variable| variable.name == name);
        found.or((name == "time").then_some(variables.len())).unwrap_or_else(|| panic!("there is no {name}")) as u32
    }

    /// The messages since they were last taken.
    pub fn take_messages(&self) -> Vec<Message3> {
        std::mem::take(&mut *self.messages.lock().expect("no test panics while it holds the messages"))
    }

    /// Asserts fmi3OK.
    #[track_caller]
    pub fn ok(&self, status: fmi3Status) {
        assert_eq!(status, fmi3Status::fmi3OK, "{:?}", self.take_messages());
    }

    /// Asserts fmi3Error and exactly one message, of the category `logStatusError`; returns its text.
    #[track_caller]
    pub fn error(&self, status: fmi3Status) -> String {
        let messages = self.take_messages();
        assert_eq!(status, fmi3Status::fmi3Error, "{messages:?}");
        let errors: Vec<_> = messages.iter().filter(|message| message.status == fmi3Status::fmi3Error).collect();
        let [message] = errors[..] else { panic!("expected one message: {messages:?}") };
        assert_eq!(message.category, "logStatusError");
        message.text.clone()
    }

    /// Sets a variable of any type but String by its name: enumerations and integers by value, Booleans as 0 and 1.
    pub fn set(&self, name: &str, value: f64) -> fmi3Status {
        let (c, reference) = (self.instance, [self.reference(name)]);
        let first = reference.as_ptr();
        // SAFETY: the instance is live; all arrays have one element.
        unsafe {
            match self.variables()[reference[0] as usize].data_type {
                Type::Real { .. } => self.set_floats(&reference, &[value]),
                Type::Integer { .. } => {
                    call3!(fmi3SetInt32: fmi3SetInt32TYPE(c, first, 1, [value as i32].as_ptr(), 1))
                }
                Type::Enumeration { .. } => {
                    call3!(fmi3SetInt64: fmi3SetInt64TYPE(c, first, 1, [value as i64].as_ptr(), 1))
                }
                Type::Boolean { .. } => {
                    call3!(fmi3SetBoolean: fmi3SetBooleanTYPE(c, first, 1, [value as u8].as_ptr(), 1))
                }
                _ => panic!("{name} is a text"),
            }
        }
    }

    /// Reads a variable of any type but String by its name, as a number.
    pub fn try_get(&self, name: &str) -> Result<f64, fmi3Status> {
        let (c, reference) = (self.instance, [self.reference(name)]);
        let first = reference.as_ptr();
        let (mut small, mut large, mut flag) = ([0_i32], [0_i64], [7_u8]);
        // SAFETY: the instance is live; all arrays have one element.
        let (status, value) = unsafe {
            match self.variables()[reference[0] as usize].data_type {
                Type::Real { .. } => return self.get_floats(&reference, 1).map(|values| values[0]),
                Type::Integer { .. } => {
                    (call3!(fmi3GetInt32: fmi3GetInt32TYPE(c, first, 1, small.as_mut_ptr(), 1)), f64::from(small[0]))
                }
                Type::Enumeration { .. } => {
                    (call3!(fmi3GetInt64: fmi3GetInt64TYPE(c, first, 1, large.as_mut_ptr(), 1)), large[0] as f64)
                }
                Type::Boolean { .. } => {
                    (call3!(fmi3GetBoolean: fmi3GetBooleanTYPE(c, first, 1, flag.as_mut_ptr(), 1)), f64::from(flag[0]))
                }
                _ => panic!("{name} is a text"),
            }
        };
        if status == fmi3Status::fmi3OK { Ok(value) } else { Err(status) }
    }

    /// Reads a variable that must be readable.
    #[track_caller]
    pub fn get(&self, name: &str) -> f64 {
        self.try_get(name).unwrap_or_else(|status| panic!("{name}: {status:?}, {:?}", self.take_messages()))
    }

    /// All values but texts in the order of the table, bit for bit; of an instance without arrays.
    pub fn all_bits(&self) -> Vec<u64> {
        let numbers = self.variables().iter().filter(|variable| !matches!(variable.data_type, Type::String { .. }));
        numbers.map(|variable| self.get(&variable.name).to_bits()).collect()
    }

    /// `fmi3SetFloat64`.
    pub fn set_floats(&self, references: &[u32], values: &[f64]) -> fmi3Status {
        let (c, first, count) = (self.instance, references.as_ptr(), references.len());
        // SAFETY: the instance is live; both arrays are as long as stated.
        unsafe { call3!(fmi3SetFloat64: fmi3SetFloat64TYPE(c, first, count, values.as_ptr(), values.len())) }
    }

    /// `fmi3GetFloat64` of this number of values.
    pub fn get_floats(&self, references: &[u32], n_values: usize) -> Result<Vec<f64>, fmi3Status> {
        let mut values = vec![f64::NAN; n_values];
        let (c, first, count) = (self.instance, references.as_ptr(), references.len());
        // SAFETY: the instance is live; both arrays are as long as stated.
        let status =
            unsafe { call3!(fmi3GetFloat64: fmi3GetFloat64TYPE(c, first, count, values.as_mut_ptr(), n_values)) };
        if status == fmi3Status::fmi3OK { Ok(values) } else { Err(status) }
    }

    /// `fmi3EnterInitializationMode` without a tolerance.
    pub fn enter_initialization(&self, start: f64, stop: Option<f64>) -> fmi3Status {
        let (c, defined) = (self.instance, u8::from(stop.is_some()));
        // SAFETY: the instance is live.
        unsafe {
            call3!(fmi3EnterInitializationMode: fmi3EnterInitializationModeTYPE(
                c, 0, 0.0, start, defined, stop.unwrap_or(0.0)
            ))
        }
    }

    /// `fmi3ExitInitializationMode`.
    pub fn exit_initialization(&self) -> fmi3Status {
        // SAFETY: the instance is live.
        unsafe { call3!(fmi3ExitInitializationMode: fmi3ExitInitializationModeTYPE(self.instance)) }
    }

    /// `fmi3EnterEventMode`.
    pub fn enter_event_mode(&self) -> fmi3Status {
        // SAFETY: the instance is live.
        unsafe { call3!(fmi3EnterEventMode: fmi3EnterEventModeTYPE(self.instance)) }
    }

    /// `fmi3UpdateDiscreteStates`; the flags must all be false afterwards.
    pub fn update_discrete_states(&self) -> fmi3Status {
        let (mut flags, mut time) = ([7_u8; 5], 0.0);
        let [need, end, nominals, values, next] = flags.each_mut().map(|flag| &raw mut *flag);
        // SAFETY: the instance is live; all places can be written.
        let status = unsafe {
            call3!(fmi3UpdateDiscreteStates: fmi3UpdateDiscreteStatesTYPE(
                self.instance, need, end, nominals, values, next, &raw mut time
            ))
        };
        assert!(status != fmi3Status::fmi3OK || flags == [0; 5], "{flags:?}");
        status
    }

    /// `fmi3EnterStepMode`.
    pub fn enter_step_mode(&self) -> fmi3Status {
        // SAFETY: the instance is live.
        unsafe { call3!(fmi3EnterStepMode: fmi3EnterStepModeTYPE(self.instance)) }
    }

    /// `fmi3DoStep`; the importer declares that it will not go back.
    pub fn try_step(&self, time: f64, length: f64) -> (fmi3Status, Stepped3) {
        let mut done = Stepped3 { flags: [7; 3], time: f64::NAN };
        let [event, end, early] = done.flags.each_mut().map(|flag| &raw mut *flag);
        // SAFETY: the instance is live; all places can be written.
        let status = unsafe {
            call3!(fmi3DoStep: fmi3DoStepTYPE(
                self.instance, time, length, 1, event, end, early, &raw mut done.time
            ))
        };
        (status, done)
    }

    /// `fmi3DoStep`.
    pub fn step(&self, time: f64, length: f64) -> fmi3Status {
        self.try_step(time, length).0
    }

    /// `fmi3Terminate`.
    pub fn terminate(&self) -> fmi3Status {
        // SAFETY: the instance is live.
        unsafe { call3!(fmi3Terminate: fmi3TerminateTYPE(self.instance)) }
    }

    /// `fmi3Reset`.
    pub fn reset(&self) -> fmi3Status {
        // SAFETY: the instance is live.
        unsafe { call3!(fmi3Reset: fmi3ResetTYPE(self.instance)) }
    }

    /// `fmi3GetFMUState` into this pointer.
    pub fn get_state(&self, state: &mut fmi3FMUState) -> fmi3Status {
        // SAFETY: the instance is live; the pointer is null or a snapshot of this library's.
        unsafe { call3!(fmi3GetFMUState: fmi3GetFMUStateTYPE(self.instance, state)) }
    }

    /// `fmi3SetFMUState`.
    pub fn set_state(&self, state: fmi3FMUState) -> fmi3Status {
        // SAFETY: the instance is live; the pointer is null or a snapshot of this library's.
        unsafe { call3!(fmi3SetFMUState: fmi3SetFMUStateTYPE(self.instance, state)) }
    }

    /// `fmi3FreeFMUState`.
    pub fn free_state(&self, state: &mut fmi3FMUState) -> fmi3Status {
        // SAFETY: the instance is live; the pointer is null or a snapshot of this library's.
        unsafe { call3!(fmi3FreeFMUState: fmi3FreeFMUStateTYPE(self.instance, state)) }
    }

    /// `fmi3SerializedFMUStateSize` and `fmi3SerializeFMUState`.
    pub fn serialize(&self, state: fmi3FMUState) -> Result<Vec<u8>, fmi3Status> {
        let (c, mut size) = (self.instance, 0);
        // SAFETY: the instance is live; the pointer is null or a snapshot of this library's.
        let status =
            unsafe { call3!(fmi3SerializedFMUStateSize: fmi3SerializedFMUStateSizeTYPE(c, state, &raw mut size)) };
        if status != fmi3Status::fmi3OK {
            return Err(status);
        }
        let mut bytes = vec![0_u8; size];
        // SAFETY: as above; there are as many bytes as stated.
        let status =
            unsafe { call3!(fmi3SerializeFMUState: fmi3SerializeFMUStateTYPE(c, state, bytes.as_mut_ptr(), size)) };
        if status == fmi3Status::fmi3OK { Ok(bytes) } else { Err(status) }
    }

    /// `fmi3DeserializeFMUState`.
    pub fn deserialize(&self, bytes: &[u8], state: &mut fmi3FMUState) -> fmi3Status {
        let (c, first, size) = (self.instance, bytes.as_ptr(), bytes.len());
        // SAFETY: the instance is live; there are as many bytes as stated; the pointer may be written.
        unsafe { call3!(fmi3DeserializeFMUState: fmi3DeserializeFMUStateTYPE(c, first, size, state)) }
    }

    /// `fmi3GetDirectionalDerivative` with this number of results.
    pub fn directional_derivative(
        &self,
        unknowns: &[u32],
        knowns: &[u32],
        seed: &[f64],
        results: usize,
    ) -> Result<Vec<f64>, fmi3Status> {
        let mut sensitivity = vec![f64::NAN; results];
        // SAFETY: the instance is live; all arrays are as long as stated.
        let status = unsafe {
            call3!(fmi3GetDirectionalDerivative: fmi3GetDirectionalDerivativeTYPE(
                self.instance,
                unknowns.as_ptr(),
                unknowns.len(),
                knowns.as_ptr(),
                knowns.len(),
                seed.as_ptr(),
                seed.len(),
                sensitivity.as_mut_ptr(),
                results,
            ))
        };
        if status == fmi3Status::fmi3OK { Ok(sensitivity) } else { Err(status) }
    }

    /// `fmi3GetOutputDerivatives` with this number of results.
    pub fn output_derivatives(
        &self,
        references: &[u32],
        orders: &[i32],
        results: usize,
    ) -> Result<Vec<f64>, fmi3Status> {
        assert_eq!(references.len(), orders.len());
        let mut values = vec![f64::NAN; results];
        // SAFETY: the instance is live; all arrays are as long as stated.
        let status = unsafe {
            call3!(fmi3GetOutputDerivatives: fmi3GetOutputDerivativesTYPE(
                self.instance,
                references.as_ptr(),
                references.len(),
                orders.as_ptr(),
                values.as_mut_ptr(),
                results,
            ))
        };
        if status == fmi3Status::fmi3OK { Ok(values) } else { Err(status) }
    }

    /// `fmi3SetDebugLogging` of one category.
    pub fn set_logging(&self, on: bool, category: &CStr) -> fmi3Status {
        let categories = [category.as_ptr()];
        // SAFETY: the instance is live; the array has one text.
        unsafe {
            call3!(fmi3SetDebugLogging: fmi3SetDebugLoggingTYPE(self.instance, on.into(), 1, categories.as_ptr()))
        }
    }
}

/// A null snapshot.
pub fn no_state() -> fmi3FMUState {
    null_mut()
}
