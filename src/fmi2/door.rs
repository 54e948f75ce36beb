//! The one door through which calls from an importer come in.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use super::bindings::{fmi2Component, fmi2Status};
use super::component::{Component, Outcome, Problem};
use super::logger::Category;
use super::sequence::{Function, State};

/// Lets one call in: checks the instance and the sequence of calls, carries the call out, and answers with a status. A
/// problem becomes fmi2Error with a message; so does a panic, after which only a reset or the end are allowed.
///
/// # Safety
/// `component` is null or was made by `fmi2Instantiate`, was not freed since, and is not used by another call meanwhile.
pub(super) unsafe fn enter(
    component: fmi2Component,
    function: Function,
    body: impl FnOnce(&mut Component) -> Outcome,
) -> fmi2Status {
    // SAFETY: a pointer that is not null is, by this function's contract, a live component that no one else uses.
    let Some(component) = (unsafe { component.cast::<Component>().as_mut() }) else {
        // Nobody can be told: the logger belongs to the instance.
        return fmi2Status::fmi2Error;
    };
    let outcome = if function.allowed_in(component.stage.state) {
        // After a panic the slave is not used again before it is reset, so a broken invariant cannot be seen.
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
pub(super) fn words(panic: &(dyn Any + Send)) -> &str {
    panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("a panic without words")
}
