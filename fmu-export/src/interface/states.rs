//! Snapshots as the importer handles them: taken, restored, freed, serialized.

use std::ffi::c_void;

use super::Interface;
use super::arguments::{element_mut, elements, elements_mut};
use super::component::{Component, Outcome, Problem};
use super::snapshot::Snapshot;

/// A snapshot that the importer got from this library.
///
/// # Safety
/// The pointer is null or came from [`get`] or [`deserialize`] and was not freed since; the snapshot does not change while the
/// result is in use. Others may read it: several instances can restore one snapshot at the same time.
unsafe fn snapshot<'a>(state: *mut c_void) -> Result<&'a Snapshot, Problem> {
    // SAFETY: a pointer that is not null is, by this function's contract, a live snapshot that does not change.
    unsafe { state.cast::<Snapshot>().as_ref() }.ok_or_else(|| Problem::call("FMUstate is null: expected a snapshot"))
}

/// Takes a snapshot, into an existing one if there is one.
///
/// # Safety
/// `place` is null or can be written, and holds null or a live snapshot that no other call uses.
pub(crate) unsafe fn get<I: Interface>(component: &Component<I>, place: *mut *mut c_void) -> Outcome {
    // SAFETY: by this function's contract.
    let place = unsafe { element_mut("FMUstate", place)? };
    if place.is_null() {
        *place = Box::into_raw(Box::new(component.save()?)).cast();
        return Ok(());
    }
    // SAFETY: the pointer is a live snapshot, which is written here and so, by contract, used by no other call.
    component.save_over(unsafe { &mut *place.cast::<Snapshot>() })
}

/// Restores a snapshot.
///
/// # Safety
/// As for [`snapshot`].
pub(crate) unsafe fn set<I: Interface>(component: &mut Component<I>, state: *mut c_void) -> Outcome {
    // SAFETY: by this function's contract.
    component.restore(unsafe { snapshot(state)? })
}

/// Frees a snapshot and sets the pointer to null; a null pointer is ignored.
///
/// # Safety
/// `place` is null or can be written, and holds null or a live snapshot that is not used again.
pub(crate) unsafe fn free(place: *mut *mut c_void) -> Outcome {
    if place.is_null() {
        return Ok(());
    }
    // SAFETY: by this function's contract.
    let place = unsafe { element_mut("FMUstate", place)? };
    let state = std::mem::replace(place, std::ptr::null_mut());
    if !state.is_null() {
        // SAFETY: a live snapshot, made by `Box::into_raw`, which the importer does not use again.
        drop(unsafe { Box::from_raw(state.cast::<Snapshot>()) });
    }
    Ok(())
}

/// Writes the size of a serialized snapshot, in bytes.
///
/// # Safety
/// `state` as for [`snapshot`]; `size` is null or can be written.
pub(crate) unsafe fn size(state: *mut c_void, size: *mut usize) -> Outcome {
    // SAFETY: by this function's contract.
    let (snapshot, size) = unsafe { (snapshot(state)?, element_mut("size", size)?) };
    *size = snapshot.write()?.len();
    Ok(())
}

/// Serializes a snapshot. Bytes beyond its size are not changed.
///
/// # Safety
/// `state` as for [`snapshot`]; `first` is null or points to `size` bytes that can be written.
pub(crate) unsafe fn serialize(state: *mut c_void, first: *mut u8, size: usize) -> Outcome {
    // SAFETY: by this function's contract.
    let (snapshot, room) = unsafe { (snapshot(state)?, elements_mut("serializedState", first, size)?) };
    let bytes = snapshot.write()?;
    let room = room
        .get_mut(..bytes.len())
        .ok_or_else(|| Problem::Call(format!("size = {size} is refused: the snapshot has {} bytes", bytes.len())))?;
    room.copy_from_slice(&bytes);
    Ok(())
}

/// Makes a new snapshot from bytes serialized by this process or another. Bytes of another model or version, and truncated or
/// changed bytes, are refused.
///
/// # Safety
/// `first` is null or points to `size` bytes; `place` is null or can be written.
pub(crate) unsafe fn deserialize<I: Interface>(
    component: &Component<I>,
    first: *const u8,
    size: usize,
    place: *mut *mut c_void,
) -> Outcome {
    // SAFETY: by this function's contract.
    let (bytes, place) = unsafe { (elements("serializedState", first, size)?, element_mut("FMUstate", place)?) };
    let snapshot = Snapshot::read(&component.model, &component.resources, bytes).map_err(Problem::Call)?;
    *place = Box::into_raw(Box::new(snapshot)).cast();
    Ok(())
}
