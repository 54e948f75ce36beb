//! The entry guard: every call on an instance passes it.

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
/// The standard forbids concurrent calls, and yet loggers call back into their instance, and importers share instances between
/// threads. Such a call is refused, so that it cannot see an instance in the middle of a change.
struct Guarded {
    busy: AtomicBool,
    component: UnsafeCell<Component>,
}

impl Guarded {
    /// Begins a call, unless one is in progress.
    fn begin(&self) -> Option<Call<'_>> {
        // Constructed only if no call is in progress, because its end admits the next call.
        (!self.busy.swap(true, Ordering::Acquire)).then(|| Call(self))
    }
}

/// A call in progress; its end admits the next one.
struct Call<'g>(&'g Guarded);

impl Call<'_> {
    fn component(&mut self) -> &mut Component {
        // SAFETY: `busy` admits one call at a time, and only a call accesses the component.
        unsafe { &mut *self.0.component.get() }
    }
}

impl Drop for Call<'_> {
    fn drop(&mut self) {
        self.0.busy.store(false, Ordering::Release);
    }
}

/// Passes a new instance to the importer.
pub(super) fn hand_out(component: Component) -> fmi2Component {
    let guarded = Guarded { busy: AtomicBool::new(false), component: UnsafeCell::new(component) };
    Box::into_raw(Box::new(guarded)).cast()
}

/// Frees an instance. One freed by its own logger during a call is leaked, because the call continues with it.
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

/// Admits one call: checks the instance and the sequence of calls, makes the call, and returns its status. A problem becomes
/// fmi2Error with a message; so does a panic, after which the run cannot continue without a reset. A model's request to end the
/// simulation becomes fmi2Discard.
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
        // There is no way to report this: the logger belongs to the instance, and may be the caller.
        return fmi2Status::fmi2Error;
    };
    let component = call.component();
    let outcome = if function.allowed_in(component.stage.state) {
        // After a panic the values are arbitrary but readable; a second panic ends here as well. No step uses them: only a
        // reset or a snapshot leaves the state `error`, and both replace all values.
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
        Err(Problem::End(text)) => {
            component.logger.send(
                fmi2Status::fmi2Discard,
                Category::Events,
                format_args!("{}: {text}", function.name()),
            );
            return fmi2Status::fmi2Discard;
        }
        Err(Problem::Run(text)) => {
            component.stage.state = State::Error;
            text
        }
    };
    component.logger.send(fmi2Status::fmi2Error, Category::StatusError, format_args!("{}: {text}", function.name()));
    fmi2Status::fmi2Error
}

/// The message of a panic.
fn words(panic: &(dyn Any + Send)) -> &str {
    panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("a panic without a message")
}
