//! Inputs over a communication step: held, or polynomials where their derivatives are given.

use serde::{Deserialize, Serialize};

use super::variable::{Row, Value};

/// The highest order of a derivative of an input that is taken into account.
pub const HIGHEST_ORDER: usize = 4;

/// The derivatives of one input with respect to time at the begin of a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Slope {
    /// Index of the input in the table.
    pub index: usize,
    /// Derivatives of order 1, 2, … in the unit of the input over powers of seconds.
    pub derivatives: [f64; HIGHEST_ORDER],
}

impl Slope {
    /// Without any slope.
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

/// The inputs over one step, whose values at its begin are those given when this was made.
///
/// `u(t) = u + Σ_j d_j (t − t_0)^j / j!` for every input with derivatives d; all others are held.
pub struct Course<D: 'static> {
    since_s: f64,
    rows: &'static [Row<D>],
    /// Each with the value at the begin of the step.
    slopes: Vec<(f64, Slope)>,
}

impl<D> Course<D> {
    pub(super) fn new(since_s: f64, rows: &'static [Row<D>], values: &D, slopes: &[Slope]) -> Self {
        let value = |slope: &Slope| match rows[slope.index].get(values) {
            Value::Real(value) => value,
            _ => unreachable!("only inputs of type Real are given a slope"),
        };
        Self { since_s, rows, slopes: slopes.iter().map(|slope| (value(slope), *slope)).collect() }
    }

    /// Whether all inputs are held.
    pub fn is_held(&self) -> bool {
        self.slopes.is_empty()
    }

    /// The time at which the values and derivatives hold, in seconds.
    pub fn since_s(&self) -> f64 {
        self.since_s
    }

    /// Sets the inputs to what they are at a time, in seconds; before the begin of the step, to what they are there.
    pub fn put(&self, values: &mut D, time_s: f64) {
        for (value, slope) in &self.slopes {
            self.write(values, slope.index, value + slope.change((time_s - self.since_s).max(0.0)));
        }
    }

    /// Puts the derivatives of that order, from 1, into the places of the inputs; places of held inputs are left alone.
    pub fn put_derivative(&self, values: &mut D, order: usize) {
        for (_, slope) in &self.slopes {
            self.write(values, slope.index, slope.derivatives[order - 1]);
        }
    }

    fn write(&self, values: &mut D, index: usize, value: f64) {
        let fits = self.rows[index].set(values, Value::Real(value));
        debug_assert!(fits, "only inputs of type Real are given a slope");
    }
}
