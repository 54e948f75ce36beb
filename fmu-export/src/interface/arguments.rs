//! Arguments of calls: arrays, strings, numbers.

use std::ffi::{CStr, c_char};

use super::Interface;
use super::component::{Component, Outcome, Problem};
use crate::variable::Value;

/// The elements of an array passed by the importer.
///
/// # Safety
/// `first` is null or points to `length` elements that stay valid and unchanged until the call returns.
pub(crate) unsafe fn elements<'a, T>(name: &str, first: *const T, length: usize) -> Result<&'a [T], Problem> {
    check_array::<T>(name, first.is_null(), length)?;
    if length == 0 {
        return Ok(&[]);
    }
    // SAFETY: the pointer is not null, and by this function's contract the elements exist; the length was checked.
    Ok(unsafe { std::slice::from_raw_parts(first, length) })
}

/// The elements of an array to be filled for the importer.
///
/// # Safety
/// `first` is null or points to `length` elements that are not used elsewhere until the call returns.
pub(crate) unsafe fn elements_mut<'a, T>(name: &str, first: *mut T, length: usize) -> Result<&'a mut [T], Problem> {
    check_array::<T>(name, first.is_null(), length)?;
    if length == 0 {
        return Ok(&mut []);
    }
    // SAFETY: the pointer is not null, and by this function's contract the elements exist; the length was checked.
    Ok(unsafe { std::slice::from_raw_parts_mut(first, length) })
}

fn check_array<T>(name: &str, null: bool, length: usize) -> Outcome {
    if length > isize::MAX as usize / size_of::<T>() {
        return Err(Problem::Call(format!("{name} cannot have {length} elements: that is more than memory can hold")));
    }
    if null && length > 0 {
        return Err(Problem::Call(format!("{name} is null: expected an array of {length} elements")));
    }
    Ok(())
}

/// A string passed by the importer.
///
/// # Safety
/// `text` is null or ends with a zero byte and stays valid and unchanged until the call returns.
pub(crate) unsafe fn text<'a>(text: *const c_char) -> Option<&'a CStr> {
    // SAFETY: the pointer is not null, and by this function's contract the text ends with a zero byte.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) })
}

/// A C type of values. Importers pass Real numbers at every step, so these have a fast path for many at once.
pub(crate) trait CValue: Sized {
    /// Reads variables until one needs the general path; returns the number of values read.
    fn read<I: Interface>(_: &mut Component<I>, _indices: &[u32], _values: &mut [Self]) -> usize {
        0
    }

    /// Writes all variables, or none if one needs the general path; returns whether it wrote them.
    fn write<I: Interface>(_: &mut Component<I>, _indices: &[u32], _values: &[Self]) -> bool {
        false
    }
}

impl CValue for f64 {
    fn read<I: Interface>(component: &mut Component<I>, indices: &[u32], values: &mut [Self]) -> usize {
        component.instance.get_reals(indices, values)
    }

    fn write<I: Interface>(component: &mut Component<I>, indices: &[u32], values: &[Self]) -> bool {
        component.instance.set_reals(indices, values)
    }
}

impl CValue for i32 {}
impl CValue for i64 {}
impl CValue for u8 {}
impl CValue for *const c_char {}

/// The value of a string passed by the importer.
///
/// # Safety
/// As for [`text`].
pub(crate) unsafe fn text_value(value: *const c_char) -> Result<Value, String> {
    // SAFETY: by this function's contract.
    let text = unsafe { text(value) }.ok_or("a null pointer is refused: expected a string")?;
    let text = text.to_str().map_err(|_| "the string is refused: expected UTF-8")?;
    Ok(Value::String(text.to_owned()))
}

/// The value of a Boolean passed as a number; `standard` begins the names of its two values.
pub(crate) fn boolean(value: impl Into<i32>, standard: &str) -> Result<Value, String> {
    match value.into() {
        0 => Ok(Value::Boolean(false)),
        1 => Ok(Value::Boolean(true)),
        other => Err(format!("{other} is refused: expected {standard}False (0) or {standard}True (1)")),
    }
}

/// The place for a single value.
///
/// # Safety
/// As for [`elements_mut`].
pub(crate) unsafe fn element_mut<'a, T>(name: &str, place: *mut T) -> Result<&'a mut T, Problem> {
    // SAFETY: by this function's contract.
    unsafe { elements_mut(name, place, 1) }.map(|elements| &mut elements[0])
}

/// Returns a number if it is finite: a step, or large inputs, can have other results.
pub(crate) fn finite_result<I: Interface>(
    component: &Component<I>,
    reference: u32,
    value: f64,
) -> Result<f64, Problem> {
    if value.is_finite() {
        return Ok(value);
    }
    let name = component.name_of(reference);
    Err(Problem::Call(format!("{name}: the model computes {value}, and only finite numbers are returned")))
}

/// Refuses NaN and infinity.
pub(crate) fn finite(value: f64) -> Result<f64, String> {
    if value.is_finite() { Ok(value) } else { Err(format!("{value} is refused: expected a finite number")) }
}
