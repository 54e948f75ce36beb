//! Reading and writing variables.

use super::Component;
use crate::fmi2::bindings::*;
use crate::fmi2::sequence::Function;
use crate::interface::arguments::{CValue, boolean, elements, elements_mut, finite_result, text_value};
use crate::interface::c_functions;
use crate::interface::component::Problem;
use crate::interface::guard::enter;
use crate::variable::Value;

/// Reads the variables of one type.
///
/// # Safety
/// As for all functions of this module.
unsafe fn get<T: CValue>(
    component: fmi2Component,
    function: Function,
    (references, count): (*const fmi2ValueReference, usize),
    values: *mut T,
    take: impl Fn(Value) -> Result<T, Value>,
    type_name: &str,
) -> fmi2Status {
    let body = |component: &mut Component| {
        // SAFETY: the arrays meet the contract of the exported function.
        let (references, values) =
            unsafe { (elements("vr", references, count)?, elements_mut("value", values, count)?) };
        let read = T::read(component, references, values);
        for (reference, value) in references.iter().zip(values).skip(read) {
            let found = component.instance.get(*reference as usize).map_err(Problem::call)?;
            if let Value::Real(number) = found {
                finite_result(component, *reference, number)?;
            }
            *value = take(found).map_err(|found| component.wrong_type(*reference, type_name, &found))?;
        }
        Ok(())
    };
    // SAFETY: the component meets the contract of the exported function.
    unsafe { enter(component, function, body) }
}

/// Writes the variables of one type: all of them, or none if one is refused.
///
/// # Safety
/// As for all functions of this module.
unsafe fn set<T: CValue + Copy>(
    component: fmi2Component,
    function: Function,
    (references, count): (*const fmi2ValueReference, usize),
    values: *const T,
    wrap: impl Fn(T) -> Result<Value, String>,
) -> fmi2Status {
    let body = |component: &mut Component| {
        // SAFETY: the arrays meet the contract of the exported function.
        let (references, values) = unsafe { (elements("vr", references, count)?, elements("value", values, count)?) };
        if T::write(component, references, values) {
            return Ok(());
        }
        for (reference, value) in references.iter().zip(values) {
            wrap(*value).map_err(|why| Problem::Call(format!("{}: {why}", component.name_of(*reference))))?;
        }
        let setting = |at: usize| (references[at] as usize, wrap(values[at]).expect("all values were checked"));
        component.instance.set_all(count, &setting).map_err(Problem::call)
    };
    // SAFETY: the component meets the contract of the exported function.
    unsafe { enter(component, function, body) }
}

c_functions! {
    /// Reads String variables. The texts stay valid until the next call on the instance.
    fn fmi2GetString: fmi2GetStringTYPE(
        c: fmi2Component,
        vr: *const fmi2ValueReference,
        nvr: usize,
        value: *mut fmi2String,
    ) -> fmi2Status {
        let body = |component: &mut Component| {
            // SAFETY: the arrays meet this module's contract.
            let (references, values) = unsafe { (elements("vr", vr, nvr)?, elements_mut("value", value, nvr)?) };
            component.read_texts(references, values)
        };
        // SAFETY: the component meets this module's contract.
        unsafe { enter(c, Function::GetString, body) }
    }
}

/// Functions that read or write the variables of one type, by [`get`] or [`set`].
macro_rules! accessors {
    ($($about:literal $name:ident: $type:ident = $function:ident($of:ty), $way:ident($($how:expr),+);)*) => {
        c_functions! {$(
            #[doc = $about]
            fn $name: $type(c: fmi2Component, vr: *const fmi2ValueReference, nvr: usize, value: $of) -> fmi2Status {
                // SAFETY: all arguments, the texts among them, meet this module's contract.
                unsafe { $way(c, Function::$function, (vr, nvr), value, $($how),+) }
            }
        )*}
    };
}

accessors! {
    "Reads Real variables." fmi2GetReal: fmi2GetRealTYPE = GetReal(*mut fmi2Real), get(f64::try_from, "Real");
    "Reads Integer and Enumeration variables."
    fmi2GetInteger: fmi2GetIntegerTYPE = GetInteger(*mut fmi2Integer), get(i32::try_from, "Integer");
    "Reads Boolean variables."
    fmi2GetBoolean: fmi2GetBooleanTYPE = GetBoolean(*mut fmi2Boolean),
        get(|value| bool::try_from(value).map(fmi2Boolean::from), "Boolean");
    "Writes Real variables: all of them, or none if one is refused. Values that are not finite are refused where they are\n\
     used: a parameter at the end of initialization. An input may be missing, like a sensor's reading: the model decides."
    fmi2SetReal: fmi2SetRealTYPE = SetReal(*const fmi2Real), set(|value| Ok(Value::Real(value)));
    "Writes Integer and Enumeration variables: all of them, or none if one is refused."
    fmi2SetInteger: fmi2SetIntegerTYPE = SetInteger(*const fmi2Integer), set(|value| Ok(Value::Integer(value)));
    "Writes Boolean variables: all of them, or none if one is refused."
    fmi2SetBoolean: fmi2SetBooleanTYPE = SetBoolean(*const fmi2Boolean), set(|value| boolean(value, "fmi2"));
    "Writes String variables, in UTF-8: all of them, or none if one is refused."
    fmi2SetString: fmi2SetStringTYPE = SetString(*const fmi2String), set(|value| text_value(value));
}
