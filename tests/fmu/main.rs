//! The models as FMUs: their variables and steps, and the C interface that importers call.

#[path = "../support/mod.rs"]
mod support;

mod abuse;
mod bindings;
mod derivatives;
// The program writes the documentation page.
#[cfg(feature = "app")]
mod description;
mod guard;
mod initial;
mod instances;
mod log;
mod prelude;
mod session;
mod stack;
mod state;
mod time;

use fmu_export::variable::{Causality, Type};
use support::ffi::{Expect, Fmu};

/// Does steps of 0.1 ms with these numbers, with continuous inputs that depend on the number.
pub fn drive(fmu: &Fmu, steps: std::ops::Range<u32>) {
    for step in steps {
        for input in inputs(fmu) {
            let Type::Real { start, nominal, .. } = fmu.variables()[input as usize].data_type else { unreachable!() };
            // Strong enough to move every part of a state, too weak for a rotor to reach a magnet.
            let wave = f64::sin(0.7 * f64::from(step) + f64::from(input));
            fmu.set_reals(&[input], &[start + 0.1 * nominal * wave]).ok(fmu);
        }
        fmu.step(f64::from(step) * 1e-4, 1e-4).ok(fmu);
    }
}

/// The references of the continuous inputs.
pub fn inputs(fmu: &Fmu) -> Vec<u32> {
    let rows = (0..).zip(fmu.variables());
    let inputs = rows.filter(|(_, variable)| variable.causality == Causality::Input && variable.is_continuous());
    inputs.map(|(reference, _)| reference).collect()
}
