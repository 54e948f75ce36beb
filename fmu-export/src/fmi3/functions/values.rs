//! Reading and writing variables.

use std::borrow::Cow;

use super::Component;
use crate::fmi3::bindings::*;
use crate::fmi3::sequence::Function;
use crate::instance::AccessError;
use crate::interface::arguments::{CValue, boolean, elements, elements_mut, finite_result, text_value};
use crate::interface::c_functions;
use crate::interface::component::{Outcome, Problem};
use crate::interface::guard::enter;
use crate::variable::{Type, Value};

/// The indices of the variables of value references, for an array those of all its elements; `count` is the number of their values.
pub(super) fn indices_of<'r>(
    component: &Component,
    references: &'r [fmi3ValueReference],
    name: &str,
    count: usize,
) -> Result<Cow<'r, [u32]>, Problem> {
    let Some(elements) = &component.options.elements else {
        return if count == references.len() {
            Ok(Cow::Borrowed(references))
        } else {
            Err(wrong_count(name, count, references.len()))
        };
    };
    // At most the importer's number of values, whatever the references.
    let mut indices = Vec::with_capacity(references.len().max(count).min(elements.len()));
    for reference in references {
        let size = size_of_variable(component, *reference);
        if size == 0 {
            return Err(Problem::Call(format!(
                "value reference {reference} is not that of a variable but lies within an array, as {}",
                component.name_of(*reference)
            )));
        }
        indices.extend((0..size as u32).map(|at| reference.saturating_add(at)));
    }
    if indices.len() == count { Ok(Cow::Owned(indices)) } else { Err(wrong_count(name, count, indices.len())) }
}

/// The number of values of a variable.
pub(super) fn size_of_variable(component: &Component, reference: fmi3ValueReference) -> usize {
    let elements = component.options.elements.as_ref();
    elements.and_then(|elements| elements.get(reference as usize)).map_or(1, |size| *size as usize)
}

fn wrong_count(name: &str, found: usize, wanted: usize) -> Problem {
    Problem::Call(format!("{name} = {found} is refused: the value references stand for {wanted} values"))
}

/// The type of FMI 3.0 as which variables are read and written.
fn type_name(data_type: &Type) -> &'static str {
    match data_type {
        Type::Real { .. } => "Float64",
        Type::Integer { .. } => "Int32",
        Type::Enumeration { .. } => "Int64",
        Type::Boolean { .. } => "Boolean",
        Type::String { .. } => "String",
    }
}

/// Whether a variable is of the type that a function reads or writes.
fn check(component: &Component, index: u32, asked: &str) -> Outcome {
    let variables = component.model.variables();
    let (name, found) = match variables.get(index as usize) {
        Some(variable) => (variable.name.as_ref(), type_name(&variable.data_type)),
        None if index as usize == variables.len() => ("time", "Float64"),
        None => return Err(Problem::call(AccessError::Unknown(index as usize))),
    };
    if found == asked {
        return Ok(());
    }
    // Only enumerations have this type.
    let found = if found == "Int64" { "Enumeration (Int64)" } else { found };
    Err(Problem::Call(format!("{name} is not of type {asked} but {found}")))
}

/// Value references and their number, as passed by the importer.
type References = (*const fmi3ValueReference, usize);

/// Reads the variables of one type.
///
/// # Safety
/// As for all functions of this module.
unsafe fn get<T: CValue>(
    instance: fmi3Instance,
    function: Function,
    (references, count): References,
    (values, n_values): (*mut T, usize),
    read: impl Fn(&mut Component, u32) -> Result<T, Problem>,
) -> fmi3Status {
    let body = |component: &mut Component| {
        // SAFETY: the arrays meet the contract of the exported function.
        let (references, values) =
            unsafe { (elements("valueReferences", references, count)?, elements_mut("values", values, n_values)?) };
        let indices = indices_of(component, references, "nValues", n_values)?;
        let done = T::read(component, &indices, values);
        for (index, value) in indices.iter().zip(values).skip(done) {
            *value = read(component, *index)?;
        }
        Ok(())
    };
    // SAFETY: the instance meets the contract of the exported function.
    unsafe { enter(instance, function, body) }
}

/// Reads a variable of one type.
fn value<T: TryFrom<Value>>(component: &mut Component, index: u32, asked: &str) -> Result<T, Problem> {
    check(component, index, asked)?;
    let found = component.instance.get(index as usize).map_err(Problem::call)?;
    // A value whose type differs from that in the table is a defect.
    T::try_from(found).map_err(|_| Problem::Run(format!("{} has a value of another type", component.name_of(index))))
}

/// Reads a Float64 variable, or the time.
fn float(component: &mut Component, index: u32) -> Result<f64, Problem> {
    if index as usize == component.model.variables().len() {
        return Ok(component.instance.time_s());
    }
    let value = value(component, index, "Float64")?;
    finite_result(component, index, value)
}

/// Writes the variables of one type: all of them, or none if one is refused.
///
/// # Safety
/// As for all functions of this module.
unsafe fn set<T: CValue + Copy>(
    instance: fmi3Instance,
    function: Function,
    (references, count): References,
    (values, n_values): (*const T, usize),
    asked: &str,
    wrap: impl Fn(T) -> Result<Value, String>,
) -> fmi3Status {
    let body = |component: &mut Component| {
        // SAFETY: the arrays meet the contract of the exported function.
        let (references, values) =
            unsafe { (elements("valueReferences", references, count)?, elements("values", values, n_values)?) };
        let indices = indices_of(component, references, "nValues", n_values)?;
        if T::write(component, &indices, values) {
            return Ok(());
        }
        for (index, value) in indices.iter().zip(values) {
            if *index as usize == component.model.variables().len() {
                return Err(Problem::call("time cannot be set: it follows from the steps"));
            }
            check(component, *index, asked)?;
            wrap(*value).map_err(|why| Problem::Call(format!("{}: {why}", component.name_of(*index))))?;
        }
        let setting = |at: usize| (indices[at] as usize, wrap(values[at]).expect("all values were checked"));
        component.instance.set_all(indices.len(), &setting).map_err(Problem::call)
    };
    // SAFETY: the instance meets the contract of the exported function.
    unsafe { enter(instance, function, body) }
}

/// Refuses every variable, because no model has any of that type; an empty list is no error.
///
/// # Safety
/// As for all functions of this module.
unsafe fn none_of(
    instance: fmi3Instance,
    function: Function,
    (references, count): References,
    asked: &str,
) -> fmi3Status {
    let body = |component: &mut Component| {
        // SAFETY: the array meets the contract of the exported function.
        let references = unsafe { elements("valueReferences", references, count)? };
        references.iter().try_for_each(|index| check(component, *index, asked))
    };
    // SAFETY: the instance meets the contract of the exported function.
    unsafe { enter(instance, function, body) }
}

c_functions! {
    /// Reads String variables. The texts stay valid until the next call on the instance.
    fn fmi3GetString: fmi3GetStringTYPE(
        instance: fmi3Instance,
        valueReferences: *const fmi3ValueReference,
        nValueReferences: usize,
        values: *mut fmi3String,
        nValues: usize,
    ) -> fmi3Status {
        let body = |component: &mut Component| {
            // SAFETY: the arrays meet this module's contract.
            let (references, values) = unsafe {
                (elements("valueReferences", valueReferences, nValueReferences)?, elements_mut("values", values, nValues)?)
            };
            let indices = indices_of(component, references, "nValues", nValues)?;
            indices.iter().try_for_each(|index| check(component, *index, "String"))?;
            component.read_texts(&indices, values)
        };
        // SAFETY: the instance meets this module's contract.
        unsafe { enter(instance, Function::GetString, body) }
    }
}

/// Functions that read or write the variables of one type, by [`get`] or [`set`].
macro_rules! accessors {
    ($($about:literal $name:ident: $type:ident = $function:ident($of:ty), $way:ident($($how:expr),+);)*) => {
        c_functions! {$(
            #[doc = $about]
            fn $name: $type(
                instance: fmi3Instance,
                valueReferences: *const fmi3ValueReference,
                nValueReferences: usize,
                values: $of,
                nValues: usize,
            ) -> fmi3Status {
                let references = (valueReferences, nValueReferences);
                // SAFETY: all arguments, the texts among them, meet this module's contract.
                unsafe { $way(instance, Function::$function, references, (values, nValues), $($how),+) }
            }
        )*}
    };
}

accessors! {
    "Reads Float64 variables, the time among them."
    fmi3GetFloat64: fmi3GetFloat64TYPE = GetFloat64(*mut fmi3Float64), get(float);
    "Reads Int32 variables."
    fmi3GetInt32: fmi3GetInt32TYPE = GetInt32(*mut fmi3Int32), get(|component, index| value(component, index, "Int32"));
    "Reads Enumeration variables."
    fmi3GetInt64: fmi3GetInt64TYPE = GetInt64(*mut fmi3Int64),
        get(|component, index| value::<i32>(component, index, "Int64").map(i64::from));
    "Reads Boolean variables."
    fmi3GetBoolean: fmi3GetBooleanTYPE = GetBoolean(*mut fmi3Boolean),
        get(|component, index| value::<bool>(component, index, "Boolean").map(fmi3Boolean::from));
    "Writes Float64 variables: all of them, or none if one is refused. Values that are not finite are refused where they are\n\
     used: a parameter at the end of initialization. An input may be missing, like a sensor's reading: the model decides."
    fmi3SetFloat64: fmi3SetFloat64TYPE = SetFloat64(*const fmi3Float64), set("Float64", |value| Ok(Value::Real(value)));
    "Writes Int32 variables: all of them, or none if one is refused."
    fmi3SetInt32: fmi3SetInt32TYPE = SetInt32(*const fmi3Int32), set("Int32", |value| Ok(Value::Integer(value)));
    "Writes Enumeration variables: all of them, or none if one is refused."
    fmi3SetInt64: fmi3SetInt64TYPE = SetInt64(*const fmi3Int64), set("Int64", item);
    "Writes Boolean variables: all of them, or none if one is refused."
    fmi3SetBoolean: fmi3SetBooleanTYPE = SetBoolean(*const fmi3Boolean),
        set("Boolean", |value| boolean(value, "fmi3"));
    "Writes String variables, in UTF-8: all of them, or none if one is refused."
    fmi3SetString: fmi3SetStringTYPE = SetString(*const fmi3String), set("String", |value| text_value(value));
}

fn item(value: fmi3Int64) -> Result<Value, String> {
    let item = i32::try_from(value).map_err(|_| format!("{value} is refused: expected an item of the enumeration"));
    item.map(Value::Integer)
}

/// Functions for the types that no model has.
macro_rules! other_types {
    ($($name:ident: $type:ident = $function:ident($($argument:ident: $of:ty),*), $asked:literal;)*) => {
        c_functions! {$(
            #[doc = concat!("No variable is of type ", $asked, ".")]
            fn $name: $type(
                instance: fmi3Instance,
                valueReferences: *const fmi3ValueReference,
                nValueReferences: usize,
                $($argument: $of),*
            ) -> fmi3Status {
                // SAFETY: all arguments meet this module's contract.
                unsafe { none_of(instance, Function::$function, (valueReferences, nValueReferences), $asked) }
            }
        )*}
    };
}

other_types! {
    fmi3GetFloat32: fmi3GetFloat32TYPE = GetFloat32(_values: *mut fmi3Float32, _nValues: usize), "Float32";
    fmi3GetInt8: fmi3GetInt8TYPE = GetInt8(_values: *mut fmi3Int8, _nValues: usize), "Int8";
    fmi3GetUInt8: fmi3GetUInt8TYPE = GetUInt8(_values: *mut fmi3UInt8, _nValues: usize), "UInt8";
    fmi3GetInt16: fmi3GetInt16TYPE = GetInt16(_values: *mut fmi3Int16, _nValues: usize), "Int16";
    fmi3GetUInt16: fmi3GetUInt16TYPE = GetUInt16(_values: *mut fmi3UInt16, _nValues: usize), "UInt16";
    fmi3GetUInt32: fmi3GetUInt32TYPE = GetUInt32(_values: *mut fmi3UInt32, _nValues: usize), "UInt32";
    fmi3GetUInt64: fmi3GetUInt64TYPE = GetUInt64(_values: *mut fmi3UInt64, _nValues: usize), "UInt64";
    fmi3GetBinary: fmi3GetBinaryTYPE = GetBinary(_valueSizes: *mut usize, _values: *mut fmi3Binary, _nValues: usize), "Binary";
    fmi3GetClock: fmi3GetClockTYPE = GetClock(_values: *mut fmi3Clock), "Clock";
    fmi3SetFloat32: fmi3SetFloat32TYPE = SetFloat32(_values: *const fmi3Float32, _nValues: usize), "Float32";
    fmi3SetInt8: fmi3SetInt8TYPE = SetInt8(_values: *const fmi3Int8, _nValues: usize), "Int8";
    fmi3SetUInt8: fmi3SetUInt8TYPE = SetUInt8(_values: *const fmi3UInt8, _nValues: usize), "UInt8";
    fmi3SetInt16: fmi3SetInt16TYPE = SetInt16(_values: *const fmi3Int16, _nValues: usize), "Int16";
    fmi3SetUInt16: fmi3SetUInt16TYPE = SetUInt16(_values: *const fmi3UInt16, _nValues: usize), "UInt16";
    fmi3SetUInt32: fmi3SetUInt32TYPE = SetUInt32(_values: *const fmi3UInt32, _nValues: usize), "UInt32";
    fmi3SetUInt64: fmi3SetUInt64TYPE = SetUInt64(_values: *const fmi3UInt64, _nValues: usize), "UInt64";
    fmi3SetBinary: fmi3SetBinaryTYPE = SetBinary(_valueSizes: *const usize, _values: *const fmi3Binary, _nValues: usize), "Binary";
    fmi3SetClock: fmi3SetClockTYPE = SetClock(_values: *const fmi3Clock), "Clock";
}
