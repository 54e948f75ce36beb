//! The entry guard: every call on an instance passes it.

use std::any::Any;
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, TryLockError};

use super::Interface;
use super::component::{Component, Outcome, Problem};
use super::logger::Category;
use super::sequence::{Rule, State};

/// Target of the importer's pointer: an instance, locked during a call on it.
///
/// The standard forbids concurrent calls, yet loggers call back into their instance, and importers share instances between
/// threads. Such a call is refused, so that it never sees an instance during a change.
type Guarded<I> = Mutex<Component<I>>;

/// Begins a call, unless one is in progress. The end of the call, when the result is dropped, admits the next one.
fn begin<I: Interface>(guarded: &Guarded<I>) -> Option<MutexGuard<'_, Component<I>>> {
    match guarded.try_lock() {
        Ok(component) => Some(component),
        // No panic leaves a call, which catches its own.
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

/// Passes a new instance to the importer.
pub(crate) fn hand_out<I: Interface>(component: Component<I>) -> *mut c_void {
    Box::into_raw(Box::new(Guarded::new(component))).cast()
}

/// Frees an instance. An instance freed by its own logger during a call is leaked, because the call still uses it.
///
/// # Safety
/// `component` is null or was made by [`hand_out`] for this standard, and is not used again.
pub(crate) unsafe fn take_back<I: Interface>(component: *mut c_void) {
    let guarded = component.cast::<Guarded<I>>();
    // SAFETY: a pointer that is not null is, by this function's contract, a live instance.
    if unsafe { guarded.as_ref() }.is_some_and(|guarded| begin(guarded).is_some()) {
        // SAFETY: `hand_out` made the pointer of a box; no call is in progress, and by contract none follows.
        let guarded = unsafe { Box::from_raw(guarded) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(guarded)));
    }
}

/// Admits one call: checks the instance and the sequence of calls, makes the call, and returns its status. A problem becomes
/// an error with a message; so does a panic, after which the run cannot continue without a reset. A model's request to end the
/// simulation has its own status.
///
/// # Safety
/// `component` is null or was made by [`hand_out`] for this standard, and was not taken back since.
pub(crate) unsafe fn enter<F: Rule>(
    component: *mut c_void,
    function: F,
    body: impl FnOnce(&mut Component<F::Standard>) -> Outcome,
) -> <F::Standard as Interface>::Status {
    // SAFETY: a pointer that is not null is, by this function's contract, a live instance.
    let guarded = unsafe { component.cast::<Guarded<F::Standard>>().as_ref() };
    let Some(mut component) = guarded.and_then(begin) else {
        // This cannot be reported: the logger belongs to the instance, and may be the caller.
        return F::Standard::ERROR;
    };
    let component = &mut *component;
    if function.states() & component.stage.state as u8 == 0 {
        let problem = out_of_sequence(component, function);
        return failed(component, function, problem);
    }
    // After a panic the values are arbitrary but readable; another panic is caught here too. No step uses them: only a reset or
    // a snapshot leaves the state `error`, and both replace all values.
    let outcome = catch_unwind(AssertUnwindSafe(|| body(component)));
    let problem = match outcome {
        Ok(Ok(())) => return F::Standard::OK,
        Ok(Err(problem)) => problem,
        Err(panic) => defect::<F::Standard>(panic.as_ref()),
    };
    failed(component, function, problem)
}

// Every exported function has its own copy of `enter`; inlining the following functions would enlarge the library by a tenth.

/// Reports a problem, and returns its status.
#[cold]
#[inline(never)]
fn failed<F: Rule>(
    component: &mut Component<F::Standard>,
    function: F,
    problem: Problem,
) -> <F::Standard as Interface>::Status {
    let (status, category, text) = match problem {
        Problem::Call(text) => (F::Standard::ERROR, Category::StatusError, text),
        Problem::End(text) => (F::Standard::ENDED, Category::Events, text),
        Problem::Run(text) => {
            component.stage.state = State::Error;
            (F::Standard::ERROR, Category::StatusError, text)
        }
    };
    component.logger.send(status, category, format_args!("{}: {text}", function.name()));
    status
}

/// A call in a state in which it is not allowed.
#[cold]
#[inline(never)]
fn out_of_sequence<F: Rule>(component: &Component<F::Standard>, function: F) -> Problem {
    let named = |states: u8| {
        let states = F::Standard::STATES.iter().filter(|(state, _)| states & *state as u8 != 0);
        states.map(|(_, name)| *name).collect::<Vec<_>>().join(", ")
    };
    let (state, allowed) = (named(component.stage.state as u8), named(function.states()));
    let allowed = if allowed.is_empty() { "no state that occurs here" } else { &allowed };
    Problem::Call(format!("not allowed in the state `{state}`; allowed in: {allowed}"))
}

/// A panic.
#[cold]
#[inline(never)]
fn defect<I: Interface>(panic: &(dyn Any + Send)) -> Problem {
    Problem::Run(format!(
        "a defect of this FMU, please report it: {}; it can be used again after {}",
        panic_message(panic),
        I::RESET
    ))
}

/// The message of a panic.
pub(crate) fn panic_message(panic: &(dyn Any + Send)) -> &str {
    panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("a panic without a message")
}
