//! The entry guard: every call of an importer on an instance passes it.

use std::any::Any;
use std::cell::UnsafeCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};

use super::bindings::{fmi2Component, fmi2Status};
use super::component::{Component, Outcome, Problem};
use super::logger::Category;
use super::sequence::{Function, State};

/// What `fmi2Component` points to: an instance, and whether a call on it is in progress.
///
/// The standard forbids a second call meanwhile, and yet loggers call back into the instance that speaks, and importers
/// share instances between threads. Such a call is refused instead of finding the instance in the middle of a change.
struct Guarded {
    busy: AtomicBool,
    component: UnsafeCell<Component>,
}

impl Guarded {
    /// Begins a call, unless one is in progress.
    fn begin(&self) -> Option<Call<'_>> {
        // Made only if no call is in progress, because its end lets the next call in.
        (!self.busy.swap(true, Ordering::Acquire)).then(|| Call(self))
    }
}

/// A call in progress; its end lets the next one in.
struct Call<'g>(&'g Guarded);

impl Call<'_> {
    fn component(&mut self) -> &mut Component {
        // SAFETY: `busy` lets one call exist at a time, and only a call reaches the component.
        unsafe { &mut *self.0.component.get() }
    }
}

impl Drop for Call<'_> {
    fn drop(&mut self) {
        self.0.busy.store(false, Ordering::Release);
    }
}

/// What an importer holds of a new instance.
pub(super) fn hand_out(component: Component) -> fmi2Component {
    let guarded = Guarded { busy: AtomicBool::new(false), component: UnsafeCell::new(component) };
    Box::into_raw(Box::new(guarded)).cast()
}

/// Ends an instance. One in the middle of a call, whose logger asks for its end, is left behind: the call goes on with it.
///
/// # Safety
/// `component` is null or was made by [`hand_out`], and is not used again.
pub(super) unsafe fn take_back(component: fmi2Component) {
    let guarded = component.cast::<Guarded>();
    // SAFETY: a pointer that is not null is, by this function's contract, a live instance.
    let Some(busy) = (unsafe { guarded.as_ref() }).map(|guarded| guarded.busy.swap(true, Ordering::Acquire)) else {
        return;
    };
    if !busy {
        // SAFETY: `hand_out` made the pointer of a box; no call is in progress, and by contract none follows.
        let guarded = unsafe { Box::from_raw(guarded) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(guarded)));
    }
}

/// Lets one call in: checks the instance and the sequence of calls, carries the call out, and answers with a status. A
/// problem becomes fmi2Error with a message; so does a panic, after which the run cannot go on before a reset.
///
/// # Safety
/// `component` is null or was made by [`hand_out`], and was not taken back since.
pub(super) unsafe fn enter(
    component: fmi2Component,
    function: Function,
    body: impl FnOnce(&mut Component) -> Outcome,
) -> fmi2Status {
    // SAFETY: a pointer that is not null is, by this function's contract, a live instance.
    let guarded = unsafe { component.cast::<Guarded>().as_ref() };
    let Some(mut call) = guarded.and_then(Guarded::begin) else {
        // Nobody can be told: the logger belongs to the instance, and may be what called.
        return fmi2Status::fmi2Error;
    };
    let component = call.component();
    let outcome = if function.allowed_in(component.stage.state) {
        // After a panic the values may be any, and can be looked at; a second panic ends here as well. No step is done
        // with them: the state `error` is left by a reset or by a snapshot, which replace them all.
        catch_unwind(AssertUnwindSafe(|| body(component))).unwrap_or_else(|panic| {
            Err(Problem::Run(format!(
                "a defect of this FMU, please report it: {}; it can be used again after fmi2Reset",
                words(panic.as_ref())
            )))
        })
    } else {
        Err(Problem::Call(format!(
            "not allowed in the state `{}`; allowed in: {}",
            component.stage.state,
            function.where_allowed()
        )))
    };
    let text = match outcome {
        Ok(()) => return fmi2Status::fmi2OK,
        Err(Problem::Call(text)) => text,
        Err(Problem::Run(text)) => {
            component.stage.state = State::Error;
            text
        }
    };
    component.logger.send(fmi2Status::fmi2Error, Category::StatusError, format_args!("{}: {text}", function.name()));
    fmi2Status::fmi2Error
}

/// What a panic said.
fn words(panic: &(dyn Any + Send)) -> &str {
    panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("a panic without words")
}
