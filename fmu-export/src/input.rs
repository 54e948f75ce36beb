//! Inputs over a communication step: held, or polynomials if their derivatives are given.

use serde::{Deserialize, Serialize};

use crate::variable::{Table, Value};

/// The highest order of input derivatives.
pub const HIGHEST_ORDER: usize = 4;

/// The derivatives of one input with respect to time at the start of a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct InputDerivatives {
    /// Index of the input in the table.
    pub index: usize,
    /// Derivatives of order 1, 2, … in the unit of the input per power of seconds.
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
        // Horner's scheme: d_1 t + d_2 t²/2 + … = (d_1 + (d_2 + …) t/2) t.
        self.derivatives.iter().enumerate().rev().fold(0.0, scheme)
    }

    /// The derivatives after `elapsed_s`.
    pub fn after(&self, elapsed_s: f64) -> Self {
        let mut later = *self;
        for order in 0..HIGHEST_ORDER {
            let mut higher = Self::of(self.index);
            let of_higher_order = &self.derivatives[order + 1..];
            higher.derivatives[..of_higher_order.len()].copy_from_slice(of_higher_order);
            later.derivatives[order] = self.derivatives[order] + higher.change(elapsed_s);
        }
        later
    }
}

/// Inputs with derivatives from a start time on.
pub(crate) struct InputPolynomials {
    start_s: f64,
    /// With the value of each input at that time.
    inputs: Vec<(f64, InputDerivatives)>,
}

impl InputPolynomials {
    /// `read` gives the value of an input.
    pub fn new(start_s: f64, inputs: &[InputDerivatives], read: impl Fn(usize) -> Value) -> Self {
        Self { start_s, inputs: inputs.iter().map(|input| (read(input.index).as_f64(), *input)).collect() }
    }

    /// Writes the values at a time, each with the index of its input.
    pub fn at(&self, time_s: f64, write: &mut dyn FnMut(usize, Value)) {
        for (value, input) in &self.inputs {
            write(input.index, Value::Real(value + input.change((time_s - self.start_s).max(0.0))));
        }
    }
}

/// The inputs over one step, starting at the values given at construction.
///
/// `u(t) = u + Σ_j d_j (t − t_0)^j / j!` for every input with derivatives d; all others are held.
pub struct InputTrajectory<'t, D> {
    pub(crate) table: &'t Table<D>,
    pub(crate) polynomials: &'t InputPolynomials,
}

impl<D> InputTrajectory<'_, D> {
    /// Whether all inputs are held.
    pub fn is_held(&self) -> bool {
        self.polynomials.inputs.is_empty()
    }

    /// The time of the values and derivatives, in seconds.
    pub fn start_s(&self) -> f64 {
        self.polynomials.start_s
    }

    /// Sets the inputs to their values at a time, in seconds; before the start of the step, to those at its start.
    pub fn apply(&self, values: &mut D, time_s: f64) {
        self.polynomials.at(time_s, &mut |index, value| self.write(values, index, value));
    }

    /// Writes the derivatives of that order, from 1, in place of the inputs; held inputs are not changed.
    pub fn apply_derivatives(&self, values: &mut D, order: usize) {
        for (_, input) in &self.polynomials.inputs {
            self.write(values, input.index, Value::Real(input.derivatives[order - 1]));
        }
    }

    fn write(&self, values: &mut D, index: usize, value: Value) {
        let fits = self.table.set(index, values, value);
        debug_assert!(fits, "only inputs of type Real are given derivatives");
    }
}
