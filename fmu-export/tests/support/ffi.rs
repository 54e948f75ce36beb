//! An importer within the test: calls the exported C functions through pointers of the types in the C header.
//!
//! The functions and the models are those of `super::library`, the module with `export_fmus!`.
//!
//! [`Fmu`] makes calls like an importer and keeps every message of its instance. Functions without a method can be called with
//! [`Fmu::component`].

use std::ffi::{CStr, CString, c_void};
use std::ptr::{null, null_mut};
use std::sync::{Arc, Mutex};

use fmu_export::ModelType;
use fmu_export::fmi2::bindings::*;
use fmu_export::variable::{Type, Variable};

use super::library::FMUS;

/// Calls a function of the C interface through the pointer type of the header; unsafe, because the caller is responsible for the
/// arguments.
#[macro_export]
macro_rules! call {
    ($name:ident: $type:ident ($($argument:expr),* $(,)?)) => {{
        let function: fmu_export::fmi2::bindings::$type = Some($crate::support::library::fmi2::$name);
        (function.expect("the function is there"))($($argument),*)
    }};
}

/// A message of an instance, as its importer receives it.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Name of the instance.
    pub instance: String,
    /// Status of the message.
    pub status: fmi2Status,
    /// Category, as the model description declares it.
    pub category: String,
    /// The message itself.
    pub text: String,
}

/// The messages of one instance; its address is the component environment.
type Messages = Mutex<Vec<Message>>;

/// Receives a message. The standard's type is variadic; the layer always passes `"%s"` and one text after it.
unsafe extern "C" fn take_message(
    environment: fmi2ComponentEnvironment,
    instance: fmi2String,
    status: fmi2Status,
    category: fmi2String,
    format: fmi2String,
    text: fmi2String,
) {
    // SAFETY: the environment is the address of the `Messages` of the instance, which outlive it; all texts end with a zero
    // byte, as the standard demands.
    let (messages, instance, category, format, text) = unsafe {
        (
            &*environment.cast::<Messages>(),
            CStr::from_ptr(instance),
            CStr::from_ptr(category),
            CStr::from_ptr(format),
            CStr::from_ptr(text),
        )
    };
    let words = |text: &CStr| text.to_str().expect("texts are UTF-8").to_owned();
    assert_eq!(format, c"%s", "the format takes exactly the text that follows it");
    // The name may have any encoding.
    let instance = instance.to_string_lossy().into_owned();
    let message = Message { instance, status, category: words(category), text: words(text) };
    messages.lock().expect("no test panics while it holds the messages").push(message);
}

/// A logger with one text after the format.
pub type Fixed =
    unsafe extern "C" fn(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, fmi2String);

/// A logger as the standard's variadic type.
pub fn variadic(logger: Fixed) -> fmi2CallbackLogger {
    type Variadic = unsafe extern "C" fn(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    // SAFETY: on x86-64, the platform of these tests, a variadic call passes six integers and pointers in the same
    // registers as any other call, and the caller passes exactly these six.
    Some(unsafe { std::mem::transmute::<Fixed, Variadic>(logger) })
}

unsafe extern "C" fn allocate(_: usize, _: usize) -> *mut c_void {
    null_mut()
}

unsafe extern "C" fn release(_: *mut c_void) {}

/// An importer's arguments for a new instance; valid by default.
pub struct Request {
    /// Name of the instance; `None` is a null pointer.
    pub name: Option<CString>,
    /// Kind of the interface.
    pub kind: fmi2Type,
    /// GUID; `None` is a null pointer.
    pub guid: Option<CString>,
    /// Location of the resources; `None` is a null pointer.
    pub resources: Option<CString>,
    /// Whether messages are wanted.
    pub logging: bool,
    /// Whether the callbacks hold a logger.
    pub logger: bool,
    /// Whether there are callbacks at all.
    pub callbacks: bool,
}

impl Request {
    /// A valid request for an instance of a model, without logging.
    pub fn of(model: &str) -> Self {
        Self {
            name: Some(text("instance")),
            kind: fmi2Type::fmi2CoSimulation,
            guid: Some(text(&guid(model))),
            resources: Some(text("file:///a/folder/resources")),
            logging: false,
            logger: true,
            callbacks: true,
        }
    }

    /// Makes the instance; returns the messages if it is refused.
    pub fn instantiate(self, model: &str) -> Result<Fmu, Vec<Message>> {
        let messages: Box<Messages> = Box::default();
        let callbacks = Box::new(fmi2CallbackFunctions {
            logger: if self.logger { variadic(take_message) } else { None },
            allocateMemory: Some(allocate),
            freeMemory: Some(release),
            stepFinished: None,
            componentEnvironment: (&raw const *messages).cast_mut().cast(),
        });
        let pointer = |text: &Option<CString>| text.as_ref().map_or(null(), |text| text.as_ptr());
        // SAFETY: texts and callbacks are alive during the call; messages and callbacks live as long as the instance.
        let component = unsafe {
            call!(fmi2Instantiate: fmi2InstantiateTYPE(
                pointer(&self.name),
                self.kind,
                pointer(&self.guid),
                pointer(&self.resources),
                if self.callbacks { &raw const *callbacks } else { null() },
                fmi2False,
                i32::from(self.logging),
            ))
        };
        if component.is_null() {
            return Err(messages.into_inner().expect("no test panics while it holds the messages"));
        }
        let model = FMUS.find(model).expect("an instance of a model");
        Ok(Fmu { component, model, messages, _callbacks: callbacks })
    }
}

/// A text for C.
pub fn text(text: &str) -> CString {
    CString::new(text).expect("a text without zero bytes")
}

/// The GUID of a model.
pub fn guid(model: &str) -> String {
    FMUS.find(model).unwrap_or_else(|| panic!("there is no model {model}")).guid().to_owned()
}

/// One instance, freed when it goes out of scope.
pub struct Fmu {
    component: fmi2Component,
    model: Arc<ModelType>,
    messages: Box<Messages>,
    _callbacks: Box<fmi2CallbackFunctions>,
}

// SAFETY: an instance may be used by one thread after another; nothing in it belongs to a thread.
unsafe impl Send for Fmu {}

impl Drop for Fmu {
    fn drop(&mut self) {
        self.free();
    }
}

impl Fmu {
    /// An instance of a model, with logging on.
    pub fn new(model: &str) -> Self {
        let request = Request { logging: true, ..Request::of(model) };
        request.instantiate(model).unwrap_or_else(|messages| panic!("{model} was refused: {messages:?}"))
    }

    /// An instance of a model between two steps, at time 0, with these values set before.
    pub fn started(model: &str, values: &[(&str, f64)]) -> Self {
        let fmu = Self::new(model);
        for (name, value) in values {
            fmu.set(name, *value).ok(&fmu);
        }
        fmu.start(0.0, None);
        fmu
    }

    /// Initializes.
    pub fn start(&self, start_s: f64, stop_s: Option<f64>) {
        self.initialize(start_s, stop_s).ok(self);
    }

    /// The status at the end of the initialization.
    pub fn initialize(&self, start_s: f64, stop_s: Option<f64>) -> fmi2Status {
        self.setup(start_s, stop_s).ok(self);
        self.enter_initialization().ok(self);
        self.exit_initialization()
    }

    /// Frees the instance; the pointer to it is null from then on.
    pub fn free(&mut self) {
        let component = std::mem::replace(&mut self.component, null_mut());
        // SAFETY: the instance is live and is not used again, or the pointer is null.
        unsafe { call!(fmi2FreeInstance: fmi2FreeInstanceTYPE(component)) }
    }

    /// The pointer that the C functions take as the instance.
    pub fn component(&self) -> fmi2Component {
        self.component
    }

    /// The messages since they were last taken.
    pub fn take_messages(&self) -> Vec<Message> {
        std::mem::take(&mut *self.messages.lock().expect("no test panics while it holds the messages"))
    }

    /// The variables in the order of their references.
    pub fn variables(&self) -> &[Variable] {
        self.model.variables()
    }

    /// The reference of a variable.
    pub fn reference(&self, name: &str) -> fmi2ValueReference {
        let found = self.variables().iter().position(|variable| variable.name == name);
        found.unwrap_or_else(|| panic!("there is no variable {name}")) as fmi2ValueReference
    }

    fn kind(&self, name: &str) -> &Type {
        &self.variables()[self.reference(name) as usize].data_type
    }

    /// Sets a variable of any type but String by its name: enumerations and integers by value, Booleans as 0 and 1.
    pub fn set(&self, name: &str, value: f64) -> fmi2Status {
        let reference = [self.reference(name)];
        match self.kind(name) {
            Type::Real { .. } => self.set_reals(&reference, &[value]),
            Type::Integer { .. } | Type::Enumeration { .. } => self.set_integers(&reference, &[value as i32]),
            Type::Boolean { .. } => self.set_booleans(&reference, &[value as i32]),
            _ => panic!("{name} is a text"),
        }
    }

    /// Reads a variable of any type but String by its name, as a number.
    pub fn try_get(&self, name: &str) -> Result<f64, fmi2Status> {
        let reference = [self.reference(name)];
        match self.kind(name) {
            Type::Real { .. } => self.get_reals(&reference).map(|values| values[0]),
            Type::Integer { .. } | Type::Enumeration { .. } => {
                self.get_integers(&reference).map(|values| f64::from(values[0]))
            }
            Type::Boolean { .. } => self.get_booleans(&reference).map(|values| f64::from(values[0])),
            _ => panic!("{name} is a text"),
        }
    }

    /// Reads a variable that must be readable.
    pub fn get(&self, name: &str) -> f64 {
        self.try_get(name).unwrap_or_else(|status| panic!("{name}: {status:?}, {:?}", self.take_messages()))
    }

    /// All values but texts in the order of the references, bit for bit.
    pub fn all_bits(&self) -> Vec<u64> {
        let numbers = self.variables().iter().filter(|variable| !matches!(variable.data_type, Type::String { .. }));
        numbers.map(|variable| self.get(&variable.name).to_bits()).collect()
    }

    /// `fmi2SetReal`.
    pub fn set_reals(&self, references: &[fmi2ValueReference], values: &[f64]) -> fmi2Status {
        assert_eq!(references.len(), values.len());
        // SAFETY: the instance is live; both arrays are as long as stated.
        unsafe {
            call!(fmi2SetReal: fmi2SetRealTYPE(self.component, references.as_ptr(), references.len(), values.as_ptr()))
        }
    }

    /// `fmi2SetInteger`.
    pub fn set_integers(&self, references: &[fmi2ValueReference], values: &[i32]) -> fmi2Status {
        assert_eq!(references.len(), values.len());
        let (first, count) = (references.as_ptr(), references.len());
        // SAFETY: the instance is live; both arrays are as long as stated.
        unsafe { call!(fmi2SetInteger: fmi2SetIntegerTYPE(self.component, first, count, values.as_ptr())) }
    }

    /// `fmi2SetBoolean`.
    pub fn set_booleans(&self, references: &[fmi2ValueReference], values: &[fmi2Boolean]) -> fmi2Status {
        assert_eq!(references.len(), values.len());
        let (first, count) = (references.as_ptr(), references.len());
        // SAFETY: the instance is live; both arrays are as long as stated.
        unsafe { call!(fmi2SetBoolean: fmi2SetBooleanTYPE(self.component, first, count, values.as_ptr())) }
    }

    /// `fmi2GetReal`.
    pub fn get_reals(&self, references: &[fmi2ValueReference]) -> Result<Vec<f64>, fmi2Status> {
        let mut values = vec![f64::NAN; references.len()];
        let (first, count) = (references.as_ptr(), references.len());
        // SAFETY: the instance is live; both arrays are as long as stated.
        let status = unsafe { call!(fmi2GetReal: fmi2GetRealTYPE(self.component, first, count, values.as_mut_ptr())) };
        if status == fmi2Status::fmi2OK { Ok(values) } else { Err(status) }
    }

    /// `fmi2GetInteger`.
    pub fn get_integers(&self, references: &[fmi2ValueReference]) -> Result<Vec<i32>, fmi2Status> {
        let mut values = vec![i32::MIN; references.len()];
        let (first, count) = (references.as_ptr(), references.len());
        // SAFETY: the instance is live; both arrays are as long as stated.
        let status =
            unsafe { call!(fmi2GetInteger: fmi2GetIntegerTYPE(self.component, first, count, values.as_mut_ptr())) };
        if status == fmi2Status::fmi2OK { Ok(values) } else { Err(status) }
    }

    /// `fmi2GetBoolean`.
    pub fn get_booleans(&self, references: &[fmi2ValueReference]) -> Result<Vec<fmi2Boolean>, fmi2Status> {
        let mut values = vec![-1; references.len()];
        let (first, count) = (references.as_ptr(), references.len());
        // SAFETY: the instance is live; both arrays are as long as stated.
        let status =
            unsafe { call!(fmi2GetBoolean: fmi2GetBooleanTYPE(self.component, first, count, values.as_mut_ptr())) };
        if status == fmi2Status::fmi2OK { Ok(values) } else { Err(status) }
    }

    /// `fmi2SetupExperiment` without a tolerance.
    pub fn setup(&self, start_s: f64, stop_s: Option<f64>) -> fmi2Status {
        let (defined, stop_s) = (i32::from(stop_s.is_some()), stop_s.unwrap_or(0.0));
        // SAFETY: the instance is live.
        unsafe {
            call!(fmi2SetupExperiment: fmi2SetupExperimentTYPE(self.component, fmi2False, 0.0, start_s, defined, stop_s))
        }
    }

    /// `fmi2EnterInitializationMode`.
    pub fn enter_initialization(&self) -> fmi2Status {
        // SAFETY: the instance is live.
        unsafe { call!(fmi2EnterInitializationMode: fmi2EnterInitializationModeTYPE(self.component)) }
    }

    /// `fmi2ExitInitializationMode`.
    pub fn exit_initialization(&self) -> fmi2Status {
        // SAFETY: the instance is live.
        unsafe { call!(fmi2ExitInitializationMode: fmi2ExitInitializationModeTYPE(self.component)) }
    }

    /// `fmi2DoStep`; the importer declares that it will not go back.
    pub fn step(&self, time_s: f64, length_s: f64) -> fmi2Status {
        // SAFETY: the instance is live.
        unsafe { call!(fmi2DoStep: fmi2DoStepTYPE(self.component, time_s, length_s, fmi2True)) }
    }

    /// `fmi2Terminate`.
    pub fn terminate(&self) -> fmi2Status {
        // SAFETY: the instance is live.
        unsafe { call!(fmi2Terminate: fmi2TerminateTYPE(self.component)) }
    }

    /// `fmi2Reset`.
    pub fn reset(&self) -> fmi2Status {
        // SAFETY: the instance is live.
        unsafe { call!(fmi2Reset: fmi2ResetTYPE(self.component)) }
    }

    /// `fmi2SetDebugLogging`.
    pub fn set_logging(&self, on: bool, categories: &[&str]) -> fmi2Status {
        let categories: Vec<_> = categories.iter().map(|name| text(name)).collect();
        let pointers: Vec<_> = categories.iter().map(|name| name.as_ptr()).collect();
        let (first, count) = (pointers.as_ptr(), pointers.len());
        // SAFETY: the instance is live; the array and its texts live until the call returns.
        unsafe { call!(fmi2SetDebugLogging: fmi2SetDebugLoggingTYPE(self.component, i32::from(on), count, first)) }
    }

    /// `fmi2GetFMUstate` into this pointer.
    pub fn get_state(&self, state: &mut fmi2FMUstate) -> fmi2Status {
        // SAFETY: the instance is live; the pointer is null or a snapshot of this library's.
        unsafe { call!(fmi2GetFMUstate: fmi2GetFMUstateTYPE(self.component, state)) }
    }

    /// `fmi2SetFMUstate`.
    pub fn set_state(&self, state: fmi2FMUstate) -> fmi2Status {
        // SAFETY: the instance is live; the pointer is null or a snapshot of this library's.
        unsafe { call!(fmi2SetFMUstate: fmi2SetFMUstateTYPE(self.component, state)) }
    }

    /// `fmi2FreeFMUstate`.
    pub fn free_state(&self, state: &mut fmi2FMUstate) -> fmi2Status {
        // SAFETY: the instance is live; the pointer is null or a snapshot of this library's.
        unsafe { call!(fmi2FreeFMUstate: fmi2FreeFMUstateTYPE(self.component, state)) }
    }

    /// `fmi2SerializedFMUstateSize` and `fmi2SerializeFMUstate`.
    pub fn serialize(&self, state: fmi2FMUstate) -> Result<Vec<u8>, fmi2Status> {
        let mut size = 0;
        // SAFETY: the instance is live; the pointer is null or a snapshot of this library's.
        let status = unsafe {
            call!(fmi2SerializedFMUstateSize: fmi2SerializedFMUstateSizeTYPE(self.component, state, &raw mut size))
        };
        if status != fmi2Status::fmi2OK {
            return Err(status);
        }
        let mut bytes = vec![0_u8; size];
        let first = bytes.as_mut_ptr().cast();
        // SAFETY: as above; there are as many bytes as stated.
        let status =
            unsafe { call!(fmi2SerializeFMUstate: fmi2SerializeFMUstateTYPE(self.component, state, first, size)) };
        if status == fmi2Status::fmi2OK { Ok(bytes) } else { Err(status) }
    }

    /// `fmi2DeSerializeFMUstate`.
    pub fn deserialize(&self, bytes: &[u8], state: &mut fmi2FMUstate) -> fmi2Status {
        let (first, size) = (bytes.as_ptr().cast(), bytes.len());
        // SAFETY: the instance is live; there are as many bytes as stated; the pointer may be written.
        unsafe { call!(fmi2DeSerializeFMUstate: fmi2DeSerializeFMUstateTYPE(self.component, first, size, state)) }
    }

    /// `fmi2GetRealStatus`.
    pub fn real_status(&self, kind: fmi2StatusKind) -> Result<f64, fmi2Status> {
        let mut value = f64::NAN;
        // SAFETY: the instance is live; the value can be written.
        let status = unsafe { call!(fmi2GetRealStatus: fmi2GetRealStatusTYPE(self.component, kind, &raw mut value)) };
        if status == fmi2Status::fmi2OK { Ok(value) } else { Err(status) }
    }

    /// `fmi2GetDirectionalDerivative`.
    pub fn directional_derivative(
        &self,
        unknowns: &[fmi2ValueReference],
        knowns: &[fmi2ValueReference],
        direction: &[f64],
    ) -> Result<Vec<f64>, fmi2Status> {
        assert_eq!(knowns.len(), direction.len());
        let mut derivatives = vec![f64::NAN; unknowns.len()];
        // SAFETY: the instance is live; all arrays are as long as stated.
        let status = unsafe {
            call!(fmi2GetDirectionalDerivative: fmi2GetDirectionalDerivativeTYPE(
                self.component,
                unknowns.as_ptr(),
                unknowns.len(),
                knowns.as_ptr(),
                knowns.len(),
                direction.as_ptr(),
                derivatives.as_mut_ptr(),
            ))
        };
        if status == fmi2Status::fmi2OK { Ok(derivatives) } else { Err(status) }
    }

    /// `fmi2SetRealInputDerivatives`.
    pub fn set_input_derivatives(
        &self,
        references: &[fmi2ValueReference],
        orders: &[i32],
        values: &[f64],
    ) -> fmi2Status {
        assert!(references.len() == orders.len() && references.len() == values.len());
        // SAFETY: the instance is live; all arrays are as long as stated.
        unsafe {
            call!(fmi2SetRealInputDerivatives: fmi2SetRealInputDerivativesTYPE(
                self.component,
                references.as_ptr(),
                references.len(),
                orders.as_ptr(),
                values.as_ptr(),
            ))
        }
    }

    /// `fmi2GetRealOutputDerivatives`.
    pub fn output_derivatives(
        &self,
        references: &[fmi2ValueReference],
        orders: &[i32],
    ) -> Result<Vec<f64>, fmi2Status> {
        assert_eq!(references.len(), orders.len());
        let mut values = vec![f64::NAN; references.len()];
        // SAFETY: the instance is live; all arrays are as long as stated.
        let status = unsafe {
            call!(fmi2GetRealOutputDerivatives: fmi2GetRealOutputDerivativesTYPE(
                self.component,
                references.as_ptr(),
                references.len(),
                orders.as_ptr(),
                values.as_mut_ptr(),
            ))
        };
        if status == fmi2Status::fmi2OK { Ok(values) } else { Err(status) }
    }
}

/// Statuses in tests.
pub trait Expect {
    /// Asserts fmi2OK; a failure shows the messages of the instance.
    #[track_caller]
    fn ok(self, fmu: &Fmu);
    /// Asserts fmi2Error and exactly one message of that status, with the category `logStatusError`; returns its text.
    #[track_caller]
    fn error(self, fmu: &Fmu) -> String;
}

impl Expect for fmi2Status {
    fn ok(self, fmu: &Fmu) {
        assert_eq!(self, Self::fmi2OK, "{:?}", fmu.take_messages());
    }

    fn error(self, fmu: &Fmu) -> String {
        let messages = fmu.take_messages();
        assert_eq!(self, Self::fmi2Error, "{messages:?}");
        let errors: Vec<_> = messages.iter().filter(|message| message.status == Self::fmi2Error).collect();
        let [message] = errors[..] else { panic!("expected one message: {messages:?}") };
        assert_eq!(message.category, "logStatusError");
        message.text.clone()
    }
}
