//! Inputs over a communication step: held, or polynomials where their derivatives are given.

use serde::{Deserialize, Serialize};

use crate::variable::{Table, Value};

/// The highest order of a derivative of an input that is taken into account.
pub const HIGHEST_ORDER: usize = 4;

/// The derivatives of one input with respect to time at the beginning of a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct InputDerivatives {
    /// Index of the input in the table.
    pub index: usize,
    /// Derivatives of order 1, 2, … in the unit of the input over powers of seconds.
    pub derivatives: [f64; HIGHEST_ORDER],
}

impl InputDerivatives {
    /// All 0.
    pub fn of(index: usize) -> Self {
        Self { index, derivatives: [0.0; HIGHEST_ORDER] }
    }

    /// The change after `elapsed_s`: `Σ_j d_j elapsed^j / j!`.
    fn change(&self, elapsed_s: f64) -> f64 {
        let scheme = |higher: f64, (j, d): (usize, &f64)| (d + higher) * elapsed_s / (j + 1) as f64;
        // d_1 t + d_2 t²/2 + … = (d_1 + (d_2 + …) t/2) t, from the innermost bracket outwards.
        self.derivatives.iter().enumerate().rev().fold(0.0, scheme)
    }

    /// The derivatives after `elapsed_s`.
    pub fn after(&self, elapsed_s: f64) -> Self {
        let mut later = *self;
        for order in 0..HIGHEST_ORDER {
            let mut rest = Self::of(self.index);
            let higher = &self.derivatives[order + 1..];
            rest.derivatives[..higher.len()].copy_from_slice(higher);
            later.derivatives[order] = self.derivatives[order] + rest.change(elapsed_s);
        }
        later
    }
}

/// The inputs over one step, whose values at its beginning are those given when this was made.
///
/// `u(t) = u + Σ_j d_j (t − t_0)^j / j!` for every input with derivatives d; all others are held.
pub struct InputTrajectory<'t, D> {
    start_s: f64,
    table: &'t Table<D>,
    /// Each with the value at the beginning of the step.
    moving: Vec<(f64, InputDerivatives)>,
}

impl<'t, D> InputTrajectory<'t, D> {
    pub(crate) fn new(start_s: f64, table: &'t Table<D>, values: &D, derivatives: &[InputDerivatives]) -> Self {
        let value = |input: &InputDerivatives| match table.get(input.index, values) {
            Value::Real(value) => value,
            _ => unreachable!("only inputs of type Real are given derivatives"),
        };
        Self { start_s, table, moving: derivatives.iter().map(|input| (value(input), *input)).collect() }
    }

    /// Whether all inputs are held.
    pub fn is_held(&self) -> bool {
        self.moving.is_empty()
    }

    /// The time at which the values and derivatives hold, in seconds.
    pub fn start_s(&self) -> f64 {
        self.start_s
    }

    /// Sets the inputs to what they are at a time, in seconds; before the beginning of the step, to what they are there.
    pub fn apply(&self, values: &mut D, time_s: f64) {
        for (value, input) in &self.moving {
            self.write(values, input.index, value + input.change((time_s - self.start_s).max(0.0)));
        }
    }

    /// Puts the derivatives of that order, from 1, into the places of the inputs; places of held inputs are left alone.
    pub fn apply_derivatives(&self, values: &mut D, order: usize) {
        for (_, input) in &self.moving {
            self.write(values, input.index, input.derivatives[order - 1]);
        }
    }

    fn write(&self, values: &mut D, index: usize, value: f64) {
        let fits = self.table.set(index, values, Value::Real(value));
        debug_assert!(fits, "only inputs of type Real are given derivatives");
    }
}
